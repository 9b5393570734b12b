# SPDX-License-Identifier: Apache-2.0
"""What breaks a rig of the generated campaign: one function for each way; pure."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_control.supervision.faults import Fault, FaultName
from cabols_hw.abb.heartbeat import MODE_AGE_S, PERIOD_S, SILENCE_S
from cabols_sim.fault_campaign.in_process.rig import LockstepRig
from cabols_sim.plant.miswiring import Miswiring

WATCH_S = PERIOD_S + SILENCE_S
"""From the last beat that the robot hears until it begins to brake [s]."""
MODE_TIMEOUT_S = 0.5
"""Age of a mode that the limb controller no longer follows [s]; its node has the same."""
Strike = Callable[[LockstepRig, np.random.Generator], None]
Senses = tuple[IntArray, FloatArray, BoolArray]
"""Counts, gauges' voltages, switches' lines: see Plant.sense."""


def _any(random: np.random.Generator, rig: LockstepRig) -> int:
    return int(random.integers(rig.plant.tension.size))


def _highest(rig: LockstepRig) -> int:
    return int(np.argmax(rig.plant.tension))


def _sign(random: np.random.Generator) -> float:
    return float(random.choice([-1.0, 1.0]))


def injected(fault: str, low: float = 0.0, high: float = 0.0, signed: bool = False) -> Strike:
    """Return a strike by a fault of the plant, at any limb, of a size drawn.

    Args:
        fault: kind of cabols_sim.faults.
        low: least size.
        high: largest size; 0: the fault has none.
        signed: whether its sign is drawn, too.
    """

    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        size = random.uniform(low, high) * (_sign(random) if signed else 1.0)
        rig.plant.inject(fault, _any(random, rig), size)

    return strike


def at_highest(fault: str) -> Strike:
    """Return a strike by a fault of the plant, at the limb that pulls most."""

    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        del random
        rig.plant.inject(fault, _highest(rig))

    return strike


def gauge(fault: str) -> Strike:
    """Return a strike at any gauge but the one that drifts."""

    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        rig.plant.inject(fault, value=float(random.integers(1, 6)))

    return strike


def several(fault: str, limbs: Callable[[np.random.Generator, int], IntArray]) -> Strike:
    """Return a strike at several limbs at once, by one cause.

    Args:
        fault: kind of cabols_sim.faults.
        limbs: picks them, from 0, of n limbs.
    """

    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        for i in limbs(random, rig.plant.tension.size):
            rig.plant.inject(fault, int(i))

    return strike


def all_limbs(random: np.random.Generator, n: int) -> IntArray:
    """Return all of n limbs.

    Args:
        random: of the trial.
        n: number of limbs.
    """
    del random
    return np.arange(n)


def two_limbs(random: np.random.Generator, n: int) -> IntArray:
    """Return two of n limbs.

    Args:
        random: of the trial.
        n: number of limbs.
    """
    return random.choice(n, 2, replace=False)


def half(random: np.random.Generator, n: int) -> IntArray:
    """Return the limbs of one of two connectors.

    Args:
        random: of the trial.
        n: number of limbs.
    """
    first = int(random.integers(2)) * (n // 2)
    return np.arange(first, first + n // 2)


def gauges(volts: float | None) -> Strike:
    """Return a strike that fixes all gauges: at a voltage, or (None) where they are."""

    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        del random
        if volts is None:
            for k in range(6):
                rig.plant.inject("gauge_flat", value=float(k))
            return
        sense = rig.plant.sense

        def unplugged() -> Senses:
            counts, gauges, lines = sense()
            gauges[:] = volts
            return counts, gauges, lines

        rig.plant.sense = unplugged  # type: ignore[method-assign]

    return strike


def count_loss(rig: LockstepRig, random: np.random.Generator) -> None:
    """Let an encoder lose or gain counts all the time.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    limb, rate, sense = (
        _any(random, rig),
        _sign(random) * random.uniform(0.02, 0.3),
        rig.plant.sense,
    )
    began_s = rig.now_s

    def drifting() -> Senses:
        counts, gauges, lines = sense()
        counts[limb] += int(1e6 * rate * (rig.now_s - began_s))
        return counts, gauges, lines

    rig.plant.sense = drifting  # type: ignore[method-assign]


def pose(kind: str) -> Strike:
    """Return a strike at the pose on its way."""

    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        sign = _sign(random)
        offset = sign * random.uniform(0.02, 0.3) * np.eye(3)[random.integers(3)]
        axis = np.eye(3)[random.integers(3)] * sign * random.uniform(0.05, 0.6)
        turn = Rotation.from_rotvec(axis).as_matrix()
        kept = rig.robot.position.copy(), rig.robot.rotation.copy()
        began_s = rig.now_s

        def change(
            position: FloatArray, rotation: FloatArray
        ) -> tuple[FloatArray, FloatArray] | None:
            passed_s = rig.now_s - began_s
            if kind == "silent":
                return None
            if kind == "frozen":
                return kept
            if kind == "jumps":
                return position + offset, rotation
            if kind == "turns":
                return position, turn @ rotation
            if kind == "drifts":
                return position + offset * min(passed_s, 1.0), rotation
            return position * np.nan, rotation

        rig.change_pose = change

    return strike


def wrong_current(kind: str) -> Strike:
    """Return a limb controller that commands wrongly."""

    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        limb, sign = _any(random, rig), _sign(random)
        size = random.uniform(1.0, 3.0)

        def change(current: FloatArray) -> FloatArray:
            wrong = current.copy()
            if kind == "one":
                wrong[limb] = sign * size
            elif kind == "all":
                wrong[:] = size
            elif kind == "reversed":
                wrong *= -1.0
            elif kind == "no number":
                wrong[limb] = np.nan
            return wrong

        rig.change_current = change

    return strike


def wrong_tension(size: float, all_limbs: bool) -> Strike:
    """Return a wrench controller that commands wrongly.

    Args:
        size: of the tension that is added [N].
        all_limbs: whether to all limbs, or to one.
    """

    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        limb = _any(random, rig)

        def change(tension: FloatArray) -> FloatArray:
            wrong = np.array(tension)
            wrong[slice(None) if all_limbs else limb] = size
            return wrong

        rig.change_tension = change

    return strike


def limbs_dead(rig: LockstepRig, random: np.random.Generator) -> None:
    """End the limb controller.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    del random
    rig.limb_controller_runs = False


def wrench_dead(rig: LockstepRig, random: np.random.Generator) -> None:
    """End the wrench controller.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    del random
    rig.wrench_controller_runs = False


def robot_bridge_dead(rig: LockstepRig, random: np.random.Generator) -> None:
    """End the robot's bridge: no pose, no path, and nobody tells the robot of a fault.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    pose("silent")(rig, random)
    rig.path, rig.relays = None, False
    rig.robot.stop(WATCH_S)


def supervisor_dead(rig: LockstepRig, random: np.random.Generator) -> None:
    """End the supervisor: the mode that is in force stays, until others find it too old.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    del random
    rig.robot.stop(MODE_AGE_S + WATCH_S)
    silent = Fault(FaultName.MODE_AGE, "the supervisor is silent")
    rig.later = rig.now_s + MODE_TIMEOUT_S, lambda: rig.limbs.trip(silent)


def pose_and_sensor(rig: LockstepRig, random: np.random.Generator) -> None:
    """Freeze the pose and all gauges at once.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    pose("frozen")(rig, random)
    gauges(None)(rig, random)


def no_samples(rig: LockstepRig, random: np.random.Generator) -> None:
    """Let the bridge miss samples: nothing is read, judged or written meanwhile.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    for _ in range(int(random.integers(25, 60))):
        rig.card.read()


def miswired(kind: str) -> Strike:
    """Return a strike that wires two limbs otherwise than the configuration says.

    Args:
        kind: of Miswiring.of.
    """

    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        limb, other = (int(i) for i in random.choice(rig.plant.tension.size, 2, replace=False))
        rig.plant.wiring = Miswiring.of(kind, limb, other)

    return strike
