# SPDX-License-Identifier: Apache-2.0
"""SROS2 policies of the graph, from its tables of nodes, topics and services.

A policy allows each node what its row says, and nothing else: a stranger's motor current or mode is
refused by DDS itself. `ros2 security create_permission` makes signed permissions of it (ROS 2
design, "ROS 2 Access Control Policies").
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from xml.etree import ElementTree

from cabols_control.bringup.graph import all_nodes
from cabols_control.bringup.specs import NodeSpec, Role
from cabols_control.command_line import DONE, CommandParser, command, give_out, text_option
from cabols_control.services import LIFECYCLE, MANAGED, SERVICES
from cabols_control.topics import FOREIGN, LIVE, NAMESPACE, TOPICS

TEXT = """Write the SROS2 policy of the graph.

One enclave a node, which may publish, subscribe, serve and call what the graph's tables say. Make
keys of it with `ros2 security create_keystore`, `create_enclave` and `create_permission`."""
EVERYBODYS_PUBLISHED = ("/rosout", "/parameter_events", "/diagnostics", "loop_status")
EVERYBODYS_READ = ("/parameter_events", "/clock", "loop_status", "mode")
PARAMETERS = (
    "describe_parameters",
    "get_parameter_types",
    "get_parameters",
    "get_type_description",
    "list_parameters",
    "set_parameters",
    "set_parameters_atomically",
)
"""Services that rclpy serves for every node, below the node's name."""
BESIDE_READ = {
    "console": (
        *("/diagnostics", "/rosout", "campaign_status", "recording"),
        *("reflector_measurement", "stiffness_estimate"),
    ),
    "supervisor": ("operator_heartbeat",),
    "pose_estimator": ("reflector_measurement",),
    "recorder": tuple(FOREIGN),
    "wrench_controller": ("sensor_tare",),
}
"""What nodes read beside the graph's rows, for which no clock and no loop waits."""
BESIDE_PUBLISHED = {
    "recorder": ("recording",),
    "frames": ("/tf", "/tf_static", "robot_description"),
}
BY_CLOCK = ("sensor_tare",)
"""What a bridge, or the simulated rig in its place, publishes beside its row."""
ASKS_PARAMETERS = ("recorder",)
"""Nodes that write into a bag what the others run with."""
ASKED = ("list_parameters", "get_parameters")
STOPS = ("stop", "stop_received")
"""Whoever moves anything hears stops and acknowledges them; whoever presses one sends them."""


class Allowance:
    """What one node may do; names as in the graph, relative ones in the namespace.

    Attributes:
        publish: topics.
        subscribe: topics.
        reply: services that it serves.
        request: services that it calls.
        execute: actions that it serves.
        call: actions that it calls.
    """

    def __init__(self, node: NodeSpec) -> None:
        """Collect from the tables.

        Args:
            node: of the graph.
        """
        name = node.executable
        live = {LIVE + topic for topic, row in TOPICS.items() if row.live}
        # A node that will take a role listens first whether another one has it.
        self.publish = {*node.writes, *EVERYBODYS_PUBLISHED, *STOPS}
        self.publish |= {*BESIDE_PUBLISHED.get(name, ())}
        self.publish |= {*(BY_CLOCK if node.role in (Role.CLOCK, Role.SIMULATION) else ())}
        self.publish |= {LIVE + topic for topic in node.writes if LIVE + topic in live}
        self.subscribe = {*node.reads, *node.writes, *EVERYBODYS_READ, *STOPS, *live}
        self.subscribe |= {*BESIDE_READ.get(name, ())}
        self.reply = {f"{name}/{service}" for service in PARAMETERS}
        self.reply |= {s.name for s in SERVICES if name in s.servers and not s.action}
        if name in MANAGED:
            self.reply |= {f"{name}/{service}" for service in LIFECYCLE}
            self.publish.add(f"{name}/transition_event")
        self.request = {s.name for s in SERVICES if name in s.clients and not s.action}
        if name in ASKS_PARAMETERS:
            others = [other.executable for other in all_nodes() if other.joins]
            self.request |= {f"{other}/{what}" for other in others for what in ASKED}
        self.execute = {s.name for s in SERVICES if name in s.servers and s.action}
        self.call = {s.name for s in SERVICES if name in s.clients and s.action}


def policy(nodes: Iterable[NodeSpec]) -> ElementTree.Element:
    """Make the policy of some nodes.

    Args:
        nodes: of the graph; those that join none are left out.
    """
    root = ElementTree.Element("policy", version="0.2.0")
    enclaves = ElementTree.SubElement(root, "enclaves")
    for node in nodes:
        if not (node.reads or node.writes):
            continue  # a server of devices, which joins no graph
        enclave = ElementTree.SubElement(enclaves, "enclave", path=f"{NAMESPACE}/{node.executable}")
        profiles = ElementTree.SubElement(enclave, "profiles")
        profile = ElementTree.SubElement(profiles, "profile", ns=NAMESPACE, node=node.executable)
        allowed = Allowance(node)
        _rule(profile, "topics", "publish", allowed.publish)
        _rule(profile, "topics", "subscribe", allowed.subscribe)
        _rule(profile, "services", "reply", allowed.reply)
        _rule(profile, "services", "request", allowed.request)
        _rule(profile, "actions", "execute", allowed.execute)
        _rule(profile, "actions", "call", allowed.call)
    return root


def _rule(profile: ElementTree.Element, kind: str, what: str, names: Iterable[str]) -> None:
    sorted_names = sorted(names)
    if not sorted_names:
        return
    rule = ElementTree.SubElement(profile, kind, {what: "ALLOW"})
    for name in sorted_names:
        ElementTree.SubElement(rule, kind[:-1]).text = name


def policy_text(nodes: Sequence[NodeSpec]) -> str:
    """Return the policy's XML.

    Args:
        nodes: of the graph.
    """
    root = policy(nodes)
    ElementTree.indent(root)
    head = '<?xml version="1.0" encoding="UTF-8"?>\n'
    return head + ElementTree.tostring(root, encoding="unicode") + "\n"


@command
def main(arguments: Sequence[str] | None = None) -> int:
    """Write the policy; returns 0, or 2 for a wrong command line."""
    parser = CommandParser("security_policy", TEXT)
    text_option(parser)
    options = parser.parse_args(arguments)
    text = policy_text(all_nodes())
    give_out(text, options.output)
    return DONE


if __name__ == "__main__":
    sys.exit(main())
