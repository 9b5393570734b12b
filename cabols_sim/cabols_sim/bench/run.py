# SPDX-License-Identifier: Apache-2.0
"""Run the simulated bench as processes, for the demo, the benchmarks and the tests."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from cabols_control.bringup.free_domains import claim_domain
from cabols_control.bringup.graph import PARTS
from cabols_control.bringup.network_names import DOMAIN, domain_id
from cabols_control.bringup.processes import GRACE_S, Ended, run
from cabols_control.bringup.specs import ONE_BLAS_THREAD, NodeSpec
from cabols_control.parameters.file import complete
from cabols_control.realtime.scheduling import may_limit_wake_up, may_use_fifo
from cabols_hw.abb.heartbeat import SILENCE_S
from cabols_sim.bringup_nodes import LOCKSTEP_WATCH_S, Ports, bench_graph

LONGEST_S = 10.0
"""Most that any of the time-outs below may be [s]."""
MAX_PORT = 65535


def isolated_environment() -> dict[str, str]:
    """Return variables that keep a run on this machine, in a DDS domain of its own.

    A ROS_DOMAIN_ID that is already set is kept: then other tools can watch.

    Raises:
        ConfigError: if it is no domain.
    """
    given = os.environ.get(DOMAIN, "") and domain_id(os.environ)
    domain = str(given) or str(claim_domain())
    return {
        DOMAIN: domain,
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        **ONE_BLAS_THREAD,
    }


def ports_of(domain: int) -> Ports:
    """Return ports of the simulated devices that runs in other DDS domains do not use.

    A domain has 250 ports, of which DDS needs the first few dozen. The highest has not so many:
    there any free ones are returned.
    """
    first = 7400 + 250 * domain + 200
    if first + 4 > MAX_PORT:
        return free_ports()
    return Ports(first, first + 1, first + 2, first + 3, first + 4)


FIFO_PRIORITY = 50


def real_time_arguments() -> dict[str, int]:
    """Return arguments for the least possible delay between bridge and limb controller.

    Each on a core of its own that stays awake, and before other work, as far as the
    kernel allows it to this process (root may; see docs/installing.md).
    """
    found: dict[str, int] = {}
    cores = sorted(os.sched_getaffinity(0))
    if len(cores) > 1:
        found.update(cpu=cores[0], other_cpu=cores[1])
    if may_use_fifo():
        found.update(fifo_priority=FIFO_PRIORITY)
    if may_limit_wake_up():
        found.update(cpu_latency_us=0)
    return found


def forgiving(speed: float = 1.0, stall_s: float = 0.1) -> dict[str, float]:
    """Return arguments for a computer that stalls now and then, in the rig's time.

    A desktop's kernel may stall for longer than a rig's watchdogs allow; a rig's own values stay
    in its configuration files.

    Args:
        speed: of the rig's time against the computer's.
        stall_s: longest stall that must trip nothing, in the rig's time [s].
    """
    return {
        "watchdog": stall_s,
        "command_timeout": stall_s,
        # These three count on the computer's clock.
        "stale_after": min(2.0 * stall_s / speed, LONGEST_S),
        "state_timeout": min(5.0 * stall_s / speed, LONGEST_S),
        "robot_watch": min(5.0 * stall_s / speed, LONGEST_S),
    }


def launched(values: Mapping[str, Any], given: Collection[str]) -> dict[str, Any]:
    """Return the arguments of a launch of the bench: what was not given fits the rig's pace.

    Args:
        values: by name.
        given: names of those that somebody gave.
    """
    pace = forgiving(values["speed"])
    if values["lockstep"]:
        # The rig's time stands still while a process stalls, these two go by the computer's clock.
        pace |= {"robot_watch": LOCKSTEP_WATCH_S, "state_timeout": LOCKSTEP_WATCH_S}
    return {**values, **{name: value for name, value in pace.items() if name not in given}}


def free_ports() -> Ports:
    """Return ports of this machine's loopback that nobody uses now, for a second rig beside one."""
    kinds = (socket.SOCK_DGRAM, socket.SOCK_DGRAM, *[socket.SOCK_STREAM] * 3)
    with ExitStack() as held:
        wires = [held.enter_context(socket.socket(socket.AF_INET, kind)) for kind in kinds]
        for wire in wires:
            wire.bind(("127.0.0.1", 0))
        return Ports(*(int(wire.getsockname()[1]) for wire in wires))


def run_bench(
    values: dict[str, Any],
    on_line: Callable[[str, str], None] | None = None,
    log_folder: Path | None = None,
    environment: dict[str, str] | None = None,
    on_start: Callable[[dict[str, int]], None] | None = None,
    keep_going: bool = False,
    respawn_s: float | None = None,
    tools: Sequence[NodeSpec] = (),
    stand_ins: Mapping[str, tuple[str, str]] | None = None,
    limit_s: float | None = None,
) -> Ended:
    """Run the bench until one node ends, or Ctrl-C.

    Args:
        values: arguments by name, see cabols_control.bringup.graph.all_arguments; without `robot`
            the target is rigid.
        on_line: called with (node, line) of output; default prints.
        log_folder: for each node's output.
        environment: default isolated_environment().
        on_start: called with the process ids by node.
        keep_going: run on when a node ends.
        respawn_s: time from a node's end to its new start; None: never [s].
        tools: started after the graph; all ends with the first of them.
        stand_ins: package and executable to start in the place of an executable.
        limit_s: longest time of the run; then all nodes are ended. None: no limit [s].

    Returns:
        How it ended.
    """
    where = environment or isolated_environment()
    graph = bench_graph(
        values.get("lockstep", False),
        robot=values.get("robot", False),
        ports=free_ports() if "namespace" in values else ports_of(domain_id(where)),
        **{part: values[part] for part in PARTS.values() if part in values},
    )
    values = {"robot_watch": min(SILENCE_S / values.get("speed", 1.0), 10.0), **values}
    nodes = [_stand_in(node, stand_ins or {}) for node in complete(graph, values, values)]
    nodes += tools
    with _on_core(values.get("other_cpu", -1)):
        output = (on_line, log_folder)
        # A load comes off in the rig's time.
        grace_s = GRACE_S / values.get("speed", 1.0)
        return run(nodes, where, *output, on_start, keep_going, respawn_s, limit_s, grace_s)


def _stand_in(node: NodeSpec, stand_ins: Mapping[str, tuple[str, str]]) -> NodeSpec:
    if node.executable not in stand_ins:
        return node
    package, executable = stand_ins[node.executable]
    return replace(node, package=package, executable=executable)


@contextmanager
def _on_core(core: int) -> Iterator[None]:
    """Keep this thread, and those that it starts, off the control path's core; -1: anywhere."""
    before = os.sched_getaffinity(0)
    if core >= 0:
        os.sched_setaffinity(0, {core})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)
