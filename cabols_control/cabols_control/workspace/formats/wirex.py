# SPDX-License-Identifier: Apache-2.0
"""Robots of WireX (Pott: Cable-Driven Parallel Robots, Springer 2018): its XML, and its text form.

The XML holds, below `models`, a `robot` with `motionpattern`, and in `geometry` one `chain` for
each cable: `base` (x, y, z, the matrix a11 to a33, the pulley's radius) and `platform`. The older
text form has a line for each of `dof`, `now` (number of cables), `lmin`, `lmax`, `fmin`, `fmax`,
and `base` and `platform` with the cable's number from 1. Metres and newtons. Neither has a
reference pose.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.errors import DataFileError
from cabols_control.motion import Motion
from cabols_control.naming import cable_name

from .exchanged import ExchangedRobot, frame_along, numbers, text_of, xml_tree

PATTERNS = {"3R3T": None, "1R2T": None, "3T": Motion.POINT}
"""Motion patterns that are read; None: in space or in a plane, as the points leave it."""
FREEDOMS = {6: None, 3: None}
MATRIX = [f"a{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3)]
LEVEL = 0.1
"""Height of a frame, as a share of its size, below which it is one of a crane."""
NUMBERS = ("dof", "now", "lmin", "lmax", "fmin", "fmax")


def read_wirex(path: Path, limits: Path | None = None) -> ExchangedRobot:
    """Read a robot.

    Args:
        path: of its XML, or of its text form.
        limits: of a text form whose limits belong to the XML; None: there is none.

    Raises:
        ConfigError: if a file cannot be read.
        DataFileError: naming file and place, if it is not a robot that is read here.
    """
    robot, planar = _read_xml(path) if path.suffix == ".xml" else _read_text(path)
    if limits is not None:
        other, _ = _read_text(limits)
        if len(other.base_points) != len(robot.base_points):
            raise DataFileError(
                f"{limits}: expected {len(robot.base_points)} cables as in {path.name}, got "
                f"{len(other.base_points)}"
            )
        robot.tension_min, robot.tension_max = other.tension_min, other.tension_max
        robot.length_min, robot.length_max = other.length_min, other.length_max
    robot.position = _inside(robot.base_points, planar)
    if robot.pulley_axes is not None:
        # Away from the platform: cables come that way and run over the wheel.
        away = robot.base_points - robot.position
        along = np.einsum("ij,ij->i", away, robot.pulley_axes)
        robot.pulley_axes = np.where(along[:, None] >= 0.0, 1.0, -1.0) * robot.pulley_axes
        robot.notes.append("pulleys of the given radius swivel about the z axes of the base points")
    robot.notes.append(
        "no pose in the file: the reference pose is at "
        f"{', '.join(f'{value:.4g}' for value in robot.position)} m; see --position"
    )
    if robot.tension_max is None:
        robot.notes.append("no tension limits in the file")
    return robot


def _inside(base: FloatArray, planar: bool) -> FloatArray:
    """(3,) middle of the frame; below it where the base points of a robot in space are level."""
    middle = 0.5 * (base.min(axis=0) + base.max(axis=0))
    sides = np.ptp(base, axis=0)
    if not planar and not sides[2] > LEVEL * sides.max():
        middle[2] -= 0.5 * float(sides.max())
    return np.asarray(np.round(middle, 12) + 0.0)


def _read_xml(path: Path) -> tuple[ExchangedRobot, bool]:
    """Robot of the XML, and whether it moves in a plane."""
    root = xml_tree(path)
    found = [each for each in root.iter("robot") if each.find("geometry/chain") is not None]
    if not found and root.find(".//frame/anchors") is not None:
        raise DataFileError(
            f"{path}: expected a robot of WireX, got one of cdpyr in XML, of which JSON and YAML "
            "are read"
        )
    if len(found) != 1:
        raise DataFileError(
            f"{path}: expected one robot with geometry and chains, got {len(found)}; CASPR's "
            "models are two files, bodies and cables"
        )
    robot = found[0]
    pattern = robot.get("motionpattern", "3R3T")
    if pattern not in PATTERNS:
        raise DataFileError(
            f"{path}: motionpattern: expected one of {', '.join(PATTERNS)}, got {pattern!r}"
        )
    base, held, radius, axes = [], [], [], []
    for index, chain in enumerate(robot.findall("geometry/chain")):
        where = f"{path}: {cable_name(index)}"
        start, end = chain.find("base"), chain.find("platform")
        if start is None or end is None:
            raise DataFileError(f"{where}: expected base and platform, got {_tags(chain)}")
        base.append(_place(f"{where}: base", start))
        held.append(_place(f"{where}: platform", end))
        size = float(numbers(f"{where}: radius", start.get("radius", "0"), 1)[0])
        if not size >= 0.0:
            raise DataFileError(f"{where}: radius: expected 0 or more, got {size:g}")
        radius.append(size)
        axes.append(_axis(f"{where}: base", start))
    body = robot.find("platform")
    made = ExchangedRobot(
        position=np.zeros(3),
        rotation=np.eye(3),
        base_points=np.array(base),
        platform_points=np.array(held),
        motion=PATTERNS[pattern],
        pulley_radius=np.array(radius),
        pulley_axes=np.array(axes) if any(radius) else None,
    )
    if body is not None:
        made.mass = float(numbers(f"{path}: mass", body.get("mass", "0"), 1)[0])
        centre = body.find("centerofgravity")
        if centre is not None:
            made.centre_of_mass = _place(f"{path}: centerofgravity", centre)
    return made, pattern == "1R2T"


def _place(where: str, tag: ElementTree.Element) -> FloatArray:
    """(3,) attributes x, y, z."""
    return np.array([numbers(f"{where}: {key}", tag.get(key, ""), 1)[0] for key in "xyz"])


def _axis(where: str, tag: ElementTree.Element) -> FloatArray:
    """(3,) z axis of the matrix of a tag; without one, the frame's own."""
    if not any(key in tag.attrib for key in MATRIX):
        return np.array([0.0, 0.0, 1.0])
    given = [numbers(f"{where}: {key}", tag.get(key, ""), 1)[0] for key in MATRIX]
    matrix = np.array(given).reshape(3, 3)
    if not np.abs(matrix @ matrix.T - np.eye(3)).max() < 1e-5:
        raise DataFileError(f"{where}: expected a rotation in a11 to a33, got {given}")
    return np.asarray(matrix[:, 2] / np.linalg.norm(matrix[:, 2]))


def _tags(parent: ElementTree.Element) -> str:
    return ", ".join(str(child.tag) for child in parent) or "nothing"


def _read_text(path: Path) -> tuple[ExchangedRobot, bool]:
    """Robot of the text form, and whether it moves in a plane."""
    try:
        lines = text_of(path).decode("utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise DataFileError(f"{path}: expected UTF-8 text, got {error}") from error
    values: dict[str, float] = {}
    points: dict[tuple[str, int], FloatArray] = {}
    for number, entry in enumerate(lines, 1):
        words = entry.split("//")[0].split()
        if not words:
            continue
        where, key = f"{path}:{number}", words[0]
        if key in NUMBERS and key not in values:
            values[key] = float(numbers(f"{where}: {key}", words[1:], 1)[0])
        elif key in ("base", "platform"):
            row = numbers(f"{where}: {key}", words[1:], 4)
            index = int(row[0])
            if not (index == row[0] and index >= 1 and (key, index) not in points):
                raise DataFileError(
                    f"{where}: {key}: expected each cable's number once, from 1, got {words[1]}"
                )
            points[key, index] = row[1:]
        else:
            raise DataFileError(
                f"{where}: expected {', '.join(NUMBERS)} once each, base or platform, got {key!r}"
            )
    count, freedom = values.get("now", 0.0), values.get("dof", 0.0)
    wanted = {(key, k) for key in ("base", "platform") for k in range(1, int(count) + 1)}
    if not (count >= 1 and count == int(count) and set(points) == wanted):
        raise DataFileError(
            f"{path}: expected base and platform of the cables 1 to {count:g} (now), got "
            f"{sum(key == 'base' for key, _ in points)} and "
            f"{sum(key == 'platform' for key, _ in points)}"
        )
    if freedom not in FREEDOMS:
        raise DataFileError(f"{path}: dof: expected 6 or 3, got {freedom:g}")
    n, largest = int(count), values.get("fmax", 0.0)
    made = ExchangedRobot(
        position=np.zeros(3),
        rotation=np.eye(3),
        base_points=np.array([points["base", k] for k in range(1, n + 1)]),
        platform_points=np.array([points["platform", k] for k in range(1, n + 1)]),
        length_min=max(values.get("lmin", 0.0), 0.0),
        notes=["no mass in the file"],
    )
    if values.get("lmax", 0.0) > 0.0:
        made.length_max = values["lmax"]
    if largest > 0.0:
        made.tension_min = np.full(n, max(values.get("fmin", 0.0), 0.0))
        made.tension_max = np.full(n, largest)
    return made, freedom == 3 and bool(np.ptp(made.platform_points, axis=0).any())


def write_wirex(robot: ExchangedRobot, folder: Path, name: str) -> list[Path]:
    """Write a robot: NAME.xml, and NAME.txt, which alone has limits, the same for all cables.

    Args:
        robot: to write.
        folder: that exists.
        name: of the robot.

    Returns:
        The files.
    """
    spatial = robot.motion is None or robot.motion is Motion.SPATIAL
    pattern = "3R3T" if spatial else "3T" if robot.motion is Motion.POINT else "1R2T"
    models = ElementTree.Element("models")
    words = {"name": name, "motionpattern": pattern}
    whole = ElementTree.SubElement(models, "robot", words)
    geometry = ElementTree.SubElement(whole, "geometry")
    for index, (start, end) in enumerate(
        zip(robot.base_points, robot.platform_points, strict=True)
    ):
        chain = ElementTree.SubElement(geometry, "chain", {"id": str(index + 1)})
        frame, radius = np.eye(3), 0.0
        if robot.pulley_radius.size and robot.pulley_axes is not None:
            radius = float(robot.pulley_radius[index])
            frame = frame_along(robot.pulley_axes[index]) if radius > 0.0 else frame
        matrix = {key: repr(float(value)) for key, value in zip(MATRIX, frame.flat, strict=True)}
        base = {**_words(start), **matrix, "radius": repr(radius)}
        ElementTree.SubElement(chain, "base", base)
        ElementTree.SubElement(chain, "platform", _words(end))
    body = ElementTree.SubElement(whole, "platform", {"name": name, "mass": repr(robot.mass)})
    ElementTree.SubElement(body, "centerofgravity", _words(robot.centre_of_mass))
    xml, text = folder / f"{name}.xml", folder / f"{name}.txt"
    ElementTree.indent(models)
    ElementTree.ElementTree(models).write(xml, encoding="utf-8", xml_declaration=True)
    lines = [f"dof {6 if spatial else 3}", f"now {len(robot.base_points)}"]
    lines += [f"lmin {robot.length_min!r}"]
    lines += [f"lmax {robot.length_max if np.isfinite(robot.length_max) else 0.0!r}"]
    if robot.tension_min is not None and robot.tension_max is not None:
        # One for all cables: what each of them may.
        lines += [f"fmin {float(robot.tension_min.max())!r}"]
        lines += [f"fmax {float(robot.tension_max.min())!r}"]
    for key, rows in (("base", robot.base_points), ("platform", robot.platform_points)):
        for index, row in enumerate(rows):
            lines.append(f"{key} {index + 1} {' '.join(repr(float(value)) for value in row)}")
    text.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return [xml, text]


def _words(point: FloatArray) -> dict[str, str]:
    return {key: repr(float(value)) for key, value in zip("xyz", point, strict=True)}
