# SPDX-License-Identifier: Apache-2.0
"""An elastic arm at rest under a wrench: the exact balance of joints and bodies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.errors import CabolsError
from cabols_stiffness.model.elastic.blocks import Block, Friction, Motion, Statics
from cabols_stiffness.model.elastic.frames import frames_of
from cabols_stiffness.model.elastic.friction import friction_along
from cabols_stiffness.model.model_words import Rung
from cabols_stiffness.model.robot import RobotModel
from cabols_stiffness.model.screws import turn

STEPS = 40
ACCURACY = 1e-10
"""Of the deflections, relative to the largest."""

HALVINGS = 45


@dataclass(frozen=True, eq=False)
class Arm:
    """Blocks with values.

    Attributes:
        blocks: what gives way.
        values: (p,) parameters of all blocks, one after the other.
    """

    blocks: tuple[Block, ...]
    values: FloatArray

    @property
    def slices(self) -> list[slice]:
        """Where each block's parameters are."""
        ends = np.cumsum([0, *(block.size for block in self.blocks)])
        return [slice(int(a), int(b)) for a, b in pairwise(ends)]

    @property
    def friction(self) -> Friction | None:
        """The block of friction, if there is one."""
        return next((block for block in self.blocks if isinstance(block, Friction)), None)

    def columns(self, state: Statics) -> FloatArray:
        """(k, 6, p) motion of the tool by each parameter [m, rad]."""
        return columns_of(self.blocks, state)


def columns_of(blocks: Sequence[Block], state: Statics) -> FloatArray:
    """(k, 6, p) motion of the tool by each parameter of some blocks [m, rad].

    Args:
        blocks: one or more.
        state: of the arm.
    """
    return np.concatenate([block.columns(state) for block in blocks], axis=2)


def settle(
    robot: RobotModel,
    arm: Arm,
    joints: FloatArray,
    wrench: FloatArray,
    follows: bool,
    drawn: FloatArray | None = None,
    start: FloatArray | None = None,
    accuracy: float = ACCURACY,
    bodies: FloatArray | None = None,
) -> Statics:
    """Deflect joints and bodies until they balance the wrench; unchecked input.

    Args:
        robot: with its tool.
        arm: what gives way.
        joints: (k, n) by the encoders [rad, m].
        wrench: (k, 6) on the tool; tool axes if it follows the tool, else base axes.
        follows: whether it does.
        drawn: (k, n) share of the friction in each sample; None: as in a load that was put on the
            relaxed arm in one way.
        start: (k, n) deflections to begin with [rad, m].
        accuracy: of the deflections, relative to the largest.
        bodies: (k, n + 1, 6) motions of the bodies to begin with [m, rad]; None: none.

    Raises:
        CabolsError: if the arm cannot balance the wrench.
    """
    k, n = joints.shape
    moved = np.zeros((k, n)) if start is None else start.copy()
    bodies = np.zeros((k, n + 1, 6)) if bodies is None else bodies
    nothing, friction = np.zeros((k, n)), arm.friction
    for _ in range(STEPS):
        frames = frames_of(robot, joints + moved, bodies)
        posture = frames.posture
        load = turn(posture.rotation, wrench) if follows else wrench
        on_bodies = np.einsum("kbij,ki->kbj", frames.twists, load)
        share = nothing if drawn is None else drawn
        state = Statics(frames, joints, posture.torque(load), on_bodies, moved, share, bodies)
        before, motion = moved, Motion(np.zeros((k, n)), np.zeros((k, n + 1, 6)))
        for block, at in zip(arm.blocks, arm.slices, strict=True):
            if not (block is friction and drawn is None):
                block.move(arm.values[at], state, motion)
        moved, bodies = motion.joints, motion.bodies
        if friction is not None and drawn is None:
            moved, share = _first_loading(arm, friction, moved)
            state = replace(state, deflection=moved, friction=share)
        largest = float(np.abs(moved).max(initial=0.0))
        if not largest < 0.5:
            raise CabolsError(
                f"wrench: expected one that the robot can balance, got deflections of {largest:.3g}"
                " rad; check the units"
            )
        if np.abs(moved - before).max(initial=0.0) <= accuracy * max(largest, 1e-9):
            break
    return state


def softness(arm: Arm, state: Statics) -> FloatArray:
    """(k, 6, 6) motion of the tool by a small wrench on it, base axes, to first order.

    Args:
        arm: what gives way.
        state: of the arm.
    """
    k, n = state.torque.shape
    posture, twists = state.frames.posture, state.frames.twists
    found = np.empty((k, 6, 6))
    for axis, unit in enumerate(np.eye(6)):
        load = np.broadcast_to(unit, (k, 6))
        on_bodies = np.einsum("kbij,ki->kbj", twists, load)
        one = replace(state, torque=posture.torque(load), wrench=on_bodies)
        motion = Motion(np.zeros((k, n)), np.zeros((k, n + 1, 6)))
        for block, at in zip(arm.blocks, arm.slices, strict=True):
            if block.rung not in (Rung.FRICTION, Rung.CUBIC):
                block.move(arm.values[at], one, motion)
        found[:, :, axis] = np.einsum("kij,kj->ki", posture.jacobian, motion.joints)
        found[:, :, axis] += np.einsum("kbij,kbj->ki", twists, motion.bodies)
    return found


def _first_loading(
    arm: Arm, friction: Friction, elastic: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(k, n) deflections and shares of friction, from deflections without friction; bisection."""
    at = arm.slices[arm.blocks.index(friction)]
    held = np.zeros(elastic.shape[1])
    held[friction.joint] = np.maximum(arm.values[at], 0.0) * friction.scale[friction.joint]
    size, sign = np.abs(elastic), np.sign(elastic)
    low, high = np.maximum(size - held, 0.0), size
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        share = friction_along(friction.form, middle[None], friction.travel)[0]
        above = middle + held * share > size
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    moved = 0.5 * (low + high)
    share = np.where(held > 0.0, (size - moved) / np.where(held > 0.0, held, 1.0), 0.0)
    return sign * moved, sign * np.clip(share, 0.0, 1.0)
