# SPDX-License-Identifier: Apache-2.0
"""Read who imports whom in the packages: rooms, files, arrows, circles, imports upward.

Usage: structure.py            print the tables and what breaks the rules; exit 1 if anything does
       structure.py --write    put the tables between their markers in docs/architecture.md

A *room* is a folder of a package, with all that is below it, or a module at the package's top.
The same rule holds on every level: what lies side by side in one folder (files and folders) never
imports in a circle. A circle between two files is then a circle somewhere on the way, too.
Imports are read from the syntax tree, at any depth of a file; nothing is executed.
Standard library only.
"""

from __future__ import annotations

import argparse
import ast
import re
import sys
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "architecture.md"
BEGIN, END = "<!-- structure: begin -->", "<!-- structure: end -->"

MAY_IMPORT: Mapping[str, frozenset[str]] = {
    "cabols_control": frozenset(),
    "cabols_hw": frozenset({"cabols_control"}),
    "cabols_stiffness": frozenset({"cabols_control"}),
    "cabols_sim": frozenset({"cabols_control", "cabols_hw"}),
}
"""The packages below each package; cabols_msgs, below all of them, is no Python of ours."""
LINES_MAX = 400
"""Longest file of a package [lines]."""
FILES_MAX = 12
"""Files in one folder above which a report says so; no rule."""
GENERATED = re.compile(r"_pb2(_grpc)?\.py$")

Graph = Mapping[str, Iterable[str]]


@dataclass(frozen=True)
class Module:
    """One Python file.

    Attributes:
        name: dotted name; a package's `__init__.py` keeps `__init__` as its last part.
        path: where it is.
        lines: how many it has.
        imports: names of the project's other modules that it imports.
    """

    name: str
    path: Path
    lines: int
    imports: frozenset[str]

    @property
    def package(self) -> str:
        """The package that it belongs to."""
        return self.name.partition(".")[0]

    @property
    def room(self) -> str:
        """The package's folder or module on the package's first level."""
        return self.name.split(".")[1]

    @property
    def folder(self) -> str:
        """The folder that it lies in, dotted."""
        return self.name.rpartition(".")[0]


def read_tree(root: Path = ROOT) -> dict[str, Module]:
    """Read the modules of all packages.

    Args:
        root: folder of the repository, with `cabols_control/cabols_control` and so on.

    Returns:
        The modules by name, without generated ones.
    """
    files = {}
    for package in MAY_IMPORT:
        base = root / package
        for path in sorted((base / package).rglob("*.py")):
            if not GENERATED.search(path.name):
                files[".".join(path.relative_to(base).with_suffix("").parts)] = path
    modules = {}
    for name, path in files.items():
        text = path.read_text(encoding="utf-8")
        found = frozenset(_imports(name, ast.parse(text, str(path)), files)) - {name}
        modules[name] = Module(name, path, len(text.splitlines()), found)
    return modules


def _imports(name: str, tree: ast.Module, known: Mapping[str, Path]) -> Iterable[str]:
    """Yield the known modules that a file imports."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield from _resolve(alias.name, known)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = name.split(".")[: -node.level]
                base = ".".join([*above, *([node.module] if node.module else [])])
            for alias in node.names:
                inner = list(_resolve(f"{base}.{alias.name}", known))
                yield from inner or _resolve(base, known)


def _resolve(dotted: str, known: Mapping[str, Path]) -> Iterable[str]:
    """Yield the module of a dotted name, if it is one of ours."""
    if dotted in known:
        yield dotted
    elif f"{dotted}.__init__" in known:
        yield f"{dotted}.__init__"


def circles(graph: Graph) -> list[tuple[str, ...]]:
    """Find what imports itself over others.

    Args:
        graph: for each name the names that it points at.

    Returns:
        The strongly connected components of more than one name, each sorted; [] without a circle.
    """
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found = []

    def visit(name: str) -> None:
        index[name] = low[name] = len(index)
        stack.append(name)
        for other in graph.get(name, ()):
            if other not in index:
                visit(other)
                low[name] = min(low[name], low[other])
            elif other in stack:
                low[name] = min(low[name], index[other])
        if low[name] == index[name]:
            at = stack.index(name)
            component = stack[at:]
            del stack[at:]
            if len(component) > 1:
                found.append(tuple(sorted(component)))

    for name in sorted(graph):
        if name not in index:
            visit(name)
    return sorted(found)


def arrows_in(modules: Mapping[str, Module], folder: str) -> dict[str, set[str]]:
    """Draw the imports between what lies side by side in a folder.

    Args:
        modules: all of them, by name.
        folder: dotted name of the folder.

    Returns:
        For each file or folder in it those that it imports, full dotted names.
    """
    depth = len(folder.split(".")) + 1
    below = {name for name in modules if name.startswith(f"{folder}.")}
    arrows: dict[str, set[str]] = {}
    for name in sorted(below):
        here = ".".join(name.split(".")[:depth])
        others = {".".join(n.split(".")[:depth]) for n in modules[name].imports & below}
        arrows.setdefault(here, set()).update(others - {here})
    return arrows


def room_circles(modules: Mapping[str, Module]) -> list[tuple[str, ...]]:
    """Find circles between what lies side by side, on every level of every package."""
    parts = [name.split(".") for name in modules]
    folders = sorted({".".join(p[:depth]) for p in parts for depth in range(1, len(p))})
    return [circle for folder in folders for circle in circles(arrows_in(modules, folder))]


def file_circles(modules: Mapping[str, Module]) -> list[tuple[str, ...]]:
    """Find circles between single files."""
    return circles({name: sorted(module.imports) for name, module in modules.items()})


def upward(modules: Mapping[str, Module]) -> list[str]:
    """List the imports of a package that is not below the importing one."""
    return [
        f"{module.name} imports {other}"
        for module in modules.values()
        for other in sorted(module.imports)
        if other.partition(".")[0] not in MAY_IMPORT[module.package] | {module.package}
    ]


def too_long(modules: Mapping[str, Module]) -> list[str]:
    """List the files of more than LINES_MAX lines."""
    return [
        f"{module.name}: {module.lines} lines, at most {LINES_MAX}"
        for module in modules.values()
        if not module.lines <= LINES_MAX
    ]


def crowded(modules: Mapping[str, Module]) -> list[str]:
    """List the folders of more than FILES_MAX files beside their `__init__`; a report, no rule."""
    counts = Counter(m.folder for m in modules.values() if not m.name.endswith(".__init__"))
    return [
        f"{folder}: {count} files, about {FILES_MAX} are enough"
        for folder, count in sorted(counts.items())
        if count > FILES_MAX
    ]


def violations(modules: Mapping[str, Module]) -> list[str]:
    """List everything that breaks a rule of structure, in words."""
    return [
        *(f"circle between files: {' '.join(found)}" for found in file_circles(modules)),
        *(f"circle between rooms: {' '.join(found)}" for found in room_circles(modules)),
        *(f"import upward: {line}" for line in upward(modules)),
        *(f"too long: {line}" for line in too_long(modules)),
    ]


def layers(arrows: Graph) -> dict[str, int]:
    """Number the layers: 0 imports none of the others, n imports one of layer n - 1.

    Args:
        arrows: for each room those that it imports. Names within a circle share a layer.
    """
    together = {name: circle for circle in circles(arrows) for name in circle}
    found: dict[str, int] = {}

    def layer(name: str) -> int:
        if name not in found:
            group = together.get(name, (name,))
            below = {o for member in group for o in arrows.get(member, ())} - set(group)
            number = 1 + max((layer(other) for other in below), default=-1)
            found.update(dict.fromkeys(group, number))
        return found[name]

    for name in arrows:
        layer(name)
    return found


def tables(modules: Mapping[str, Module]) -> str:
    """Write the tables of docs/architecture.md, as Markdown."""
    lines = ["| package | rooms | files | arrows between its rooms | imports |"]
    lines += ["|---|---|---|---|---|"]
    for package in MAY_IMPORT:
        own = [module for module in modules.values() if module.package == package]
        arrows = arrows_in(modules, package)
        counts = Counter(other.partition(".")[0] for module in own for other in module.imports)
        del counts[package]
        others = ", ".join(f"{name} ({n} imports)" for name, n in sorted(counts.items()))
        total = sum(map(len, arrows.values()))
        lines.append(f"| `{package}` | {len(arrows)} | {len(own)} | {total} | {others or '-'} |")
    for package in MAY_IMPORT:
        lines += ["", f"`{package}`, lowest layer first:", "", *_rooms(modules, package)]
    return "\n".join(lines) + "\n"


def _rooms(modules: Mapping[str, Module], package: str) -> list[str]:
    """Write one package's table of rooms."""
    lines = ["| layer | room | files | imports rooms | and of other packages |"]
    lines += ["|---|---|---|---|---|"]
    arrows = arrows_in(modules, package)
    level = layers(arrows)
    for room in sorted(arrows, key=lambda name: (level[name], name)):
        own = [m for m in modules.values() if f"{m.name}.".startswith(f"{room}.")]
        outside = Counter(
            ".".join(other.split(".")[:2])
            for module in own
            for other in module.imports
            if other.partition(".")[0] != package
        )
        inside = ", ".join(sorted(name.split(".")[1] for name in arrows[room]))
        beyond = ", ".join(
            name.removeprefix("cabols_").replace(".", "/") for name in sorted(outside)
        )
        parts = Counter(m.folder.split(".")[2] for m in own if m.folder.count(".") > 1)
        files = ", ".join(f"{name} {count}" for name, count in sorted(parts.items()))
        count = f"{len(own)} ({files})" if files else f"{len(own)}"
        name = f"`{room.split('.')[1]}{'' if room in modules else '/'}`"
        lines.append(f"| {level[room]} | {name} | {count} | {inside or '-'} | {beyond or '-'} |")
    return lines


def with_tables(page: str, text: str) -> str:
    """Put tables between the markers of a page.

    Args:
        page: the page's text.
        text: the tables.

    Raises:
        ValueError: if the page does not hold both markers, once each and in order.
    """
    if page.count(BEGIN) != 1 or page.count(END) != 1 or page.index(BEGIN) > page.index(END):
        raise ValueError(f"expected {BEGIN} and, after it, {END}, once each: put them in the page")
    head, rest = page.split(BEGIN)
    return f"{head}{BEGIN}\n\n{text}\n{END}{rest.split(END)[1]}"


def main() -> int:
    """Run the command line; exit code 1 if a rule is broken."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--write", action="store_true", help=f"put the tables into {PAGE.name}")
    options = parser.parse_args()
    modules = read_tree()
    if options.write:
        PAGE.write_text(with_tables(PAGE.read_text(encoding="utf-8"), tables(modules)))
    else:
        print(tables(modules))
    for line in crowded(modules):
        print(f"note: {line}")
    broken = violations(modules)
    for line in broken:
        print(line)
    print(f"{len(modules)} files, {len(broken)} broken rules")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
