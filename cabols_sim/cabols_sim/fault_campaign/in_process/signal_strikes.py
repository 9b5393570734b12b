# SPDX-License-Identifier: Apache-2.0
"""Signals of the card, and poses, that go wrong in ways that no fault of the plant has; pure."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_sim.fault_campaign.in_process.rig import LockstepRig
from cabols_sim.fault_campaign.in_process.strikes import Senses, Strike

Change = Callable[[IntArray, FloatArray, BoolArray], Senses]
PoseChange = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]

STUCK_V = 0.001
"""Noise of a gauge that tells nothing any more [V]."""


def senses(fault: Callable[[LockstepRig, np.random.Generator], Change]) -> Strike:
    """Return a strike at what the card reads.

    Args:
        fault: draws what becomes of counts (n,), gauges (6,) [V] and switches' lines (n,).
    """

    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        right, change = rig.plant.sense, fault(rig, random)
        rig.plant.sense = lambda: change(*right())  # type: ignore[method-assign]

    return strike


def poses(fault: Callable[[LockstepRig, np.random.Generator], PoseChange]) -> Strike:
    """Return a strike at the pose on its way.

    Args:
        fault: draws what becomes of position (3,) [m] and rotation (3, 3).
    """

    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        rig.change_pose = fault(rig, random)

    return strike


def card_frozen(rig: LockstepRig, random: np.random.Generator) -> Change:
    """Read the same for ever: all that the card has.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    del rig, random
    kept: list[Senses] = []

    def change(counts: IntArray, volts: FloatArray, lines: BoolArray) -> Senses:
        if not kept:
            kept.append((counts.copy(), volts.copy(), lines.copy()))
        counts, volts, lines = kept[0]
        return counts.copy(), volts.copy(), lines.copy()

    return change


def digital_frozen(rig: LockstepRig, random: np.random.Generator) -> Change:
    """Freeze all encoders and switches.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    frozen = card_frozen(rig, random)

    def change(counts: IntArray, volts: FloatArray, lines: BoolArray) -> Senses:
        kept = frozen(counts, volts, lines)
        return kept[0], volts, kept[2]

    return change


def _delayed(samples: int) -> Change:
    """Give the senses of so many samples ago; before there are any, the first ones."""
    waiting = deque[Senses]()

    def change(counts: IntArray, volts: FloatArray, lines: BoolArray) -> Senses:
        waiting.append((counts.copy(), volts.copy(), lines.copy()))
        if len(waiting) > samples:
            return waiting.popleft()
        counts, volts, lines = waiting[0]
        return counts.copy(), volts.copy(), lines.copy()

    return change


def inputs_late(rig: LockstepRig, random: np.random.Generator) -> Change:
    """Read all inputs some samples late.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    del rig
    return _delayed(int(random.integers(5, 60)))


def encoder_bit(rig: LockstepRig, random: np.random.Generator) -> Change:
    """Let one bit of an encoder's counter stick.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    limb, bit = int(random.integers(rig.plant.tension.size)), 1 << int(random.integers(3, 13))
    on = bool(random.random() < 0.5)

    def change(counts: IntArray, volts: FloatArray, lines: BoolArray) -> Senses:
        counts[limb] = counts[limb] | bit if on else counts[limb] & ~bit
        return counts, volts, lines

    return change


def encoder_noise(rig: LockstepRig, random: np.random.Generator) -> Change:
    """Add noise to an encoder.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    limb, size = int(random.integers(rig.plant.tension.size)), int(random.integers(30, 2000))

    def change(counts: IntArray, volts: FloatArray, lines: BoolArray) -> Senses:
        counts[limb] += int(random.integers(-size, size + 1))
        return counts, volts, lines

    return change


def gauges_times(*factors: float) -> Callable[[LockstepRig, np.random.Generator], Change]:
    """Multiply all gauges, as a supply that is another one does.

    Args:
        factors: of which one is drawn.
    """

    def fault(rig: LockstepRig, random: np.random.Generator) -> Change:
        del rig
        factor = float(random.choice(factors))
        return lambda counts, volts, lines: (counts, factor * volts, lines)

    return fault


def gauges_late(rig: LockstepRig, random: np.random.Generator) -> Change:
    """Read the gauges late.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    del rig
    delayed = _delayed(int(random.integers(25, 150)))

    def change(counts: IntArray, volts: FloatArray, lines: BoolArray) -> Senses:
        return counts, delayed(counts, volts, lines)[1], lines

    return change


def gauges_stuck(rig: LockstepRig, random: np.random.Generator) -> Change:
    """Read the gauges as they were, with the noise that they have: no bit of them stands still.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    del rig
    held: list[FloatArray] = []

    def change(counts: IntArray, volts: FloatArray, lines: BoolArray) -> Senses:
        if not held:
            held.append(volts.copy())
        return counts, held[0] + STUCK_V * random.normal(size=volts.size), lines

    return change


def switches_inverted(rig: LockstepRig, random: np.random.Generator) -> Change:
    """Read every switch the other way round.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    del rig, random
    return lambda counts, volts, lines: (counts, volts, ~lines)


def pose_noisy(rig: LockstepRig, random: np.random.Generator) -> PoseChange:
    """Add noise to the position.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    del rig
    size = random.uniform(0.001, 0.004)
    return lambda where, turn: (where + size * random.standard_normal(3), turn)


def pose_in_millimetres(rig: LockstepRig, random: np.random.Generator) -> PoseChange:
    """Tell the position in millimetres.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    del rig, random
    return lambda where, turn: (1e3 * where, turn)


def pose_creeps(rig: LockstepRig, random: np.random.Generator) -> PoseChange:
    """Let the pose drift more slowly than a platform under load may move.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    way = random.normal(size=3)
    way *= random.uniform(0.005, 0.018) / np.linalg.norm(way)
    began_s = rig.now_s
    return lambda where, turn: (where + way * (rig.now_s - began_s), turn)


def pose_turns_slowly(rig: LockstepRig, random: np.random.Generator) -> PoseChange:
    """Let the pose turn more slowly than a platform under load may.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    axis = random.normal(size=3)
    axis *= random.uniform(0.02, 0.045) / np.linalg.norm(axis)
    began_s = rig.now_s

    def change(where: FloatArray, turn: FloatArray) -> tuple[FloatArray, FloatArray]:
        angle = axis * (rig.now_s - began_s)
        return where, Rotation.from_rotvec(angle).as_matrix() @ turn

    return change
