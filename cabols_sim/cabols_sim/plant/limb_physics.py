"""Physics of a limb: motor with friction, gear backlash, spring, cable; compiled.

The columns of `table` (n, 10) are: k, T, Coulomb current, viscous current, load current, backlash,
spring compliance, spring initial tension, fixed cable compliance, cable compliance per metre.
The columns of `state` (n, 3) are: motor position x [m of cable], motor speed v [m/s], pulley
position p [m of cable wound in].
"""

from __future__ import annotations

import numpy as np
from numba import njit

from cabols_control.checks import FloatArray

COLUMNS = 10


@njit(cache=True)
def cable_tension(elongation: float, length: float, row: FloatArray) -> float:
    """Tension [N] of cable and spring in series, stretched by elongation [m]; none when slack.

    Below the spring's initial tension its coils touch and only the cable stretches.
    """
    if elongation <= 0.0:
        return 0.0
    cable = row[8] + row[9] * length
    initial = row[7]
    below: float = elongation / cable
    if below <= initial:
        return below
    beyond: float = (elongation + initial * row[6]) / (cable + row[6])
    return beyond


@njit(cache=True)
def limb_step(
    table: FloatArray,
    state: FloatArray,
    current: FloatArray,
    rest: FloatArray,
    length: FloatArray,
    dt_s: float,
    tension: FloatArray,
) -> None:
    """Advance all limbs by one integration step.

    The motor is T dv/dt + v = k (i - friction - load): (3.11) with dry and viscous friction and
    the cable's pull. It is integrated exactly over the step for constant current and load; dry
    friction then takes up to its own share, and holds the motor still when that is enough. The
    pulley follows within the backlash (a play held by friction).

    Args:
        table: (n, 10) parameters.
        state: (n, 3) motor position, speed, pulley position; updated.
        current: (n,) [A].
        rest: (n,) cable wound out and slack when p = 0, so that elongation is
            length - rest + p [m].
        length: (n,) distance between the cable's points [m].
        dt_s: step [s].
        tension: (n,) at the start of the step on entry, at its end on return [N].
    """
    for i in range(table.shape[0]):
        k, time_constant = table[i, 0], table[i, 1]
        # Viscous current beyond k slows the pole and lowers the gain: v (1 + k c) = k i.
        slower = 1.0 + k * table[i, 3]
        gain = k / slower
        decay = np.exp(-dt_s * slower / time_constant)
        drive = gain * (current[i] - table[i, 4] * tension[i])
        free = decay * state[i, 1] + (1.0 - decay) * drive
        friction = (1.0 - decay) * gain * table[i, 2]
        if abs(free) <= friction:
            speed = 0.0
        elif free > 0.0:
            speed = free - friction
        else:
            speed = free + friction
        state[i, 0] += 0.5 * (state[i, 1] + speed) * dt_s
        state[i, 1] = speed
        half = 0.5 * table[i, 5]
        state[i, 2] = min(max(state[i, 2], state[i, 0] - half), state[i, 0] + half)
        tension[i] = cable_tension(length[i] - rest[i] + state[i, 2], length[i], table[i])


@njit(cache=True)
def advance_limbs(
    table: FloatArray,
    state: FloatArray,
    current: FloatArray,
    rest: FloatArray,
    length: FloatArray,
    dt_s: float,
    steps: int,
    tension: FloatArray,
) -> None:
    """Advance all limbs by several integration steps; see limb_step."""
    for _ in range(steps):
        limb_step(table, state, current, rest, length, dt_s, tension)


@njit(cache=True)
def cable_wrench(matrix: FloatArray, tension: FloatArray, wrench: FloatArray) -> None:
    """Fill wrench (6,) = structure matrix (6, n) @ tension (n,).

    Args:
        matrix: (6, n) structure matrix.
        tension: (n,) [N].
        wrench: (6,), filled [N, N m].
    """
    for row in range(6):
        total = 0.0
        for i in range(tension.shape[0]):
            total += matrix[row, i] * tension[i]
        wrench[row] = total
