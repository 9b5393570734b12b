# SPDX-License-Identifier: Apache-2.0
"""What a rig's files must show before a platform may hang on its cables; pure."""

from __future__ import annotations

from itertools import product

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.forward_kinematics.hanging import HangingPlatform
from cabols_control.kinematics import structure_matrix
from cabols_control.naming import limb_name, limb_names
from cabols_control.rig import Rig
from cabols_control.workspace.suspension import borne_share, judge_suspension
from cabols_hw.card.config import CardConfig
from cabols_hw.safety.config import SafetyConfig

SURE = 0.8
"""Largest share of the weight that cables may bear where the stand must be known to bear it."""


def missing_condition(rig: Rig, safety: SafetyConfig, card: CardConfig) -> str:
    """Say which condition of a platform that hangs on its cables the files leave open.

    Args:
        rig: geometry, limbs, control, what hangs.
        safety: with platform_held and suspension.
        card: with what open switches mean.

    Returns:
        What is missing, for people; empty: nothing is.
    """
    declared, hanging = safety.suspension, rig.hanging
    if declared is None or hanging is None:
        return (
            "safety.yaml of the rig's folder has no block suspension (sinking_speed, proof_pull, "
            "net_depth), in which the site says what ends a fall"
        )
    if card.switch_active_low:
        return (
            "card.yaml says switch_active_low: true, by which switches without supply read open, "
            "as they do while the platform stands"
        )
    control = rig.control
    pulls = (
        (safety.cable_tension, "cable_tension of safety.yaml", rig.limbs.switch_tension),
        (control.tension_min, "tension_min of control.yaml", safety.cable_tension),
        (declared.proof_pull, "proof_pull of safety.yaml", control.tension_min),
        (safety.tension_max, "tension_max of safety.yaml", declared.proof_pull),
    )
    for value, name, least in pulls:
        if not value > least:
            return (
                f"{name} is {value:g} N and must be more than {least:g} N: switch_tension < "
                "cable_tension < tension_min < proof_pull < tension_max, so that an open switch "
                "tells of a lost cable and no limb pulls more than its gear was proven for"
            )
    away = np.array(safety.position_range)
    gears = judge_suspension(rig, hanging.mass, hanging.centre, away)
    if not gears.known:
        return gears.told()
    if not gears.sinking <= declared.sinking_speed:
        return f"{gears.told()}; sinking_speed allows {declared.sinking_speed:g} m/s"
    platform = HangingPlatform(rig.geometry, rig.springs, hanging.mass, hanging.centre)
    stand = np.array(rig.geometry.reference_position)
    return (
        _stand_unsure(rig, safety, platform, stand)
        or _lifts_early(rig, platform, stand)
        or _loss_unbounded(rig, safety, platform, stand)
    )


def _stand_unsure(
    rig: Rig, safety: SafetyConfig, platform: HangingPlatform, stand: FloatArray
) -> str:
    """Why open switches do not prove that the stand bears the platform, though one lies."""
    rotation = np.asarray(rig.geometry.reference_rotation)
    weight, n = platform.weight_at(rotation), rig.geometry.cables
    for corner in product((-1.0, 0.0, 1.0), repeat=3):
        position = stand + np.array(corner) * np.array(safety.position_range)
        for liar in range(n):
            most = np.full(n, rig.limbs.switch_tension)
            most[liar] = safety.tension_max
            share = borne_share(rig.geometry, position, rotation, weight, most)
            if not share <= SURE:
                return (
                    f"with all switches open, and that of {limb_name(liar)} stuck, the cables may "
                    f"still bear {share:.0%} of the weight: that they are open does not prove that "
                    "the platform stands"
                )
    return ""


def _lifts_early(rig: Rig, platform: HangingPlatform, stand: FloatArray) -> str:
    """Why a search for switches could lift the platform off its stand."""
    matrix = structure_matrix(rig.geometry, stand, rig.geometry.reference_rotation)
    up = float(np.maximum(matrix[2], 0.0).sum()) * rig.holding_tension
    if up <= SURE * platform.weight:
        return ""
    return (
        f"while limbs search for their switches, at {rig.holding_tension:.1f} N, the cables may "
        f"lift with {up:.0f} N, and the platform weighs {platform.weight:.0f} N"
    )


def _loss_unbounded(
    rig: Rig, safety: SafetyConfig, platform: HangingPlatform, stand: FloatArray
) -> str:
    """Why a broken cable's fall has no end."""
    if safety.suspension is not None and safety.suspension.net_depth is not None:
        return ""
    rotation = np.asarray(rig.geometry.reference_rotation)
    weight, needed = platform.weight_at(rotation), set()
    for corner in product((-1.0, 0.0, 1.0), repeat=3):
        position = stand + np.array(corner) * np.array(safety.position_range)
        for lost in range(rig.geometry.cables):
            most = np.full(rig.geometry.cables, safety.tension_max)
            most[lost] = 0.0
            if not borne_share(rig.geometry, position, rotation, weight, most) >= 1.0:
                needed.add(lost)
    if not needed:
        return ""
    return (
        f"suspension declares no net (net_depth), and without {limb_names(sorted(needed))} the "
        "others do not bear the platform everywhere in position_range"
    )
