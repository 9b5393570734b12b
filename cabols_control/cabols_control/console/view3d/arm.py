"""A robot's joints from its URDF, as far as a picture needs them."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element, ParseError

import defusedxml.ElementTree as Xml
from defusedxml.common import DefusedXmlException

from cabols_control.errors import ConfigError

TURNING = ("revolute", "continuous")


class Arm(NamedTuple):
    """A chain of joints that turn about axes of their frames.

    Attributes:
        offsets: [x, y, z] of every joint, in the frame of the link before it [m].
        axes: 0, 1, 2 for x, y, z of that frame.
        flange: [x, y, z] of what is fixed to the last link, in its frame [m].
    """

    offsets: list[list[float]]
    axes: list[int]
    flange: list[float]


def read_arm(path: str | Path) -> Arm | None:
    """Read a robot's joints; None for one that is no such chain, of which no picture is drawn.

    Raises:
        ConfigError: if the file is no URDF.
    """
    try:
        root = Xml.parse(str(path)).getroot()
    except (OSError, ParseError, DefusedXmlException) as error:
        raise ConfigError(f"{path}: expected a URDF, got {error}") from error
    offsets: list[list[float]] = []
    axes: list[int] = []
    flange = [0.0] * 3
    for joint in root.iter("joint"):
        place, turn = _numbers(joint, "origin", "xyz"), _numbers(joint, "origin", "rpy")
        if joint.get("type") in TURNING:
            axis = _numbers(joint, "axis", "xyz", "1 0 0")
            if any(turn) or sorted(axis) != [0.0, 0.0, 1.0]:
                return None
            offsets.append(place)
            axes.append(axis.index(1.0))
        elif joint.get("type") == "fixed" and offsets:
            flange = [one + other for one, other in zip(flange, place, strict=True)]
            if any(turn):
                # What is fixed behind a turned flange is not drawn.
                break
        else:
            return None
    return Arm(offsets, axes, flange) if offsets else None


def _numbers(joint: Element, tag: str, name: str, default: str = "0 0 0") -> list[float]:
    found = joint.find(tag)
    words = (found.get(name, default) if found is not None else default).split()
    try:
        numbers = [float(word) for word in words]
    except ValueError as error:
        raise ConfigError(f"{tag} of a joint: expected three numbers, got {words}") from error
    if len(numbers) != 3:
        raise ConfigError(f"{tag} of a joint: expected three numbers, got {words}")
    return numbers
