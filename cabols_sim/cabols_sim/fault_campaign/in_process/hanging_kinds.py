# SPDX-License-Identifier: Apache-2.0
"""What breaks a rig whose platform hangs on its cables; pure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.supervision.modes import OperatingMode
from cabols_sim.fault_campaign.in_process.hanging_rig import HangingRig
from cabols_sim.fault_campaign.in_process.strikes import (
    count_loss,
    injected,
    limbs_dead,
    no_samples,
    wrench_dead,
    wrong_current,
    wrong_tension,
)

STATES = ("hangs", "rises", "stopped", "after a stop")
"""It hangs under a small wrench; is on its way up; hangs on its gears; likewise, just stopped."""
WEAK_A, WEAK_A_PER_N = 0.004, 6e-4
"""A gear that gives way: friction, and what a pull takes through it."""
HangingStrike = Callable[[HangingRig, np.random.Generator], None]


@dataclass(frozen=True)
class HangingKind:
    """One way in which it breaks.

    Attributes:
        name: for the table.
        strike: does it.
        states: in which it is tried.
        found: whether it must be reported.
        falls: whether nothing but the net, or other cables, ends what follows.
    """

    name: str
    strike: HangingStrike
    states: tuple[str, ...] = STATES
    found: bool = False
    falls: bool = False


MOVING = ("hangs", "rises")


def supply_lost(rig: HangingRig, random: np.random.Generator) -> None:
    """Let no motor get a current any more.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    del random
    drive = rig.plant.drive

    def silent(volts: FloatArray) -> None:
        drive(np.zeros_like(volts))

    rig.plant.drive = silent  # type: ignore[method-assign]


def stop_pressed(rig: HangingRig, random: np.random.Generator) -> None:
    """Press the stop.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    del random
    rig.guard.press_stop()
    rig.mode = OperatingMode.FAULT


def weak_gear(rig: HangingRig, random: np.random.Generator) -> None:
    """Let a gear wear out after its proof, and press the stop.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    weaken(rig, int(np.argmax(rig.plant.tension)))
    stop_pressed(rig, random)


def weaken(rig: HangingRig, limb: int) -> None:
    """Let a gear be weaker than its file says.

    Args:
        rig: with the gear.
        limb: from 0.
    """
    parameters = rig.plant._parameters = rig.plant._parameters.copy()
    parameters["coulomb_current"][limb] = WEAK_A
    parameters["load_current"][limb] = WEAK_A_PER_N


def after(first: HangingStrike, then: HangingStrike) -> HangingStrike:
    """Return two strikes, the second 20 to 200 ms after the first.

    Args:
        first: strike.
        then: strike.
    """

    def strike(rig: HangingRig, random: np.random.Generator) -> None:
        first(rig, random)
        rig.run(random.uniform(0.02, 0.2))
        then(rig, random)

    return strike


def of_plant(
    fault: str, low: float = 0.0, high: float = 0.0, signed: bool = False
) -> HangingStrike:
    """Return a strike of the plant; see strikes.injected.

    Args:
        fault: kind of cabols_sim.faults.
        low: least size.
        high: largest size.
        signed: whether its sign is drawn.
    """
    return injected(fault, low, high, signed)


HANGING_KINDS = (
    HangingKind("supply lost", supply_lost),
    HangingKind("stop pressed", stop_pressed, MOVING),
    HangingKind("limb controller ends", limbs_dead, MOVING, found=True),
    HangingKind("wrench controller ends", wrench_dead, MOVING),
    HangingKind("samples missing", no_samples, MOVING, found=True),
    HangingKind("encoder jumps", of_plant("encoder_jump", 0.002, 0.03, True), MOVING, found=True),
    HangingKind("encoder stands", of_plant("encoder_frozen"), MOVING),
    HangingKind("counts lost or gained", count_loss, MOVING, found=True),
    HangingKind("cable slips a little", of_plant("cable_slip", 0.001, 0.004)),
    HangingKind("cable slips", of_plant("cable_slip", 0.03, 0.06), MOVING, found=True, falls=True),
    HangingKind("cable breaks", of_plant("cable_break"), STATES, falls=True),
    HangingKind("switch stuck open", of_plant("switch_open"), MOVING, found=True),
    HangingKind("switch stuck closed", of_plant("switch_closed")),
    HangingKind("motor jammed", of_plant("motor_jam"), MOVING),
    HangingKind("amplifier adds current", of_plant("amplifier_offset", 0.5, 4.0, True), MOVING),
    HangingKind("wrong current of one limb", wrong_current("one"), MOVING, found=True),
    HangingKind("wrong currents", wrong_current("all"), MOVING, found=True),
    HangingKind("currents reversed", wrong_current("reversed"), MOVING),
    HangingKind("wrong tension of one limb", wrong_tension(75.0, False), MOVING, found=True),
    HangingKind("wrong tensions", wrong_tension(75.0, True), MOVING, found=True),
    HangingKind("no tensions", wrong_tension(0.0, True), MOVING, found=True),
    HangingKind("gear weakens after its proof", weak_gear, MOVING, falls=True),
    HangingKind(
        "cable breaks after a stop",
        after(stop_pressed, of_plant("cable_break")),
        MOVING,
        falls=True,
    ),
    HangingKind(
        "second cable breaks",
        after(of_plant("cable_break"), of_plant("cable_break")),
        MOVING,
        falls=True,
    ),
    HangingKind(
        "encoder jumps, then supply lost",
        after(of_plant("encoder_jump", 0.005, 0.02, True), supply_lost),
        MOVING,
        found=True,
    ),
)
"""Kinds of trials. A jammed motor, a frozen encoder or a lost supply change nothing while the
platform hangs still."""
