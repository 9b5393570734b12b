# SPDX-License-Identifier: Apache-2.0
"""Reads a YAML file of nodes' parameters, in ROS's own form: typed, and every mistake is named."""

from __future__ import annotations

import ast
import difflib
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

from cabols_control.bringup.argument_text import check_value
from cabols_control.bringup.graph import all_arguments, all_nodes
from cabols_control.bringup.specs import Argument, NodeSpec
from cabols_control.errors import ConfigError
from cabols_control.files.strict_yaml import parse, shown
from cabols_control.parameters.declared import DeclaredParameter, declared_parameters
from cabols_control.topics import NAMESPACE

SECTION = "ros__parameters"
EVERY_NODE = ("/**", "/*")
OF_ROS = {"use_sim_time": False, "start_type_description_service": True}
"""Parameters that ROS declares itself, and the only value that the graph can obey."""


def rows_of(node: NodeSpec, parameter: str) -> list[Argument]:
    """Return the arguments of a launch that give a node's parameter.

    Args:
        node: of the graph.
        parameter: its name for it.
    """
    return [
        a for a in all_arguments() if a.name in node.takes and (a.parameter or a.name) == parameter
    ]


def read_params_file(path: Path, namespace: str = NAMESPACE) -> dict[str, dict[str, Any]]:
    """Read a file of parameters.

    What stands under `/**` is of every node that has such a parameter, and gives way to a node's
    own section. Sections of other namespaces than the graph's are another rig's.

    Args:
        path: of the YAML file.
        namespace: of the graph.

    Returns:
        Values by parameter, by the executable's name, in the types that the nodes declare.

    Raises:
        ConfigError: naming every node, parameter and value that cannot be used.
    """
    try:
        content = parse(path.read_text(encoding="utf-8")).content
    except (OSError, UnicodeDecodeError, ConfigError) as error:
        raise ConfigError(f"{path}: expected a YAML file of parameters, got {error}") from error
    if content is None:
        content = {}  # every line of it has been deleted
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: expected nodes with their parameters, got {shown(content)}")
    nodes = {node.executable: node for node in all_nodes() if node.joins}
    wrong: list[str] = []
    ours: set[str] = set()
    theirs: set[str] = set()
    of_all: dict[str, dict[str, Any]] = {}
    found: dict[str, dict[str, Any]] = {}
    for target, section in _sections(content, nodes):
        where, _, name = target.rpartition("/")
        if target not in EVERY_NODE and name not in nodes:
            wrong.append(f"{target}: there is no such node{_close(name, nodes)}")
            continue
        if section is None or section == {SECTION: None}:
            continue
        given = section.get(SECTION) if isinstance(section, dict) else None
        if not isinstance(given, dict) or set(section) != {SECTION}:
            wrong.append(f"{target}: expected {SECTION} with parameters, got {shown(section)}")
        elif target in EVERY_NODE:
            _read_of_all(nodes, given, of_all, wrong)
        else:
            place = "/" + where.strip("/")
            mine = place in ("/", "/*", "/**", namespace)
            (ours if mine else theirs).add(place)
            _read_section(nodes[name], given, found.setdefault(name, {}) if mine else {}, wrong)
    if theirs and not (ours or of_all):
        wrong.append(f"expected a section of {namespace}, got those of {', '.join(sorted(theirs))}")
    if wrong:
        raise ConfigError(f"{path}: {'; '.join(wrong)}")
    both = {name: {**of_all.get(name, {}), **found.get(name, {})} for name in {**of_all, **found}}
    return {name: values for name, values in both.items() if values}


def _sections(
    content: Mapping[Any, Any], nodes: Collection[str], above: str = ""
) -> Iterator[tuple[str, Any]]:
    """Yield names of nodes and their sections, also out of namespaces that hold nodes."""
    for key, section in content.items():
        target = f"{above}/{str(key).strip('/')}" if above else str(key)
        holds = isinstance(section, dict) and section and SECTION not in section
        named = target.rpartition("/")[2] in nodes or target in EVERY_NODE
        if holds and not named and all(isinstance(inner, dict) for inner in section.values()):
            yield from _sections(section, nodes, target)
        else:
            yield target, section


def _read_of_all(
    nodes: Mapping[str, NodeSpec],
    given: Mapping[str, Any],
    of_all: dict[str, dict[str, Any]],
    wrong: list[str],
) -> None:
    """Give each node those of the parameters that it has."""
    for parameter, value in given.items():
        having = {
            name: node
            for name, node in nodes.items()
            if any(parameter == known.name for known in parameters_of(node))
        }
        if not having and parameter not in OF_ROS:
            known = {p.name for node in nodes.values() for p in parameters_of(node)}
            close = difflib.get_close_matches(str(parameter), known, 1)
            hint = f"; did you mean {close[0]}?" if close else ""
            wrong.append(f"no node has a parameter {parameter}{hint}")
            continue
        # One that ROS declares itself is of every node: one of them says whether it can be obeyed.
        for name, node in (having or dict([*nodes.items()][:1])).items():
            _read_section(node, {parameter: value}, of_all.setdefault(name, {}), wrong)


def _read_section(
    node: NodeSpec, given: Mapping[str, Any], found: dict[str, Any], wrong: list[str]
) -> None:
    """Read one node's parameters into `found`, and what is wrong with them into `wrong`."""
    name, known = node.executable, {p.name: p for p in parameters_of(node)}
    for parameter, value in given.items():
        if parameter in OF_ROS:
            if value is not OF_ROS[parameter]:
                wrong.append(
                    f"{name}: {parameter}: expected {str(OF_ROS[parameter]).lower()}, got "
                    f"{shown(value)}; leave it out"
                )
        elif parameter not in known:
            wrong.append(f"{name}: there is no parameter {parameter}{_close(parameter, known)}")
        else:
            try:
                found[parameter] = typed = _typed(known[parameter], value)
                for argument in rows_of(node, parameter):
                    check_value(argument, typed)
            except ConfigError as error:
                wrong.append(f"{name}: {error}")


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
