# SPDX-License-Identifier: Apache-2.0
"""The topics of the graph, once: nodes, recorder, bags, table of nodes and docs read this table."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum
from importlib.util import find_spec
from pathlib import Path

NAMESPACE = "/cabols"
LIVE = "live/"
"""A topic's slow copy, for pages and viewers, is named so: see ros/live.py."""


class Quality(Enum):
    """How messages of a topic are delivered (cabols_control.ros.messages.qos says why)."""

    CONTROL = "best effort, newest only; in lockstep reliable and deep"
    MODE = "reliable, newest kept for late readers; in lockstep deep"
    LATCHED = "reliable, newest kept for late readers"
    REPORT = "reliable, 100 deep"
    LIVE = "best effort, newest only"


@dataclass(frozen=True)
class Topic:
    """One topic.

    Attributes:
        name: relative to the namespace.
        type_name: of its messages.
        quality: of their delivery.
        description: one line: from where, what, unit, frame.
        arrays: fields with one value for each cable.
        recorded: whether a recorder takes it by default.
        live: whether there is a slow copy of it.
        in_loop: whether the control loop waits for it; a recorder then lets the loop's own readers
            subscribe first.
    """

    name: str
    type_name: str
    quality: Quality
    description: str
    arrays: tuple[str, ...] = ()
    recorded: bool = True
    live: bool = False
    in_loop: bool = False


_LIMB_ARRAYS = (
    "limb",
    "wound_length",
    "elongation",
    "tension",
    "current",
    "switch_closed",
    "zeroed",
    "cable_speed",
    "cable_acceleration",
)
_ROWS = (
    Topic(
        "limb_state",
        "cabols_msgs/msg/LimbState",
        Quality.CONTROL,
        "state of all limbs, sampled by the bridge every 1 ms: the clock of the graph",
        arrays=_LIMB_ARRAYS,
        live=True,
        in_loop=True,
    ),
    Topic(
        "wrench",
        "geometry_msgs/msg/WrenchStamped",
        Quality.CONTROL,
        "measured force [N] and torque [N m] on the platform, in the platform's axes",
        live=True,
        in_loop=True,
    ),
    Topic(
        "motor_current",
        "cabols_msgs/msg/MotorCurrent",
        Quality.CONTROL,
        "current of each motor [A], the limb controller's answer to limb_state",
        arrays=("limb", "current", "saturated"),
        in_loop=True,
    ),
    Topic(
        "tension_command",
        "cabols_msgs/msg/TensionCommand",
        Quality.CONTROL,
        "setpoint of each tension [N], the wrench controller's answer to wrench",
        arrays=("limb", "tension"),
        live=True,
        in_loop=True,
    ),
    Topic(
        "desired_wrench",
        "geometry_msgs/msg/WrenchStamped",
        Quality.CONTROL,
        "setpoint of the wrench on the platform [N, N m], in the rig's base axes",
    ),
    Topic(
        "program_wrench",
        "cabols_msgs/msg/ProgramWrench",
        Quality.CONTROL,
        "wrench that the running programme asks for, and as smoothed [N, N m], base axes",
        live=True,
    ),
    Topic(
        "frame_wrench",
        "cabols_msgs/msg/FrameWrench",
        Quality.CONTROL,
        "desired and measured wrench [N, N m] in the frame of desired_wrench, about its origin, "
        "and how well the measured one is known",
        live=True,
    ),
    Topic(
        "sensor_tare",
        "geometry_msgs/msg/WrenchStamped",
        Quality.LATCHED,
        "weight of the tool at the tare in force [N, N m], in the platform's axes",
        recorded=False,
    ),
    Topic(
        "desired_tension",
        "cabols_msgs/msg/DesiredTension",
        Quality.CONTROL,
        "setpoint of each tension [N] in place of a wrench, by a campaign",
        arrays=("limb", "tension"),
    ),
    Topic(
        "limb_joint_states",
        "sensor_msgs/msg/JointState",
        Quality.LIVE,
        "for ros2_control: wound length [m], its rate [m/s], tension [N] of each limb, and the "
        "wrench on the platform [N, N m]",
        recorded=False,
    ),
    Topic(
        "limb_joint_commands",
        "sensor_msgs/msg/JointState",
        Quality.LIVE,
        "from ros2_control: efforts that are setpoints of the limbs' tensions [N]",
        recorded=False,
    ),
    Topic(
        "platform_pose",
        "geometry_msgs/msg/PoseStamped",
        Quality.CONTROL,
        "pose of the platform in the rig's base frame [m], from the robot",
        live=True,
    ),
    Topic(
        "desired_pose",
        "geometry_msgs/msg/PoseStamped",
        Quality.REPORT,
        "where a platform that hangs on its cables is to move, in the rig's base frame [m]",
    ),
    Topic(
        "path_motion",
        "cabols_msgs/msg/PathMotion",
        Quality.CONTROL,
        "motion of the robot under load: speeds that the safety envelope is to allow",
    ),
    Topic(
        "mode",
        "cabols_msgs/msg/Mode",
        Quality.MODE,
        "operating mode, and why, from the supervisor",
    ),
    Topic(
        "loop_status",
        "cabols_msgs/msg/LoopStatus",
        Quality.REPORT,
        "state, fault and counters of every node's loop",
    ),
    Topic(
        "stop",
        "cabols_msgs/msg/Stop",
        Quality.REPORT,
        "emergency stop, by any number of senders, repeated until acknowledged",
    ),
    Topic(
        "stop_received",
        "cabols_msgs/msg/StopReceived",
        Quality.REPORT,
        "acknowledgement of a stop by each node that has acted on it",
    ),
    Topic(
        "true_limb_state",
        "cabols_msgs/msg/LimbState",
        Quality.CONTROL,
        "simulation: state of the limbs without the sensors' errors",
        arrays=_LIMB_ARRAYS,
        recorded=False,
    ),
    Topic(
        "true_wrench",
        "geometry_msgs/msg/WrenchStamped",
        Quality.CONTROL,
        "simulation: wrench of the cables on the platform, in the rig's base axes [N, N m]",
        recorded=False,
    ),
    Topic(
        "joint_states",
        "sensor_msgs/msg/JointState",
        Quality.CONTROL,
        "joint angles of the robot [rad]",
        live=True,
    ),
    Topic(
        "reflector_measurement",
        "cabols_msgs/msg/ReflectorMeasurement",
        Quality.REPORT,
        "each reading of the laser tracker: position of a reflector [m] in the tracker's frame",
    ),
    Topic(
        "estimated_pose",
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        Quality.REPORT,
        "pose of the platform by robot, encoders and sensor together, base frame [m], [rad]",
    ),
    Topic(
        "pose_agreement",
        "cabols_msgs/msg/PoseAgreement",
        Quality.REPORT,
        "robot, encoders, sensor and tracker against each other: which of them disagrees",
    ),
    Topic(
        "stiffness_load",
        "cabols_msgs/msg/StiffnessLoad",
        Quality.REPORT,
        "one completed load of a stiffness campaign, with its window of time",
    ),
    Topic(
        "stiffness_estimate",
        "cabols_msgs/msg/StiffnessEstimate",
        Quality.LATCHED,
        "joint stiffness from the loads so far [N m/rad]",
    ),
    Topic(
        "campaign_status",
        "cabols_msgs/msg/CampaignStatus",
        Quality.LATCHED,
        "where a stiffness campaign stands",
    ),
    Topic(
        "operator_heartbeat",
        "cabols_msgs/msg/OperatorHeartbeat",
        Quality.REPORT,
        "heartbeat of the console whose page is in command",
        recorded=False,
    ),
    Topic(
        "recording",
        "std_msgs/msg/String",
        Quality.LATCHED,
        "folder of the bag in progress; empty: none",
        recorded=False,
    ),
    Topic(
        "markers",
        "visualization_msgs/msg/MarkerArray",
        Quality.REPORT,
        "the rig as shapes for RViz",
        recorded=False,
    ),
)
TOPICS = {row.name: row for row in _ROWS}
RECORDED = tuple(row.name for row in _ROWS if row.recorded)
"""What is recorded unless told otherwise: what a real rig has, too."""


FOREIGN = {
    row.name: row
    for row in (
        Topic(
            "/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", Quality.REPORT, "of all nodes"
        ),
        Topic("/rosout", "rcl_interfaces/msg/Log", Quality.REPORT, "lines of all nodes' logs"),
        Topic("/tf", "tf2_msgs/msg/TFMessage", Quality.REPORT, "frames that move"),
        Topic("/tf_static", "tf2_msgs/msg/TFMessage", Quality.LATCHED, "frames that stand"),
        Topic(
            "/parameter_events",
            "rcl_interfaces/msg/ParameterEvent",
            Quality.REPORT,
            "parameters that were set",
        ),
        Topic("/robot_description", "std_msgs/msg/String", Quality.LATCHED, "URDF of the rig"),
    )
}
"""ROS's own topics, which a recorder can take besides the graph's."""


TOPIC_NAME = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
TYPE_NAME = re.compile(r"[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*")


def foreign_row(text: str) -> Topic:
    """Return the row of a topic that is none of the graph's table.

    Args:
        text: name of one of ROS's own, or NAME:PACKAGE/msg/TYPE, relative to the namespace unless
            it begins with a slash.

    Raises:
        ValueError: if it is neither, or a name of the graph's own.
    """
    name, colon, type_name = text.partition(":")
    if not colon and name in FOREIGN:
        return FOREIGN[name]
    if not (TOPIC_NAME.fullmatch(name) and TYPE_NAME.fullmatch(type_name)):
        raise ValueError(f"expected {', '.join(FOREIGN)} or NAME:PACKAGE/msg/TYPE, got {text!r}")
    if name in (*TOPICS, *FOREIGN):
        raise ValueError(f"expected a topic of the site, got {name!r}, whose type is known here")
    # Matches publishers of every quality.
    return Topic(name, type_name, Quality.LIVE, "of the site")


def type_is_installed(name: str) -> bool:
    """Whether a message type, PACKAGE/msg/TYPE, can be imported; imports nothing."""
    package, _, kind = name.split("/")
    found = find_spec(package)
    for folder in () if found is None else found.submodule_search_locations or ():
        listed = Path(folder, "msg", "__init__.py")
        if listed.is_file() and re.search(rf"\b{kind}\b", listed.read_text(encoding="utf-8")):
            return True
    return False


def topic_row(name: str) -> Topic:
    """Return the row of a topic, or of the topic whose slow copy is named.

    Raises:
        KeyError: if the graph has no such topic.
    """
    return TOPICS[name.removeprefix(LIVE)]
