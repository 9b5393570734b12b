# SPDX-License-Identifier: Apache-2.0
"""ATI force/torque sensors: the .cal file, and wrenches seen from another point or other axes.

wrench = M (volts - bias). In the file a UserAxis row is M's row in the units that the file names,
with the file's BasicTransform done: torque' = torque - d x F.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from defusedxml import ElementTree
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, finite_array, rotation_matrix
from cabols_control.errors import ConfigError
from cabols_control.files.plain_numbers import plain_number
from cabols_control.rotations import cross_matrix

AXES = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
DELTA_LIMITS = (165.0, 165.0, 495.0, 15.0, 15.0, 15.0)
"""Range of an ATI Delta SI-165-15 [N, N m]."""

POUND, STANDARD_GRAVITY, INCH = 4.4482216152605, 9.80665, 0.0254
FORCE = {
    **dict.fromkeys(("n", "newton", "newtons"), 1.0),
    "kn": 1e3,
    **dict.fromkeys(("lb", "lbs", "lbf", "pound", "pounds"), POUND),
    **dict.fromkeys(("klb", "klbf"), 1e3 * POUND),
    **dict.fromkeys(("kg", "kgf", "kilogram", "kilograms"), STANDARD_GRAVITY),
    **dict.fromkeys(("g", "gf", "gram", "grams"), 1e-3 * STANDARD_GRAVITY),
}
DISTANCE = {
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), 1.0),
    "cm": 1e-2,
    "mm": 1e-3,
    **dict.fromkeys(("in", "inch", "inches"), INCH),
    **dict.fromkeys(("ft", "foot", "feet"), 12.0 * INCH),
}
TORQUE = {
    **{first + force: DISTANCE[first] * FORCE[force]
       for first in ("in", "ft", "inch", "foot") for force in FORCE},
    **{force + second: FORCE[force] * DISTANCE[second] for force in FORCE for second in DISTANCE},
}  # fmt: skip
"""Force and distance written as one word: nm, nmm, knm, lbin, inlb."""
CONVERTER_VOLTS = 10.0
"""The card's analog inputs end here [V]."""
SATURATED_SHARE = 0.998
"""Of a range, beyond which a gauge is saturated: some converters stop short of their end."""
ANALOG_MODES = ("differential", "single ended", "single-ended", "ground referenced",
                "nonreferenced single ended", "non-referenced single-ended")  # fmt: skip


class CalibrationWarning(UserWarning):
    """A calibration file says something that is not done."""


@dataclass(frozen=True, eq=False)
class AtiCalibration:
    """One calibration of one sensor.

    Attributes:
        serial: of the sensor.
        part_number: of the calibration, e.g. SI-165-15.
        matrix: (6, 6) wrench per gauge volt [N/V, N m/V], at the file's origin and axes.
        limits: (6,) the calibrated range [N, N m].
        saturated_volts: largest valid voltage of a gauge; beyond it, it is saturated [V].
        notes: what the file says and is not done, in words for people.
    """

    serial: str
    part_number: str
    matrix: FloatArray
    limits: FloatArray
    saturated_volts: float = SATURATED_SHARE * CONVERTER_VOLTS
    notes: tuple[str, ...] = ()


def read_calibration(path: str | Path, part_number: str | None = None) -> AtiCalibration:
    """Read a .cal file.

    Args:
        path: of the file.
        part_number: of the calibration, where the file has several; None: its only one.

    Raises:
        ConfigError: naming the file, what was expected and what came.
    """
    try:
        text = Path(path).read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error})") from error
    return parse_calibration(text, str(path), part_number)


def parse_calibration(
    text: str | bytes, name: str, part_number: str | None = None
) -> AtiCalibration:
    """Make a calibration from the text of a .cal file.

    What the file says and is not done is refused where it makes the wrench wrong, and said by a
    CalibrationWarning otherwise. Fields as in ATI's own library.

    Args:
        text: XML, one FTSensor.
        name: of the file, for messages.
        part_number: of the calibration, where the file has several; None: its only one.

    Raises:
        ConfigError: naming what was expected and what came.
    """
    try:
        sensor = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise ConfigError(f"{name}: expected the XML of an ATI calibration, got {error}") from error
    calibration = _chosen(sensor, name, part_number)
    _six_gauges(sensor, name)
    gain = calibration.get("GainMultiplier", "1")
    if not _number(gain) == 1.0:
        raise ConfigError(f"{name}: GainMultiplier: expected 1, got {gain}; ask ATI for volts")
    units = np.repeat([_force_unit(calibration, name), _torque_unit(calibration, name)], 3)
    user = _axes(calibration, "UserAxis", name)
    if user:
        matrix, limits = _rows(user, name, lambda _: 1.0)
        return _finished(sensor, calibration, units[:, None] * matrix, units * limits, name)
    # Files of version 1.0: rows times a scale, not yet transformed.
    axes = _axes(calibration, "Axis", name)
    matrix, limits = _rows(axes, name, lambda axis: _number(axis.get("scale", "")))
    matrix = _basic_transform(calibration, name) @ (units[:, None] * matrix)
    return _finished(sensor, calibration, matrix, units * limits, name)


def _chosen(sensor: Any, name: str, part_number: str | None) -> Any:
    """Return the calibration that is asked for."""
    found = sensor.findall("Calibration")
    parts = [str(each.get("PartNumber", "")) for each in found]
    if sensor.tag != "FTSensor" or not found:
        raise ConfigError(
            f"{name}: expected one Calibration in an FTSensor, got {len(found)} in {sensor.tag}"
        )
    if part_number is None:
        if len(found) > 1:
            raise ConfigError(
                f"{name}: expected one Calibration in an FTSensor, got {len(found)} "
                f"({', '.join(parts)}); choose by ft_calibration_part"
            )
        return found[0]
    if parts.count(part_number) != 1:
        raise ConfigError(
            f"{name}: expected one Calibration of the part number {part_number}, got "
            f"{', '.join(parts)}; correct ft_calibration_part"
        )
    return found[parts.index(part_number)]


def _six_gauges(sensor: Any, name: str) -> None:
    gauges = sensor.get("NumGages", "6")
    if not _number(gauges) == 6.0:
        raise ConfigError(
            f"{name}: NumGages: expected a sensor of 6 gauges, got {gauges}; its matrix is no "
            "(6, 6)"
        )


def _axes(calibration: Any, tag: str, name: str) -> dict[str | None, Any]:
    """Axes by name; each may stand once."""
    found: dict[str | None, Any] = {}
    for axis in calibration.findall(tag):
        key = axis.get("Name")
        if key in found:
            raise ConfigError(f"{name}: {tag} {key}: expected it once, got it twice; which holds?")
        found[key] = axis
    return found


def _saturated_volts(calibration: Any, name: str) -> float:
    """Largest valid voltage by the sensor's output range, which spans both polarities."""
    bipolar = calibration.get("OutputBipolar", "True").strip().lower()
    if bipolar not in ("true", "1", "yes"):
        raise ConfigError(
            f"{name}: OutputBipolar: expected True, got {calibration.get('OutputBipolar')}; "
            "gauges are judged in a range that is symmetric about zero"
        )
    text = calibration.get("OutputRange", str(2.0 * CONVERTER_VOLTS))
    span = _number(text)
    if not 0.0 < span < np.inf:
        raise ConfigError(f"{name}: OutputRange: expected volts, got {text!r}")
    return SATURATED_SHARE * min(0.5 * span, CONVERTER_VOLTS)


def _notes(calibration: Any, name: str) -> tuple[str, ...]:
    """What the file says and is not done."""
    notes = []
    mode = calibration.get("OutputMode", "").strip().lower()
    if mode and not any(known in mode for known in ANALOG_MODES):
        notes.append(
            f"OutputMode: {calibration.get('OutputMode')} is none of an analog output that is "
            "known here; check the gauges' wiring"
        )
    slopes = [_values(calibration, tag) for tag in ("BiasSlope", "GainSlope")]
    in_hardware = calibration.get("HWTempComp", "").strip().lower()
    if in_hardware not in ("", "true", "1", "yes"):
        notes.append(
            f"HWTempComp: {calibration.get('HWTempComp')}: temperature is not compensated, neither "
            "by the sensor nor here; tare often"
        )
    elif not in_hardware and any(value != 0.0 for value in (*slopes[0], *slopes[1])):
        notes.append(
            "BiasSlope, GainSlope: compensation of temperature by software is not done here; "
            "tare often"
        )
    return tuple(f"{name}: {note}" for note in notes)


def _values(calibration: Any, tag: str) -> list[float]:
    element = calibration.find(tag)
    return [] if element is None else [_number(v) for v in element.get("values", "").split()]


def _finished(
    sensor: Any, calibration: Any, matrix: FloatArray, limits: FloatArray, name: str
) -> AtiCalibration:
    if not (np.isfinite(matrix).all() and np.linalg.cond(matrix) < 1e6):
        raise ConfigError(f"{name}: expected six independent finite rows, got a singular matrix")
    if not (np.isfinite(limits).all() and (limits > 0.0).all()):
        raise ConfigError(f"{name}: max: expected positive numbers, got {limits.tolist()}")
    serial = sensor.get("Serial") or sensor.get("SerialNumber") or ""
    matrix = np.ascontiguousarray(matrix)
    notes = _notes(calibration, name)
    for note in notes:
        warnings.warn(note, CalibrationWarning, stacklevel=4)
    return AtiCalibration(
        serial=serial,
        part_number=calibration.get("PartNumber", ""),
        matrix=matrix,
        limits=limits,
        saturated_volts=_saturated_volts(calibration, name),
        notes=notes,
    )


def _number(text: str) -> float:
    try:
        return plain_number(text.strip())
    except ValueError:
        return float("nan")


def _rows(
    axes: dict[str | None, Any], name: str, scale: Callable[[Any], float]
) -> tuple[FloatArray, FloatArray]:
    missing = [axis for axis in AXES if axis not in axes]
    if missing:
        raise ConfigError(f"{name}: expected the axes {', '.join(AXES)}, {missing} are missing")
    matrix, limits = np.zeros((6, 6)), np.zeros(6)
    for i, axis in enumerate(AXES):
        values = axes[axis].get("values", "")
        row = [_number(value) for value in values.split()]
        if len(row) != 6:
            raise ConfigError(f"{name}: {axis}: expected 6 values, got {len(row)}: {values!r}")
        matrix[i] = np.array(row) / scale(axes[axis])
        limits[i] = _number(axes[axis].get("max", ""))
    return matrix, limits


def _unit(units: dict[str, float], text: str, key: str, name: str) -> float:
    word = text.strip().lower()
    if word not in units:
        raise ConfigError(f"{name}: {key}: expected one of {sorted(units)}, got {text!r}")
    return units[word]


def _force_unit(calibration: Any, name: str) -> float:
    return _unit(FORCE, calibration.get("ForceUnits", ""), "ForceUnits", name)


def _torque_unit(calibration: Any, name: str) -> float:
    """Force times distance, in either order, with or without a sign between: N-m, Nmm, lbf-in."""
    text = calibration.get("TorqueUnits", "")
    parts = re.split(r"[-*\s.\u00b7\u22c5]+", text.strip().lower())
    if len(parts) == 1 and parts[0] in TORQUE:
        return TORQUE[parts[0]]
    for force, distance in (parts, parts[::-1]) if len(parts) == 2 else ():
        if force in FORCE and distance in DISTANCE:
            return FORCE[force] * DISTANCE[distance]
    raise ConfigError(f"{name}: TorqueUnits: expected force-distance, e.g. N-m, got {text!r}")


def _basic_transform(calibration: Any, name: str) -> FloatArray:
    """(6, 6) of the BasicTransform element; distances, then angles about x, y, z in degrees."""
    element = calibration.find("BasicTransform")
    if element is None:
        return np.eye(6)
    unit = _unit(DISTANCE, calibration.get("DistUnits", ""), "DistUnits", name)
    offset = [_number(element.get(key, "0")) for key in ("Dx", "Dy", "Dz")]
    angles = [_number(element.get(key, "0")) for key in ("Rx", "Ry", "Rz")]
    if angles != [0.0, 0.0, 0.0]:
        raise ConfigError(
            f"{name}: BasicTransform: expected no rotation, got {angles}; give the sensor's "
            "orientation in sensor_rotation"
        )
    # The element names the new origin, seen from the old one.
    return wrench_transform(-unit * np.array(offset), np.eye(3))


def wrench_transform(position: ArrayLike, rotation: ArrayLike) -> FloatArray:
    """Matrix from a wrench in a sensor's frame S to the same wrench in a frame P.

    Args:
        position: (3,) origin of S, seen from the origin of P, in axes P [m].
        rotation: (3, 3) from axes S to axes P.

    Returns:
        (6, 6); force F_P = R F_S, torque T_P = R T_S + position x F_P.

    Raises:
        ShapeError: if an argument is not of its shape, not finite or no rotation.
    """
    turn = rotation_matrix("rotation", rotation)
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = matrix[3:, 3:] = turn
    matrix[3:, :3] = cross_matrix(finite_array("position", position, (3,))) @ turn
    return matrix


def shift_wrench(wrench: ArrayLike, offset: ArrayLike) -> FloatArray:
    """Move a wrench to another point of the same body: torque' = torque - offset x force.

    Args:
        wrench: (6,) force [N] then torque [N m], about a point A.
        offset: (3,) from A to the new point, same axes [m].

    Returns:
        (6,) the same wrench about the new point.

    Raises:
        ShapeError: if an argument is not of its shape or not finite.
    """
    value = finite_array("wrench", wrench, (6,))
    arm = finite_array("offset", offset, (3,))
    return np.concatenate([value[:3], value[3:] - np.cross(arm, value[:3])])


def saturated_axes(wrench: ArrayLike, limits: ArrayLike) -> tuple[str, ...]:
    """Names of the axes, of AXES, beyond the sensor's range; one that is NaN is, too.

    Args:
        wrench: (6,) on the sensor, the tool's weight included, sensor axes [N, N m].
        limits: (6,) range [N, N m].
    """
    pairs = zip(AXES, np.asarray(wrench, dtype=float), np.asarray(limits), strict=True)
    return tuple(axis for axis, value, limit in pairs if not abs(value) <= limit)
