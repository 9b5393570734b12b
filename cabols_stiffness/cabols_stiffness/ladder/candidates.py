# SPDX-License-Identifier: Apache-2.0
"""Candidates for the ladder's rungs: blocks with the strength of their prior, and friction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabols_control.checks import FloatArray, IntArray
from cabols_stiffness.identification.elastic_observations import draw
from cabols_stiffness.identification.hysteresis import has_branches
from cabols_stiffness.identification.observations import Observations
from cabols_stiffness.ladder.evidence import solve
from cabols_stiffness.ladder.sums import RESIDUAL, Sums
from cabols_stiffness.model.elastic.blocks import (
    Block,
    Coupling,
    Cubic,
    Friction,
    Varying,
    bodies_of,
)
from cabols_stiffness.model.elastic.friction import Form
from cabols_stiffness.model.elastic.variation import Over, variation
from cabols_stiffness.model.model_words import Rung

TRAVELS = np.array([0.02, 0.05, 0.1, 0.2, 0.4, 0.8])
"""Candidates for the motion after which friction is drawn, of a joint's largest deflection."""

LENGTHS = (0.7, 2.0)
"""Over which compliance may vary [rad]."""

FLAT = 1e4
"""Deviation of a prior that says nothing."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A block with its prior.

    Attributes:
        name: for people.
        block: what gives way.
        prior: standard deviation of its parameters about zero, relative to their natural size.
    """

    name: str
    block: Block
    prior: float

    @property
    def rung(self) -> Rung:
        """What the block stands for."""
        return self.block.rung


def elastic_candidates(
    observations: Observations, scale: FloatArray, reach: FloatArray
) -> list[Candidate]:
    """Candidates for all rungs but joints and friction.

    Args:
        observations: of the robot.
        scale: (n,) the joints' compliance, about [rad/(N m)].
        reach: (n,) largest deflection of each joint [rad].
    """
    robot, samples = observations.robot, observations.samples
    found = [Candidate("cubic", Cubic(1.0 / reach**2), 1.0)]
    if robot.n > 1:
        found.append(Candidate("coupling", Coupling(scale), 1.0))
    for rung in (Rung.BASE, Rung.LINKS):
        block = bodies_of(robot, scale, rung)
        found += [Candidate(f"{rung.value}, prior {prior:g}", block, prior) for prior in (0.1, 1.0)]
    centres = np.unique(np.round(samples.joints, 6), axis=0)
    if len(centres) >= 3:
        for over in Over:
            for length in LENGTHS:
                smooth = Varying(scale, variation(over, length, robot.slides, centres))
                found += [
                    Candidate(
                        f"varying over {over.value}, {length:g} rad, {prior:g}", smooth, prior
                    )
                    for prior in (0.05, 0.2)
                ]
    return found


@dataclass(frozen=True, eq=False)
class FrictionStates:
    """Share of friction in each sample, for every form, travel and memory.

    Attributes:
        forms: (f,) form of each.
        kept: (f,) whether it is kept when the robot moves to another configuration.
        travel: (f, n) [rad].
        share: (f, k, n) -1 to 1.
    """

    forms: list[Form]
    kept: list[bool]
    travel: FloatArray
    share: FloatArray


def friction_states(
    observations: Observations, deflection: FloatArray, reach: FloatArray
) -> FrictionStates | None:
    """Draw friction along the deflections in the order of measurement; None without branches.

    Args:
        observations: of the robot.
        deflection: (k, n) of the joints [rad].
        reach: (n,) largest of each joint [rad].
    """
    samples = observations.samples
    if not has_branches(samples):
        return None
    forms: list[Form] = []
    memory: list[bool] = []
    travels, shares = [], []
    for form in Form:
        tried = TRAVELS[:1] if form is Form.COULOMB else TRAVELS
        travel = tried[:, None] * reach
        for kept in (False, True):
            share = draw(observations, deflection, form, travel, kept)
            forms += [form] * len(tried)
            memory += [kept] * len(tried)
            travels.append(travel)
            shares.append(share.swapaxes(0, 1))
    return FrictionStates(forms, memory, np.concatenate(travels), np.concatenate(shares))


def best_friction(
    sums: Sums, others: list[IntArray], held: IntArray, states: FrictionStates, scale: FloatArray
) -> list[tuple[Candidate, IntArray, bool]]:
    """Best travels and joints of each form, beside other columns; its columns (p,); its memory.

    Args:
        sums: of the samples.
        others: columns of the model so far.
        held: (f, n) columns of all states.
        states: of the friction.
        scale: (n,) of the motion that friction holds back [rad].
    """
    flat = held.ravel()
    whole = sums.of([*others, flat]).sum(axis=0)
    own = whole.shape[0] - flat.size
    inside, across = whole[1:own, 1:own], whole[1:own]
    beside = np.delete(whole[own:], slice(1, own), axis=1) - across[:, own:].T @ solve(
        inside, np.delete(across, slice(1, own), axis=1)
    )
    # Products of what the others leave of the states' columns: with the residual, with each other.
    target, apart = beside[:, RESIDUAL], beside[:, 1:]
    n, found = held.shape[1], []
    place = np.arange(flat.size).reshape(held.shape)
    for form in Form:
        for kept in (False, True):
            mine = [i for i, f in enumerate(states.forms) if f is form and states.kept[i] is kept]
            chosen = np.full(n, mine[len(mine) // 2])
            for _ in range(2):
                for j in range(n):
                    rest = np.delete(place[chosen, np.arange(n)], j)
                    chosen[j] = mine[_most(apart, target, place[mine, j], rest)]
            # All joints that the loads move: leaving out small ones would bend the others.
            moved = np.diagonal(whole)[own:][place[chosen, np.arange(n)]]
            joint: IntArray = np.flatnonzero(moved > 0.0).astype(np.int64)
            if joint.size == 0:
                continue
            block = Friction(form, joint, states.travel[chosen, np.arange(n)], scale)
            name = f"friction, {form.value}" + (", kept between configurations" if kept else "")
            found.append((Candidate(name, block, FLAT), held[chosen[joint], joint], kept))
    return found


def _most(apart: FloatArray, target: FloatArray, tried: IntArray, beside: IntArray) -> int:
    """Which column of tried explains most of the residual with a positive sign, beside others.

    Args:
        apart: (f, f) products of all columns.
        target: (f,) of them with the residual.
        tried: (t,) columns.
        beside: (b,) columns that are fitted, too.
    """
    right = np.column_stack([target[beside], apart[np.ix_(beside, tried)]])
    lead = solve(apart[np.ix_(beside, beside)], right)
    along = target[tried] - apart[np.ix_(tried, beside)] @ lead[:, RESIDUAL]
    square = np.diagonal(apart)[tried] - np.sum(
        apart[np.ix_(tried, beside)].T * lead[:, 1:], axis=0
    )
    usable = square > 1e-9 * max(float(np.diagonal(apart)[tried].max(initial=0.0)), 1e-300)
    length = np.sqrt(np.where(usable, square, 1.0))
    return int(np.argmax(np.where(usable, along / length, 0.0)))
