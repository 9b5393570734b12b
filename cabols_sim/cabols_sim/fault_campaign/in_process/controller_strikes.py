# SPDX-License-Identifier: Apache-2.0
"""Controllers that go wrong in the generated campaign: in units, signs, time and noise; pure."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np

from cabols_control.checks import FloatArray
from cabols_sim.fault_campaign.in_process.rig import LockstepRig
from cabols_sim.fault_campaign.in_process.strikes import Strike

Change = Callable[[FloatArray], FloatArray]
Fault = Callable[[LockstepRig, np.random.Generator], Change]
"""Draws what becomes of a command (n,), or of a wrench (6,), from now on."""


def currents(fault: Fault) -> Strike:
    """Return a limb controller whose currents go wrong.

    Args:
        fault: of the (n,) currents [A].
    """

    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        rig.change_current = fault(rig, random)

    return strike


def tensions(fault: Fault) -> Strike:
    """Return a wrench controller whose tensions go wrong.

    Args:
        fault: of the (n,) tensions [N].
    """

    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        rig.change_tension = fault(rig, random)

    return strike


def felt_wrench(fault: Fault) -> Strike:
    """Return a wrench controller that takes the sensor's wrench for another one.

    Args:
        fault: of the (6,) wrench, base axes [N, N m].
    """

    def strike(rig: LockstepRig, random: np.random.Generator) -> None:
        change, right = fault(rig, random), rig.wrenches.to_base_axes
        rig.wrenches.to_base_axes = (  # type: ignore[method-assign]
            lambda wrench: change(right(wrench))
        )

    return strike


def noisy(low: float, high: float) -> Fault:
    """Add noise of a size that is drawn between two.

    Args:
        low: least standard deviation.
        high: largest.
    """

    def fault(rig: LockstepRig, random: np.random.Generator) -> Change:
        del rig
        size = random.uniform(low, high)
        return lambda values: values + size * random.standard_normal(values.size)

    return fault


def late(least: int, most: int) -> Fault:
    """Give each command some samples late, as if it were new.

    Args:
        least: samples.
        most: samples.
    """

    def fault(rig: LockstepRig, random: np.random.Generator) -> Change:
        del rig
        behind, waiting = int(random.integers(least, most)), deque[FloatArray]()

        def change(values: FloatArray) -> FloatArray:
            waiting.append(values.copy())
            return waiting.popleft() if len(waiting) > behind else waiting[0]

        return change

    return fault


def stuck(rig: LockstepRig, random: np.random.Generator) -> Change:
    """Repeat the first command for ever.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    del rig, random
    kept: list[FloatArray] = []

    def change(values: FloatArray) -> FloatArray:
        if not kept:
            kept.append(values.copy())
        return kept[0]

    return change


def scaled(*factors: float) -> Fault:
    """Multiply by one of some factors, as in other units.

    Args:
        factors: of which one is drawn.
    """

    def fault(rig: LockstepRig, random: np.random.Generator) -> Change:
        del rig
        factor = float(random.choice(factors))
        return lambda values: factor * values

    return fault


def one_reversed(rig: LockstepRig, random: np.random.Generator) -> Change:
    """Turn the sign of one limb.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    signs = np.ones(rig.plant.tension.size)
    signs[random.integers(signs.size)] = -1.0
    return lambda values: signs * values


def shifted(rig: LockstepRig, random: np.random.Generator) -> Change:
    """Give each limb another one's.

    Args:
        rig: that is struck.
        random: of the trial.
    """
    by = int(random.integers(1, rig.plant.tension.size))
    return lambda values: np.roll(values, by)


def swinging(low: float, high: float, slow_hz: float, fast_hz: float) -> Fault:
    """Add a square wave to one limb, or to all.

    Args:
        low: least amplitude.
        high: largest.
        slow_hz: lowest frequency [Hz].
        fast_hz: highest [Hz].
    """

    def fault(rig: LockstepRig, random: np.random.Generator) -> Change:
        n = rig.plant.tension.size
        limbs = np.ones(n) if random.random() < 0.5 else np.eye(n)[random.integers(n)]
        size = random.uniform(low, high)
        rate = 2.0 * np.pi * np.exp(random.uniform(np.log(slow_hz), np.log(fast_hz)))
        return lambda values: values + size * np.sign(np.sin(rate * rig.now_s)) * limbs

    return fault


def rising(low: float, high: float) -> Fault:
    """Add more and more to one limb, or to all.

    Args:
        low: least rate [1/s].
        high: largest [1/s].
    """

    def fault(rig: LockstepRig, random: np.random.Generator) -> Change:
        n, began_s = rig.plant.tension.size, rig.now_s
        limbs = np.ones(n) if random.random() < 0.5 else np.eye(n)[random.integers(n)]
        rate = random.uniform(low, high)
        return lambda values: values + rate * (rig.now_s - began_s) * limbs

    return fault
