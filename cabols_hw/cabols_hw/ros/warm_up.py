# SPDX-License-Identifier: Apache-2.0
"""Warm-up of the bridge's kernels, for arrays as they lie in a message."""

from __future__ import annotations

from cabols_control.rig import Rig
from cabols_control.ros.messages.layout import Layout
from cabols_control.supervision.modes import OperatingMode
from cabols_hw.bridge.bridge import Bridge
from cabols_hw.safety.config import SafetyConfig
from cabols_hw.safety.guard import BridgeGuard


def warm_up_guard(
    rig: Rig, config: SafetyConfig, watchdog_s: float, bridge: Bridge, currents: Layout
) -> None:
    """Compile or load what a command and a sample call in the guard.

    Args:
        rig: geometry, limbs, limits.
        config: of the safety envelope.
        watchdog_s: age of the newest command that cuts all currents [s].
        bridge: whose arrays are those of the messages.
        currents: layout of motor_current.
    """
    record = currents.read(currents.record().raw())
    guard = BridgeGuard(rig, config, watchdog_s)
    guard.safety.hear_pose(0.0, rig.geometry.reference_position, rig.geometry.reference_rotation)
    guard.command(record["limb"], record["current"], 0.0)
    guard.sample(0.001, bridge, OperatingMode.STOPPED)
    guard.sample(0.002, bridge, OperatingMode.LOADING)
    guard.safety.warm_up(bridge)
    guard.unloading.warm_up(bridge.tension, bridge.elongation)
