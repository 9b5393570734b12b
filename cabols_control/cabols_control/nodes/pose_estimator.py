# SPDX-License-Identifier: Apache-2.0
"""Node: robot, encoders, sensor and tracker against each other, from slow copies of their topics.

Twenty-two samples a second come beside the control loop, as for the operator's page. It observes:
nothing stops or moves by its answers.
"""

from __future__ import annotations

import os
import sys
import time
from typing import NamedTuple

import numpy as np
from cabols_msgs.msg import PoseAgreement, ReflectorMeasurement
from geometry_msgs.msg import PoseWithCovarianceStamped
from scipy.spatial.transform import Rotation

from cabols_control.frames import load_frames
from cabols_control.pose_agreement import (
    Agreement,
    Estimate,
    Fault,
    LimbSample,
    Measured,
    PoseEstimator,
    State,
)
from cabols_control.ros.live import live_name
from cabols_control.ros.loop import Input
from cabols_control.ros.messages import topics
from cabols_control.ros.messages.qos import topic_qos
from cabols_control.ros.node import RUNNING, WAITING, run_node
from cabols_control.ros.parameters import declare_robot
from cabols_control.ros.reader import Reader
from cabols_control.ros.ticking_node import TickingNode
from cabols_control.rotations import read_pose
from cabols_control.stamps import set_time, time_ns
from cabols_control.supervision.faults import Fault as LoopFault
from cabols_control.supervision.faults import FaultName

PERIOD_S = 0.02
NICE = 10
"""It observes: on a busy computer the control loop comes first."""
KINDS = {
    Fault.SWAPPED_ENCODERS: PoseAgreement.SWAPPED_ENCODERS,
    Fault.SLIPPED_CABLE: PoseAgreement.SLIPPED_CABLE,
    Fault.ROBOT_TOOL: PoseAgreement.ROBOT_TOOL,
    Fault.TRACKER: PoseAgreement.TRACKER,
}


class SentAnswer(NamedTuple):
    """By what an answer differs from the one before."""

    time: float
    state: State
    readings: int


class PoseEstimatorNode(TickingNode):
    """Publishes `pose_agreement` and `estimated_pose`; names what disagrees in `loop_status`."""

    def __init__(self) -> None:
        """Subscribe and advertise.

        Raises:
            ConfigError: if a file of the rig cannot be used.
        """
        super().__init__("pose_estimator", PERIOD_S)
        geometry = self.rig.geometry
        self._estimator = PoseEstimator(self.rig, load_frames(self.rig_folder), declare_robot(self))
        state = topics.limb_state_layout(geometry)
        self._state = Input(self, live_name("limb_state"), state)
        wrench = topics.wrench_layout(geometry.platform_frame)
        self._wrench = Input(self, live_name("wrench"), wrench)
        self._pose = Input(self, live_name("platform_pose"), topics.pose_layout(geometry))
        self._reflectors = Reader(self, "reflector_measurement")
        self._agreements = self.create_publisher(
            PoseAgreement, "pose_agreement", topic_qos("pose_agreement")
        )
        self._poses = self.create_publisher(
            PoseWithCovarianceStamped, "estimated_pose", topic_qos("estimated_pose")
        )
        self._sent = SentAnswer(-np.inf, State.UNKNOWN, 0)

    def tick(self) -> None:
        """Take what has come, judge it, tell what is new."""
        self._hear()
        found = self._estimator.look()
        answer = SentAnswer(found.time, found.state, found.readings)
        if answer != self._sent and np.isfinite(found.time):
            self._sent = answer
            self._agreements.publish(self._message(found))
            if found.agreement is not None:
                self._poses.publish(self._pose_message(found.time, found.agreement))
        disagree = found.state in (State.CANDIDATES, State.NAMED)
        fault = LoopFault(FaultName.POSE_SOURCES, found.reason) if disagree else None
        known = found.state is not State.UNKNOWN
        self.status.cycle(time.time_ns(), RUNNING if known else WAITING, fault)

    def _hear(self) -> None:
        if self._wrench.take():
            wrench = self._wrench.record["wrench"]
            self._estimator.joiner.wrench(1e-9 * self._wrench.stamp_ns, wrench)
        if self._state.take():
            record = self._state.record
            zeroed = bool(np.all(record["zeroed"]))
            self._estimator.limbs(
                LimbSample(
                    time=1e-9 * self._state.stamp_ns,
                    wound=np.array(record["wound_length"]),
                    elongation=np.array(record["elongation"]),
                    # A bag of 0.1 has zeros without a number.
                    zeroing=int(record["zeroing"]) if zeroed else 0,
                )
            )
        if self._pose.take():
            pose = read_pose(self._pose.record["pose"])
            if pose is not None:
                self._estimator.joiner.pose(1e-9 * self._pose.stamp_ns, *pose)
        for message in self._reflectors.take():
            if message.success:
                self._estimator.measured(reading_of(message))

    def _message(self, found: Estimate) -> PoseAgreement:
        made = PoseAgreement(state=int(found.state), reason=found.reason)
        made.header.frame_id = self.rig.geometry.base_frame
        set_time(made.header.stamp, round(1e9 * found.time))
        for suspect in found.suspects:
            limbs = (*suspect.limbs, -1, -1)
            made.suspect.append(KINDS[suspect.fault])
            made.limb.append(limbs[0])
            made.other_limb.append(limbs[1])
        nothing = np.full(6, np.nan)
        agreement = found.agreement
        made.residual = nothing if agreement is None else agreement.residual
        made.deviation = nothing if agreement is None else agreement.deviation
        compared = found.compared
        made.tracker_distance = np.nan if compared is None else compared.distance
        made.tracker_deviation = np.nan if compared is None else compared.deviation
        made.reflectors = found.readings
        return made

    def _pose_message(self, time_s: float, agreement: Agreement) -> PoseWithCovarianceStamped:
        made = PoseWithCovarianceStamped()
        made.header.frame_id = self.rig.geometry.base_frame
        set_time(made.header.stamp, round(1e9 * time_s))
        p, q = made.pose.pose.position, made.pose.pose.orientation
        p.x, p.y, p.z = map(float, agreement.position)
        q.x, q.y, q.z, q.w = map(float, Rotation.from_matrix(agreement.rotation).as_quat())
        made.pose.covariance = agreement.covariance.ravel()
        return made


def reading_of(message: ReflectorMeasurement) -> Measured:
    """Read a measurement of the tracker.

    Args:
        message: of one that succeeded.
    """
    middle = 1e-9 * time_ns(message.header.stamp)
    half = 0.5 * float(message.averaging_time)
    position = np.array([message.position.x, message.position.y, message.position.z])
    covariance = np.asarray(message.covariance, dtype=np.float64).reshape(3, 3)
    std = np.nan
    if np.isfinite(covariance).all():
        std = float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))
    return Measured(middle - half, middle + half, int(message.reflector), position, std)


def main() -> int:
    """Entry point."""
    os.nice(NICE)
    return run_node(PoseEstimatorNode)


if __name__ == "__main__":
    sys.exit(main())
