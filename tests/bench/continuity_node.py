# SPDX-License-Identifier: Apache-2.0
"""The wrench controller's real node between a noisy pose and a wrench: changes of its tensions.

This process stands for the bridge, the robot and the load programme: it sends pose, desired and
measured wrench of a sample, and waits for the node's tension_command. What is measured follows the
commanded tensions by a lag, so that the law is in its loop. Desired wrenches are ramped out
through the boundary, held there, and taken back.
"""

from __future__ import annotations

import os
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.kinematics import structure_matrix
from cabols_control.supervision.modes import OperatingMode
from cabols_sim.bench.run import isolated_environment

PERIOD_NS = 1_000_000
LAG_S = 0.02
"""Of what is measured behind the commanded tensions."""
SHARES = (0.95, 1.0, 1.05, 1.3)
"""Of the boundary; at each the wrench is held for HELD_CYCLES, RAMP_CYCLES lie between two."""
RAMP_CYCLES, HELD_CYCLES = 120, 60
WAIT_S, START_S, END_S = 0.5, 180.0, 60.0
SESSION = 7


class NodeLoop:
    """The node as a process, and the messages of its topics."""

    def __init__(self, method: str) -> None:
        environment = isolated_environment()
        os.environ.update(environment)
        import rclpy
        from cabols_msgs.msg import Mode, TensionCommand
        from geometry_msgs.msg import PoseStamped, WrenchStamped

        from cabols_control.ros.messages.qos import topic_qos

        self._rclpy, self._kinds = rclpy, (Mode, PoseStamped, WrenchStamped)
        command = Path(".venv/lib/cabols_control/wrench_controller")
        arguments = ["--ros-args", "-r", "__ns:=/cabols", "-p", f"tension_method:={method}"]
        self._process = subprocess.Popen(
            [str(command), *arguments],
            env={**os.environ, **environment},
            stdout=subprocess.DEVNULL,
        )
        rclpy.init()
        self._node = rclpy.create_node("continuity", namespace="cabols")
        names = {"mode": Mode, "platform_pose": PoseStamped}
        names |= dict.fromkeys(("wrench", "desired_wrench"), WrenchStamped)
        self._out = {
            topic: self._node.create_publisher(kind, topic, topic_qos(topic))
            for topic, kind in names.items()
        }
        self._answer = None
        self._node.create_subscription(
            TensionCommand, "tension_command", self._hear, topic_qos("tension_command")
        )
        self._executor = rclpy.executors.SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._stamp_ns = time.time_ns()
        self.lost = 0

    def _hear(self, message) -> None:
        self._answer = message

    def _stamped(self, message, frame: str):
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(self._stamp_ns, 10**9)
        message.header.frame_id = frame
        return message

    def step(self, mode, position, rotation, desired, measured):
        """Answer of the node to one sample, None if it is lost: (tension, active, feasible)."""
        kind_mode, kind_pose, kind_wrench = self._kinds
        self._stamp_ns += PERIOD_NS
        told = self._stamped(kind_mode(mode=int(mode), session=SESSION), "")
        pose = self._stamped(kind_pose(), "rig_base")
        pose.pose.position.x, pose.pose.position.y, pose.pose.position.z = map(float, position)
        turn = Rotation.from_matrix(rotation).as_quat()
        o = pose.pose.orientation
        o.x, o.y, o.z, o.w = map(float, turn)
        local = np.concatenate([rotation.T @ measured[:3], rotation.T @ measured[3:]])
        self._out["mode"].publish(told)
        self._out["platform_pose"].publish(pose)
        for topic, frame, values in (
            ("desired_wrench", "rig_base", desired),
            ("wrench", "platform", local),
        ):
            message = self._stamped(kind_wrench(), frame)
            for part, three in zip((message.wrench.force, message.wrench.torque),
                                   (values[:3], values[3:]), strict=True):  # fmt: skip
                part.x, part.y, part.z = map(float, three)
            self._out[topic].publish(message)
        self._answer, end = None, time.monotonic() + WAIT_S
        while time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.05)
            found = self._answer
            if found is not None:
                got_ns = 10**9 * found.header.stamp.sec + found.header.stamp.nanosec
                if got_ns == self._stamp_ns:
                    return np.array(found.tension), found.active, found.feasible
        self.lost += 1
        return None

    def wait_for(self, mode, active, *sample) -> None:
        """Repeat a sample until the node answers that a load is or is not commanded."""
        end = time.monotonic() + START_S
        while time.monotonic() < end:
            found = self.step(mode, *sample)
            if found is not None and found[1] == active:
                return
        raise RuntimeError(f"wrench_controller: no answer with active {active} in {START_S:g} s")

    def close(self) -> None:
        """End the node."""
        self._process.send_signal(signal.SIGINT)
        self._process.wait(timeout=END_S)
        self._node.destroy_node()
        self._rclpy.shutdown()


def wanted():
    """(k,) shares of the boundary, cycle by cycle, and (k,) whether they are ramps."""
    shares, ramps = [], []
    for k, share in enumerate(SHARES):
        if k:
            shares.append(np.linspace(SHARES[k - 1], share, RAMP_CYCLES))
            ramps.append(np.ones(RAMP_CYCLES, dtype=bool))
        shares.append(np.full(HELD_CYCLES, share))
        ramps.append(np.zeros(HELD_CYCLES, dtype=bool))
    return np.concatenate(shares), np.concatenate(ramps)


def node_changes(geometry, method, directions, ends, noise, wrench_noise):
    """Changes of tensions from cycle to cycle at the node.

    Args:
        geometry: of the rig.
        method: of tension distribution.
        directions: (k, 6) of the wrenches.
        ends: (k,) how far along them the boundary is.
        noise: (6,) of the pose [m, rad].
        wrench_noise: (6,) of the measured wrench [N, N m].

    Returns:
        (m,) largest change of a tension [N], (m,) whether the wrench was ramped, the share of
        feasible cycles, the number of samples that were lost.
    """
    random = np.random.default_rng(3)
    at, share = geometry.reference_position, 1e-9 * PERIOD_NS / LAG_S
    way, ramped = wanted()
    changes, ramps, feasible, loop, lost = [], [], [], NodeLoop(method), 0

    def sample():
        offset = random.normal(0.0, 1.0, 6) * noise
        return at + offset[:3], Rotation.from_rotvec(offset[3:]).as_matrix()

    try:
        for direction, end in zip(directions, ends, strict=True):
            felt = way[0] * end * direction
            for mode in (OperatingMode.STOPPED, OperatingMode.LOADING):
                loop.wait_for(mode, mode == OperatingMode.LOADING, *sample(), felt, felt)
            before, waited = None, loop.lost
            for part, ramp in zip(way, ramped, strict=True):
                place = sample()
                measured = felt + random.normal(0.0, 1.0, 6) * wrench_noise
                found = loop.step(OperatingMode.LOADING, *place, part * end * direction, measured)
                if found is None:
                    before = None
                    continue
                tension, active, reached = found
                if not active:
                    raise RuntimeError("wrench_controller gave up the load")
                given = structure_matrix(geometry, *place) @ tension
                felt = felt + share * (given - felt)
                if before is not None:
                    changes.append(float(np.abs(tension - before).max()))
                    ramps.append(ramp)
                    feasible.append(reached)
                before = tension
            lost += loop.lost - waited
    finally:
        loop.close()
    return np.array(changes), np.array(ramps), float(np.mean(feasible)), lost
