# SPDX-License-Identifier: Apache-2.0
"""Nodes and arguments of this package: bridges to card, robot and tracker."""

from __future__ import annotations

from cabols_control.bringup.specs import Argument, NodeSpec, PackageNodes, Role
from cabols_control.bringup_nodes import OF_EVERY_LOOP

BRIDGE = NodeSpec(
    "cabols_hw",
    "q8_ati_bridge",
    ("motor_current", "platform_pose", "path_motion", "mode"),
    ("limb_state", "wrench", "loop_status"),
    role=Role.CLOCK,
    takes=(
        *OF_EVERY_LOOP,
        "card_file",
        "safety_file",
        "bias_file",
        "power_on_check",
        "activate",
        "watchdog",
        "board",
        "cpu_latency_us",
        "cpu",
    ),
)
ROBOT = NodeSpec(
    "cabols_hw",
    "abb_tracker_bridge",
    ("mode",),
    ("platform_pose", "joint_states", "reflector_measurement", "path_motion", "loop_status"),
    role=Role.ROBOT,
    takes=(
        *OF_EVERY_LOOP,
        "robot_configurations_file",
        "tracker_file",
        "robot_address",
        "robot_maker",
        "robot_position",
        "robot_rotation_xyz_deg",
        "password_file",
        "rws_port",
        "rtde_port",
        "egm_port",
        "heartbeat_port",
        "tracker_address",
        "stale_after",
        "cpu",
        "speed",
    ),
    fifo_below=2,
)
ARGUMENTS = (
    Argument(
        "card_file",
        "",
        "YAML of the card's scaling; empty: the rig's",
        reader="cabols_hw.card.config:load_card",
    ),
    Argument(
        "safety_file",
        "",
        "YAML of the safety envelope; empty: the rig's",
        reader="cabols_hw.safety.config:load_safety",
    ),
    Argument(
        "bias_file",
        "",
        "file of the force/torque sensor's bias; empty: in the user's state folder, for the "
        "simulated rig none",
    ),
    Argument(
        "power_on_check",
        "auto",
        "required: nothing but the check first_power_on moves before it has passed; skipped; auto: "
        "required of a rig, skipped for the simulated one",
        choices=("auto", "required", "skipped"),
    ),
    Argument(
        "activate",
        True,
        "false: the amplifiers stay off until `ros2 lifecycle set` of the bridge says activate",
    ),
    Argument("board", "0", "number of the Q8 in this machine", kinds=("rig",)),
    Argument(
        "robot_configurations_file",
        "",
        "YAML of the robot's stored configurations; empty: the rig's",
        reader="cabols_hw.abb.configurations:load_configurations",
    ),
    Argument(
        "tracker_file",
        "",
        "YAML of the laser tracker; empty: the rig's",
        reader="cabols_hw.tracker.config:load_tracker_config",
    ),
    Argument("robot_address", "127.0.0.1", "IP of the robot's controller", kinds=("rig",)),
    Argument(
        "robot_maker", "abb", "abb: EGM and Robot Web Services; ur: RTDE", choices=("abb", "ur")
    ),
    Argument(
        "robot_position",
        [0.0, 0.0, 0.0],
        "origin of the robot's base in the rig's base frame",
        kinds=("rig",),
        bounds=(-1000.0, 1000.0),
        unit="m",
    ),
    Argument(
        "robot_rotation_xyz_deg",
        [0.0, 0.0, 0.0],
        "axes of the robot's base in the rig's, intrinsic x-y-z Euler angles",
        kinds=("rig",),
        bounds=(-360.0, 360.0),
        unit="deg",
    ),
    Argument(
        "password_file",
        "",
        "file whose first line is the robot controller's password; empty: $CABOLS_ROBOT_PASSWORD, "
        "or ABB's default",
        kinds=("rig",),
    ),
    Argument(
        "rtde_port",
        30004,
        "TCP port of RTDE, of robots of Universal Robots",
        kinds=("rig",),
        bounds=(1, 65535),
    ),
    Argument(
        "rws_port",
        80,
        "TCP port of the controller's Robot Web Services",
        kinds=("rig",),
        bounds=(1, 65535),
    ),
    Argument(
        "egm_port",
        6510,
        "UDP port that the controller sends its position to",
        kinds=("rig",),
        bounds=(0, 65535),
    ),
    Argument(
        "heartbeat_port",
        6512,
        "TCP port of the controller's watch of the rig; 0: none, the robot then moves unwatched",
        kinds=("rig",),
        bounds=(0, 65535),
    ),
    Argument("tracker_address", "", "host:port of the tracker's server", kinds=("rig",)),
    Argument(
        "stale_after",
        0.05,
        "age of the robot's newest packet at which its pose is stale",
        bounds=(0.005, 10.0),
        unit="s",
    ),
    Argument(
        "watchdog",
        0.0,
        "age of a motor current that zeroes the outputs; 0: the card file's",
        bounds=(0.0, 0.1),
        unit="s",
    ),
    Argument(
        "speed",
        1.0,
        "below 1: the simulated rig in slow motion",
        kinds=("bench",),
        bounds=(0.01, 1.0),
    ),
)
NODES = PackageNodes((BRIDGE, ROBOT), ARGUMENTS)
