# SPDX-License-Identifier: Apache-2.0
"""Recorded wrenches in the frame in which they were asked for, while the platform moves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.bags.reader import Bag, Series
from cabols_control.checks import FloatArray, IntArray
from cabols_control.configuration import load_config
from cabols_control.errors import CabolsError
from cabols_control.frames import RigFrames
from cabols_control.geometry import load_geometry
from cabols_control.wrench_control.frames import WrenchFrames, wrench_frames

POSITION = tuple(f"pose.position.{axis}" for axis in "xyz")
QUATERNION = tuple(f"pose.orientation.{axis}" for axis in "xyzw")
UNCERTAINTY = tuple(f"uncertainty.{kind}.{axis}" for kind in ("force", "torque") for axis in "xyz")
TOLD_WITHIN_NS = 100_000_000
"""Longest time for which an uncertainty that was told holds [ns]."""


@dataclass(frozen=True, eq=False)
class PlatformPoses:
    """Poses of the platform at k samples.

    Attributes:
        position: (k, 3) of its origin, base frame [m].
        rotation: (k, 3, 3) from platform to base axes.
    """

    position: FloatArray
    rotation: FloatArray


def poses_at(bag: Bag, samples_ns: IntArray) -> PlatformPoses | None:
    """Return the platform's poses at samples, between the recorded ones; None without any.

    Args:
        bag: of the run.
        samples_ns: (k,) stamps [ns].
    """
    if "platform_pose" not in bag or not len(bag["platform_pose"]):
        return None
    series = bag["platform_pose"]
    stamps, rows = np.unique(series.stamp_ns, return_index=True)
    place, quaternion = (_columns(series, names)[rows] for names in (POSITION, QUATERNION))
    turn = Rotation.from_quat(quaternion)
    after = np.clip(np.searchsorted(stamps, samples_ns, side="right"), 1, max(stamps.size - 1, 1))
    before, after = after - 1, np.minimum(after, stamps.size - 1)
    span = np.maximum(stamps[after] - stamps[before], 1)
    share = np.clip((samples_ns - stamps[before]) / span, 0.0, 1.0)
    way = (turn[after] * turn[before].inv()).as_rotvec()
    return PlatformPoses(
        position=place[before] + share[:, None] * (place[after] - place[before]),
        rotation=(Rotation.from_rotvec(share[:, None] * way) * turn[before]).as_matrix(),
    )


def _columns(series: Series, names: tuple[str, ...]) -> FloatArray:
    return np.column_stack([np.asarray(series[name], dtype=np.float64) for name in names])


def recorded_frames(metadata: Mapping[str, str]) -> WrenchFrames | None:
    """Return the frames of the rig that a bag carries; None if it carries none.

    Args:
        metadata: of the bag.
    """
    texts = {name: metadata.get(f"{name}_yaml") for name in ("frames", "geometry")}
    if not all(texts.values()):
        return None
    try:
        with TemporaryDirectory() as place:
            paths = {name: Path(place) / f"{name}.yaml" for name in texts}
            for name, path in paths.items():
                path.write_text(str(texts[name]), encoding="utf-8")
            geometry = load_geometry(paths["geometry"])
            found = load_config(RigFrames, paths["frames"])
        names = (geometry.base_frame, geometry.platform_frame)
        return wrench_frames(*names, found.tool_frame, found.sensor_frame, found.wrench_frames)
    except CabolsError:
        return None


def recorded_uncertainty(bag: Bag, samples_ns: IntArray) -> FloatArray:
    """(k, 6) newest uncertainty told before each of k samples; NaN where there is none [N, N m].

    Args:
        bag: of the run.
        samples_ns: (k,) stamps, increasing [ns].
    """
    found = np.full((samples_ns.size, 6), np.nan)
    if "frame_wrench" not in bag:
        return found
    series = bag["frame_wrench"]
    # Bags of before have no such field.
    if not len(series) or UNCERTAINTY[0] not in series.fields:
        return found
    order = np.argsort(series.stamp_ns, kind="stable")
    stamps, told = series.stamp_ns[order], _columns(series, UNCERTAINTY)[order]
    newest = np.searchsorted(stamps, samples_ns, side="right") - 1
    known = (newest >= 0) & (samples_ns - stamps[np.maximum(newest, 0)] <= TOLD_WITHIN_NS)
    found[known] = told[newest[known]]
    return found


def frame_of(bag: Bag, topic: str) -> str:
    """Return the frame of most of a topic's messages; empty if they name none.

    Args:
        bag: of the run.
        topic: with a header.
    """
    if topic not in bag:
        return ""
    names = list(bag[topic]["header.frame_id"])
    return max(set(names), key=names.count) if names else ""


@dataclass(frozen=True, eq=False)
class UserFrame:
    """A frame of wrenches along a run of k samples.

    Attributes:
        name: of the frame; empty: base axes about the platform's origin.
        lever: (k, 3) of its origin from the platform's, base axes [m].
        turn: (k, 3, 3) from its axes to base axes.
    """

    name: str = ""
    lever: FloatArray | None = None
    turn: FloatArray | None = None

    def from_base(self, wrench: FloatArray) -> FloatArray:
        """Return (k, 6) about its origin, in its axes, of (k, 6) in base axes [N, N m]."""
        if self.lever is None or self.turn is None:
            return wrench
        torque = wrench[:, 3:] - np.cross(self.lever, wrench[:, :3])
        back = self.turn.transpose(0, 2, 1)
        return np.hstack([_turned(back, wrench[:, :3]), _turned(back, torque)])

    def to_base(self, wrench: FloatArray) -> FloatArray:
        """Return (k, 6) about the platform's origin, base axes, of (k, 6) in it [N, N m]."""
        if self.lever is None or self.turn is None:
            return wrench
        force = _turned(self.turn, wrench[:, :3])
        torque = _turned(self.turn, wrench[:, 3:]) + np.cross(self.lever, force)
        return np.hstack([force, torque])


def _turned(turn: FloatArray, vectors: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("kij,kj->ki", turn, vectors))


def user_frame(
    frames: WrenchFrames | None, name: str, poses: PlatformPoses | None
) -> UserFrame | None:
    """Place a frame along a run; None if it is not known where it was.

    Args:
        frames: of the rig; None: not recorded.
        name: of the frame.
        poses: of the platform; None: not recorded.
    """
    if not name or (frames is not None and name == frames.names[0]):
        return UserFrame()
    if frames is None or name not in frames.names or poses is None:
        return None
    return UserFrame(name, *frames.along(name, poses.position, poses.rotation))
