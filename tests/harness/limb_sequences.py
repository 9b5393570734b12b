# SPDX-License-Identifier: Apache-2.0
"""Random sequences of modes, limb states and commands, and what a limb controller answers.

The numbers come from the generator's integers by plain arithmetic, so that they are the same bits
wherever this runs: version 0.1's answers to them are stored beside the test.
"""

from __future__ import annotations

import numpy as np

CABLES = 8
STEPS = 400
FLOATS = ("wound_length", "elongation", "tension")


class Generator:
    """Numbers of the same bits everywhere."""

    def __init__(self, seed):
        self._bits = np.random.Generator(np.random.PCG64(seed))

    def numbers(self, low, high, count):
        """(count,) between low and high, multiples of a 2**-20th of the range."""
        return low + (high - low) * (self._bits.integers(0, 1 << 20, count) / (1 << 20))

    def number(self, low, high):
        return float(self.numbers(low, high, 1)[0])

    def below(self, count):
        return int(self._bits.integers(0, count))

    def chance(self, one_in):
        return self.below(one_in) == 0


class RandomProgramme:
    """A commissioning programme that asks for anything."""

    def __init__(self, draw, limb):
        self.limb, self.hold_others = limb, draw.chance(2)
        self.started = self.done = False
        self.taken = []
        self._draw = draw

    def step(self, sample):
        self.started = True
        self.done = self._draw.chance(40)
        kind = self._draw.below(6)
        value = self._draw.number(-5.0, 120.0) if kind == 2 else self._draw.number(-0.2, 0.2)
        return kind, value

    def take(self, current):
        self.taken.append(current)

    def abort(self, reason):
        self.done = True


def answers(make_controller, make_sample, make_setpoint, modes, limbs, seed):
    """Drive a controller; (STEPS, ...) currents, saturated, whether at fault, whether unloaded.

    Args:
        make_controller: from a list of limbs, or None for all.
        make_sample: from a stamp and arrays by name.
        make_setpoint: from stamp, (m,) tension, active.
        modes: names to enumeration members.
        limbs: indices or None.
        seed: of the sequence.
    """
    draw = Generator(seed)
    controller = make_controller(limbs)
    driven = CABLES if limbs is None else len(limbs)
    names = [name for name in modes if name != "FAULT"]
    mode, left, stamp_s = "STOPPED", 3, 1.0
    tension = draw.numbers(4.0, 8.0 if seed % 3 == 0 else 60.0, CABLES)
    slack = draw.numbers(0.0, 0.02, CABLES)
    zeroed = np.zeros(CABLES, dtype=np.bool_)
    currents, taken = np.zeros((STEPS, driven)), []
    saturated = np.zeros((STEPS, driven), dtype=np.bool_)
    faults, unloaded = np.zeros(STEPS, dtype=np.bool_), np.zeros(STEPS, dtype=np.bool_)
    for k in range(STEPS):
        left -= 1
        if left == 0:
            mode, left = names[draw.below(len(names))], 1 + draw.below(40)
            if controller.fault or draw.chance(4):
                mode, left = "STOPPED", 1 + draw.below(2)
            if not draw.chance(6):
                zeroed[:] = True
            else:
                zeroed[:] = draw.numbers(0.0, 1.0, CABLES) > 0.5
            if mode == "COMMISSIONING":
                controller.excitation = RandomProgramme(draw, draw.below(CABLES))
        stamp_s += (0.001, 0.001, 0.001, 0.0011, 0.004, 0.001)[draw.below(6)]
        if draw.chance(60):
            stamp_s += (0.02, 0.0, -0.0005, -30.0)[draw.below(4)]
        tension = np.minimum(np.maximum(tension + draw.numbers(-0.2, 0.2, CABLES), 0.0), 110.0)
        slack = slack + draw.numbers(-2e-6, 2e-6, CABLES)
        known = np.where(zeroed, tension, np.nan)
        arrays = {
            "wound_length": slack + tension / 90_000.0,
            "elongation": known / 2200.0,
            "tension": known.copy(),
            "switch_closed": draw.numbers(0.0, 1.0, CABLES) > 0.3,
            "zeroed": zeroed.copy(),
        }
        if draw.chance(80):
            arrays[FLOATS[draw.below(3)]][draw.below(CABLES)] = (np.nan, np.inf)[draw.below(2)]
        asked = draw.numbers(-10.0, 160.0, driven)
        if draw.chance(90):
            asked[draw.below(driven)] = np.nan
        age_s = 1.0 if draw.chance(120) else 0.001
        command = make_setpoint(stamp_s - age_s, asked, not draw.chance(10))
        if draw.chance(150):
            command = None
        current = controller.step(make_sample(stamp_s, arrays), modes[mode], command)
        currents[k], saturated[k] = current, controller.saturated
        faults[k], unloaded[k] = bool(controller.fault), controller.unloaded
        if controller.excitation is not None and controller.excitation.taken:
            taken.append(controller.excitation.taken[-1])
    return {
        "current": currents,
        "saturated": saturated,
        "fault": faults,
        "unloaded": unloaded,
        "taken": np.array(taken),
    }
