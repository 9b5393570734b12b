# SPDX-License-Identifier: Apache-2.0
"""The ROS parameters that a node declares, read from its source: nothing of ROS is imported.

A node's `main` is followed through the classes and functions of nodes/ and ros/ that it names; each
`declare(node, name, default, description, bounds)` found on the way is a parameter of the node, and
so is each `declare_row(node, NODES.argument(name))`, whose row the table of the package has.
"""

from __future__ import annotations

import ast
import functools
import importlib.util
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cabols_control.bringup.graph import all_arguments

PREFIX = "cabols_"
DECLARE, DECLARE_ROW = "declare", "declare_row"
ROS_FOLDERS = {"nodes", "ros"}
Definition = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


@dataclass(frozen=True)
class DeclaredParameter:
    """One parameter of a node.

    Attributes:
        name: of the parameter.
        default: as Python writes it.
        description: for people, with the unit.
        bounds: least and largest value as Python writes them; empty: none.
    """

    name: str
    default: str
    description: str
    bounds: str


@dataclass(frozen=True)
class _Module:
    """What one source file defines.

    Attributes:
        docstring: of the module.
        definitions: top-level functions and classes.
        constants: top-level assignments.
        imports: name here -> (module, name there).
    """

    docstring: str
    definitions: dict[str, Definition]
    constants: dict[str, ast.expr]
    imports: dict[str, tuple[str, str]]


def declared_parameters(module: str, entry: str = "main") -> list[DeclaredParameter]:
    """Return a node's parameters, sorted by name.

    Args:
        module: full name of the node's module.
        entry: function that runs the node.

    Raises:
        ModuleNotFoundError: if there is no such module.
    """
    return list(_declared(module, entry))


@functools.cache
def _declared(module: str, entry: str) -> tuple[DeclaredParameter, ...]:
    found: dict[str, DeclaredParameter] = {}
    _follow(module, entry, found, set())
    return tuple(sorted(found.values(), key=lambda parameter: parameter.name))


def docstring_of(module: str) -> str:
    """Return a module's docstring without importing it."""
    return _read(module).docstring


def _follow(
    module: str, name: str, found: dict[str, DeclaredParameter], seen: set[tuple[str, str]]
) -> None:
    """Gather what one definition declares, and what the definitions that it names do."""
    if (module, name) in seen or not ROS_FOLDERS & set(module.split(".")):
        return
    seen.add((module, name))
    source = _read(module)
    definition = source.definitions.get(name)
    if definition is None:
        if name in source.imports:
            _follow(*source.imports[name], found, seen)
        return
    nodes = list(ast.walk(definition))
    values = {**_imported(module), **source.constants, **_assigned(nodes)}
    for node in nodes:
        if isinstance(node, ast.Call) and _is_row(node):
            parameter = _of_table(node)
            found.setdefault(parameter.name, parameter)
        elif isinstance(node, ast.Call) and _is_declaration(node):
            parameter = _parameter(node, values)
            found.setdefault(parameter.name, parameter)
        elif isinstance(node, ast.Name):
            if node.id in source.definitions:
                _follow(module, node.id, found, seen)
            elif node.id in source.imports:
                _follow(*source.imports[node.id], found, seen)


def _is_declaration(call: ast.Call) -> bool:
    return (
        isinstance(call.func, ast.Name)
        and call.func.id == DECLARE
        and len(call.args) > 3
        and isinstance(call.args[1], ast.Constant)
    )


def _is_row(call: ast.Call) -> bool:
    return (
        isinstance(call.func, ast.Name)
        and call.func.id == DECLARE_ROW
        and len(call.args) > 1
        and isinstance(call.args[1], ast.Call)
    )


def _of_table(call: ast.Call) -> DeclaredParameter:
    row_call = call.args[1]
    assert isinstance(row_call, ast.Call)
    name = ast.literal_eval(row_call.args[0])
    row = next(argument for argument in all_arguments() if argument.name == name)
    bounds = "" if row.bounds is None else repr(row.bounds).strip("()")
    text = f"{row.unit}, {row.description}" if row.unit else row.description
    return DeclaredParameter(row.parameter or row.name, repr(row.default), text, bounds)


def _assigned(nodes: Iterable[ast.AST]) -> dict[str, ast.expr]:
    """Return the plain assignments among the nodes of a definition, by name."""
    return {
        node.targets[0].id: node.value
        for node in nodes
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)
    }


@functools.cache
def _imported(module: str) -> dict[str, ast.expr]:
    """Return the constants that a module imports from the project, by the name that it uses."""
    found = {}
    for name, (other, original) in _read(module).imports.items():
        if not other.startswith(PREFIX):
            continue
        if (constant := _read(other).constants.get(original)) is not None:
            found[name] = constant
    return found


def _parameter(call: ast.Call, values: dict[str, ast.expr]) -> DeclaredParameter:
    _, name, default, description, *rest = call.args
    rest += [keyword.value for keyword in call.keywords if keyword.arg == "bounds"]
    return DeclaredParameter(
        str(ast.literal_eval(name)),
        _text(default, values, repr),
        _text(description, values, str),
        _text(rest[0], values, repr).strip("()") if rest else "",
    )


def _text(expression: ast.expr, values: dict[str, ast.expr], show: Any) -> str:
    """Return an expression's value as text; what cannot be evaluated as it is written."""
    if isinstance(expression, ast.Name) and expression.id in values:
        expression = values[expression.id]
    if isinstance(expression, ast.JoinedStr):
        return "".join(
            str(part.value) if isinstance(part, ast.Constant) else _text(part.value, values, str)
            for part in expression.values
            if isinstance(part, ast.Constant | ast.FormattedValue)
        )
    try:
        return str(show(ast.literal_eval(expression)))
    except ValueError:
        return ast.unparse(expression)


@functools.cache
def _read(module: str) -> _Module:
    path = _source(module)
    tree = ast.parse(path.read_text(encoding="utf-8"), str(path))
    definitions: dict[str, Definition] = {}
    constants: dict[str, ast.expr] = {}
    imports: dict[str, tuple[str, str]] = {}
    for node in tree.body:
        if isinstance(node, Definition):
            definitions[node.name] = node
        elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            constants[node.targets[0].id] = node.value
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            imports.update({a.asname or a.name: (node.module, a.name) for a in node.names})
    return _Module(ast.get_docstring(tree) or "", definitions, constants, imports)


def _source(module: str) -> Path:
    """Find a module's file without importing the packages that it lies in."""
    package, *rest = module.split(".")
    found = importlib.util.find_spec(package)
    for folder in () if found is None else found.submodule_search_locations or ():
        path = Path(folder).joinpath(*rest)
        for candidate in (path.with_suffix(".py"), path / "__init__.py"):
            if candidate.is_file():
                return candidate
    raise ModuleNotFoundError(f"{module}: expected a module with a source file, found none")
