# SPDX-License-Identifier: Apache-2.0
"""What a forward kinematics is asked for, and its scratch: records, passed by address."""

from __future__ import annotations

from typing import Any

import numpy as np

MOST_CABLES = 16
"""Room of the records."""
BOXES = 400
"""Depth of the search's stack: each split adds one, and halves a side."""
_N = MOST_CABLES

POSE_TASK = np.dtype(
    [
        ("cables", np.int64),  # number n
        ("freedom", np.int64),  # number m of directions
        ("directions", np.int64, (6,)),  # rows of the structure matrix that count: see Motion
        ("information", np.float64, (_N,)),  # inverse variances of the lengths [1/m^2]
        ("variance", np.float64, (_N,)),  # of the lengths [m^2]
        ("tolerance", np.float64, (_N,)),  # largest error of a length that is noise [m]
        ("arms", np.float64, (_N,)),  # platform points from what they turn about [m]
        ("bound", np.float64),  # largest root of summed squared errors, in deviations, of noise
        ("scale", np.float64),  # length at which an angle counts as a distance [m]
        ("centre", np.float64, (3,)),  # of the region where the platform may be, base frame [m]
        ("rotation", np.float64, (3, 3)),  # from platform to base axes in its middle
        ("half_widths", np.float64, (6,)),  # of it [m]; then three times the largest turn [rad]
    ],
    align=True,
)
"""What is asked. Half widths are zero along what the platform cannot move."""

POSE_WORK = np.dtype(
    [
        ("position", np.float64, (3,)),  # start, then answer [m]
        ("rotation", np.float64, (3, 3)),  # likewise
        ("residual", np.float64, (_N,)),  # given less computed lengths [m]
        ("clear", np.float64, (_N,)),  # how far a platform point is from where its cable leaves [m]
        ("matrix", np.float64, (6, _N)),  # structure matrix
        ("normal", np.float64, (6, 6)),  # factor of the normal matrix
        ("inverse", np.float64, (6, _N)),  # from changes of lengths to changes of pose
        ("step", np.float64, (6,)),  # of the last iteration, along `directions`
        ("move", np.float64, (6,)),  # the same, along all six [m, rad]
        ("trial_position", np.float64, (3,)),
        ("trial_rotation", np.float64, (3, 3)),
        ("near_position", np.float64, (3,)),  # of the pose that was found first
        ("near_rotation", np.float64, (3, 3)),
        ("boxes", np.float64, (BOXES, 12)),  # stack of the search: centres, half widths
    ],
    align=True,
)
"""Scratch of the kernels; one for each thread."""


def pose_work() -> Any:
    """Return a record of POSE_WORK."""
    return np.zeros((), POSE_WORK)[()]


def pose_task() -> Any:
    """Return a record of POSE_TASK, to be filled."""
    return np.zeros((), POSE_TASK)[()]
