# SPDX-License-Identifier: Apache-2.0
"""The limb controller's step, from message to message in one compiled call, for all modes.

Arithmetic is not the cost of a step at 1 kHz: after a millisecond of other processes' work each
Python operation on an array meets cold caches and takes microseconds.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.compiling import njit
from cabols_control.limb_control.law import advance_law, reset_law
from cabols_control.limb_control.records import Outcome
from cabols_control.limb_control.references import (
    override_currents,
    set_references,
    set_setpoints,
)

LONGEST_STEP_S = 0.010
"""Longest gap between states for a derivative [s]; after a longer one the law resets bumplessly."""
UNLOADED_WITHIN_N = 3.0
"""Largest distance from the holding tension of an unloaded limb, left by dry friction [N]."""


@njit(cache=True)
def _unfit(state: Any, task: Any, limbs: Any, given: FloatArray) -> int:
    """Return why the task cannot continue with these arguments; DONE if it can."""
    if given.shape[0] != limbs.shape[0]:
        return Outcome.WRONG_LENGTH.value
    cables, zeroed = state["limb"], state["zeroed"]
    for i in range(cables.shape[0]):
        if cables[i] != i:
            return Outcome.WRONG_LIMBS.value
    if task["needs_zeros"]:
        for place in range(limbs.shape[0]):
            if not zeroed[limbs[place]["limb"]]:
                return Outcome.UNZEROED.value
    return Outcome.DONE.value


@njit(cache=True)
def _move(
    state: Any,
    task: Any,
    limbs: Any,
    given: FloatArray,
    dt_s: float,
    entered: bool,
    moving: bool,
    limit: float,
) -> int:
    """Set the limbs' currents in a mode in which they may flow."""
    anew = entered or not moving
    arrived = set_setpoints(state, task, limbs, given, dt_s, anew, UNLOADED_WITHIN_N)
    set_references(state, task, limbs, min(dt_s, LONGEST_STEP_S))
    gap = dt_s > LONGEST_STEP_S
    for place in range(limbs.shape[0]):
        limb = limbs[place]
        # Continue from the present current, at rest, without a bump.
        if (limb["changed"] or gap or not moving) and np.isfinite(limb["position"]):
            reset_law(limb, limb["position"], limb["current"])
    if not gap:
        if not advance_law(limbs, dt_s, limit):
            return Outcome.NOT_FINITE.value
        for place in range(limbs.shape[0]):
            limbs[place]["current"] = limbs[place]["law_current"]
    override_currents(limbs, limit)
    return Outcome.ARRIVED.value if arrived else Outcome.DONE.value


@njit(cache=True)
def write_answer(state: Any, work: Any, answer: Any) -> None:
    """Write the limbs' currents into the answer to a limb state.

    Args:
        state: (1,) record of the LimbState; its stamp and sequence go into the answer.
        work: (1,) record of limb_control_work for m limbs, after the step.
        answer: (1,) record of a MotorCurrent of m limbs, filled.
    """
    come, own, sent = state[0], work[0], answer[0]
    sent["header.stamp.sec"] = come["header.stamp.sec"]
    sent["header.stamp.nanosec"] = come["header.stamp.nanosec"]
    sent["sequence"] = come["sequence"]
    limbs, limit = own["limbs"], own["current_limit"]
    current, saturated = sent["current"], sent["saturated"]
    for place in range(limbs.shape[0]):
        current[place] = limbs[place]["current"]
        saturated[place] = abs(limbs[place]["law_current"]) >= limit


@njit(cache=True)
def step_limbs(
    state: Any, given: FloatArray, work: Any, mode: int, dt_s: float, answer: Any
) -> int:
    """Answer one limb state.

    Args:
        state: (1,) record of a LimbState of all n limbs, flags as bytes.
        given: (m,) setpoints of a mode without ramps [N].
        work: (1,) record of limb_control_work for m limbs; updated.
        mode: number of the operating mode whose task is done.
        dt_s: time since the previous state, positive [s].
        answer: (1,) record of a MotorCurrent of m limbs; stamp, sequence, current and saturated
            are set.

    Returns:
        An Outcome. From RESTED on, all currents are zero.
    """
    come, own = state[0], work[0]
    task, limbs, moving = own["tasks"][mode], own["limbs"][:], own["moving"]
    outcome = _unfit(come, task, limbs, given)
    if outcome == Outcome.DONE:
        outcome = Outcome.RESTED.value
        if task["moves"]:
            entered, limit = mode != own["mode"], own["current_limit"]
            outcome = _move(come, task, limbs, given, dt_s, entered, moving, limit)
    if outcome >= Outcome.RESTED:
        for place in range(limbs.shape[0]):
            limbs[place]["current"] = 0.0
    own["mode"], own["moving"] = mode, outcome < Outcome.RESTED
    write_answer(state, work, answer)
    return outcome
