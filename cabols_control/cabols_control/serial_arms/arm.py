# SPDX-License-Identifier: Apache-2.0
"""A robot arm's joints, in their order from base to flange, from its URDF."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError
from xml.parsers.expat.errors import XML_ERROR_UNBOUND_PREFIX, codes

import defusedxml.ElementTree as Xml
import numpy as np
from defusedxml.common import DefusedXmlException
from scipy.spatial.transform import Rotation

from cabols_control.checks import BoolArray, FloatArray
from cabols_control.errors import ConfigError
from cabols_control.files.plain_numbers import plain_number

TURNING = ("revolute", "continuous")
SLIDING = "prismatic"
FLANGES = ("tool0", "flange")
"""Links that are taken for the flange where an arm has several ends; ROS-Industrial's names."""
NO_FLANGE = ("camera", "optical", "lidar", "laser", "imu", "sensor", "finger", "gripper")
"""Words in the names of links that are never taken for the flange unasked."""

WITHOUT_JOINTS = ("link", "gazebo", "transmission", "material")
"""Elements of a robot in which no joints are."""
SHOWN = 6
"""Links that a message names."""

ATTRIBUTES = {
    "origin": ("xyz", "rpy"),
    "axis": ("xyz",),
    "limit": ("lower", "upper", "effort", "velocity", "acceleration", "deceleration", "jerk"),
}
"""Of the elements that are read: a misspelt one would count as left out."""


class NotSerialError(ConfigError):
    """The URDF is of something else than one chain of joints that turn."""


@dataclass(frozen=True, eq=False)
class SerialArm:
    """An arm of n joints, which turn; on request also such that slide.

    Attributes:
        name: of the robot.
        joints: names of the n joints, from the base.
        origins: (n, 3) of each joint, in the axes of the joint before it; the first: the base [m].
        rotations: (n, 3, 3) from each joint's axes, at angle zero, to those of the one before it.
        axes: (n, 3) unit vectors, in the joints' own axes.
        limits: (n, 2) of the angles [rad], or [m]; infinite for a continuous joint.
        slides: (n,) joints that slide along their axis instead of turning about it.
        flange: name of the link at the arm's end.
        flange_position: (3,) of that link, in the last joint's axes [m].
        flange_rotation: (3, 3) from its axes to the last joint's.
    """

    name: str
    joints: tuple[str, ...]
    origins: FloatArray
    rotations: FloatArray
    axes: FloatArray
    limits: FloatArray
    slides: BoolArray
    flange: str
    flange_position: FloatArray
    flange_rotation: FloatArray


def read_serial_arm(
    path: str | Path,
    flange: str = "",
    *,
    sliding: bool = False,
    locked: Mapping[str, float] | None = None,
) -> SerialArm:
    """Read an arm.

    Args:
        path: URDF; joints that are fixed are taken into the next one that turns.
        flange: link at the arm's end; empty: the only one that carries no other, else tool0 or
            flange.
        sliding: whether joints may slide.
        locked: positions of joints that are held and count as fixed, by name [rad, m].

    Raises:
        NotSerialError: if a joint on the way to the flange does not turn or follows another one,
            or no flange can be told; the message names joints or links.
        ConfigError: if the file is no URDF.
    """
    try:
        root = parse_urdf(path)
    except (OSError, ParseError, DefusedXmlException, ValueError, LookupError) as error:
        _refuse_xacro(path, getattr(error, "code", 0) == codes[XML_ERROR_UNBOUND_PREFIX])
        raise ConfigError(f"{path}: expected a URDF, got {error}") from error
    _refuse_xacro(path, _is_template(root))
    if root.tag != "robot":
        raise ConfigError(
            f"{path}: expected a URDF, whose root is <robot>, got <{root.tag}>; convert it to URDF"
        )
    above = _above(root, path)
    name = flange or _flange(root, above, path)
    chain = _way_to(name, above, path)
    places: list[tuple[FloatArray, FloatArray]] = []
    held = dict(locked or {})
    names, axes, limits, slides = [], [], [], []
    position, rotation = np.zeros(3), np.eye(3)
    for joint in chain:
        position = position + rotation @ _numbers(joint, "origin", "xyz", "0 0 0", path)
        # URDF's rpy turns about the fixed axes x, y, z.
        angles = _numbers(joint, "origin", "rpy", "0 0 0", path)
        rotation = rotation @ Rotation.from_euler("xyz", angles).as_matrix()
        if joint.get("type") == "fixed":
            continue
        is_held = joint.get("name", "") in held
        slide = _slides(joint, path, sliding, is_held)
        if is_held:
            at = held.pop(joint.get("name", "")) * _axis(joint, path)
            if slide:
                position = position + rotation @ at
            else:
                rotation = rotation @ Rotation.from_rotvec(at).as_matrix()
            continue
        names.append(joint.get("name", ""))
        axes.append(_axis(joint, path))
        limits.append(_limits(joint, path))
        slides.append(slide)
        places.append((position, rotation))
        position, rotation = np.zeros(3), np.eye(3)
    if held:
        raise NotSerialError(
            f"{path}: locked: expected joints on the way to {name!r}, got {', '.join(held)}"
        )
    if not names:
        raise NotSerialError(f"{path}: expected joints that turn on the way to {name!r}, got none")
    return SerialArm(
        name=root.get("name", ""),
        joints=tuple(names),
        origins=np.array([place for place, _ in places]),
        rotations=np.array([turn for _, turn in places]),
        axes=np.array(axes),
        limits=np.array(limits),
        slides=np.array(slides, dtype=np.bool_),
        flange=name,
        flange_position=position,
        flange_rotation=rotation,
    )


def parse_urdf(path: str | Path) -> Element:
    """Return the root of a URDF; names of simulators' sensors may have an undeclared prefix.

    Raises:
        OSError, ParseError, DefusedXmlException, ValueError, LookupError: if it is no XML file.
    """
    root: Element
    try:
        root = Xml.parse(str(path)).getroot()
    except ParseError as error:
        text = Path(path).read_text(encoding="utf-8")
        if error.code != codes[XML_ERROR_UNBOUND_PREFIX] or "xacro:" in text:
            raise
        found = set(re.findall(r"[<\s]/?([A-Za-z_][\w.-]*):[A-Za-z_]", text))
        found -= {"xml", "xmlns", *re.findall(r"xmlns:([\w.-]+)\s*=", text)}
        declared = " ".join(f'xmlns:{name}="undeclared:{name}"' for name in sorted(found))
        root = Xml.fromstring(re.sub(r"<robot\b", f"<robot {declared}", text, count=1).encode())
    return root


def _refuse_xacro(path: str | Path, is_xacro: bool) -> None:
    """Refuse a template: its macros and terms are not read here."""
    if is_xacro:
        name = Path(path).name
        stem = name.removesuffix(".xacro").removesuffix(".urdf")
        raise ConfigError(
            f"{path}: expected a URDF, got a xacro file, whose macros are not expanded yet; expand "
            f"it where ROS is installed: `xacro {name} > {stem}_expanded.urdf`"
        )


def _is_template(root: Element) -> bool:
    """Whether macros or terms are left where joints are; in a link's looks they do no harm."""
    parts = [one for one in root if one.tag not in WITHOUT_JOINTS]
    elements = [element for part in parts for element in part.iter()]
    elements += [one for one in root if one.tag == "link"]
    values = [value for one in elements for value in one.attrib.values()]
    macros = any("xacro" in str(one.tag) for one in elements)
    return macros or any("${" in value or "$(" in value for value in values)


def _above(root: Element, path: str | Path) -> dict[str, Element]:
    """Joint that carries each link; a tree has one for each, and no name twice."""
    above: dict[str, Element] = {}
    names: set[str] = set()
    for joint in root.findall("joint"):
        link, name = _link(joint, "child", path), joint.get("name", "")
        if link in above or name in names:
            raise ConfigError(
                f"{path}: {name!r}: expected each joint once, and one joint for each link; got "
                f"{'another one for ' + repr(link) if link in above else 'its name twice'}"
            )
        above[link] = joint
        names.add(name)
    return above


def _flange(root: Element, above: dict[str, Element], path: str | Path) -> str:
    """Link that carries no other, or the one by name if there are several."""
    carrying = {_link(joint, "parent", path) for joint in above.values()}
    ends = [link.get("name", "") for link in root.findall("link")]
    ends = [name for name in ends if name not in carrying]
    for name in FLANGES:
        if name in above:
            return name
    if len(ends) == 1 and not any(word in ends[0].lower() for word in NO_FLANGE):
        return ends[0]
    # Those behind most moving joints first: one of them is meant.
    moving = {name: _moving(name, above, path) for name in ends}
    ends.sort(key=lambda name: (-moving[name], any(word in name.lower() for word in NO_FLANGE)))
    more = f" and {len(ends) - SHOWN} more" if len(ends) > SHOWN else ""
    behind = [f"{name} (behind {moving[name]} joints)" for name in ends[:SHOWN]]
    raise NotSerialError(
        f"{path}: expected one link that carries no other, or one of {', '.join(FLANGES)}; got "
        f"{', '.join(behind) or 'none'}{more}"
    )


def _moving(name: str, above: dict[str, Element], path: str | Path) -> int:
    """How many joints that move are on the way to a link."""
    way = _way_to(name, above, path) if name in above else []
    return sum(joint.get("type") != "fixed" for joint in way)


def _way_to(name: str, above: dict[str, Element], path: str | Path) -> list[Element]:
    """Joints from the base to a link."""
    if name not in above:
        raise NotSerialError(
            f"{path}: expected a link {name!r} at the end of a joint, got "
            f"{', '.join(above) or 'no joints'}"
        )
    way: list[Element] = []
    while name in above:
        if len(way) > len(above):
            raise NotSerialError(f"{path}: expected a tree of links, got a circle through {name!r}")
        way.append(above[name])
        name = _link(above[name], "parent", path)
    return way[::-1]


def _slides(joint: Element, path: str | Path, sliding: bool, is_held: bool) -> bool:
    """Whether a joint slides; others must turn, and move on their own unless they are held."""
    name, kind = joint.get("name", ""), joint.get("type")
    known = (*TURNING, SLIDING) if sliding else TURNING
    if kind not in known:
        raise NotSerialError(
            f"{path}: {name!r}: expected a type of {', '.join(known)} or fixed, got {kind}"
        )
    if joint.find("mimic") is not None and not is_held:
        raise NotSerialError(
            f"{path}: {name!r}: expected one that moves on its own, got a mimic; hold it where it "
            "is (locked), or choose a link before it"
        )
    return kind == SLIDING


def _link(joint: Element, tag: str, path: str | Path) -> str:
    found = joint.find(tag)
    if found is None or not found.get("link"):
        raise ConfigError(f"{path}: {joint.get('name')!r}: expected <{tag} link=...>")
    return str(found.get("link"))


def _axis(joint: Element, path: str | Path) -> FloatArray:
    axis = _numbers(joint, "axis", "xyz", "1 0 0", path)
    length = float(np.linalg.norm(axis))
    if not 1e-6 < length < 1e6:
        raise ConfigError(f"{path}: {joint.get('name')!r}: expected an axis, got {axis}")
    return np.asarray(axis / length)


def _limits(joint: Element, path: str | Path) -> tuple[float, float]:
    """Limits of the angle; a joint of type revolute must have them."""
    if joint.get("type") == "continuous":
        return -np.inf, np.inf
    lower = float(_numbers(joint, "limit", "lower", "0", path, 1)[0])
    upper = float(_numbers(joint, "limit", "upper", "0", path, 1)[0])
    if not lower < upper:
        raise ConfigError(
            f"{path}: {joint.get('name')!r}: expected limits lower < upper, got {lower:g}, "
            f"{upper:g}"
        )
    return lower, upper


def _numbers(
    joint: Element, tag: str, name: str, default: str, path: str | Path, count: int = 3
) -> FloatArray:
    """Numbers of an attribute, finite."""
    found = joint.find(tag)
    # A name with a namespace is another program's own.
    own = [] if found is None else [key for key in found.attrib if not key.startswith("{")]
    odd = [key for key in own if key not in ATTRIBUTES[tag]]
    if odd or (tag == "axis" and found is not None and name not in found.attrib):
        raise ConfigError(
            f"{path}: {joint.get('name')!r}: expected {', '.join(ATTRIBUTES[tag])} in {tag}, got "
            f"{', '.join(odd) or 'none'}"
        )
    words = (found.get(name, default) if found is not None else default).split()
    try:
        numbers = np.array([plain_number(word) for word in words])
    except ValueError:
        numbers = np.full(1, np.nan)
    if numbers.size != count or not np.isfinite(numbers).all():
        raise ConfigError(
            f"{path}: {joint.get('name')!r}: expected {count} finite numbers in {tag} "
            f"{name}, got {' '.join(words)!r}"
        )
    return numbers
