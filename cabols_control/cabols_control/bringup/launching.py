# SPDX-License-Identifier: Apache-2.0
"""Functions of both launch files; only they import it, as `launch` is not installed everywhere."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from launch.actions import DeclareLaunchArgument, EmitEvent, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch_ros.actions import Node

from cabols_control import end_signals
from cabols_control.bringup.argument_text import others, read_arguments
from cabols_control.bringup.graph import all_arguments
from cabols_control.bringup.network_names import domain_id
from cabols_control.bringup.processes import GRACE_S, RESTART_S, RESTARTS
from cabols_control.bringup.specs import LAUNCHER, ONE_BLAS_THREAD, NodeSpec

DISCOVERY = "discovery"
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PREFIX = "launch-prefix"
"""Launch's own configuration of words before every command, such as a debugger's."""
RANGES = ["LOCALHOST", "SUBNET", "OFF", "SYSTEM_DEFAULT"]


def arguments(kind: str, defaults: Mapping[str, Any] | None = None) -> list[Any]:
    """Declare the launch arguments of one kind of graph.

    Args:
        kind: "bench" or "rig".
        defaults: of this launch file, by name, in the place of the nodes' own.
    """
    own = defaults or {}
    discovery = DeclareLaunchArgument(
        DISCOVERY,
        default_value=os.environ.get(RANGE, "") or "LOCALHOST",
        choices=RANGES,
        description="whom the nodes find: LOCALHOST, this machine; SUBNET, every machine of the "
        "network, which can then command the rig",
    )
    return [
        discovery,
        *(
            DeclareLaunchArgument(
                a.name, default_value=str(own.get(a.name, a.default)), description=a.text
            )
            for a in all_arguments()
            if kind in a.kinds
        ),
    ]


def argument_values(
    context: Any, kind: str, defaults: Mapping[str, Any] | None = None
) -> tuple[dict[str, Any], set[str]]:
    """Return the arguments' values, typed as their defaults, and the names of those given.

    Args:
        context: of the launch.
        kind: of graph, "bench" or "rig".
        defaults: of this launch file, as for arguments().

    Raises:
        ConfigError: naming every argument that cannot be used, or is none, or the environment's
            DDS domain; nothing has started.
    """
    domain_id(os.environ)
    texts = {k: v for k, v in context.launch_configurations.items() if k != DISCOVERY}
    mine = [argument for argument in all_arguments() if kind in argument.kinds]
    values = read_arguments(mine, texts, others(list(texts), context.argv, sys.argv))
    shown = {a.name: str((defaults or {}).get(a.name, a.default)) for a in mine}
    given = {name for name, text in texts.items() if text != shown.get(name)}
    return {**{argument.name: argument.default for argument in all_arguments()}, **values}, given


def launch_nodes(nodes: Sequence[NodeSpec], context: Any = None) -> list[Any]:
    """Return launch actions for the nodes; when one ends that may not restart, all end.

    Args:
        nodes: complete, see cabols_control.parameters.file.complete.
        context: of the launch; None: the nodes find this machine alone.
    """
    discovery = "LOCALHOST"
    if context is not None:
        discovery = str(context.launch_configurations.get(DISCOVERY, discovery))
    # Words that the user puts before commands, such as a debugger's, are launch's own affair.
    given = context is not None and context.launch_configurations.get(PREFIX)
    prefix = None if given else " ".join(end_signals.holding_words())
    actions: list[Any] = []
    # Nodes under load unload before they obey: SIGTERM and SIGKILL leave them the time for it.
    grace = str(2.0 * GRACE_S)
    for spec in nodes:
        node = Node(
            package=spec.package,
            executable=spec.executable,
            exec_name=spec.executable,  # and not the first word before the command
            arguments=spec.option_list(),
            parameters=[spec.parameters] if spec.parameters else [],
            namespace=spec.namespace or None,
            ros_arguments=spec.ros_words() or None,
            output="screen",
            prefix=prefix,
            additional_env={**ONE_BLAS_THREAD, LAUNCHER: str(os.getpid()), RANGE: discovery},
            respawn=spec.restarts,
            respawn_delay=RESTART_S,
            respawn_max_retries=RESTARTS,
            sigterm_timeout=grace,
            sigkill_timeout=grace,
        )
        if spec.restarts:
            actions.append(node)
            continue
        actions += [
            node,
            RegisterEventHandler(OnProcessExit(target_action=node, on_exit=end_all(spec))),
        ]
    return actions


def end_all(spec: NodeSpec) -> Callable[[Any, Any], list[Any]]:
    """Return what ends the launch when a node ends, in order in any case.

    A launch whose handler raises shuts down as always, and then exits with 1: launch has no other
    way to an exit code.

    Args:
        spec: the node; the handler takes launch's event and context.

    Raises:
        RuntimeError: by the handler, if the node failed before the launch was ending.
    """

    def ended(event: Any, context: Any) -> list[Any]:
        if event.returncode and not context.is_shutdown:
            raise RuntimeError(f"{spec.executable} ended with exit code {event.returncode}")
        return [EmitEvent(event=Shutdown(reason=f"{spec.executable} ended"))]

    return ended
