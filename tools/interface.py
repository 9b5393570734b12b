# SPDX-License-Identifier: Apache-2.0
"""Write docs/interface.md and the picture of the graph in docs/architecture.md, from the code.

Usage: interface.py            print what would be written
       interface.py --write    write it (`make interface`)

Topics, nodes and launch arguments come from the tables that the nodes themselves use; services,
actions and parameters from the calls in the nodes' sources; messages from their definition files.
Needs the environment of `make setup`.
"""

from __future__ import annotations

import argparse
import ast
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from structure import ROOT

PAGE = ROOT / "docs" / "interface.md"
ARCHITECTURE = ROOT / "docs" / "architecture.md"
GRAPH_BEGIN, GRAPH_END = "<!-- graph: begin -->", "<!-- graph: end -->"
NODE_FOLDERS = ("nodes", "ros")
CLIENT_CALLS = {"create_client", "ActionClient"}
LIVE = """\
Fast topics are repeated every 45 ms on `live/<topic>` for those who only watch. `plant` publishes
`true_limb_state` and `true_wrench` with its parameter `truth`.
"""
RIG_FILES = """\
A rig is a folder with these files; the bench's is `cabols_control/cabols_control/rigs/bench`."""
CAPTION = """\
The simulated bench with everything. Left out: `mode`, from the supervisor to every node that acts;
`loop_status`, from every node to supervisor and console; the recorder, which takes all topics. On a
rig `q8_ati_bridge` stands in the plant's place, and the devices in that of `device_simulator`."""
FOREIGN_SERVICES = {"Trigger": "std_srvs", "SetBool": "std_srvs"}
EVERYBODYS = ("mode", "loop_status")
"""Topics that nearly every node reads or writes; left out of the picture."""
SHARED = {
    "bridge_node": "`plant`, `q8_ati_bridge`",
    "node": "every node with a control loop",
    "parameters": "every node with a control loop",
    "commission_server": "`limb_controller`",
    "diagnostics": "every node",
    "report_service": "`stiffness_identifier`",
}
"""Who has the parameters and services of a module that is no node itself."""
HEAD = """\
# Interface

Written by `make interface` from the tables in the code and the definition files; do not edit.
Everything is in the namespace `/cabols`. SI units; limbs, reflectors and configurations count from
0 in messages and on the command line of ROS, from 1 wherever people read.
"""


@dataclass(frozen=True)
class Served:
    """One service or action.

    Attributes:
        name: relative to the namespace.
        kind: "service" or "action".
        type: package and type.
        where: who serves it.
    """

    name: str
    kind: str
    type: str
    where: str


@dataclass(frozen=True)
class Parameter:
    """One ROS parameter as a node declares it; texts as in the source.

    Attributes:
        where: who has it.
        name: its name.
        default: expression of the default.
        description: one line.
        bounds: expression of the bounds; empty without.
    """

    where: str
    name: str
    default: str
    description: str
    bounds: str


def sources(root: Path) -> Iterator[Path]:
    """Yield the files in which nodes declare and serve."""
    for package in sorted(root.glob("cabols_*")):
        for folder in NODE_FOLDERS:
            yield from sorted((package / package.name / folder).rglob("*.py"))


def definitions(root: Path) -> dict[str, list[Path]]:
    """Return the definition files by kind: msg, srv, action."""
    return {k: sorted((root / "cabols_msgs" / k).glob(f"*.{k}")) for k in ("msg", "srv", "action")}


def served(root: Path) -> list[Served]:
    """Find the services and actions that the nodes' sources serve."""
    types = {path.stem: ("action", "cabols_msgs") for path in definitions(root)["action"]}
    types |= {path.stem: ("service", "cabols_msgs") for path in definitions(root)["srv"]}
    types |= {name: ("service", package) for name, package in FOREIGN_SERVICES.items()}
    found = set()
    for path in sources(root):
        tree = ast.parse(path.read_text(encoding="utf-8"), str(path))
        for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
            if _called(call) in CLIENT_CALLS:
                continue
            for first, second in zip(call.args, call.args[1:], strict=False):
                if isinstance(first, ast.Name) and first.id in types:
                    kind, package = types[first.id]
                    found |= {
                        Served(name, kind, f"{package}/{first.id}", _where(path))
                        for name in _texts(second, tree)
                    }
    return sorted(found, key=lambda item: (item.kind, item.name))


def parameters(root: Path) -> list[Parameter]:
    """Find the parameters that the nodes' sources declare; those of the tables are read there."""
    from cabols_control.bringup.graph import all_arguments

    rows = {argument.name: argument for argument in all_arguments()}
    found: list[Parameter] = []
    for path in sources(root):
        tree = ast.parse(path.read_text(encoding="utf-8"), str(path))
        for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
            if _called(call) == "declare_row" and isinstance(call.args[1], ast.Call):
                row = rows[ast.literal_eval(call.args[1].args[0])]
                name, limits = row.parameter or row.name, repr(row.bounds) if row.bounds else ""
                unit = f" [{row.unit}]" if row.unit else ""
                text = f"{row.description}{unit}"
                found.append(Parameter(_where(path), name, repr(row.default), text, limits))
            if _called(call) == "declare" and len(call.args) >= 4:
                bounds = call.args[4] if len(call.args) > 4 else None
                found += [
                    Parameter(
                        _where(path),
                        name,
                        ast.unparse(call.args[2]),
                        _prose(call.args[3]),
                        ast.unparse(bounds) if bounds else "",
                    )
                    for name in _texts(call.args[1], tree)
                ]
    return sorted(set(found), key=lambda item: (item.where, item.name))


def _called(call: ast.Call) -> str:
    """Return the last name of what is called."""
    return call.func.attr if isinstance(call.func, ast.Attribute) else ast.unparse(call.func)


def _where(path: Path) -> str:
    """Return who has what a file declares."""
    return SHARED.get(path.stem, f"`{path.stem}`")


def _texts(argument: ast.expr, tree: ast.Module) -> list[str]:
    """Return the texts that an argument may be: itself, or what a loop's literal gives a name."""
    if isinstance(argument, ast.Constant):
        return [argument.value] if isinstance(argument.value, str) else []
    if not isinstance(argument, ast.Name):
        return []
    loops = [node for node in ast.walk(tree) if isinstance(node, ast.For)]
    return [text for loop in loops for text in _looped(loop, argument.id)]


def _looped(loop: ast.For, name: str) -> list[str]:
    """Return the texts that a loop over a literal gives a name."""
    targets = loop.target.elts if isinstance(loop.target, ast.Tuple) else [loop.target]
    at = [i for i, target in enumerate(targets) if isinstance(target, ast.Name)
          and target.id == name]  # fmt: skip
    if not at or not isinstance(loop.iter, ast.Tuple | ast.List):
        return []
    rows = [row.elts if isinstance(row, ast.Tuple) else [row] for row in loop.iter.elts]
    cells = [row[at[0]] for row in rows]
    return [c.value for c in cells if isinstance(c, ast.Constant) and isinstance(c.value, str)]


def _prose(argument: ast.expr) -> str:
    """Return a description as it reads, or the expression that it is made of."""
    if isinstance(argument, ast.Constant):
        return str(argument.value)
    if isinstance(argument, ast.JoinedStr):
        return "".join(
            str(part.value) if isinstance(part, ast.Constant) else "..." for part in argument.values
        )
    return ast.unparse(argument)


def row(*cells: object) -> str:
    """Write one row of a Markdown table."""
    return "| " + " | ".join(str(cell).replace("|", "\\|") or "-" for cell in cells) + " |"


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    """Write a Markdown table."""
    return [row(*head), "|" + "---|" * len(head), *(row(*cells) for cells in rows)]


def graph_nodes() -> list[Any]:
    """Return the nodes of the bench with everything: robot, campaign, console, recorder."""
    from cabols_sim.bringup_nodes import bench_graph

    return bench_graph(campaign=True, console=True)


def topic_rows() -> Iterator[tuple[str, ...]]:
    """Yield the topics: name, type, quality of service, writers, readers, recorded, what."""
    from cabols_control.topics import TOPICS

    writers, readers = defaultdict(set), defaultdict(set)
    for node in graph_nodes():
        for topic in node.writes:
            writers[topic].add(f"`{node.executable}`")
        for topic in node.reads:
            readers[topic].add(f"`{node.executable}`")
    for name, topic in TOPICS.items():
        yield (
            f"`{name}`",
            topic.type_name.replace("/msg/", "/"),
            topic.quality.value,
            ", ".join(sorted(writers[name])),
            ", ".join(sorted(readers[name] - {"`recorder`"})),
            "yes" if topic.recorded else "no",
            topic.description,
        )


def other_topics(root: Path) -> list[tuple[str, str, str]]:
    """Find the topics that sources publish and the table of topics does not name."""
    from cabols_control.ros.messages import topics

    found = set()
    for path in sources(root):
        tree = ast.parse(path.read_text(encoding="utf-8"), str(path))
        for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
            if _called(call) == "create_publisher" and len(call.args) >= 2:
                for name in set(_texts(call.args[1], tree)) - set(topics.TYPES):
                    found.add((f"`{name}`", ast.unparse(call.args[0]), _where(path)))
    return sorted(found)


def argument_rows() -> Iterator[tuple[object, ...]]:
    """Yield the arguments of the launch files."""
    from cabols_control.bringup import graph

    for item in graph.all_arguments():
        yield (
            f"`{item.name}`",
            f"`{item.default!r}`",
            item.text,
            ", ".join(item.kinds),
            ", ".join(f"`{n.executable}`" for n in graph.all_nodes() if item.name in n.takes)
            or "the graph itself",
        )


def rig_file_rows() -> Iterator[tuple[str, ...]]:
    """Yield the files of a rig's folder."""
    from cabols_control.rig_folder import FILES

    for item in FILES:
        yield f"`{item.name}`", item.holds, f"`{item.package}`", item.without or "refused"


def picture() -> str:
    """Draw the graph as a Mermaid flowchart: who sends what to whom."""
    nodes = [node for node in graph_nodes() if node.executable != "recorder"]
    arrows: dict[tuple[str, str], list[str]] = defaultdict(list)
    for writer in nodes:
        for topic in writer.writes:
            for reader in nodes:
                if topic in reader.reads and topic not in EVERYBODYS and reader is not writer:
                    arrows[writer.executable, reader.executable].append(topic)
    lines = ["```mermaid", "flowchart LR"]
    lines += [f"  {node.executable}[{node.executable}]" for node in nodes]
    lines += [f"  {a} -->|{', '.join(topics)}| {b}" for (a, b), topics in arrows.items()]
    lines += ["  device_simulator <-.->|EGM, RWS, gRPC| abb_tracker_bridge"]
    lines += ["  plant <-.->|UDP: wrench, pose| device_simulator", "```", "", CAPTION]
    return "\n".join(lines)


def page() -> str:
    """Write docs/interface.md."""
    lines = [HEAD, "## Topics", ""]
    lines += table(("topic", "type", "quality", "from", "to", "recorded", "what"), topic_rows())
    lines += ["", LIVE, "Beside these, from single nodes:", ""]
    lines += table(("topic", "type", "from"), other_topics(ROOT))
    lines += [""]
    for kind in ("service", "action"):
        lines += [f"## {kind.capitalize()}s", ""]
        rows = [item for item in served(ROOT) if item.kind == kind]
        lines += table(
            (kind, "type", "served by"), ((f"`{r.name}`", r.type, r.where) for r in rows)
        )
        lines += [""]
    lines += [
        "## Launch arguments",
        "",
        "Of `bench.launch.py` (bench) and `rig.launch.py` (rig).",
        "",
    ]
    lines += table(("argument", "default", "meaning", "of", "nodes that get it"), argument_rows())
    lines += [
        "",
        "## Parameters of the nodes",
        "",
        "As each node declares them; all are read-only.",
        "",
    ]
    lines += table(
        ("node", "parameter", "default", "meaning", "bounds"),
        (
            (
                p.where,
                f"`{p.name}`",
                f"`{p.default}`",
                p.description,
                f"`{p.bounds}`" * bool(p.bounds),
            )
            for p in parameters(ROOT)
        ),
    )
    lines += ["", "## Files of a rig", "", RIG_FILES, ""]
    lines += table(("file", "what it says", "read by", "if it is missing"), rig_file_rows())
    for kind, title in (
        ("msg", "Messages"),
        ("srv", "Services' types"),
        ("action", "Actions' types"),
    ):
        lines += ["", f"## {title}", "", f"In `cabols_msgs/{kind}`."]
        for path in definitions(ROOT)[kind]:
            lines += [
                "",
                f"### {path.stem}",
                "",
                "```",
                path.read_text(encoding="utf-8").strip(),
                "```",
            ]
    return "\n".join(lines) + "\n"


def with_picture(text: str) -> str:
    """Put the picture between its markers in a page.

    Args:
        text: the page.

    Raises:
        ValueError: if the page does not hold both markers once.
    """
    if text.count(GRAPH_BEGIN) != 1 or text.count(GRAPH_END) != 1:
        raise ValueError(f"expected {GRAPH_BEGIN} and {GRAPH_END}, once each: put them in the page")
    head, rest = text.split(GRAPH_BEGIN)
    return f"{head}{GRAPH_BEGIN}\n\n{picture()}\n\n{GRAPH_END}{rest.split(GRAPH_END)[1]}"


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Write docs/interface.md and the graph's picture.")
    parser.add_argument("--write", action="store_true", help="write instead of printing")
    if parser.parse_args().write:
        PAGE.write_text(page(), encoding="utf-8")
        ARCHITECTURE.write_text(with_picture(ARCHITECTURE.read_text(encoding="utf-8")))
    else:
        print(page(), picture(), sep="\n")


if __name__ == "__main__":
    main()
