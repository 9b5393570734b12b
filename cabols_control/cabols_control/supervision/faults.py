# SPDX-License-Identifier: Apache-2.0
"""The only table of faults: everything that a node can report as wrong, by name.

LoopStatus.fault, Mode.fault and SetMode's answer hold such a name; programs decide by it alone. The
reason beside it is for people.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class FaultName(str, Enum):
    """Name of a fault; its value stands in messages."""

    # Found by the bridge in what it samples; its reactions are in cabols_hw.safety.faults.
    TENSION = "tension"
    CABLE_SPEED = "cable_speed"
    WRENCH = "wrench"
    ESTIMATE = "estimate"
    SENSOR_INVALID = "sensor_invalid"
    SENSOR_SATURATED = "sensor_saturated"
    SENSOR_FLAT = "sensor_flat"
    CABLE = "cable"
    SWITCH = "switch"
    POSE = "pose"
    POSE_SPEED = "pose_speed"
    POSE_AGE = "pose_age"
    CURRENT = "current"
    MOTION = "motion"
    ENCODER = "encoder"
    STATE_AGE = "state_age"
    COMMAND_AGE = "command_age"
    CARD = "card"
    FIRST_POWER_ON = "first_power_on"
    """The rig's wiring has not been checked: one limb moves at a time, at 0.1 A, for 5 mm."""
    NOT_HELD = "not_held"
    """Nothing but the cables holds the platform: no current may flow."""
    HANGS = "hangs"
    """The platform hangs on its cables and stands on nothing; a notice, with a healthy state."""
    GEAR = "gear"
    """A gear does not hold what limbs.yaml says, with the amplifiers off."""
    INACTIVE = "inactive"
    """The bridge is a managed node that is not active: its amplifiers stay off."""
    # Found by controllers and by the bridge in what they receive.
    CLOCK = "clock"
    """The samples' clock went back."""
    MESSAGE = "message"
    """A message is not as expected: limbs, lengths, order, or an answer to no sample."""
    NOT_FINITE = "not_finite"
    NOT_ZEROED = "not_zeroed"
    """A load is commanded to limbs that are not pre-tightened."""
    TENSION_AGE = "tension_age"
    """tension_command is stale, or has never come."""
    MODE_AGE = "mode_age"
    """The supervisor is silent."""
    DESIRED = "desired"
    """A desired wrench or tension cannot be used; the one before stays in force."""
    DESIRED_AGE = "desired_age"
    """The desired wrench or tensions are stale: they are ramped down."""
    NOT_TARED = "not_tared"
    """The force/torque sensor's bias is not known: no load may be commanded."""
    TARE_REFUSED = "tare_refused"
    """The bias before stays in force."""
    LOAD_HELD = "load_held"
    """At rest, the gears hold a load; a notice, with a healthy state."""
    ENDING = "ending"
    """A process of the control path is asked to end: the rig unloads first."""
    RECORDING = "recording"
    """What happens is not recorded any more: the test ends in order."""
    # Found by the robot's bridge.
    STREAM_SILENT = "stream_silent"
    STREAM_QUALITY = "stream_quality"
    STREAM_REFUSED = "stream_refused"
    """Packets of the robot's stream, or beside it, are not used."""
    ROBOT_MOTORS = "robot_motors"
    """The robot's motors are off: its brakes hold it, and not its joints' servo control."""
    ROBOT_PROGRAM = "robot_program"
    """RAPID is stopped; the robot stands under servo control."""
    TRACKER_WARM_UP = "tracker_warm_up"
    """The laser tracker warms up: its frame still drifts. Told beside the measurements."""
    # Found by the supervisor.
    PRETIGHTENING_TIME = "pretightening_time"
    UNLOADING_TIME = "unloading_time"
    EMERGENCY_STOP = "emergency_stop"
    SECOND_PUBLISHER = "second_publisher"
    """Two nodes publish a topic that has one publisher."""
    # Found by the pose estimator.
    POSE_SOURCES = "pose_sources"
    """Robot, encoders, sensor or tracker disagree about the platform's pose; a notice."""
    # Found by the stiffness identification.
    IDENTIFICATION = "identification"
    OTHER = "other"
    """A FAULT whose node reports no name of this table."""

    def __str__(self) -> str:
        """Return the name alone, in every version of Python."""
        return str(self.value)

    def __format__(self, format_spec: str) -> str:
        """Format as the name."""
        return format(self.value, format_spec)


SENSOR_FAULTS = frozenset(
    {FaultName.SENSOR_INVALID, FaultName.SENSOR_SATURATED, FaultName.SENSOR_FLAT}
)
"""Of the force/torque sensor itself."""

ORDERLY_END = frozenset({FaultName.ENDING, FaultName.RECORDING})
"""Notices after which the supervisor unloads and stops, without a FAULT."""

OVERLOAD = FaultName.SENSOR_SATURATED
"""A load that is beyond the sensor: FREE_MOVING takes it off."""


def fault_name(text: str, in_fault: bool = False) -> FaultName | None:
    """Read a name from a message.

    Args:
        text: field `fault` of a message; empty if nothing is wrong.
        in_fault: whether the message says that there is a fault, whatever its name.

    Returns:
        The name; OTHER for one that is not in the table, or for a fault without one; None for
        nothing.
    """
    if not text:
        return FaultName.OTHER if in_fault else None
    try:
        return FaultName(text)
    except ValueError:
        return FaultName.OTHER


@dataclass(frozen=True)
class Fault:
    """A fault.

    Attributes:
        name: what, for programs.
        reason: what was expected and what came, for people.
        limb: index from 0 of the limb that must not be moved any more; -1 for none in particular.
    """

    name: FaultName
    reason: str
    limb: int = -1

    def __str__(self) -> str:
        """Return the name and the reason, as they stand in the bridge's reports."""
        return f"{self.name}: {self.reason}"
