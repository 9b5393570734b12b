"""The usual step of a loaded rig's limb controller, from message to message in one compiled call.

What a step costs at 1 kHz is not its arithmetic: after a millisecond of other processes' work each
Python operation on an array finds cold caches and takes microseconds. So the case of nearly every
cycle (LOADING, all zeros known, nothing changes) has this short cut, around the same kernels.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_control.limb_control.law import limb_law_into
from cabols_control.limb_control.references import TENSION, references_into

ROWS = 7
"""Rows of loaded_step_into's array of that name."""


@njit(cache=True)
def loaded_step_into(
    state: Any,
    wanted: FloatArray,
    kind: IntArray,
    present: IntArray,
    changed: BoolArray,
    gains: FloatArray,
    law_state: FloatArray,
    rows: FloatArray,
    tension_limit: float,
    speed: float,
    current_limit: float,
    dt_s: float,
    answer: Any,
) -> bool:
    """Answer one limb state in tension control; arrays as in references_into and limb_law_into.

    Args:
        state: (1,) record of a LimbState, for limbs 0 to n - 1 in this order.
        wanted: (n,) desired tensions [N].
        kind: (n, 2).
        present: (n,) kinds of control at the previous state.
        changed: (n,) bool, work space.
        gains: (n, 2) of the law.
        law_state: (n, 2) of the law; updated.
        rows: (7, n) k_P2, length, rate, position, reference, the law's current and the output;
            updated but for the first.
        tension_limit: [N].
        speed: of SWITCH [m/s].
        current_limit: [A].
        dt_s: since the previous state [s].
        answer: (1,) record of a MotorCurrent; stamp, sequence, current and saturated are set.

    Returns:
        False if this is not the usual case; nothing is changed then.
    """
    come, sent = state[0], answer[0]
    n = wanted.shape[0]
    for i in range(n):
        if come["limb"][i] != i or not come["zeroed"][i]:
            return False
        if kind[i, 1] != TENSION or present[i] != TENSION:
            return False
        if not np.isfinite(come["tension"][i] + come["elongation"][i] + wanted[i]):
            return False
    references_into(
        kind,
        come["zeroed"],
        come["switch_closed"],
        come["wound_length"],
        come["elongation"],
        come["tension"],
        wanted,
        rows[0],
        tension_limit,
        speed,
        dt_s,
        present,
        changed,
        rows[1],
        rows[2],
        rows[3],
        rows[4],
    )
    limb_law_into(gains, current_limit, rows[4], rows[3], dt_s, law_state, rows[5])
    sent["header.stamp.sec"] = come["header.stamp.sec"]
    sent["header.stamp.nanosec"] = come["header.stamp.nanosec"]
    sent["sequence"] = come["sequence"]
    for i in range(n):
        rows[6, i] = rows[5, i]
        sent["current"][i] = rows[5, i]
        sent["saturated"][i] = abs(rows[5, i]) >= current_limit
    return True
