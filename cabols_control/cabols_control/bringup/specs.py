# SPDX-License-Identifier: Apache-2.0
"""What a package declares of its nodes: topics, arguments, part in the graph."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any

from cabols_control.errors import ConfigError
from cabols_control.topics import NAMESPACE

ONE_BLAS_THREAD = {"OPENBLAS_NUM_THREADS": "1"}
"""Environment of every node: its matrices are tiny, and two cores run the whole graph."""
LAUNCHER = "CABOLS_LAUNCHER"
"""Environment variable with the process id of who launched a node, if it is the node's parent."""
FIFO = "fifo_priority"
"""The argument of which nodes get less than its value: see NodeSpec.fifo_below."""
FIFO_STEPS = 2
"""Most that a node gets less."""


class Role(Enum):
    """What a node is for in a graph; a graph is put together by roles, in this order."""

    CONSOLE = "operator's page"
    FRAMES = "frames for viewers"
    ESTIMATOR = "sources of the pose against each other"
    ROS2_CONTROL = "controllers of ros2_control"
    RECORDER = "recorder"
    CONTROLLER = "control loop"
    PROGRAM = "load programmes"
    CAMPAIGN = "stiffness campaigns"
    ROBOT = "robot and tracker"
    CLOCK = "bridge to the hardware, the clock of the graph"
    SIMULATION = "simulated rig"


@dataclass(frozen=True)
class NodeSpec:
    """One node of the graph.

    Attributes:
        package: ROS package.
        executable: its executable, and the node's name.
        reads: topics, relative to /cabols.
        writes: topics, relative to /cabols.
        parameters: ROS parameters.
        options: command line of an executable that is no ROS node, by name without dashes.
        role: what it is for.
        takes: names of the arguments that it gets.
        fifo_below: how much less than the argument's its real-time priority is.
        restarts: whether it is started again when it ends; the graph goes on without it.
        namespace: that it joins; empty: its own default.
        log_level: of its logger; empty: its own default.

    Raises:
        ValueError: if a topic is named twice, so that a lockstep clock waits for a reader too many.
    """

    package: str
    executable: str
    reads: tuple[str, ...]
    writes: tuple[str, ...]
    parameters: dict[str, Any] = field(default_factory=dict)
    options: dict[str, Any] = field(default_factory=dict)
    role: Role | None = None
    takes: tuple[str, ...] = ()
    fifo_below: int = 0
    restarts: bool = False
    namespace: str = ""
    log_level: str = ""

    def __post_init__(self) -> None:
        for topics in (self.reads, self.writes):
            if len(set(topics)) < len(topics):
                raise ValueError(f"{self.executable}: a topic twice in {', '.join(topics)}")

    @property
    def joins(self) -> bool:
        """Whether it is a node of the graph, and no server of devices beside it."""
        return bool(self.reads or self.writes)

    def with_parameters(self, **parameters: Any) -> NodeSpec:
        """Return the same node with more parameters."""
        return replace(self, parameters={**self.parameters, **parameters})

    def option_list(self) -> list[str]:
        """Return the options as they stand on the command line."""
        return [word for name, value in self.options.items() for word in (f"--{name}", str(value))]

    def arguments(self) -> list[str]:
        """Return the command line behind the executable's name."""
        ros = [*self.ros_words(), *(["-r", f"__ns:={self.namespace}"] * bool(self.namespace))]
        for name, value in self.parameters.items():
            # JSON is YAML: quotes keep a path or a name from being read as a number.
            ros += ["-p", f"{name}:={json.dumps(value)}"]
        return [*self.option_list(), *(["--ros-args", *ros] if ros else [])]

    def ros_words(self) -> list[str]:
        """Return what ROS is told beside parameters and namespace: the level of the logger."""
        if not self.log_level:
            return []
        logger = f"{self.namespace or NAMESPACE}/{self.executable}".strip("/").replace("/", ".")
        # Not of all loggers: debug lines of the middleware at the control rate would stop the loop.
        return ["--log-level", f"{logger}:={self.log_level}"]


@dataclass(frozen=True)
class Argument:
    """One argument of the launch files and of the demo, and the ROS parameter that it is of nodes.

    Attributes:
        name: its name, and the parameter's.
        default: its default, which also gives its type.
        description: one line.
        kinds: "bench", "rig" or both.
        parameter: the nodes' name for it, where that differs.
        bounds: least and largest value; None for none.
        unit: of the value; empty for none.
        choices: that there are; empty: not a choice.
        reader: of the file that it names, module:function, called with the rig and the file, and
            raising ConfigError for one that cannot be used; empty: no file of a rig.
        keyword: of the reader for the file.
    """

    name: str
    default: Any
    description: str
    kinds: tuple[str, ...] = ("bench", "rig")
    parameter: str = ""
    bounds: tuple[float, float] | None = None
    unit: str = ""
    choices: tuple[str, ...] = ()
    reader: str = ""
    keyword: str = "path"

    @property
    def text(self) -> str:
        """Description with unit and bounds, for help texts."""
        unit = f" [{self.unit}]" if self.unit else ""
        bounds = f" ({self.bounds[0]:g} to {self.bounds[1]:g})" if self.bounds else ""
        return f"{self.description}{unit}{bounds}"

    def checked(self, value: Any) -> Any:
        """Return a value that is within the bounds and of the choices.

        Raises:
            ConfigError: if it is not; NaN is not.
        """
        if self.choices and value not in self.choices:
            raise ConfigError(
                f"{self.name}: expected one of {', '.join(self.choices)}, got {value!r}"
            )
        if self.name == FIFO and 0 < value <= FIFO_STEPS:
            raise ConfigError(
                f"{self.name}: expected 0 or {FIFO_STEPS + 1} to 99, as some nodes get up to "
                f"{FIFO_STEPS} less, got {value!r}"
            )
        numbers = value if isinstance(value, list) else [value]
        if self.bounds is not None and not all(
            self.bounds[0] <= number <= self.bounds[1] for number in numbers
        ):
            low, high = self.bounds
            unit = f" {self.unit}" if self.unit else ""
            raise ConfigError(f"{self.name}: expected {low:g} to {high:g}{unit}, got {value!r}")
        return value


@dataclass(frozen=True)
class PackageNodes:
    """What one package brings to a graph; `NODES` in its module `bringup_nodes`.

    Attributes:
        nodes: of the package.
        arguments: that it adds; those of another package may be taken as well.
    """

    nodes: tuple[NodeSpec, ...]
    arguments: tuple[Argument, ...] = ()

    def argument(self, name: str) -> Argument:
        """One of the package's arguments, by its name."""
        return next(argument for argument in self.arguments if argument.name == name)


def give(
    nodes: Sequence[NodeSpec], arguments: Sequence[Argument], values: dict[str, Any]
) -> list[NodeSpec]:
    """Give each node the arguments that it takes and that differ from their defaults.

    Args:
        nodes: of a graph.
        arguments: all that there are.
        values: by name of the argument.

    Raises:
        ConfigError: if a value is out of its bounds.
    """
    found = []
    for node in nodes:
        meant = {}
        for a in arguments:
            value = values.get(a.name, a.default)
            if a.name in node.takes and value != a.default:
                value = a.checked(value)
                below = node.fifo_below if a.name == FIFO else 0
                meant[a.parameter or a.name] = value - below if below else value
        if node.options:
            found.append(replace(node, options={**node.options, **meant}))
        else:
            found.append(node.with_parameters(**meant))
    return found
