# SPDX-License-Identifier: Apache-2.0
"""Puts graphs together from what the packages declare; names no node and no package itself.

A package declares its nodes and arguments in its module `bringup_nodes`. The packages are found by
their names, cabols_*, among what is installed: the lower packages must not import the higher ones,
and a launch file of one starts nodes of another.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from cabols_control.bringup.specs import Argument, NodeSpec, PackageNodes, Role, give
from cabols_control.errors import ConfigError

PREFIX = "cabols_"
MODULE = "bringup_nodes"
READERS_FIRST = (
    Role.CONSOLE,
    Role.FRAMES,
    Role.ESTIMATOR,
    Role.ROS2_CONTROL,
    Role.RECORDER,
    Role.CONTROLLER,
    Role.PROGRAM,
    Role.CAMPAIGN,
)
"""Starting order of what answers the clock."""
PARTS = {
    Role.RECORDER: "record",
    Role.CAMPAIGN: "campaign",
    Role.CONSOLE: "console",
    Role.FRAMES: "frames",
    Role.ESTIMATOR: "pose_estimator",
    Role.ROS2_CONTROL: "ros2_control",
}
"""Parts of a graph that may be left out, and the argument that says whether."""


@cache
def packages() -> tuple[PackageNodes, ...]:
    """What each installed package declares, by the packages' names."""
    names = sorted(
        {found.name for found in pkgutil.iter_modules() if found.name.startswith(PREFIX)}
    )
    modules = (f"{name}.{MODULE}" for name in names)
    return tuple(import_module(name).NODES for name in modules if find_spec(name) is not None)


def all_nodes() -> tuple[NodeSpec, ...]:
    """All nodes that the packages declare."""
    return tuple(node for package in packages() for node in package.nodes)


def all_arguments() -> tuple[Argument, ...]:
    """All arguments that the packages declare."""
    return tuple(argument for package in packages() for argument in package.arguments)


def with_arguments(nodes: Sequence[NodeSpec], values: dict[str, Any]) -> list[NodeSpec]:
    """Give each node the arguments that are meant for it and differ from their defaults.

    Args:
        nodes: of a graph.
        values: by name of the argument.
    """
    return give(nodes, all_arguments(), values)


def nodes_of(role: Role) -> list[NodeSpec]:
    """The nodes of one role."""
    return [node for node in all_nodes() if node.role is role]


def answering(**parts: bool) -> list[NodeSpec]:
    """What answers the clock, in starting order, without robot and clock.

    Args:
        **parts: whether each of PARTS is there, by its argument; left out: it is not.

    Raises:
        ConfigError: if two of them would command the same.
    """
    unknown = sorted(set(parts) - set(PARTS.values()))
    if unknown:
        raise ConfigError(f"graph: expected parts of {', '.join(PARTS.values())}, got {unknown}")
    if parts.get("campaign") and parts.get("ros2_control"):
        raise ConfigError(
            "ros2_control: expected no campaign beside it, got both; each commands the limbs' "
            "tensions: start one of them"
        )
    roles = (role for role in READERS_FIRST if role not in PARTS or parts.get(PARTS[role]))
    return [node for role in roles for node in nodes_of(role)]


def rig_graph(record: bool = True, **parts: bool) -> list[NodeSpec]:
    """Nodes of a rig with hardware, in starting order: readers first, the clock last.

    Args:
        record: with the recorder.
        **parts: whether each other one of PARTS is there.
    """
    nodes = answering(record=record, **parts)
    nodes += [*nodes_of(Role.ROBOT), *nodes_of(Role.CLOCK)]
    return [with_robot(node) for node in nodes]


def with_robot(node: NodeSpec) -> NodeSpec:
    """Tell a node that behaves differently then that there is a robot."""
    tells = node.role in (Role.CONTROLLER, Role.FRAMES, Role.ESTIMATOR)
    return node.with_parameters(robot=True) if tells else node
