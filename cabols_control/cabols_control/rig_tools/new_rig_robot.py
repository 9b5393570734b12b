# SPDX-License-Identifier: Apache-2.0
"""Files of a new rig whose robot is not the bench's: kinematics, configurations, tool."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.configuration import read_yaml
from cabols_control.errors import UsageError
from cabols_control.frames import load_frames
from cabols_control.rig_folder import RigFolder
from cabols_control.rig_tools.robot_placing import FLANGE_AXIS, flange_pose, place_robot
from cabols_control.serial_arms.arm import read_serial_arm

JOINTS = 6


def robot_files(bench: RigFolder, urdf: Path, tip: str = "") -> dict[str, str]:
    """Texts of robot.urdf, robot.yaml and frames.yaml, with another arm at the bench's poses.

    The arm holds the platform where the bench's robot does, from the same side, so that the bench's
    loads are feasible for it. How the platform is fixed to its flange is chosen here.

    Args:
        bench: rig whose poses are taken.
        urdf: of an arm of six joints that turn, its base at the rig's base frame.
        tip: link at the arm's end; empty: as read_serial_arm finds it.

    Returns:
        Texts by file name.

    Raises:
        ConfigError: if the URDF cannot be used, or the arm does not reach a pose.
    """
    arm = read_serial_arm(urdf, tip)
    if len(arm.joints) != JOINTS:
        raise UsageError(f"--robot: {urdf}: expected six joints that turn, got {len(arm.joints)}")
    old = read_serial_arm(bench.file("robot.urdf"))
    tool = load_frames(bench).tool_frame
    angles = np.deg2rad(read_yaml(bench.file("robot.yaml"))["configurations"])
    flanges = [flange_pose(old, joints) for joints in angles]
    positions = np.array([place + turn @ tool.position for place, turn in flanges])
    rotations = np.array([turn @ tool.rotation for _, turn in flanges])
    _, first = flanges[0]
    found = place_robot(arm, positions, rotations, first @ FLANGE_AXIS)
    rows = "\n".join(
        f"  - [{', '.join(f'{angle:.5f}' for angle in joints)}]"
        for joints in np.rad2deg(found.joints)
    )
    robot = (
        f"# Configurations of {arm.name}, in which it holds the platform where the bench's robot\n"
        "# does; made by new_rig. Look at them before the arm moves: collisions were not judged.\n"
        "# The first is configuration 1 to people, index 0 to programs.\n"
        f"configurations:   # deg, joints 1 to 6\n{rows}\n"
    )
    x, y, z, w = Rotation.from_matrix(found.tool_rotation).as_quat()
    place = ", ".join(f"{value:.6f}" for value in found.tool_position)
    frame = (
        "tool_frame:                   # the platform in the robot's flange, chosen by new_rig\n"
        f"  position: [{place}]   # m\n"
        f"  quaternion_wxyz: [{w:.12f}, {x:.12f}, {y:.12f}, {z:.12f}]\n"
    )
    frames = bench.file("frames.yaml").read_text(encoding="utf-8")
    frames = re.sub(r"(?ms)^tool_frame:.*?(?=^tool_mass:)", frame, frames)
    return {
        "robot.urdf": urdf.read_text(encoding="utf-8"),
        "robot.yaml": robot,
        "frames.yaml": frames,
    }
