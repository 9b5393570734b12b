# SPDX-License-Identifier: Apache-2.0
"""Make a rig's folder of what version 0.1 kept in single YAML files.

Names one of 0.1's files or a folder of them. Each is known by its name, or by its keys where it has
another one. Keys that moved to frames.yaml are taken there; files that are not given are the
bench's. Writes a new folder, never into an existing one, and leaves the old files alone.
Bags and campaigns of 0.1 open as they are.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from cabols_control.command_line import DONE, CommandParser, command
from cabols_control.configuration import read_yaml
from cabols_control.errors import ConfigError, UsageError
from cabols_control.rig import load_rig
from cabols_control.rig_folder import FILES, RigFolder, find_rig
from cabols_control.rig_tools.rig_moves import FILES_OF_0_1, KEYS_OF_0_1

FRAMES = "frames.yaml"
SCENE = "bench_scene.yaml"
KINDS = {
    "geometry.yaml": {"base_points", "platform_points"},
    "limbs.yaml": {"stiffness", "gain", "time_constant"},
    "control.yaml": {"poles", "zero"},
    "card.yaml": {"counts_per_metre"},
    "safety.yaml": {"tension_max", "wrench_max"},
    "robot.yaml": {"configurations", "tool_position"},
    "tracker.yaml": {"address", "reflectors"},
    "campaign.yaml": {"configurations", "paths"},
    "bodies.yaml": {"cable_radius", "platform"},
    "plant.yaml": {"limbs", "sensors"},
    "robot_truth.yaml": {"stiffness", "joint_speed"},
    "tracker_truth.yaml": {"reflector_axis", "drift"},
}
"""Keys by which a file of 0.1 is known that has a name of its own."""
STAYING = ("plant.yaml", "campaign.yaml")
"""Files whose moved keys are left where they stand: they may differ from the rig's."""


@dataclass
class Migration:
    """What becomes of one rig.

    Attributes:
        texts: of the new folder's files, by name.
        frames: content of frames.yaml.
        notes: what was done, a line each.
    """

    texts: dict[str, str] = field(default_factory=dict)
    frames: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def kind_of(path: Path) -> str | None:
    """Name in a rig's folder of one of 0.1's files.

    Args:
        path: of the file.

    Returns:
        The name; empty for a file that is no longer needed; None for one that is none of 0.1's.
    """
    if path.name in FILES_OF_0_1:
        return FILES_OF_0_1[path.name]
    if path.suffix in (".urdf", ".cal"):
        return "robot.urdf" if path.suffix == ".urdf" else "sensor.cal"
    if path.suffix not in (".yaml", ".yml"):
        return None
    keys = set(read_yaml(path))
    fitting = [name for name, needed in KINDS.items() if needed <= keys]
    return fitting[0] if len(fitting) == 1 else None


def without_keys(text: str, keys: Sequence[str]) -> str:
    """Take top-level keys with all that belongs to them out of a YAML text; comments stay.

    Args:
        text: YAML whose top level is a mapping in block style.
        keys: to take out.
    """
    kept, inside = [], False
    for line in text.splitlines(keepends=True):
        if line[:1] not in (" ", "#", "\n", "-"):
            inside = line.split(":")[0].strip() in keys
        if not inside or line.startswith("#"):
            kept.append(line)
    return "".join(kept)


def frames_of(name: str, content: Mapping[str, Any]) -> dict[str, Any]:
    """What one of 0.1's files says of frames.yaml: keys and values in its form.

    Args:
        name: of the file, as it is called today.
        content: of the file.
    """
    found: dict[str, Any] = {}
    for move in KEYS_OF_0_1:
        if move.file != name or move.target != FRAMES or move.key not in content:
            continue
        value, (key, _, part) = content[move.key], move.target_key.partition(".")
        if move.key == "sensor_rotation":
            matrix = np.asarray(value, dtype=np.float64)
            angles = Rotation.from_matrix(matrix).as_euler("XYZ", degrees=True)
            value = [round(float(angle), 9) + 0.0 for angle in angles]
        if part:
            found.setdefault(key, {})[part] = value
        elif key:
            found[key] = value
    return found


def migrate(sources: Sequence[Path]) -> Migration:
    """Read files of 0.1 and say what the folder of their rig holds.

    Args:
        sources: the files.

    Raises:
        ConfigError: if a file cannot be read, or two say the same of one rig.
    """
    done = Migration()
    origin: dict[str, Path] = {}
    for path in sources:
        name = kind_of(path)
        if name is None:
            done.notes.append(f"{path.name}: none of 0.1's files of a rig, left out")
            continue
        if not name:
            done.notes.append(f"{path.name}: no longer needed: frames.yaml and robot.urdf say it")
            continue
        if name in origin:
            raise ConfigError(
                f"{path}: expected one file for {name}, got {origin[name]}, too; name the one "
                "that is meant, or move the other away"
            )
        origin[name] = path
        text = path.read_text(encoding="utf-8")
        moved: list[str] = []
        if name not in STAYING and path.suffix in (".yaml", ".yml"):
            content = read_yaml(path)
            done.frames.update(frames_of(name, content))
            moved = [m.key for m in KEYS_OF_0_1 if m.file == name and m.key in content]
            text = without_keys(text, moved)
        # The sensor's file has a name of its own in a rig's folder.
        done.texts[name] = re.sub(r"(?m)^(ft_calibration_file:\s*)\S+\.cal", r"\1sensor.cal", text)
        where = f"; to {FRAMES}: {', '.join(moved)}" if moved else ""
        done.notes.append(f"{path.name} -> {name}{where}")
    if not origin:
        raise ConfigError("expected at least one of 0.1's files of a rig, got none")
    _fill(done)
    return done


def _fill(done: Migration) -> None:
    """Take from the bench what 0.1's files do not say."""
    bench = find_rig()
    if set(done.frames) or FRAMES not in done.texts:
        whole = {**read_yaml(bench.file(FRAMES)), **done.frames}
        missing = sorted(set(whole) - set(done.frames))
        head = "# Where tool, sensor, tracker and reflectors are: m, deg, kg.\n"
        done.texts[FRAMES] = head + yaml.safe_dump(whole, default_flow_style=None, sort_keys=False)
        if missing:
            done.notes.append(f"{FRAMES}: as the bench's: {', '.join(missing)}")
    for file in FILES:
        if file.name not in done.texts and bench.has(file.name):
            done.texts[file.name] = bench.file(file.name).read_text(encoding="utf-8")
            done.notes.append(f"{file.name}: the bench's, as no file of 0.1 says it")


def write(done: Migration, folder: Path) -> None:
    """Write a rig's folder.

    Args:
        done: what it holds.
        folder: that is made; nothing may be there yet.

    Raises:
        UsageError: if something is there.
        ConfigError: if what was written cannot be read as a rig.
    """
    try:
        folder.mkdir(parents=True)
    except FileExistsError as error:
        raise UsageError(
            f"{folder}: expected nothing there, got a file or folder; name another one by --output"
        ) from error
    for name, text in done.texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    load_rig(RigFolder(folder))


def opens_directly(path: Path) -> bool:
    """Whether a path is a bag or a campaign, which need no migration.

    Args:
        path: of a folder or a file.
    """
    if path.is_file():
        return path.suffix == ".mcap" or path.name in ("metadata.yaml", "result.yaml")
    return any((path / name).exists() for name in ("metadata.yaml", "samples.csv", "bags"))


@command
def main() -> int:
    """Make a rig's folder; returns 0, or 2 if there is something already."""
    parser = CommandParser("migrate", __doc__)
    parser.add_argument("source", type=Path, help="one of 0.1's files, or a folder of them")
    parser.add_argument("--output", type=Path, help="folder to make (default: SOURCE_rig)")
    options = parser.parse_args()
    source: Path = options.source
    if not source.exists():
        raise UsageError(f"{source}: expected a file or folder of 0.1, got nothing there")
    if opens_directly(source):
        print(f"{source}: bags, campaigns and results of 0.1 open as they are: nothing to do")
        return DONE
    files = [source] if source.is_file() else sorted(p for p in source.iterdir() if p.is_file())
    folder = options.output or source.with_name(f"{source.stem}_rig")
    done = migrate(files)
    write(done, folder)
    for note in done.notes:
        print(f"  {note}")
    print(f"{folder}: a rig; look at it with `ros2 run cabols_sim check_rig {folder}`")
    return DONE


if __name__ == "__main__":
    raise SystemExit(main())
