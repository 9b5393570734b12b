"""What a forward kinematics is asked for: cables, freedom, noise, and where the platform may be."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cabols_control.checks import FloatArray, IntArray


class PoseTask(NamedTuple):
    """Arguments of the compiled forward kinematics, checked.

    Attributes:
        cables: (n,) records of CABLE.
        directions: (m,) rows of the structure matrix along which the platform can move: 0 to 2
            along x, y, z, 3 to 5 about them (base axes).
        information: (n,) inverse variances of the lengths [1/m^2].
        tolerance: (n,) largest error of a length that its noise explains [m].
        bound: largest root of the sum of squared errors, in standard deviations, that it explains.
        arms: (n,) distance of a platform point from the axis or point it turns about [m].
        scale: length at which an angle counts as a distance [m].
        centre: (3,) of the region where the platform may be, base frame [m].
        rotation: (3, 3) from platform to base axes in the region's middle.
        half_widths: (6,) of the region: three of position [m]; then, three times, the largest
            turn from `rotation` about any axis [rad]. Zero along what the platform cannot move.
    """

    cables: Any
    directions: IntArray
    information: FloatArray
    tolerance: FloatArray
    bound: float
    arms: FloatArray
    scale: float
    centre: FloatArray
    rotation: FloatArray
    half_widths: FloatArray


class PoseWork(NamedTuple):
    """Arrays that the kernels fill; one set for each thread.

    Attributes:
        position: (3,) answer [m].
        rotation: (3, 3) answer.
        residual: (n,) given less computed lengths [m].
        matrix: (6, n) structure matrix there.
        normal: (m, m) inverse of the normal matrix: the answer's covariance.
        step: (m,) of the last iteration [m, rad].
        move: (6,) the same, zero along what the platform cannot move.
        trial_position: (3,) scratch.
        trial_rotation: (3, 3) scratch.
        inverse: (m, n) from changes of lengths to changes of pose.
        near_position: (3,) scratch of the search.
        near_rotation: (3, 3) scratch of the search.
        boxes: (BOXES, 12) scratch of the search: centres, half widths.
    """

    position: FloatArray
    rotation: FloatArray
    residual: FloatArray
    matrix: FloatArray
    normal: FloatArray
    step: FloatArray
    move: FloatArray
    trial_position: FloatArray
    trial_rotation: FloatArray
    inverse: FloatArray
    near_position: FloatArray
    near_rotation: FloatArray
    boxes: FloatArray


BOXES = 400
"""Depth of the search's stack: each split adds one, and halves a side."""


def pose_work(cables: int, freedom: int) -> PoseWork:
    """Return scratch for so many cables, and so many directions of motion."""
    return PoseWork(
        position=np.zeros(3),
        rotation=np.eye(3),
        residual=np.zeros(cables),
        matrix=np.zeros((6, cables)),
        normal=np.zeros((freedom, freedom)),
        step=np.zeros(freedom),
        move=np.zeros(6),
        trial_position=np.zeros(3),
        trial_rotation=np.eye(3),
        inverse=np.zeros((freedom, cables)),
        near_position=np.zeros(3),
        near_rotation=np.eye(3),
        boxes=np.zeros((BOXES, 12)),
    )
