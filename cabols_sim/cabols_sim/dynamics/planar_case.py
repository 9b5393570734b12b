# SPDX-License-Identifier: Apache-2.0
"""The planar robot of section 2.5 with cables of about 900 m: what the variable mass does there.

The source gives rho = 0.215 kg/m, 2500 kg, state (x, y, phi) and "in the order of 900 meters"; its
layout and trajectory are in figures without numbers. Chosen here: the plane is vertical; base
points on a circle of 900 m at -135, -45, 45 and 135 deg, platform points on one of 10 m at -45,
-135, 135 and 45 deg, so that the cables cross and hold the platform against turning; the platform
turns like a disc of 10 m; it moves once, from rest to rest, along a polynomial of fifth order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cabols_control.checks import FloatArray
from cabols_sim.dynamics.body import equations
from cabols_sim.dynamics.lagrange import inverse_dynamics, state_at
from cabols_sim.dynamics.redundancy import tensions_for
from cabols_sim.dynamics.robot import (
    CENTRE,
    MATERIAL,
    STRETCHING,
    CableModel,
    CableRobot,
    planar_robot,
)

DENSITY, PLATFORM_MASS = 0.215, 2500.0
"""Of section 2.5 [kg/m, kg]."""
BASE_RADIUS, PLATFORM_RADIUS = 900.0, 10.0
BASE_ANGLES_DEG = (-135.0, -45.0, 45.0, 135.0)
PLATFORM_ANGLES_DEG = (-45.0, -135.0, 135.0, 45.0)
TENSION_MIN, TENSION_MAX = 2000.0, 60000.0
"""[N]; a 900 m cable of this density would hang through by 1/11 of its length at 2000 N."""


@dataclass(frozen=True)
class Motion:
    """A motion from rest to rest, straight in (x, y, phi).

    Attributes:
        start: (3,) [m, m, rad].
        end: (3,) [m, m, rad].
        rest_s: standing still before and after [s].
        move_s: moving [s].
    """

    start: tuple[float, float, float] = (-60.0, -40.0, -0.1)
    end: tuple[float, float, float] = (60.0, 40.0, 0.1)
    rest_s: float = 5.0
    move_s: float = 30.0

    @property
    def duration_s(self) -> float:
        """From the first to the last instant [s]."""
        return 2.0 * self.rest_s + self.move_s

    def at(self, time: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(3,) coordinates, rates and accelerations at a time [s]."""
        share = min(max((time - self.rest_s) / self.move_s, 0.0), 1.0)
        way = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        speed = 30.0 * share**2 * (1.0 - share) ** 2 / self.move_s
        change = 60.0 * share * (1.0 - share) * (1.0 - 2.0 * share) / self.move_s**2
        start, step = np.array(self.start), np.subtract(self.end, self.start)
        return start + way * step, speed * step, change * step


def case_robot(
    size: float = 1.0, density: float = DENSITY, cable: CableModel = CENTRE
) -> CableRobot:
    """Return the robot of the case; size scales its lengths (and the disc's inertia with them).

    Args:
        size: factor of all lengths.
        density: of the cables [kg/m].
        cable: model of their mass.
    """
    outer, inner = np.radians(BASE_ANGLES_DEG), np.radians(PLATFORM_ANGLES_DEG)
    radius = PLATFORM_RADIUS * size
    return planar_robot(
        BASE_RADIUS * size * np.column_stack([np.cos(outer), np.sin(outer)]),
        radius * np.column_stack([np.cos(inner), np.sin(inner)]),
        PLATFORM_MASS,
        0.5 * PLATFORM_MASS * radius**2,
        density,
        cable=cable,
    )


def models(robot: CableRobot, motion: Motion) -> dict[str, CableRobot]:
    """The models that are compared, by name; the constant masses are those of the start.

    Args:
        robot: of the case.
        motion: whose start gives the constant masses.
    """
    length = state_at(robot, motion.start).cables(robot).length
    return {
        "as published": robot.with_options(cable=CENTRE),
        "without (2.28)": robot.with_options(cable=CENTRE, mass_law="no_stream"),
        "constant mass": robot.with_constant_mass(length, STRETCHING),
        "material": robot.with_options(cable=MATERIAL),
    }


@dataclass(frozen=True, eq=False)
class CaseRun:
    """One model on one motion, k times, n cables.

    Attributes:
        time: (k,) [s].
        coordinates: (k, 3) [m, m, rad].
        force: (k, 3) generalized force of the cables: F_x, F_y [N], tau_z [N m].
        stream: (k, 3) of (2.28), as it stands in the model; zero where it is left out.
        tension: (k, n) [N].
        length: (k, n) [m].
        rate: (k, n) [m/s].
        feasible: whether every instant's force was within the tensions' limits.
    """

    time: FloatArray
    coordinates: FloatArray
    force: FloatArray
    stream: FloatArray
    tension: FloatArray
    length: FloatArray
    rate: FloatArray
    feasible: bool


def run_case(robot: CableRobot, motion: Motion, samples: int = 401) -> CaseRun:
    """Inverse dynamics (2.34) along a motion, and tensions (2.35) by redundancy resolution.

    Args:
        robot: of one model.
        motion: that it is led along.
        samples: evenly spread over the motion.
    """
    time = np.linspace(0.0, motion.duration_s, samples)
    rows = [_instant(robot, *motion.at(float(t))) for t in time]
    *columns, feasible = zip(*rows, strict=True)
    x, force, stream, tension, length, rate = map(np.array, columns)
    return CaseRun(time, x, force, stream, tension, length, rate, all(map(bool, feasible)))


def _instant(
    robot: CableRobot, x: FloatArray, x_dot: FloatArray, x_ddot: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, bool]:
    state = state_at(robot, x, x_dot)
    force = inverse_dynamics(robot, x, x_dot, x_ddot)
    found = tensions_for(robot, state, force, TENSION_MIN, TENSION_MAX)
    cables = state.cables(robot)
    stream = equations(robot, state).stream
    return x, force, stream, found.tension, cables.length, cables.rate, found.feasible


@dataclass(frozen=True)
class Effect:
    """How much a model differs from the reference model on one case.

    Attributes:
        density: [kg/m].
        radius: of the base circle [m].
        move_s: duration of the motion [s].
        peak_rate: fastest cable [m/s].
        force: largest difference of (F_x, F_y) [N].
        force_percent: of the largest inertial force that the reference has, weight aside.
        torque: largest difference of tau_z [N m].
        tension: largest difference of a tension [N].
        tension_percent: of the largest tension.
    """

    density: float
    radius: float
    move_s: float
    peak_rate: float
    force: float
    force_percent: float
    torque: float
    tension: float
    tension_percent: float


def compare(reference: CaseRun, other: CaseRun, robot: CableRobot, motion: Motion) -> Effect:
    """Reduce two runs to their largest differences.

    Args:
        reference: run of the published model.
        other: run of another model along the same motion.
        robot: of the reference.
        motion: of both.
    """
    apart = other.force - reference.force
    moving = reference.force - _weights(robot, motion, reference.time)
    inertial = float(np.linalg.norm(moving[:, :2], axis=1).max())
    force = float(np.linalg.norm(apart[:, :2], axis=1).max())
    *_, torque = apart.T
    tension = float(np.abs(other.tension - reference.tension).max())
    return Effect(
        density=float(robot.density[0]),
        radius=float(np.linalg.norm(robot.base_points[0])),
        move_s=motion.move_s,
        peak_rate=float(np.abs(reference.rate).max()),
        force=force,
        force_percent=100.0 * force / inertial,
        torque=float(np.abs(torque).max()),
        tension=tension,
        tension_percent=100.0 * tension / float(reference.tension.max()),
    )


def _weights(robot: CableRobot, motion: Motion, time: FloatArray) -> FloatArray:
    """(k, 3) forces that hold the robot still along the motion."""
    still = np.zeros(3)
    return np.array([inverse_dynamics(robot, motion.at(float(t))[0], still, still) for t in time])


def study(
    densities: Sequence[float] = (0.5, 1.0, 2.0, 4.0),
    sizes: Sequence[float] = (0.25, 0.5, 1.0, 2.0),
    paces: Sequence[float] = (0.5, 1.0, 2.0, 3.0),
    samples: int = 161,
) -> dict[str, list[tuple[Effect, Effect, Effect]]]:
    """Vary density, size and pace, one at a time, as factors of the case's.

    The motion grows with the size and lasts as long; a pace of 2 halves its duration.

    Args:
        densities: factors of the cables' density.
        sizes: factors of the robot's size.
        paces: factors of the motion's speed.
        samples: of each motion.

    Returns:
        By "density", "size", "pace": for each factor three effects. The first leaves (2.28) out of
        the published model, the second is the constant mass against MATERIAL, the third the
        published model against MATERIAL.
    """
    cases = {
        "density": [(1.0, factor, 1.0) for factor in densities],
        "size": [(factor, 1.0, 1.0) for factor in sizes],
        "pace": [(1.0, 1.0, factor) for factor in paces],
    }
    return {
        name: [_effects(*case, samples=samples) for case in variants]
        for name, variants in cases.items()
    }


def _effects(
    size: float, density: float, pace: float, samples: int
) -> tuple[Effect, Effect, Effect]:
    robot, motion = case_robot(size, density * DENSITY), Motion()
    x0, y0, turn0 = motion.start
    x1, y1, turn1 = motion.end
    motion = replace(
        motion,
        start=(size * x0, size * y0, turn0),
        end=(size * x1, size * y1, turn1),
        move_s=motion.move_s / pace,
    )
    found = {name: run_case(m, motion, samples) for name, m in models(robot, motion).items()}
    published = robot.with_options(cable=CENTRE)
    material = robot.with_options(cable=MATERIAL)
    return (
        compare(found["as published"], found["without (2.28)"], published, motion),
        compare(found["material"], found["constant mass"], material, motion),
        compare(found["material"], found["as published"], material, motion),
    )
