"""Serial robots of six revolute joints from their URDF: kinematics and complementary stiffness.

pinocchio reads the URDF once. What identification needs is computed here for many configurations
at a time in numpy, where a call of pinocchio per sample would take most of the time; tests compare
the two.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, finite_array, rotation_matrix
from cabols_control.errors import ConfigError
from cabols_control.rig_folder import rig_file
from cabols_control.rotations import cross_matrix

JOINTS = 6


@dataclass(frozen=True, eq=False)
class Posture:
    """Kinematics at k configurations, in the robot's base axes.

    Attributes:
        position: (k, 3) of the tool's origin [m].
        rotation: (k, 3, 3) from tool to base axes.
        axes: (k, 6, 3) unit vectors of the joints.
        arms: (k, 6, 3) from each joint to the tool's origin [m].
    """

    position: FloatArray
    rotation: FloatArray
    axes: FloatArray
    arms: FloatArray

    @property
    def rates(self) -> FloatArray:
        """(k, 6, 3) angular velocity of the tool by each joint."""
        return self.axes

    @property
    def jacobian(self) -> FloatArray:
        """(k, 6, 6) from joint rates to the tool's origin's velocity, then angular velocity."""
        return np.concatenate([_cross(self.axes, self.arms), self.axes], axis=-1).swapaxes(-1, -2)

    def torque(self, wrench: FloatArray) -> FloatArray:
        """(k, 6) joint torques J^T w [N m] of wrenches (k, 6) on the tool, base axes."""
        lever = _cross(self.arms, wrench[:, None, :3]) + wrench[:, None, 3:]
        return np.asarray(np.einsum("kij,kij->ki", self.axes, lever))

    def complementary_stiffness(self, wrench: FloatArray, follows: bool = False) -> FloatArray:
        """(k, 6, 6) K_C of (4.14): column j is the torques' derivative by joint j [N m/rad].

        With v_j = z_j x r_j the tool's velocity by joint j, the force's part is f . (z_i x v_j) for
        joints j from i on and f . (z_j x v_i) for those before i; the torque's part m . (z_j x z_i)
        exists for joints before i only, as only they turn its axis.

        Args:
            wrench: (k, 6) on the tool, base axes.
            follows: the wrench turns with the tool (a sensor's readings) instead of keeping its
                direction in the base (a dead weight).
        """
        # As products of matrices, with f . (z x v) = (f x z) . v.
        speeds = _cross(self.axes, self.arms)
        by_force = _cross(wrench[:, None, :3], self.axes)
        by_moment = _cross(wrench[:, None, 3:], self.axes)
        upper = by_force @ speeds.swapaxes(1, 2)
        lower = upper.swapaxes(1, 2)
        turned = self.axes @ by_moment.swapaxes(1, 2)
        before = np.tril(np.ones((JOINTS, JOINTS)), -1)
        found = upper * (1.0 - before) + (lower + turned) * before
        return np.asarray(found - lower - turned if follows else found)


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
        origins: (6, 3) of each joint's frame, in the frame of the joint before it [m].
        rotations: (6, 3, 3) of each joint's frame, likewise, at joint angle zero.
        joint_axes: (6, 3) unit vectors, in the joints' own frames.
        limits: (6, 2) of the joint angles [rad].
        flange_position: (3,) of the frame that carries the tool, in the last joint's frame [m].
        flange_rotation: (3, 3) likewise.
        tool_position: (3,) of the tool's origin, in the flange's axes [m].
        tool_rotation: (3, 3) from tool to flange axes.
    """

    name: str
    origins: FloatArray
    rotations: FloatArray
    joint_axes: FloatArray
    limits: FloatArray
    flange_position: FloatArray
    flange_rotation: FloatArray
    tool_position: FloatArray
    tool_rotation: FloatArray

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

    def posture(self, joints: FloatArray) -> Posture:
        """Kinematics at (k, 6) joint angles [rad], unchecked."""
        k = joints.shape[0]
        position, rotation = np.zeros((k, 3)), np.broadcast_to(np.eye(3), (k, 3, 3))
        points, axes = np.empty((k, JOINTS, 3)), np.empty((k, JOINTS, 3))
        for j in range(JOINTS):
            position = position + rotation @ self.origins[j]
            rotation = rotation @ self.rotations[j]
            points[:, j], axes[:, j] = position, rotation @ self.joint_axes[j]
            cross = cross_matrix(self.joint_axes[j])
            sine = np.sin(joints[:, j])[:, None, None]
            versine = (1.0 - np.cos(joints[:, j]))[:, None, None]
            rotation = rotation @ (np.eye(3) + sine * cross + versine * (cross @ cross))
        position = position + rotation @ self.flange_position
        rotation = rotation @ self.flange_rotation
        position = position + rotation @ self.tool_position
        return Posture(position, rotation @ self.tool_rotation, axes, position[:, None, :] - points)

    def forward(self, joints: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Pose of the tool.

        Args:
            joints: (6,) angles [rad].

        Returns:
            (3,) of its origin [m] and (3, 3) from tool to base axes.

        Raises:
            ShapeError: if joints has another shape or is not finite.
        """
        posture = self.posture(finite_array("joints", joints, (JOINTS,))[None])
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
        posture = self.posture(finite_array("joints", joints, (JOINTS,))[None])
        moved = posture.rotation @ finite_array("offset", offset, (3,))
        return replace(
            posture, position=posture.position + moved, arms=posture.arms + moved[:, None, :]
        )


def load_robot(
    path: str | Path | None = None,
    tool_frame: str = "",
    tool_position: ArrayLike = (0.0, 0.0, 0.0),
    tool_rotation: ArrayLike | None = None,
) -> RobotModel:
    """Read a robot from its URDF.

    Args:
        path: URDF of a robot with six revolute joints; None: the bench's IRB 1600-6/1.45.
        tool_frame: link that carries the tool; empty: the URDF's last.
        tool_position: (3,) of the tool's origin in that link's axes [m].
        tool_rotation: (3, 3) from tool to that link's axes; None: parallel.

    Raises:
        ConfigError: if the file cannot be used, or the frame is not on the last link.
        ShapeError: if the tool's placement has another shape, is not finite or no rotation.
    """
    source = Path(rig_file("robot.urdf", path))
    try:
        model = pinocchio.buildModelFromUrdf(str(source))
    except (ValueError, RuntimeError) as error:
        raise ConfigError(f"{source}: expected a URDF, got {error}") from error
    chain = model.njoints == JOINTS + 1 and model.nv == model.nq == JOINTS
    if not chain or [int(parent) for parent in model.parents] != [0, *range(JOINTS)]:
        raise ConfigError(
            f"{source}: expected a chain of {JOINTS} revolute joints with limits, got joints "
            f"{', '.join(model.names[1:]) or 'none'}; make the others fixed"
        )
    name = tool_frame or model.frames[len(model.frames) - 1].name
    if not model.existFrame(name):
        known = ", ".join(frame.name for frame in model.frames)
        raise ConfigError(f"{source}: expected a frame named {name!r}, got {known}")
    frame = model.frames[model.getFrameId(name)]
    if frame.parentJoint != JOINTS:
        raise ConfigError(f"{source}: expected {name!r} behind the last joint, got one before it")
    robot = RobotModel(
        name=str(model.name),
        origins=np.array([model.jointPlacements[j + 1].translation for j in range(JOINTS)]),
        rotations=np.array([model.jointPlacements[j + 1].rotation for j in range(JOINTS)]),
        joint_axes=np.array([_axis(model, j + 1, source) for j in range(JOINTS)]),
        limits=np.column_stack([model.lowerPositionLimit, model.upperPositionLimit]),
        flange_position=np.array(frame.placement.translation),
        flange_rotation=np.array(frame.placement.rotation),
        tool_position=np.zeros(3),
        tool_rotation=np.eye(3),
    )
    return robot.with_tool(tool_position, tool_rotation)


def _axis(model: pinocchio.Model, joint: int, source: Path) -> FloatArray:
    data = model.joints[joint].createData()
    model.joints[joint].calc(data, pinocchio.neutral(model), np.zeros(model.nv))
    subspace = np.array(data.S).ravel()
    if subspace.shape != (6,) or np.abs(subspace[:3]).max() > 1e-12:
        raise ConfigError(f"{source}: expected joint {model.names[joint]!r} to be revolute")
    return np.asarray(subspace[3:])
