# SPDX-License-Identifier: Apache-2.0
"""Finds numbers that stand for names: column indices, and kernels with long argument lists.

A subscript counts if it holds an integer of 3 or more, or picks a column (`table[:, 1]`,
`table[..., 1]`) by any integer. Vectors of the six wrench axes are told by their names.
"""

from __future__ import annotations

import ast
from dataclasses import dataclass

MOST_ARGUMENTS = 8
FIRST_NAMELESS = 3
"""0, 1 and 2 are x, y, z, or the parts of a pair."""
LAST_AXIS = 5
COMPILERS = {"njit", "jit", "compiled", "inlined", "vectorised"}
WRENCHES = {
    "wrench", "turned", "measured", "control", "tared", "bias", "load", "accumulated", "residual",
    "matrix", "jacobian", "q", "desired",
}  # fmt: skip
"""Vectors (6,) of force and torque, or matrices with such rows: 3 to 5 are the torque's axes."""
COORDINATES = {
    "points", "corners", "position", "positions", "base_points", "platform_points", "directions",
    "keys", "lone", "coordinates",
}  # fmt: skip
"""Arrays (k, 3), of places in a grid, or of planar coordinates: columns are x, y, z."""


@dataclass(frozen=True)
class Finding:
    """One place in a file, and the code that stands there."""

    line: int
    code: str


def _integer(node: ast.expr) -> int | None:
    if isinstance(node, ast.Constant) and type(node.value) is int:
        return node.value
    return None


def _name(node: ast.expr) -> str:
    """Last name of what is subscripted: `wrench` of self.wrench and of rig.wrench[:6]."""
    while isinstance(node, ast.Subscript):
        node = node.value
    if isinstance(node, ast.Attribute):
        return node.attr
    return node.id if isinstance(node, ast.Name) else ""


def _is_numbered(node: ast.Subscript) -> bool:
    parts = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
    if not parts:
        return False  # x[()] is all of x
    name, indices = _name(node.value).lstrip("_"), [_integer(part) for part in parts]
    for index in indices:
        if index is not None and index >= FIRST_NAMELESS:
            return not (name in WRENCHES and index <= LAST_AXIS)
    whole = isinstance(parts[0], ast.Slice) or (
        isinstance(parts[0], ast.Constant) and parts[0].value is Ellipsis
    )
    column = len(parts) > 1 and whole and any(index is not None for index in indices[1:])
    # What a call returns has no name; its only column is no column of a table.
    return column and bool(name) and name not in COORDINATES | WRENCHES


def numbered_columns(source: str) -> list[Finding]:
    """Subscripts of a module by numbers that should be names."""
    nodes = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Subscript)]
    found = [Finding(node.lineno, ast.unparse(node)) for node in nodes if _is_numbered(node)]
    return sorted(found, key=lambda finding: (finding.line, finding.code))


def _compiles(decorator: ast.expr) -> bool:
    called = decorator.func if isinstance(decorator, ast.Call) else decorator
    return _name(called) in COMPILERS


def long_kernels(source: str) -> list[Finding]:
    """Compiled functions of a module with more than MOST_ARGUMENTS positional arguments."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.FunctionDef) or not any(map(_compiles, node.decorator_list)):
            continue
        count = len(node.args.posonlyargs) + len(node.args.args)
        if count > MOST_ARGUMENTS or node.args.vararg is not None:
            found.append(Finding(node.lineno, f"{node.name}: {count} arguments"))
    return found
