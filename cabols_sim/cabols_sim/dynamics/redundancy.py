# SPDX-License-Identifier: Apache-2.0
"""Tensions for a generalized force, by the project's redundancy resolution; planar robots too."""

from __future__ import annotations

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.tension import TensionSolution, distribute
from cabols_sim.dynamics.body import BodyState, equations
from cabols_sim.dynamics.robot import PLANAR, SPATIAL, CableRobot

_IDLE = tuple(k for k in SPATIAL if k not in PLANAR)


def tensions_for(
    robot: CableRobot,
    state: BodyState,
    force: FloatArray,
    tension_min: float,
    tension_max: float,
    method: str = "min_norm",
) -> TensionSolution:
    """Choose tensions that give a force on the degrees of freedom.

    `distribute` knows six degrees of freedom. A planar robot's other three get one idle cable each,
    which pulls along that freedom alone and has nothing to do, so that nothing else changes.

    Args:
        robot: model.
        state: of the platform.
        force: (m,) wanted from the cables, at the platform's origin [N, N m].
        tension_min: [N].
        tension_max: [N].
        method: of `distribute`.

    Returns:
        As `distribute`; residual is (m,).
    """
    transmission = equations(robot, state).transmission
    if not robot.planar:
        return distribute(transmission, force, tension_min, tension_max, method)
    n = robot.cables
    matrix, wrench = np.zeros((6, n + 3)), np.zeros(6)
    matrix[list(PLANAR), :n] = transmission
    matrix[list(_IDLE), [n, n + 1, n + 2]] = 1.0
    wrench[list(PLANAR)] = force
    low, high = np.full(n + 3, -1.0), np.full(n + 3, 1.0)
    low[:n], high[:n] = tension_min, tension_max
    found = distribute(matrix, wrench, low, high, method)
    return found._replace(tension=found.tension[:n], residual=found.residual[list(PLANAR)])
