# SPDX-License-Identifier: Apache-2.0
"""A robot with its joints' springs for MuJoCo (MJCF).

Each joint is a spring about its commanded position: `springref` in the file, `qpos_spring` of a
loaded model. So the robot at rest is the flexible one at that command. Masses are not known here:
links are placeholders, and gravity is off.
"""

from __future__ import annotations

from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.checks import FloatArray
from cabols_stiffness.export.springs import Springs
from cabols_stiffness.model.robot import RobotModel

MASS_KG, INERTIA_KGM2 = 1.0, 0.01
"""Of every link: placeholders."""


def to_mujoco(robot: RobotModel, springs: Springs, command: FloatArray) -> str:
    """MJCF of a robot.

    Args:
        robot: with its tool, whose origin becomes the site "tool".
        springs: of its joints.
        command: (n,) positions at which the springs are at rest [rad, m].
    """
    root = Element("mujoco", model=robot.name or "robot")
    SubElement(root, "compiler", angle="radian", autolimits="true")
    SubElement(root, "option", gravity="0 0 0", integrator="implicitfast")
    body = SubElement(root, "worldbody")
    for j, name in enumerate(robot.joint_names):
        place = {"pos": _text(robot.origins[j]), "quat": _quaternion(robot.rotations[j])}
        body = SubElement(body, "body", place, name=f"{name}_link")
        inertia = _text([INERTIA_KGM2] * 3)
        SubElement(body, "inertial", pos="0 0 0", mass=f"{MASS_KG:g}", diaginertia=inertia)
        joint = SubElement(body, "joint", name=name)
        joint.set("type", "slide" if robot.slides[j] else "hinge")
        joint.set("axis", _text(robot.joint_axes[j]))
        joint.set("stiffness", f"{springs.stiffness[j]:.9g}")
        joint.set("springref", f"{command[j]:.12g}")
        joint.set("damping", f"{springs.damping[j]:.9g}")
        if springs.friction[j] > 0.0:
            joint.set("frictionloss", f"{springs.friction[j]:.9g}")
        if np.isfinite(robot.limits[j]).all():
            joint.set("range", _text(robot.limits[j]))
    flange = {"pos": _text(robot.flange_position), "quat": _quaternion(robot.flange_rotation)}
    body = SubElement(body, "body", flange, name="flange")
    tool = {"pos": _text(robot.tool_position), "quat": _quaternion(robot.tool_rotation)}
    SubElement(body, "site", tool, name="tool")
    indent(root)
    return tostring(root, encoding="unicode") + "\n"


def _text(values: object) -> str:
    return " ".join(f"{value:.15g}" for value in np.asarray(values, dtype=np.float64))


def _quaternion(matrix: FloatArray) -> str:
    x, y, z, w = Rotation.from_matrix(matrix).as_quat()
    return _text([w, x, y, z])
