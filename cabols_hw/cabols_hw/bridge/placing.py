# SPDX-License-Identifier: Apache-2.0
"""Where the platform puts the cables at a sample, and how fast it lengthens them; compiled."""

from __future__ import annotations

from typing import Any

import numpy as np

from cabols_control.cable_kernels import cable_lengths_into, structure_matrix_into
from cabols_control.checks import FloatArray
from cabols_control.compiling import njit
from cabols_control.poses.track import place_platform
from cabols_hw.force_torque.tool_weight import tool_weight_into


@njit(cache=True, error_model="numpy")
def place_cables_into(
    track: Any,
    now_s: float,
    cables: tuple[Any, FloatArray, FloatArray, FloatArray, FloatArray],
    tool: tuple[float, FloatArray, FloatArray],
    rotation: FloatArray,
    weight: FloatArray,
) -> bool:
    """Extrapolate the platform's pose to a sample; nothing is computed while it stands.

    Args:
        track: (1,) record of POSE_TRACK; updated.
        now_s: of the sample [s].
        cables: (n,) records of CABLE; then, filled: (n,) lengths [m], (6, n) structure matrix,
            (n,) speeds [m/s] and (n,) accelerations [m/s^2] at which the platform lengthens them.
        tool: its mass [kg], (3,) centre of mass in platform axes [m]; then, filled: (6,) what it
            puts on the sensor by weight and inertia, platform axes [N, N m].
        rotation: (3, 3) platform to base axes; filled.
        weight: (6,) of the tool, platform axes; filled [N, N m].

    Returns:
        Whether the platform has moved.
    """
    records, length, structure, speed, acceleration = cables
    own = track[0]
    if not place_platform(track, now_s):
        if own["poses"]:
            _lengthen_into(own, structure, speed, acceleration)
            _carry_into(own, tool, rotation, weight)
        return False
    place, turn = own["place"], own["turn"]
    cable_lengths_into(records, place, turn, length)
    structure_matrix_into(records, place, turn, structure)
    rotation[:] = turn
    tool_weight_into(tool[0], tool[1], rotation, weight)
    _lengthen_into(own, structure, speed, acceleration)
    _carry_into(own, tool, rotation, weight)
    return True


@njit(cache=True)
def _carry_into(
    own: Any, tool: tuple[float, FloatArray, FloatArray], rotation: FloatArray, weight: FloatArray
) -> None:
    """Fill the last of tool: the weight (6,), less mass times its centre's acceleration.

    a_c = a + b x c + w x (w x c), c from the platform's origin. What turning the body itself takes
    is left out, as its moments of inertia are not known: 0.03 N m at 5 rad/s^2 for the bench's.
    """
    mass, centre, carried = tool
    velocity, change = own["velocity"], own["acceleration"]
    lever, along, felt = np.zeros(3), np.zeros(3), np.zeros(3)
    for i in range(3):
        for j in range(3):
            lever[i] += rotation[i, j] * centre[j]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        along[i] = velocity[3 + j] * lever[k] - velocity[3 + k] * lever[j]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        turning = change[3 + j] * lever[k] - change[3 + k] * lever[j]
        turning += velocity[3 + j] * along[k] - velocity[3 + k] * along[j]
        for axis in range(3):
            felt[axis] -= mass * rotation[i, axis] * (change[i] + turning)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        carried[i] = weight[i] + felt[i]
        carried[3 + i] = weight[3 + i] + centre[j] * felt[k] - centre[k] * felt[j]


@njit(cache=True)
def _lengthen_into(
    own: Any, structure: FloatArray, speed: FloatArray, acceleration: FloatArray
) -> None:
    """Fill speeds and accelerations (n,) of the cables' lengths: l_dot = -A^T [v; w].

    The acceleration leaves out what turns the cables: v^2 / l, below 0.01 m/s^2 at 100 mm/s.
    """
    velocity, change = own["velocity"], own["acceleration"]
    for i in range(speed.shape[0]):
        speed[i] = acceleration[i] = 0.0
        for k in range(6):
            speed[i] -= structure[k, i] * velocity[k]
            acceleration[i] -= structure[k, i] * change[k]
