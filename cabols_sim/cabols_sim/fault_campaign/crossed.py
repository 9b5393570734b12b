# SPDX-License-Identifier: Apache-2.0
"""Kinds of the generated campaign that are made once more with the real nodes; pure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cabols_sim.fault_campaign.in_process.kinds import GeneratedKind, generated_kinds
from cabols_sim.fault_campaign.judgement import SAFE_WITHIN_S
from cabols_sim.fault_campaign.kinds import ALL, ANY, HALF, HIGHEST, NONE, TWO, Kind
from cabols_sim.fault_campaign.table import PEAK_TENSION_N

STATES = ("pretightening", "loading", "free", "robot moves", "stopped")
"""States that the real nodes can be brought to at any time."""

Value = Callable[[np.random.Generator], float]


def _uniform(low: float, high: float, signed: bool = False) -> Value:
    def draw(random: np.random.Generator) -> float:
        return float(random.uniform(low, high) * (random.choice([-1.0, 1.0]) if signed else 1.0))

    return draw


def _gauge(random: np.random.Generator) -> float:
    return float(random.integers(1, 6))


INJECTED: dict[str, tuple[str, str, Value]] = {
    "cable breaks": ("cable_break", HIGHEST, _uniform(0.0, 0.0)),
    "two cables break": ("cable_break", TWO, _uniform(0.0, 0.0)),
    "switch stuck open": ("switch_open", HIGHEST, _uniform(0.0, 0.0)),
    "switch stuck closed": ("switch_closed", ANY, _uniform(0.0, 0.0)),
    "all switches read open": ("switch_open", ALL, _uniform(0.0, 0.0)),
    "all switches read closed": ("switch_closed", ALL, _uniform(0.0, 0.0)),
    "two switches stuck open": ("switch_open", TWO, _uniform(0.0, 0.0)),
    "encoder jumps": ("encoder_jump", ANY, _uniform(0.003, 0.02, True)),
    "encoder frozen": ("encoder_frozen", ANY, _uniform(0.0, 0.0)),
    "encoder of the highest frozen": ("encoder_frozen", HIGHEST, _uniform(0.0, 0.0)),
    "two encoders frozen": ("encoder_frozen", TWO, _uniform(0.0, 0.0)),
    "encoders of a connector frozen": ("encoder_frozen", HALF, _uniform(0.0, 0.0)),
    "motor jams": ("motor_jam", ANY, _uniform(0.0, 0.0)),
    "motor of the highest jams": ("motor_jam", HIGHEST, _uniform(0.0, 0.0)),
    "two motors jam": ("motor_jam", TWO, _uniform(0.0, 0.0)),
    "amplifiers' supply lost": ("motor_jam", ALL, _uniform(0.0, 0.0)),
    "amplifier offset": ("amplifier_offset", ANY, _uniform(0.5, 2.0, True)),
    "amplifier delivers all": ("amplifier_offset", ANY, _uniform(6.0, 7.0)),
    "two amplifiers offset": ("amplifier_offset", TWO, _uniform(1.0, 1.0)),
    "gauge flat": ("gauge_flat", NONE, _gauge),
    "gauge not a number": ("gauge_nan", NONE, _gauge),
    "gauge saturated": ("gauge_saturated", NONE, _gauge),
    "gauge drifts": ("gauge_drift", NONE, _uniform(2.0, 10.0, True)),
    "pose silent": ("pose_silent", NONE, _uniform(0.0, 0.0)),
    "pose jumps": ("pose_offset", NONE, _uniform(0.02, 0.3, True)),
}
"""What the service inject_fault can do of the generated ways: fault, limb, size."""


def _twins() -> dict[str, GeneratedKind]:
    """Generated kinds that can be made with the real nodes and must be found, by name."""
    return {
        kind.name: kind
        for kind in generated_kinds()
        if kind.state in STATES and kind.disturbance.name in INJECTED and not kind.latent
    }


TWINS = _twins()
CROSSED = tuple(
    Kind(name, "inject", *INJECTED[twin.disturbance.name], state=twin.state)
    for name, twin in TWINS.items()
)


def crossed_claims(trials: Sequence[dict[str, Any]]) -> dict[str, int]:
    """Count what breaks a claim; a motor that coasts or a robot that brakes is not judged by time.

    Args:
        trials: of CROSSED, as they stand in the log.
    """
    judged = [(trial, TWINS[trial["kind"]]) for trial in trials]
    timed = [t for t, twin in judged if not (twin.disturbance.amplifier or twin.by_robot)]
    driven = [t for t, twin in judged if twin.disturbance.name != "amplifier delivers all"]
    return {
        "undetected": sum(not trial["detected"] for trial in trials),
        "slow_to_safe": sum(
            t["safe_time_s"] is None or t["safe_time_s"] > SAFE_WITHIN_S for t in timed
        ),
        "tension_exceeded": sum(t["peak_tension_n"] > PEAK_TENSION_N for t in driven),
    }
