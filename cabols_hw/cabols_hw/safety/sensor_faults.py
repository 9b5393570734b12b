# SPDX-License-Identifier: Apache-2.0
"""Faults of the force/torque sensor and of the wrench, as a person is told them; pure."""

from __future__ import annotations

from cabols_control.checks import FloatArray
from cabols_control.supervision.faults import FaultName
from cabols_hw.bridge.bridge import Bridge
from cabols_hw.safety.config import SafetyConfig
from cabols_hw.safety.faults import AXES, BridgeFault
from cabols_hw.safety.rules import Rule


def sensor_fault(rule: int, gauge: int, bridge: Bridge, config: SafetyConfig) -> BridgeFault | None:
    """Return the fault of a sensor whose gauges break a rule, or whose wrench is out of its range.

    Args:
        rule: that is broken; FINE: none.
        gauge: that breaks it, from 0.
        bridge: with the sample's values.
        config: limits of the file.
    """
    if rule == Rule.FINE:
        # An axis can be beyond the sensor's range while every gauge is still valid.
        said = bridge.saturation
        if not said:
            return None
        return BridgeFault(FaultName.SENSOR_SATURATED, f"force/torque sensor: {said}")
    if rule == Rule.SENSOR_INVALID:
        return BridgeFault(
            FaultName.SENSOR_INVALID, f"force/torque sensor: gauge {gauge} is not a number"
        )
    volts = float(bridge.gauges[gauge])
    if rule == Rule.SENSOR_SATURATED:
        return BridgeFault(
            FaultName.SENSOR_SATURATED,
            f"force/torque sensor: a gauge is saturated: {gauge} at {volts:.2f} V",
        )
    return BridgeFault(
        FaultName.SENSOR_FLAT,
        f"force/torque sensor: gauge {gauge} has shown {volts:.4f} V for "
        f"{config.sensor_flat:g} s: a broken wire?",
    )


def wrench_fault(axis: int, wrench: FloatArray, config: SafetyConfig) -> BridgeFault:
    """Return the fault of a wrench beyond its limits.

    Args:
        axis: that is beyond, from 0.
        wrench: (6,) measured, platform axes [N, N m].
        config: limits of the file.
    """
    kind, unit = ("force", "N") if axis < 3 else ("torque", "N m")
    return BridgeFault(
        FaultName.WRENCH,
        f"{kind} {AXES[axis % 3]} is {wrench[axis]:.1f} {unit}, or will be more "
        f"before the motors can be stopped; {config.wrench_max[axis]:g} {unit} allowed",
    )


def estimate_fault(config: SafetyConfig) -> BridgeFault:
    """Return the fault of a sensor and tension estimates that disagree.

    Args:
        config: limits of the file.
    """
    return BridgeFault(
        FaultName.ESTIMATE,
        "the force/torque sensor and the tension estimates disagree by more than "
        f"{config.estimate_force:g} N or {config.estimate_torque:g} N m",
    )
