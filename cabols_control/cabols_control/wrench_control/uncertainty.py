# SPDX-License-Identifier: Apache-2.0
"""Uncertainty of a measured wrench, in the frame of the user; compiled, O(1).

A first-order propagation (JCGM 100:2008, "GUM", 5.1): each source moves the wrench by a known
derivative, the sources are independent, and 1.96 combined standard deviations hold 95 % of errors.
Sources are stated by the largest error that is believed in, evenly distributed up to it (GUM
4.3.7), noise by its standard deviation:

- sensor: gain of each axis, cross-talk between axes, bias of the tare, noise,
- where the sensor is in the platform, and a frame of the user's in its parent,
- mass and centre of what hangs on the sensor. A tare takes its weight for zero, so that an error of
  the mass counts by how far the platform has turned since the tare; where that is not known, for
  any turn. Its inertia counts by the platform's acceleration,
- the pose: by the weight's direction, and where axes or origin of the frame do not move with the
  platform.
"""

from __future__ import annotations

from dataclasses import field
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic.dataclasses import dataclass

from cabols_control.checks import FloatArray, finite_array
from cabols_control.compiling import njit
from cabols_control.configuration import STRICT, within
from cabols_control.errors import ConfigError
from cabols_control.placement import Frame
from cabols_control.wrench_control.frames import Axes, WrenchFrames, wrench_from_base

COVERAGE = 1.96
"""Standard deviations that hold 95 % of a normal distribution."""
EVEN = 1.0 / np.sqrt(3.0)
"""Standard deviation of an even distribution, of its half width."""
CROSS_LENGTH_M = 0.1
"""Cross-talk of 1 % is 1 N of 100 N, and 0.1 N m of 100 N: torques are so much smaller."""
GRAVITY = 9.80665


@dataclass(frozen=True, config=STRICT)
class UncertaintyConfig:
    """Largest errors that are believed in, in frames.yaml under wrench_uncertainty.

    Attributes:
        gain: of each of the sensor's axes, as a share.
        cross_talk: of each axis in each other one, as a share; 1 N counts as 0.1 N m.
        bias: (6,) left by the tare, and drift since, sensor axes [N, N m].
        noise: (6,) standard deviation of a sample, sensor axes [N, N m].
        sensor_position: of the sensor in the platform, along each axis [m].
        sensor_turn: of the sensor in the platform, about each axis [rad].
        tool_mass: of all that hangs on the sensor [kg].
        tool_centre: of its centre, along each axis [m].
        inertia: share of the tool's mass times its acceleration that may remain.
        pose_position: of the platform, along each axis [m].
        pose_turn: of the platform, about each axis [rad].
        frame_position: of a frame of the user's, along each axis [m].
        frame_turn: of a frame of the user's, about each axis [rad].
    """

    gain: Annotated[float, within(0.0, 1.0)] = 0.005
    cross_talk: Annotated[float, within(0.0, 1.0)] = 0.01
    bias: list[float] = field(default_factory=lambda: [0.1, 0.1, 0.2, 0.01, 0.01, 0.01])
    noise: list[float] = field(default_factory=lambda: [0.05, 0.05, 0.1, 0.005, 0.005, 0.005])
    sensor_position: Annotated[float, within(0.0, 1.0)] = 0.0005
    sensor_turn: Annotated[float, within(0.0, 1.0)] = 0.002
    tool_mass: Annotated[float, within(0.0, 1000.0)] = 0.02
    tool_centre: Annotated[float, within(0.0, 1.0)] = 0.002
    inertia: Annotated[float, within(0.0, 1.0)] = 0.25
    pose_position: Annotated[float, within(0.0, 1.0)] = 0.001
    pose_turn: Annotated[float, within(0.0, 1.0)] = 0.002
    frame_position: Annotated[float, within(0.0, 1.0)] = 0.0
    frame_turn: Annotated[float, within(0.0, 1.0)] = 0.0

    def __post_init__(self) -> None:
        """Check lengths and signs."""
        for name in ("bias", "noise"):
            values = finite_array(name, getattr(self, name), (6,))
            if not (values >= 0.0).all():
                raise ConfigError(f"{name}: expected numbers from 0, got {values.tolist()}")


UNCERTAINTY = np.dtype(
    [
        ("gain", np.float64),  # standard deviations, as all below
        ("cross_talk", np.float64),
        ("bias", np.float64, (6,)),
        ("noise", np.float64, (6,)),
        ("sensor_position", np.float64),
        ("sensor_turn", np.float64),
        ("tool_mass", np.float64),
        ("tool_centre", np.float64),
        ("inertia", np.float64),
        ("pose_position", np.float64),
        ("pose_turn", np.float64),
        ("frame_position", np.float64),
        ("frame_turn", np.float64),
        ("mass", np.float64),  # nominal [kg]
        ("centre", np.float64, (3,)),  # nominal, platform axes [m]
        ("place", np.float64, (3,)),  # of the sensor in the platform, nominal [m]
        ("turn", np.float64, (3, 3)),  # from the sensor's axes to the platform's, nominal
        ("down", np.float64, (3,)),  # gravity's direction at the tare, platform axes; NaN: unknown
    ],
    align=True,
)
"""Sources of uncertainty as standard deviations, and the nominal places that they act at."""


@njit(cache=True)
def _cross(a: FloatArray, b: FloatArray, product: FloatArray) -> None:
    """Fill product (3,) = a x b, none of them the product itself."""
    product[0] = a[1] * b[2] - a[2] * b[1]
    product[1] = a[2] * b[0] - a[0] * b[2]
    product[2] = a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def _add(
    frame: Any, force: FloatArray, torque: FloatArray, deviation: float, sum_: FloatArray
) -> None:
    """Add the variance that an error of a wrench makes in a frame.

    Args:
        frame: (1,) record of WRENCH_FRAME, placed.
        force: (3,) for one unit of the source, base axes.
        torque: (3,) likewise, about the platform's origin.
        deviation: of the source.
        sum_: (6,) variances; added to.
    """
    column, moved = np.empty(6), np.empty(6)
    for i in range(3):
        column[i], column[3 + i] = deviation * force[i], deviation * torque[i]
    wrench_from_base(frame, column, moved)
    for i in range(6):
        sum_[i] += moved[i] * moved[i]


@njit(cache=True)
def _turns(into: Any) -> bool:
    """Whether a frame's axes turn with the platform."""
    if into["axes"] == Axes.BASE:
        return False
    return bool(into["axes"] == Axes.PLATFORM or not into["fixed"])


@njit(cache=True)
def _add_turn(
    frame: Any,
    one: FloatArray,
    wrench: FloatArray,
    about: FloatArray,
    arm: FloatArray,
    column: FloatArray,
) -> None:
    """Add what a pose turned by one radian about `one` makes of a wrench in a frame.

    Args:
        frame: (1,) record of WRENCH_FRAME, placed.
        one: (3,) axis.
        wrench: (6,) measured, about the platform's origin, base axes [N, N m].
        about: (3,) its torque about the frame's origin [N m].
        arm: (3,) force of it so far; added to.
        column: (3,) torque of it so far; added to.
    """
    lever, turned, other = frame[0]["lever"], np.empty(3), np.empty(3)
    force, torque = wrench[:3], wrench[3:]
    _cross(one, torque, turned)
    column += turned
    _cross(one, force, turned)
    arm += turned
    if _turns(frame[0]):
        arm -= turned
        _cross(lever, turned, other)
        column -= other
        _cross(one, about, other)
        column -= other
    if not frame[0]["fixed"]:
        _cross(one, lever, turned)
        _cross(turned, force, other)
        column -= other


@njit(cache=True)
def wrench_uncertainty_into(
    own: Any,
    frame: Any,
    placed: bool,
    rotation: FloatArray,
    acceleration: FloatArray,
    wrench: FloatArray,
    found: FloatArray,
) -> None:
    """Fill the half widths within which 95 % of a measured wrench's errors are.

    Args:
        own: (1,) record of UNCERTAINTY.
        frame: (1,) record of WRENCH_FRAME, placed at the pose.
        placed: whether the frame has a placement of its own, with its own error.
        rotation: (3, 3) from platform to base axes.
        acceleration: (3,) of the platform, base axes [m/s^2].
        wrench: (6,) measured, about the platform's origin, base axes [N, N m].
        found: (6,) in the frame, filled [N, N m].
    """
    source, into = own[0], frame[0]
    force, torque = wrench[:3], wrench[3:]
    axes, place, centre = np.zeros((3, 3)), np.zeros(3), np.zeros(3)
    since, inertia, fall = np.zeros(3), np.zeros(3), np.zeros(3)
    mass, known = source["mass"], True
    for i in range(3):
        known = known and np.isfinite(source["down"][i])
    for i in range(3):
        inertia[i] = -acceleration[i]
        for j in range(3):
            place[i] += rotation[i, j] * source["place"][j]
            centre[i] += rotation[i, j] * source["centre"][j]
            if known:
                since[i] -= GRAVITY * rotation[i, j] * source["down"][j]
            for k in range(3):
                axes[i, j] += rotation[i, k] * source["turn"][k, j]
    fall[2] = -GRAVITY
    since[2] -= GRAVITY
    # What the sensor feels beyond the tare, about the sensor's origin, base axes.
    load, moment, turned = np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        load[i] = force[i] + mass * (since[i] + inertia[i])
    _cross(place, force, turned)
    moment[:] = torque - turned
    weight = mass * (since + inertia)
    _cross(centre - place, weight, turned)
    moment += turned
    variance, one, arm = np.zeros(6), np.zeros(3), np.zeros(3)
    zero, column = np.zeros(3), np.zeros(3)
    felt = np.zeros(6)
    for i in range(3):
        for k in range(3):
            felt[i] += axes[k, i] * load[k]
            felt[3 + i] += axes[k, i] * moment[k]
    total = 0.0
    for i in range(6):
        scaled = felt[i] if i < 3 else felt[i] / CROSS_LENGTH_M
        total += scaled * scaled
    # Of a tare in any orientation, the weight that it took for zero.
    spare = 0.0 if known else (mass * GRAVITY) ** 2 / 3.0
    total += 3.0 * spare
    for i in range(6):
        # An axis of the sensor: gain, cross-talk, bias, noise.
        square = felt[i] * felt[i] + (spare if i < 3 else 0.0)
        scale = 1.0 if i < 3 else CROSS_LENGTH_M
        other = max(scale * scale * total - square, 0.0)
        deviation = np.sqrt(
            source["gain"] ** 2 * square
            + source["cross_talk"] ** 2 * other
            + source["bias"][i] ** 2
            + source["noise"][i] ** 2
        )
        one[:] = axes[:, i % 3]
        if i < 3:
            _cross(place, one, arm)
            _add(frame, one, arm, deviation, variance)
        else:
            _add(frame, zero, one, deviation, variance)
    lever = into["lever"]
    fixed = into["fixed"] != 0
    about = np.empty(3)
    _cross(lever, force, turned)
    about[:] = torque - turned
    for i in range(3):
        one[:] = 0.0
        one[i] = 1.0
        # The sensor in the platform.
        _cross(one, load, arm)
        _add(frame, zero, arm, source["sensor_position"], variance)
        _cross(place, arm, column)
        _cross(one, moment, turned)
        _add(frame, arm, column + turned, source["sensor_turn"], variance)
        # The tool's centre, and its weight's direction by the pose.
        _cross(one, weight, arm)
        _add(frame, zero, arm, source["tool_centre"], variance)
        if not known:
            _add(frame, zero, one, EVEN * mass * GRAVITY * source["tool_centre"], variance)
            _cross(centre, one, arm)
            _add(frame, one, arm, EVEN * GRAVITY * source["tool_mass"], variance)
        _cross(one, mass * fall, arm)
        _cross(centre, arm, column)
        # Axes and origin that do not move with the platform, by the pose.
        _add_turn(frame, one, wrench, about, arm, column)
        _add(frame, arm, column, source["pose_turn"], variance)
        _cross(one, force, turned)
        if fixed:
            _add(frame, zero, turned, source["pose_position"], variance)
        if placed:
            _add(frame, zero, turned, source["frame_position"], variance)
        if placed and into["axes"] == Axes.OWN:
            arm[:] = turned
            _cross(lever, arm, column)
            _cross(one, about, turned)
            _add(frame, arm, column + turned, source["frame_turn"], variance)
    # The tool's mass, and what is left of its inertia.
    pulled = since + inertia
    _cross(centre, pulled, arm)
    _add(frame, pulled, arm, source["tool_mass"], variance)
    pulled[:] = mass * inertia
    _cross(centre, pulled, arm)
    _add(frame, pulled, arm, source["inertia"], variance)
    for i in range(6):
        found[i] = COVERAGE * np.sqrt(variance[i])


def uncertainty_sources(
    config: UncertaintyConfig, mass: float, centre: ArrayLike, sensor: Frame
) -> Any:
    """Build the (1,) record of UNCERTAINTY, with a tare whose orientation is not known.

    Args:
        config: of the rig.
        mass: of all that hangs on the sensor, nominal [kg].
        centre: (3,) of it, platform axes, nominal [m].
        sensor: in the platform, nominal.
    """
    record = np.zeros(1, UNCERTAINTY)
    for name in UNCERTAINTY.names or ():
        if hasattr(config, name):
            share = 1.0 if name == "noise" else EVEN
            record[name] = share * np.asarray(getattr(config, name), dtype=np.float64)
    record["mass"], record["centre"] = mass, finite_array("centre", centre, (3,))
    record["place"], record["turn"] = sensor.position, sensor.rotation
    record["down"] = np.nan
    return record


class WrenchUncertainty:
    """Uncertainty of a rig's measured wrenches in any of its frames."""

    def __init__(self, sources: Any, frames: WrenchFrames) -> None:
        """Take what is known of a rig; compiles or loads the kernel.

        Args:
            sources: from uncertainty_sources.
            frames: of the rig.
        """
        self._sources, self._own = sources, frames.own
        self._base = frames.record(frames.names[0])
        self.of("", self._base, np.eye(3), np.zeros(3), np.zeros(6))

    def tell_tare(self, weight: ArrayLike) -> None:
        """Take what the tool weighed at the tare: it shows how the platform was turned.

        Args:
            weight: (3,) force of its weight, platform axes [N]; NaN or zero: it is not known.
        """
        pull = np.asarray(weight, dtype=np.float64)
        size = float(np.linalg.norm(pull))
        self._sources["down"] = pull / size if np.isfinite(size) and size > 0.0 else np.nan

    def of(
        self,
        name: str,
        frame: Any,
        rotation: FloatArray,
        acceleration: FloatArray,
        wrench: FloatArray,
    ) -> FloatArray:
        """Return (6,) half widths that hold 95 % of the errors, in a frame [N, N m].

        Args:
            name: of the frame.
            frame: (1,) record of WRENCH_FRAME, placed at the pose; None: the rig's base frame.
            rotation: (3, 3) from platform to base axes.
            acceleration: (3,) of the platform, base axes [m/s^2].
            wrench: (6,) measured, about the platform's origin, base axes [N, N m].
        """
        found = np.empty(6)
        place = self._base if frame is None else frame
        wrench_uncertainty_into(
            self._sources, place, name in self._own, rotation, acceleration, wrench, found
        )
        return found
