"""Executable cabols-stiffness: joint stiffness from a table of loads and deflections, and its use.

`cabols-stiffness identify loads.csv --robot robot.urdf --tip tool0` needs neither a rig nor ROS.
The table (CSV or Parquet) has a line of headers, each with its unit, or the units in a line below:
q1_deg to qN_deg (prismatic joints in mm or m), fx_N to mz_Nm, and what was measured: dx_mm, dy_mm,
dz_mm (and rx_mrad, ...) against the unloaded robot, or positions px_mm, ..., or distance_mm to an
anchor; config, load, group, branch, reflector where there are such. Empty cells were not measured.
The verdict comes before the numbers.

`cabols-stiffness correct PROGRAM` and `cabols-stiffness export RESULT` use what was identified: a
program's points corrected, springs for a simulator; each has a --help of its own.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cabols_control.command_line import DONE, FAILED, CommandParser, command
from cabols_control.configuration import read_yaml
from cabols_control.errors import UsageError
from cabols_control.files.output_folder import output_folder
from cabols_stiffness.certificate.made import certificate_of
from cabols_stiffness.certificate.pages import write_certificate
from cabols_stiffness.certificate.statement import Statement, load_statement
from cabols_stiffness.data_files.command_words import joint_position
from cabols_stiffness.export import command as export_command
from cabols_stiffness.identification.identify import identify
from cabols_stiffness.ladder.identified import identify_ladder, model_word
from cabols_stiffness.ladder.texts import ladder_mapping, ladder_text
from cabols_stiffness.model.elastic.blocks import Rung
from cabols_stiffness.model.result import AS_PUBLISHED, LINEAR, MODELS, StiffnessResult
from cabols_stiffness.model.result_file import write_result
from cabols_stiffness.model.robot import RobotModel, load_robot
from cabols_stiffness.model.verdict import Grade
from cabols_stiffness.model.verdict_text import verdict_lines
from cabols_stiffness.table import program
from cabols_stiffness.table.laboratory import Stated, to_samples
from cabols_stiffness.table.reading import Table, read_table

TASKS = {"correct": program.main, "export": export_command.main}
"""Besides identify, each with options of its own."""


@command
def main(words: Sequence[str] | None = None) -> int:
    """Do a task; 0, 1 if the data contradict the model, 2 for a wrong command line or table."""
    given = list(sys.argv[1:] if words is None else words)
    if given and given[0] in TASKS:
        return TASKS[given[0]](given[1:])
    return _identify(given)


def _identify(words: Sequence[str]) -> int:
    options = _arguments(words)
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
    locked = dict(joint_position(word) for word in options.lock)
    robot = load_robot(options.robot or None, options.tip, options.tool, locked=locked)
    mapping = read_yaml(options.mapping) if options.mapping else None
    table = read_table(options.table, robot.n, mapping)
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
    print(summary(result, robot, table))
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


def summary(result: StiffnessResult, robot: RobotModel, table: Table) -> str:
    """Verdict, then numbers; no numbers where the data contradict the model.

    Args:
        result: judged.
        robot: that it is of.
        table: that it is from.
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
    return "\n".join(lines)


def _write_csv(path: Path, result: StiffnessResult, robot: RobotModel) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        rows = csv.writer(stream)
        rows.writerow(["joint", "unit", "stiffness", "deviation", "low_95", "high_95"])
        for j, name in enumerate(robot.joint_names):
            unit = "N/m" if robot.slides[j] else "N m/rad"
            numbers = (result.stiffness[j], result.standard_deviation[j], *result.interval[j])
            rows.writerow([name, unit, *(f"{float(value):.8g}" for value in numbers)])


def _arguments(words: Sequence[str]) -> argparse.Namespace:
    parser = CommandParser("cabols-stiffness", __doc__)
    add = parser.add_argument
    add("task", choices=["identify", *TASKS], help="what to do")
    add("table", type=Path, metavar="TABLE", help="CSV or Parquet file")
    add("--robot", default="", help="URDF, or YAML or CSV of DH parameters; default: IRB 1600")
    add("--tip", default="", help="link that carries the tool; default: tool0 or flange")
    add("--lock", action="append", default=[], metavar="JOINT=POSITION", help="hold a joint there")
    vector: dict[str, Any] = {"nargs": 3, "type": float, "metavar": ("X", "Y", "Z")}
    add("--tool", default=(0.0, 0.0, 0.0), **vector, help="tool's origin, axes of the tip [m]")
    add("--reflector", default=(0.0, 0.0, 0.0), **vector, help="measured point, tool axes [m]")
    add("--anchor", default=None, **vector, help="other end of a distance, base axes [m]")
    axes = ["base", "tool"]
    add("--wrench-axes", default="base", choices=axes, help="axes of the wrench, at the tool")
    add("--mapping", default="", help="YAML: header: {as: name, unit: unit}")
    add(
        "--model",
        default=LINEAR,
        type=model_word,
        help="linear; cubic; auto: the ladder of models, by held-out configurations; or its rungs: "
        + "+".join(Rung),
    )
    add("--deviation-um", type=float, default=20.0, help="of a displacement [um]")
    add("--deviation-urad", type=float, default=80.0, help="of a rotation [urad]")
    add("--deviation-n", type=float, default=0.5, help="of a force [N]")
    add("--deviation-nm", type=float, default=0.05, help="of a torque [N m]")
    add("--statement", default="", help="YAML of a certificate: operator, instruments, type B")
    add("--output", type=Path, help="folder to fill; default: the table's name")
    return parser.parse_args(words)


if __name__ == "__main__":
    sys.exit(main())
