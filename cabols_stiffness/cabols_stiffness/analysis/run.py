# SPDX-License-Identifier: Apache-2.0
"""From a campaign's folder or a bag to result.yaml, report.html, tables and a certificate."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from cabols_control.files.output_folder import OutputFolder, output_folder
from cabols_control.naming import number
from cabols_stiffness.analysis.report import write_report
from cabols_stiffness.analysis.source import Source, is_campaign, read_source
from cabols_stiffness.analysis.study import Study, study
from cabols_stiffness.analysis.tables import summary, write_tables
from cabols_stiffness.campaign.journal import SAMPLES, read_log, read_samples
from cabols_stiffness.certificate.document import Certificate
from cabols_stiffness.certificate.made import certificate_of
from cabols_stiffness.certificate.pages import write_certificate
from cabols_stiffness.certificate.statement import load_statement
from cabols_stiffness.ladder.texts import ladder_mapping
from cabols_stiffness.measurements.measured_load import to_cells
from cabols_stiffness.model.result_file import write_result


def analyse(options: argparse.Namespace) -> None:
    """Analyse what the options name, write everything and say where it is.

    Args:
        options: of the command line, see cabols_stiffness.analysis.analyze.

    Raises:
        CabolsError: for data that cannot be used.
    """
    began, place = time.monotonic(), _output(options)
    with _claimed(place) as folder:
        source = read_source(options.source, options.campaign, options.geometry or None, _say)
        _say(f"{len(source.loads)} loads, {source.rig_s:.0f} s of the rig's time; identifying")
        found = study(source.loads, source.plan, options.model)
        more = provenance(source, found)
        if found.climbed is not None:
            more |= ladder_mapping(found.climbed)
        write_result(place / "result.yaml", found.result, found.robot, more)
        written = write_tables(found, place)
        log = read_log(options.source) if is_campaign(options.source) else []
        write_report(place / "report.html", found, source, log)
        if options.statement:
            written += write_certificate(place, _certificate(found, options.statement, log))
        if folder is not None:
            folder.finish()
    print(summary(found))
    difference = _compare(options.source, source)
    if difference:
        print(difference)
    for path in (place / "result.yaml", place / "report.html", *written):
        print(f"  {path}")
    print(f"analysed in {time.monotonic() - began:.1f} s")


def _certificate(found: Study, statement: str, log: Sequence[dict[str, str]]) -> Certificate:
    skipped = [
        f"load {number(int(row['load_index']))} of configuration "
        f"{number(int(row['configuration_index']))}: {row['reason']}"
        for row in log
        if row["what"] == "skipped"
    ]
    said = load_statement(statement)
    return certificate_of(found.result, found.samples, found.robot, said, skipped)


@contextmanager
def _claimed(place: Path) -> Iterator[OutputFolder | None]:
    """Claim the output folder; a campaign's own folder always accepts its results."""
    if is_campaign(place):
        yield None
        return
    with output_folder(place, "analyze", keep=True, shared=True) as folder:
        yield folder


def provenance(source: Source, found: Study) -> dict[str, object]:
    """Provenance of the numbers in result.yaml.

    Args:
        source: of the data.
        found: from them.
    """
    frames, validation = found.frames, found.point_validation
    return {
        "provenance": {
            "bags_sha256": dict(source.bags),
            "parameters": dict(source.parameters),
            "loads": len(source.loads),
            "failed_measurements": len(source.failures),
            "rig_time_s": round(source.rig_s, 3),
        },
        "tracker": {
            "registered_from_configurations": frames.poses,
            "fit_probability": (
                float(frames.probability) if np.isfinite(frames.probability) else None
            ),
            "position_m": [float(value) for value in frames.position],
            "rotation": [[float(value) for value in row] for row in frames.rotation],
            "reflectors_m": [[float(value) for value in row] for row in frames.reflectors],
        },
        "validation": None
        if validation is None
        else {
            "explained": validation.explained,
            "normalised_rms": validation.normalised_rms,
            "error_rms_m": [float(value) for value in validation.error_rms],
        },
        "model_by_held_out_loads": None if found.choice is None else found.choice.model,
    }


def _compare(place: Path, source: Source) -> str:
    """Print whether the bags hold exactly the loads that the campaign saved."""
    if not is_campaign(place) or not (place / SAMPLES).exists():
        return ""
    online = {(load.group, load.load): to_cells(load) for load in read_samples(place)}
    offline = {(load.group, load.load): to_cells(load) for load in source.loads}
    if online.keys() != offline.keys():
        return (
            f"{SAMPLES} has {len(online)} loads, the bags {len(offline)}: a run was cut between "
            "bag and table; the campaign mends that when it goes on"
        )
    worst = max(
        float(np.max(np.abs(np.array(online[key], float) - np.array(offline[key], float))))
        for key in online
    )
    return f"largest difference between {SAMPLES} and the bags: {worst:.3g}"


def _output(options: argparse.Namespace) -> Path:
    if options.output is not None:
        return Path(options.output)
    place = Path(options.source)
    return place if is_campaign(place) else place.with_name(place.name + "_analysis")


def _say(text: str) -> None:
    print(f"  {text}", flush=True)
