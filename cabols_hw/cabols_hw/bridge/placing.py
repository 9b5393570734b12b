"""Where the platform puts the cables at a sample, and how fast it lengthens them; compiled."""

from __future__ import annotations

from typing import Any

from numba import njit

from cabols_control.cable_kernels import cable_lengths_into, structure_matrix_into
from cabols_control.checks import FloatArray
from cabols_control.pose_track import place_platform
from cabols_hw.force_torque.tool_weight import tool_weight_into


@njit(cache=True, error_model="numpy")
def place_cables_into(
    track: Any,
    now_s: float,
    cables: tuple[Any, FloatArray, FloatArray, FloatArray, FloatArray],
    tool: tuple[float, FloatArray],
    rotation: FloatArray,
    weight: FloatArray,
) -> bool:
    """Extrapolate the platform's pose to a sample; nothing is computed while it stands.

    Args:
        track: (1,) record of POSE_TRACK; updated.
        now_s: of the sample [s].
        cables: (n,) records of CABLE; then, filled: (n,) lengths [m], (6, n) structure matrix,
            (n,) speeds [m/s] and (n,) accelerations [m/s^2] at which the platform lengthens them.
        tool: its mass [kg], (3,) centre of mass in platform axes [m].
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
        return False
    place, turn = own["place"], own["turn"]
    cable_lengths_into(records, place, turn, length)
    structure_matrix_into(records, place, turn, structure)
    rotation[:] = turn
    tool_weight_into(tool[0], tool[1], rotation, weight)
    _lengthen_into(own, structure, speed, acceleration)
    return True


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
