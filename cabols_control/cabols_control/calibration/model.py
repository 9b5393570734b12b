# SPDX-License-Identifier: Apache-2.0
"""What the rig's sensors read at a pose, for all poses at once: lengths and wrenches.

The same kinematics as `cable_kernels`, in numpy over arrays of poses, so that the derivatives by
90 parameters cost milliseconds. A cable's length is its offset, what the motor has let out and the
limb's elongation; tension is stiffness times elongation.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.checks import (
    BoolArray,
    FloatArray,
    IntArray,
    finite_array,
    in_range,
    shaped_array,
)
from cabols_control.errors import ShapeError
from cabols_control.naming import number

from .parameters import Layout

STEP = 1e-4
"""Step of the central differences, in standard deviations beforehand."""
LEAST_STD, LARGEST_STD = 1e-12, 1e6
"""Bounds of a standard deviation, in its unit."""
MOST_TENSION_N = 1e6
POSE_STEP = 1e-6
"""Step of the differences by the pose [m, rad]."""


@dataclass(frozen=True, eq=False)
class Readings:
    """What was recorded, one row a stop of the platform.

    Attributes:
        position: (k, 3) of the platform's origin, base frame [m].
        rotation: (k, 3, 3) from platform to base axes.
        let_out: (k, n) lengths that the motors have let out [m].
        wrench: (k, 6) of the sensor about the platform's origin, platform axes [N, N m]; NaN where
            the cables are only held tight (FREE_MOVING).
        tension: tension of the cables that are only held tight [N].
    """

    position: FloatArray
    rotation: FloatArray
    let_out: FloatArray
    wrench: FloatArray
    tension: float

    def __post_init__(self) -> None:
        """Check shapes; a row has a whole wrench or none.

        Raises:
            ShapeError: if an array has another shape, is not finite, or a turn is no rotation.
            OutOfRangeError: if the tension is not positive.
        """
        keep = object.__setattr__
        keep(self, "position", finite_array("position", self.position, (None, 3)))
        rows = len(self.position)
        turns = finite_array("rotation", self.rotation, (rows, 3, 3))
        off = np.abs(turns @ np.swapaxes(turns, 1, 2) - np.eye(3))
        if not ((off < 1e-6).all() and (np.linalg.det(turns) > 0.0).all()):
            raise ShapeError("rotation: expected rotation matrices, got others; normalise them")
        keep(self, "rotation", turns)
        keep(self, "let_out", finite_array("let_out", self.let_out, (rows, None)))
        wrench = shaped_array("wrench", self.wrench, (rows, 6))
        known = np.isfinite(wrench).sum(axis=1)
        if not np.isin(known, (0, 6)).all():
            row = int(np.argmax((known > 0) & (known < 6)))
            raise ShapeError(
                f"wrench, reading {number(row)}: expected six finite numbers or none, got "
                f"{wrench[row]}"
            )
        keep(self, "wrench", wrench)
        keep(self, "tension", in_range("tension", self.tension, 1e-9, MOST_TENSION_N))

    @property
    def loaded(self) -> BoolArray:
        """(k,) whether a row has a wrench."""
        return np.asarray(np.isfinite(self.wrench).all(axis=1), dtype=np.bool_)

    def moved(self, motion: FloatArray) -> Readings:
        """Return the same readings at other poses.

        Args:
            motion: (6,) or (k, 6) shift [m] and rotation vector [rad], base axes.
        """
        turn = Rotation.from_rotvec(motion[..., 3:]).as_matrix()
        place = self.position + motion[..., :3]
        return Readings(place, turn @ self.rotation, self.let_out, self.wrench, self.tension)

    def chosen(self, rows: BoolArray | IntArray) -> Readings:
        """Return some rows.

        Args:
            rows: indices or (k,) booleans.
        """
        return Readings(
            self.position[rows],
            self.rotation[rows],
            self.let_out[rows],
            self.wrench[rows],
            self.tension,
        )


@dataclass(frozen=True)
class Noise:
    """Standard deviations of what is read.

    Attributes:
        length: of a let-out length [m].
        position: of the pose, each coordinate [m].
        rotation: each axis [rad].
        force: of the sensor [N].
        torque: [N m].
    """

    length: float = 1e-4
    position: float = 20e-6
    rotation: float = 140e-6
    force: float = 0.05
    torque: float = 0.005

    @property
    def pose(self) -> FloatArray:
        """(6,) of a pose's components [m], [rad]."""
        return np.repeat([self.position, self.rotation], 3)

    def __post_init__(self) -> None:
        """Check that all are positive.

        Raises:
            OutOfRangeError: if one is not.
        """
        for each in fields(self):
            in_range(each.name, getattr(self, each.name), LEAST_STD, LARGEST_STD)


def courses(
    layout: Layout, values: FloatArray, position: FloatArray, rotation: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Lengths, directions and levers of the cables at many poses.

    Args:
        layout: of the parameters.
        values: (p,) parameters.
        position: (k, 3) [m].
        rotation: (k, 3, 3).

    Returns:
        (k, n) lengths [m], (k, n, 3) unit vectors from the platform along the cables, (k, n, 3)
        platform points from the platform's origin, base axes [m].
    """
    own = layout.parts(values)
    lever = np.einsum("kab,nb->kna", rotation, own["platform"])
    away = position[:, None] + lever - own["base"]
    axis, radius = layout.axes, own["radius"]
    height = np.einsum("kna,na->kn", away, axis)
    beside = away - height[..., None] * axis
    out = np.linalg.norm(beside, axis=2)
    x = out - radius
    square = x**2 + height**2
    with np.errstate(invalid="ignore"):  # a point on a wheel: NaN from here on
        straight = np.sqrt(square - radius**2)
    cosine = (x * radius - height * straight) / square
    sine = (height * radius + x * straight) / square
    length = straight + radius * (np.pi - np.arctan2(sine, cosine))
    direction = cosine[..., None] * axis - (sine / out)[..., None] * beside
    return length, direction, lever


def springs_at(layout: Layout, values: FloatArray, length: FloatArray) -> FloatArray:
    """(k, n) k_e of the limbs at the cables' lengths [N/m].

    Args:
        layout: of the parameters.
        values: (p,) parameters.
        length: (k, n) of the cables [m].
    """
    softness = 1.0 / layout.parts(values)["stiffness"]
    return np.asarray(
        1.0 / (softness + layout.per_metre * (length - layout.length)), dtype=np.float64
    )


def predicted(layout: Layout, values: FloatArray, readings: Readings) -> FloatArray:
    """(k, n + 6) let-out lengths [m] of rows without a load, wrenches of rows with one; else 0.

    Args:
        layout: of the parameters.
        values: (p,) parameters.
        readings: poses, and the let-out lengths behind the wrenches.
    """
    own, n = layout.parts(values), layout.cables
    length, direction, lever = courses(layout, values, readings.position, readings.rotation)
    found = np.zeros((len(length), n + 6))
    loaded = readings.loaded
    spring = springs_at(layout, values, length)
    free = length - own["offset"] - readings.tension / spring
    found[~loaded, :n] = free[~loaded]
    stretch = length - own["offset"] - readings.let_out
    pull = (spring * stretch)[..., None] * direction
    force, torque = pull.sum(axis=1), np.cross(lever, pull).sum(axis=1)
    down = np.array([0.0, 0.0, -1.0])
    arm = np.einsum("kab,b->ka", readings.rotation, own["moment"])
    force, torque = force + own["weight"] * down, torque + np.cross(arm, down)
    force, torque = (
        np.einsum("kba,kb->ka", readings.rotation, vector) for vector in (force, torque)
    )
    turn = Rotation.from_rotvec(own["sensor_turn"]).as_matrix()
    torque = torque - np.cross(own["sensor_shift"], force)
    wrench = np.hstack([force @ turn.T, torque @ turn.T]) + own["bias"]
    found[loaded, n:] = wrench[loaded]
    return found


def derivatives(layout: Layout, values: FloatArray, readings: Readings) -> FloatArray:
    """(k, n + 6, p) derivatives of what is predicted, by parameters in standard deviations.

    Args:
        layout: of the parameters.
        values: (p,) parameters.
        readings: as for `predicted`.
    """
    found = np.zeros((len(readings.position), layout.cables + 6, values.size))
    for index, spread in enumerate(layout.spread):
        if spread > 0.0:
            step = np.zeros(values.size)
            step[index] = STEP * spread
            after, before = (
                predicted(layout, values + sign * step, readings) for sign in (1.0, -1.0)
            )
            found[:, :, index] = (after - before) / (2.0 * STEP)
    return found


def pose_derivatives(layout: Layout, values: FloatArray, readings: Readings) -> FloatArray:
    """(k, n + 6, 6) derivatives of what is predicted, by the pose: shift [m], turn [rad].

    Args:
        layout: of the parameters.
        values: (p,) parameters.
        readings: as for `predicted`.
    """
    found = np.zeros((len(readings.position), layout.cables + 6, 6))
    for k in range(6):
        move = np.zeros(6)
        move[k] = POSE_STEP
        after, before = (
            predicted(layout, values, readings.moved(sign * move)) for sign in (1.0, -1.0)
        )
        found[:, :, k] = (after - before) / (2.0 * POSE_STEP)
    return found


def noise_covariances(
    layout: Layout, values: FloatArray, readings: Readings, noise: Noise
) -> FloatArray:
    """(k, n + 6, n + 6) covariances of readings minus predictions; 1 where nothing is read.

    What a pose is wrong by shows in all lengths of a row at once, and times the stiffness in the
    wrench; what a length is wrong by shows in the wrench as well.

    Args:
        layout: of the parameters.
        values: (p,) parameters.
        readings: as for `predicted`.
        noise: of what is read.
    """
    n, loaded = layout.cables, readings.loaded
    by_pose = pose_derivatives(layout, values, readings)
    length, direction, lever = courses(layout, values, readings.position, readings.rotation)
    columns = np.concatenate([direction, np.cross(lever, direction)], axis=2)
    turned = np.concatenate(
        [np.einsum("kba,knb->kna", readings.rotation, part) for part in np.split(columns, 2, 2)],
        axis=2,
    )
    by_length = np.swapaxes(springs_at(layout, values, length)[..., None] * turned, 1, 2)
    scaled = by_pose * noise.pose
    found = scaled @ np.swapaxes(scaled, 1, 2)
    own_noise = np.repeat([noise.force, noise.torque], 3) ** 2
    lengths = noise.length**2 * by_length @ np.swapaxes(by_length, 1, 2)
    found[loaded, n:, n:] += lengths[loaded] + np.diag(own_noise)
    found[~loaded, :n, :n] += noise.length**2 * np.eye(n)
    found[loaded, :n, :n] = np.eye(n)
    found[~loaded, n:, n:] = np.eye(6)
    return np.asarray(found, dtype=np.float64)
