"""The table of nodes: the only source for the process supervisor and the launch files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from cabols_control.bringup.node_spec import NodeSpec
from cabols_control.rig_folder import BENCH
from cabols_control.topics import RECORDED

CONTROLLERS = (
    NodeSpec(
        "cabols_control",
        "supervisor",
        ("limb_state", "platform_pose", "loop_status"),
        ("mode", "loop_status"),
    ),
    NodeSpec(
        "cabols_control",
        "limb_controller",
        ("limb_state", "tension_command", "mode"),
        ("motor_current", "loop_status"),
    ),
    NodeSpec(
        "cabols_control",
        "wrench_controller",
        ("wrench", "desired_wrench", "desired_tension", "platform_pose", "mode"),
        ("tension_command", "loop_status"),
    ),
)
LOAD_PROGRAM = NodeSpec(
    "cabols_control", "load_program", ("mode", "wrench"), ("desired_wrench", "loop_status")
)
RECORDER = NodeSpec(
    "cabols_control",
    "recorder",
    RECORDED,
    ("loop_status",),
)
CONSOLE = NodeSpec(
    "cabols_control", "console", ("mode", "loop_status"), ("operator_heartbeat", "loop_status")
)
PLANT = NodeSpec(
    "cabols_sim",
    "plant",
    ("motor_current", "tension_command", "mode"),
    ("limb_state", "wrench", "platform_pose", "loop_status"),
)
BRIDGE = NodeSpec(
    "cabols_hw",
    "q8_ati_bridge",
    ("motor_current", "platform_pose", "mode"),
    ("limb_state", "wrench", "loop_status"),
)
ROBOT = NodeSpec(
    "cabols_hw",
    "abb_tracker_bridge",
    ("mode",),
    ("platform_pose", "joint_states", "reflector_measurement", "loop_status"),
)
DEVICES = NodeSpec("cabols_sim", "device_simulator", (), ())
CAMPAIGN = (
    NodeSpec(
        "cabols_stiffness",
        "stiffness_identifier",
        ("stiffness_load", "campaign_status"),
        ("stiffness_estimate", "loop_status"),
    ),
    NodeSpec(
        "cabols_stiffness",
        "stiffness_campaign",
        ("mode", "limb_state", "wrench", "joint_states", "platform_pose", "stiffness_estimate"),
        ("desired_tension", "stiffness_load", "campaign_status", "loop_status"),
    ),
)


@dataclass(frozen=True)
class Ports:
    """Ports of the simulated devices, all on loopback.

    Attributes:
        link: UDP, between plant and device simulator.
        egm: UDP, the robot's position stream.
        rws: TCP, Robot Web Services.
        tracker: TCP, the laser tracker.
    """

    link: int = 6520
    egm: int = 6510
    rws: int = 6580
    tracker: int = 6590


@dataclass(frozen=True)
class Argument:
    """One argument of the launch files and of the demo.

    Attributes:
        name: its name, and the parameter's.
        default: its default, which also gives its type.
        description: for help texts.
        nodes: executables that get it as a parameter; empty: the graph itself uses it.
        kinds: "bench", "rig" or both.
        parameter: the nodes' name for it, where that differs.
        below: by executable, how much less than the value that node gets.
    """

    name: str
    default: Any
    description: str
    nodes: tuple[str, ...]
    kinds: tuple[str, ...] = ("bench", "rig")
    parameter: str = ""
    below: dict[str, int] = field(default_factory=dict)

    def value_for(self, executable: str, value: Any) -> Any:
        """Return what one node gets of a value."""
        return value - self.below[executable] if executable in self.below else value


_BRIDGES = ("plant", "q8_ati_bridge")
_LOOPS = (*_BRIDGES, "limb_controller", "wrench_controller")
_ROBOT = ("abb_tracker_bridge",)
_DEVICES = "device_simulator"
_CAMPAIGN = tuple(node.executable for node in CAMPAIGN)
_BESIDE = ("supervisor", "load_program", "recorder", *_ROBOT, *_CAMPAIGN)
_ALL = (*_LOOPS, *_BESIDE)
_RIG = (*_ALL, "console")
"""Nodes that read the rig's files; the console never gets a real-time priority."""
ARGUMENTS = (
    Argument("rig", BENCH, "name of an installed rig, or folder of a rig", (*_RIG, _DEVICES)),
    Argument("geometry_file", "", "YAML of the geometry; empty: the rig's", _RIG),
    Argument("limbs_file", "", "YAML of the limbs; empty: the rig's", _RIG),
    Argument("control_file", "", "YAML of the control design; empty: the rig's", _RIG),
    Argument("card_file", "", "YAML of the card's scaling; empty: the rig's", _BRIDGES),
    Argument("safety_file", "", "YAML of the safety envelope; empty: the rig's", _BRIDGES),
    Argument(
        "robot_configurations_file",
        "",
        "YAML of the robot's stored configurations; empty: the rig's",
        (*_ROBOT, "plant"),
    ),
    Argument("tracker_file", "", "YAML of the laser tracker; empty: the rig's", _ROBOT),
    Argument("robot_address", "127.0.0.1", "IP of the robot's controller", _ROBOT, ("rig",)),
    Argument("rws_port", 80, "TCP port of its Robot Web Services", _ROBOT, ("rig",)),
    Argument("egm_port", 6510, "UDP port that it sends its position to", _ROBOT, ("rig",)),
    Argument("tracker_address", "", "host:port of the tracker's server", _ROBOT, ("rig",)),
    Argument(
        "stale_after", 0.05, "s without a packet of the robot until its pose is stale", _ROBOT
    ),
    Argument("watchdog", 0.0, "s, replaces the card file's; 0: the file's", _BRIDGES),
    Argument(
        "command_timeout", 0.0, "s, replaces the control file's; 0: its", ("limb_controller",)
    ),
    Argument(
        "tension_method",
        "",
        "min_norm, p_norm, barycentre or analytic_centre; empty: the control file's",
        ("wrench_controller",),
    ),
    Argument(
        "fifo_priority",
        0,
        "SCHED_FIFO priority of bridge and limb controller, from 3; wrench controller and recorder "
        "get 1 less, the other nodes, whose locks the loops may meet, 2 less; 0: none",
        (*_ALL, _DEVICES),
        below={**dict.fromkeys((*_BESIDE, _DEVICES), 2), "wrench_controller": 1, "recorder": 1},
    ),
    Argument(
        "cpu_latency_us",
        -1,
        "us, longest wake-up of any core while the bridge runs; 0: cores poll, -1: leave",
        _BRIDGES,
    ),
    Argument(
        "cpu",
        -1,
        "core for the bridge, the recorder, the robot's bridge and the simulated devices; -1: any",
        (*_BRIDGES, "recorder", *_ROBOT, _DEVICES),
    ),
    Argument(
        "other_cpu",
        -1,
        "core for the other nodes; -1: any",
        (
            *("limb_controller", "wrench_controller", "supervisor", "load_program"),
            *("console", *_CAMPAIGN),
        ),
        parameter="cpu",
    ),
    Argument("record", True, "record a bag", ()),
    Argument("record_at_start", True, "false: the recorder waits for its service", ("recorder",)),
    Argument("console", False, "serve the operator's page on this machine", ()),
    Argument("console_port", 8080, "TCP port of that page", ("console",), parameter="port"),
    Argument(
        "console_host",
        "127.0.0.1",
        "its address; another than loopback needs a token_file",
        ("console",),
        parameter="host",
    ),
    Argument("token_file", "", "its first line is demanded of visitors", ("console",)),
    Argument("foxglove_port", 0, "of a WebSocket for Foxglove; 0: none", ("console",)),
    Argument("campaigns", "campaigns", "folder of stiffness campaigns", ("console",)),
    Argument("uploads", "console/programs", "folder of uploaded programmes", ("console",)),
    Argument("output", "", "folder of the bag; empty: bags/cabols_<time>", ("recorder",)),
    Argument("description", "", "text about the run for the bag's metadata", ("recorder",)),
    Argument("program", "", "load programme to run at the first LOADING", ("load_program",)),
    Argument("scale", 1.0, "factor on the programme's wrench", ("load_program",)),
    Argument("exit_when_done", False, "end everything after the programme", ("load_program",)),
    Argument(
        "state_timeout", 0.2, "s without a limb state until the supervisor stops", ("supervisor",)
    ),
    Argument(
        "operator_timeout",
        10.0,
        "s that a console in command may be silent, under way, until the supervisor unloads",
        ("supervisor",),
    ),
    Argument("campaign", False, "with the nodes of stiffness campaigns", ()),
    Argument(
        "campaign_file", "", "campaign.yaml of campaigns that name none", ("stiffness_campaign",)
    ),
    Argument("campaign_folder", "", "folder of campaigns that name none", ("stiffness_campaign",)),
    Argument("auto_start", False, "pre-tighten and load without a request", ("supervisor",)),
    Argument("plant_file", "", "YAML of the plant; empty: the rig's", ("plant",), ("bench",)),
    Argument("linear", False, "simulate the linear plant", ("plant",), ("bench",)),
    Argument("seed", 0, "of the simulated rig's noise", ("plant",), ("bench",)),
    Argument(
        "speed", 1.0, "below 1: the simulated rig in slow motion", ("plant", *_ROBOT), ("bench",)
    ),
    Argument("robot", True, "simulate robot and tracker; false: a rigid target", (), ("bench",)),
    Argument(
        "robot_file", "", "YAML of the robot's truth; empty: the rig's", ("plant",), ("bench",)
    ),
    Argument("truth", False, "publish what no sensor sees", ("plant",), ("bench",)),
    Argument("lockstep", False, "deterministic: the clock waits for answers", (), ("bench",)),
    Argument("steps", 0, "lockstep: end after this number of milliseconds", ("plant",), ("bench",)),
)


def with_arguments(nodes: Sequence[NodeSpec], values: dict[str, Any]) -> list[NodeSpec]:
    """Give each node the arguments that are meant for it and differ from their defaults.

    Args:
        nodes: of a graph.
        values: of arguments, by name.
    """
    found = []
    for node in nodes:
        meant = {
            a.parameter or a.name: a.value_for(node.executable, values[a.name])
            for a in ARGUMENTS
            if node.executable in a.nodes and values.get(a.name, a.default) != a.default
        }
        if node.options:
            found.append(replace(node, options={**node.options, **meant}))
        else:
            found.append(node.with_parameters(**meant))
    return found


def rig_graph(record: bool = True, campaign: bool = False, console: bool = False) -> list[NodeSpec]:
    """Nodes of a rig with hardware, in starting order: readers first, the clock last.

    Args:
        record: with the recorder.
        campaign: with the nodes of stiffness campaigns.
        console: with the operator's page.
    """
    first = [*([CONSOLE] if console else []), *([RECORDER] if record else [])]
    extra = CAMPAIGN if campaign else ()
    nodes = [*first, *CONTROLLERS, LOAD_PROGRAM, *extra, ROBOT, BRIDGE]
    return [_with_robot(node) for node in nodes]


def _with_robot(node: NodeSpec) -> NodeSpec:
    """Set the parameter of nodes that behave differently with a robot."""
    concerned = node.executable in ("supervisor", "limb_controller", "wrench_controller")
    return node.with_parameters(robot=True) if concerned else node


def bench_graph(
    lockstep: bool = False,
    record: bool = True,
    robot: bool = True,
    ports: Ports | None = None,
    campaign: bool = False,
    console: bool = False,
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
        campaign: with the nodes of stiffness campaigns; they need the robot.
        console: with the operator's page; in lockstep only with a robot, as otherwise the clock
            waits for the supervisor, whose operator time-out then cannot run.
    """
    first = [CONSOLE] if console and (robot or not lockstep) else []
    first += [RECORDER] if record else []
    nodes = [*first, *CONTROLLERS, LOAD_PROGRAM, *(CAMPAIGN if campaign else ())]
    nodes += _devices(ports or Ports()) if robot else [PLANT]
    if robot:
        nodes = [_with_robot(node) for node in nodes]
    if not lockstep:
        return nodes
    if robot:
        nodes = [_beside_clock(node) for node in nodes]
    readers = Counter(topic for node in nodes for topic in node.reads)
    return [
        node
        if node is DEVICES or node.options
        else node.with_parameters(
            lockstep=True,
            wait_for_readers=[f"{topic}={readers[topic]}" for topic in node.writes],
        )
        for node in nodes
    ]


def _beside_clock(node: NodeSpec) -> NodeSpec:
    """Let a node beside the control path run at its own rate, as in real time, in lockstep, too."""
    reads = {"load_program": ("mode",), "supervisor": ("loop_status",)}.get(node.executable)
    if reads is None:
        return node
    return replace(node, reads=reads).with_parameters(beside_clock=True)


def _devices(ports: Ports) -> list[NodeSpec]:
    """Robot and tracker as servers, the bridge that talks to them, the plant that moves them."""
    servers = replace(
        DEVICES,
        options={
            "link-port": ports.link,
            "egm-port": ports.egm,
            "rws-port": ports.rws,
            "tracker-port": ports.tracker,
        },
    )
    bridge = ROBOT.with_parameters(
        egm_port=ports.egm,
        rws_port=ports.rws,
        tracker_address=f"127.0.0.1:{ports.tracker}",
        robot_clock=True,
    )
    writes = tuple(topic for topic in PLANT.writes if topic != "platform_pose")
    plant = replace(PLANT, reads=(*PLANT.reads, "platform_pose"), writes=writes)
    return [servers, bridge, plant.with_parameters(robot=True, link_port=ports.link)]
