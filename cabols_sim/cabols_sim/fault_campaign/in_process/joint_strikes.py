# SPDX-License-Identifier: Apache-2.0
"""What breaks together, amplifiers, mechanics, and processes that come back; pure."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from cabols_control.limb_control.controller import LimbController
from cabols_control.supervision.modes import OperatingMode
from cabols_control.wrench_control.controller import WrenchController
from cabols_sim.fault_campaign.in_process.rig import LockstepRig
from cabols_sim.fault_campaign.in_process.strikes import WATCH_S, Strike

ASKED_N = 60.0
"""Load that is asked for anew [N]."""
BACK_S = (0.02, 0.4)
"""After which a process that has ended runs again [s]."""


def together(*strikes: Strike) -> Strike:
    """Return several strikes at once.

    Args:
        strikes: of them.
    """

    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        for one in strikes:
            one(rig, random)

    return strike


def one_limb(*faults: str) -> Strike:
    """Return several faults of the plant at the limb that pulls most.

    Args:
        faults: kinds of cabols_sim.faults.
    """

    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        del random
        limb = int(np.argmax(rig.plant.tension))
        for fault in faults:
            rig.plant.inject(fault, limb)

    return strike


def asks_anew(rig: LockstepRig, random: np.random.Generator) -> None:
    """Ask for another load, as a programme does: in LOADING currents flow then.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    direction = random.normal(size=3)
    rig.desired[:3] = ASKED_N * direction / np.linalg.norm(direction)


def stands_and_drives(low: float, high: float) -> Strike:
    """Return an encoder that stands still at an amplifier that adds a current of its own.

    Args:
        low: least current [A].
        high: largest current [A].
    """

    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        limb = int(random.integers(rig.rig.geometry.cables))
        rig.plant.inject("encoder_frozen", limb)
        rig.plant.inject("amplifier_offset", limb, random.uniform(low, high))

    return strike


def amplifier(
    fault: Callable[[LockstepRig, np.random.Generator, float], Callable[[float], float]],
) -> Strike:
    """Return an amplifier that gives another current than it is told.

    Args:
        fault: draws what becomes of a current, by the present one [A].
    """

    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        limb, right = int(random.integers(rig.plant.tension.size)), rig.plant.drive
        change = fault(rig, random, float(rig.plant.current[limb]))

        def drive(volts: np.ndarray) -> None:
            right(volts)
            rig.plant._current[limb] = change(float(rig.plant._current[limb]))

        rig.plant.drive = drive  # type: ignore[method-assign]

    return strike


def outputs_frozen(rig: LockstepRig, random: np.random.Generator) -> None:
    """Let the card's outputs stay as they are.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    del random
    rig.plant.drive = lambda _: None  # type: ignore[method-assign, assignment]


def snags(rig: LockstepRig, random: np.random.Generator) -> None:
    """Let something pull at a cable: it is shorter at once.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    rig.plant._rest[random.integers(rig.plant.tension.size)] -= random.uniform(0.002, 0.012)


def _back_later(rig: LockstepRig, runs: str, random: np.random.Generator) -> None:
    """Let a controller stand still until a drawn time; runs: the flag of the rig that says so."""
    setattr(rig, runs, False)
    rig.later = rig.now_s + random.uniform(*BACK_S), partial(setattr, rig, runs, True)


def limbs_back(rig: LockstepRig, random: np.random.Generator) -> None:
    """End the limb controller; another one starts.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    rig.limbs = LimbController(rig.rig)
    _back_later(rig, "limb_controller_runs", random)


def wrench_back(rig: LockstepRig, random: np.random.Generator) -> None:
    """End the wrench controller; another one starts.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    rig.wrenches = WrenchController(rig.rig)
    _back_later(rig, "wrench_controller_runs", random)


def bridge_back(mode: OperatingMode | None, bias_kept: bool) -> Strike:
    """Return an end of the bridge; another one starts, in STOPPED, then a mode is asked for.

    Args:
        mode: that is asked for; None: the rig stays in STOPPED.
        bias_kept: whether the sensor's bias lies on the disk.
    """

    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        bias = rig.bridge.sensor_tare.proven if bias_kept else None
        rig.robot.stop(WATCH_S)
        for _ in range(round(1e3 * random.uniform(*BACK_S))):
            rig.card.read()
        rig.start_again(bias)
        rig.card.clear_watchdog()
        if mode is not None:

            def ask() -> None:
                if rig.guard.fault is None:
                    rig.mode = mode

            rig.later = rig.now_s + 0.4, ask

    return strike
