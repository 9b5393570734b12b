# SPDX-License-Identifier: Apache-2.0
"""Node: the simulated rig behind the real bridge, in place of q8_ati_bridge."""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from typing import Any

import numpy as np
from cabols_msgs.srv import InjectFault
from scipy.spatial.transform import Rotation

from cabols_control.geometry import RigGeometry
from cabols_control.result_code import ResultCode
from cabols_control.rig import Rig
from cabols_control.ros.loop import Input, Output
from cabols_control.ros.messages import topics
from cabols_control.ros.messages.layout import Record
from cabols_control.ros.node import run_node
from cabols_control.ros.parameters import declare, declare_row
from cabols_control.supervision.modes import OperatingMode
from cabols_hw.abb.configurations import load_configurations
from cabols_hw.bridge.bridge import Bridge
from cabols_hw.bringup_nodes import NODES as HW_NODES
from cabols_hw.card.config import CardConfig
from cabols_hw.ros.bridge_node import BridgeNode
from cabols_hw.safety.config import SafetyConfig, load_safety
from cabols_sim.bringup_nodes import NODES as SIM_NODES
from cabols_sim.devices.link import DEFAULT_LINK_PORT, PlantLink
from cabols_sim.devices.robot.coupling import RobotCoupling
from cabols_sim.devices.robot.kinematics import load_arm
from cabols_sim.devices.robot.robot_checks import check_robot
from cabols_sim.devices.robot.robot_config import load_robot_truth
from cabols_sim.devices.robot.robot_target import RobotTarget
from cabols_sim.faults import FaultError
from cabols_sim.plant.card import SimulatedQ8
from cabols_sim.plant.config import PlantConfig, load_plant
from cabols_sim.plant.plant import Plant
from cabols_sim.plant.stand import DAMPING, Stand, StandingPlatform, hanging_body

POSE_EVERY = 4
"""The robot reports its pose every 4 ms; in lockstep every sample has one."""
POSE_LAG_NS = 20_000_000
"""Age of the robot's pose beyond which a lockstep clock waits for it, in the rig's time..."""
POSE_PATIENCE_S = 1.0
"""...and the longest wait: a silent robot must show."""


def make_card(node: BridgeNode, rig: Rig, card: CardConfig) -> SimulatedQ8:
    """Build plant and card from the node's parameters."""
    path = declare_row(node, SIM_NODES.argument("plant_file"))
    config = load_plant(node.rig_folder, path)
    if declare_row(node, SIM_NODES.argument("linear")):
        config = config.linear()
    seed = declare_row(node, SIM_NODES.argument("seed"))
    node.quiet = node.get_parameter("linear").value
    speed = declare_row(node, HW_NODES.argument("speed"))
    warm_up_card(rig, card, config)
    node.coupling = make_coupling(node, rig.geometry)
    robot = node.coupling.robot if node.coupling is not None else None
    if rig.hanging is not None:
        robot = hanging_target(rig, load_safety(node.rig_folder))
    plant = Plant(rig, card, config, seed, robot)
    if node.coupling is not None:
        node.coupling.obey_faults(plant.faults)
    node.hardware = "simulated Q8 card with force/torque sensor"
    return SimulatedQ8(plant, card, rig.geometry.cables, node.lockstep, speed)


def make_coupling(node: BridgeNode, geometry: RigGeometry) -> RobotCoupling | None:
    """Build the robot and its link to the device simulator; None for a rigid target.

    Raises:
        ConfigError: if robot, configurations and cables cannot be of one rig.
    """
    wanted = declare(node, "robot", False, "flexible robot, its devices served by device_simulator")
    path = declare_row(node, SIM_NODES.argument("robot_file"))
    configurations = declare_row(node, HW_NODES.argument("robot_configurations_file"))
    port = declare(
        node, "link_port", DEFAULT_LINK_PORT, "UDP on loopback, to device_simulator", (0, 65535)
    )
    if not wanted:
        return None
    config = load_robot_truth(node.rig_folder, path)
    stored = load_configurations(node.rig_folder, configurations)
    target = RobotTarget(config, stored, load_arm(node.rig_folder))
    check_robot(target.arm, stored, geometry).settle(node.rig_folder.path)
    return RobotCoupling(target, PlantLink(port))


def hanging_target(rig: Rig, safety: SafetyConfig) -> StandingPlatform | None:
    """Build the platform that hangs on its cables, on its stand; None where something holds it."""
    if safety.platform_held or rig.hanging is None:
        return None
    depth = None if safety.suspension is None else safety.suspension.net_depth
    stand = Stand() if depth is None else Stand(net_depth=depth)
    made, warm = (
        StandingPlatform(rig.geometry, hanging_body(rig.hanging), DAMPING, stand) for _ in range(2)
    )
    warm.release()
    warm.step(np.zeros(6), 1e-3)
    return made


def warm_up_card(rig: Rig, card: CardConfig, config: PlantConfig) -> None:
    """Compile, or load from the cache, what plant and bridge call in a cycle."""
    n = rig.geometry.cables
    daq = SimulatedQ8(Plant(rig, card, config), card, n, lockstep=True)
    bridge = Bridge(rig, card)
    bridge.hear_pose(0.0, rig.geometry.reference_position, rig.geometry.reference_rotation)
    for mode in (OperatingMode.STOPPED, OperatingMode.PRETIGHTENING, OperatingMode.LOADING):
        bridge.take(daq.read(), mode)
        daq.write(bridge.volts(np.zeros(n)))


class PlantNode(BridgeNode):
    """BridgeNode on a simulated card; publishes the platform's pose in the robot's place.

    With robot:=true the pose comes from abb_tracker_bridge, as on the rig: it lags by what the
    devices take, so in lockstep the clock waits only for one that is not too old, and runs differ.
    """

    is_rig = False
    starts_harmlessly = True
    coupling: RobotCoupling | None = None

    def __init__(self) -> None:
        """Build the rig."""
        super().__init__("plant", make_card)
        self._steps = declare_row(self, SIM_NODES.argument("steps"))
        geometry = self.rig.geometry
        self._pose = topics.pose_layout(geometry).record()
        self._place = b""
        if self.coupling is None and self.hanging is None:
            self._pose_output = self.advertise_live("platform_pose")
        self._truth = None
        if declare_row(self, SIM_NODES.argument("truth")):
            self._truth = self._advertise_truth()
        self.create_service(InjectFault, "inject_fault", self._inject)

    def safety_config(self) -> SafetyConfig:
        """Without noise a gauge may show the same number for long."""
        config = super().safety_config()
        return replace(config, sensor_flat=0.0) if self.quiet else config

    def _advertise_truth(self) -> tuple[Record, Output, Record, Output]:
        geometry = self.rig.geometry
        state = topics.limb_state_layout(geometry).record()
        state["limb"][:] = np.arange(geometry.cables)
        wrench = topics.wrench_layout(geometry.base_frame).record()
        names = ("true_limb_state", "true_wrench")
        outputs = [Output(self, name, self.lockstep) for name in names]
        return state, outputs[0], wrench, outputs[1]

    def _publish_truth(self, stamp_ns: int, sequence: int) -> None:
        state, state_output, wrench, wrench_output = self._truth
        plant = self.daq.plant
        state.stamp(stamp_ns)
        state["sequence"][0] = sequence
        state["tension"][:] = plant.tension
        state["current"][:] = plant.motor_current
        wrench.stamp(stamp_ns)
        wrench["wrench"][:] = plant.wrench
        state_output.publish(state.raw())
        wrench_output.publish(wrench.raw())

    def _inject(self, request: Any, response: Any) -> Any:
        order = (request.fault, request.limb, request.value, request.duration)
        try:
            with self._lock:
                said = self.daq.plant.inject(*order)
                response.time = self._newest_s
            response.success, response.code = True, int(ResultCode.DONE)
            response.message = f"{said}; at {response.time:.4f} s"
        except FaultError as error:
            response.code, response.message = int(ResultCode.BAD_REQUEST), str(error)
        return response

    def extra_inputs(self) -> list[Input]:
        """In lockstep the clock also waits for the wrench controller."""
        # In lockstep the robot's pose is taken in on_inputs; missing() waits for a recent one.
        pose = super().extra_inputs() if self.coupling is not None else []
        if not self.lockstep:
            return pose
        geometry = self.rig.geometry
        self._tension_input = Input(
            self, "tension_command", topics.tension_command_layout(geometry), lockstep=True
        )
        return [self._tension_input]

    def missing(self, stamp_ns: int) -> list[Input]:
        """With a robot, which has its own pace, wait for a recent pose instead of the mode."""
        found = super().missing(stamp_ns)
        if self.coupling is None:
            return found
        found = [item for item in found if item is not self._mode_input]
        if not self._poses.count:
            return found
        silent = time.monotonic_ns() - self._poses.received_ns > 1e9 * POSE_PATIENCE_S
        if self._poses.stamp_ns < stamp_ns - POSE_LAG_NS and not silent:
            found.append(self._poses)
        return found

    def on_inputs(self) -> None:
        """Take the wrench controller's answer, which only paces the clock, and the robot's pose."""
        if self.coupling is not None:
            super().on_inputs()
        if self.lockstep:
            self._tension_input.take()

    def on_sample(self, stamp_ns: int, sequence: int) -> None:
        """Publish the target's pose, which the bridge knows already, or serve the devices."""
        if self._truth is not None:
            self._publish_truth(stamp_ns, sequence)
        if self.coupling is not None:
            self.coupling.on_sample(stamp_ns, sequence)
            return
        if self.hanging is not None:
            super().on_sample(stamp_ns, sequence)
            return
        if not self.lockstep and sequence % POSE_EVERY != 0:
            return
        target, faults = self.daq.plant.target, self.daq.plant.faults
        if faults.has("pose_silent"):
            return
        offset = np.array([faults.value("pose_offset"), 0.0, 0.0])
        now_s = 1e-9 * stamp_ns
        self._poses.use(now_s, now_s, target.position + offset, target.rotation)
        self._pose.stamp(stamp_ns)
        place = offset.tobytes() + target.position.tobytes() + target.rotation.tobytes()
        if place != self._place:
            self._place = place
            self._pose["pose"][:3] = target.position + offset
            self._pose["pose"][3:] = Rotation.from_matrix(target.rotation).as_quat()
        self._pose_output.publish(self._pose.raw())
        self._pose_output.copy()

    def end(self) -> None:
        """End the bridge, then the link."""
        super().end()
        if self.coupling is not None:
            self.coupling.close()

    def finished(self) -> bool:
        """Whether the requested number of steps is done."""
        return 0 < self._steps <= self._count.sent


def main() -> int:
    """Entry point."""
    return run_node(PlantNode)


if __name__ == "__main__":
    sys.exit(main())
