# SPDX-License-Identifier: Apache-2.0
"""The robot that holds the platform: a Target that moves and deflects."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.checks import FloatArray, finite_array, in_range
from cabols_control.compiling import njit
from cabols_control.serial_arms.arm import SerialArm
from cabols_hw.abb.configurations import RobotConfigurations, load_configurations
from cabols_sim.devices.robot.flexible import JointTables, deflect_into
from cabols_sim.devices.robot.kinematics import Arm, Chain, kinematics_into
from cabols_sim.devices.robot.robot_config import RobotConfig, load_robot_truth
from cabols_sim.devices.robot.trajectory import Motion, duration_s

NOWHERE = -1
"""Target index of a robot that stands, or moves, at no stored configuration."""

FASTEST = 0.25
"""Of the platform's origin in any motion [m/s]."""

STILL_RAD = 1e-12
"""Largest change of the joints that leaves the pose as it is, without new cable lengths [rad]."""


@njit(cache=True)
def _settle_into(
    encoders: FloatArray,
    wrench: FloatArray,
    share: float,
    chain: Chain,
    tables: JointTables,
    memory: tuple[FloatArray, FloatArray],
    placement: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
) -> bool:
    """Deflect the joints and place the platform; return whether it has moved.

    Args:
        encoders: (6,) angles on the motors' side [rad].
        wrench: (6,) on the platform, base axes [N, N m].
        share: of the way to the balance in this step.
        chain: of the arm, as kinematics_into takes it.
        tables: of the joints, as deflect_into takes them.
        memory: slip and deflection of the joints; updated.
        placement: true joints, the platform's position and rotation, jacobian; updated.
    """
    slip, deflection = memory
    joints, position, rotation, jacobian = placement
    deflect_into(jacobian, wrench, share, tables, slip, deflection)
    moved = 0.0
    for j in range(6):
        moved = max(moved, abs(encoders[j] + deflection[j] - joints[j]))
    if moved < STILL_RAD:
        return False
    for j in range(6):
        joints[j] = encoders[j] + deflection[j]
    kinematics_into(joints, chain, position, rotation, jacobian)
    return True


class RobotTarget:
    """Flexible-joint robot with stored configurations; encoders do not measure the deflection.

    Attributes:
        position: (3,) true platform origin, {0} [m].
        rotation: (3, 3) true, from platform to {0} axes.
        encoders: (6,) angles on the motors' side [rad].
        joint_speed: (6,) of the encoders [rad/s].
        joints: (6,) true angles, encoders plus deflection [rad].
        jacobian: (6, 6) at the platform's origin, true joints.
        target_index: configuration that it stands at or moves to; NOWHERE after a stop.
        disabled: True holds it still and refuses motions (its own emergency stop).
        arm: its kinematics.
    """

    def __init__(
        self,
        config: RobotConfig | None = None,
        configurations: RobotConfigurations | None = None,
        serial: SerialArm | None = None,
    ) -> None:
        """Stand unloaded at the first configuration; None stands for the bench's.

        Raises:
            ConfigError: if the bench's files cannot be used.
        """
        config = config or load_robot_truth()
        self._config = config
        self._configurations = configurations or load_configurations()
        angles = config.base_rotation_xyz_deg
        self.arm = Arm(
            config.base_position,
            Rotation.from_euler("XYZ", angles, degrees=True).as_matrix(),
            self._configurations.tool_position,
            self._configurations.tool_rotation,
            serial,
        )
        self._flexible = config.joints()
        self.encoders = self._configurations.joints(0)
        self.joint_speed = np.zeros(6)
        self.joints = self.encoders.copy()
        self.position, self.rotation, self.jacobian = self.arm.solve(self.joints)
        self.target_index = 0
        self.disabled = False
        self._motion: Motion | None = None
        self._tables = self._flexible.tables
        # Compile or load a step's kernels: the first sample would otherwise be seconds late.
        self.step(np.zeros(6), 1e-3)

    @property
    def moving(self) -> bool:
        """Whether a motion is under way."""
        return self._motion is not None

    @property
    def arrived(self) -> bool:
        """Whether it stands at configuration target_index."""
        return self._motion is None and self.target_index != NOWHERE

    @property
    def deflection(self) -> FloatArray:
        """(6,) of the joints [rad]."""
        return self._flexible.deflection.copy()

    @property
    def platform_speed(self) -> float:
        """Speed of the platform's origin by the joints' motion [m/s]."""
        if self._motion is None:
            return 0.0
        return float(np.linalg.norm(self.jacobian[:3] @ self.joint_speed))

    @property
    def twist(self) -> FloatArray:
        """(6,) velocity by the joints' motion, without deflections [m/s], [rad/s], base axes."""
        if self._motion is None:
            return np.zeros(6)
        return np.asarray(self.jacobian @ self.joint_speed)

    def move_to(self, goal: int | FloatArray, speed_scale: float = 1.0, speed: float = 0.0) -> bool:
        """Begin a motion from where it stands.

        Args:
            goal: index of a stored configuration, or (6,) angles [rad].
            speed_scale: of the platform's speed limit, over 0 to 1.
            speed: in place of that limit [m/s]; 0: the limit.

        Returns:
            False if a motion is under way or the robot is disabled: nothing was begun.

        Raises:
            CabolsError: if there is no such configuration or the scale is none.
        """
        by_index = isinstance(goal, (int, np.integer))
        joints = (
            self._configurations.joints(int(goal)) if by_index else finite_array("goal", goal, (6,))
        )
        limit = in_range("speed", speed, 1e-4, FASTEST) if speed else self._config.speed
        most = limit * in_range("speed_scale", speed_scale, 0.01, 1.0)
        if self.moving or self.disabled:
            return False
        config = self._config
        time_s = duration_s(
            self.arm, self.encoders, joints, most, config.joint_speed, config.joint_acceleration
        )
        self.target_index = int(goal) if by_index else NOWHERE
        if time_s > 0.0:
            self._motion = Motion(self.encoders, joints, time_s, config.brake)
        return True

    def stop(self) -> None:
        """Brake along the path; the robot then stands at no stored configuration."""
        if self._motion is not None:
            self._motion.stop()

    def step(self, wrench: FloatArray, dt_s: float) -> bool:
        """Advance under the (6,) cable wrench (base axes); return whether the pose has changed.

        Args:
            wrench: (6,) of the cables on the platform [N, N m], base axes.
            dt_s: time to advance [s].
        """
        if self._motion is not None:
            self._move(dt_s)
        share = 1.0 - np.exp(-dt_s / self._flexible.lag_s)
        moved: bool = _settle_into(
            self.encoders,
            wrench,
            share,
            self.arm.chain,
            self._tables,
            (self._flexible.slip, self._flexible.deflection),
            (self.joints, self.position, self.rotation, self.jacobian),
        )
        return moved

    def _move(self, dt_s: float) -> None:
        motion = self._motion
        assert motion is not None
        if self.disabled:
            motion.stop()
        motion.advance_into(dt_s, self.encoders, self.joint_speed)
        if motion.finished:
            # In this order: a reader in another thread must not take a stop for an arrival.
            if not motion.arrived:
                self.target_index = NOWHERE
            self._motion = None
