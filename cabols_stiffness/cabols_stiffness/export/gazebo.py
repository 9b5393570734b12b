# SPDX-License-Identifier: Apache-2.0
"""A robot's URDF with its joints' springs for Gazebo, and the same as SDF.

In URDF stiffness is no part of a joint: it is an extension of Gazebo's, in an element beside it. In
SDF it is part of the joint's dynamics. A spring is about its reference: the commanded position.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import defusedxml.ElementTree as Xml
import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.errors import ConfigError
from cabols_stiffness.export.springs import Springs
from cabols_stiffness.model.robot import RobotModel

MASS_KG, INERTIA_KGM2 = 1.0, 0.01
"""Of every link of the SDF: placeholders; the URDF keeps its own."""

LEVEL = 1e-9
"""Cosine of the pitch below which roll and yaw turn about one axis."""


def to_urdf(path: str | Path, robot: RobotModel, springs: Springs, command: FloatArray) -> str:
    """Text of a URDF with springs; all else stays as it is, but for comments and blanks.

    Args:
        path: of the robot's URDF.
        robot: read from it.
        springs: of its joints.
        command: (n,) positions at which the springs are at rest [rad, m].

    Raises:
        ConfigError: if the file has springs already, or does not hold the joints.
    """
    root = Xml.parse(str(path)).getroot()
    names = {joint.get("name", "") for joint in root.findall("joint")}
    lost = [name for name in robot.joint_names if name not in names]
    there = [one.get("reference", "") for one in root.findall("gazebo")
             if one.find("springStiffness") is not None]  # fmt: skip
    twice = [name for name in there if name in robot.joint_names]
    if lost or twice:
        told = ", ".join(lost or twice)
        what = f"none named {told}" if lost else f"springs of {told} already"
        raise ConfigError(f"{path}: expected the robot's URDF without springs, got {what}")
    for j, name in enumerate(robot.joint_names):
        extension = SubElement(root, "gazebo", reference=name)
        SubElement(extension, "implicitSpringDamper").text = "true"
        SubElement(extension, "springStiffness").text = f"{springs.stiffness[j]:.9g}"
        SubElement(extension, "springReference").text = f"{command[j]:.12g}"
        dynamics = next(one for one in root.findall("joint") if one.get("name") == name)
        _with_dynamics(dynamics, springs, j)
    indent(root)
    return '<?xml version="1.0"?>\n' + tostring(root, encoding="unicode") + "\n"


def _with_dynamics(joint: Element, springs: Springs, j: int) -> None:
    """Damping, and friction where some was found; what the file has stays."""
    dynamics = joint.find("dynamics")
    if dynamics is None:
        dynamics = SubElement(joint, "dynamics")
    if "damping" not in dynamics.attrib:
        dynamics.set("damping", f"{springs.damping[j]:.9g}")
    if springs.friction[j] > 0.0:
        dynamics.set("friction", f"{springs.friction[j]:.9g}")


def to_sdf(robot: RobotModel, springs: Springs, command: FloatArray) -> str:
    """SDF of a robot, its base fixed to the world.

    Args:
        robot: with its tool, whose origin becomes the frame "tool".
        springs: of its joints.
        command: (n,) positions at which the springs are at rest [rad, m].
    """
    root = Element("sdf", version="1.9")
    model = SubElement(root, "model", name=robot.name or "robot")
    _link(model, "base", "")
    fixed = SubElement(model, "joint", name="world_base", type="fixed")
    SubElement(fixed, "parent").text = "world"
    SubElement(fixed, "child").text = "base"
    before = "base"
    for j, name in enumerate(robot.joint_names):
        link = f"{name}_link"
        _link(model, link, name)
        kind = "prismatic" if robot.slides[j] else "revolute"
        joint = SubElement(model, "joint", name=name, type=kind)
        pose = SubElement(joint, "pose", relative_to=before)
        pose.text = _pose(robot.origins[j], robot.rotations[j])
        SubElement(joint, "parent").text = before
        SubElement(joint, "child").text = link
        axis = SubElement(joint, "axis")
        SubElement(axis, "xyz").text = _text(robot.joint_axes[j])
        dynamics = SubElement(axis, "dynamics")
        SubElement(dynamics, "damping").text = f"{springs.damping[j]:.9g}"
        SubElement(dynamics, "friction").text = f"{springs.friction[j]:.9g}"
        SubElement(dynamics, "spring_reference").text = f"{command[j]:.12g}"
        SubElement(dynamics, "spring_stiffness").text = f"{springs.stiffness[j]:.9g}"
        if np.isfinite(robot.limits[j]).all():
            limit = SubElement(axis, "limit")
            SubElement(limit, "lower").text, SubElement(limit, "upper").text = (
                f"{value:.9g}" for value in robot.limits[j]
            )
        before = link
    for name, parent, place, turned in (
        ("flange", before, robot.flange_position, robot.flange_rotation),
        ("tool", "flange", robot.tool_position, robot.tool_rotation),
    ):
        frame = SubElement(model, "frame", name=name, attached_to=parent)
        SubElement(frame, "pose").text = _pose(place, turned)
    indent(root)
    return '<?xml version="1.0"?>\n' + tostring(root, encoding="unicode") + "\n"


def _link(model: Element, name: str, joint: str) -> None:
    link = SubElement(model, "link", name=name)
    if joint:
        SubElement(link, "pose", relative_to=joint).text = "0 0 0 0 0 0"
    inertial = SubElement(link, "inertial")
    SubElement(inertial, "mass").text = f"{MASS_KG:g}"
    inertia = SubElement(inertial, "inertia")
    for axis in ("ixx", "iyy", "izz"):
        SubElement(inertia, axis).text = f"{INERTIA_KGM2:g}"


def _pose(position: FloatArray, rotation: FloatArray) -> str:
    return _text(np.concatenate([position, _angles(rotation)]))


def _angles(rotation: FloatArray) -> FloatArray:
    """(3,) turns about the fixed axes x, y, z, as in URDF; roll zero where only one counts."""
    level = float(np.hypot(rotation[0, 0], rotation[1, 0]))
    pitch = np.arctan2(-rotation[2, 0], level)
    if level < LEVEL:
        return np.array([0.0, pitch, np.arctan2(-rotation[0, 1], rotation[1, 1])])
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    return np.array([roll, pitch, np.arctan2(rotation[1, 0], rotation[0, 0])])


def _text(values: FloatArray) -> str:
    return " ".join(f"{value:.15g}" for value in values)
