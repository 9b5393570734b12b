# SPDX-License-Identifier: Apache-2.0
"""A URDF of a rig, from its folder: frame, cables' points, robot, platform, sensor, tracker.

The robot's own URDF is taken over as it is; its base hangs on the rig's base frame, the platform on
its flange. Rotations are written as roll, pitch and yaw; where these lose digits, near a pitch of
90 deg, as two turns.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, SubElement, indent, tostring

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.checks import FloatArray, finite_array
from cabols_control.command_line import (
    DONE,
    CommandParser,
    command,
    give_out,
    rig_option,
    text_option,
)
from cabols_control.errors import ConfigError
from cabols_control.files.plain_numbers import plain_number
from cabols_control.frames import RigFrames, load_frames
from cabols_control.geometry import RigGeometry
from cabols_control.naming import number
from cabols_control.placement import Frame
from cabols_control.rig import load_rig
from cabols_control.rig_folder import find_rig
from cabols_control.rig_tools.ros2_control_urdf import add_ros2_control
from cabols_control.serial_arms.arm import parse_urdf, read_serial_arm

TEXT = "Write the URDF of a rig: its frame, robot, platform, sensor, tracker and reflectors."
ROBOT_URDF = "robot.urdf"
TRACKER, SENSOR = "tracker", "sensor"
WORLD = "world"
LOST = 1e-14
"""Largest error of a rotation that roll, pitch and yaw may have."""
QUARTER = "0 1.5707963267948966 0"
POINT_M = 0.02
"""Diameter of what marks a point [m]."""
NOWHERE = Frame([0.0, 0.0, 0.0])


def rig_urdf(rig: str = "", robot_base: Frame = NOWHERE) -> Element:
    """Make the URDF of a rig.

    Args:
        rig: name or folder, see find_rig.
        robot_base: of the robot, in the rig's base frame.

    Returns:
        The element `robot`; links are named as the frames of messages, counted from 1.

    Raises:
        ConfigError: if a file of the rig cannot be used, or a link's name stands twice.
    """
    folder = find_rig(rig)
    geometry, frames = load_rig(folder).geometry, load_frames(folder)
    root = Element("robot", name=folder.name)
    _let_mujoco_read(root)
    SubElement(root, "link", name=geometry.base_frame)
    if folder.has(ROBOT_URDF):
        path = folder.file(ROBOT_URDF)
        flange = read_serial_arm(path).flange
        own = parse_urdf(path)
        _rename_world(own)
        for element in own:
            if element.tag != "mujoco":
                root.append(element)
        _hang(root, geometry.base_frame, _root_link(own, path), robot_base, known=True)
        _hang(root, flange, geometry.platform_frame, frames.tool_frame)
        _add_mass(root, geometry.platform_frame, frames)
    else:
        place = Frame(
            [float(x) for x in geometry.reference_position],
            quaternion_wxyz=_wxyz(geometry.reference_rotation),
        )
        _hang(root, geometry.base_frame, geometry.platform_frame, place)
    _hang_devices(root, geometry, frames)
    _check_names(root)
    return root


def _rename_world(robot: Element) -> None:
    """Rename a robot's own link `world`: MuJoCo would put it at the origin, whatever carries it."""
    for element in (*robot.findall("link"), *robot.findall("joint/parent")):
        key = "name" if element.tag == "link" else "link"
        if element.get(key) == WORLD:
            element.set(key, f"robot_{WORLD}")


def _without_shapes(root: Element) -> None:
    for link in root.findall("link"):
        for shape in (*link.findall("visual"), *link.findall("collision")):
            link.remove(shape)


def _let_mujoco_read(root: Element) -> None:
    """Let MuJoCo keep fixed links as bodies, and take links without a mass."""
    options = {"fusestatic": "false", "boundmass": "1e-3", "boundinertia": "1e-6"}
    SubElement(SubElement(root, "mujoco"), "compiler", {**options, "discardvisual": "false"})


def _hang_devices(root: Element, geometry: RigGeometry, frames: RigFrames) -> None:
    base, platform = geometry.base_frame, geometry.platform_frame
    for index in range(geometry.cables):
        at = [float(x) for x in geometry.base_points[index]]
        on = [float(x) for x in geometry.platform_points[index]]
        _hang(root, base, f"anchor_{number(index)}", Frame(at), marked=True)
        _hang(root, platform, f"attachment_{number(index)}", Frame(on), marked=True)
    _hang(root, platform, SENSOR, frames.sensor_frame)
    _hang(root, base, TRACKER, frames.tracker_frame)
    for index, place in enumerate(frames.reflectors):
        _hang(root, platform, f"reflector_{number(index)}", Frame(place), marked=True)
    for name, frame in frames.wrench_frames.items():
        _hang(root, base if frame.parent == "base" else platform, name, frame)


def _hang(
    root: Element,
    parent: str,
    child: str,
    frame: Frame,
    *,
    marked: bool = False,
    known: bool = False,
) -> None:
    """Fix a link to another one."""
    if not known:
        link = SubElement(root, "link", name=child)
        if marked:
            shape = SubElement(SubElement(link, "visual"), "geometry")
            SubElement(shape, "sphere", radius=repr(0.5 * POINT_M))
    turns = _turns(frame.rotation)
    xyz = " ".join(repr(float(x)) for x in frame.position)
    for index, rpy in enumerate(turns):
        last = index == len(turns) - 1
        below = child if last else f"{child}_turn"
        if not last:
            SubElement(root, "link", name=below)
        joint = SubElement(root, "joint", name=f"{parent}_to_{below}", type="fixed")
        SubElement(joint, "parent", link=parent)
        SubElement(joint, "child", link=below)
        SubElement(joint, "origin", xyz=xyz, rpy=rpy)
        parent, xyz = below, "0 0 0"


def _turns(rotation: FloatArray) -> list[str]:
    """One or two triples of roll, pitch, yaw whose product is a rotation."""
    text = _rpy(rotation)
    if _lost(text, rotation) <= LOST:
        return [text]
    rest = Rotation.from_euler("y", -0.5 * np.pi).as_matrix() @ rotation
    return [QUARTER, _rpy(rest)]


def _rpy(rotation: FloatArray) -> str:
    angles = np.arctan2(rotation[2, 1], rotation[2, 2]), np.arctan2(rotation[1, 0], rotation[0, 0])
    pitch = np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0]))
    return f"{float(angles[0])!r} {float(pitch)!r} {float(angles[1])!r}"


def _lost(text: str, rotation: FloatArray) -> float:
    again = Rotation.from_euler("xyz", [float(word) for word in text.split()]).as_matrix()
    return float(np.abs(again - rotation).max())


def _wxyz(rotation: FloatArray) -> list[float]:
    x, y, z, w = Rotation.from_matrix(rotation).as_quat()
    return [float(w), float(x), float(y), float(z)]


def _root_link(robot: Element, path: Path) -> str:
    """Name of the only link that nothing carries."""
    carried = {joint.find("child").get("link") for joint in robot.findall("joint")}  # type: ignore[union-attr]
    roots = [link.get("name", "") for link in robot.findall("link")]
    roots = [name for name in roots if name not in carried]
    if len(roots) != 1:
        raise ConfigError(f"{path}: expected one link that nothing carries, got {roots}")
    return roots[0]


def _add_mass(root: Element, platform: str, frames: RigFrames) -> None:
    """Give the platform what hangs on the sensor, as a point mass with a sphere's inertia."""
    mass = float(frames.tool_mass)
    if mass <= 0.0:
        return
    link = next(link for link in root.findall("link") if link.get("name") == platform)
    inertial = SubElement(link, "inertial")
    xyz = " ".join(repr(float(x)) for x in frames.tool_centre_of_mass)
    SubElement(inertial, "origin", xyz=xyz, rpy="0 0 0")
    SubElement(inertial, "mass", value=repr(mass))
    turning = repr(0.4 * mass * 0.05**2)
    zeros = dict.fromkeys(("ixy", "ixz", "iyz"), "0")
    SubElement(inertial, "inertia", {"ixx": turning, "iyy": turning, "izz": turning, **zeros})


def _check_names(root: Element) -> None:
    for tag in ("link", "joint"):
        names = [element.get("name", "") for element in root.findall(tag)]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ConfigError(
                f"URDF of the rig: expected each {tag} once, got {', '.join(twice)} twice; name "
                f"those of {ROBOT_URDF} differently"
            )


def urdf_text(root: Element) -> str:
    """Return a URDF's text.

    Args:
        root: its element `robot`.
    """
    indent(ElementTree(root))
    return '<?xml version="1.0"?>\n' + tostring(root, encoding="unicode") + "\n"


def _three(text: str) -> list[float]:
    words = text.split(",")
    return [float(x) for x in finite_array("numbers", [plain_number(word) for word in words], (3,))]


@command
def main(arguments: Sequence[str] | None = None) -> int:
    """Write the URDF; returns 0, or 2 for a wrong command line."""
    parser = CommandParser("rig_urdf", TEXT)
    rig_option(parser)
    parser.add_argument("--robot-position", type=_three, default=[0.0] * 3, help="x,y,z [m]")
    parser.add_argument(
        "--robot-rotation-xyz-deg", type=_three, default=[0.0] * 3, help="of its base [deg]"
    )
    parser.add_argument(
        "--no-shapes",
        action="store_true",
        help="without visual and collision parts, for programs that do not find their mesh files",
    )
    parser.add_argument(
        "--ros2-control", action="store_true", help="with limbs as joints of ros2_control"
    )
    text_option(parser)
    options = parser.parse_args(arguments)
    base = Frame(options.robot_position, options.robot_rotation_xyz_deg)
    root = rig_urdf(options.rig, base)
    if options.ros2_control:
        add_ros2_control(root, load_rig(find_rig(options.rig)))
        _check_names(root)
    if options.no_shapes:
        _without_shapes(root)
    text = urdf_text(root)
    give_out(text, options.output)
    return DONE


if __name__ == "__main__":
    sys.exit(main())
