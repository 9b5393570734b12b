# SPDX-License-Identifier: Apache-2.0
"""Nodes and arguments of this package, and the graph of the simulated bench."""

from __future__ import annotations

from dataclasses import dataclass, replace

from cabols_control.bringup.graph import answering, nodes_of, with_robot
from cabols_control.bringup.specs import Argument, NodeSpec, PackageNodes, Role
from cabols_control.bringup_nodes import OF_EVERY_LOOP
from cabols_control.topics import Quality, topic_row

PLANT = NodeSpec(
    "cabols_sim",
    "plant",
    # Its own pose, too, where there is no robot: as a bridge it listens to whoever tells one.
    ("motor_current", "tension_command", "platform_pose", "path_motion", "mode"),
    ("limb_state", "wrench", "platform_pose", "loop_status"),
    role=Role.SIMULATION,
    takes=(
        *OF_EVERY_LOOP,
        "card_file",
        "safety_file",
        "bias_file",
        "power_on_check",
        "activate",
        "robot_configurations_file",
        "watchdog",
        "cpu_latency_us",
        "cpu",
        "plant_file",
        "linear",
        "seed",
        "speed",
        "robot_file",
        "truth",
        "steps",
    ),
)
DEVICES = NodeSpec(
    "cabols_sim",
    "device_simulator",
    (),
    (),
    role=Role.SIMULATION,
    takes=("rig", "fifo_priority", "cpu", "seed", "robot_watch", "rws_version", "robot_maker"),
    fifo_below=2,
)
ARGUMENTS = (
    Argument(
        "plant_file",
        "",
        "YAML of the plant; empty: the rig's",
        kinds=("bench",),
        reader="cabols_sim.plant.config:load_plant",
    ),
    Argument("linear", False, "simulate the linear plant", kinds=("bench",)),
    Argument(
        "seed",
        0,
        "of all noise of the simulated rig",
        kinds=("bench",),
        bounds=(0, 2147483647),
    ),
    Argument("robot", True, "simulate robot and tracker; false: a rigid target", kinds=("bench",)),
    Argument(
        "robot_file",
        "",
        "YAML of the robot's truth; empty: the rig's",
        kinds=("bench",),
        reader="cabols_sim.devices.robot.robot_config:load_robot_truth",
    ),
    Argument(
        "robot_watch",
        0.1,
        "silence of the rig's heartbeat after which the simulated robot stops by itself",
        kinds=("bench",),
        bounds=(0.02, 10.0),
        unit="s",
    ),
    Argument(
        "rws_version",
        1,
        "of the simulated robot's web services: 1 as of IRC5, 2 as of OmniCore",
        kinds=("bench",),
        bounds=(1, 2),
    ),
    Argument("truth", False, "publish what no sensor sees", kinds=("bench",)),
    Argument("lockstep", False, "deterministic: the clock waits for answers", kinds=("bench",)),
    Argument(
        "steps",
        0,
        "lockstep: end after this number of samples; 0: never",
        kinds=("bench",),
        bounds=(0, 2147483647),
    ),
)
NODES = PackageNodes((PLANT, DEVICES), ARGUMENTS)


LOCKSTEP_WATCH_S = 5.0


@dataclass(frozen=True)
class Ports:
    """Ports of the simulated devices, all on loopback.

    Attributes:
        link: UDP, between plant and device simulator.
        egm: UDP, the robot's position stream.
        rws: TCP, Robot Web Services.
        tracker: TCP, the laser tracker.
        watch: TCP, the rig's heartbeat to the robot.
    """

    link: int = 6520
    egm: int = 6510
    rws: int = 6580
    tracker: int = 6590
    watch: int = 6512


def bench_graph(
    lockstep: bool = False,
    record: bool = True,
    robot: bool = True,
    ports: Ports | None = None,
    **parts: bool,
) -> list[NodeSpec]:
    """Nodes of the simulated bench, in starting order: readers first, the clock last.

    They are the rig's nodes with the plant in the bridge's place, and the simulated devices. In
    lockstep every node waits until its topics have all the readers that this table gives them, so
    that nothing is lost at the start. With a robot, which has its own pace, the clock waits for the
    control path alone: plant, wrench controller, limb controller.

    Args:
        lockstep: deterministic clock.
        record: with the recorder.
        robot: with robot and tracker; False for a target that never moves, whose pose the plant
            publishes itself.
        ports: of the devices.
        **parts: whether each other one of cabols_control.bringup.graph.PARTS is there. Campaigns
            need the robot; the operator's page is there in lockstep only with a robot, as otherwise
            the clock waits for the supervisor, whose operator time-out then cannot run.
    """
    parts["console"] = parts.get("console", False) and (robot or not lockstep)
    nodes = answering(record=record, **parts)
    nodes += _devices(ports or Ports(), lockstep) if robot else [PLANT]
    if robot:
        nodes = [with_robot(node) for node in nodes]
    if not lockstep:
        return nodes
    if robot:
        nodes = [_beside_clock(node) for node in nodes]
    readers = {
        topic: sorted(node.executable for node in nodes if topic in node.reads)
        for node in nodes
        for topic in node.writes
    }
    return [
        node
        if node is DEVICES or node.options
        else node.with_parameters(
            lockstep=True,
            # What is latched reaches a reader that comes later.
            wait_for_readers=[
                f"{topic}={'+'.join(readers[topic])}"
                for topic in node.writes
                if readers[topic] and topic_row(topic).quality is not Quality.LATCHED
            ],
        )
        for node in nodes
    ]


def _beside_clock(node: NodeSpec) -> NodeSpec:
    """Set the parameters of nodes outside the control path, for which lockstep does not wait."""
    # They then run at their own rate instead of answering every sample, as in real time.
    reads = {"load_program": ("mode",), "supervisor": ("loop_status",)}.get(node.executable)
    if reads is None:
        return node
    return replace(node, reads=reads).with_parameters(beside_clock=True)


def _devices(ports: Ports, lockstep: bool) -> list[NodeSpec]:
    """Robot and tracker as servers, the bridge that talks to them, the plant that moves them."""
    # A lockstep rig's time stands still while a process stalls, the heartbeat's does not.
    patience = {"robot_watch": LOCKSTEP_WATCH_S} if lockstep else {}
    servers = replace(
        DEVICES,
        options={
            "link-port": ports.link,
            "egm-port": ports.egm,
            "rws-port": ports.rws,
            "tracker-port": ports.tracker,
            "watch-port": ports.watch,
            **patience,
        },
    )
    bridges = [
        node.with_parameters(
            egm_port=ports.egm,
            rws_port=ports.rws,
            rtde_port=ports.rws,
            heartbeat_port=ports.watch,
            tracker_address=f"127.0.0.1:{ports.tracker}",
            robot_clock=True,
        )
        for node in nodes_of(Role.ROBOT)
    ]
    no_pose = tuple(topic for topic in PLANT.writes if topic != "platform_pose")
    plant = replace(PLANT, writes=no_pose)
    return [servers, *bridges, plant.with_parameters(robot=True, link_port=ports.link)]
