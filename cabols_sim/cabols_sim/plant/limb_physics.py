# SPDX-License-Identifier: Apache-2.0
"""Physics of a limb: motor with friction, gear backlash, spring, cable; compiled."""

from __future__ import annotations

from typing import Any

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.compiling import njit

LIMB_PARAMETERS = np.dtype(
    [
        ("gain", np.float64),  # k [m/s/A]
        ("time_constant", np.float64),  # T [s]
        ("coulomb_current", np.float64),  # overcomes dry friction [A]
        ("viscous_current", np.float64),  # per speed beyond what k contains [A s/m]
        ("load_current", np.float64),  # holds 1 N of cable tension through the gear [A/N]
        ("backlash", np.float64),  # at the cable [m]
        ("spring_compliance", np.float64),  # [m/N]; 0 without a spring
        ("spring_initial_tension", np.float64),  # below it the coils touch [N]
        ("spring_end_tension", np.float64),  # above it only the cable stretches [N]; inf: never
        ("self_locking", np.int64),  # whether the cable's pull cannot turn the motor
        ("cable_compliance_fixed", np.float64),  # [m/N]
        ("cable_compliance_per_metre", np.float64),  # [1/N]
    ],
    align=True,
)
"""True physics of one limb."""

LIMB_STATE = np.dtype(
    [
        ("motor_position", np.float64),  # [m of cable]
        ("motor_speed", np.float64),  # [m/s]
        ("pulley_position", np.float64),  # cable wound in [m]
    ],
    align=True,
)
"""State of one limb."""


@njit(cache=True)
def cable_tension(elongation: float, length: float, limb: Any) -> float:
    """Tension [N] of cable and spring in series, stretched by elongation [m]; none when slack.

    Below the spring's initial tension its coils touch, and above its end tension its end is
    reached: there only the cable stretches.

    Args:
        elongation: of both [m].
        length: of cable [m].
        limb: record of LIMB_PARAMETERS.
    """
    if elongation <= 0.0:
        return 0.0
    cable = limb["cable_compliance_fixed"] + limb["cable_compliance_per_metre"] * length
    initial, spring = limb["spring_initial_tension"], limb["spring_compliance"]
    below: float = elongation / cable
    if below <= initial:
        return below
    beyond: float = (elongation + initial * spring) / (cable + spring)
    end = limb["spring_end_tension"]
    if beyond > end:
        beyond = end + (elongation + initial * spring - end * (cable + spring)) / cable
    return beyond


@njit(cache=True)
def limb_step(
    limbs: Any,
    state: Any,
    current: FloatArray,
    rest: FloatArray,
    length: FloatArray,
    dt_s: float,
    tension: FloatArray,
) -> None:
    """Advance all limbs by one integration step.

    The motor is T dv/dt + v = k (i - friction - load): (3.11) with dry and viscous friction and
    the cable's pull. It is integrated exactly over the step for constant current and load; dry
    friction then takes up to its own share, and holds the motor still when that is enough. Through
    a self-locking gear the pull only takes current from a motor that winds in. The pulley follows
    within the backlash (a play held by friction).

    Args:
        limbs: (n,) records of LIMB_PARAMETERS.
        state: (n,) records of LIMB_STATE; updated.
        current: (n,) [A].
        rest: (n,) length of slack cable at pulley position 0, so that elongation is
            length - rest + pulley position [m].
        length: (n,) distance between the cable's points [m].
        dt_s: step [s].
        tension: (n,) at the start of the step on entry, at its end on return [N].
    """
    for i in range(limbs.shape[0]):
        limb, now = limbs[i], state[i]
        k = limb["gain"]
        # Viscous current beyond k slows the pole and lowers the gain: v (1 + k c) = k i.
        slower = 1.0 + k * limb["viscous_current"]
        gain = k / slower
        decay = np.exp(-dt_s * slower / limb["time_constant"])
        load = limb["load_current"] * tension[i]
        if limb["self_locking"]:
            load = min(load, max(current[i], 0.0))
        drive = gain * (current[i] - load)
        free = decay * now["motor_speed"] + (1.0 - decay) * drive
        friction = (1.0 - decay) * gain * limb["coulomb_current"]
        if abs(free) <= friction:
            speed = 0.0
        elif free > 0.0:
            speed = free - friction
        else:
            speed = free + friction
        now["motor_position"] += 0.5 * (now["motor_speed"] + speed) * dt_s
        now["motor_speed"] = speed
        half, motor = 0.5 * limb["backlash"], now["motor_position"]
        now["pulley_position"] = min(max(now["pulley_position"], motor - half), motor + half)
        tension[i] = cable_tension(length[i] - rest[i] + now["pulley_position"], length[i], limb)


@njit(cache=True)
def advance_limbs(
    limbs: Any,
    state: Any,
    current: FloatArray,
    rest: FloatArray,
    length: FloatArray,
    dt_s: float,
    steps: int,
    tension: FloatArray,
) -> None:
    """Advance all limbs by several integration steps, platform and currents standing still.

    Args:
        limbs: (n,) records of LIMB_PARAMETERS.
        state: (n,) records of LIMB_STATE; updated.
        current: (n,) [A].
        rest: (n,) length of slack cable at pulley position 0 [m].
        length: (n,) distance between the cable's points [m].
        dt_s: one step [s].
        steps: how many.
        tension: (n,) at the start on entry, at the end on return [N].
    """
    for _ in range(steps):
        limb_step(limbs, state, current, rest, length, dt_s, tension)


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
