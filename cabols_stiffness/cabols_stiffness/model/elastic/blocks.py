# SPDX-License-Identifier: Apache-2.0
"""What may give way in an arm, each as motions that are linear in a few parameters.

To first order every effect moves a joint or a body in proportion to its parameters: a compliance by
the torque there, friction by its share, a cubic term by the cube of the deflection. A block has the
columns of the tool's motion by its parameters (for the fit) and the motions themselves (for the
exact balance). Parameters are relative to natural sizes, so that 1 is a lot for all of them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from cabols_control.checks import FloatArray, IntArray
from cabols_stiffness.model.elastic.frames import Frames
from cabols_stiffness.model.elastic.friction import Form
from cabols_stiffness.model.elastic.variation import Variation
from cabols_stiffness.model.model_words import Rung
from cabols_stiffness.model.robot import RobotModel


@dataclass(frozen=True, eq=False)
class Statics:
    """A loaded arm.

    Attributes:
        frames: where it is.
        joints: (k, n) by the encoders [rad, m].
        torque: (k, n) of the joints [N m, N].
        wrench: (k, n + 1, 6) on each body at its origin, in its axes [N, N m].
        deflection: (k, n) of the joints [rad, m].
        friction: (k, n) share of the joints' friction that is drawn, -1 to 1.
        bodies: (k, n + 1, 6) motion of each body, in its axes [m, rad]; None: not kept.
    """

    frames: Frames
    joints: FloatArray
    torque: FloatArray
    wrench: FloatArray
    deflection: FloatArray
    friction: FloatArray
    bodies: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Motion:
    """What gives way: filled block by block.

    Attributes:
        joints: (k, n) deflections [rad, m].
        bodies: (k, n + 1, 6) of each body, in its axes [m, rad].
    """

    joints: FloatArray
    bodies: FloatArray


class Block(Protocol):
    """Parameters of one effect."""

    @property
    def rung(self) -> Rung:
        """What it stands for."""

    @property
    def size(self) -> int:
        """Number p of parameters."""

    def columns(self, state: Statics) -> FloatArray:
        """(k, 6, p) motion of the tool, in base axes, by each parameter [m, rad]."""

    def move(self, values: FloatArray, state: Statics, motion: Motion) -> None:
        """Add what gives way by (p,) values.

        Args:
            values: (p,) of the parameters.
            state: of the arm.
            motion: filled.
        """


@dataclass(frozen=True, eq=False)
class Joints:
    """Compliance of each joint about its own axis.

    Attributes:
        scale: (n,) of the compliance [rad/(N m)].
    """

    scale: FloatArray
    rung = Rung.JOINTS

    @property
    def size(self) -> int:
        """Number of joints."""
        return int(self.scale.size)

    def columns(self, state: Statics) -> FloatArray:
        """(k, 6, n)."""
        return state.frames.posture.jacobian * (self.scale * state.torque)[:, None, :]

    def move(self, values: FloatArray, state: Statics, motion: Motion) -> None:
        """Add the joints' motions.

        Args:
            values: (p,) of the parameters.
            state: of the arm.
            motion: filled.
        """
        motion.joints[...] += values * self.scale * state.torque


@dataclass(frozen=True, eq=False)
class Cubic:
    """Stiffening of each joint: c a d^3 less deflection, of (4.8).

    Attributes:
        scale: (n,) of c a [1/rad^2].
    """

    scale: FloatArray
    rung = Rung.CUBIC

    @property
    def size(self) -> int:
        """Number of joints."""
        return int(self.scale.size)

    def columns(self, state: Statics) -> FloatArray:
        """(k, 6, n)."""
        return -state.frames.posture.jacobian * (self.scale * state.deflection**3)[:, None, :]

    def move(self, values: FloatArray, state: Statics, motion: Motion) -> None:
        """Add the joints' motions.

        Args:
            values: (p,) of the parameters.
            state: of the arm.
            motion: filled.
        """
        motion.joints[...] -= values * self.scale * state.deflection**3


@dataclass(frozen=True, eq=False)
class Coupling:
    """Joints that deflect under each other's torque: a parallelogram, a coupled wrist.

    Attributes:
        scale: (n,) of the joints' own compliance [rad/(N m)].
    """

    scale: FloatArray
    rung = Rung.COUPLING

    @property
    def pairs(self) -> tuple[IntArray, IntArray]:
        """Joints of each parameter."""
        first, second = np.triu_indices(self.scale.size, 1)
        return first, second

    @property
    def size(self) -> int:
        """Number of pairs."""
        return self.scale.size * (self.scale.size - 1) // 2

    @property
    def _pair_scale(self) -> FloatArray:
        first, second = self.pairs
        return np.asarray(np.sqrt(self.scale[first] * self.scale[second]))

    def columns(self, state: Statics) -> FloatArray:
        """(k, 6, p)."""
        jacobian, torque = state.frames.posture.jacobian, state.torque
        first, second = self.pairs
        both = jacobian[:, :, first] * torque[:, None, second]
        both += jacobian[:, :, second] * torque[:, None, first]
        return np.asarray(both * self._pair_scale)

    def move(self, values: FloatArray, state: Statics, motion: Motion) -> None:
        """Add the joints' motions.

        Args:
            values: (p,) of the parameters.
            state: of the arm.
            motion: filled.
        """
        first, second = self.pairs
        matrix = np.zeros((self.scale.size, self.scale.size))
        matrix[first, second] = values * self._pair_scale
        motion.joints[...] += state.torque @ (matrix + matrix.T)


@dataclass(frozen=True, eq=False)
class Bodies:
    """Base or links that give way: a symmetric 6 x 6 compliance of each body (virtual joints).

    Attributes:
        rung: BASE or LINKS.
        body: (p,) which body each parameter belongs to.
        basis: (p, 6, 6) its compliance, in the body's axes [m/N, 1/N, rad/(N m)].
    """

    rung: Rung
    body: IntArray
    basis: FloatArray

    @property
    def size(self) -> int:
        """Number of parameters."""
        return int(self.body.size)

    def columns(self, state: Statics) -> FloatArray:
        """(k, 6, p)."""
        twists, found = state.frames.twists, []
        for body in np.unique(self.body):
            basis = self.basis[self.body == body]
            # As one product of matrices: (k, 6) with (6, 6 p).
            flat = state.wrench[:, body] @ basis.transpose(2, 1, 0).reshape(6, -1)
            found.append(twists[:, body] @ flat.reshape(-1, 6, basis.shape[0]))
        return np.concatenate(found, axis=2)

    def compliance(self, values: FloatArray, bodies: int) -> FloatArray:
        """(bodies, 6, 6) of all bodies.

        Args:
            values: (p,) of the parameters.
            bodies: how many there are, the base among them.
        """
        matrix = np.zeros((bodies, 6, 6))
        np.add.at(matrix, self.body, values[:, None, None] * self.basis)
        return matrix

    def move(self, values: FloatArray, state: Statics, motion: Motion) -> None:
        """Add the bodies' motions.

        Args:
            values: (p,) of the parameters.
            state: of the arm.
            motion: filled.
        """
        matrix = self.compliance(values, motion.bodies.shape[1])
        motion.bodies[...] += np.einsum("bij,kbj->kbi", matrix, state.wrench)


@dataclass(frozen=True, eq=False)
class Varying:
    """Compliance of each joint that varies smoothly over the workspace.

    Attributes:
        scale: (n,) of the compliance [rad/(N m)].
        over: see Variation.
    """

    scale: FloatArray
    over: Variation
    rung = Rung.VARYING
    _last: list[tuple[FloatArray, list[FloatArray]]] = field(default_factory=list, repr=False)

    @property
    def joint(self) -> IntArray:
        """(p,) joint of each parameter."""
        return np.repeat(np.arange(self.scale.size), [part.size for part in self.over.middle])

    @property
    def size(self) -> int:
        """Number of features of all joints."""
        return sum(part.size for part in self.over.middle)

    def _features(self, state: Statics) -> list[FloatArray]:
        """(k, r) of each joint; those of the last joints are kept, as an iteration's stay."""
        if self._last and self._last[0][0] is state.joints:
            return self._last[0][1]
        found = self.over.features(state.joints)
        self._last[:] = [(state.joints, found)]
        return found

    def _along(self, state: Statics) -> FloatArray:
        """(k, p) motion of the parameter's joint."""
        joint = self.joint
        features = np.concatenate(self._features(state), axis=1)
        return np.asarray(features * (self.scale * state.torque)[:, joint])

    def columns(self, state: Statics) -> FloatArray:
        """(k, 6, p)."""
        jacobian = state.frames.posture.jacobian
        return np.asarray(jacobian[:, :, self.joint] * self._along(state)[:, None, :])

    def move(self, values: FloatArray, state: Statics, motion: Motion) -> None:
        """Add the joints' motions.

        Args:
            values: (p,) of the parameters.
            state: of the arm.
            motion: filled.
        """
        ends = np.cumsum([part.size for part in self.over.middle])[:-1]
        for j, own in enumerate(np.split(values, ends)):
            factor = self._features(state)[j] @ own
            motion.joints[:, j] += factor * self.scale[j] * state.torque[:, j]


@dataclass(frozen=True, eq=False)
class Friction:
    """Friction of joints, as the motion that it holds back: its torque times the compliance.

    Attributes:
        form: how it is drawn.
        joint: (p,) joints that have it.
        travel: (n,) see `friction_along`; also of the others [rad].
        scale: (n,) of the motion [rad].
    """

    form: Form
    joint: IntArray
    travel: FloatArray
    scale: FloatArray
    rung = Rung.FRICTION

    @property
    def size(self) -> int:
        """Number of joints that have it."""
        return int(self.joint.size)

    def columns(self, state: Statics) -> FloatArray:
        """(k, 6, p)."""
        held = (self.scale * state.friction)[:, self.joint]
        return np.asarray(-state.frames.posture.jacobian[:, :, self.joint] * held[:, None, :])

    def move(self, values: FloatArray, state: Statics, motion: Motion) -> None:
        """Add the joints' motions.

        Args:
            values: (p,) of the parameters.
            state: of the arm.
            motion: filled.
        """
        motion.joints[:, self.joint] -= values * (self.scale * state.friction)[:, self.joint]


def bodies_of(robot: RobotModel, scale: FloatArray, rung: Rung) -> Bodies:
    """Compliance of the base, or of the links, as far as no joint's own compliance is the same.

    What turns a body about its joint's axis, or about that of the next joint, is that joint's.

    Args:
        robot: with its tool.
        scale: (n,) of the joints' compliance [rad/(N m)].
        rung: BASE or LINKS.
    """
    n = robot.n
    body, basis = [], []
    for b in [0] if rung is Rung.BASE else range(1, n + 1):
        end = robot.origins[b] if b < n else robot.flange_position + robot.tool_position
        lever = max(float(np.linalg.norm(end)), 0.1)
        size = np.repeat([lever, 1.0], 3)
        shared = []
        if b > 0:
            shared.append(_screw(robot.joint_axes[b - 1], np.zeros(3), bool(robot.slides[b - 1])))
        if b < n:
            axis = robot.rotations[b] @ robot.joint_axes[b]
            shared.append(_screw(axis, robot.origins[b], bool(robot.slides[b])))
        for matrix in _apart_from([screw / size for screw in shared]):
            body.append(b)
            basis.append(scale[max(b - 1, 0)] * np.outer(size, size) * matrix)
    return Bodies(rung, np.array(body), np.array(basis))


def _screw(axis: FloatArray, point: FloatArray, slides: bool) -> FloatArray:
    """(6,) motion of a body's origin by a joint at a point."""
    if slides:
        return np.concatenate([axis, np.zeros(3)])
    return np.concatenate([np.cross(point, axis), axis])


def _apart_from(screws: list[FloatArray]) -> FloatArray:
    """(p, 6, 6) orthonormal symmetric matrices, orthogonal to the screws' own."""
    first, second = np.triu_indices(6)
    weight = np.where(first == second, 1.0, np.sqrt(2.0))
    known = np.array([(np.outer(s, s))[first, second] * weight for s in screws])
    _, _, right = np.linalg.svd(known.reshape(len(screws), weight.size), full_matrices=True)
    found = []
    for row in right[len(screws) :]:
        matrix = np.zeros((6, 6))
        matrix[first, second] = row / weight
        found.append(matrix + np.triu(matrix, 1).T)
    return np.array(found)
