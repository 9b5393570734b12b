# SPDX-License-Identifier: Apache-2.0
"""Joint stiffness of robots from the deflections under measured wrenches."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cabols_stiffness.identification.identify import identify
    from cabols_stiffness.measurements.samples import PointSamples, Samples
    from cabols_stiffness.model.result import StiffnessResult
    from cabols_stiffness.model.robot import RobotModel, load_robot

__all__ = ["PointSamples", "RobotModel", "Samples", "StiffnessResult", "identify", "load_robot"]

_FOUND_IN = {
    "PointSamples": "measurements.samples",
    "RobotModel": "model.robot",
    "Samples": "measurements.samples",
    "StiffnessResult": "model.result",
    "identify": "identification.identify",
    "load_robot": "model.robot",
}


def __getattr__(name: str) -> Any:
    """Import a name when it is first used: commands that only print help need no pinocchio."""
    if name not in _FOUND_IN:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_FOUND_IN[name]}"), name)
