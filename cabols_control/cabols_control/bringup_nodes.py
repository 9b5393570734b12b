# SPDX-License-Identifier: Apache-2.0
"""Nodes and arguments of this package, and what nodes of all packages take."""

from __future__ import annotations

from cabols_control.bringup.specs import Argument, NodeSpec, PackageNodes, Role
from cabols_control.rig_folder import BENCH
from cabols_control.topics import NAMESPACE, RECORDED

OF_EVERY_NODE = ("rig", "geometry_file", "limbs_file", "control_file")
"""Arguments of every node: which rig it is."""
LOAD_RIG = "cabols_control.rig:load_rig"
OF_EVERY_LOOP = (*OF_EVERY_NODE, "fifo_priority", "lock_memory")
"""Of every node that gets a real-time priority: all but the console."""

SUPERVISOR = NodeSpec(
    "cabols_control",
    "supervisor",
    ("limb_state", "platform_pose", "loop_status"),
    ("mode", "loop_status"),
    role=Role.CONTROLLER,
    takes=(
        *OF_EVERY_LOOP,
        "other_cpu",
        "state_timeout",
        "operator_timeout",
        "auto_start",
    ),
    fifo_below=2,
)
LIMB_CONTROLLER = NodeSpec(
    "cabols_control",
    "limb_controller",
    ("limb_state", "tension_command", "mode"),
    ("motor_current", "loop_status"),
    role=Role.CONTROLLER,
    takes=(
        *OF_EVERY_LOOP,
        "command_timeout",
        "other_cpu",
    ),
)
WRENCH_CONTROLLER = NodeSpec(
    "cabols_control",
    "wrench_controller",
    ("wrench", "desired_wrench", "desired_tension", "platform_pose", "mode"),
    ("tension_command", "frame_wrench", "loop_status"),
    role=Role.CONTROLLER,
    takes=(
        *OF_EVERY_LOOP,
        "tension_method",
        "other_cpu",
    ),
    fifo_below=1,
)
LOAD_PROGRAM = NodeSpec(
    "cabols_control",
    "load_program",
    ("mode", "wrench"),
    ("desired_wrench", "program_wrench", "loop_status"),
    role=Role.PROGRAM,
    takes=(
        *OF_EVERY_LOOP,
        "other_cpu",
        "program",
        "scale",
        "preview",
        "learn",
        "exit_when_done",
    ),
    fifo_below=2,
)
RECORDER = NodeSpec(
    "cabols_control",
    "recorder",
    RECORDED,
    ("loop_status",),
    role=Role.RECORDER,
    takes=(
        *OF_EVERY_LOOP,
        "cpu",
        "record_at_start",
        "free_space",
        "split_size",
        "split_duration",
        "output",
        "description",
        "record_also",
    ),
    fifo_below=1,
)
CONSOLE = NodeSpec(
    "cabols_control",
    "console",
    ("mode", "loop_status"),
    ("operator_heartbeat", "loop_status"),
    role=Role.CONSOLE,
    restarts=True,
    takes=(
        *OF_EVERY_NODE,
        "other_cpu",
        "console_port",
        "console_host",
        "token_file",
        "foxglove_port",
        "campaigns",
        "uploads",
    ),
)
FRAMES = NodeSpec(
    "cabols_control",
    "frames",
    (),
    ("loop_status",),
    role=Role.FRAMES,
    restarts=True,
    takes=(
        *OF_EVERY_NODE,
        "other_cpu",
        "frame_prefix",
        "robot_position",
        "robot_rotation_xyz_deg",
    ),
)
POSE_ESTIMATOR = NodeSpec(
    "cabols_control",
    "pose_estimator",
    (),
    ("estimated_pose", "pose_agreement", "loop_status"),
    role=Role.ESTIMATOR,
    restarts=True,
    takes=(*OF_EVERY_NODE, "other_cpu"),
)
ROS2_CONTROL_BRIDGE = NodeSpec(
    "cabols_control",
    "ros2_control_bridge",
    ("limb_state", "wrench", "mode", "limb_joint_commands"),
    ("desired_tension", "limb_joint_states", "loop_status"),
    role=Role.ROS2_CONTROL,
    restarts=True,
    takes=(*OF_EVERY_NODE, "other_cpu", "joint_state_rate"),
)
ARGUMENTS = (
    Argument(
        "params_file",
        "",
        "YAML of any parameters of any nodes, as the command parameters_file writes it; arguments "
        "that are given go before it",
    ),
    Argument("namespace", NAMESPACE, "of all nodes; rigs of different ones do not meet"),
    Argument(
        "nodes",
        "",
        "names, by commas, of those to start; empty: all; of one rig on several hosts each launch "
        "starts its own",
    ),
    Argument(
        "log_level",
        "info",
        "of all nodes",
        choices=("debug", "info", "warn", "error", "fatal"),
    ),
    Argument("rig", BENCH, "name of an installed rig, or folder of a rig"),
    Argument(
        "geometry_file",
        "",
        "YAML of the geometry; empty: the rig's",
        reader=LOAD_RIG,
        keyword="geometry",
    ),
    Argument(
        "limbs_file",
        "",
        "YAML of the limbs; empty: the rig's",
        reader=LOAD_RIG,
        keyword="limbs",
    ),
    Argument(
        "control_file",
        "",
        "YAML of the control design; empty: the rig's",
        reader=LOAD_RIG,
        keyword="control",
    ),
    Argument(
        "command_timeout",
        0.0,
        "age of a tension command that stops the motion; 0: the control file's",
        bounds=(0.0, 0.2),
        unit="s",
    ),
    Argument(
        "tension_method",
        "",
        "min_norm, p_norm, barycentre or analytic_centre; empty: the control file's",
    ),
    Argument(
        "fifo_priority",
        0,
        "SCHED_FIFO priority of bridge and limb controller, from 3; wrench controller and "
        "recorder get 1 less, the other nodes, whose locks the loops may meet, 2 less; 0: none",
        bounds=(0, 99),
    ),
    Argument(
        "cpu_latency_us",
        -1,
        "longest wake-up of any core while the bridge runs; 0: cores poll, -1: leave",
        bounds=(-1, 1000000),
        unit="us",
    ),
    Argument("lock_memory", False, "keep all pages of the control path in memory"),
    Argument(
        "cpu",
        -1,
        "core for the bridge, the recorder, the robot's bridge and the simulated devices; -1: any",
        bounds=(-1, 1023),
    ),
    Argument(
        "other_cpu",
        -1,
        "core for the other nodes; -1: any",
        parameter="cpu",
        bounds=(-1, 1023),
    ),
    Argument("record", True, "record a bag"),
    Argument("record_at_start", True, "false: the recorder waits for its service"),
    Argument(
        "free_space",
        0.5,
        "space on the disk without which nothing is recorded; below it a test is ended in order",
        bounds=(0.0, 1e6),
        unit="GB",
    ),
    Argument(
        "split_size",
        0.0,
        "of a bag's file, at which another one begins; 0: one file",
        bounds=(0.0, 1e6),
        unit="GB",
    ),
    Argument(
        "split_duration",
        0.0,
        "of a bag's file, after which another one begins; 0: one file",
        bounds=(0.0, 1e6),
        unit="s",
    ),
    Argument("frames", False, "publish /tf, /tf_static and robot_description (needs tf2_msgs)"),
    Argument(
        "pose_estimator",
        False,
        "hold robot, encoders, sensor and tracker against each other, and name what disagrees",
    ),
    Argument(
        "ros2_control",
        False,
        "let controllers of ros2_control command the limbs' tensions (docs/ros2_control.md)",
    ),
    Argument(
        "joint_state_rate",
        100.0,
        "of limb_joint_states, for ros2_control",
        bounds=(1.0, 1000.0),
        unit="Hz",
    ),
    Argument("frame_prefix", "", "before each frame's name on /tf, such as rig2/"),
    Argument("console", False, "serve the operator's page on this machine"),
    Argument(
        "console_port",
        8080,
        "TCP port of the operator's page; 0: any free one",
        parameter="port",
        bounds=(0, 65535),
    ),
    Argument(
        "console_host",
        "127.0.0.1",
        "address of the operator's page; another than loopback needs a token_file",
        parameter="host",
    ),
    Argument(
        "token_file",
        "",
        "file whose first line is demanded of the page's visitors; empty: none",
    ),
    Argument(
        "foxglove_port",
        0,
        "TCP port of a WebSocket for Foxglove on loopback; 0: none",
        bounds=(0, 65535),
    ),
    Argument("campaigns", "campaigns", "folder of stiffness campaigns"),
    Argument("uploads", "console/programs", "folder of uploaded programmes"),
    Argument("output", "", "folder of the bag; empty: bags/cabols_<time>"),
    Argument("description", "", "text about the run for the bag's metadata"),
    Argument(
        "record_also",
        "",
        "further topics of the bag, separated by commas: /diagnostics, /rosout, /tf, /tf_static, "
        "NAME:PACKAGE/msg/TYPE",
    ),
    Argument("program", "", "load programme to run at the first LOADING"),
    Argument("scale", 1.0, "factor on the programme's wrench", bounds=(-10.0, 10.0)),
    Argument("preview", True, "follow programmes without lag: smoothed, and previewed"),
    Argument("learn", False, "learn from each run of a programme for its next one; needs preview"),
    Argument("exit_when_done", False, "end everything after the programme"),
    Argument(
        "state_timeout",
        0.2,
        "longest silence of limb states until the supervisor stops",
        bounds=(0.01, 10.0),
        unit="s",
    ),
    Argument(
        "operator_timeout",
        10.0,
        "longest silence of a console in command while anything moves",
        bounds=(0.5, 86400.0),
        unit="s",
    ),
    Argument("auto_start", False, "pre-tighten and load without a request"),
)
NODES = PackageNodes(
    (
        SUPERVISOR,
        LIMB_CONTROLLER,
        WRENCH_CONTROLLER,
        LOAD_PROGRAM,
        RECORDER,
        CONSOLE,
        FRAMES,
        POSE_ESTIMATOR,
        ROS2_CONTROL_BRIDGE,
    ),
    ARGUMENTS,
)
