# SPDX-License-Identifier: Apache-2.0
"""One YAML file of parameters for all nodes of a graph, in ROS's own form.

The command writes it with every parameter, its default and its meaning; launch files and the demo
read it. Each node's section may also be given to `ros2 run` by `--params-file`.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from cabols_control.bringup.argument_text import listed
from cabols_control.bringup.graph import all_arguments, all_nodes, with_arguments
from cabols_control.bringup.specs import NodeSpec
from cabols_control.bringup_nodes import OF_EVERY_NODE
from cabols_control.command_line import DONE, CommandParser, command, give_out, text_option
from cabols_control.errors import CabolsError, ConfigError
from cabols_control.parameters.reader import (
    SECTION,
    default_of,
    parameters_of,
    read_params_file,
    rows_of,
)
from cabols_control.rig_folder import BENCH

TEXT = """Write a YAML file of all parameters of all nodes, with their defaults.

Change what you need, delete the rest, and give it to a launch file: params_file:=FILE."""
ANYWHERE = "/**/"
"""Before a node's name: in any namespace."""
OF_THE_LAUNCH = (
    *("lockstep", "beside_clock", "wait_for_readers", "robot", "robot_clock", "link_port"),
)
"""Parameters by which a launch makes nodes fit each other."""
HEAD = """\
# Parameters of all nodes: for the launch files' argument params_file. What is left out keeps its
# default; arguments of a launch go before this file. Indices count from 0.
"""


def complete(
    graph: Sequence[NodeSpec], values: Mapping[str, Any], typed: Collection[str] = ()
) -> list[NodeSpec]:
    """Give a graph's nodes their arguments, parameter file, namespace and log level.

    Args:
        graph: its nodes.
        values: of the arguments, by name; those that are missing have their defaults.
        typed: names of those that somebody gave: they go before the file.

    Raises:
        ConfigError: if the file cannot be used, naming every mistake, or the graph lacks a node.
    """
    nodes = with_arguments(graph, dict(values))
    path = str(values.get("params_file", ""))
    defaults = {argument.name: argument.default for argument in all_arguments()}
    namespace = str(values.get("namespace", defaults["namespace"]))
    if path:
        nodes = _with_file(graph, nodes, Path(path), typed, namespace)
    _check_same_rig(nodes, defaults)
    check_files(nodes)
    nodes = chosen(nodes, str(values.get("nodes", defaults["nodes"])))
    level = str(values.get("log_level", defaults["log_level"]))
    return [
        replace(
            node,
            namespace=namespace if namespace != defaults["namespace"] else node.namespace,
            log_level=level if level != defaults["log_level"] else node.log_level,
        )
        if node.joins
        else node
        for node in nodes
    ]


def check_files(nodes: Sequence[NodeSpec]) -> None:
    """Read the files that nodes are given in place of their rig's, and a rig that is not the bench.

    Args:
        nodes: of a graph, with their parameters; all of one rig.

    Raises:
        ConfigError: naming every file that cannot be used.
    """
    calls: dict[tuple[str, str], dict[str, str]] = {}
    for node in nodes:
        given = {**node.options, **node.parameters}
        for argument in all_arguments():
            if argument.reader and argument.name in node.takes:
                rig = str(given.get("rig", BENCH))
                path = str(given.get(argument.parameter or argument.name, ""))
                of_all = argument.name in OF_EVERY_NODE and rig != BENCH
                if path or of_all:
                    calls.setdefault((argument.reader, rig), {})[argument.keyword] = path
    wrong: list[str] = []
    for (reader, rig), paths in calls.items():
        module, _, function = reader.partition(":")
        try:
            getattr(importlib.import_module(module), function)(rig, **paths)
        except CabolsError as error:
            wrong.append(str(error))
    if wrong:
        raise ConfigError("; ".join(wrong))


def chosen(graph: Sequence[NodeSpec], names: str) -> list[NodeSpec]:
    """Choose nodes of a graph.

    Args:
        graph: its nodes.
        names: of those to start, by commas; empty: all.

    Raises:
        ConfigError: for a name that no node of the graph has.
    """
    wanted = listed(names)
    there = [node.executable for node in graph]
    if strange := [name for name in wanted if name not in there]:
        raise ConfigError(
            f"nodes: expected some of {', '.join(there)}, got {', '.join(strange)}; robot, record, "
            "campaign and console say which nodes the graph has"
        )
    return [node for node in graph if not wanted or node.executable in wanted]


def _check_same_rig(nodes: Sequence[NodeSpec], defaults: Mapping[str, Any]) -> None:
    """Refuse a graph whose nodes are of different rigs, as a file may say."""
    for name in OF_EVERY_NODE:
        found = {
            node.executable: {**node.options, **node.parameters}.get(name, defaults[name])
            for node in nodes
            if name in node.takes
        }
        if len(set(found.values())) > 1:
            raise ConfigError(
                f"{name}: expected the same for all nodes, got "
                f"{', '.join(f'{value!r} for {node}' for node, value in found.items())}; give it "
                f"as the argument {name}"
            )


def _with_file(
    graph: Sequence[NodeSpec],
    nodes: Sequence[NodeSpec],
    path: Path,
    typed: Collection[str],
    namespace: str,
) -> list[NodeSpec]:
    given = read_params_file(path, namespace)
    wrong: list[str] = []
    found = []
    for own, node in zip(graph, nodes, strict=True):
        parameters = dict(node.parameters)
        for name, value in given.get(node.executable, {}).items():
            if name in own.parameters:
                if own.parameters[name] != value:
                    wrong.append(
                        f"{node.executable}: {name} is set by the launch itself to "
                        f"{own.parameters[name]!r}, got {value!r}; leave it out"
                    )
            elif not {row.name for row in rows_of(node, name)} & set(typed):
                parameters[name] = value
        found.append(replace(node, parameters=parameters))
    if wrong:
        raise ConfigError(f"{path}: {'; '.join(wrong)}")
    return found


def params_text(nodes: Sequence[NodeSpec]) -> str:
    """Return the file's text, with every parameter of some nodes at its default.

    Args:
        nodes: of the graph.
    """
    return HEAD + "".join(line + "\n" for node in nodes for line in _lines(node))


def _lines(node: NodeSpec) -> Iterator[str]:
    yield ""
    yield f"{ANYWHERE}{node.executable}:"
    yield f"  {SECTION}:"
    for parameter in parameters_of(node):
        if parameter.name in OF_THE_LAUNCH:
            continue
        default = default_of(parameter)
        if default is None:
            yield f"    # {parameter.name}: {parameter.description}"
            continue
        text = yaml.safe_dump(default, default_flow_style=True, width=1000).split("\n")[0]
        bounds = f" ({parameter.bounds.replace(', ', ' to ')})" if parameter.bounds else ""
        yield f"    {parameter.name}: {text}  # {parameter.description}{bounds}"


def launched_nodes(kind: str) -> list[NodeSpec]:
    """Nodes that one of the launch files may start.

    Args:
        kind: "rig" or "bench".
    """
    clock = "CLOCK" if kind == "rig" else "SIMULATION"
    other = "SIMULATION" if kind == "rig" else "CLOCK"
    nodes = [node for node in all_nodes() if node.joins and node.role is not None]
    kept = [node for node in nodes if node.role is not None and node.role.name != other]
    return sorted(kept, key=lambda node: node.role is not None and node.role.name != clock)


@command
def main(arguments: Sequence[str] | None = None) -> int:
    """Write the file; returns 0, or 2 for a wrong command line."""
    parser = CommandParser("parameters_file", TEXT)
    parser.add_argument(
        "--kind",
        choices=("rig", "bench"),
        default="rig",
        help="of rig.launch.py or bench.launch.py (default: %(default)s)",
    )
    text_option(parser)
    options = parser.parse_args(arguments)
    text = params_text(launched_nodes(options.kind))
    give_out(text, options.output)
    return DONE


if __name__ == "__main__":
    sys.exit(main())
