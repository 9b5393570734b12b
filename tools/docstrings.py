# SPDX-License-Identifier: Apache-2.0
"""Find public functions of two or more arguments whose docstrings do not describe them.

Usage: docstrings.py            list them
       docstrings.py --shrink   take from the skip list what is described by now; nothing is added

Rooms that hold nodes are left out: their functions are ROS's callbacks. Standard library only.
"""

from __future__ import annotations

import argparse
import ast
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

from structure import ROOT, Module, read_tree

SKIPPED = ROOT / "tests" / "system" / "undescribed_arguments.txt"
LEFT_OUT = {"nodes", "ros", "launch"}
LEAST_ARGUMENTS = 2
ROW = re.compile(r"^    (\*{0,2}\w+(?:, \*{0,2}\w+)*)(?: \([^)]*\))?:", re.MULTILINE)
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


def undescribed(modules: Mapping[str, Module]) -> dict[str, list[str]]:
    """Find the functions with an argument that no `Args:` section describes.

    Args:
        modules: of the packages, by name, as structure.read_tree gives them.

    Returns:
        For each function, `module:name`, its arguments that are not described.
    """
    found = {}
    for name, module in modules.items():
        if LEFT_OUT & set(name.split(".")):
            continue
        tree = ast.parse(module.path.read_text(encoding="utf-8"))
        for function, node in _public(tree.body, ""):
            missing = missing_arguments(node)
            if missing:
                found[f"{name}:{function}"] = missing
    return found


def missing_arguments(node: ast.FunctionDef | ast.AsyncFunctionDef) -> list[str]:
    """Return the arguments of a function that its docstring does not describe."""
    listed = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    names = [argument.arg for argument in listed if argument.arg not in {"self", "cls"}]
    if len(names) < LEAST_ARGUMENTS:
        return []
    described = _described(ast.get_docstring(node) or "")
    return [name for name in names if name not in described]


def _described(docstring: str) -> set[str]:
    """Return the names that the `Args:` section describes; a row may describe several."""
    section = re.search(r"^Args:\n((?:[ \t]+.*\n?|\n)*)", docstring, re.MULTILINE)
    rows = ROW.findall(section.group(1)) if section else []
    return {name for row in rows for name in re.findall(r"\w+", row)}


def _public(
    body: list[ast.stmt], prefix: str
) -> Iterator[tuple[str, ast.FunctionDef | ast.AsyncFunctionDef]]:
    """Yield the public functions of a module and the methods of its public classes."""
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from _public(node.body, f"{prefix}{node.name}.")
        elif isinstance(node, FUNCTIONS) and not node.name.startswith("_"):
            yield prefix + node.name, node


def skipped(path: Path = SKIPPED) -> set[str]:
    """Read the functions that are still to be described."""
    return set(path.read_text(encoding="utf-8").split())


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Find arguments that no docstring describes.")
    parser.add_argument("--shrink", action="store_true", help="shorten the skip list")
    found = undescribed(read_tree())
    if parser.parse_args().shrink:
        left = sorted(skipped() & set(found))
        SKIPPED.write_text("".join(f"{name}\n" for name in left), encoding="utf-8")
        print(f"{len(left)} functions are left in {SKIPPED.name}")
    else:
        for name, arguments in found.items():
            print(f"{name}: {', '.join(arguments)}")


if __name__ == "__main__":
    main()
