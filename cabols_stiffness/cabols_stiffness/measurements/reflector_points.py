# SPDX-License-Identifier: Apache-2.0
"""Conversion of measured loads to the input of `identify`: points in the robot's base, wrenches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.registration.reflectors import (
    LEAST_PROBABILITY,
    RegistrationError,
    register_frame,
)
from cabols_stiffness.errors import CampaignError
from cabols_stiffness.measurements.deflected_arm import loaded_posture
from cabols_stiffness.measurements.measured_load import MeasuredLoad
from cabols_stiffness.measurements.measuring_rig import MeasuringRig
from cabols_stiffness.measurements.samples import REFERENCE, PointSamples
from cabols_stiffness.model.robot import RobotModel, load_robot

FEWEST_POSES = 4
"""Configurations with all reflectors, from which the tracker is registered; fewer: nominal."""

REPEATABILITY = np.diag([4e-5] * 3 + [9e-5] * 3) ** 2
"""(6, 6) of a robot of this size: 37 um and 87 urad (Slamani, Nubiola, Bonev); weights only."""


@dataclass(frozen=True, eq=False)
class Frames:
    """Places of tracker and reflectors.

    Attributes:
        position: (3,) of the tracker in the robot's base [m].
        rotation: (3, 3) from tracker to base axes.
        reflectors: (r, 3) in platform axes [m].
        residual: root mean square distance of the references from the robot's poses [m]; NaN
            for nominal frames.
        poses: configurations that they were registered from; 0: nominal.
        probability: of so large residuals, if robot and tracker are as good as they say; NaN for
            nominal frames and before the robot's deflection is known.
    """

    position: FloatArray
    rotation: FloatArray
    reflectors: FloatArray
    residual: float
    poses: int
    probability: float = float("nan")

    @property
    def fits(self) -> bool:
        """Whether the references belong to one place of the tracker, as far as it is known."""
        return not self.probability < LEAST_PROBABILITY


def robot_of(rig: MeasuringRig) -> RobotModel:
    """The robot with the platform as its tool.

    Raises:
        ConfigError: if its URDF cannot be used.
    """
    return load_robot(
        rig.urdf or None, tool_position=rig.tool_position, tool_rotation=rig.tool_rotation
    )


def nominal_frames(rig: MeasuringRig) -> Frames:
    """Frames as campaign.yaml gives them."""
    reflectors = np.array(rig.reflectors, dtype=np.float64)
    position = np.array(rig.tracker_position, dtype=np.float64)
    return Frames(position, rig.tracker_rotation, reflectors, float("nan"), 0)


def frames_of(
    loads: Sequence[MeasuredLoad],
    rig: MeasuringRig,
    robot: RobotModel,
    parameters: FloatArray | None = None,
) -> Frames:
    """Register tracker and reflectors from the unloaded references, if they are enough.

    Args:
        loads: measured so far.
        rig: nominal values.
        robot: with the platform as its tool.
        parameters: (12,) of a first result, by which the cables' least tension bends the robot
            there; None: the encoders' poses.
    """
    nominal = nominal_frames(rig)
    seen: dict[tuple[int, int], list[MeasuredLoad]] = {}
    for load in loads:
        if load.branch == REFERENCE:
            seen.setdefault((load.configuration, load.reflector), []).append(load)
    count = len(rig.reflectors)
    configurations = sorted({configuration for configuration, _ in seen})
    poses = [c for c in configurations if all((c, r) in seen for r in range(count))]
    if not rig.register or len(poses) < FEWEST_POSES:
        return nominal
    rows = [[seen[c, r] for r in range(count)] for c in poses]
    joints = np.array([row[0][0].average.joints for row in rows])
    wrench = np.array([row[0][0].average.wrench for row in rows])
    posture = robot.posture(joints)
    if parameters is not None:
        posture = loaded_posture(robot, joints, wrench, parameters)
    try:
        found = register_frame(
            posture.position,
            posture.rotation,
            nominal.reflectors,
            [[np.mean([m.position for m in same], axis=0) for same in row] for row in rows],
            [[_spread(same) for same in row] for row in rows],
            pose_covariance=REPEATABILITY,
            solve_reflectors=True,
            least_probability=0.0,
        )
    except RegistrationError:
        # Poses that are too similar give nothing better than the nominal values.
        return nominal
    if not found.converged:
        return nominal
    # A robot is less accurate than it repeats: the frame is used all the same, and it is said.
    probability = float("nan") if parameters is None else found.probability
    return Frames(
        position=found.position,
        rotation=found.rotation,
        reflectors=found.reflectors,
        residual=found.residual_rms,
        poses=len(poses),
        probability=probability,
    )


def _spread(same: Sequence[MeasuredLoad]) -> FloatArray:
    """(3, 3) of the mean of some measurements of one reflector."""
    mean = np.mean([load.position_covariance for load in same], axis=0)
    return np.asarray(mean / len(same))


def to_points(loads: Sequence[MeasuredLoad], frames: Frames) -> PointSamples:
    """Measured loads as samples of reflectors, in their order.

    Args:
        loads: one or more.
        frames: of tracker and reflectors.

    Raises:
        CampaignError: if there are none.
        ShapeError: if a covariance is not valid.
    """
    if not loads:
        raise CampaignError("loads: expected at least one finished load, got none")
    begin = loads[0].begin_ns
    turn = frames.rotation
    position = np.array([load.position for load in loads])
    covariance = np.array([load.position_covariance for load in loads])
    reflector = np.array([load.reflector for load in loads])
    middle = np.array([(load.begin_ns + load.end_ns) // 2 - begin for load in loads])
    return PointSamples(
        configuration=np.array([load.configuration for load in loads]),
        load=np.array([load.load for load in loads]),
        branch=np.array([load.branch for load in loads]),
        reflector=reflector,
        group=np.array([load.group for load in loads]),
        time=1e-9 * middle,
        joints=np.array([load.average.joints for load in loads]),
        wrench=np.array([load.average.wrench for load in loads]),
        wrench_covariance=np.array([load.average.covariance for load in loads]),
        offset=frames.reflectors[reflector],
        position=frames.position + position @ turn.T,
        position_covariance=_symmetric(turn @ covariance @ turn.T),
    )


def _symmetric(matrices: FloatArray) -> FloatArray:
    return np.asarray(0.5 * (matrices + np.swapaxes(matrices, 1, 2)))
