# SPDX-License-Identifier: Apache-2.0
"""How long the supervisor waits, and for whom."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SupervisionConfig:
    """How the supervisor acts.

    Attributes:
        auto_start: go to PRETIGHTENING and LOADING without a request.
        settle_s: time of arriving states before the automatic start, e.g. for the tare.
        pretension_timeout_s: longest pre-tightening.
        state_timeout_s: longest silence of the limb states.
        controllers: nodes that must report before the cables may move.
        bridges: one of these must, too: it then gets motor currents; empty for none.
        report_timeout_s: longest age of a report that counts.
        unloaded_tension: below it in all limbs, UNLOADING is over [N].
        unload_timeout_s: longest UNLOADING.
        recorder: node without whose reports a test is not recorded; empty for none.
        recorder_timeout_s: longest silence of a recorder that has recorded.
        hangs: whether the platform hangs on its cables.
    """

    auto_start: bool = False
    settle_s: float = 0.4
    pretension_timeout_s: float = 15.0
    state_timeout_s: float = 0.2
    controllers: tuple[str, ...] = ("limb_controller", "wrench_controller")
    bridges: tuple[str, ...] = ("plant", "q8_ati_bridge")
    report_timeout_s: float = 1.5
    unloaded_tension: float = 8.0
    unload_timeout_s: float = 5.0
    recorder: str = "recorder"
    recorder_timeout_s: float = 5.0
    hangs: bool = False
