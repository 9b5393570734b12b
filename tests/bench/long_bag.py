# SPDX-License-Identifier: Apache-2.0
"""A bag as a long campaign leaves it, written as fast as the project's writer goes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from cabols_msgs.msg import ReflectorMeasurement, StiffnessLoad
from rclpy.serialization import serialize_message

from cabols_control.bags.writer import BagWriter
from cabols_control.geometry import load_geometry
from cabols_control.kinematics import structure_matrix
from cabols_control.rig_folder import rig_file
from cabols_control.ros.messages import topics
from cabols_control.stamps import set_time
from cabols_hw.abb.configurations import load_configurations
from cabols_hw.ros.robot_stream import JOINT_NAMES, JointStateBytes
from cabols_stiffness.analysis.bag import NEEDED
from cabols_stiffness.campaign.plan import PLAN, load_plan
from cabols_stiffness.measurements.reflector_points import robot_of
from cabols_stiffness.model.balance import Law, balance

TRUE = np.array([966398.0, 731208.0, 317900.0, 13277.0, 7744.0, 2141.0])
EVERY_S = 2.0
"""From one load to the next."""
WINDOW_NS = 100_000_000
FLUSH_EVERY = 20_000
NOISE_M, NOISE_N, NOISE_NM = 5e-6, 0.02, 0.002


class LongCampaign:
    """Passes over configurations, reflectors and loads of the bench's campaign, again and again."""

    def __init__(self, seed: int = 0) -> None:
        """Prepare the loaded robot at every configuration under every load."""
        self.plan = load_plan()
        self.random = np.random.default_rng(seed)
        robot = robot_of(self.plan.rig)
        configurations, geometry = load_configurations(), load_geometry()
        law = Law(TRUE, np.zeros(6))
        self.stops = []
        stops = [s for s in self.plan.stops(6.11) if not self.plan.is_validation(s[0])]
        for configuration, trajectory in stops:
            joints = configurations.joints(configuration)
            position, rotation = robot.forward(joints)
            matrix = structure_matrix(geometry, position, rotation)
            wrench = np.array([matrix @ point.tension for point in trajectory])
            tool = np.hstack([wrench[:, :3] @ rotation, wrench[:, 3:] @ rotation])
            rest = balance(robot, np.tile(joints, (len(tool), 1)), tool, law, follows=True)
            self.stops.append((configuration, joints, trajectory, tool, rest.posture))
        self.rig = self.plan.rig

    def loads(self, count: int):
        """Yield so many loads: message without times, joints, wrench (6,), tracker's point (3,)."""
        group = made = 0
        while True:
            for configuration, joints, trajectory, tool, posture in self.stops:
                for reflector in self.plan.reflectors:
                    for k, point in enumerate(trajectory):
                        if made == count:
                            return
                        made += 1
                        arm = posture.rotation[k] @ self.rig.reflectors[reflector]
                        seen = posture.position[k] + arm - self.rig.tracker_position
                        message = StiffnessLoad(
                            configuration=configuration,
                            reflector=reflector,
                            load=point.load,
                            group=group,
                            branch=point.branch,
                            tension=point.tension.tolist(),
                            success=True,
                        )
                        yield message, joints, tool[k], self.rig.tracker_rotation.T @ seen
                    group += 1


def write_bag(folder: Path, seconds: int, recorder: bool = False) -> int:
    """Write a bag of so many seconds; return the control cycles in it.

    Args:
        folder: of the bag; new.
        seconds: of the rig's time.
        recorder: also the other topics at 1 kHz that the rig's recorder takes.
    """
    campaign = LongCampaign()
    random, geometry = campaign.random, load_geometry()
    wrench = topics.wrench_layout(geometry.platform_frame).record()
    others = {
        "limb_state": topics.limb_state_layout(geometry).record(),
        "tension_command": topics.tension_command_layout(geometry).record(),
        "motor_current": topics.motor_current_layout(geometry, geometry.cables).record(),
    }
    encoders = JointStateBytes(JOINT_NAMES)
    loads = campaign.loads(round(seconds / EVERY_S))
    steps = round(1000 * EVERY_S)
    scale = np.repeat([NOISE_N, NOISE_NM], 3)
    cycles = 0
    with BagWriter(folder, {"campaign_yaml": rig_file(PLAN).read_text("utf-8")}) as writer:
        for topic, type_name in NEEDED.items():
            writer.add_topic(topic, type_name)
        for topic in others if recorder else ():
            name = topics.TYPES[topic].__name__
            writer.add_topic(topic, f"cabols_msgs/msg/{name}")
        for message, joints, load, point in loads:
            noise = load + scale * random.standard_normal((steps, 6))
            angles = joints.tolist()
            for step in range(steps):
                cycles += 1
                now_ns = cycles * 1_000_000
                wrench.stamp(now_ns)
                wrench["wrench"][:] = noise[step]
                writer.write("wrench", now_ns, now_ns, wrench.raw())
                if recorder:
                    for topic, record in others.items():
                        record.stamp(now_ns)
                        writer.write(topic, now_ns, now_ns, record.raw())
                if cycles % 4 == 0:
                    writer.write("joint_states", now_ns, now_ns, encoders.raw(now_ns, angles))
                if cycles % FLUSH_EVERY == 0:
                    writer.flush()
            _finish(writer, campaign, message, point, now_ns)
    return cycles


def _finish(writer: BagWriter, campaign: LongCampaign, message, point, now_ns: int) -> None:
    """Write the measurement of a load's last tenth of a second, and the load."""
    begin_ns, end_ns = now_ns - 50_000_000 - WINDOW_NS, now_ns - 50_000_000
    seen = point + NOISE_M * campaign.random.standard_normal(3)
    reading = ReflectorMeasurement(
        reflector=message.reflector,
        covariance=(NOISE_M**2 * np.eye(3)).ravel().tolist(),
        averaging_time=1e-9 * WINDOW_NS,
        samples=100,
        success=True,
    )
    reading.header.frame_id = "tracker"
    reading.position.x, reading.position.y, reading.position.z = seen.tolist()
    for target, time_ns in (
        (reading.header.stamp, (begin_ns + end_ns) // 2),
        (message.header.stamp, now_ns),
        (message.begin, begin_ns),
        (message.end, end_ns),
    ):
        set_time(target, time_ns)
    writer.write("reflector_measurement", now_ns, now_ns, serialize_message(reading))
    writer.write("stiffness_load", now_ns, now_ns, serialize_message(message))
