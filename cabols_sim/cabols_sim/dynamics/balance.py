# SPDX-License-Identifier: Apache-2.0
"""Free motions that show whether energy and momentum balance, planar and spatial."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline

from cabols_control.checks import FloatArray
from cabols_sim.dynamics.body import equations
from cabols_sim.dynamics.lagrange import state_at
from cabols_sim.dynamics.newton import momentum, momentum_supply
from cabols_sim.dynamics.planar_case import case_robot
from cabols_sim.dynamics.redundancy import tensions_for
from cabols_sim.dynamics.robot import CENTRE, CableModel, CableRobot
from cabols_sim.dynamics.simulation import Trajectory, simulate, winch_springs


@dataclass(frozen=True, eq=False)
class FreeMotion:
    """A robot that is let go beside its rest, its winches acting as springs and dampers.

    At rest they hold its weight.

    Attributes:
        robot: model.
        offset: (m,) coordinates at the start; the springs rest at zero.
        rate: (m,) at the start.
        stiffness: of a winch [N/m].
        damping: of a winch [N s/m].
        tension: of any winch at rest, at least [N].
    """

    robot: CableRobot
    offset: FloatArray
    rate: FloatArray
    stiffness: float
    damping: float
    tension: float

    def run(self, duration_s: float = 60.0, samples: int = 801) -> Trajectory:
        """Simulate.

        Args:
            duration_s: of the motion [s].
            samples: that are kept, evenly spread.
        """
        rest = state_at(self.robot, np.zeros(self.offset.size))
        weight = equations(self.robot, rest).gravity
        held = tensions_for(self.robot, rest, weight, self.tension, 10.0 * self.tension).tension
        length = rest.cables(self.robot).length
        law = winch_springs(self.stiffness, self.damping, length, held, self.robot)
        start = state_at(self.robot, self.offset, self.rate)
        return simulate(self.robot, start, law, duration_s, samples=samples)


def planar_motion(cable: CableModel = CENTRE) -> FreeMotion:
    """Return the planar robot of section 2.5, swinging by some 40 m."""
    return FreeMotion(
        case_robot(cable=cable),
        np.array([30.0, -15.0, 0.04]),
        np.array([3.0, 2.0, 0.01]),
        stiffness=120.0,
        damping=10.0,
        tension=9000.0,
    )


def spatial_motion(cable: CableModel = CENTRE) -> FreeMotion:
    """Return eight cables of some 110 m about a platform of half a ton, swinging and turning."""
    corner = np.radians([45.0, 135.0, 225.0, 315.0])
    turn = np.radians([45.0, -45.0, 45.0, -45.0])
    around = ((80.0, 70.0), (-80.0, 70.0), (-80.0, -70.0), (80.0, -70.0))
    frame = [[x, y, z] for z in (60.0, -60.0) for x, y in around]
    rings = [
        np.column_stack([4.0 * np.cos(a), 4.0 * np.sin(a), np.full(4, z)])
        for a, z in ((corner + turn, -2.0), (corner - turn, 2.0))
    ]
    robot = CableRobot(
        np.array(frame, dtype=np.float64),
        np.vstack(rings),
        mass=500.0,
        inertia=np.diag([4500.0, 4800.0, 5200.0]),
        density=np.full(8, 0.4),
        centre_of_mass=np.array([0.2, -0.1, 0.15]),
        cable=cable,
    )
    return FreeMotion(
        robot,
        np.array([6.0, -4.0, -5.0, 0.05, -0.1, 0.08]),
        np.array([2.0, 1.0, -1.0, 0.05, 0.02, 0.1]),
        stiffness=100.0,
        damping=4.0,
        tension=2500.0,
    )


def momentum_imbalance(robot: CableRobot, motion: Trajectory) -> tuple[float, float]:
    """Return the largest change of momentum without a force, weight or mass stream for it.

    Newton's forces are integrated over the whole motion by splines through its samples. Wrenches
    on the platform are taken to be zero.

    Args:
        robot: that moved freely.
        motion: its states.

    Returns:
        Linear and angular, relative to the largest of each.
    """
    none = np.zeros(6)
    has = np.array([momentum(robot, state) for state in motion.states])
    rows = zip(motion.states, motion.acceleration, motion.tension, strict=True)
    supply = np.array([momentum_supply(robot, *row, none) for row in rows])
    gained = make_interp_spline(motion.time, supply, k=7).antiderivative()
    error = has - has[0] - (gained(motion.time) - gained(motion.time[0]))

    def relative(columns: slice) -> float:
        return float(np.abs(error[:, columns]).max() / np.abs(has[:, columns]).max())

    return relative(slice(0, 3)), relative(slice(3, 6))
