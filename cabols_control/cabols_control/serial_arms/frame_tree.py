# SPDX-License-Identifier: Apache-2.0
"""The frames of a URDF: where each link is in the one that carries it, at joint positions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.checks import FloatArray

MOVING = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True, eq=False)
class Link:
    """One joint of a URDF, and the link that it carries.

    Attributes:
        joint: its name.
        kind: its type.
        parent: link that carries it.
        child: link that is carried.
        position: (3,) of the child at zero, in the parent [m].
        rotation: (3, 3) from the child's axes, at zero, to the parent's.
        axis: (3,) unit vector, in the child's axes.
    """

    joint: str
    kind: str
    parent: str
    child: str
    position: FloatArray
    rotation: FloatArray
    axis: FloatArray

    @property
    def moves(self) -> bool:
        """Whether a joint's position changes it."""
        return self.kind in MOVING

    def at(self, value: float) -> tuple[FloatArray, FloatArray]:
        """Return position (3,) [m] and rotation (3, 3) at a joint's position [rad, m]."""
        if self.kind == "prismatic":
            return self.position + self.rotation @ (value * self.axis), self.rotation
        if self.moves:
            turn = Rotation.from_rotvec(value * self.axis).as_matrix()
            return self.position, self.rotation @ turn
        return self.position, self.rotation


def read_links(root: Element) -> list[Link]:
    """Read the joints of a URDF.

    Args:
        root: its element `robot`; checked, as rig_urdf makes it.
    """
    return [_link(joint) for joint in root.findall("joint")]


def _link(joint: Element) -> Link:
    axis = _numbers(joint, "axis", "xyz", "1 0 0")
    return Link(
        joint=joint.get("name", ""),
        kind=joint.get("type", "fixed"),
        parent=_name(joint, "parent"),
        child=_name(joint, "child"),
        position=_numbers(joint, "origin", "xyz", "0 0 0"),
        rotation=Rotation.from_euler("xyz", _numbers(joint, "origin", "rpy", "0 0 0")).as_matrix(),
        axis=axis / np.linalg.norm(axis),
    )


def _name(joint: Element, tag: str) -> str:
    found = joint.find(tag)
    return "" if found is None else found.get("link", "")


def _numbers(joint: Element, tag: str, name: str, default: str) -> FloatArray:
    found = joint.find(tag)
    text = default if found is None else found.get(name, default)
    return np.array([float(word) for word in text.split()])


def pose_in(
    links: list[Link], base: str, link: str, joints: Mapping[str, float]
) -> tuple[FloatArray, FloatArray]:
    """Return position (3,) [m] and rotation (3, 3) of a link in one above it.

    Args:
        links: of the URDF.
        base: link above it.
        link: whose pose is wanted.
        joints: positions by name [rad, m]; 0 where there is none.

    Raises:
        KeyError: if the base is not above it.
    """
    above = {each.child: each for each in links}
    position, rotation = np.zeros(3), np.eye(3)
    while link != base:
        step = above[link]
        at, turn = step.at(joints.get(step.joint, 0.0))
        position, rotation = at + turn @ position, turn @ rotation
        link = step.parent
    return position, rotation
