# SPDX-License-Identifier: Apache-2.0
"""Faults of limbs, as the envelope reports them: their names, and what a person is told; pure."""

from __future__ import annotations

from typing import Any

import numpy as np

from cabols_control.naming import limb_name
from cabols_control.supervision.faults import FaultName
from cabols_hw.bridge.bridge import Bridge
from cabols_hw.safety.config import SafetyConfig
from cabols_hw.safety.faults import BridgeFault
from cabols_hw.safety.rules import Rule

ALONE = 0.3
"""Share of a limb's tension by which what the sensor misses may differ from it, to be its own."""


def limb_fault(rule: Rule, i: int, limb: Any, limits: Any, config: SafetyConfig) -> BridgeFault:
    """Return the fault of a limb that breaks a rule, but for a broken cable.

    Args:
        rule: that is broken.
        i: limb, from 0.
        limb: its record of LIMB_WATCH.
        limits: record of LIMB_LIMITS.
        config: limits of the file.
    """
    bound, ahead = float(limb["bound"]), max(float(limb["ahead"]), 0.0)
    name, reason = {
        Rule.ENCODER: (FaultName.ENCODER, f"jumped to {limb['last_speed']:.1f} m/s"),
        Rule.TENSION: (
            FaultName.TENSION,
            f"pulls {bound:.1f} N, and {bound + ahead:.1f} N before its motor can be stopped; "
            f"{config.tension_max:g} N allowed",
        ),
        Rule.CABLE_SPEED: (
            FaultName.CABLE_SPEED,
            f"winds at {limb['last_speed']:.2f} m/s, {config.cable_speed:g} m/s allowed, and "
            f"{config.search_speed:g} m/s inwards without a zero",
        ),
        Rule.SEARCH: (
            FaultName.SWITCH,
            f"wound in {1e3 * config.search_length:.0f} mm and its switch has not moved: "
            "is it, its wire or its supply broken, switch_active_low of card.yaml the wrong way "
            "round, or the cable too slack? Check the switch, "
            "take up the slack by hand, then start the bridge again",
        ),
        Rule.PAYOUT: (
            FaultName.SWITCH,
            f"paid out {1e3 * config.search_length:.0f} mm with an open switch: is the limb "
            "controller wrong, or the switch broken?",
        ),
        Rule.SWITCH: (
            FaultName.SWITCH,
            f"closed after paying out {1e3 * config.switch_payout:.0f} mm: stuck, its wire broken, "
            "or, where all are, switch_active_low of card.yaml the wrong way round?",
        ),
        Rule.CURRENT: (
            FaultName.CURRENT,
            f"at its limit of {limits['current_limit']:g} A for "
            f"{1e3 * config.current_saturated:.0f} ms",
        ),
        Rule.MOTION: (
            FaultName.MOTION,
            f"more than {config.motion_current:g} A are not in its motion; jammed, a slipping "
            "encoder or an amplifier's offset?",
        ),
    }[rule]
    return BridgeFault(name, f"{limb_name(i)}: {reason}", -1 if rule == Rule.TENSION else i)


def unseen_fault(i: int, force: float) -> BridgeFault:
    """Return the fault of a limb that pulls more and more while its encoder stands still.

    Args:
        i: limb, from 0.
        force: that the sensor feels along its cable, beyond all estimates [N].
    """
    return BridgeFault(
        FaultName.MOTION,
        f"{limb_name(i)}: the sensor feels its cable pull {force:.1f} N more within "
        "milliseconds, and its encoder stands still: does its amplifier drive by itself, with a "
        "broken encoder?",
        i,
    )


def missing_force(i: int, bridge: Bridge) -> float:
    """Force that the sensor misses of what all tensions say, along a limb's cable [N].

    Args:
        i: limb, from 0.
        bridge: with the sample's values.
    """
    measured = bridge.rotation @ bridge.wrench[:3]
    return float(bridge.structure[:3, i] @ (bridge.structure[:3] @ bridge.tension - measured))


def alone_missing(i: int, bridge: Bridge) -> bool:
    """Whether what the sensor misses of all tensions is what one limb should pull, and no more.

    A wrong pose makes all tensions wrong together: then force and torque do not fit one cable.

    Args:
        i: limb, from 0.
        bridge: with the sample's values.
    """
    matrix, turn = bridge.structure, bridge.rotation
    missing = matrix @ bridge.tension
    missing[:3] -= turn @ bridge.wrench[:3]
    missing[3:] -= turn @ bridge.wrench[3:]
    arm = np.linalg.norm(matrix[3:]) / np.linalg.norm(matrix[:3])
    column = matrix[:, i].copy()
    column[3:] /= arm
    missing[3:] /= arm
    size = float(column @ column)
    pull = float(column @ missing) / size
    rest = float(np.linalg.norm(missing - pull * column))
    expected = float(bridge.tension[i])
    return abs(pull - expected) < ALONE * expected and rest < ALONE * expected * size**0.5


def cable_or_switch(i: int, tension: float, bridge: Bridge) -> BridgeFault:
    """Distinguish a broken cable, whose force is missing, from a switch that is stuck open.

    Args:
        i: limb, from 0.
        tension: that it should have [N].
        bridge: with the sample's values.
    """
    if not bridge.zeroed[i]:
        return BridgeFault(
            FaultName.SWITCH,
            f"{limb_name(i)}: open, but since it last moved the limb has wound in to "
            f"{tension:.1f} N: is the switch or its wire broken? Check it first",
            i,
        )
    if missing_force(i, bridge) > 0.5 * tension:
        return BridgeFault(
            FaultName.CABLE,
            f"{limb_name(i)}: elongation says {tension:.1f} N, switch and sensor say none: "
            "broken, or has its encoder lost counts?",
            i,
        )
    return BridgeFault(
        FaultName.SWITCH, f"{limb_name(i)}: open at an estimated {tension:.1f} N: stuck?", i
    )
