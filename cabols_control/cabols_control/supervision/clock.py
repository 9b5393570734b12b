# SPDX-License-Identifier: Apache-2.0
"""Samples whose clock goes back, such as those of a bridge that was restarted; pure."""

from __future__ import annotations

from cabols_control.supervision.faults import Fault, FaultName

CLOCK_BACK_S = 0.010
"""A sample older than its predecessor by more than this comes from another clock [s]."""


def clock_fault(topic: str, dt_s: float) -> Fault | None:
    """Return the fault of a sample whose clock cannot be followed; None if it can.

    Otherwise older data would seem fresh for as long as the jump.

    Args:
        topic: where the sample came from.
        dt_s: its stamp less the one's before [s].
    """
    if not dt_s < -CLOCK_BACK_S:
        return None
    reason = f"{topic}'s clock went back by {-dt_s:.3g} s: was the bridge restarted?"
    return Fault(FaultName.CLOCK, reason)
