# SPDX-License-Identifier: Apache-2.0
"""Faults that the bridge finds in its samples, and its reaction to each."""

from __future__ import annotations

from enum import IntEnum

from cabols_control.supervision.faults import Fault, FaultName

AXES = ("x", "y", "z")


class Reaction(IntEnum):
    """The bridge's reaction to a fault; a larger number is a harder one."""

    NONE = 0
    UNLOAD = 1
    """The bridge ramps all trusted limbs down by itself, then zero current."""
    CUT = 2
    """Zero current at once; the gears hold what tension there is."""


class BridgeFault(Fault):
    """A broken rule of the bridge; its name is one of FAULTS."""

    @property
    def reaction(self) -> Reaction:
        """Reaction to the fault."""
        return FAULTS[self.name]

    def told(self) -> Fault:
        """Return the fault as it is reported: with its name before the reason."""
        return Fault(self.name, str(self), self.limb)


def same_kind(one: Fault | None, other: Fault | None) -> bool:
    """Whether both are faults of the same name.

    Args:
        one: a fault, or None.
        other: a fault, or None.
    """
    return one is not None and other is not None and one.name == other.name


FAULTS: dict[FaultName, Reaction] = {
    FaultName.TENSION: Reaction.UNLOAD,
    FaultName.CABLE_SPEED: Reaction.UNLOAD,
    FaultName.WRENCH: Reaction.UNLOAD,
    FaultName.ESTIMATE: Reaction.UNLOAD,
    FaultName.SENSOR_INVALID: Reaction.UNLOAD,
    FaultName.SENSOR_SATURATED: Reaction.UNLOAD,
    FaultName.SENSOR_FLAT: Reaction.UNLOAD,
    FaultName.CABLE: Reaction.UNLOAD,
    FaultName.SWITCH: Reaction.UNLOAD,
    FaultName.POSE: Reaction.UNLOAD,
    FaultName.POSE_SPEED: Reaction.UNLOAD,
    FaultName.POSE_AGE: Reaction.UNLOAD,
    FaultName.ENDING: Reaction.UNLOAD,
    FaultName.CURRENT: Reaction.CUT,
    FaultName.MOTION: Reaction.CUT,
    FaultName.ENCODER: Reaction.CUT,
    FaultName.STATE_AGE: Reaction.CUT,
    FaultName.COMMAND_AGE: Reaction.CUT,
    FaultName.CARD: Reaction.CUT,
    FaultName.FIRST_POWER_ON: Reaction.CUT,
    FaultName.NOT_HELD: Reaction.CUT,
    FaultName.GEAR: Reaction.UNLOAD,
}
"""Every fault that the bridge finds, and its reaction.

Unloading moves the motors by the tension estimates. It is chosen where encoders and motors can be
trusted; cutting is chosen where they cannot, or where the meantime is unknown.
"""

BRAKED: frozenset[FaultName] = frozenset(
    {FaultName.CURRENT, FaultName.ENCODER, FaultName.COMMAND_AGE, FaultName.MOTION}
    | {name for name, reaction in FAULTS.items() if reaction is Reaction.UNLOAD}
)
"""Faults that leave the amplifiers sound: motors that wind in are braked before anything else.
After MOTION only where no motor goes beyond its current; see SafetyEnvelope.driving.

A motor that is cut at 0.1 m/s coasts for v T, which adds 55 to 124 N on the reference bench.
"""

DOUBTING: frozenset[FaultName] = frozenset({FaultName.MOTION, FaultName.ENCODER, FaultName.CURRENT})
"""Faults after which a motor may do other than its encoder and its current say."""

POSE_LOST: frozenset[FaultName] = frozenset(
    {FaultName.POSE, FaultName.POSE_SPEED, FaultName.POSE_AGE}
)
"""Faults after which the platform may move without a pose: the limbs give way by their switches."""
NOT_HELD = (
    "nothing but the cables holds the platform (platform_held of safety.yaml): it would fall with "
    "the amplifiers off, so that nothing moves. Let a robot or a stand hold it and set "
    "platform_held, or meet what docs/safety.md asks of a platform that hangs"
)
"""What the bridge says of a platform that hangs on its cables."""
FOLLOWED: frozenset[FaultName] = frozenset(
    {FaultName.COMMAND_AGE, FaultName.MOTION, FaultName.CURRENT, FaultName.ENCODER}
)
"""Faults that are cut, but after which the limbs give way to a robot that may still move."""
