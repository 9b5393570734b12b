"""The table of nodes: the one source for the supervisor of processes and for the launch files."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any


@dataclass(frozen=True)
class NodeSpec:
    """One node of the graph.

    Attributes:
        package: ROS package.
        executable: its executable, and the node's name.
        reads: topics, relative to /cabols.
        writes: topics, relative to /cabols.
        parameters: ROS parameters.
    """

    package: str
    executable: str
    reads: tuple[str, ...]
    writes: tuple[str, ...]
    parameters: dict[str, Any] = field(default_factory=dict)

    def with_parameters(self, **parameters: Any) -> NodeSpec:
        """Return the same node with more parameters."""
        return replace(self, parameters={**self.parameters, **parameters})

    def arguments(self) -> list[str]:
        """Return the command line behind the executable's name."""
        if not self.parameters:
            return []
        found = ["--ros-args"]
        for name, value in self.parameters.items():
            # JSON is YAML: quotes keep a path or a name from being read as a number.
            found += ["-p", f"{name}:={json.dumps(value)}"]
        return found


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
        ("wrench", "desired_wrench", "platform_pose", "mode"),
        ("tension_command", "loop_status"),
    ),
)
LOAD_PROGRAM = NodeSpec(
    "cabols_control", "load_program", ("mode", "wrench"), ("desired_wrench", "loop_status")
)
RECORDER = NodeSpec(
    "cabols_control",
    "recorder",
    (
        "limb_state",
        "wrench",
        "motor_current",
        "tension_command",
        "desired_wrench",
        "platform_pose",
        "mode",
        "loop_status",
    ),
    ("loop_status",),
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
    """

    name: str
    default: Any
    description: str
    nodes: tuple[str, ...]
    kinds: tuple[str, ...] = ("bench", "rig")
    parameter: str = ""


_BRIDGES = ("plant", "q8_ati_bridge")
_LOOPS = (*_BRIDGES, "limb_controller", "wrench_controller")
_ALL = (*_LOOPS, "supervisor", "load_program", "recorder")
ARGUMENTS = (
    Argument("geometry_file", "", "YAML of the geometry; empty: reference bench", _ALL),
    Argument("limbs_file", "", "YAML of the limbs; empty: reference bench", _ALL),
    Argument("control_file", "", "YAML of the control design; empty: reference bench", _ALL),
    Argument("card_file", "", "YAML of the card's scaling; empty: reference bench", _BRIDGES),
    Argument("watchdog", 0.0, "s, replaces the card file's; 0: the file's", _BRIDGES),
    Argument(
        "command_timeout", 0.0, "s, replaces the control file's; 0: its", ("limb_controller",)
    ),
    Argument(
        "fifo_priority",
        0,
        "SCHED_FIFO priority of bridge and limb controller; 0: none",
        (*_BRIDGES, "limb_controller"),
    ),
    Argument(
        "background_fifo_priority",
        0,
        "the same for the other nodes, whose locks the loops may meet; below fifo_priority",
        ("wrench_controller", "supervisor", "load_program", "recorder"),
        parameter="fifo_priority",
    ),
    Argument(
        "cpu", -1, "core for bridge and limb controller; -1: any", (*_BRIDGES, "limb_controller")
    ),
    Argument(
        "other_cpu",
        -1,
        "core for the other nodes; -1: any",
        ("wrench_controller", "supervisor", "load_program", "recorder"),
        parameter="cpu",
    ),
    Argument("record", True, "record a bag", ()),
    Argument("output", "", "folder of the bag; empty: bags/cabols_<time>", ("recorder",)),
    Argument("description", "", "text about the run for the bag's metadata", ("recorder",)),
    Argument("program", "", "load programme to run at the first LOADING", ("load_program",)),
    Argument("scale", 1.0, "factor on the programme's wrench", ("load_program",)),
    Argument("exit_when_done", False, "end everything after the programme", ("load_program",)),
    Argument("auto_start", False, "pre-tighten and load without being asked", ("supervisor",)),
    Argument("plant_file", "", "YAML of the simulated rig; empty: bench", ("plant",), ("bench",)),
    Argument("linear", False, "simulate the linear plant", ("plant",), ("bench",)),
    Argument("seed", 0, "of the simulated rig's noise", ("plant",), ("bench",)),
    Argument("speed", 1.0, "below 1: the simulated rig in slow motion", ("plant",), ("bench",)),
    Argument("lockstep", False, "deterministic: the clock waits for answers", (), ("bench",)),
    Argument("steps", 0, "lockstep: end after so many milliseconds", ("plant",), ("bench",)),
)


def with_arguments(nodes: Sequence[NodeSpec], values: dict[str, Any]) -> list[NodeSpec]:
    """Give each node the arguments that are meant for it and differ from their defaults."""
    found = []
    for node in nodes:
        meant = {
            a.parameter or a.name: values[a.name]
            for a in ARGUMENTS
            if node.executable in a.nodes and values.get(a.name, a.default) != a.default
        }
        found.append(node.with_parameters(**meant))
    return found


def rig_graph(record: bool = True) -> list[NodeSpec]:
    """Nodes of a rig with hardware, in starting order: readers first, the clock last."""
    return [*([RECORDER] if record else []), *CONTROLLERS, LOAD_PROGRAM, BRIDGE]


def bench_graph(lockstep: bool = False, record: bool = True) -> list[NodeSpec]:
    """Nodes of the simulated bench, in starting order: readers first, the clock last.

    In lockstep every node waits until its topics have all the readers that this table gives them,
    so that nothing is lost at the start.
    """
    nodes = [*([RECORDER] if record else []), *CONTROLLERS, LOAD_PROGRAM, PLANT]
    if not lockstep:
        return nodes
    readers = Counter(topic for node in nodes for topic in node.reads)
    return [
        node.with_parameters(
            lockstep=True,
            wait_for_readers=[f"{topic}={readers[topic]}" for topic in node.writes],
        )
        for node in nodes
    ]
