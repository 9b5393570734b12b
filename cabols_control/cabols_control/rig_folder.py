# SPDX-License-Identifier: Apache-2.0
"""A rig is a folder of files: their names, their readers, and the folder of a rig's name."""

from __future__ import annotations

import hashlib
import warnings
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from cabols_control.errors import ConfigError

BENCH = "bench"
"""The reference bench, which is installed with this package."""


class RigWarning(UserWarning):
    """A rig's files or numbers are odd."""


@dataclass(frozen=True)
class RigFile:
    """One file of a rig's folder.

    Attributes:
        name: in the folder.
        package: whose schema reads it.
        holds: its content.
        without: what happens where the file is missing; empty: the rig cannot be used without it.
    """

    name: str
    package: str
    holds: str
    without: str = ""


FILES = (
    RigFile("geometry.yaml", "cabols_control", "attachment points and reference pose"),
    RigFile("limbs.yaml", "cabols_control", "identified motors, cable stiffness, switches"),
    RigFile("control.yaml", "cabols_control", "design of both loops and their limits"),
    RigFile("card.yaml", "cabols_hw", "wiring and scaling of the card, force/torque sensor"),
    RigFile("safety.yaml", "cabols_hw", "safety envelope"),
    RigFile("frames.yaml", "cabols_control", "where tool, sensor, tracker, reflectors are"),
    RigFile("robot.yaml", "cabols_hw", "stored configurations of the robot"),
    RigFile("robot.urdf", "cabols_stiffness", "kinematics of the robot"),
    RigFile("tracker.yaml", "cabols_hw", "laser tracker: address, times, noise"),
    RigFile("campaign.yaml", "cabols_stiffness", "loads of a stiffness campaign"),
    RigFile("bodies.yaml", "cabols_control", "what cables must not touch"),
    RigFile("sensor.cal", "cabols_hw", "calibration that card.yaml may name", "none is named"),
    RigFile(
        "plant.yaml",
        "cabols_sim",
        "physics of the simulated limbs, card and sensors",
        "the simulated limbs, card and sensors are as the bench's",
    ),
    RigFile("robot_truth.yaml", "cabols_sim", "physics of the simulated robot"),
    RigFile(
        "tracker_truth.yaml",
        "cabols_sim",
        "truth about the simulated laser tracker",
        "the simulated tracker and its reflectors are where frames.yaml says",
    ),
)


@dataclass(frozen=True)
class RigFolder:
    """The folder of one rig.

    Attributes:
        path: of the folder.
    """

    path: Path

    @property
    def name(self) -> str:
        """Name of the rig: that of its folder."""
        return self.path.name

    @property
    def fingerprint(self) -> str:
        """Twelve digits of the hash of all its files: two rigs with one are configured alike."""
        digest = hashlib.sha256()
        for file in FILES:
            if self.has(file.name):
                digest.update(file.name.encode() + b"\0")
                digest.update((self.path / file.name).read_bytes() + b"\0")
        return digest.hexdigest()[:12]

    def has(self, name: str) -> bool:
        """Whether the folder has this file."""
        return (self.path / name).is_file()

    def optional(self, name: str) -> Path | None:
        """Path of a file that may be missing: then None, and a warning of what holds instead."""
        if self.has(name):
            return self.path / name
        instead = next(file.without for file in FILES if file.name == name)
        warnings.warn(f"rig {self.path}: no {name}: {instead}", RigWarning, stacklevel=3)
        return None

    def file(self, name: str) -> Path:
        """Path of one of the rig's files.

        Raises:
            ConfigError: if the folder has no such file.
        """
        path = self.path / name
        if not path.is_file():
            known = ", ".join(sorted(entry.name for entry in self.path.iterdir())) or "nothing"
            raise ConfigError(f"rig {self.path}: expected {name}, got {known}")
        return path


def find_rig(rig: str | Path | RigFolder = "") -> RigFolder:
    """Find the folder of a rig.

    Args:
        rig: name of an installed rig or of a folder in the working directory, or a path, in which
            `~` stands for the home directory; empty: the reference bench.

    Raises:
        ConfigError: if there is no such folder.
    """
    if isinstance(rig, RigFolder):
        return rig
    installed = Path(str(files("cabols_control") / "rigs"))
    text = str(rig) or BENCH
    if (installed / text).is_dir() and Path(text).name == text and text not in (".", ".."):
        return RigFolder(installed / text)
    try:
        path = Path(text).expanduser().absolute()
    except RuntimeError as error:
        raise ConfigError(f"rig {text}: expected a folder, got {error}") from error
    if not path.is_dir():
        known = ", ".join(sorted(entry.name for entry in installed.iterdir() if entry.is_dir()))
        what = "a file" if path.exists() else "nothing there"
        raise ConfigError(
            f"rig {text}: expected the name of an installed rig ({known}) or the folder of a rig, "
            f"got {what}; `ros2 run cabols_control new_rig NAME` makes one"
        )
    return RigFolder(path)


def rig_file(name: str, given: str | Path | None = None, rig: str | Path | RigFolder = "") -> Path:
    """Path of one file of a rig, or of the file that is given in its place.

    Args:
        name: of the file in the rig's folder.
        given: another file; None or empty: the rig's.
        rig: see find_rig.

    Raises:
        ConfigError: if the rig or its file is missing.
    """
    return Path(given).expanduser() if given else find_rig(rig).file(name)
