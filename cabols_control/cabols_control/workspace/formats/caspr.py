# SPDX-License-Identifier: Apache-2.0
"""Models of CASPR (Cable-robot Analysis and Simulation Platform for Research): two XML files.

`*_bodies.xml` holds the links with joint, mass and centre of mass, `*_cables.xml` sets of cables
with force limits and attachments on the links; link 0 is the base. Lengths in metres, angles in
radians. Models of one link with a joint in space, in a plane or of translation are read.
Lau, Eden, Tan, Oetomo 2016: CASPR, IROS.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.checks import FloatArray
from cabols_control.errors import DataFileError
from cabols_control.motion import Motion
from cabols_control.naming import cable_name

from .exchanged import ExchangedRobot, numbers, xml_tree

JOINTS = {
    "SPATIAL_EULER_XYZ": (Motion.SPATIAL, 6),
    "SPATIAL_QUATERNION": (Motion.SPATIAL, 7),
    "PLANAR_XY": (Motion.PLANAR_XY, 3),
    "PLANAR_XZ": (Motion.PLANAR_XZ, 3),
    "PLANAR_YZ": (Motion.PLANAR_YZ, 3),
    "T_XYZ": (Motion.POINT, 3),
    "TRANSLATION_XYZ": (Motion.POINT, 3),
}
"""Types of joints that are read: motion, number of coordinates."""
_WRITTEN = {
    Motion.SPATIAL: "SPATIAL_EULER_XYZ",
    Motion.PLANAR_XY: "PLANAR_XY",
    Motion.PLANAR_XZ: "PLANAR_XZ",
    Motion.PLANAR_YZ: "PLANAR_YZ",
    Motion.POINT: "T_XYZ",
}
_ROWS = {
    Motion.PLANAR_XY: (0, 1),
    Motion.PLANAR_XZ: (0, 2),
    Motion.PLANAR_YZ: (1, 2),
}
PULLEY = "base_rotating_pulley"
"""Attachment over a swivelling wheel: the cable comes along the swivel's axis."""
LARGEST_N = 1e8
"""Largest tension of a robot file [N]."""


def read_caspr(bodies: Path, cables: Path, cable_set: str = "") -> ExchangedRobot:
    """Read a model.

    Args:
        bodies: file of the links.
        cables: file of the cables.
        cable_set: id of a set; empty: the file's default.

    Raises:
        ConfigError: if a file cannot be read.
        DataFileError: naming file and place, if a model is not one that is read here.
    """
    tree = xml_tree(bodies)
    links = [link for link in tree.iter() if str(link.tag).startswith("link_")]
    if len(links) != 1:
        raise DataFileError(
            f"{bodies}: expected one link, got {len(links)}; robots of one platform are read"
        )
    link = links[0]
    joint = link.find("joint")
    kind = "" if joint is None else str(joint.get("type"))
    if joint is None or kind not in JOINTS:
        raise DataFileError(f"{bodies}: joint: expected one of {', '.join(JOINTS)}, got {kind!r}")
    motion, count = JOINTS[kind]
    at = np.zeros(count)
    if count == 7:
        at[-4] = 1.0  # w of a quaternion
    notes = []
    given = joint.get("q_initial") or joint.get("q_default")
    if given is None:
        notes.append("no initial pose in the file: the reference pose is the origin")
    else:
        at = numbers(f"{bodies}: q_initial", given, count)
    position, rotation = _pose(motion, at)
    shift = link.findtext("parent/location")
    if shift is not None:
        position = position + numbers(f"{bodies}: parent/location", shift, 3)
    centre = link.findtext("physical/com_location")
    robot = ExchangedRobot(
        position=position,
        rotation=rotation,
        base_points=np.zeros((0, 3)),
        platform_points=np.zeros((0, 3)),
        motion=motion,
        mass=float(numbers(f"{bodies}: mass", link.findtext("physical/mass") or "0", 1)[0]),
        centre_of_mass=np.zeros(3)
        if centre is None
        else numbers(f"{bodies}: com_location", centre, 3),
        notes=notes,
    )
    _read_cables(robot, cables, cable_set)
    return robot


def _pose(motion: Motion, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Position and rotation of joint coordinates."""
    position, turn = np.zeros(3), Rotation.identity()
    if motion in _ROWS:
        position[list(_ROWS[motion])] = at[:2]
        axis = np.eye(3)[motion.across or 0]
        turn = Rotation.from_rotvec(at[2] * axis)
    else:
        position = at[:3].copy()
        if at.size == 6:
            turn = Rotation.from_euler("XYZ", at[3:])
        elif at.size == 7:
            w, *vector = at[3:]
            turn = Rotation.from_quat([*vector, w])
    return position, np.asarray(turn.as_matrix())


def _read_cables(robot: ExchangedRobot, path: Path, wanted: str) -> None:
    """Fill in points and limits of a set of cables."""
    tree = xml_tree(path)
    sets = {str(found.get("id")): found for found in tree.iter("cable_set")}
    name = wanted or str(tree.get("default_cable_set"))
    if name not in sets:
        raise DataFileError(
            f"{path}: expected one of the cable sets {', '.join(sets) or 'none'}, got {name!r}"
        )
    cables = [each for each in sets[name] if str(each.tag).startswith("cable_")]
    base, platform, limits = [], [], []
    radius, axes = np.zeros(len(cables)), np.tile([0.0, 0.0, 1.0], (len(cables), 1))
    for index, cable in enumerate(cables):
        where = f"{path}: {cable_name(index)}"
        if "passive" in str(cable.tag):
            raise DataFileError(
                f"{where}: expected a cable with a motor, got {cable.tag}, which pulls by itself"
            )
        reference = cable.get("attachment_reference", "joint")
        if reference not in ("joint", "com"):
            raise DataFileError(
                f"{where}: attachment_reference: expected joint or com, got {reference!r}"
            )
        from_centre = reference == "com"
        ends: dict[int, FloatArray] = {}
        attachments = list(cable.find("attachments") or ())
        for attachment in attachments:
            if attachment.tag == PULLEY:
                ends[0], radius[index], axes[index] = _pulley(where, attachment)
                continue
            if attachment.tag != "attachment":
                raise DataFileError(
                    f"{where}: expected an attachment or {PULLEY}, got {attachment.tag}"
                )
            link = int(numbers(f"{where}: link", attachment.findtext("link") or "", 1)[0])
            place = numbers(f"{where}: location", attachment.findtext("location") or "", 3)
            ends[link] = place + robot.centre_of_mass if link and from_centre else place
        if len(attachments) != 2 or set(ends) != {0, 1}:
            kinds = sorted({str(attachment.tag) for attachment in attachments})
            raise DataFileError(
                f"{where}: expected one attachment or {PULLEY} on link 0, one attachment on link "
                f"1, got {len(attachments)} ({', '.join(kinds)}) on the links {sorted(ends)}"
            )
        base.append(ends[0])
        platform.append(ends[1])
        limits.append(
            [
                float(numbers(f"{where}: {key}", cable.findtext(f"properties/{key}") or "", 1)[0])
                for key in ("force_min", "force_max")
            ]
        )
    if not cables:
        raise DataFileError(f"{path}: expected cables in the set {name!r}, got none")
    robot.base_points, robot.platform_points = np.array(base), np.array(platform)
    robot.tension_min, robot.tension_max = np.array(limits).T
    if (robot.tension_max > LARGEST_N).any():
        robot.tension_max = np.minimum(robot.tension_max, LARGEST_N)
        robot.notes.append(f"largest tensions above {LARGEST_N:g} N stand for none: taken as that")
    robot.pulley_radius = radius
    if radius.any():
        robot.pulley_axes = axes


def _pulley(where: str, pulley: ElementTree.Element) -> tuple[FloatArray, float, FloatArray]:
    """Where the cable meets the groove, radius, unit vector along which it comes."""

    def values(key: str, count: int) -> FloatArray:
        return numbers(f"{where}: {key}", pulley.findtext(key) or "", count)

    radius, along = float(values("pulley_radius", 1)[0]), values("cable_entry_vector", 3)
    length = float(np.linalg.norm(along))
    if not (radius >= 0.0 and length > 0.0):
        raise DataFileError(
            f"{where}: expected a radius from 0 and a direction, got {radius:g} and {along}"
        )
    return values("fixed_location", 3), radius, along / length


def write_caspr(robot: ExchangedRobot, folder: Path, name: str) -> list[Path]:
    """Write a model: NAME_bodies.xml and NAME_cables.xml.

    Args:
        robot: to write.
        folder: that exists.
        name: of the model.

    Returns:
        The files.
    """
    motion = robot.motion or Motion.SPATIAL
    turn = Rotation.from_matrix(robot.rotation)
    if motion in _ROWS:
        angle = turn.as_rotvec()[motion.across or 0]
        at = [*robot.position[list(_ROWS[motion])], angle]
    elif motion is Motion.POINT:
        at = [*robot.position]
    else:
        at = [*robot.position, *turn.as_euler("XYZ")]
    bodies = ElementTree.Element("bodies_system")
    links = ElementTree.SubElement(bodies, "links")
    link = ElementTree.SubElement(links, "link_rigid", {"num": "1", "name": name})
    ElementTree.SubElement(link, "joint", {"type": _WRITTEN[motion], "q_initial": _words(at)})
    physical = ElementTree.SubElement(link, "physical")
    _put(physical, "mass", [robot.mass])
    _put(physical, "com_location", robot.centre_of_mass)
    _put(physical, "end_location", np.zeros(3))
    inertia = ElementTree.SubElement(physical, "inertia", {"ref": "com"})
    for key in ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"):
        _put(inertia, key, [0.0])
    parent = ElementTree.SubElement(link, "parent")
    ElementTree.SubElement(parent, "num").text = "0"
    # What a planar joint cannot move along stands in the parent's place.
    fixed = np.array(robot.position)
    if motion in _ROWS:
        fixed[list(_ROWS[motion])] = 0.0
    else:
        fixed[:] = 0.0
    _put(parent, "location", fixed)
    cables = ElementTree.Element("cables", {"default_cable_set": "given"})
    group = ElementTree.SubElement(cables, "cable_set", {"id": "given"})
    for index, (start, end) in enumerate(
        zip(robot.base_points, robot.platform_points, strict=True)
    ):
        words = {"name": cable_name(index), "attachment_reference": "joint"}
        cable = ElementTree.SubElement(group, "cable_ideal", words)
        properties = ElementTree.SubElement(cable, "properties")
        if robot.tension_min is not None and robot.tension_max is not None:
            _put(properties, "force_min", [robot.tension_min[index]])
            _put(properties, "force_max", [robot.tension_max[index]])
        attachments = ElementTree.SubElement(cable, "attachments")
        pulley = robot.pulley_radius.size and robot.pulley_radius[index] > 0.0
        if pulley and robot.pulley_axes is not None:
            wheel = ElementTree.SubElement(attachments, PULLEY)
            _put(wheel, "fixed_location", start)
            _put(wheel, "pulley_radius", [robot.pulley_radius[index]])
            _put(wheel, "cable_entry_vector", robot.pulley_axes[index])
        for number, place in enumerate((start, end)):
            if number == 0 and pulley:
                continue
            attachment = ElementTree.SubElement(attachments, "attachment")
            ElementTree.SubElement(attachment, "link").text = str(number)
            _put(attachment, "location", place)
    files = []
    for kind, root in (("bodies", bodies), ("cables", cables)):
        path = folder / f"{name}_{kind}.xml"
        ElementTree.indent(root)
        ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
        files.append(path)
    return files


def _words(values: list[float] | FloatArray) -> str:
    return " ".join(repr(float(value)) for value in values)


def _put(parent: ElementTree.Element, tag: str, values: list[float] | FloatArray) -> None:
    ElementTree.SubElement(parent, tag).text = _words(values)
