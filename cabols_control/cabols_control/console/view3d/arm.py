# SPDX-License-Identifier: Apache-2.0
"""A robot's joints as far as a picture needs them."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from cabols_control.serial_arms.arm import NotSerialError, read_serial_arm


class Arm(NamedTuple):
    """A chain of joints that turn about axes of their frames.

    Attributes:
        offsets: [x, y, z] of every joint, in the frame of the link before it [m].
        axes: 0, 1, 2 for x, y, z of that frame.
        flange: [x, y, z] of what is fixed to the last link, in its frame [m].
    """

    offsets: list[list[float]]
    axes: list[int]
    flange: list[float]


def read_arm(path: str | Path) -> Arm | None:
    """Read a robot's joints; None for one that is no such chain, of which no picture is drawn.

    Raises:
        ConfigError: if the file is no URDF.
    """
    try:
        arm = read_serial_arm(path)
    except NotSerialError:
        return None
    if not (np.equal(arm.rotations, np.eye(3)).all() and (np.sort(arm.axes) == [0, 0, 1]).all()):
        return None
    axes = [int(axis) for axis in arm.axes.argmax(axis=1)]
    return Arm(arm.origins.tolist(), axes, arm.flange_position.tolist())
