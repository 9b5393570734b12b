# SPDX-License-Identifier: Apache-2.0
"""The platform's pose from its cables' lengths: arguments checked, answers with their meaning."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from math import pi

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import chi2

from cabols_control.checks import (
    FloatArray,
    finite_array,
    in_range,
    one_or_each,
    rotation_matrix,
)
from cabols_control.errors import OutOfRangeError
from cabols_control.geometry import RigGeometry

from . import search
from .task import MOST_CABLES, pose_task, pose_work

MISSED = 1e-9
"""Probability of an error of the lengths beyond what counts as noise."""
BOXES_LOOKED_AT = 20_000
"""About 60 ms at most."""
LEAST_STD_M, LARGEST_STD_M = 1e-12, 1.0


class PoseState(IntEnum):
    """What is known of the pose."""

    KNOWN = search.KNOWN
    """It is the only pose of the region with these lengths: shown, not sampled."""
    NOT_FOUND = search.NOT_FOUND
    """None was found, and that there is none was not shown."""
    NO_POSE = search.NO_POSE
    """No pose of the region has these lengths: a length is wrong, or the platform elsewhere."""
    NOT_ALONE = search.NOT_ALONE
    """Several poses of the region have these lengths; one of them is returned."""
    NOT_SHOWN = search.NOT_SHOWN
    """One was found; that it is the only one was not shown."""


@dataclass(frozen=True, eq=False)
class PoseRegion:
    """Where the platform may be.

    Attributes:
        position: (3,) of its middle, base frame [m].
        rotation: (3, 3) from platform to base axes in the middle.
        half_widths: (3,) along the base axes [m].
        largest_turn: from `rotation`, about any axis [rad], up to pi.
    """

    position: FloatArray
    rotation: FloatArray
    half_widths: FloatArray
    largest_turn: float

    def __post_init__(self) -> None:
        """Check shapes and sizes."""
        keep = object.__setattr__
        keep(self, "position", finite_array("position", self.position, (3,)))
        keep(self, "rotation", rotation_matrix("rotation", self.rotation))
        half = finite_array("half_widths", self.half_widths, (3,))
        if not (half >= 0.0).all():
            raise OutOfRangeError("half_widths", float(half.min()), 0.0, np.inf)
        keep(self, "half_widths", half)
        keep(self, "largest_turn", in_range("largest_turn", self.largest_turn, 0.0, pi))


@dataclass(frozen=True, eq=False)
class FoundPose:
    """Answer of a forward kinematics.

    Attributes:
        state: what is known; a pose may be used as the platform's in state KNOWN alone.
        position: (3,) of the platform's origin, base frame [m]; NaN where none was found.
        rotation: (3, 3) from platform to base axes.
        covariance: (6, 6) of position [m] and rotation vector [rad], base axes; NaN likewise, and
            zero along what the platform cannot move.
        residual: (n,) given less computed lengths of the best pose [m].
    """

    state: PoseState
    position: FloatArray
    rotation: FloatArray
    covariance: FloatArray
    residual: FloatArray


class PoseFinder:
    """Finds poses of one robot from lengths, in compiled code; one for each thread.

    Attributes:
        cables: (n,) records of CABLE.
        task: record of POSE_TASK, for the compiled `search.locate` in loops of one's own.
        work: record of POSE_WORK, its scratch.
    """

    def __init__(self, geometry: RigGeometry, length_std: ArrayLike, region: PoseRegion) -> None:
        """Prepare a robot.

        Args:
            geometry: of n cables.
            length_std: standard deviation of the lengths' errors, one or (n,) [m].
            region: where the platform may be.

        Raises:
            ShapeError: if an argument has another shape or is not finite.
            OutOfRangeError: if a standard deviation is not above zero, or there are more cables
                than the records have room for.
        """
        n, directions = geometry.cables, geometry.motion.directions
        in_range("cables", n, geometry.motion.freedom, MOST_CABLES)
        std = one_or_each("length_std", length_std, n)
        for value in std:
            in_range("length_std", value, LEAST_STD_M, LARGEST_STD_M)
        arms = _arms(geometry)
        self.cables, self.work, self.task = geometry.records(), pose_work(), pose_task()
        task = self.task
        task["cables"], task["freedom"] = n, directions.size
        task["directions"][: directions.size] = directions
        task["bound"] = np.sqrt(chi2.isf(MISSED, n))
        task["information"][:n], task["variance"][:n] = std**-2.0, std**2.0
        task["tolerance"][:n], task["arms"][:n] = task["bound"] * std, arms
        task["scale"] = max(arms.mean(), 1e-3 * np.ptp(geometry.base_points, axis=0).max())
        self.look_in(region)

    def look_in(self, region: PoseRegion) -> None:
        """Look in another region from now on.

        Args:
            region: where the platform may be. What it cannot move along stays as in the middle.
        """
        task = self.task
        moves = np.isin(np.arange(6), task["directions"][: task["freedom"]])
        task["centre"][:], task["rotation"][:] = region.position, region.rotation
        task["half_widths"][:] = moves * np.r_[region.half_widths, [region.largest_turn] * 3]

    def find(self, lengths: ArrayLike, boxes: int = BOXES_LOOKED_AT) -> FoundPose:
        """Find the pose whose cables have these lengths.

        Args:
            lengths: (n,) of the cables, as `cable_lengths` gives them, with arcs on pulleys [m].
            boxes: effort: largest number of parts of the region to look at.

        Returns:
            The pose, and whether it is the only one of the region.

        Raises:
            ShapeError: if the lengths are not (n,) finite numbers.
        """
        n, task, work = self.cables.size, self.task, self.work
        given = finite_array("lengths", lengths, (n,))
        covariance, residual = np.zeros((6, 6)), np.zeros(n)
        work["position"][:], work["rotation"][:] = task["centre"], task["rotation"]
        found = search.locate(self.cables, task, given, boxes, work, covariance, residual)
        state = PoseState(found)
        if state in (PoseState.NOT_FOUND, PoseState.NO_POSE):
            none = np.full((3, 3), np.nan)
            return FoundPose(state, none[0], none, np.full((6, 6), np.nan), residual)
        place, turn = work["position"].copy(), work["rotation"].copy()
        return FoundPose(state, place, turn, covariance, residual)


def _arms(geometry: RigGeometry) -> FloatArray:
    """(n,) distance of the platform points from what they turn about [m]."""
    turns = [row - 3 for row in geometry.motion.directions if row >= 3]
    points = geometry.platform_points @ geometry.reference_rotation.T
    if not turns:
        return np.zeros(geometry.cables)
    if len(turns) == 1:
        points = np.delete(points, turns[0], axis=1)
    return np.asarray(np.linalg.norm(points, axis=1))


def stretched_lengths(
    unstretched: ArrayLike,
    tension: ArrayLike,
    stiffness: ArrayLike,
    unstretched_std: ArrayLike = 0.0,
    tension_std: ArrayLike = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Lengths of cables under tension, and their standard deviations.

    Args:
        unstretched: (n,) lengths without tension, by the encoders [m].
        tension: (n,) [N].
        stiffness: k_e of spring and cable, one or (n,) [N/m].
        unstretched_std: standard deviation of the lengths, one or (n,) [m].
        tension_std: of the tensions, one or (n,) [N].

    Returns:
        (n,) lengths, (n,) standard deviations [m].

    Raises:
        ShapeError: if an argument has another shape or is not finite.
        OutOfRangeError: if a stiffness is not above zero.
    """
    free = finite_array("unstretched", unstretched, (None,))
    n = free.size
    pull = finite_array("tension", tension, (n,))
    spring = one_or_each("stiffness", stiffness, n)
    if not (spring > 0.0).all():
        raise OutOfRangeError("stiffness", float(spring.min()), 0.0, np.inf)
    own = one_or_each("unstretched_std", unstretched_std, n)
    pulled = one_or_each("tension_std", tension_std, n)
    return free + pull / spring, np.hypot(own, pulled / spring)
