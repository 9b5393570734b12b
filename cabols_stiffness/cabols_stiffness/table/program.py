# SPDX-License-Identifier: Apache-2.0
"""cabols-stiffness correct: a program's points with commands under which the loaded robot is there.

`cabols-stiffness correct program.csv --result result.yaml --robot robot.urdf` reads one point a
line: q1_deg to qN_deg, and the wrench there (fx_N to mz_Nm) or the same one for all (--wrench). The
output has the same columns, the joints changed, and beside them by how much the robot would give
way (moved_x_mm ...) and by how much the commanded pose differs (shift_x_mm ..., base axes): added
to points that are programmed as poses, it corrects them. One point that cannot be corrected, far
from the data or loaded beyond them, and nothing is written. Measured: a result of another robot, or
one whose model does not explain its data, is refused.
"""

from __future__ import annotations

import argparse
import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.command_line import DONE
from cabols_control.configuration import read_yaml
from cabols_control.errors import CabolsError, UsageError
from cabols_control.files.plain_numbers import plain_number
from cabols_stiffness.data_files.cells import Cells, read_cells
from cabols_stiffness.errors import TableError
from cabols_stiffness.model.compensation import correct
from cabols_stiffness.model.identity import require_usable
from cabols_stiffness.model.result import StiffnessResult
from cabols_stiffness.model.result_file import read_result, tool_of
from cabols_stiffness.model.robot import RobotModel
from cabols_stiffness.model.screws import logarithm
from cabols_stiffness.table.robot_options import require_file, robot_of
from cabols_stiffness.table.units import JOINT, is_known, meaning

WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
MORE = (
    *(f"moved_{axis}_mm" for axis in "xyz"),
    *(f"shift_{axis}_mm" for axis in "xyz"),
    *(f"shift_r{axis}_mrad" for axis in "xyz"),
)


@dataclass(frozen=True, eq=False)
class Program:
    """Points of a program.

    Attributes:
        cells: as they are in the file.
        joint: column and factor to SI of each joint.
        joints: (k, n) [rad, m].
        wrench: (k, 6) [N, N m].
    """

    cells: Cells
    joint: list[tuple[int, float]]
    joints: FloatArray
    wrench: FloatArray


def read_program(path: str | Path, n: int, wrench: Sequence[float] | None) -> Program:
    """Read a program's points.

    Args:
        path: CSV or Parquet.
        n: joints of the robot.
        wrench: (6,) of all points; None: the table has it.

    Raises:
        TableError: naming line and column, what was expected and what came.
    """
    cells = read_cells(path, is_known)
    found: dict[str, tuple[int, float]] = {}
    for index, header in enumerate(cells.headers):
        try:
            said = meaning(header, cells.units[index])
        except TableError:
            if _matters(header):
                raise
            continue
        if said is None or not (JOINT.match(said.role) or said.role in WRENCH):
            continue
        if said.role in found:
            raise TableError(f"{path}: expected one column for {said.role}, got {header!r}, too")
        found[said.role] = (index, said.factor)
    wanted = [f"q{j + 1}" for j in range(n)]
    joints = [role for role in found if JOINT.match(role)]
    if set(joints) != set(wanted):
        raise TableError(
            f"{path}: expected columns q1 to q{n} with their units for the robot's joints, got "
            f"{', '.join(joints) or 'none'}; the headers are {', '.join(cells.headers)}"
        )
    loaded = [role for role in WRENCH if role in found]
    if bool(loaded) is (wrench is not None):
        raise TableError(
            f"{path}: expected the wrench either as columns (fx_N ... mz_Nm) or by --wrench, got "
            f"{'both' if loaded else 'neither'}"
        )
    load = np.zeros((len(cells.rows), 6))
    if wrench is not None:
        load[:] = wrench
    for axis, role in enumerate(WRENCH):
        if role in found:
            load[:, axis] = _numbers(cells, *found[role], path)
    columns = [_numbers(cells, *found[role], path) for role in wanted]
    return Program(cells, [found[role] for role in wanted], np.column_stack(columns), load)


def _matters(header: str) -> bool:
    """Whether a header without a unit is of a joint or of the wrench."""
    word = header.strip().lower()
    return bool(JOINT.match(word)) or word in WRENCH


def _numbers(cells: Cells, index: int, factor: float, path: str | Path) -> FloatArray:
    def one(line: int, word: str) -> float:
        try:
            return factor * plain_number(word)
        except ValueError as error:
            raise TableError(f"{path}: line {line}: {cells.headers[index]}: {error}") from error

    words = [row[index] for row in cells.rows]
    return np.array([one(line, word) for line, word in zip(cells.lines, words, strict=True)])


def corrected_program(
    program: Program,
    result: StiffnessResult,
    robot: RobotModel,
    *,
    follows: bool = False,
    anywhere: bool = False,
) -> str:
    """CSV of the program with corrected joints.

    Args:
        program: points and loads.
        result: identified.
        robot: with the tool that carries the load.
        follows: whether the wrenches are in the tool's axes.
        anywhere: as correct.

    Raises:
        CabolsError: naming the line of the first point that cannot be corrected.
    """
    require_usable(result, robot)
    out = io.StringIO()
    rows = csv.writer(out, lineterminator="\n")
    rows.writerow(_headers(program.cells))
    for i, (line, cells) in enumerate(zip(program.cells.lines, program.cells.rows, strict=True)):
        at = robot.drives(program.joints[i])
        try:
            found = correct(
                result, robot, at, program.wrench[i], follows=follows, anywhere=anywhere
            )
        except CabolsError as error:
            raise CabolsError(f"line {line}: {error}; nothing was written") from error
        changed = list(cells)
        command = robot.joints_of(found.joints)
        for j, (index, factor) in enumerate(program.joint):
            changed[index] = f"{command[j] / factor:.9g}"
        both = robot.posture(np.array([at, found.joints]))
        shift = both.position[1] - both.position[0]
        turned = logarithm((both.rotation[1] @ both.rotation[0].T)[None])[0]
        numbers = 1e3 * np.concatenate([found.prediction.deflection[:3], shift, turned])
        rows.writerow([*changed, *(f"{number:.6g}" for number in numbers)])
    return out.getvalue()


def _headers(cells: Cells) -> list[str]:
    pairs = zip(cells.headers, cells.units, strict=True)
    return [f"{name} [{unit}]" if unit else name for name, unit in pairs] + list(MORE)


def run(options: argparse.Namespace) -> int:
    """Correct a program; 0.

    Raises:
        CabolsError: if it cannot be.
    """
    require_file(options.program)
    path = Path(
        options.output or options.program.with_name(f"{options.program.stem}_corrected.csv")
    )
    if path.exists() and not options.overwrite:
        raise UsageError(f"{path}: expected no such file yet, got one; --overwrite replaces it")
    content = read_yaml(options.result)
    result = read_result(options.result)
    place, turn = tool_of(content)
    robot = robot_of(options, place, turn)
    program = read_program(options.program, robot.n, options.wrench)
    follows = options.wrench_axes == "tool"
    text = corrected_program(program, result, robot, follows=follows, anywhere=options.anywhere)
    path.write_text(text, encoding="utf-8")
    moved = 1e3 * np.linalg.norm(_moved(text), axis=1)
    print(f"{len(program.cells.rows)} points corrected, of {robot.name}")
    print(f"without: {moved.mean():.0f} um off on the average, {moved.max():.0f} um at most")
    print(f"  {path}")
    return DONE


def _moved(text: str) -> FloatArray:
    """(k, 3) deflections of a corrected program [mm]."""
    rows = list(csv.DictReader(io.StringIO(text)))
    return np.array([[float(row[name]) for name in MORE[:3]] for row in rows])
