# SPDX-License-Identifier: Apache-2.0
"""First power-on of a rig: is each limb's motor, encoder, switch and pull its own? Pure.

With slack cables one limb after the other is wound in by short pulses of 0.1 A, 5 mm at most, until
its switch closes and its cable pulls a little. What moved, which switch closed and which way the
force/torque sensor felt the pull tell whether the wiring is as configured.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cabols_control.checks import BoolArray, FloatArray
from cabols_control.commissioning.programmes import CommissioningConfig, Programme
from cabols_control.limb_control.records import ControlKind
from cabols_control.naming import limb_name

if TYPE_CHECKING:
    from cabols_control.limb_control.controller import LimbSample

CURRENT_A = 0.1
"""Of the pulses; no limb gets more before the check has passed."""
TRAVEL_M = 0.005
"""Longest way of any encoder from where the check began."""
PULSE_S, PULSE_MAX_S = 0.010, 0.025
"""First and longest pulse; they are made longer or shorter for ways of STEP_M."""
STEP_M = (0.0001, 0.00025)
"""Way of a pulse, with the coasting behind it."""
REST_S, RESTS = 0.060, 3.0
"""Shortest rest behind a pulse, and in lengths of the pulse: the motor then stands."""
STAND_S = 0.3
MOVED_M = 0.0005
"""An encoder that went farther has moved."""
DEAD_PULSES, DEAD_M = 8, 0.0001
"""Pulses after which something must have moved, and how far: an unseen motor goes a few mm."""
PULL_M = 0.001
"""Way behind the closing of the switch, so that the cable pulls."""
CHECK_S = 40.0
DIRECTION = 0.9
"""Least cosine between the measured pull and a cable's."""
FELT_N = 1.0
"""Least pull that has a direction; torques count by the rated ones."""


class WiringFault(IntEnum):
    """What is not as configured; same numbers as CommissionLimb's result."""

    NONE = 0
    NOTHING_MOVES = 1
    """No encoder moved: amplifier, motor, or encoder."""
    ENCODER_DEAD = 2
    """The limb's switch closed, and no encoder moved."""
    REVERSED = 3
    """The encoder went out where the motor should wind in: motor or encoder."""
    ENCODER_REVERSED = 4
    """The limb's switch closed while its encoder went out."""
    MOTORS_EXCHANGED = 5
    """Another limb moved, and its switch closed."""
    ENCODERS_EXCHANGED = 6
    """Another limb's encoder moved, but this one's switch closed."""
    SWITCHES_EXCHANGED = 7
    """This limb moved, but another one's switch closed."""
    OTHER_LIMB_MOVES = 8
    """Another limb's encoder moved, and no switch closed."""
    SEVERAL_MOVE = 9
    CABLES_EXCHANGED = 10
    """The pull has another cable's direction."""
    GAUGES = 11
    """The pull has no cable's direction: gauges exchanged, reversed, or another calibration."""
    NOT_TIGHT = 12
    """The cable did not get tight within 5 mm: take up its slack by hand, and check again."""


TEXTS = {
    WiringFault.NONE: "motor, encoder, switch and gauges are as configured",
    WiringFault.NOTHING_MOVES: "nothing moved: check its amplifier, motor cable and encoder",
    WiringFault.ENCODER_DEAD: "its switch closed, but no encoder moved: check the encoder's cable",
    WiringFault.REVERSED: "its encoder went out where it should wind in, and its switch did not "
    "close: the motor is reversed, or the encoder and the cable is slack",
    WiringFault.ENCODER_REVERSED: "its switch closed while its encoder went out: the encoder is "
    "reversed",
    WiringFault.MOTORS_EXCHANGED: "the other one moved and its switch closed: their motors are "
    "exchanged",
    WiringFault.ENCODERS_EXCHANGED: "the other one's encoder moved: their encoders are exchanged",
    WiringFault.SWITCHES_EXCHANGED: "the other one's switch closed: their switches are exchanged",
    WiringFault.OTHER_LIMB_MOVES: "the other one's encoder moved: motors or encoders are exchanged",
    WiringFault.SEVERAL_MOVE: "several encoders moved: check the wiring of motors and encoders",
    WiringFault.CABLES_EXCHANGED: "it pulls as the other one should: their cables are exchanged, "
    "or all their channels",
    WiringFault.GAUGES: "the sensor felt a pull of no cable's direction: check the gauges' wiring, "
    "the calibration file and the sensor's orientation",
    WiringFault.NOT_TIGHT: "its cable did not get tight within 5 mm: take up the slack by hand, "
    "then check it again; if it got slacker, motor and encoder are both reversed",
}


class Finding(NamedTuple):
    """What the check of one limb found.

    Attributes:
        fault: of the wiring.
        partner: limb that it is exchanged with, from 0; -1: none.
    """

    fault: WiringFault
    partner: int = -1

    def told(self, limb: int) -> str:
        """Sentence for people.

        Args:
            limb: that was checked, from 0.
        """
        other = f" and {limb_name(self.partner)}" if self.partner >= 0 else ""
        return f"{limb_name(limb)}{other}: {TEXTS[self.fault]}"


class PowerOnProgramme(Programme):
    """Checks one limb: stand, wind in by pulses, pull, feel, back.

    Attributes:
        moved: (n,) way of each encoder when the winding ended [m].
        closed: (n,) bool, switches that closed meanwhile.
    """

    kind = "first power-on"

    def __init__(self, limb: int, cables: int) -> None:
        """Wait for the first sample.

        Args:
            limb: index from 0.
            cables: number of the rig's.
        """
        super().__init__(limb, CommissioningConfig(timeout=CHECK_S), np.inf)
        self.moved = np.zeros(cables)
        self.closed: BoolArray = np.zeros(cables, dtype=np.bool_)
        self._start = np.zeros(cables)
        self._open: BoolArray = np.zeros(cables, dtype=np.bool_)
        self._sample: LimbSample | None = None
        self._pulses = 0
        self._pulse_s = -np.inf
        self._length_s = PULSE_S
        self._before = np.zeros(cables)
        self._tight_at = np.nan
        self._slack_sum, self._tight_sum = np.zeros(6), np.zeros(6)
        self._slack_count = self._tight_count = 0

    @property
    def progress(self) -> float:
        """Share that is done, roughly."""
        phases = ("waiting", "stand", "open", "wind", "pull", "feel", "back")
        return 1.0 if self.done else phases.index(self.phase) / len(phases)

    @property
    def pull(self) -> FloatArray:
        """(6,) mean wrench of the tight cable, less that of the slack one; NaN if there is none."""
        if not (self._slack_count and self._tight_count):
            return np.full(6, np.nan)
        return self._tight_sum / self._tight_count - self._slack_sum / self._slack_count

    def take_wrench(self, stamp_s: float, wrench: FloatArray) -> None:
        """Take a measured wrench, platform axes.

        Args:
            stamp_s: when it was measured [s]; not used.
            wrench: (6,) [N, N m].
        """
        del stamp_s
        # The first half of each rest still holds motion.
        settled = self._elapsed() > 0.5 * STAND_S
        if self.phase == "stand" and settled:
            self._slack_sum += wrench
            self._slack_count += 1
        elif self.phase == "feel" and settled:
            self._tight_sum += wrench
            self._tight_count += 1

    def step(self, sample: LimbSample) -> tuple[int, float]:
        """Return the limb's ControlKind and its value for one sample."""
        self._sample = sample
        return super().step(sample)

    def begin(self, sample: LimbSample) -> None:
        """Store where all stand."""
        self._start[:] = sample.wound_length
        self._enter("stand")

    def advance(self, wound: float, closed: bool) -> tuple[int, float]:
        """Return kind and value of the present phase.

        Args:
            wound: of this limb [m].
            closed: not used: all switches are looked at.
        """
        del closed
        sample = self._sample
        assert sample is not None
        if self.phase == "stand":
            if self._elapsed() < STAND_S:
                return ControlKind.CURRENT, 0.0
            self._enter("open" if sample.switch_closed[self.limb] else "wind")
            self._open = ~np.asarray(sample.switch_closed, dtype=np.bool_)
        if self.phase == "feel":
            if self._elapsed() < STAND_S:
                return ControlKind.CURRENT, 0.0
            self._enter("back")
        way = sample.wound_length - self._start
        far = bool(np.abs(way).max() >= TRAVEL_M)
        if self.phase == "open":
            # A tight cable is given out first; its switch must open.
            if far or not sample.switch_closed[self.limb]:
                self._open = ~np.asarray(sample.switch_closed, dtype=np.bool_)
                self._restart("wind", sample)
                return ControlKind.CURRENT, 0.0
            if self._pulse_due():
                self._begin_pulse(way)
            return self._pulsed(-CURRENT_A)
        if self.phase in ("wind", "pull"):
            return self._wind(sample, way, far)
        home = wound - self._start[self.limb]
        if home <= 0.0 or self._pulses <= 0:
            self.done = True
            return ControlKind.REST, 0.0
        if self._pulse_due():
            self._pulses -= 1
            self._begin_pulse(way)
        return self._pulsed(-CURRENT_A)

    def _restart(self, phase: str, sample: LimbSample) -> None:
        self._start[:] = sample.wound_length
        self._pulses = 0
        self._enter(phase)

    def _wind(self, sample: LimbSample, way: FloatArray, far: bool) -> tuple[int, float]:
        self.moved[:] = way
        self.closed |= self._open & np.asarray(sample.switch_closed, dtype=np.bool_)
        still = np.abs(way).max() < DEAD_M and self._pulses >= DEAD_PULSES
        if self.phase == "wind":
            if self.closed.any() and not (self.closed[self.limb] and way[self.limb] > MOVED_M):
                # Judged as it is: something is exchanged or reversed.
                return self._give_up()
            if self.closed.any():
                self._tight_at = float(way[self.limb])
                self._enter("pull")
            elif far or still:
                return self._give_up()
        if self.phase == "pull" and (far or way[self.limb] - self._tight_at >= PULL_M):
            self._enter("feel")
            return ControlKind.CURRENT, 0.0
        if self._pulse_due():
            self._pulses += 1
            self._begin_pulse(way)
        return self._pulsed(CURRENT_A)

    def _give_up(self) -> tuple[int, float]:
        self._enter("back")
        return ControlKind.CURRENT, 0.0

    def _pulse_due(self) -> bool:
        rest = max(REST_S, RESTS * self._length_s)
        return not self._now_s - self._pulse_s < self._length_s + rest

    def _begin_pulse(self, way: FloatArray) -> None:
        """Begin a pulse, longer or shorter by how far the one before went."""
        if np.isfinite(self._pulse_s):
            step = float(np.abs(way - self._before).max())
            factor = 1.4 if step < STEP_M[0] else 0.7 if step > STEP_M[1] else 1.0
            self._length_s = min(max(factor * self._length_s, 0.5 * PULSE_S), PULSE_MAX_S)
        self._before[:] = way
        self._pulse_s = self._now_s

    def _pulsed(self, current: float) -> tuple[int, float]:
        inside = self._now_s - self._pulse_s < self._length_s
        return ControlKind.CURRENT, current if inside else 0.0


def judge_limb(
    limb: int,
    moved: FloatArray,
    closed: BoolArray,
    pull: FloatArray,
    structure: FloatArray,
    rated: FloatArray,
) -> Finding:
    """Say what is wrong with a limb's wiring.

    Args:
        limb: that got the current, from 0.
        moved: (n,) way of each encoder [m].
        closed: (n,) bool, switches that closed.
        pull: (6,) wrench of the tight cable, base axes; NaN if it did not get tight [N, N m].
        structure: (6, n) structure matrix at the platform's pose.
        rated: (6,) rated wrench, by which forces and torques are compared [N, N m].
    """
    movers = np.flatnonzero(np.abs(moved) >= MOVED_M)
    closers = np.flatnonzero(closed)
    own = bool(closed[limb])
    if movers.size == 0:
        return Finding(WiringFault.ENCODER_DEAD if own else WiringFault.NOTHING_MOVES)
    if movers.size > 1:
        return Finding(WiringFault.SEVERAL_MOVE)
    mover = int(movers[0])
    if mover != limb:
        if own:
            return Finding(WiringFault.ENCODERS_EXCHANGED, mover)
        both = mover in closers
        kind = WiringFault.MOTORS_EXCHANGED if both else WiringFault.OTHER_LIMB_MOVES
        return Finding(kind, mover)
    if moved[limb] < 0.0:
        return Finding(WiringFault.ENCODER_REVERSED if own else WiringFault.REVERSED)
    if not own:
        if closers.size:
            return Finding(WiringFault.SWITCHES_EXCHANGED, int(closers[0]))
        return Finding(WiringFault.NOT_TIGHT)
    return _judge_pull(limb, pull, structure, rated)


def _judge_pull(limb: int, pull: FloatArray, structure: FloatArray, rated: FloatArray) -> Finding:
    """Compare the direction of a pull with all cables'."""
    scale = rated[:3].mean() / rated
    felt = pull * scale
    size = float(np.linalg.norm(felt))
    if not size >= FELT_N:
        return Finding(WiringFault.NOT_TIGHT if np.isnan(size) else WiringFault.GAUGES)
    cables = structure * scale[:, None]
    cosine = felt @ cables / (size * np.linalg.norm(cables, axis=0))
    best = int(np.argmax(cosine))
    if not cosine[best] >= DIRECTION:
        return Finding(WiringFault.GAUGES)
    if best != limb and cosine[best] > cosine[limb] + 1.0 - DIRECTION:
        return Finding(WiringFault.CABLES_EXCHANGED, best)
    return Finding(WiringFault.NONE if cosine[limb] >= DIRECTION else WiringFault.GAUGES)
