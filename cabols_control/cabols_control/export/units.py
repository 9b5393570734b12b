# SPDX-License-Identifier: Apache-2.0
"""Units of message fields, from the comments of the message definitions; pure."""

from __future__ import annotations

AXES = ("x", "y", "z")
WRENCH = "wrench"
"""Stands for the units of six numbers: three forces [N], then three torques [N m]."""
WRENCH_PARTS = tuple(
    f"{kind}_{axis}_{unit}" for kind, unit in (("force", "n"), ("torque", "nm")) for axis in AXES
)
QUATERNION = (*AXES, "w")


def _axes(field: str, name: str, unit: str) -> dict[str, tuple[str, str]]:
    return {f"{field}.{axis}": (f"{name}_{axis}", unit) for axis in AXES}


_WRENCH = {**_axes("force", "force", "n"), **_axes("torque", "torque", "nm")}
_POSE = {
    **_axes("position", "position", "m"),
    **{f"orientation.{axis}": (f"orientation_{axis}", "") for axis in QUATERNION},
}


def _below(field: str, names: dict[str, tuple[str, str]]) -> dict[str, tuple[str, str]]:
    return {f"{field}.{inner}": found for inner, found in names.items()}


def _same(unit: str, *fields: str) -> dict[str, tuple[str, str]]:
    return {field: (field, unit) for field in fields}


FIELDS: dict[str, dict[str, tuple[str, str]]] = {
    "cabols_msgs/msg/LimbState": {
        **_same("m", "wound_length", "elongation"),
        **_same("n", "tension"),
        **_same("a", "current"),
        **_same("m_per_s", "cable_speed"),
        **_same("m_per_s2", "cable_acceleration"),
    },
    "cabols_msgs/msg/MotorCurrent": _same("a", "current"),
    "cabols_msgs/msg/TensionCommand": {
        **_same("n", "tension"),
        **_same(WRENCH, "control", "residual", "desired"),
    },
    "cabols_msgs/msg/FrameWrench": {
        **_below("desired", _WRENCH),
        **_below("measured", _WRENCH),
        **_below("uncertainty", _WRENCH),
    },
    "cabols_msgs/msg/PathMotion": {
        **_same("m_per_s", "speed"),
        **_same("rad_per_s", "rotation_speed"),
    },
    "cabols_msgs/msg/DesiredTension": _same("n", "tension"),
    "cabols_msgs/msg/LoopStatus": _same(
        "s", "work_time", "work_time_p99", "round_trip", "round_trip_p99"
    ),
    "cabols_msgs/msg/ReflectorMeasurement": {
        **_axes("position", "position", "m"),
        **_same("m2", "covariance"),
        **_same("m", "rms"),
        **_same("s", "averaging_time"),
        **_same("degc", "temperature"),
    },
    "cabols_msgs/msg/StiffnessEstimate": {
        **_same("nm_per_rad", "stiffness", "standard_deviation"),
        **_same("nm_per_rad3", "cubic", "cubic_deviation"),
    },
    "cabols_msgs/msg/StiffnessLoad": _same("n", "tension"),
    "cabols_msgs/msg/CampaignStatus": _same("s", "remaining"),
    "geometry_msgs/msg/Wrench": _WRENCH,
    "geometry_msgs/msg/WrenchStamped": _below("wrench", _WRENCH),
    "geometry_msgs/msg/Pose": _POSE,
    "geometry_msgs/msg/PoseStamped": _below("pose", _POSE),
    "geometry_msgs/msg/PointStamped": _axes("point", "point", "m"),
    "geometry_msgs/msg/TwistStamped": {
        **_below("twist", _axes("linear", "linear", "m_per_s")),
        **_below("twist", _axes("angular", "angular", "rad_per_s")),
    },
    "sensor_msgs/msg/JointState": {
        **_same("rad", "position"),
        **_same("rad_per_s", "velocity"),
        **_same("nm", "effort"),
    },
    "sensor_msgs/msg/Imu": {
        **_axes("angular_velocity", "angular_velocity", "rad_per_s"),
        **_axes("linear_acceleration", "linear_acceleration", "m_per_s2"),
    },
    "sensor_msgs/msg/Temperature": _same("degc", "temperature"),
}
"""Type -> field -> (name in a table, unit), for all elements of an array."""

HEADER = {
    "header.stamp.sec": None,
    "header.stamp.nanosec": None,
    "header.frame_id": ("frame_id", ""),
    "header.seq": ("header_seq", ""),
}
"""Fields of every header; the stamp becomes one column of nanoseconds."""


def column_name(type_name: str, field: str) -> tuple[str, str]:
    """Return a field's name in a table, without its unit, and the unit; empty: none known.

    Args:
        type_name: e.g. `cabols_msgs/msg/LimbState`; a type that is not known here keeps its names.
        field: dotted name.
    """
    header = HEADER.get(field)
    if header is not None:
        return header
    return FIELDS.get(type_name, {}).get(field, (field.replace(".", "_"), ""))


def with_unit(name: str, unit: str) -> str:
    """Return a column's whole name: `tension_0`, `n` is `tension_0_n`.

    Args:
        name: of the column.
        unit: short name of its unit; empty: none.
    """
    return f"{name}_{unit}" if unit and unit != WRENCH else name
