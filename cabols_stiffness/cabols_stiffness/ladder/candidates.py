"""Candidates for the ladder's rungs: blocks with the strength of their prior, and friction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabols_control.checks import FloatArray, IntArray
from cabols_stiffness.identification.elastic_observations import draw
from cabols_stiffness.identification.hysteresis import has_branches
from cabols_stiffness.identification.observations import Observations
from cabols_stiffness.ladder.evidence import Rows
from cabols_stiffness.model.elastic.blocks import (
    Block,
    Coupling,
    Cubic,
    Friction,
    Rung,
    Varying,
    bodies_of,
)
from cabols_stiffness.model.elastic.friction import Form
from cabols_stiffness.model.elastic.variation import Over, variation

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
    rows: Rows, others: FloatArray, columns: FloatArray, states: FrictionStates, scale: FloatArray
) -> list[tuple[Candidate, FloatArray, bool]]:
    """Best travels and joints of each form, beside other columns; its columns (r, p); its memory.

    Args:
        rows: of the samples.
        others: (r, q) columns of the model so far.
        columns: (r, f, n) of all states.
        states: of the friction.
        scale: (n,) of the motion that friction holds back [rad].
    """
    basis, _ = np.linalg.qr(others)
    flat = columns.reshape(columns.shape[0], -1)
    apart = (flat - basis @ (basis.T @ flat)).reshape(columns.shape)
    target = rows.residual - basis @ (basis.T @ rows.residual)
    n, found = columns.shape[2], []
    for form in Form:
        for kept in (False, True):
            mine = [i for i, f in enumerate(states.forms) if f is form and states.kept[i] is kept]
            chosen, left = np.full(n, mine[len(mine) // 2]), target
            for _ in range(2):
                for j in range(n):
                    beside = apart[:, np.delete(chosen, j), np.delete(np.arange(n), j)]
                    chosen[j] = mine[_most(apart[:, mine, j], left, beside)]
            # All joints that the loads move: leaving out small ones would bend the others.
            moved = np.linalg.norm(apart[:, chosen, np.arange(n)], axis=0)
            joint: IntArray = np.flatnonzero(moved > 0.0).astype(np.int64)
            if joint.size == 0:
                continue
            block = Friction(form, joint, states.travel[chosen, np.arange(n)], scale)
            name = f"friction, {form.value}" + (", kept between configurations" if kept else "")
            found.append((Candidate(name, block, FLAT), columns[:, chosen[joint], joint], kept))
    return found


def _most(tried: FloatArray, target: FloatArray, beside: FloatArray) -> int:
    """Which column (r, t) explains most of a target with a positive sign, beside others."""
    basis, _ = np.linalg.qr(beside)
    rest = tried - basis @ (basis.T @ tried)
    length = np.linalg.norm(rest, axis=0)
    left = target - basis @ (basis.T @ target)
    usable = length > 1e-6 * max(float(length.max(initial=0.0)), 1e-300)
    return int(np.argmax(np.where(usable, rest.T @ left / np.where(usable, length, 1.0), 0.0)))
