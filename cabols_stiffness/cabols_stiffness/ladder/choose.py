# SPDX-License-Identifier: Apache-2.0
"""The ladder: blocks are added one after the other, as long as held-out cells are predicted better.

In each round every rung that is left is tried beside those already taken, in all its variants, on
the linearised measurements; the one that predicts held-out configurations best is taken, if its
gain is beyond doubt over the configurations. So complexity is paid for by predictions alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_stiffness.identification.adequacy.suspects import suspects
from cabols_stiffness.identification.elastic_observations import motion_of, residual_of
from cabols_stiffness.identification.gauss_newton import Fitted
from cabols_stiffness.identification.observations import Observations
from cabols_stiffness.ladder.candidates import (
    FLAT,
    Candidate,
    FrictionStates,
    best_friction,
    elastic_candidates,
    friction_states,
)
from cabols_stiffness.ladder.evidence import (
    HeldOut,
    Rows,
    groups,
    rows_of,
)
from cabols_stiffness.ladder.sums import Sums
from cabols_stiffness.model.elastic.arm import Arm, columns_of, settle
from cabols_stiffness.model.elastic.blocks import Block, Joints, Statics, Varying
from cabols_stiffness.model.model_words import Rung
from cabols_stiffness.model.verdict import Suspect

BEYOND_DOUBT = 2.0
"""Standard deviations by which the gain over the cells must differ from zero."""

LEAST_OF_FAULTS = 0.05
"""Share of the held-out deviance that wrong data must explain to be named."""

FAULTS = (
    Suspect.TOOL_POINT,
    Suspect.WRENCH_POINT,
    Suspect.BASE_FRAME,
    Suspect.WRENCH_FRAME,
    Suspect.WRENCH_GAIN,
)

LEAST_SHARE = 0.02

LEAST_GAIN = 0.003
"""Share of the squared error that a rung must remove."""


@dataclass(frozen=True, eq=False)
class Step:
    """One comparison.

    Attributes:
        rung: that was tried.
        name: its best variant.
        parameters: how many it has.
        rms: held-out error with it, in the stated noise.
        gain: share of the squared error that it removes from that of the rungs before.
        doubt: standard deviation of that share over the cells.
        taken: whether it was.
    """

    rung: Rung
    name: str
    parameters: int
    rms: float
    gain: float
    doubt: float
    taken: bool


@dataclass(frozen=True)
class Fault:
    """Wrong data that a rung would only imitate.

    Attributes:
        suspect: what is wrong.
        gain: share of the held-out deviance that it removes.
    """

    suspect: Suspect
    gain: float


@dataclass(frozen=True, eq=False)
class Choice:
    """What the ladder chose.

    Attributes:
        taken: blocks with their priors, joints first.
        steps: all comparisons, in order; the first is of the joints alone.
        fault: of the data that predicts better than any rung: a frame, a point, the sensor's gains;
            the ladder ends there. None: no such.
        kept: whether friction is kept when the robot moves to another configuration.
        rivals: other forms of friction that predict as well, with their memory.
        rms: held-out error of the choice, in the stated noise.
    """

    taken: tuple[Candidate, ...]
    steps: tuple[Step, ...]
    fault: Fault | None
    kept: bool
    rivals: tuple[tuple[Candidate, bool], ...]
    rms: float


@dataclass(frozen=True, eq=False)
class _Tried:
    candidate: Candidate
    at: IntArray
    score: HeldOut
    kept: bool


class Ladder:
    """Linearised measurements of one campaign, and the choice among blocks."""

    def __init__(self, observations: Observations, found: Fitted) -> None:
        """Linearise at a fit of the joints alone.

        Args:
            observations: of the robot.
            found: fit of the joints' compliance, with the samples in use.
        """
        self.scale = natural_scale(found)
        deflection = found.deflection
        self.reach = np.maximum(np.abs(deflection[found.use]).max(axis=0, initial=0.0), 1e-9)
        self._use: BoolArray = found.use
        joints = Joints(self.scale)
        arm = Arm((joints,), found.parameters.compliance / self.scale)
        samples = observations.samples
        nothing = np.zeros_like(deflection)
        state = settle(
            observations.robot, arm, samples.joints, samples.wrench, observations.follows,
            nothing, deflection,
        )  # fmt: skip
        self._candidates = elastic_candidates(observations, self.scale, self.reach)
        blocks: list[Block] = [joints]
        blocks += [c.block for i, c in enumerate(self._candidates) if not self._same(i)]
        # What varies over the workspace is the joints' columns times features of the configuration.
        varying = [block for block in blocks if isinstance(block, Varying)]
        blocks = [block for block in blocks if not isinstance(block, Varying)]
        columns = columns_of(blocks, state)
        self._states = friction_states(observations, deflection, self.reach)
        if self._states is not None:
            columns = np.concatenate([columns, _held(self._states, state, self.reach)], axis=2)
        guessed = suspects(observations, found, False)
        self._faults = {one: guessed[one] for one in FAULTS if one in guessed}
        sizes = [one.shape[2] for one in self._faults.values()]
        measured = [motion_of(observations, state) @ columns, *self._faults.values()]
        rows = rows_of(
            observations,
            residual_of(observations, arm, state),
            np.concatenate(measured, axis=2),
            found.line,
            found.use,
        )
        width = rows.columns.shape[1]
        first = width - sum(sizes)
        self._fault_at = [slice(first + at.start, first + at.stop) for at in groups(sizes)]
        self._joints = Candidate("joints", joints, FLAT)
        self._at = groups([block.size for block in blocks])
        self._held: IntArray | None = None
        if self._states is not None:
            held = np.arange(self._at[-1].stop, first)
            self._held = held.reshape(len(self._states.forms), self.scale.size)
        self._blocks = [*blocks, *varying]
        ends = groups([block.size for block in varying])
        self._at += [slice(width + at.start, width + at.stop) for at in ends]
        more = [_varied(block, rows, samples.joints) for block in varying]
        self._rows = rows.with_columns(np.hstack([rows.columns, *more]))
        self._sums = Sums(self._rows, self._columns(joints))

    def _same(self, index: int) -> bool:
        """Whether a candidate's block is that of the one before it."""
        return index > 0 and self._candidates[index].block is self._candidates[index - 1].block

    def _columns(self, block: Block) -> IntArray:
        index = next(i for i, one in enumerate(self._blocks) if one is block)
        return np.arange(self._at[index].start, self._at[index].stop)

    def climb(self, rungs: frozenset[Rung] | None = None) -> Choice:
        """Add rungs while held-out predictions improve.

        Args:
            rungs: that may be added; None: all.
        """
        left = set(Rung) - {Rung.JOINTS} if rungs is None else set(rungs) - {Rung.JOINTS}
        taken = [_Tried(self._joints, self._columns(self._joints.block), _none(self._rows), False)]
        steps = [self._first(taken)]
        rivals: tuple[tuple[Candidate, bool], ...] = ()
        fault: Fault | None = None
        while left:
            score, tried = self._tried(taken, left)
            if not tried:
                break
            best = min(tried, key=lambda one: one.score.squares.sum())
            rounds = []
            for rung in sorted(left):
                mine = [one for one in tried if one.candidate.rung is rung]
                if not mine:
                    continue
                one = min(mine, key=lambda each: each.score.squares.sum())
                gain, doubt = _gain(score, one.score)
                good = one is best and gain > max(BEYOND_DOUBT * doubt, LEAST_GAIN)
                block, raw = one.candidate.block, self._raw([*taken, one])
                rounds.append(
                    Step(rung, one.candidate.name, block.size, raw.rms, gain, doubt, good)
                )
            rounds.sort(key=lambda step: not step.taken)
            if not rounds[0].taken:
                steps += rounds
                fault = self._fault(taken, score, score)
                break
            fault = self._fault(taken, score, best.score)
            if fault is not None:
                break
            steps.append(rounds[0])
            if best.candidate.rung is Rung.FRICTION:
                rivals = self._rivals(tried, best)
            taken.append(best)
            left.discard(best.candidate.rung)
        return self._choice(taken, steps, rivals, fault)

    def only(self, rungs: frozenset[Rung]) -> Choice:
        """Take these rungs, each in its best variant, whatever it gains.

        Args:
            rungs: besides the joints.
        """
        taken = [_Tried(self._joints, self._columns(self._joints.block), _none(self._rows), False)]
        steps = [self._first(taken)]
        rivals: tuple[tuple[Candidate, bool], ...] = ()
        for rung in sorted(rungs - {Rung.JOINTS}):
            score, tried = self._tried(taken, {rung})
            if not tried:
                continue
            best = min(tried, key=lambda one: one.score.squares.sum())
            gain, doubt = _gain(score, best.score)
            block, name = best.candidate.block, best.candidate.name
            raw = self._raw([*taken, best])
            steps.append(Step(rung, name, block.size, raw.rms, gain, doubt, True))
            if rung is Rung.FRICTION:
                rivals = self._rivals(tried, best)
            taken.append(best)
        return self._choice(taken, steps, rivals, None)

    def _first(self, taken: list[_Tried]) -> Step:
        rms = self._raw(taken).rms
        return Step(Rung.JOINTS, "joints", self._joints.block.size, rms, 0.0, 0.0, True)

    def _choice(
        self,
        taken: list[_Tried],
        steps: list[Step],
        rivals: tuple[tuple[Candidate, bool], ...],
        fault: Fault | None,
    ) -> Choice:
        kept, rms = any(one.kept for one in taken), self._raw(taken).rms
        blocks = tuple(one.candidate for one in taken)
        return Choice(blocks, tuple(steps), fault, kept, rivals, rms)

    def _fault(self, taken: list[_Tried], before: HeldOut, rung: HeldOut) -> Fault | None:
        """Wrong data that predict better than the best rung, with what is taken beside them."""
        so_far = [one.at for one in taken]
        prior = np.concatenate([_precision(one.candidate, 1.0) for one in taken])
        best, found = float(rung.squares.sum()), None
        for suspect, at in zip(self._faults, self._fault_at, strict=True):
            precision = np.append(prior, np.zeros(at.stop - at.start))
            score = self._sums.predictive([*so_far, np.arange(at.start, at.stop)], precision)
            gain, doubt = _gain(before, score)
            clear = gain > max(BEYOND_DOUBT * doubt, LEAST_OF_FAULTS)
            if clear and float(score.squares.sum()) < best:
                best, found = float(score.squares.sum()), Fault(suspect, gain)
        return found

    def _raw(self, taken: list[_Tried]) -> HeldOut:
        """Held-out error in the stated noise, whatever scatters."""
        precision = np.concatenate([_precision(one.candidate, 1.0) for one in taken])
        return self._sums.held_out([one.at for one in taken], precision)

    def _tried(self, taken: list[_Tried], left: set[Rung]) -> tuple[HeldOut, list[_Tried]]:
        """Held-out deviance of what is taken, and with each candidate beside it."""
        so_far = [one.at for one in taken]
        prior = np.concatenate([_precision(one.candidate, 1.0) for one in taken])
        score = self._sums.predictive(so_far, prior)
        found = [(one, self._columns(one.block), False) for one in self._candidates
                 if one.rung in left]  # fmt: skip
        if Rung.FRICTION in left and self._states is not None and self._held is not None:
            held = self._held
            found += best_friction(self._sums, so_far, held, self._states, self.reach)
        tried = []
        for candidate, at, kept in found:
            precision = np.concatenate([prior, _precision(candidate, 1.0)])
            after = self._sums.predictive([*so_far, at], precision)
            tried.append(_Tried(candidate, at, after, kept))
        return score, tried

    @staticmethod
    def _rivals(tried: list[_Tried], best: _Tried) -> tuple[tuple[Candidate, bool], ...]:
        found = []
        for one in tried:
            if one.candidate.rung is Rung.FRICTION and one is not best:
                gain, doubt = _gain(one.score, best.score)
                if not gain > BEYOND_DOUBT * doubt:
                    found.append((one.candidate, one.kept))
        return tuple(found)


def natural_scale(found: Fitted) -> FloatArray:
    """(n,) compliances of a natural size: as the joints alone have, but none absurdly small.

    Coupled joints can leave a joint alone no compliance at all; what it then counts as is the
    compliance by which it would make LEAST_SHARE of the motion.

    Args:
        found: fit of the joints alone.
    """
    line, compliance = found.line, found.parameters.compliance
    torque = line.balance.posture.torque(line.balance.wrench)
    each = line.motion[found.use] * torque[found.use][:, None, :]
    total = np.sqrt(np.mean((each @ compliance) ** 2))
    per_unit = np.sqrt(np.mean(each**2, axis=(0, 1)))
    least = LEAST_SHARE * total / np.maximum(per_unit, 1e-300)
    known = per_unit > 1e-6 * float(per_unit.max(initial=0.0))
    return np.asarray(np.where(known, np.maximum(compliance, least), compliance))


def _held(states: FrictionStates, state: Statics, reach: FloatArray) -> FloatArray:
    """(k, 6, f n) motion of the tool by friction of every state and joint."""
    held = -state.frames.posture.jacobian * reach
    found = held[:, :, None, :] * states.share.swapaxes(0, 1)[:, None]
    return np.asarray(found.reshape(found.shape[0], 6, -1))


def _varied(block: Varying, rows: Rows, joints: FloatArray) -> FloatArray:
    """(r, p) whitened columns of a block, from those of the joints, which come first."""
    _, first = np.unique(rows.sample, return_index=True)
    sample = rows.sample[np.sort(first)]
    features = np.concatenate(block.over.features(joints[sample]), axis=1)
    count = rows.sample.size // sample.size
    return np.asarray(rows.columns[:, block.joint] * np.repeat(features, count, axis=0))


def _none(rows: Rows) -> HeldOut:
    return HeldOut(np.full(rows.fold.size, np.inf), rows.numbers)


def _precision(candidate: Candidate, noise: float) -> FloatArray:
    flat = candidate.prior >= FLAT
    value = 0.0 if flat else noise / candidate.prior**2
    return np.full(candidate.block.size, value)


def _gain(before: HeldOut, after: HeldOut) -> tuple[float, float]:
    """Share of the squared error that is removed, and its deviation over the cells."""
    total = float(before.squares.sum())
    each = (before.squares - after.squares) / total
    deviation = float(each.std(ddof=1) * np.sqrt(each.size)) if each.size > 1 else float("inf")
    return float(each.sum()), deviation
