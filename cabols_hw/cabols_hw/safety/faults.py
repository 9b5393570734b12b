"""The faults that the bridge finds, by name, and what it does about each."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

AXES = ("x", "y", "z")


class Reaction(IntEnum):
    """What the bridge does about a fault; the larger, the harder."""

    NONE = 0
    UNLOAD = 1
    """Ramp all trusted limbs down by itself, then zero current."""
    CUT = 2
    """Zero current at once; the gears hold what tension there is."""


@dataclass(frozen=True)
class Fault:
    """A broken rule.

    Attributes:
        name: one of FAULTS, for diagnostics and tables.
        reason: what was expected and what came.
        limb: which limb must not be moved any more; -1 for none in particular.
    """

    name: str
    reason: str
    limb: int = -1

    @property
    def reaction(self) -> Reaction:
        """What is done about it."""
        return FAULTS[self.name]

    def __str__(self) -> str:
        """Return the name and the reason, as they stand in `loop_status` and `mode`."""
        return f"{self.name}: {self.reason}"


def same_kind(one: Fault | None, other: Fault | None) -> bool:
    """Whether both are faults of the same name."""
    return one is not None and other is not None and one.name == other.name


FAULTS: dict[str, Reaction] = {
    "tension": Reaction.UNLOAD,
    "wrench": Reaction.UNLOAD,
    "estimate": Reaction.UNLOAD,
    "sensor_invalid": Reaction.UNLOAD,
    "sensor_saturated": Reaction.UNLOAD,
    "sensor_flat": Reaction.UNLOAD,
    "cable": Reaction.UNLOAD,
    "switch": Reaction.UNLOAD,
    "pose": Reaction.UNLOAD,
    "pose_speed": Reaction.UNLOAD,
    "pose_age": Reaction.UNLOAD,
    "current": Reaction.CUT,
    "motion": Reaction.CUT,
    "encoder": Reaction.CUT,
    "state_age": Reaction.CUT,
    "command_age": Reaction.CUT,
    "card": Reaction.CUT,
}
"""Every fault that the bridge finds, and its reaction.

Unloading moves the motors by the tension estimates: it is chosen where encoders and motors can be
trusted, and cutting where they cannot, or where nobody knows what has happened in the meantime.
"""
