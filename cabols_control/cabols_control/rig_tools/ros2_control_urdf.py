# SPDX-License-Identifier: Apache-2.0
"""What ros2_control needs in a URDF: the limbs as joints, and the topics that they are on."""

from __future__ import annotations

from xml.etree.ElementTree import Element, SubElement

import numpy as np

from cabols_control.kinematics import cable_lengths
from cabols_control.naming import number
from cabols_control.rig import MOTOR_CURRENT_MAX_A, Rig
from cabols_control.topics import NAMESPACE
from cabols_control.wrench_control.joint_commands import limb_joints, wrench_joints

PLUGIN = "joint_state_topic_hardware_interface/JointStateTopicSystem"
"""Of the package joint_state_topic_hardware_interface, which reads and writes JointState topics."""
STILL = 1e-9
"""Most that a joint of the wrench may move [m, rad]: readers warn of limits that are equal."""
ALWAYS = "-1"
"""Threshold below which the plugin sends a command only when it changes: a silent sender would be
taken for a dead one."""


def add_ros2_control(root: Element, rig: Rig, namespace: str = NAMESPACE) -> None:
    """Add a joint a limb, six for the wrench on the platform, and their tags `ros2_control`.

    A limb's joint slides along its cable at the reference pose: position is the cable wound in [m],
    effort its tension [N]. The wrench's joints never move; their efforts are what the force/torque
    sensor measures, about the platform's origin, in its axes: the plugin fills no sensor's
    interfaces.

    Args:
        root: the rig's URDF, with its links `anchor_1` and so on; changed.
        rig: configuration.
        namespace: of the rig's topics.
    """
    limbs, wrench = limb_joints(rig.geometry.cables), wrench_joints()
    _slides(root, rig, limbs)
    for index, name in enumerate(wrench):
        axis = " ".join("1" if index % 3 == k else "0" for k in range(3))
        kind = "prismatic" if index < len(wrench) // 2 else "revolute"
        limit = {"lower": repr(-STILL), "upper": repr(STILL), "velocity": "0"}
        rated = repr(float(rig.control.rated[index]))
        _joint(root, name, kind, rig.geometry.platform_frame, axis, {**limit, "effort": rated})
    _system(root, "limbs", limbs, namespace, commanded=True)
    _system(root, "platform_wrench", wrench, namespace, commanded=False)


def _slides(root: Element, rig: Rig, names: tuple[str, ...]) -> None:
    geometry = rig.geometry
    turned = geometry.platform_points @ geometry.reference_rotation.T
    along = geometry.base_points - geometry.reference_position - turned
    lengths = cable_lengths(geometry, geometry.reference_position, geometry.reference_rotation)
    for index, name in enumerate(names):
        axis = along[index] / np.linalg.norm(along[index])
        reach = repr(float(lengths[index]))
        limit = {
            "lower": f"-{reach}",
            "upper": reach,
            "velocity": repr(rig.limbs.gain[index] * MOTOR_CURRENT_MAX_A),
            "effort": repr(float(rig.control.tension_max)),
        }
        words = " ".join(repr(float(part)) for part in axis)
        _joint(root, name, "prismatic", f"anchor_{number(index)}", words, limit)


def _joint(
    root: Element, name: str, kind: str, parent: str, axis: str, limit: dict[str, str]
) -> None:
    SubElement(root, "link", name=f"{name}_end")
    joint = SubElement(root, "joint", name=name, type=kind)
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=f"{name}_end")
    SubElement(joint, "axis", xyz=axis)
    SubElement(joint, "limit", limit)


def _system(
    root: Element, name: str, joints: tuple[str, ...], namespace: str, *, commanded: bool
) -> None:
    control = SubElement(root, "ros2_control", name=name, type="system")
    hardware = SubElement(control, "hardware")
    SubElement(hardware, "plugin").text = PLUGIN
    topics = {
        "joint_states_topic": f"{namespace}/limb_joint_states",
        # Those of the wrench have nothing to say; a topic of their own says so to nobody.
        "joint_commands_topic": f"{namespace}/{'limb_joint' if commanded else name}_commands",
        "trigger_joint_command_threshold": ALWAYS if commanded else "0",
    }
    for key, value in topics.items():
        SubElement(hardware, "param", name=key).text = value
    for joint in joints:
        element = SubElement(control, "joint", name=joint)
        if commanded:
            SubElement(element, "command_interface", name="effort")
        # All three of every joint: the plugin writes what a message has.
        for state in ("position", "velocity", "effort"):
            SubElement(element, "state_interface", name=state)
