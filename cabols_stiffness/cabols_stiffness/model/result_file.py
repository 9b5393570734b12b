# SPDX-License-Identifier: Apache-2.0
"""result.yaml: an identification's numbers, for people and for programs.

Unknown keys, such as the provenance that a report adds, are ignored.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from cabols_control.checks import FloatArray, finite_array
from cabols_control.configuration import read_yaml
from cabols_control.errors import CabolsError, ConfigError
from cabols_stiffness.model.elastic.file import ELASTIC, read_elastic, write_elastic
from cabols_stiffness.model.model_words import LINEAR, MODELS
from cabols_stiffness.model.result import Origin, StiffnessResult
from cabols_stiffness.model.robot import RobotModel
from cabols_stiffness.model.verdict_file import read_verdict, verdict_mapping

FORMAT = "cabols stiffness 1"


def to_mapping(result: StiffnessResult, robot: RobotModel) -> dict[str, Any]:
    """Return the content of result.yaml as plain numbers and lists; None stands for NaN.

    Args:
        result: of an identification.
        robot: that it is of.
    """
    deviation, cubic_deviation = result.standard_deviation, result.cubic_deviation
    joints = []
    for j in range(result.n):
        joint = {
            "joint": j + 1,
            "identifiable": bool(result.identifiable[j]),
            "stiffness_nm_per_rad": _plain(result.stiffness[j]),
            "standard_deviation_nm_per_rad": _plain(deviation[j]),
            "interval_95_nm_per_rad": _plain(result.interval[j]),
            "largest_deflection_rad": float(result.joint_range[j]),
            "friction_nm": float(result.friction[j]),
            "friction_deviation_nm": float(result.friction_deviation[j]),
            "friction_reach_rad": float(result.friction_reach[j]),
        }
        if result.cubic is not None:
            assert cubic_deviation is not None
            assert result.cubic_interval is not None
            joint["cubic_identifiable"] = bool(result.cubic_identifiable[j])
            joint["cubic_nm_per_rad3"] = _plain(result.cubic[j])
            joint["cubic_deviation_nm_per_rad3"] = _plain(cubic_deviation[j])
            joint["cubic_interval_95_nm_per_rad3"] = _plain(result.cubic_interval[j])
        joints.append(joint)
    return {
        "format": FORMAT,
        "model": result.model,
        "joints": joints,
        "covariance": _plain(result.covariance),
        "residual_rms": float(result.residual_rms),
        "degrees_of_freedom": int(result.degrees_of_freedom),
        "samples": int(result.samples),
        "outliers": [int(index) for index in result.outliers],
        "iterations": int(result.iterations),
        "converged": bool(result.converged),
        "parameters": _plain(result.parameters),
        "parameter_covariance": _plain(result.parameter_covariance),
        "robot": {
            "name": robot.name,
            "joint_names": list(robot.joint_names),
            "kinematics_sha256": robot.kinematics,
            "tool_position_m": _plain(robot.tool_position),
            "tool_rotation": _plain(robot.tool_rotation),
        },
        "range": _range(result),
        "verdict": None if result.verdict is None else verdict_mapping(result.verdict),
    }


def _range(result: StiffnessResult) -> dict[str, Any] | None:
    """Return where the data were taken."""
    origin = result.origin
    if origin is None or origin.joints is None or origin.wrench is None:
        return None
    return {"joints": _plain(origin.joints), "wrench_max": _plain(origin.wrench)}


def _origin(content: dict[str, Any]) -> Origin | None:
    robot, where = content.get("robot"), content.get("range")
    if not isinstance(robot, dict):
        return None
    return Origin(
        robot=str(robot.get("name", "")),
        joint_names=tuple(str(name) for name in robot.get("joint_names", ())),
        kinematics=str(robot.get("kinematics_sha256", "")),
        joints=None if not where else _numbers(where["joints"]),
        wrench=None if not where else _numbers(where["wrench_max"]),
    )


def from_mapping(content: dict[str, Any]) -> StiffnessResult:
    """Return the result that a mapping of to_mapping holds.

    Raises:
        ConfigError: if it is of another format or a key is missing or wrong.
    """
    if content.get("format") != FORMAT:
        raise ConfigError(f"format: expected {FORMAT!r}, got {content.get('format')!r}")
    try:
        return _result(content)
    except (KeyError, TypeError, IndexError) as error:
        raise ConfigError(
            f"result: expected the keys of {FORMAT!r}, got none of {error}"
        ) from error
    except CabolsError as error:
        raise ConfigError(f"result: {error}") from error


def tool_of(content: dict[str, Any]) -> tuple[FloatArray, FloatArray]:
    """Tool (3,) [m] and (3, 3), flange axes, that the result of a mapping is about.

    Raises:
        ConfigError: if it is missing or has another shape.
    """
    try:
        robot = content["robot"]
        position = finite_array("tool_position_m", robot["tool_position_m"], (3,))
        return position, finite_array("tool_rotation", robot["tool_rotation"], (3, 3))
    except (KeyError, TypeError) as error:
        raise ConfigError(
            f"robot: expected tool_position_m and tool_rotation, got none of {error}"
        ) from error
    except CabolsError as error:
        raise ConfigError(f"robot: {error}") from error


def _result(content: dict[str, Any]) -> StiffnessResult:
    model, joints = content["model"], content["joints"]
    if model not in MODELS or not joints:
        raise ConfigError(f"result: expected joints and a known model, got {model!r}")
    with_cubic, n = model != LINEAR, len(joints)
    size = 2 * n if with_cubic else n

    def column(key: str) -> FloatArray:
        return _numbers([joint[key] for joint in joints])

    return StiffnessResult(
        model=model,
        stiffness=column("stiffness_nm_per_rad"),
        cubic=column("cubic_nm_per_rad3") if with_cubic else None,
        covariance=_numbers(content["covariance"]).reshape(size, size),
        identifiable=np.array([bool(joint["identifiable"]) for joint in joints]),
        cubic_identifiable=np.array([bool(joint.get("cubic_identifiable")) for joint in joints]),
        interval=column("interval_95_nm_per_rad").reshape(n, 2),
        cubic_interval=column("cubic_interval_95_nm_per_rad3").reshape(n, 2)
        if with_cubic
        else None,
        residual_rms=float(content["residual_rms"]),
        degrees_of_freedom=int(content["degrees_of_freedom"]),
        samples=int(content["samples"]),
        outliers=np.array(content["outliers"], dtype=np.int64),
        iterations=int(content["iterations"]),
        converged=bool(content["converged"]),
        parameters=finite_array("parameters", content["parameters"], (2 * n,)),
        parameter_covariance=finite_array(
            "parameter_covariance", content["parameter_covariance"], (2 * n, 2 * n)
        ),
        joint_range=column("largest_deflection_rad"),
        friction=column("friction_nm"),
        friction_deviation=column("friction_deviation_nm"),
        friction_reach=column("friction_reach_rad"),
        verdict=read_verdict(content.get("verdict")),
        origin=_origin(content),
    )


def write_result(
    path: str | Path,
    result: StiffnessResult,
    robot: RobotModel,
    more: dict[str, Any] | None = None,
) -> None:
    """Write result.yaml; `more` are further top-level keys, such as the provenance.

    Args:
        path: of the file.
        result: of an identification.
        robot: that it is of.
        more: further top-level keys, such as the provenance.
    """
    content = {**to_mapping(result, robot), **(more or {})}
    if result.elastic is not None:
        content["elastic"] = ELASTIC
        write_elastic(Path(path).with_name(ELASTIC), result.elastic)
    text = yaml.safe_dump(content, sort_keys=False, width=100, default_flow_style=None)
    Path(path).write_text(text, encoding="utf-8")


def read_result(path: str | Path) -> StiffnessResult:
    """Read result.yaml.

    Raises:
        ConfigError: naming the file and what is wrong with it.
    """
    content = read_yaml(path)
    try:
        result = from_mapping(content)
        if content.get("elastic") is None:
            return result
        return replace(result, elastic=read_elastic(Path(path).with_name(ELASTIC)))
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error


def _plain(value: Any) -> Any:
    array = np.asarray(value, dtype=np.float64)
    if array.ndim == 0:
        number = float(array)
        return number if np.isfinite(number) else None
    return [_plain(item) for item in array]


def _numbers(value: Any) -> FloatArray:
    # None becomes NaN.
    return np.array(value, dtype=np.float64)
