# SPDX-License-Identifier: Apache-2.0
"""Commissions one limb of a running rig, and waits where the rig is only not ready yet."""

from __future__ import annotations

import time
from collections.abc import Callable
from threading import Event
from typing import Any

from cabols_control.result_code import NOT_YET, ResultCode
from cabols_control.ros.rig_client import ActionFailedError, RigClient

ACTION = "commission_limb"
FOUND_S = 180.0
"""Longest wait for the action; a first start compiles for a minute or two [s]."""
PATIENCE_S = 60.0
"""Time for which a refusal is tried again [s]: nodes that compile at first start are silent."""
AGAIN_S = 0.5
TRIED_AGAIN = NOT_YET | {ResultCode.FAULT_REPORTED}


def commission_limb(
    rig: RigClient,
    timeout_s: float,
    on_refusal: Callable[[str], object] = lambda _: None,
    on_feedback: Callable[[Any], object] | None = None,
    **goal: Any,
) -> Any:
    """Run the action once; a refusal before any motion is tried again for a minute.

    Args:
        rig: client of the running rig.
        timeout_s: longest motion [s]; the action is cancelled then.
        on_refusal: called with each new reason for which the rig is waited for.
        on_feedback: called with each feedback, in the executor's thread.
        goal: fields of CommissionLimb's goal.

    Returns:
        The action's result, with success or without.

    Raises:
        RigError: if there is no action, it is not accepted, or it does not end.
    """
    give_up, told, accept_s, moved = time.monotonic() + PATIENCE_S, "", FOUND_S, Event()

    def hear(feedback: Any) -> None:
        """The action tells its progress from the first motion on."""
        moved.set()
        if on_feedback is not None:
            on_feedback(feedback)

    while True:
        try:
            return rig.run(ACTION, hear, timeout_s, accept_s, **goal)
        except ActionFailedError as error:
            accept_s = PATIENCE_S
            late = time.monotonic() > give_up
            if error.code not in TRIED_AGAIN or moved.is_set() or late:
                return error.result
            if error.result.message != told:
                told = error.result.message
                on_refusal(told)
        rig.pause(AGAIN_S)
