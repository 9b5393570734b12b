# SPDX-License-Identifier: Apache-2.0
"""Identification from a laboratory's table: verdict, numbers, files."""

from __future__ import annotations

import argparse
import csv
from dataclasses import replace
from pathlib import Path

from cabols_control.command_line import DONE, FAILED
from cabols_control.configuration import read_yaml
from cabols_control.errors import UsageError
from cabols_control.files.output_folder import output_folder
from cabols_stiffness.certificate.made import certificate_of
from cabols_stiffness.certificate.pages import write_certificate
from cabols_stiffness.certificate.statement import Statement, load_statement
from cabols_stiffness.errors import TableError
from cabols_stiffness.identification.identify import identify
from cabols_stiffness.ladder.identified import identify_ladder
from cabols_stiffness.ladder.texts import ladder_mapping, ladder_text
from cabols_stiffness.model.model_words import AS_PUBLISHED, LINEAR, MODELS
from cabols_stiffness.model.result import StiffnessResult
from cabols_stiffness.model.result_file import write_result
from cabols_stiffness.model.robot import RobotModel
from cabols_stiffness.model.verdict import Grade
from cabols_stiffness.model.verdict_text import verdict_lines
from cabols_stiffness.table.laboratory import Stated, not_used, to_samples
from cabols_stiffness.table.reading import Table, read_table
from cabols_stiffness.table.robot_options import require_file, robot_of


def run(options: argparse.Namespace) -> int:
    """Identify; 0, 1 if the data contradict the model.

    Args:
        options: of the command line.
    """
    stated = Stated(
        position_m=1e-6 * options.deviation_um,
        rotation_rad=1e-6 * options.deviation_urad,
        force_n=options.deviation_n,
        torque_nm=options.deviation_nm,
        follows=options.wrench_axes == "tool",
        reflector=tuple(options.reflector),
        anchor=None if options.anchor is None else tuple(options.anchor),
    )
    if options.model == AS_PUBLISHED:
        raise UsageError(f"--model {AS_PUBLISHED}: expected another one; it is for comparison only")
    require_file(options.table)
    robot = robot_of(options, options.tool)
    mapping = read_yaml(options.mapping) if options.mapping else None
    table = read_table(options.table, robot.n, mapping)
    table = replace(table, joints=robot.drives(table.joints))
    output = options.output or Path(options.table).with_suffix("")
    statement = load_statement(options.statement) if options.statement else None
    return identify_table(table, robot, stated, options.model, output, statement)


def identify_table(
    table: Table,
    robot: RobotModel,
    stated: Stated,
    model: str,
    output: Path,
    statement: Statement | None = None,
) -> int:
    """Identify from a table, print, and fill a folder; return the exit code.

    Args:
        table: of a laboratory.
        robot: with its tool.
        stated: noise, axes, measured point.
        model: linear, cubic, auto, or rungs of the ladder joined by +.
        output: folder to fill.
        statement: what a certificate needs; None: none is written.
    """
    if not table.wrench.any():
        raise TableError(
            "table: expected a wrench in some rows, got zeros in all; are its columns those of the "
            "loads?"
        )
    plain = model if model in MODELS else LINEAR
    result = identify(to_samples(table, robot, stated), robot, plain, judged=False)
    samples = to_samples(table, robot, stated, result)
    climbed = None
    if model in MODELS:
        result = identify(samples, robot, model, start=result)
    else:
        climbed = identify_ladder(samples, robot, model)
        result = climbed.result
    verdict = result.verdict
    assert verdict is not None
    print(summary(result, robot, table, not_used(table, stated)))
    more = {}
    if climbed is not None:
        print(ladder_text(climbed, robot))
        more = ladder_mapping(climbed)
    with output_folder(output, "cabols-stiffness", keep=True, shared=True) as folder:
        write_result(output / "result.yaml", result, robot, more)
        _write_csv(output / "stiffness.csv", result, robot)
        written = [output / "result.yaml", output / "stiffness.csv"]
        if statement is not None and verdict.grade is not Grade.HOPELESS:
            skipped = [f"line {line}: no joints or no wrench" for line in table.skipped]
            certificate = certificate_of(result, samples, robot, statement, skipped)
            written += write_certificate(output, certificate)
        folder.finish()
    for path in written:
        print(f"  {path}")
    return FAILED if verdict.grade is Grade.HOPELESS else DONE


def summary(
    result: StiffnessResult, robot: RobotModel, table: Table, unused: tuple[str, ...] = ()
) -> str:
    """Verdict, then numbers; no numbers where the data contradict the model.

    Args:
        result: judged.
        robot: that it is of.
        table: that it is from.
        unused: known columns of which nothing was taken.
    """
    verdict = result.verdict
    assert verdict is not None
    lines = verdict_lines(verdict)
    left = len(table.skipped) + verdict.missing
    repeated = len(table.repeated) + verdict.repeated
    if left or repeated or result.outliers.size:
        lines.append(
            f"  left out: {left} rows without numbers, {repeated} repeated, "
            f"{result.outliers.size} outliers"
        )
    if table.unread:
        lines.append(f"  columns not read: {', '.join(table.unread)}")
    if unused:
        lines.append(
            f"  columns read but not used beside the others: {', '.join(unused)} (rotations count "
            "beside dx, dy, dz of the tool's origin)"
        )
    if verdict.grade is Grade.HOPELESS:
        return "\n".join([*lines, "no stiffness: correct the data first"])
    lines.append("joint              stiffness     deviation    95 % interval")
    for j, name in enumerate(robot.joint_names):
        unit = "N/m" if robot.slides[j] else "N m/rad"
        if not result.identifiable[j]:
            lines.append(f"{name:16s} not identifiable from these loads")
            continue
        low, high = result.interval[j]
        relative = 100.0 * result.standard_deviation[j] / result.stiffness[j]
        lines.append(
            f"{name:16s} {result.stiffness[j]:11.5g} {unit:8s} {relative:6.2f} %    "
            f"{low:.5g} to {high:.5g}"
        )
    lines.append(
        "not in the deviations: what is wrong alike in all loads, as the gain of the whole sensor "
        "(1 % of it is 1 % of every stiffness); --statement budgets it"
    )
    return "\n".join(lines)


def _write_csv(path: Path, result: StiffnessResult, robot: RobotModel) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        rows = csv.writer(stream)
        rows.writerow(["joint", "unit", "stiffness", "deviation", "low_95", "high_95"])
        for j, name in enumerate(robot.joint_names):
            unit = "N/m" if robot.slides[j] else "N m/rad"
            numbers = (result.stiffness[j], result.standard_deviation[j], *result.interval[j])
            rows.writerow([name, unit, *(f"{float(value):.8g}" for value in numbers)])
