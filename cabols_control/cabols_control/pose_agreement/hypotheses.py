# SPDX-License-Identifier: Apache-2.0
"""What may be wrong where sources of the platform's pose disagree, and what each would look like.

The springs turn lengths into forces: the residual is the sensor's wrench less A tension, with
tensions k_e times elongations from the robot's pose and the encoders, and none where that is below
zero: a slack cable does not push. A fault that changes the
elongations by e leaves the residual -A K e: along one column for a cable that slipped, along two
for exchanged encoders. A wrong tool puts the platform elsewhere, so that it changes the lengths,
the directions of the cables and the axes of the sensor, less what was so when the limbs were
zeroed. A bumped tracker leaves nothing in the cables.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.cable_kernels import cable_lengths_unchecked, structure_matrix_unchecked
from cabols_control.checks import FloatArray
from cabols_control.naming import limb_names

STEP = 1e-6
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
        residual: (6,) sensor's wrench less A pull, base axes, about the platform's origin.
        matrix: (6, n) structure matrix.
        pulled: (6, n) structure matrix times k_e [N/m].
        gain: (6, 6) pulled times the structure matrix' transpose: change of the residual by a pose.
        tension: (n,) k_e times elongation; below zero, a cable is slack [N].
        wound: (n,) wound in since zeroing [m].
        rotation: (3, 3) of the platform by the robot.
        position: (3,) likewise [m].
        wrench: (6,) of the cables on the platform by the sensor, base axes [N, N m].
        travel: how far the pose may be off by the motion, standard deviation [m].
        acceleration: of the platform, about [m/s^2].
        covariance: (6, 6) of the residual where nothing is wrong; set once it is known.
    """

    residual: FloatArray
    matrix: FloatArray
    pulled: FloatArray
    gain: FloatArray
    tension: FloatArray
    wound: FloatArray
    rotation: FloatArray
    position: FloatArray
    wrench: FloatArray
    travel: float = 0.0
    acceleration: float = 0.0
    covariance: FloatArray = field(default_factory=lambda: np.eye(6))

    @property
    def pull(self) -> FloatArray:
        """(n,) tensions by the springs: a slack cable does not push [N]."""
        return np.maximum(self.tension, 0.0)


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
    frames: Sequence[Frame], zero: Frame, stiffness: FloatArray, cables: Any, tool: FloatArray
) -> FloatArray:
    """(6 k,) residuals that an error of the tool leaves at k moments, one below the other.

    Args:
        frames: the moments.
        zero: when the limbs were zeroed: what was wrong then is in the zeros.
        stiffness: (n,) k_e [N/m].
        cables: (n,) records of CABLE.
        tool: (6,) error of position [m] and rotation vector [rad], platform axes.
    """
    turn = np.ascontiguousarray(Rotation.from_rotvec(tool[3:]).as_matrix().T)
    at_zero = _lengthened(zero, cables, tool, turn)[0]
    seen = np.empty(6 * len(frames))
    for i, frame in enumerate(frames):
        longer, place, turned = _lengthened(frame, cables, tool, turn)
        really = np.maximum(frame.tension - stiffness * (longer - at_zero), 0.0)
        wrench = structure_matrix_unchecked(cables, place, turned) @ really
        # The sensor's axes turn with the platform; the robot's orientation turns them back.
        back = frame.rotation @ turned.T
        seen[6 * i : 6 * i + 3] = back @ wrench[:3]
        seen[6 * i + 3 : 6 * i + 6] = back @ wrench[3:]
        seen[6 * i : 6 * i + 6] -= frame.matrix @ frame.pull
    return seen


def _lengthened(
    frame: Frame, cables: Any, tool: FloatArray, turn: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """How much longer cables seem by the robot than they are, and where the platform is then."""
    rotation = frame.rotation @ turn
    position = frame.position - rotation @ tool[:3]
    seems = cable_lengths_unchecked(cables, frame.position, frame.rotation)
    return seems - cable_lengths_unchecked(cables, position, rotation), position, rotation


def tool_columns(
    frames: Sequence[Frame],
    zero: Frame,
    stiffness: FloatArray,
    cables: Any,
    tool: FloatArray,
    seen: FloatArray,
) -> FloatArray:
    """(6 k, 6) change of `tool_residual` for each unit of the tool's error, by differences.

    Args:
        frames: the moments.
        zero: when the limbs were zeroed.
        stiffness: (n,) k_e [N/m].
        cables: (n,) records of CABLE.
        tool: (6,) error about which to differ.
        seen: (6 k,) `tool_residual` of it.
    """
    moved = (tool + STEP * unit for unit in np.eye(6))
    ends = [tool_residual(frames, zero, stiffness, cables, each) for each in moved]
    return (np.column_stack(ends) - seen[:, None]) / STEP


def effect(
    suspect: Suspect,
    frame: Frame,
    stiffness: FloatArray,
    unknown: float = 0.0,
    start: float | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Residual that a suspect among the limbs would leave, and its change with the one unknown.

    Args:
        suspect: one of `suspects_of`, not the robot's tool.
        frame: a moment at which it was wrong.
        stiffness: (n,) k_e [N/m].
        unknown: of a slipped cable, how far it has slipped; of exchanged encoders, by how much
            `start` is wrong [m].
        start: for exchanged encoders, what the two limbs differed by, in what was wound, when
            their plugs were exchanged, as far as it is known: a card that counts steps shows each
            the other's way from then on. None: each shows all that the other wound [m].

    Returns:
        (6,) and (6,), the latter as if no cable could be slack.
    """
    limbs, signs, longer = suspect.limbs, [1.0], unknown
    if suspect.fault is Fault.SWAPPED_ENCODERS:
        i, j = limbs
        signs = [1.0, -1.0]
        longer = frame.wound[i] - frame.wound[j] - (start or 0.0) - unknown
    seen, column = np.zeros(6), np.zeros(6)
    for k, sign in zip(limbs, signs, strict=True):
        shown = float(frame.tension[k])
        really = shown - sign * float(stiffness[k]) * longer
        seen += frame.matrix[:, k] * (max(really, 0.0) - max(shown, 0.0))
        column += sign * frame.pulled[:, k]
    return seen, -column if suspect.fault is Fault.SLIPPED_CABLE else column
