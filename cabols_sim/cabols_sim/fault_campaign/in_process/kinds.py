# SPDX-License-Identifier: Apache-2.0
"""Kinds of the generated campaign: each state of the rig, broken in every way that it has; pure."""

from __future__ import annotations

from dataclasses import dataclass

from cabols_sim.fault_campaign.in_process.strikes import (
    Strike,
    all_limbs,
    at_highest,
    count_loss,
    gauge,
    gauges,
    half,
    injected,
    limbs_dead,
    miswired,
    no_samples,
    pose,
    pose_and_sensor,
    robot_bridge_dead,
    several,
    supervisor_dead,
    two_limbs,
    wrench_dead,
    wrong_current,
    wrong_tension,
)

SOON_S, SENSOR_S, LATE_S, SEARCH_S, WIRED_S = 0.05, 0.25, 2.0, 4.0, 12.0
"""Bounds of detection [s]: at once, within a flat gauge's time and more, once it matters, within a
search for the switches, and until a load stands after one."""


@dataclass(frozen=True)
class Disturbance:
    """One way in which a rig breaks.

    Attributes:
        name: for the table.
        strike: does it.
        within_s: longest time to a report of a fault [s].
        latent: states in which nothing depends on it: there only the bounds hold.
        amplifier: whether an amplifier itself drives: then no current stops the motor.
        held: whether a motor cannot turn: then a cable is stretched until the robot stands.
    """

    name: str
    strike: Strike
    within_s: float
    latent: frozenset[str] = frozenset()
    amplifier: bool = False
    held: bool = False


RESTS = frozenset({"loading", "free"})
ZEROING = frozenset({"pretightening"})
SLACK = ZEROING | {"started"}
FREE = frozenset({"free", "robot moves"})
LIGHT = FREE | SLACK | frozenset({"loading"})
EVERY = LIGHT | RESTS | ZEROING
"""States in which nothing depends on a fault: at rest a frozen count is a right one, without zeros
no limb goes by pose or counts, only LOADING goes by tension commands. And 140 N on all limbs are
within the envelope: whether a load is the one that was asked for, the bridge does not know. A
cable that pulls no more than closes its switch may break unseen: the others hold what it held."""

DISTURBANCES = (
    Disturbance("cable breaks", at_highest("cable_break"), SENSOR_S, FREE | SLACK),
    Disturbance("any cable breaks", injected("cable_break"), LATE_S, RESTS | FREE | SLACK),
    Disturbance("switch stuck open", at_highest("switch_open"), SENSOR_S, FREE | SLACK),
    Disturbance("switch stuck closed", injected("switch_closed"), LATE_S, RESTS | FREE | ZEROING),
    Disturbance("all switches read open", several("switch_open", all_limbs), SEARCH_S, FREE),
    Disturbance(
        "all switches read closed",
        several("switch_closed", all_limbs),
        LATE_S,
        RESTS | FREE | ZEROING,
    ),
    Disturbance("half of the switches read open", several("switch_open", half), SEARCH_S, FREE),
    Disturbance(
        "half of the switches read closed",
        several("switch_closed", half),
        LATE_S,
        RESTS | FREE | ZEROING,
    ),
    Disturbance("encoder jumps", injected("encoder_jump", 0.003, 0.02, True), SOON_S),
    Disturbance("encoder frozen", injected("encoder_frozen"), LATE_S, RESTS),
    Disturbance("encoder loses counts", count_loss, SEARCH_S, frozenset({"started"})),
    Disturbance("encoders of a connector frozen", several("encoder_frozen", half), LATE_S, RESTS),
    Disturbance(
        "encoder of the highest frozen", at_highest("encoder_frozen"), LATE_S, RESTS | SLACK
    ),
    Disturbance("two encoders frozen", several("encoder_frozen", two_limbs), LATE_S, RESTS),
    Disturbance("two cables break", several("cable_break", two_limbs), LATE_S, LIGHT),
    Disturbance("two switches stuck open", several("switch_open", two_limbs), SEARCH_S, LIGHT),
    Disturbance(
        "motor of the highest jams", at_highest("motor_jam"), LATE_S, RESTS | SLACK, held=True
    ),
    Disturbance("motor jams", injected("motor_jam"), LATE_S, RESTS, held=True),
    Disturbance("two motors jam", several("motor_jam", two_limbs), LATE_S, RESTS, held=True),
    Disturbance(
        "amplifiers' supply lost", several("motor_jam", all_limbs), LATE_S, RESTS, held=True
    ),
    Disturbance(
        "amplifier offset", injected("amplifier_offset", 0.5, 2.0, True), SOON_S, amplifier=True
    ),
    Disturbance(
        "amplifier offset, larger",
        injected("amplifier_offset", 2.0, 4.9, True),
        SOON_S,
        amplifier=True,
    ),
    Disturbance(
        "amplifier delivers all", injected("amplifier_offset", 6.0, 7.0), SOON_S, amplifier=True
    ),
    Disturbance(
        "two amplifiers offset", several("amplifier_offset", two_limbs), SOON_S, amplifier=True
    ),
    Disturbance("gauge flat", gauge("gauge_flat"), SENSOR_S),
    Disturbance("gauge not a number", gauge("gauge_nan"), SOON_S),
    Disturbance("gauge saturated", gauge("gauge_saturated"), SOON_S),
    Disturbance("gauge drifts", injected("gauge_drift", 2.0, 10.0, True), SEARCH_S),
    Disturbance("all gauges flat", gauges(None), SENSOR_S),
    Disturbance("sensor unplugged, reads 0 V", gauges(0.0), SENSOR_S),
    Disturbance("sensor unplugged, reads 10 V", gauges(10.0), SOON_S),
    Disturbance("pose silent", pose("silent"), SENSOR_S),
    Disturbance("pose frozen", pose("frozen"), LATE_S, RESTS | SLACK),
    Disturbance("pose jumps", pose("jumps"), SOON_S),
    Disturbance("pose turns", pose("turns"), SOON_S),
    Disturbance("pose drifts", pose("drifts"), LATE_S, frozenset({"started"})),
    Disturbance("pose not a number", pose("no number"), SENSOR_S),
    Disturbance("pose and sensor frozen", pose_and_sensor, SENSOR_S),
    Disturbance("wrong current, one limb", wrong_current("one"), LATE_S),
    Disturbance("wrong current, all limbs", wrong_current("all"), LATE_S),
    Disturbance("currents reversed", wrong_current("reversed"), LATE_S),
    Disturbance("current not a number", wrong_current("no number"), SOON_S),
    Disturbance("wrong tension, one limb", wrong_tension(145.0, False), LATE_S, FREE | SLACK),
    Disturbance(
        "wrong tension, all limbs", wrong_tension(140.0, True), LATE_S, FREE | SLACK | RESTS
    ),
    Disturbance("limb controller dead", limbs_dead, SOON_S),
    Disturbance("wrench controller dead", wrench_dead, LATE_S, FREE | SLACK | RESTS),
    Disturbance("robot's bridge dead", robot_bridge_dead, SENSOR_S),
    Disturbance("supervisor dead", supervisor_dead, LATE_S, EVERY),
    Disturbance("samples missing", no_samples, SOON_S + 0.06),
)
"""Every way; each meets each state below."""

MOVED = {"path under load": ("encoders of a connector frozen", "amplifiers' supply lost")}
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
        moves = self.state in ROBOT_MOVES
        return moves and (self.disturbance.held or self.disturbance.amplifier)

    @property
    def blind(self) -> bool:
        """Whether an encoder is not its motor's: no motor can be braked by it, and all are off."""
        name = self.disturbance.name
        return self.state == WIRED and ("motor" in name or "encoder" in name)

    @property
    def latent(self) -> bool:
        """Whether only the bounds hold, as nothing depends on it yet."""
        name = self.disturbance.name
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
