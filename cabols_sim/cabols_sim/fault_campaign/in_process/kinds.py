# SPDX-License-Identifier: Apache-2.0
"""Kinds of the generated campaign: each state of the rig, broken in every way that it has; pure."""

from __future__ import annotations

from dataclasses import dataclass

from cabols_sim.fault_campaign.in_process.disturbances import (
    BROKEN,
    JOINT,
    SIGNALS,
    WIRED_S,
    WRONG,
    Disturbance,
)
from cabols_sim.fault_campaign.in_process.pairs import two_of
from cabols_sim.fault_campaign.in_process.strikes import miswired

SINGLES = (*BROKEN, *WRONG, *SIGNALS)
DISTURBANCES = (*SINGLES, *JOINT, two_of(SINGLES, WRONG))
"""Every way; each meets each state below."""

MOVED = {
    "path under load": (
        "encoders of a connector frozen",
        "amplifiers' supply lost",
        "current reversed, one limb",
    )
}
"""What shows where the platform moves, though not where it stands."""
HARDER = frozenset(
    {
        "encoder jumps",
        "encoder of the highest frozen",
        "encoders of a connector frozen",
        "motor of the highest jams",
        "amplifiers' supply lost",
        "amplifier offset",
        "amplifier offset, larger",
        "amplifier delivers all",
        "two amplifiers offset",
        "samples missing",
    }
)
"""Whose reaction is a harder one than unloading, and which show while limbs are unloaded: they must
be found also while the bridge unloads for another fault's sake."""
SENSED = frozenset(
    {
        "gauge flat",
        "gauge not a number",
        "gauge saturated",
        "all gauges flat",
        "sensor unplugged, reads 0 V",
        "sensor unplugged, reads 10 V",
        "pose and sensor frozen",
    }
)
"""What is judged in STOPPED, where nothing moves: the sensor alone."""

WIRINGS = tuple(
    Disturbance(name.replace("_", " "), miswired(name), WIRED_S, frozenset(latent))
    for name, latent in (
        ("motors_exchanged", ()),
        ("encoders_exchanged", ()),
        ("switches_exchanged", ()),
        ("channels_exchanged", ()),
        ("motor_reversed", ()),
        ("encoder_reversed", ()),
        ("both_reversed", ()),
        ("motor_dead", ()),
        ("encoder_dead", ()),
        ("gauges_exchanged", ()),
        ("gauges_reversed", ()),
    )
)
"""Wrong wirings of a rig whose check at first power-on was left out; with it nothing would move."""

STATES = (
    "started",
    "pretightening",
    "loading",
    "free",
    "robot moves",
    "path under load",
    "second fault",
    "stopped",
)
"""FREE_MOVING without zeros; the search for zeros; 100 N; FREE_MOVING at rest; FREE_MOVING while
the robot moves at 60 mm/s; 60 N while the robot follows a path at 20 to 40 mm/s; 100 N while the
bridge unloads, because the pose is silent; STOPPED with 100 N on the gears after a cut."""
ROBOT_MOVES = ("robot moves", "path under load")
WIRED = "wired wrongly"
"""PRETIGHTENING, then a load, of a rig that is wired otherwise than its files say."""


@dataclass(frozen=True)
class GeneratedKind:
    """A state and what breaks in it.

    Attributes:
        state: one of STATES.
        disturbance: what breaks.
    """

    state: str
    disturbance: Disturbance

    @property
    def name(self) -> str:
        """For the table."""
        return f"{self.state}: {self.disturbance.name}"

    @property
    def by_robot(self) -> bool:
        """Whether a motor that cannot give way meets a robot that moves: it has to brake first."""
        how = self.disturbance
        return self.state in ROBOT_MOVES and (how.held or how.amplifier or how.uncounted)

    @property
    def blind(self) -> bool:
        """Whether an encoder is not its motor's: no motor can be braked by it, and all are off."""
        name = self.disturbance.name
        miswired = self.state == WIRED and ("motor" in name or "encoder" in name)
        return miswired or (self.disturbance.uncounted and self.state not in ROBOT_MOVES)

    @property
    def latent(self) -> bool:
        """Whether only the bounds hold, as nothing depends on it yet."""
        name = self.disturbance.name
        if self.disturbance.pair:
            return True
        if self.state == "second fault":
            return name not in HARDER
        if self.state == "stopped":
            return name not in SENSED
        state = "loading" if self.state == "path under load" else self.state
        return state in self.disturbance.latent and name not in MOVED.get(self.state, ())


def generated_kinds() -> list[GeneratedKind]:
    """Return every state with every disturbance, and the wrong wirings."""
    kinds = [GeneratedKind(state, way) for state in STATES for way in DISTURBANCES]
    return kinds + [GeneratedKind(WIRED, way) for way in WIRINGS]
