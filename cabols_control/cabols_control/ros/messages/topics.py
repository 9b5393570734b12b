# SPDX-License-Identifier: Apache-2.0
"""Message types and byte layouts of the topics in cabols_control.topics."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from importlib import import_module

from cabols_msgs.msg import (
    DesiredTension,
    FrameWrench,
    LimbState,
    LoopStatus,
    Mode,
    MotorCurrent,
    PathMotion,
    ProgramWrench,
    TensionCommand,
)
from geometry_msgs.msg import PoseStamped, WrenchStamped

from cabols_control.geometry import RigGeometry
from cabols_control.ros.messages.layout import Layout
from cabols_control.topics import TOPICS, topic_row


@cache
def message_type(topic: str) -> type:
    """Return the message class of a topic, or of its slow copy.

    Args:
        topic: its name in cabols_control.topics, relative to the namespace.

    Raises:
        KeyError: if the graph has no such topic.
    """
    return class_of(topic_row(topic).type_name)


def class_of(type_name: str) -> type:
    """Return the message class of a type such as std_msgs/msg/String.

    Args:
        type_name: its name.

    Raises:
        ModuleNotFoundError: if its package is not installed.
        AttributeError: if the package has no such type.
    """
    package, _, name = type_name.partition("/msg/")
    found: type = getattr(import_module(f"{package}.msg"), name)
    return found


class _Types(Mapping[str, type]):
    """Message classes by topic, imported when they are looked up."""

    def __getitem__(self, topic: str) -> type:
        return message_type(topic)

    def __iter__(self) -> Iterator[str]:
        return iter(TOPICS)

    def __len__(self) -> int:
        return len(TOPICS)


TYPES = _Types()
"""Every topic of the graph, relative to the namespace."""


def _cable_arrays(topic: str, values: int) -> dict[str, int]:
    return dict.fromkeys(topic_row(topic).arrays, values)


def limb_state_layout(geometry: RigGeometry) -> Layout:
    """LimbState of all cables."""
    lengths = _cable_arrays("limb_state", geometry.cables)
    return Layout(LimbState, lengths, {"header.frame_id": geometry.base_frame})


def wrench_layout(frame: str) -> Layout:
    """WrenchStamped in a frame; field `wrench` (6,) force [N], torque [N m]."""
    return Layout(
        WrenchStamped,
        strings={"header.frame_id": frame},
        joined={"wrench": ("wrench.force.x", 6)},
    )


def program_wrench_layout(frame: str) -> Layout:
    """ProgramWrench in a frame; fields `command`, `smoothed` (6,) force [N], torque [N m]."""
    return Layout(
        ProgramWrench,
        strings={"header.frame_id": frame},
        joined={name: (f"{name}.force.x", 6) for name in ("command", "smoothed")},
    )


FRAME_WRENCHES = ("desired", "measured", "uncertainty")
"""Wrenches of a FrameWrench."""


def frame_wrench_layout(frame: str) -> Layout:
    """FrameWrench in a frame; fields `desired`, `measured`, `uncertainty` (6,) [N], [N m]."""
    return Layout(
        FrameWrench,
        strings={"header.frame_id": frame},
        joined={name: (f"{name}.force.x", 6) for name in FRAME_WRENCHES},
    )


def tension_command_layout(geometry: RigGeometry) -> Layout:
    """TensionCommand for all cables."""
    lengths = _cable_arrays("tension_command", geometry.cables)
    return Layout(TensionCommand, lengths, {"header.frame_id": geometry.base_frame})


def desired_tension_layout(geometry: RigGeometry) -> Layout:
    """DesiredTension for all cables."""
    return Layout(DesiredTension, _cable_arrays("desired_tension", geometry.cables))


def motor_current_layout(geometry: RigGeometry, limbs: int) -> Layout:
    """MotorCurrent for a number of limbs."""
    lengths = _cable_arrays("motor_current", limbs)
    return Layout(MotorCurrent, lengths, {"header.frame_id": geometry.base_frame})


def pose_layout(geometry: RigGeometry) -> Layout:
    """PoseStamped in the base frame; field `pose` (7,) position [m], quaternion x y z w."""
    return Layout(
        PoseStamped,
        strings={"header.frame_id": geometry.base_frame},
        joined={"pose": ("pose.position.x", 7)},
    )


def path_motion_layout(geometry: RigGeometry) -> Layout:
    """PathMotion in the base frame."""
    return Layout(PathMotion, strings={"header.frame_id": geometry.base_frame})


def mode_layout(reason: str = "", fault: str = "") -> Layout:
    """Mode with a reason and a fault's name."""
    return Layout(Mode, strings={"reason": reason, "fault": fault})


def loop_status_layout(node: str, reason: str, fault: str = "") -> Layout:
    """LoopStatus of a node with a reason and a fault's name."""
    return Layout(LoopStatus, strings={"node": node, "reason": reason, "fault": fault})
