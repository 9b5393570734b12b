# SPDX-License-Identifier: Apache-2.0
"""Report of any bag: pictures of the topics that it has, the run's judgement where there is one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from cabols_control.bags.errors import BagError
from cabols_control.bags.information import BagInformation, bag_information
from cabols_control.bags.reader import Bag, read_bag
from cabols_control.errors import UsageError
from cabols_control.report_page import embedded_picture, render_page
from cabols_control.rig import Rig, load_rig
from cabols_control.run_report.judgement.figures_of_merit import checks, summarise
from cabols_control.run_report.pictures.bag_parts import PARTS, TOPICS, table
from cabols_control.run_report.pictures.run_figures import DPI
from cabols_control.run_report.run import RunError, join_run

GENERATOR = '<meta name="generator" content="cabols report">'
STATES = ("waiting", "running", "FAULT")
RIG_FILES = ("geometry", "limbs", "control")


@dataclass(frozen=True)
class ReportWritten:
    """What became of a bag's report.

    Attributes:
        path: of the HTML file.
        shown: titles of the parts that it has.
        missing: what the bag lacks, as sentences.
        judged: whether it has the table of a run that reached LOADING.
    """

    path: Path
    shown: list[str]
    missing: list[str]
    judged: bool


def report_bag(
    folder: Path, output: Path, say: Callable[[str], object] = lambda _: None
) -> ReportWritten:
    """Write the report of a bag.

    Args:
        folder: of the bag.
        output: HTML file; an existing one must be such a report.
        say: gets a line for each slow step.

    Raises:
        BagError: if the bag cannot be read, or has none of the topics.
        UsageError: if there is another file.
    """
    _check_output(output)
    information = bag_information(folder)
    there = [topic for topic in TOPICS if information.counts.get(topic)]
    if not there:
        raise BagError(
            f"{folder}: expected some of the topics {', '.join(TOPICS)}, got "
            f"{', '.join(information.present()) or 'an empty bag'}; `export` writes any topics"
        )
    total = sum(information.counts[topic] for topic in there)
    say(f"reading {total} messages of {len(there)} topics")
    bag = read_bag(folder, there)
    rig, source = recorded_rig(information)
    missing = [
        f"{part.title}: no messages of {part.topic}" for part in PARTS if part.topic not in bag
    ]
    parts = []
    for part in PARTS:
        if part.topic not in bag:
            continue
        say(f"drawing: {part.title}")
        picture = embedded_picture(part.draw(bag, rig), DPI)
        parts.append({"title": part.title, "picture": picture})
    judgement, why = _judgement(bag, rig)
    missing += [why] if why else []
    duration = max(float(np.ptp(s.log_time_ns)) for s in bag.topics.values()) * 1e-9
    text = render_page(
        "cabols_control",
        "bag_report.html.j2",
        title=f"Recording {folder.resolve().name}",
        subtitle=f"{duration:.1f} s, {total} messages; limits from {source}",
        head=GENERATOR,
        missing=missing,
        checks=judgement,
        parts=parts,
        nodes=_nodes(bag),
        measurements=_measurements(bag),
        provenance=information.metadata,
        counts=information.counts,
    )
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_text(text, encoding="utf-8")
    return ReportWritten(output, [p["title"] for p in parts], missing, bool(judgement))


def _check_output(output: Path) -> None:
    if not output.exists():
        return
    if output.is_dir() or GENERATOR not in output.read_text("utf-8", errors="replace")[:2000]:
        raise UsageError(
            f"{output}: expected a new file, or a report of this command, got something else; "
            "nothing was touched: name another --output"
        )


def recorded_rig(information: BagInformation) -> tuple[Rig, str]:
    """Return the rig that a bag carries, or the reference bench, and which it is."""
    metadata = information.metadata
    texts = {name: metadata.get(f"{name}_yaml") for name in RIG_FILES}
    if not all(texts.values()):
        return load_rig(), "the reference bench, as the bag carries no rig"
    with TemporaryDirectory() as place:
        paths = {name: Path(place) / f"{name}.yaml" for name in RIG_FILES}
        for name, path in paths.items():
            path.write_text(str(texts[name]), encoding="utf-8")
        rig = load_rig(**paths)
    if method := metadata.get("tension_method"):
        rig = replace(rig, control=replace(rig.control, tension_method=method))
    return rig, "the rig's files in the bag"


def _judgement(bag: Bag, rig: Rig) -> tuple[list[Any], str]:
    """Return the table of a run that reached LOADING, or why there is none."""
    try:
        return checks(summarise(join_run(bag), rig)), ""
    except (RunError, BagError) as error:
        return [], f"Judgement of a loaded run: {error}"


def _nodes(bag: Bag) -> list[dict[str, Any]]:
    """Return the last report of each node, and its faults."""
    if "loop_status" not in bag:
        return []
    series = bag["loop_status"]
    names, states = np.array(series["node"]), np.asarray(series["state"])
    found = []
    for name in dict.fromkeys(names.tolist()):
        rows = np.flatnonzero(names == name)
        faults = [series["reason"][k] for k in rows if states[k] == len(STATES) - 1]
        found.append(
            {
                "node": name,
                "state": STATES[min(int(states[rows[-1]]), len(STATES) - 1)],
                **{n: int(series[n][rows[-1]]) for n in ("cycles", "lost", "late", "infeasible")},
                "faults": "; ".join(dict.fromkeys(faults)),
            }
        )
    return found


def _measurements(bag: Bag) -> str:
    if "reflector_measurement" not in bag:
        return ""
    series = bag["reflector_measurement"]
    good = np.asarray(series["success"], bool)
    if not good.any():
        return f"{len(series)} measurements of reflectors, none succeeded."
    rms = table(series, "rms")[good, 0]
    return (
        f"{len(series)} measurements of reflectors, {int(good.sum())} succeeded; scatter "
        f"{1e6 * float(np.median(rms)):.0f} um (median)."
    )
