# SPDX-License-Identifier: Apache-2.0
"""Frames in which a wrench may be desired: axes, and the point about which its torque is.

A wrench (f, m) about a frame's origin F, in its axes, is about the platform's origin P, base axes,

    f_0 = R_0F f,    m_0 = R_0F m + (p_F - p_P) x f_0,

the adjoint of the frame's pose (Lynch and Park, Modern Robotics, 3.4). A frame moves with the
platform, or stands in the rig; its origin is as far from the platform's as the pose says, so that
the lever is computed anew at each sample.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Literal

import numpy as np
from pydantic.dataclasses import dataclass as config_dataclass

from cabols_control.checks import (
    FloatArray,
    finite_array,
    plain_array,
    rotation_matrix,
    shaped_array,
)
from cabols_control.compiling import njit
from cabols_control.configuration import STRICT
from cabols_control.errors import ConfigError, ShapeError
from cabols_control.placement import Frame

OWN_NAMES = ("tool", "sensor", "flange")
"""Frames that each rig has, beside its base and its platform."""


FARTHEST_M = 50.0
"""Origins beyond are of another unit: no rig is so large, and torque would be force alone [m]."""
_NAME = re.compile(r"[^\W\d_][\w./-]{0,63}")


class Axes(IntEnum):
    """In whose axes a frame's wrenches are."""

    OWN = 0
    BASE = 1
    PLATFORM = 2


@config_dataclass(frozen=True, config=STRICT)
class WrenchFrame(Frame):
    """A frame of the user's, in frames.yaml under wrench_frames.

    Attributes:
        parent: platform, with which it moves; base, in which it stands.
        axes: own; or base or platform, where only its origin counts.
    """

    parent: Literal["platform", "base"] = "platform"
    axes: Literal["own", "base", "platform"] = "own"


WRENCH_FRAME = np.dtype(
    [
        ("fixed", np.int64),  # whether it stands in the rig
        ("axes", np.int64),  # Axes
        ("position", np.float64, (3,)),  # of its origin, in its parent [m]
        ("rotation", np.float64, (3, 3)),  # from its axes to its parent's
        ("lever", np.float64, (3,)),  # from the platform's origin, base axes, at the pose [m]
        ("turn", np.float64, (3, 3)),  # from its wrenches' axes to base axes, at the pose
    ],
    align=True,
)
"""A frame, and where the platform's pose puts it."""


@njit(cache=True)
def place_frame(frame: Any, position: FloatArray, rotation: FloatArray) -> None:
    """Set lever and turn of a frame at a pose of the platform.

    Args:
        frame: (1,) record of WRENCH_FRAME; updated.
        position: (3,) of the platform's origin, base frame [m].
        rotation: (3, 3) from platform to base axes.
    """
    own = frame[0]
    place, turned, lever, turn = own["position"], own["rotation"], own["lever"], own["turn"]
    for i in range(3):
        lever[i] = place[i] - position[i] if own["fixed"] else 0.0
        for j in range(3):
            if not own["fixed"]:
                lever[i] += rotation[i, j] * place[j]
            if own["axes"] == Axes.BASE:
                turn[i, j] = 1.0 if i == j else 0.0
            elif own["axes"] == Axes.PLATFORM:
                turn[i, j] = rotation[i, j]
            elif own["fixed"]:
                turn[i, j] = turned[i, j]
            else:
                turn[i, j] = 0.0
                for k in range(3):
                    turn[i, j] += rotation[i, k] * turned[k, j]


@njit(cache=True)
def _add_moment(lever: FloatArray, force: FloatArray, sign: float, torque: FloatArray) -> None:
    """Add sign * lever x force to torque, all (3,)."""
    torque[0] += sign * (lever[1] * force[2] - lever[2] * force[1])
    torque[1] += sign * (lever[2] * force[0] - lever[0] * force[2])
    torque[2] += sign * (lever[0] * force[1] - lever[1] * force[0])


@njit(cache=True)
def wrench_to_base(frame: Any, wrench: FloatArray, moved: FloatArray) -> None:
    """Fill moved (6,) about the platform's origin, base axes, of a wrench (6,) in a placed frame.

    Args:
        frame: (1,) record of WRENCH_FRAME, placed.
        wrench: (6,) about its origin, in its axes [N, N m].
        moved: (6,), filled [N, N m].
    """
    own = frame[0]
    turn = own["turn"]
    force, torque = np.zeros(3), np.zeros(3)
    for i in range(3):
        for j in range(3):
            force[i] += turn[i, j] * wrench[j]
            torque[i] += turn[i, j] * wrench[3 + j]
    _add_moment(own["lever"], force, 1.0, torque)
    for i in range(3):
        moved[i], moved[3 + i] = force[i], torque[i]


@njit(cache=True)
def wrench_from_base(frame: Any, wrench: FloatArray, moved: FloatArray) -> None:
    """Fill moved (6,) in a placed frame of a wrench (6,) about the platform's origin, base axes.

    Args:
        frame: (1,) record of WRENCH_FRAME, placed.
        wrench: (6,) about the platform's origin, base axes [N, N m].
        moved: (6,) about the frame's origin, in its axes, filled [N, N m].
    """
    own = frame[0]
    turn = own["turn"]
    force, torque = np.empty(3), np.empty(3)
    for i in range(3):
        force[i], torque[i] = wrench[i], wrench[3 + i]
    _add_moment(own["lever"], force, -1.0, torque)
    for i in range(3):
        moved[i] = moved[3 + i] = 0.0
        for j in range(3):
            moved[i] += turn[j, i] * force[j]
            moved[3 + i] += turn[j, i] * torque[j]


@dataclass(frozen=True, eq=False)
class WrenchFrames:
    """The frames of a rig by name.

    Attributes:
        names: of all of them; the first is the rig's base frame, whose wrenches are about the
            platform's origin.
        own: names of the user's, which were placed by hand.
    """

    names: tuple[str, ...]
    _records: Mapping[str, Any]
    own: frozenset[str] = frozenset()

    def record(self, name: str) -> Any:
        """Return a frame of the caller's own, a (1,) record of WRENCH_FRAME, not placed yet.

        Args:
            name: of the frame; empty: the rig's base frame.

        Raises:
            ConfigError: if there is none of that name.
        """
        found = self._records.get(name or self.names[0])
        if found is None:
            raise ConfigError(f"frame: expected one of {', '.join(self.names)}, got {name}")
        return found.copy()

    def along(
        self, name: str, positions: FloatArray, rotations: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Place a frame at k poses of the platform.

        Args:
            name: of the frame.
            positions: (k, 3) of the platform's origin, base frame [m].
            rotations: (k, 3, 3) from platform to base axes.

        Returns:
            (k, 3) its origin from the platform's, base axes [m], and (k, 3, 3) from the axes of its
            wrenches to base axes.

        Raises:
            ConfigError, ShapeError: if there is no such frame, or an argument is not valid.
        """
        frame = self.record(name)
        places = shaped_array("positions", positions, (None, 3))
        rotated = shaped_array("rotations", rotations, (places.shape[0], 3, 3))
        levers, turns = np.empty_like(places), np.empty_like(rotated)
        for k in range(places.shape[0]):
            place_frame(frame, places[k].copy(), rotated[k].copy())
            levers[k], turns[k] = frame[0]["lever"], frame[0]["turn"]
        return levers, turns

    def to_base(
        self, name: str, wrenches: FloatArray, position: FloatArray, rotation: FloatArray
    ) -> FloatArray:
        """Move wrenches to the platform's origin, base axes.

        Args:
            name: of the frame that they are in; empty: the rig's base frame.
            wrenches: (..., 6) [N, N m].
            position: (3,) of the platform's origin, base frame [m].
            rotation: (3, 3) from platform to base axes.

        Returns:
            (..., 6) [N, N m].

        Raises:
            ConfigError, ShapeError: if there is no such frame, or an argument is not valid.
        """
        return self._move(wrench_to_base, name, wrenches, position, rotation)

    def from_base(
        self, name: str, wrenches: FloatArray, position: FloatArray, rotation: FloatArray
    ) -> FloatArray:
        """Move wrenches about the platform's origin, base axes, into a frame; see to_base.

        Args:
            name: of the frame; empty: the rig's base frame.
            wrenches: (..., 6) [N, N m].
            position: (3,) of the platform's origin, base frame [m].
            rotation: (3, 3) from platform to base axes.
        """
        return self._move(wrench_from_base, name, wrenches, position, rotation)

    def _move(
        self, kernel: Any, name: str, wrenches: FloatArray, position: Any, rotation: Any
    ) -> FloatArray:
        frame = self.record(name)
        place = finite_array("position", position, (3,)).copy()
        place_frame(frame, place, rotation_matrix("rotation", rotation).copy())
        try:
            given = plain_array(wrenches)
        except (TypeError, ValueError, OverflowError) as error:
            raise ShapeError(f"wrenches: expected numbers (..., 6), got {wrenches!r}") from error
        if given.shape[-1:] != (6,):
            raise ShapeError(f"wrenches: expected shape (..., 6), got {given.shape}")
        moved = np.zeros_like(given)
        for before, after in zip(given.reshape(-1, 6), moved.reshape(-1, 6), strict=True):
            kernel(frame, before, after)
        return moved


def _record(fixed: bool, axes: Axes, position: Any, rotation: Any) -> Any:
    record = np.zeros(1, WRENCH_FRAME)
    record["fixed"], record["axes"] = fixed, axes
    record["position"], record["rotation"] = position, rotation
    record["turn"] = np.eye(3)
    return record


def platform_axes() -> Any:
    """Return the frame of the platform's axes about its origin, a (1,) record, not placed yet."""
    return _record(False, Axes.OWN, np.zeros(3), np.eye(3))


def wrench_frames(
    base: str,
    platform: str,
    tool: Frame,
    sensor: Frame,
    own: Mapping[str, WrenchFrame],
) -> WrenchFrames:
    """Collect the frames of a rig.

    Args:
        base: name of the rig's base frame.
        platform: name of the platform's frame.
        tool: the platform in the robot's flange.
        sensor: the force/torque sensor in the platform.
        own: the user's, by name.

    Raises:
        ConfigError: if a frame of the user's has a name that is taken.
    """
    alias = {"base": _record(False, Axes.BASE, np.zeros(3), np.eye(3))} if base != "base" else {}
    standard = platform_axes()
    flange = tool.rotation.T
    records = {
        base: _record(False, Axes.BASE, np.zeros(3), np.eye(3)),
        **alias,
        platform: standard,
        "tool": standard,
        "sensor": _record(False, Axes.OWN, sensor.position, sensor.rotation),
        "flange": _record(False, Axes.OWN, -flange @ np.array(tool.position), flange),
    }
    for name, frame in own.items():
        if not name or name in records:
            taken = ", ".join(records)
            raise ConfigError(f"wrench_frames: expected another name than {taken}, got {name!r}")
        if not _NAME.fullmatch(name):
            raise ConfigError(
                "wrench_frames: expected names of at most 64 letters, digits and _ - . / that "
                f"begin with a letter, got {name!r}"
            )
        if not np.abs(frame.position).max() <= FARTHEST_M:
            raise ConfigError(
                f"wrench_frames.{name}: expected an origin within {FARTHEST_M:g} m of its "
                f"parent's, got {frame.position}; positions are in metres"
            )
        axes = Axes[frame.axes.upper()]
        records[name] = _record(frame.parent == "base", axes, frame.position, frame.rotation)
    found = WrenchFrames(tuple(records), records, frozenset(own))
    # Compile or load the kernels now: a control loop does not wait for a compiler.
    for move in (found.to_base, found.from_base):
        move(base, np.zeros(6), np.zeros(3), np.eye(3))
    return found
