# SPDX-License-Identifier: Apache-2.0
"""Serial robots from their URDF: kinematics and complementary stiffness.

Joints turn or slide; n of them. What identification needs is computed for many configurations at a
time in numpy; tests compare it with pinocchio.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import BoolArray, FloatArray, finite_array, rotation_matrix
from cabols_control.errors import ConfigError
from cabols_control.rig_folder import rig_file
from cabols_control.rotations import cross_matrix
from cabols_control.serial_arms.arm import NotSerialError, SerialArm, read_serial_arm
from cabols_stiffness.model.denavit_hartenberg import ENDINGS, read_dh

JOINTS = 6
"""Of the rig's own robot, and least number of joints unless a caller asks for fewer."""

WORST_COUPLING = 1e3
"""Condition number of a coupling beyond which it is none."""


@dataclass(frozen=True, eq=False)
class Posture:
    """Kinematics at k configurations, in the robot's base axes.

    Attributes:
        position: (k, 3) of the tool's origin [m].
        rotation: (k, 3, 3) from tool to base axes.
        axes: (k, n, 3) unit vectors of the joints.
        arms: (k, n, 3) from each joint to the tool's origin [m].
        slides: (n,) joints that slide along their axis; None: all turn about it.
        coupling: (n, n) positions of the joints by those of coupled drives; None: each its own. It
            turns rates, speeds, torques and stiffness into the drives'.
    """

    position: FloatArray
    rotation: FloatArray
    axes: FloatArray
    arms: FloatArray
    slides: BoolArray | None = None
    coupling: FloatArray | None = None

    @property
    def rates(self) -> FloatArray:
        """(k, n, 3) angular velocity of the tool by each joint: none by one that slides."""
        return self._by_drives(self._joint_rates)

    @property
    def speeds(self) -> FloatArray:
        """(k, n, 3) velocity of the tool's origin by each joint."""
        return self._by_drives(self._joint_speeds)

    @property
    def _joint_rates(self) -> FloatArray:
        return self.axes if self.slides is None else self.axes * ~self.slides[:, None]

    @property
    def _joint_speeds(self) -> FloatArray:
        turned = _cross(self.axes, self.arms)
        return turned if self.slides is None else np.where(self.slides[:, None], self.axes, turned)

    def _by_drives(self, moved: FloatArray) -> FloatArray:
        return moved if self.coupling is None else self.coupling.T @ moved

    @property
    def jacobian(self) -> FloatArray:
        """(k, 6, n) from joint rates to the tool's origin's velocity, then angular velocity."""
        return np.concatenate([self.speeds, self.rates], axis=-1).swapaxes(-1, -2)

    def torque(self, wrench: FloatArray) -> FloatArray:
        """(k, n) torques J^T w [N m], forces [N] where they slide, of wrenches (k, 6) in base."""
        lever = _cross(self.arms, wrench[:, None, :3]) + wrench[:, None, 3:]
        if self.slides is not None:
            lever = np.where(self.slides[:, None], wrench[:, None, :3], lever)
        torque = np.asarray(np.einsum("kij,kij->ki", self.axes, lever))
        return torque if self.coupling is None else torque @ self.coupling

    def complementary_stiffness(self, wrench: FloatArray, follows: bool = False) -> FloatArray:
        """(k, n, n) K_C of (4.14): column j is the torques' derivative by joint j [N m/rad].

        With v_j = z_j x r_j the tool's velocity by joint j, the force's part is f . (z_i x v_j) for
        joints j from i on and f . (z_j x v_i) for those before i; the torque's part m . (z_j x z_i)
        exists for joints before i only, as only they turn its axis.

        Args:
            wrench: (k, 6) on the tool, base axes.
            follows: the wrench turns with the tool (a sensor's readings) instead of keeping its
                direction in the base (a dead weight).
        """
        # As products of matrices, with f . (z x v) = (f x z) . v.
        speeds, rates = self._joint_speeds, self._joint_rates
        by_force = _cross(wrench[:, None, :3], rates)
        by_moment = _cross(wrench[:, None, 3:], rates)
        upper = by_force @ speeds.swapaxes(1, 2)
        lower = upper.swapaxes(1, 2)
        turned = rates @ by_moment.swapaxes(1, 2)
        n = rates.shape[1]
        before = np.tril(np.ones((n, n)), -1)
        found = upper * (1.0 - before) + (lower + turned) * before
        found = np.asarray(found - lower - turned if follows else found)
        return found if self.coupling is None else self.coupling.T @ found @ self.coupling


def _times(matrices: FloatArray, matrix: FloatArray) -> FloatArray:
    """(k, 3, m) products of matrices (k, 3, 3) with one (3, m), as a single product."""
    flat = np.ascontiguousarray(matrices).reshape(-1, 3) @ matrix
    return np.asarray(flat.reshape(matrices.shape[0], 3, matrix.shape[1]))


def _cross(one: FloatArray, other: FloatArray) -> FloatArray:
    """np.cross over the last axis, faster."""
    x, y, z = one[..., 0], one[..., 1], one[..., 2]
    u, v, w = other[..., 0], other[..., 1], other[..., 2]
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


@dataclass(frozen=True, eq=False, repr=False)
class RobotModel:
    """A robot with its tool.

    Attributes:
        name: of the robot, from its URDF.
        joint_names: of the n joints, from the base.
        origins: (n, 3) of each joint's frame, in the frame of the joint before it [m].
        rotations: (n, 3, 3) of each joint's frame, likewise, at joint angle zero.
        joint_axes: (n, 3) unit vectors, in the joints' own frames.
        slides: (n,) joints that slide along their axis.
        limits: (n, 2) of the joint angles [rad], or [m].
        flange: name of the link that carries the tool.
        flange_position: (3,) of the frame that carries the tool, in the last joint's frame [m].
        flange_rotation: (3, 3) likewise.
        tool_position: (3,) of the tool's origin, in the flange's axes [m].
        tool_rotation: (3, 3) from tool to flange axes.
        coupling: (n, n) positions of the joints by those of the drives, where these are coupled (a
            parallelogram, a wrist); None: each joint has its own. With it "joints" of all that is
            computed are the drives; see `drives` and `joints_of`.
    """

    name: str
    joint_names: tuple[str, ...]
    origins: FloatArray
    rotations: FloatArray
    joint_axes: FloatArray
    slides: BoolArray
    limits: FloatArray
    flange: str
    flange_position: FloatArray
    flange_rotation: FloatArray
    tool_position: FloatArray
    tool_rotation: FloatArray
    coupling: FloatArray | None = None

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @property
    def kinematics(self) -> str:
        """Hash of the joints' placement, to a micrometre and a microradian; not of the tool."""
        parts: tuple[FloatArray, ...] = (
            self.origins, self.rotations, self.joint_axes, self.slides.astype(np.float64),
        )  # fmt: skip
        if self.coupling is not None:
            parts += (self.coupling,)
        numbers = np.concatenate([np.round(part, 6).ravel() + 0.0 for part in parts])
        return sha256(numbers.astype("<f8").tobytes()).hexdigest()

    def with_tool(self, position: ArrayLike, rotation: ArrayLike | None = None) -> RobotModel:
        """Return the same robot with another tool, such as a virtual spindle's end point.

        Args:
            position: (3,) of the tool's origin, flange axes [m].
            rotation: (3, 3) from tool to flange axes; None: parallel to the flange.

        Raises:
            ShapeError: if one has another shape, is not finite or is no rotation.
        """
        turned = np.eye(3) if rotation is None else rotation_matrix("rotation", rotation)
        return replace(
            self, tool_position=finite_array("position", position, (3,)), tool_rotation=turned
        )

    def drives(self, joints: FloatArray) -> FloatArray:
        """(..., n) positions of the drives at (..., n) positions of the joints [rad, m]."""
        return joints if self.coupling is None else joints @ np.linalg.inv(self.coupling).T

    def joints_of(self, drives: FloatArray) -> FloatArray:
        """(..., n) positions of the joints at (..., n) positions of the drives [rad, m]."""
        return drives if self.coupling is None else drives @ self.coupling.T

    def coupled(self, coupling: ArrayLike) -> RobotModel:
        """Return the same robot with drives that move several joints.

        Args:
            coupling: (n, n) positions of the joints by those of the drives; the identity without.

        Raises:
            ConfigError: if it has no inverse, or mixes joints that turn with such that slide.
            ShapeError: if it has another shape or is not finite.
        """
        matrix = finite_array("coupling", coupling, (self.n, self.n))
        mixed = matrix[self.slides[:, None] != self.slides[None, :]]
        if mixed.any() or not np.linalg.cond(matrix) < WORST_COUPLING:
            raise ConfigError(
                "coupling: expected a matrix with an inverse, that couples joints which turn with "
                f"each other, or such that slide, got {matrix.tolist()}"
            )
        return replace(self, coupling=matrix)

    def posture(self, joints: FloatArray) -> Posture:
        """Kinematics at (k, n) joint positions [rad, m], unchecked."""
        joints = self.joints_of(joints)
        k, n = joints.shape[0], self.n
        position, rotation = np.zeros((k, 3)), np.broadcast_to(np.eye(3), (k, 3, 3))
        points, axes = np.empty((k, n, 3)), np.empty((k, n, 3))
        for j in range(n):
            position = position + rotation @ self.origins[j]
            rotation = _times(rotation, self.rotations[j])
            points[:, j], axes[:, j] = position, rotation @ self.joint_axes[j]
            if self.slides[j]:
                position = position + joints[:, j, None] * axes[:, j]
                continue
            cross = cross_matrix(self.joint_axes[j])
            sine = np.sin(joints[:, j])[:, None, None]
            versine = (1.0 - np.cos(joints[:, j]))[:, None, None]
            turned = _times(rotation, np.hstack([cross, cross @ cross]))
            rotation = rotation + sine * turned[:, :, :3] + versine * turned[:, :, 3:]
        position = position + rotation @ self.flange_position
        rotation = rotation @ self.flange_rotation
        position = position + rotation @ self.tool_position
        arms = position[:, None, :] - points
        slides = self.slides if self.slides.any() else None
        turned = rotation @ self.tool_rotation
        return Posture(position, turned, axes, arms, slides, self.coupling)

    def forward(self, joints: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Pose of the tool.

        Args:
            joints: (6,) angles [rad].

        Returns:
            (3,) of its origin [m] and (3, 3) from tool to base axes.

        Raises:
            ShapeError: if joints has another shape or is not finite.
        """
        posture = self.posture(finite_array("joints", joints, (self.n,))[None])
        return posture.position[0], posture.rotation[0]

    def jacobian(self, joints: ArrayLike, offset: ArrayLike = (0.0, 0.0, 0.0)) -> FloatArray:
        """Geometric Jacobian at a point of the tool, base axes.

        Args:
            joints: (6,) angles [rad].
            offset: (3,) of the point from the tool's origin, tool axes [m].

        Returns:
            (6, 6) from joint rates [rad/s] to the point's velocity [m/s], angular velocity [rad/s].

        Raises:
            ShapeError: if an argument has another shape or is not finite.
        """
        return np.asarray(self._at(joints, offset).jacobian[0])

    def complementary_stiffness(
        self,
        joints: ArrayLike,
        wrench: ArrayLike,
        offset: ArrayLike = (0.0, 0.0, 0.0),
        follows: bool = False,
    ) -> FloatArray:
        """K_C of (4.14): how the torques of a wrench change with the joints.

        Args:
            joints: (6,) angles [rad].
            wrench: (6,) on the tool at the point, base axes [N, N m].
            offset: (3,) of the point from the tool's origin, tool axes [m].
            follows: whether the wrench turns with the tool; see Posture.

        Returns:
            (6, 6), column j the derivative of J^T w by joint j [N m/rad].

        Raises:
            ShapeError: if an argument has another shape or is not finite.
        """
        load = finite_array("wrench", wrench, (6,))
        posture = self._at(joints, offset)
        return np.asarray(posture.complementary_stiffness(load[None], follows)[0])

    def _at(self, joints: ArrayLike, offset: ArrayLike) -> Posture:
        posture = self.posture(finite_array("joints", joints, (self.n,))[None])
        moved = posture.rotation @ finite_array("offset", offset, (3,))
        return replace(
            posture, position=posture.position + moved, arms=posture.arms + moved[:, None, :]
        )


def load_robot(
    path: str | Path | None = None,
    tool_frame: str = "",
    tool_position: ArrayLike = (0.0, 0.0, 0.0),
    tool_rotation: ArrayLike | None = None,
    *,
    locked: Mapping[str, float] | None = None,
    least: int = JOINTS,
) -> RobotModel:
    """Read a robot from its URDF: the chain of joints from the base to the link with the tool.

    Joints beside the chain (grippers, balancers) are ignored.

    Args:
        path: URDF, or YAML or CSV of Denavit-Hartenberg parameters (denavit_hartenberg.py); None:
            the bench's IRB 1600-6/1.45.
        tool_frame: link that carries the tool; empty: tool0 or flange, else the only link that
            carries no other, never one with a camera's or a gripper's name.
        tool_position: (3,) of the tool's origin in that link's axes [m].
        tool_rotation: (3, 3) from tool to that link's axes; None: parallel.
        locked: positions of joints that are held and count as fixed, by name [rad, m].
        least: joints that the chain must have.

    Raises:
        ConfigError: if the file cannot be used, or the frame is not on the last link.
        ShapeError: if the tool's placement has another shape, is not finite or no rotation.
    """
    source = Path(rig_file("robot.urdf", path))
    if source.suffix.lower() in ENDINGS:
        return _of_parameters(source, tool_frame, locked, least).with_tool(
            tool_position, tool_rotation
        )
    try:
        arm = read_serial_arm(source, tool_frame, sliding=True, locked=locked)
    except NotSerialError as error:
        if tool_frame:
            raise ConfigError(
                f"{source}: expected a frame named {tool_frame!r}, got none that a chain of joints "
                f"leads to: {error}"
            ) from error
        raise ConfigError(f"{error}; name the link that carries the tool (--tip)") from error
    if len(arm.joints) < least:
        got = ", ".join(arm.joints)
        if tool_frame:
            raise ConfigError(
                f"{source}: expected {tool_frame!r} behind the last joint, got one behind {got}"
            )
        raise ConfigError(
            f"{source}: expected a chain of {least} revolute joints or more, got {got}; make "
            "the others fixed"
        )
    return _model(arm).with_tool(tool_position, tool_rotation)


def _of_parameters(
    source: Path, tool_frame: str, locked: Mapping[str, float] | None, least: int
) -> RobotModel:
    """Robot of a table of Denavit-Hartenberg parameters."""
    if tool_frame:
        raise ConfigError(
            f"{source}: expected no name of a link, as a table of parameters has none, got "
            f"{tool_frame!r}; the tool is stated from its last frame"
        )
    arm = read_dh(source, locked)
    if len(arm.joints) < least:
        raise ConfigError(
            f"{source}: expected {least} joints or more, got {len(arm.joints)}: "
            f"{', '.join(arm.joints)}"
        )
    return _model(arm)


def _model(arm: SerialArm) -> RobotModel:
    """Robot without a tool."""
    return RobotModel(
        name=arm.name,
        joint_names=arm.joints,
        origins=arm.origins,
        rotations=arm.rotations,
        joint_axes=arm.axes,
        slides=arm.slides,
        limits=arm.limits,
        flange=arm.flange,
        flange_position=arm.flange_position,
        flange_rotation=arm.flange_rotation,
        tool_position=np.zeros(3),
        tool_rotation=np.eye(3),
    )
