# SPDX-License-Identifier: Apache-2.0
"""One YAML file of parameters for all nodes of a graph, in ROS's own form.

The command writes it with every parameter, its default and its meaning; launch files and the demo
read it. Each node's section may also be given to `ros2 run` by `--params-file`.
"""

from __future__ import annotations

import ast
import difflib
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
from cabols_control.command_line import DONE, CommandParser, command
from cabols_control.declared_parameters import DeclaredParameter, declared_parameters
from cabols_control.errors import ConfigError
from cabols_control.files.strict_yaml import parse, shown

TEXT = """Write a YAML file of all parameters of all nodes, with their defaults.

Change what you need, delete the rest, and give it to a launch file: params_file:=FILE."""
SECTION = "ros__parameters"
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
    if path:
        nodes = _with_file(graph, nodes, Path(path), typed)
    defaults = {argument.name: argument.default for argument in all_arguments()}
    _check_same_rig(nodes, defaults)
    nodes = chosen(nodes, str(values.get("nodes", defaults["nodes"])))
    namespace = str(values.get("namespace", defaults["namespace"]))
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
    graph: Sequence[NodeSpec], nodes: Sequence[NodeSpec], path: Path, typed: Collection[str]
) -> list[NodeSpec]:
    given = read_params_file(path)
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
            elif not _argument_of(node, name) & set(typed):
                parameters[name] = value
        found.append(replace(node, parameters=parameters))
    if wrong:
        raise ConfigError(f"{path}: {'; '.join(wrong)}")
    return found


def _argument_of(node: NodeSpec, parameter: str) -> set[str]:
    """Names of the arguments that give a node's parameter."""
    return {
        a.name
        for a in all_arguments()
        if a.name in node.takes and (a.parameter or a.name) == parameter
    }


def read_params_file(path: Path) -> dict[str, dict[str, Any]]:
    """Read a file of parameters.

    Args:
        path: of the YAML file.

    Returns:
        Values by parameter, by the executable's name, in the types that the nodes declare.

    Raises:
        ConfigError: naming every node, parameter and value that cannot be used.
    """
    try:
        content = parse(path.read_text(encoding="utf-8")).content
    except (OSError, UnicodeDecodeError, ConfigError) as error:
        raise ConfigError(f"{path}: expected a YAML file of parameters, got {error}") from error
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: expected nodes with their parameters, got {shown(content)}")
    nodes = {node.executable: node for node in all_nodes() if node.joins}
    found: dict[str, dict[str, Any]] = {}
    wrong: list[str] = []
    for target, section in content.items():
        name = str(target).rpartition("/")[2]
        if name not in nodes:
            wrong.append(f"{target}: there is no such node{_close(name, nodes)}")
            continue
        if section is None or section == {SECTION: None}:
            continue  # every line of it has been deleted
        given = section.get(SECTION) if isinstance(section, dict) else None
        if not isinstance(given, dict) or set(section) != {SECTION}:
            wrong.append(f"{target}: expected {SECTION} with parameters, got {shown(section)}")
            continue
        known = {p.name: p for p in parameters_of(nodes[name])}
        for parameter, value in given.items():
            if parameter not in known:
                wrong.append(f"{name}: there is no parameter {parameter}{_close(parameter, known)}")
                continue
            try:
                found.setdefault(name, {})[parameter] = _typed(known[parameter], value)
            except ConfigError as error:
                wrong.append(f"{name}: {error}")
    if wrong:
        raise ConfigError(f"{path}: {'; '.join(wrong)}")
    return found


def _close(name: Any, known: Collection[str]) -> str:
    close = difflib.get_close_matches(str(name), known, 1)
    return f"; did you mean {close[0]}?" if close else f"; there are {', '.join(sorted(known))}"


def parameters_of(node: NodeSpec) -> list[DeclaredParameter]:
    """Parameters that a node declares, by name."""
    return declared_parameters(f"{node.package}.nodes.{node.executable}")


def default_of(parameter: DeclaredParameter) -> Any:
    """Return a parameter's default, of its type; None if its source does not say it."""
    try:
        return ast.literal_eval(parameter.default)
    except ValueError:
        pass
    try:
        tree = ast.parse(parameter.default, mode="eval").body
        if isinstance(tree, ast.BinOp) and isinstance(tree.op, ast.Mult):
            return list(ast.literal_eval(tree.left)) * int(ast.literal_eval(tree.right))
    except (ValueError, SyntaxError):
        pass
    return None


def _typed(parameter: DeclaredParameter, value: Any) -> Any:
    """Return a value in its parameter's type.

    Raises:
        ConfigError: if it is of another one, or out of the bounds.
    """
    default = default_of(parameter)
    what = f"{parameter.name}: expected {_kind(default)}, got {shown(value)}"
    if isinstance(default, float) and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if isinstance(default, list) and isinstance(value, list) and default:
        if isinstance(default[0], float):
            value = [float(v) if type(v) is int else v for v in value]
        if any(type(v) is not type(default[0]) for v in value):
            raise ConfigError(what)
    if type(value) is not (list if default is None else type(default)):
        raise ConfigError(what)
    if parameter.bounds:
        low, high = ast.literal_eval(f"({parameter.bounds})")
        for number in value if isinstance(value, list) else [value]:
            if not low <= number <= high:
                raise ConfigError(f"{parameter.name}: expected {low:g} to {high:g}, got {number!r}")
    if parameter.name.endswith("_file") and value and not Path(str(value)).expanduser().is_file():
        raise ConfigError(f"{parameter.name}: expected a file, found none at {value}")
    return str(Path(str(value)).expanduser()) if str(value).startswith("~") else value


def _kind(default: Any) -> str:
    kinds = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}
    if isinstance(default, list):
        of = kinds.get(type(default[0]), "values") if default else "values"
        return f"a list, each {of}"
    return kinds.get(type(default), "a list")


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
    parser.add_argument("--output", type=Path, default=None, help="file; default: print it")
    options = parser.parse_args(arguments)
    text = params_text(launched_nodes(options.kind))
    if options.output is None:
        print(text, end="")
    else:
        options.output.write_text(text, encoding="utf-8")
    return DONE


if __name__ == "__main__":
    sys.exit(main())
