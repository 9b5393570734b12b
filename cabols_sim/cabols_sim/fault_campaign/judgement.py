# SPDX-License-Identifier: Apache-2.0
"""Judgement of one trial: detection, time to a safe state, peaks; pure."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.supervision.faults import FaultName

SAFE_WITHIN_S = 0.05
"""Longest time from a fault's detection to a safe state [s]."""
CARD_WATCHDOG_S = 0.010
GAP_S = 0.020
"""Longest gap between samples of a running bridge [s]."""
TOLERANCE_N = 5.0
"""After the reaction no tension may exceed the highest at detection by more than this."""


@dataclass(frozen=True)
class Report:
    """One message of loop_status or mode.

    Attributes:
        stamp_s: on the rig's clock [s].
        node: that reports.
        reason: what is not well, for people.
        fault: whether it stops the rig.
        name: what is not well, for the table; None where it has no name.
    """

    stamp_s: float
    node: str
    reason: str
    fault: bool
    name: FaultName | None = None


@dataclass(frozen=True, eq=False)
class TrialData:
    """Record from the fault on.

    Attributes:
        fault_s: when the fault began, on the rig's clock [s].
        time: (k,) [s].
        tension: (k, n) true tensions [N].
        current: (k, n) true motor currents [A].
        wrench: (k, 6) true wrench, base axes [N, N m].
        reports: what nodes said since.
    """

    fault_s: float
    time: FloatArray
    tension: FloatArray
    current: FloatArray
    wrench: FloatArray
    reports: tuple[Report, ...]


@dataclass(frozen=True)
class TrialResult:
    """Outcome of one trial; times in seconds of the rig.

    Attributes:
        kind: name of the kind.
        seed: of its draw.
        detected: whether any node said so.
        detection: the first report of a fault (without one: the first of all), "node: reason".
        found_by: the node of that report, with the name of what it found: for the table.
        detection_time_s: from the fault to that report.
        safe_time_s: from detection until the rig is safe for good; see judge.
        peak_tension_n: from the fault on.
        peak_force_n: of the wrench.
        peak_torque_nm: of the wrench.
    """

    kind: str
    seed: int
    detected: bool
    detection: str
    detection_time_s: float
    safe_time_s: float
    peak_tension_n: float
    peak_force_n: float
    peak_torque_nm: float
    found_by: str = ""

    @property
    def safe_in_time(self) -> bool:
        """Whether it was detected and safe within SAFE_WITHIN_S of that."""
        return self.detected and self.safe_time_s <= SAFE_WITHIN_S

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON; None for events that did not happen."""
        return {
            key: None if isinstance(value, float) and not np.isfinite(value) else value
            for key, value in asdict(self).items()
        }


def judge(kind: str, seed: int, data: TrialData) -> TrialResult:
    """Evaluate a trial.

    Safe is the rig from the instant at which its reaction is in force (all motor currents zero, or
    the bridge unloading by itself, as its fault report says) and after which no tension exceeds
    the highest at detection by more than TOLERANCE_N. A report without a fault, as of a desired
    wrench that has stopped coming, has its reaction in force at once: the load is ramped down.
    Where the bridge itself stands still it cannot tell: the card's watchdog has zeroed the outputs
    CARD_WATCHDOG_S into the gap if the first sample after it finds them at zero. Where it is gone
    for good, and with it the simulated physics, the rig counts as safe: that watchdog is shown by
    the frozen bridge and by tests/hw/test_daq_contract.py.

    Args:
        kind: of the trial's fault, for the result.
        seed: of its draw, for the result.
        data: what was recorded.

    Returns:
        The figures; times are inf where nothing was detected or the rig did not get safe.
    """
    # A notice may have another cause: it counts only where no fault is ever reported.
    telling = [report for report in data.reports if report.fault] or data.reports
    first = min(telling, key=lambda report: report.stamp_s, default=None)
    force = float(np.linalg.norm(data.wrench[:, :3], axis=1).max(initial=0.0))
    torque = float(np.linalg.norm(data.wrench[:, 3:], axis=1).max(initial=0.0))
    tension = data.tension.max(axis=1, initial=0.0)
    peak = float(tension.max(initial=0.0))
    if first is None:
        nothing = (False, "", np.inf, np.inf)
        return TrialResult(kind, seed, *nothing, peak, force, torque)
    # Reports carry the stamp of the sample that they are about.
    detected_s = max(first.stamp_s, data.fault_s)
    return TrialResult(
        kind,
        seed,
        True,
        f"{first.node}: {first.reason}",
        detected_s - data.fault_s,
        _safe_s(data, detected_s, first) - detected_s,
        peak,
        force,
        torque,
        f"{first.node}: {first.name}" if first.name is not None else first.node,
    )


def _safe_s(data: TrialData, detected_s: float, first: Report) -> float:
    time, tension = data.time, data.tension.max(axis=1, initial=0.0)
    resting = np.asarray(np.abs(data.current).max(axis=1, initial=0.0) < 1e-9)
    after = time >= detected_s - 1e-9
    if not after.any():
        return detected_s
    before = tension[~after]
    reference = float(before[-1] if before.size else tension[0])
    high = time[after & (tension > reference + TOLERANCE_N)]
    settled_s = float(high[-1]) if high.size else detected_s
    if not first.fault:
        return settled_s
    gaps = np.flatnonzero(np.diff(time) > GAP_S)
    cut = time[gaps[resting[gaps + 1]]] + CARD_WATCHDOG_S
    guarded = [
        report.stamp_s
        for report in data.reports
        if report.node == "plant" and report.fault and report.stamp_s >= detected_s - 1e-9
    ]
    reactions = [*guarded[:1], *time[after & resting][:1].tolist(), *cut.tolist()]
    return max(settled_s, detected_s, min(reactions, default=np.inf))
