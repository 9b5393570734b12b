# SPDX-License-Identifier: Apache-2.0
"""Kinds of faults that the campaign causes; pure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cabols_control.checks import FloatArray

HIGHEST, ANY, NONE = "highest", "any", "none"
ALL, HALF, TWO = "all", "half", "two"
LOADING = "loading"
PROCESSES = (
    "supervisor",
    "limb_controller",
    "wrench_controller",
    "load_program",
    "plant",
    "abb_tracker_bridge",
    "device_simulator",
)
"""Every process of the graph but the recorder, which commands nothing."""


@dataclass(frozen=True)
class Kind:
    """One kind of trial.

    Attributes:
        name: for the table.
        how: "inject" (the simulated rig's service), "pretighten" (the same, and the fault shows
            when the operator unloads and pre-tightens: until then nothing depends on it), "kill",
            "freeze", "demand" or "beam".
        fault: the service's name of it, or the process.
        limb: which limb gets it, by tension.
        value: draws its size.
        demand: (6,) desired wrench from the instant of the fault on [N, N m]; None to continue.
        state: of the rig, one of the generated campaign's.
    """

    name: str
    how: str
    fault: str = ""
    limb: str = NONE
    value: Callable[[np.random.Generator], float] = lambda _: 0.0
    demand: tuple[float, ...] | None = None
    state: str = LOADING

    def pick_limbs(self, random: np.random.Generator, tension: FloatArray) -> list[int]:
        """Return the limbs that get it, for (n,) true tensions [N]; -1 where it has none.

        Args:
            random: generator of the trial.
            tension: (n,) true [N].
        """
        order, n = np.argsort(tension), tension.size
        if self.limb == NONE:
            return [-1]
        if self.limb == ANY:
            return [int(random.integers(n))]
        if self.limb == TWO:
            return [int(i) for i in random.choice(n, 2, replace=False)]
        if self.limb in (ALL, HALF):
            first = int(random.integers(2)) * (n // 2) if self.limb == HALF else 0
            return list(range(first, first + n // 2 if self.limb == HALF else n))
        return [int(order[-1 - random.integers(2)])]


def _sign(random: np.random.Generator) -> float:
    return float(random.choice([-1.0, 1.0]))


INJECTED = (
    Kind("cable breaks", "inject", "cable_break", HIGHEST),
    Kind("switch stuck open", "inject", "switch_open", HIGHEST),
    Kind("switch stuck closed, then tighten", "pretighten", "switch_closed", ANY),
    Kind("switch stuck open, then tighten", "pretighten", "switch_open", ANY),
    Kind(
        "encoder jumps",
        "inject",
        "encoder_jump",
        ANY,
        lambda random: _sign(random) * random.uniform(0.003, 0.02),
    ),
    Kind(
        "amplifier offset",
        "inject",
        "amplifier_offset",
        ANY,
        lambda random: _sign(random) * random.uniform(0.5, 2.0),
    ),
    Kind(
        "motor jams, load changes",
        "inject",
        "motor_jam",
        HIGHEST,
        demand=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    ),
    Kind("gauge flat", "inject", "gauge_flat", value=lambda r: float(r.integers(1, 6))),
    Kind("gauge not a number", "inject", "gauge_nan", value=lambda r: float(r.integers(1, 6))),
    Kind("gauge saturated", "inject", "gauge_saturated", value=lambda r: float(r.integers(1, 6))),
    Kind("gauge drifts", "inject", "gauge_drift", value=lambda r: _sign(r) * r.uniform(2.0, 10.0)),
    Kind(
        "platform moves", "inject", "platform_runs", value=lambda r: _sign(r) * r.uniform(0.04, 0.2)
    ),
    Kind(
        "reported pose jumps",
        "inject",
        "pose_offset",
        value=lambda r: _sign(r) * r.uniform(0.02, 0.5),
    ),
    Kind("wrench too large", "demand", demand=(190.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
    Kind("tension too high", "demand", demand=(145.0, -145.0, 300.0, 0.0, 0.0, 0.0)),
)
NETWORK = (
    Kind("EGM: 30 % lost, 50 ms late", "inject", "egm_bad"),
    Kind("tracker's beam broken", "beam", "beam"),
)
KILLED = tuple(Kind(f"kill -9 {name}", "kill", name) for name in PROCESSES)
FROZEN = tuple(Kind(f"freeze {name}", "freeze", name) for name in PROCESSES)
KINDS = (*INJECTED, *NETWORK, *KILLED, *FROZEN)
