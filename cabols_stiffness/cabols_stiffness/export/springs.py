# SPDX-License-Identifier: Apache-2.0
"""Springs of a robot's joints, as far as a simulator's file can hold them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.errors import CabolsError
from cabols_control.naming import joint_names
from cabols_stiffness.model.identity import require_usable
from cabols_stiffness.model.model_words import LINEAR
from cabols_stiffness.model.result import StiffnessResult
from cabols_stiffness.model.robot import RobotModel

DAMPING_S = 1e-3
"""Damping of a spring, of its stiffness [s]; nothing of it was measured, without it simulators
swing for ever."""


@dataclass(frozen=True, eq=False)
class Springs:
    """Of n joints.

    Attributes:
        stiffness: (n,) [N m/rad], of joints that slide [N/m].
        friction: (n,) [N m, N]; zero where none was found.
        left_out: what of the result the file cannot hold, for people.
    """

    stiffness: FloatArray
    friction: FloatArray
    left_out: tuple[str, ...]

    @property
    def damping(self) -> FloatArray:
        """(n,) [N m s/rad, N s/m]."""
        return DAMPING_S * self.stiffness


def springs_of(result: StiffnessResult, robot: RobotModel) -> Springs:
    """Springs of a result that may be used with a robot.

    Args:
        result: of an identification.
        robot: that it is of.

    Raises:
        UnusableResultError: if it is of another robot, or its model does not explain its data.
        CabolsError: if a joint was not identified.
    """
    require_usable(result, robot)
    if robot.coupling is not None:
        raise CabolsError(
            f"{robot.name}: expected joints with drives of their own, got coupled ones; a spring a "
            "joint cannot hold them"
        )
    if not result.identifiable.all():
        missing = joint_names(np.flatnonzero(~result.identifiable))
        raise CabolsError(
            f"result: expected all joints identified, got none for {missing}; load them more"
        )
    left = []
    if result.elastic is not None and len(result.elastic.arm.blocks) > 1:
        rungs = [
            block.rung.value for block in result.elastic.arm.blocks if block.rung.value != "joints"
        ]
        left.append(f"besides the joints what gives way: {', '.join(rungs)}")
    elif result.model != LINEAR:
        left.append(f"the {result.model} part of the joints' law")
    return Springs(result.stiffness, np.maximum(result.friction, 0.0), tuple(left))
