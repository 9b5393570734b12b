"""What may be wrong where sources of the platform's pose disagree, and what each would look like.

The springs turn lengths into forces: the residual is the sensor's wrench less A tension, with
tensions k_e times elongations from the robot's pose and the encoders. A fault that changes the
elongations by e leaves the residual -A K e: along one column for a cable that slipped, along two
for exchanged encoders. A wrong tool puts the platform elsewhere, so that it changes the lengths,
the directions of the cables and the axes of the sensor, less what was so when the limbs were
zeroed. A bumped tracker leaves nothing in the cables.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.cable_kernels import cable_lengths_unchecked, structure_matrix_unchecked
from cabols_control.checks import FloatArray
from cabols_control.naming import limb_names

STEP = 1e-5
"""Of numerical differences [m], [rad]."""


class Fault(str, Enum):
    """Kind of what disagrees."""

    SLIPPED_CABLE = "slipped cable"
    SWAPPED_ENCODERS = "swapped encoders"
    ROBOT_TOOL = "robot's tool"
    TRACKER = "tracker"


@dataclass(frozen=True)
class Suspect:
    """What may disagree.

    Attributes:
        fault: kind.
        limbs: indices of the limbs it is about, none for robot and tracker.
    """

    fault: Fault
    limbs: tuple[int, ...] = ()

    def __str__(self) -> str:
        """Name it, for people."""
        return f"{self.fault.value}, {limb_names(self.limbs)}" if self.limbs else self.fault.value


@dataclass(frozen=True, eq=False)
class Frame:
    """One moment of the cables' data.

    Attributes:
        residual: (6,) sensor's wrench less A tension, base axes, about the platform's origin.
        covariance: (6, 6) of it where nothing is wrong.
        matrix: (6, n) structure matrix.
        tension: (n,) k_e times elongation [N].
        wound: (n,) wound in since zeroing [m].
        rotation: (3, 3) of the platform by the robot.
        position: (3,) likewise [m].
    """

    residual: FloatArray
    covariance: FloatArray
    matrix: FloatArray
    tension: FloatArray
    wound: FloatArray
    rotation: FloatArray
    position: FloatArray


def suspects_of(cables: int) -> tuple[Suspect, ...]:
    """All that the cables' data can tell of.

    Args:
        cables: number n.
    """
    pairs = [(i, j) for i in range(cables) for j in range(i + 1, cables)]
    return (
        *(Suspect(Fault.SWAPPED_ENCODERS, pair) for pair in pairs),
        *(Suspect(Fault.SLIPPED_CABLE, (i,)) for i in range(cables)),
        Suspect(Fault.ROBOT_TOOL),
    )


def unknowns(suspect: Suspect) -> int:
    """Number of parameters of a suspect's effect.

    Args:
        suspect: one of `suspects_of`.
    """
    return {Fault.SWAPPED_ENCODERS: 0, Fault.SLIPPED_CABLE: 1, Fault.ROBOT_TOOL: 6}[suspect.fault]


def tool_residual(
    frame: Frame, zero: Frame, stiffness: FloatArray, cables: Any, tool: FloatArray
) -> FloatArray:
    """(6,) residual that an error of the tool leaves.

    Args:
        frame: now.
        zero: when the limbs were zeroed: what was wrong then is in the zeros.
        stiffness: (n,) k_e [N/m].
        cables: (n,) records of CABLE.
        tool: (6,) error of position [m] and rotation vector [rad], platform axes.
    """
    position, rotation = _behind(frame, tool)
    at_zero = _behind(zero, tool)
    longer = (
        cable_lengths_unchecked(cables, frame.position, frame.rotation)
        - cable_lengths_unchecked(cables, position, rotation)
        - cable_lengths_unchecked(cables, zero.position, zero.rotation)
        + cable_lengths_unchecked(cables, *at_zero)
    )
    wrench = structure_matrix_unchecked(cables, position, rotation) @ (
        frame.tension - stiffness * longer
    )
    # The sensor's axes turn with the platform; the robot's orientation turns them back.
    turn = frame.rotation @ rotation.T
    seen = np.concatenate([turn @ wrench[:3], turn @ wrench[3:]])
    return np.asarray(seen - frame.matrix @ frame.tension)


def _behind(frame: Frame, tool: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pose of the platform where the robot's has an error of the tool."""
    turn = Rotation.from_rotvec(tool[3:]).as_matrix()
    rotation = np.ascontiguousarray(frame.rotation @ turn.T)
    return frame.position - rotation @ tool[:3], rotation


def tool_columns(
    frame: Frame, zero: Frame, stiffness: FloatArray, cables: Any, tool: FloatArray
) -> FloatArray:
    """(6, 6) change of `tool_residual` for each unit of the tool's error, by differences.

    Args:
        frame: now.
        zero: when the limbs were zeroed.
        stiffness: (n,) k_e [N/m].
        cables: (n,) records of CABLE.
        tool: (6,) error about which to differ.
    """
    columns = []
    for k in range(6):
        ends = [
            tool_residual(frame, zero, stiffness, cables, tool + sign * STEP * np.eye(6)[k])
            for sign in (1.0, -1.0)
        ]
        columns.append((ends[0] - ends[1]) / (2.0 * STEP))
    return np.column_stack(columns)


def effect(suspect: Suspect, frame: Frame, stiffness: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Residual that a suspect among the limbs would leave: a fixed part, a column per unknown.

    Args:
        suspect: one of `suspects_of`, not the robot's tool.
        frame: now.
        stiffness: (n,) k_e [N/m].

    Returns:
        (6,) and (6, p).
    """
    pulled = frame.matrix * stiffness
    if suspect.fault is Fault.SLIPPED_CABLE:
        return np.zeros(6), -pulled[:, list(suspect.limbs)]
    i, j = suspect.limbs
    # Each shows what the other wound.
    change = frame.wound[i] - frame.wound[j]
    return -(pulled[:, i] - pulled[:, j]) * change, np.zeros((6, 0))
