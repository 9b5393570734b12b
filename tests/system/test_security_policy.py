# SPDX-License-Identifier: Apache-2.0
"""The SROS2 policy names all that the running nodes do, and nothing that no table names."""

from __future__ import annotations

from xml.etree import ElementTree

import pytest

from cabols_control.bringup.graph import all_nodes
from cabols_control.bringup.security import Allowance, main, policy_text
from cabols_control.services import SERVICES
from cabols_control.topics import LIVE, NAMESPACE, TOPICS
from console_harness import console_values, free_port
from graph_harness import run_scenario

ACTION_PARTS = ("feedback", "status", "cancel_goal", "get_result", "send_goal")
NO_NODES = ("device_simulator",)
ALLOWED = {node.executable: Allowance(node) for node in all_nodes()}


def names(profile, kind, what):
    """Names that a profile's rules of a kind hold."""
    rules = profile.findall(kind)
    return {e.text for rule in rules if rule.get(what) == "ALLOW" for e in rule}


def test_policy_is_the_tables(tmp_path):
    path = tmp_path / "policy.xml"
    assert main(["--output", str(path)]) == 0
    root = ElementTree.parse(path).getroot()
    assert (root.tag, root.get("version")) == ("policy", "0.2.0")
    profiles = {p.get("node"): p for p in root.iter("profile")}
    expected = {node.executable for node in all_nodes()} - set(NO_NODES)
    assert set(profiles) == expected
    assert all(p.get("ns") == NAMESPACE for p in profiles.values())
    for node in all_nodes():
        if node.executable in NO_NODES:
            continue
        profile = profiles[node.executable]
        assert set(node.writes) <= names(profile, "topics", "publish")
        assert set(node.reads) <= names(profile, "topics", "subscribe")
    # What moves the rig has one writer each, and no wildcard is anywhere.
    for topic in ("motor_current", "tension_command"):
        writers = [n for n, p in profiles.items() if topic in names(p, "topics", "publish")]
        assert len(writers) == 1
    assert "*" not in path.read_text("utf-8")
    assert policy_text(all_nodes()) == path.read_text("utf-8")


def test_every_service_has_servers_and_known_nodes():
    known = {node.executable for node in all_nodes()}
    for service in SERVICES:
        assert set(service.servers) <= known | {"compensation"}
        assert set(service.clients) <= known
    assert len({service.name for service in SERVICES}) == len(SERVICES)


def missing(kind, node, found, allowed, actions):
    """What a node does that its policy does not allow."""
    odd = []
    for name in found:
        short = name.removeprefix(NAMESPACE + "/")
        action, mark, part = short.partition("/_action/")
        if mark:
            if action not in actions or part not in ACTION_PARTS:
                odd.append(f"{node}: {kind} {short}")
        elif short not in allowed and name not in allowed:
            odd.append(f"{node}: {kind} {short}")
    return odd


@pytest.mark.ros
@pytest.mark.timeout(120)
def test_running_nodes_do_nothing_else(tmp_path):
    odd, seen = [], set()

    def scenario(watcher, pids):
        watcher.wait(lambda: watcher.seen["mode"], "the first mode")
        watcher.wait(
            lambda: {"console", "stiffness_campaign"} <= set(watcher.node.get_node_names()),
            "all nodes",
        )
        counts: list[int] = []

        def settled() -> bool:
            """Discovery has no end of its own: the same number of endpoints for two seconds."""
            ends = sum(watcher.node.count_publishers(t) for t in TOPICS)
            counts.append(ends + sum(watcher.node.count_subscribers(t) for t in TOPICS))
            return len(counts) > 400 and len(set(counts[-400:])) == 1

        watcher.wait(settled, "the end of discovery")
        me = watcher.node
        for node, space in me.get_node_names_and_namespaces():
            if node not in ALLOWED or space != NAMESPACE:
                continue
            seen.add(node)
            allowed = ALLOWED[node]
            actions = allowed.execute | allowed.call
            for kind, look, may in (
                ("publishes", me.get_publisher_names_and_types_by_node, allowed.publish),
                ("subscribes", me.get_subscriber_names_and_types_by_node, allowed.subscribe),
                ("serves", me.get_service_names_and_types_by_node, allowed.reply),
                ("calls", me.get_client_names_and_types_by_node, allowed.request),
            ):
                found = [name for name, _ in look(node, space)]
                odd.extend(missing(kind, node, found, may, actions))

    values = console_values(tmp_path, free_port(), robot=True, campaign=True, record=True)
    run_scenario({**values, "output": str(tmp_path / "bag")}, scenario, ("mode",))
    assert seen >= {"supervisor", "plant", "limb_controller", "wrench_controller", "recorder"}
    assert sorted(odd) == [], "\n".join(sorted(odd))


def test_slow_copies_have_a_topic():
    every = {name for allowed in ALLOWED.values() for name in allowed.publish}
    for name in every:
        if name.startswith(LIVE):
            assert TOPICS[name.removeprefix(LIVE)].live
