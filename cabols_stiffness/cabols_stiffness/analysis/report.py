# SPDX-License-Identifier: Apache-2.0
"""report.html: one file that needs nothing else, no network either."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import yaml

from cabols_control.naming import number
from cabols_control.report_page import embed, render_page
from cabols_stiffness.analysis.plots import joint_plots, load_plots, validation_plots
from cabols_stiffness.analysis.source import Source
from cabols_stiffness.analysis.study import Study
from cabols_stiffness.analysis.tables import stiffness_table, summary
from cabols_stiffness.ladder.texts import HEADER, ladder_rows
from cabols_stiffness.measurements.measured_load import INDICES
from cabols_stiffness.model.compliance import compliance_table
from cabols_stiffness.model.verdict_text import verdict_rows

RATED_N = 60.0
"""Weight of the rated load of an IRB 1600-6, about."""


def write_report(
    path: str | Path, study: Study, source: Source, log: Sequence[dict[str, str]] = ()
) -> Path:
    """Write the report of an analysis.

    Args:
        path: of the HTML file.
        study: what was found.
        source: where it is from.
        log: what was tried again or skipped; rows of log.csv.

    Returns:
        The path.
    """
    joints, loads = joint_plots(study), load_plots(study)
    checked = [] if study.pose_validation is None else validation_plots(study.pose_validation)
    script, divs = embed([*joints, *checked, *loads])
    header, rows = stiffness_table(study)
    failures = [
        dict(zip(INDICES, map(str, at), strict=True), what="failed", reason=reason)
        for *at, reason in source.failures
    ]
    where = f"{len(study.loads)} loads at {len(study.by_configuration)} configurations"
    text = render_page(
        "cabols_stiffness",
        "stiffness.html.j2",
        title="Joint stiffness",
        subtitle=f"{study.robot.name}: {where}, {len(study.plan.reflectors)} reflectors; "
        f"{source.rig_s:.0f} s of the rig's time",
        script=script,
        summary=summary(study),
        verdict=study.result.verdict,
        verdict_rows=_verdict_rows(study),
        ladder=[] if study.climbed is None else ladder_rows(study.climbed),
        ladder_header=HEADER,
        table={"header": header, "rows": rows},
        joint_plots=divs[: len(joints)],
        validation_plots=divs[len(joints) : len(joints) + len(checked)],
        load_plots=divs[len(joints) + len(checked) :],
        rated=RATED_N,
        compliance=compliance_table(study.result, study.robot, study.samples.joints[0], RATED_N),
        log=[_for_people(row) for row in list(log) or failures],
        provenance={**source.parameters, **_hashes(source)},
        campaign=yaml.safe_dump(asdict(study.plan), sort_keys=False, default_flow_style=None),
    )
    target = Path(path)
    target.write_text(text, encoding="utf-8")
    return target


def _verdict_rows(study: Study) -> list[tuple[str, str]]:
    verdict = study.result.verdict
    return [] if verdict is None else verdict_rows(verdict, study.robot.joint_names)


def _hashes(source: Source) -> dict[str, str]:
    return {f"SHA-256 of {path}": digest for path, digest in source.bags.items()}


def _for_people(row: dict[str, str]) -> dict[str, str]:
    """A row of log.csv with its indices as the numbers that people read."""
    place = {name.removesuffix("_index"): str(number(int(row[name]))) for name in INDICES}
    return {"what": row["what"], "reason": row["reason"], **place}
