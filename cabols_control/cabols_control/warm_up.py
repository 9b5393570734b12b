# SPDX-License-Identifier: Apache-2.0
"""Compile and cache the numerical kernels once, so that no node waits for the compiler."""

from __future__ import annotations

from typing import Any

import numpy as np

from cabols_control.kinematics import structure_matrix
from cabols_control.limb import identify_limb
from cabols_control.limb_control.controller import LimbController, LimbSample, TensionSetpoint
from cabols_control.rig import Rig, load_rig
from cabols_control.rotations import read_pose
from cabols_control.supervision.modes import OperatingMode
from cabols_control.tension import calls, distribute
from cabols_control.wrench_control.controller import DesiredWrench, WrenchController
from cabols_control.wrench_control.frames import platform_axes


def warm_limbs(rig: Rig) -> None:
    """Compile or load a limb controller's kernels for samples as arrays."""
    n = rig.geometry.cables
    flags, length = np.ones(n, dtype=np.bool_), np.full(n, 0.001)
    sample = LimbSample(0.0, length, length, length, flags, flags)
    controller = LimbController(rig)
    for stamp_s in (0.001, 0.002, 0.002):
        setpoint = TensionSetpoint(stamp_s, np.full(n, 10.0), True)
        controller.step(sample._replace(stamp_s=stamp_s), OperatingMode.LOADING, setpoint)


def warm_limb_messages(rig: Rig, limbs: list[int], state: Any, answer: Any) -> None:
    """Compile or load a limb controller's kernels from message to message.

    Args:
        rig: configuration.
        limbs: indices of the limbs that it drives, from 0.
        state: (1,) record of a LimbState, as messages come: compiled code differs for those that
            are read-only or not aligned.
        answer: (1,) record of a MotorCurrent, writable.
    """
    controller = LimbController(rig, limbs)
    for stamp_s in (0.001, 0.002, 0.002):
        setpoint = TensionSetpoint(stamp_s, np.full(len(limbs), 10.0), True)
        controller.answer(stamp_s, OperatingMode.LOADING, setpoint, state, answer)


def warm_commissioning(rig: Rig) -> None:
    """Compile or load what commissioning calls beside a running control loop."""
    pose = read_pose(np.array([*rig.geometry.reference_position, 0.0, 0.0, 0.0, 1.0]))
    if pose is not None:
        structure_matrix(rig.geometry, *pose)


def warm_wrenches(rig: Rig) -> None:
    """Compile or load a wrench controller's kernels."""
    controller = WrenchController(rig)
    # As a pose comes in a message: (7,) numbers.
    pose = read_pose(np.array([*rig.geometry.reference_position, 0.0, 0.0, 0.0, 1.0]))
    for k in range(3):
        if pose is not None:
            controller.hear_pose(0.001 * k, *pose)
        controller.place(0.001 * k)
        setpoint = DesiredWrench(0.001 * k, np.full(6, 1000.0 * k))
        measured = controller.to_base_axes(np.zeros(6))
        controller.step(0.001 * k, measured, OperatingMode.LOADING, setpoint)
    moving = platform_axes()
    for k in range(3, 6):
        setpoint = DesiredWrench(0.001 * k, np.full(6, 1.0), moving)
        measured = controller.to_base_axes(np.zeros(6))
        controller.step(0.001 * k, measured, OperatingMode.LOADING, setpoint)


def warm_workspace(rig: Rig) -> None:
    """Compile or load the kernels of the command `workspace`."""
    from cabols_control.workspace.bodies import load_bodies
    from cabols_control.workspace.capacity import capacity_along
    from cabols_control.workspace.interference import clearance_along, free_turn
    from cabols_control.workspace.wrench_set import wrench_box

    geometry, bodies = rig.geometry, load_bodies()
    pose = (geometry.reference_position[None], geometry.reference_rotation[None])
    limits = (rig.control.tension_min, rig.control.tension_max)
    capacity_along(geometry, *pose, *limits, wrench_box(rig.control.rated))
    clearance_along(geometry, bodies, *pose)
    free_turn(geometry, bodies, pose[0][0], pose[1][0], (0.0, 0.0, 1.0), 0.1)


def main() -> None:
    """Call every compiled kernel of this package once."""
    rig = load_rig()
    warm_limbs(rig)
    warm_commissioning(rig)
    warm_wrenches(rig)
    calls.load_all()
    matrix = np.random.default_rng(0).normal(size=(6, rig.geometry.cables))
    distribute(matrix, np.zeros(6), 1.0, 100.0)
    distribute(matrix, np.full(6, 1e4), 1.0, 100.0)
    time = np.arange(100) * 0.001
    identify_limb(time, np.ones(100), time**2)
    warm_workspace(rig)


if __name__ == "__main__":
    main()
