# SPDX-License-Identifier: Apache-2.0
"""A laboratory's table against robots that are none of the project's code."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
import yaml

import independent_arm as arm
from cabols_control.errors import CabolsError
from cabols_stiffness import load_robot
from cabols_stiffness.errors import TableError
from cabols_stiffness.identification.identify import identify
from cabols_stiffness.model.result_file import read_result
from cabols_stiffness.table.command import main
from cabols_stiffness.table.laboratory import Stated, to_samples
from cabols_stiffness.table.reading import read_table
from cabols_stiffness.table.units import meaning

LAB = Path(__file__).parent.parent / "cases" / "stiffness" / "lab.csv"
OPTIONS = ["--tool", "0", "0", "0.15", "--reflector", "0", "0.1", "0.05", "--deviation-um", "21"]


def test_command_identifies_the_laboratorys_robot(tmp_path, capsys):
    assert main(["identify", str(LAB), *OPTIONS, "--output", str(tmp_path / "out")]) == 0
    assert capsys.readouterr().out.startswith("verdict: good")
    found = read_result(tmp_path / "out" / "result.yaml")
    error = np.abs(found.stiffness - arm.STIFFNESS)
    assert np.all(error < 3.0 * found.standard_deviation)
    assert found.adequate
    assert found.origin.joint_names == tuple(f"joint_{j}" for j in range(1, 7))


def test_command_climbs_the_ladder_where_it_pays(tmp_path, capsys):
    """This robot has joints alone; nothing else is taken, and what was tried is in result.yaml."""
    words = ["identify", str(LAB), *OPTIONS, "--output", str(tmp_path / "out"), "--model", "auto"]
    assert main(words) == 0
    assert "ladder of models" in capsys.readouterr().out
    content = yaml.safe_load((tmp_path / "out" / "result.yaml").read_text("utf-8"))
    taken = [step["rung"] for step in content["ladder"]["steps"] if step["taken"]]
    assert taken == ["joints"]
    found = read_result(tmp_path / "out" / "result.yaml")
    assert found.elastic is not None
    assert np.all(np.abs(found.stiffness - arm.STIFFNESS) < 3.0 * found.standard_deviation)


@pytest.mark.parametrize("model", ["gearbox", "joints+gearbox", "as_published"])
def test_unknown_model_is_a_usage_error(tmp_path, model, capsys):
    words = ["identify", str(LAB), *OPTIONS, "--output", str(tmp_path / "out"), "--model", model]
    try:
        code = main(words)
    except SystemExit as ended:  # refused with the command line
        code = ended.code
    assert code == 2
    assert "expected" in capsys.readouterr().err


def test_wrong_sign_is_refused_and_named(tmp_path, capsys):
    rows = list(csv.DictReader(LAB.open(encoding="utf-8")))
    for row in rows:
        for name in ("Fx_N", "Fy_N", "Fz_N", "Mx_Nm", "My_Nm", "Mz_Nm"):
            row[name] = str(-float(row[name]))
    path = tmp_path / "reversed.csv"
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    assert main(["identify", str(path), *OPTIONS, "--output", str(tmp_path / "out")]) == 1
    said = capsys.readouterr()
    assert "sign of the wrench" in said.out + said.err
    assert "95 %" not in said.out


@pytest.mark.parametrize(
    ("header", "unit", "role", "factor"),
    [
        ("Fx_N", "", "fx", 1.0),
        ("Mx [N mm]", "", "mx", 1e-3),
        ("Tz_Nmm", "", "mz", 1e-3),
        ("torque_x (N m)", "", "mx", 1.0),
        ("q3_deg", "", "q3", np.pi / 180.0),
        ("joint_1 [mm]", "", "q1", 1e-3),
        ("dx", "mm", "dx", 1e-3),
        ("rz_mrad", "", "rz", 1e-3),
        ("config", "", "configuration", 1.0),
    ],
)
def test_headers_say_what_and_in_which_unit(header, unit, role, factor):
    found = meaning(header, unit)
    assert (found.role, found.factor) == (role, factor)


@pytest.mark.parametrize("header", ["Fx", "dx_N", "Mx_mm", "q1_N"])
def test_missing_or_wrong_unit_is_refused(header):
    with pytest.raises(TableError, match="expected a unit"):
        meaning(header)


def test_rows_without_a_load_are_skipped_and_empty_cells_not_measured(tmp_path):
    lines = LAB.read_text(encoding="utf-8").splitlines()
    cells = lines[3].split(",")
    cells[8] = ""
    lines[3] = ",".join(cells)
    cells = lines[5].split(",")
    cells[-1] = "nan"
    lines[5] = ",".join(cells)
    path = tmp_path / "holes.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    table = read_table(path, 6)
    assert table.skipped == (4,)
    stated = Stated(reflector=(0.0, 0.1, 0.05), position_m=21e-6)
    robot = load_robot(tool_position=arm.TOOL_POSITION)
    found = identify(to_samples(table, robot, stated), robot)
    assert found.adequate


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("q1_deg,q2_deg\n1,2\n", "q1 to q6"),
        (",".join(f"q{j}_deg" for j in range(1, 8)) + "\n" + "1," * 6 + "1\n", "got also q7"),
        (",".join(f"q{j}_deg" for j in range(1, 7)) + "\n" + "1," * 5 + "1\n", "wrench"),
        ("q1_deg\n", "got 1 lines"),
    ],
)
def test_tables_that_cannot_be_used_are_refused(tmp_path, text, said):
    path = tmp_path / "loads.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(CabolsError, match=said):
        read_table(path, 6)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--deviation-um", "-5"], "a number above zero, got '-5'"),
        (["--deviation-n", "nan"], "a number above zero, got 'nan'"),
        (["--tool", "0", "inf", "0"], "a finite number, got 'inf'"),
    ],
)
def test_impossible_numbers_are_usage_errors(more, said, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["identify", str(LAB), *more])
    assert ended.value.code == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("path", ["nothing.csv", "."])
def test_a_table_that_is_no_file_is_a_usage_error(path, tmp_path, capsys):
    assert main(["identify", str(tmp_path / path)]) == 2
    assert "expected a table's file" in capsys.readouterr().err


@pytest.mark.parametrize("said", ["kN", {"as": "fx", "in": "kN"}, {"unit": 3}])
def test_a_mapping_of_another_form_is_refused(said, tmp_path, capsys):
    place = tmp_path / "mapping.yaml"
    place.write_text(yaml.safe_dump({"Fx_N": said}), encoding="utf-8")
    assert main(["identify", str(LAB), *OPTIONS, "--mapping", str(place)]) == 1
    assert "`as` (a known name), `unit`, or both" in capsys.readouterr().err


def test_a_table_without_loads_is_refused(tmp_path, capsys):
    header, *rows = LAB.read_text(encoding="utf-8").splitlines()
    rows = [",".join([*row.split(",")[:8], *["0"] * 6, *row.split(",")[14:]]) for row in rows]
    path = tmp_path / "loads.csv"
    path.write_text("\n".join([header, *rows]), encoding="utf-8")
    assert main(["identify", str(path), *OPTIONS]) == 1
    assert "got zeros in all" in capsys.readouterr().err
