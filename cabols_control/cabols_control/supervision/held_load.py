# SPDX-License-Identifier: Apache-2.0
"""What load the gears hold while the motors are off, in words; pure."""

from __future__ import annotations

import numpy as np

from cabols_control.checks import BoolArray, FloatArray
from cabols_control.naming import limb_name, limb_names

HELD_N = 10.0
"""Tension that counts as a load; unloaded limbs are left at a few newtons [N]."""
STEP_N = 5.0
"""What is said is rounded, so that noise changes nothing [N]."""


def taut_limbs(tension: FloatArray, zeroed: BoolArray, closed: BoolArray) -> str:
    """Names of the limbs that pull; empty if none does, as far as is known.

    A robot that moves would stretch their cables while the motors are off: gears hold.

    Args:
        tension: (n,) estimates [N]; they count where there is a zero.
        zeroed: (n,) whether there is.
        closed: (n,) switches.
    """
    taut = np.flatnonzero(closed | (zeroed & (tension > HELD_N)))
    return limb_names(taut) if taut.size else ""


def held_text(tension: FloatArray, zeroed: BoolArray, closed: BoolArray, force: float) -> str:
    """Tell what the gears hold; empty where the cables are known to be unloaded.

    Args:
        tension: (n,) estimates [N]; they count where there is a zero.
        zeroed: (n,) whether there is.
        closed: (n,) switches.
        force: on the sensor [N]; NaN: not known.
    """
    pulling = np.flatnonzero(zeroed & (tension > HELD_N))
    unknown = np.flatnonzero(~zeroed & closed)
    parts = []
    if pulling.size:
        worst = int(pulling[np.argmax(tension[pulling])])
        parts.append(
            f"{limb_names(pulling)} pull, {limb_name(worst)} most, "
            f"about {_rounded(tension[worst])} N"
        )
    if unknown.size:
        parts.append(f"{limb_names(unknown)} pull by their switches, how much is not known")
    if not parts:
        return ""
    if np.isfinite(force):
        parts.append(f"the sensor shows about {_rounded(force)} N")
    return f"the gears hold: {'; '.join(parts)}. FREE_MOVING takes it off"


def _rounded(newtons: float) -> int:
    return int(STEP_N * round(float(newtons) / STEP_N))
