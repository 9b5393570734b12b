# SPDX-License-Identifier: Apache-2.0
"""A rig's robot against its configurations and its cables: another robot.urdf with old numbers."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.geometry import RigGeometry
from cabols_control.naming import configuration_name
from cabols_control.rig_checks import Findings
from cabols_hw.abb.configurations import RobotConfigurations
from cabols_sim.devices.robot.kinematics import Arm

NEAR_M, NEAR_DEG = 0.05, 5.0
"""Distance of the first configuration from the cables' reference pose that needs no question."""


def check_robot(arm: Arm, configurations: RobotConfigurations, geometry: RigGeometry) -> Findings:
    """Look at where the robot holds the platform.

    Args:
        arm: at its place in the rig, with the platform at its flange.
        configurations: stored joint angles.
        geometry: attachment points and reference pose of the cables.
    """
    serial, found = arm.serial, Findings()
    lowest, highest = serial.limits.T
    low, high = geometry.base_points.min(axis=0), geometry.base_points.max(axis=0)
    for k in range(len(configurations)):
        joints, name = configurations.joints(k), configuration_name(k)
        outside = ~((joints >= lowest) & (joints <= highest))
        for j in np.nonzero(outside)[0]:
            least, most = np.rad2deg(serial.limits[j])
            found.refused.append(
                f"{name}: {serial.joints[j]}: expected {least:.4g} to {most:.4g} deg of "
                f"robot.urdf, got {np.rad2deg(joints[j]):.4g}"
            )
        position = arm.solve(joints)[0]
        if not ((position >= low) & (position <= high)).all():
            found.refused.append(
                f"{name}: expected the platform between the cables' base points, got it at "
                f"{_place(position)}; are configurations and robot.urdf of one robot?"
            )
    position, rotation, _ = arm.solve(configurations.joints(0))
    away = float(np.linalg.norm(position - geometry.reference_position))
    turn = Rotation.from_matrix(geometry.reference_rotation.T @ rotation).magnitude()
    angle = float(np.rad2deg(turn))
    found.read = (
        f"robot {serial.name} of {len(serial.joints)} joints, {len(configurations)} "
        f"configurations; the first {away * 1000.0:.1f} mm and {angle:.2f} deg from the reference "
        "pose"
    )
    if not (away <= NEAR_M and angle <= NEAR_DEG):
        found.odd.append(
            f"{configuration_name(0)}: expected within {NEAR_M * 1000.0:g} mm and {NEAR_DEG:g} deg "
            f"of the reference pose of geometry.yaml, got {away * 1000.0:.1f} mm, {angle:.1f} deg"
        )
    return found


def _place(position: np.ndarray) -> str:
    return f"({', '.join(f'{value:.3f}' for value in position)}) m"
