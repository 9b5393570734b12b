# SPDX-License-Identifier: Apache-2.0
"""Every way in which a rig of the generated campaign breaks, and until when it shows; pure."""

from __future__ import annotations

from dataclasses import dataclass

from cabols_control.supervision.modes import OperatingMode
from cabols_sim.fault_campaign.in_process.controller_strikes import (
    currents,
    felt_wrench,
    late,
    noisy,
    one_reversed,
    rising,
    scaled,
    shifted,
    stuck,
    swinging,
    tensions,
)
from cabols_sim.fault_campaign.in_process.joint_strikes import (
    amplifier,
    asks_anew,
    bridge_back,
    limbs_back,
    one_limb,
    outputs_frozen,
    snags,
    stands_and_drives,
    together,
    wrench_back,
)
from cabols_sim.fault_campaign.in_process.signal_strikes import (
    card_frozen,
    digital_frozen,
    encoder_bit,
    encoder_noise,
    gauges_late,
    gauges_stuck,
    gauges_times,
    inputs_late,
    pose_creeps,
    pose_in_millimetres,
    pose_noisy,
    pose_turns_slowly,
    poses,
    senses,
    switches_inverted,
)
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
PATIENCE_S = 2.5
"""Bound for what grows slowly until it matters: the longest trial but for searches [s]."""


@dataclass(frozen=True)
class Disturbance:
    """One way in which a rig breaks.

    Attributes:
        name: for the table.
        strike: does it.
        within_s: longest time to a report of a fault [s].
        latent: states in which nothing depends on it: there only the bounds hold.
        amplifier: whether an amplifier itself drives: then no current stops the motor.
        held: whether a motor cannot turn, or no limb can know that it pulls: then a cable is
            stretched until the robot stands.
        uncounted: whether a motor may turn that no encoder counts. It may be its amplifier that
            drives it: all are switched off, and coast, and give way to no robot.
        pair: whether it is two others: only the bounds of tension and wrench hold.
    """

    name: str
    strike: Strike
    within_s: float
    latent: frozenset[str] = frozenset()
    amplifier: bool = False
    held: bool = False
    uncounted: bool = False
    pair: bool = False


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

BROKEN = (
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
    Disturbance("encoder frozen", injected("encoder_frozen"), LATE_S, RESTS, uncounted=True),
    Disturbance("encoder loses counts", count_loss, SEARCH_S, frozenset({"started"})),
    Disturbance(
        "encoders of a connector frozen",
        several("encoder_frozen", half),
        LATE_S,
        RESTS,
        uncounted=True,
    ),
    Disturbance(
        "encoder of the highest frozen",
        at_highest("encoder_frozen"),
        LATE_S,
        RESTS | SLACK,
        uncounted=True,
    ),
    Disturbance(
        "two encoders frozen", several("encoder_frozen", two_limbs), LATE_S, RESTS, uncounted=True
    ),
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
    Disturbance("limb controller dead", limbs_dead, SOON_S),
    Disturbance("wrench controller dead", wrench_dead, LATE_S, FREE | SLACK | RESTS),
    Disturbance("robot's bridge dead", robot_bridge_dead, SENSOR_S),
    Disturbance("supervisor dead", supervisor_dead, LATE_S, EVERY),
    Disturbance("samples missing", no_samples, SOON_S + 0.06),
)
"""What breaks by itself, and processes that end."""

STOPPED = OperatingMode.STOPPED
PRETIGHTENING, FREE_MOVING = OperatingMode.PRETIGHTENING, OperatingMode.FREE_MOVING
WRONG = (
    Disturbance("wrong current, one limb", wrong_current("one"), LATE_S),
    Disturbance("wrong current, all limbs", wrong_current("all"), LATE_S),
    Disturbance("currents reversed", wrong_current("reversed"), LATE_S),
    Disturbance("current not a number", wrong_current("no number"), SOON_S),
    Disturbance("wrong tension, one limb", wrong_tension(145.0, False), LATE_S, FREE | SLACK),
    Disturbance(
        "wrong tension, all limbs", wrong_tension(140.0, True), LATE_S, FREE | SLACK | RESTS
    ),
    Disturbance("currents noisy", currents(noisy(0.2, 2.0)), LATE_S, EVERY),
    Disturbance("currents late", currents(late(5, 40)), LATE_S, EVERY),
    Disturbance("currents stuck", currents(stuck), LATE_S, EVERY),
    Disturbance(
        "current reversed, one limb",
        together(currents(one_reversed), asks_anew),
        LATE_S,
        FREE | RESTS,
    ),
    Disturbance("currents in other units", currents(scaled(1e3, 1e-3, 9.81)), LATE_S, EVERY),
    Disturbance("currents of other limbs", currents(shifted), LATE_S, RESTS),
    Disturbance("currents swing", currents(swinging(1.0, 3.0, 3.0, 50.0)), LATE_S, EVERY),
    Disturbance("currents rise", currents(rising(0.1, 3.0)), LATE_S, EVERY),
    Disturbance("tensions noisy", tensions(noisy(5.0, 60.0)), LATE_S, EVERY),
    Disturbance("tensions late", tensions(late(10, 100)), LATE_S, EVERY),
    Disturbance("tensions stuck", tensions(stuck), LATE_S, EVERY),
    Disturbance("tension reversed, one limb", tensions(one_reversed), LATE_S, EVERY),
    Disturbance("tensions in other units", tensions(scaled(4.448, 9.81, 1e3, 0.1)), LATE_S, EVERY),
    Disturbance("tensions of other limbs", tensions(shifted), LATE_S, EVERY),
    Disturbance("tensions swing", tensions(swinging(20.0, 130.0, 0.5, 50.0)), LATE_S, EVERY),
    Disturbance("tensions rise", tensions(rising(20.0, 500.0)), LATE_S, EVERY),
    Disturbance("wrench felt reversed", felt_wrench(scaled(-1.0)), LATE_S, FREE | SLACK),
    Disturbance("wrench felt as nothing", felt_wrench(scaled(0.0)), LATE_S, FREE | SLACK),
    Disturbance("wrench felt late", felt_wrench(late(20, 100)), LATE_S, EVERY),
    Disturbance("wrench felt in other units", felt_wrench(scaled(4.448, 9.81)), LATE_S, EVERY),
)
"""Controllers that go wrong. Where what they do stays within the envelope, only the bounds hold."""

SIGNALS = (
    Disturbance("all inputs frozen", senses(card_frozen), SENSOR_S, uncounted=True),
    Disturbance(
        "encoders and switches frozen", senses(digital_frozen), LATE_S, RESTS, uncounted=True
    ),
    Disturbance("all inputs late", senses(inputs_late), LATE_S, RESTS),
    Disturbance("a bit of an encoder stuck", senses(encoder_bit), LATE_S, EVERY),
    Disturbance("encoder noisy", senses(encoder_noise), SOON_S),
    Disturbance("gauges of another supply", senses(gauges_times(0.5, 1.5)), SENSOR_S, EVERY),
    Disturbance("gauges late", senses(gauges_late), SENSOR_S),
    Disturbance("gauges stuck, with noise", senses(gauges_stuck), LATE_S, EVERY),
    Disturbance("switches inverted", senses(switches_inverted), LATE_S, FREE | SLACK),
    Disturbance("pose noisy", poses(pose_noisy), LATE_S, FREE | SLACK),
    Disturbance("pose in millimetres", poses(pose_in_millimetres), SOON_S),
    Disturbance("pose creeps", poses(pose_creeps), PATIENCE_S, SLACK),
    Disturbance("pose turns slowly", poses(pose_turns_slowly), PATIENCE_S, SLACK),
)
"""Signals that go wrong without an end of their own."""

JOINT = (
    Disturbance(
        "encoder and switch frozen",
        one_limb("encoder_frozen", "switch_closed"),
        LATE_S,
        LIGHT,
        uncounted=True,
    ),
    Disturbance(
        "cable breaks, its switch closed", one_limb("cable_break", "switch_closed"), LATE_S, LIGHT
    ),
    Disturbance("both controllers dead", together(limbs_dead, wrench_dead), SOON_S),
    Disturbance("a computer dead", together(limbs_dead, robot_bridge_dead), SOON_S),
    Disturbance(
        "supervisor and robot's bridge dead", together(supervisor_dead, robot_bridge_dead), SENSOR_S
    ),
    Disturbance(
        "pose silent, all switches open",
        together(pose("silent"), several("switch_open", all_limbs)),
        SENSOR_S,
        held=True,
    ),
    Disturbance(
        "pose silent, motor jams",
        together(pose("silent"), at_highest("motor_jam")),
        SENSOR_S,
        held=True,
    ),
    Disturbance(
        "amplifier offset, gauges late",
        together(injected("amplifier_offset", 0.5, 2.0), senses(gauges_late)),
        SOON_S,
        amplifier=True,
    ),
    Disturbance(
        "gauges stuck, wrong current, all limbs",
        together(senses(gauges_stuck), wrong_current("all")),
        LATE_S,
    ),
    Disturbance(
        "gauges stuck, wrong current, one limb",
        together(senses(gauges_stuck), wrong_current("one")),
        LATE_S,
    ),
    Disturbance(
        "gauges stuck, wrong tension, all limbs",
        together(senses(gauges_stuck), wrong_tension(140.0, True)),
        LATE_S,
        FREE | SLACK | RESTS,
    ),
    Disturbance(
        "encoder stands, its amplifier offset",
        stands_and_drives(0.5, 1.2),
        SENSOR_S,
        amplifier=True,
    ),
    Disturbance(
        "amplifier reversed",
        amplifier(lambda *_: lambda current: -current),
        LATE_S,
        RESTS,
        amplifier=True,
    ),
    Disturbance(
        "amplifier winds in alone",
        amplifier(lambda *_: lambda current: max(current, 0.0)),
        LATE_S,
        EVERY,
        amplifier=True,
    ),
    Disturbance(
        "amplifier stuck",
        amplifier(lambda _rig, _random, now: lambda _: now),
        LATE_S,
        EVERY,
        amplifier=True,
    ),
    Disturbance("outputs frozen", outputs_frozen, LATE_S, RESTS, amplifier=True),
    Disturbance("something pulls at a cable", snags, LATE_S, EVERY),
    Disturbance("limb controller starts again", limbs_back, SOON_S),
    Disturbance("wrench controller starts again", wrench_back, LATE_S, EVERY),
    Disturbance("bridge starts again", bridge_back(STOPPED, True), LATE_S, EVERY),
    Disturbance("bridge starts again without a bias", bridge_back(STOPPED, False), LATE_S, EVERY),
    Disturbance(
        "bridge starts again, then PRETIGHTENING", bridge_back(PRETIGHTENING, True), LATE_S, EVERY
    ),
    Disturbance(
        "bridge starts again, then FREE_MOVING", bridge_back(FREE_MOVING, False), LATE_S, EVERY
    ),
)
"""What breaks together, amplifiers, mechanics, and processes that come back."""
