# SPDX-License-Identifier: Apache-2.0
"""elastic.npz: an identified elastic arm beside result.yaml, as plain arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from cabols_control.errors import ConfigError
from cabols_stiffness.model.elastic.arm import Arm
from cabols_stiffness.model.elastic.blocks import (
    Block,
    Bodies,
    Coupling,
    Cubic,
    Friction,
    Joints,
    Varying,
)
from cabols_stiffness.model.elastic.friction import Form
from cabols_stiffness.model.elastic.prediction import ElasticModel
from cabols_stiffness.model.elastic.variation import Over, variation
from cabols_stiffness.model.model_words import Rung
from cabols_stiffness.model.robot import RobotModel

ELASTIC = "elastic.npz"
FORMAT = "cabols elastic arm 1"


def write_elastic(path: Path, model: ElasticModel) -> None:
    """Write an arm; its robot is written as its kinematics.

    Args:
        path: of the file.
        model: identified.
    """
    robot = model.robot
    content: dict[str, Any] = {
        "format": np.array(FORMAT),
        "rungs": np.array([block.rung.value for block in model.arm.blocks]),
        "values": model.arm.values,
        "covariance": model.covariance,
        "scatter": model.scatter,
        "robot_name": np.array(robot.name),
        "robot_joints": np.array(robot.joint_names),
        "robot_flange": np.array(robot.flange),
    }
    content |= {f"robot_{name}": getattr(robot, name) for name in ROBOT}
    for block in model.arm.blocks:
        for name, value in _arrays(block).items():
            content[f"{block.rung.value}_{name}"] = value
    with path.open("wb") as stream:
        np.savez_compressed(stream, **content)


ROBOT = (
    *("origins", "rotations", "joint_axes", "slides", "limits"),
    *("flange_position", "flange_rotation", "tool_position", "tool_rotation"),
)


def read_elastic(path: Path) -> ElasticModel:
    """Read what write_elastic wrote.

    Raises:
        ConfigError: naming the file and what is wrong with it.
    """
    try:
        with np.load(path, allow_pickle=False) as stored:
            content = {name: stored[name] for name in stored.files}
        if str(content["format"]) != FORMAT:
            raise ConfigError(f"format: expected {FORMAT!r}, got {str(content['format'])!r}")
        blocks = tuple(_block(Rung(str(rung)), content) for rung in content["rungs"])
        robot = RobotModel(
            name=str(content["robot_name"]),
            joint_names=tuple(str(name) for name in content["robot_joints"]),
            flange=str(content["robot_flange"]),
            **{name: content[f"robot_{name}"] for name in ROBOT},
        )
        values, covariance = content["values"], content["covariance"]
        size = sum(block.size for block in blocks)
        if values.shape != (size,) or covariance.shape != (size, size):
            raise ConfigError(f"values: expected {size}, got shape {values.shape}")
        if not (np.isfinite(values).all() and np.isfinite(covariance).all()):
            raise ConfigError("values: expected finite numbers, got others")
        return ElasticModel(robot, Arm(blocks, values), covariance, content["scatter"])
    except (OSError, KeyError, ValueError, BadZipFile) as error:
        raise ConfigError(
            f"{path}: expected the elastic arm that belongs to result.yaml, got {error!r}; keep "
            "both files together"
        ) from error


def _arrays(block: Block) -> dict[str, Any]:
    if isinstance(block, Joints | Cubic | Coupling):
        return {"scale": block.scale}
    if isinstance(block, Bodies):
        return {"body": block.body, "basis": block.basis}
    if isinstance(block, Varying):
        over = block.over
        return {
            "scale": block.scale,
            "over": np.array(over.over.value),
            "length": np.array(over.length),
            "slides": over.slides,
            "centres": over.centres,
        }
    assert isinstance(block, Friction)
    return {
        "form": np.array(block.form.value),
        "joint": block.joint,
        "travel": block.travel,
        "scale": block.scale,
    }


def _block(rung: Rung, content: dict[str, Any]) -> Block:
    def of(name: str) -> Any:
        return content[f"{rung.value}_{name}"]

    match rung:
        case Rung.JOINTS:
            return Joints(of("scale"))
        case Rung.CUBIC:
            return Cubic(of("scale"))
        case Rung.COUPLING:
            return Coupling(of("scale"))
        case Rung.BASE | Rung.LINKS:
            return Bodies(rung, of("body"), of("basis"))
        case Rung.VARYING:
            over = Over(str(of("over")))
            smooth = variation(over, float(of("length")), of("slides"), of("centres"))
            return Varying(of("scale"), smooth)
        case Rung.FRICTION:
            return Friction(Form(str(of("form"))), of("joint"), of("travel"), of("scale"))
        case _:
            raise ValueError(f"rung: expected one that gives way, got {rung.value!r}")
