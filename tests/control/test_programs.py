# SPDX-License-Identifier: Apache-2.0
"""Load programmes: built-in ones are feasible on the bench, CSV files are checked line by line."""

from __future__ import annotations

import numpy as np
import pytest

from cabols_control.errors import ConfigError
from cabols_control.kinematics import structure_matrix
from cabols_control.load_programs.programs import BUILT_IN, CSV_HEADER, load_program, parse_csv
from cabols_control.tension import TensionResolver


@pytest.mark.parametrize("name", sorted(BUILT_IN))
def test_built_in_programmes_are_feasible(rig, name):
    geometry, control = rig.geometry, rig.control
    matrix = structure_matrix(geometry, geometry.reference_position, geometry.reference_rotation)
    resolver = TensionResolver(matrix, control.tension_min, control.tension_max)
    program = load_program(name)
    assert program.time[0] == 0.0
    assert (np.diff(program.time) > 0).all()
    for time_s in np.linspace(0.0, program.duration, 400):
        wrench = program.at(time_s)
        assert resolver.solve(wrench).feasible
        assert (np.abs(wrench) <= control.rated).all()
    np.testing.assert_array_equal(program.at(program.duration), 0.0)
    loaded = np.abs(program.wrench).max(axis=0)
    assert (loaded > 0).all(), "every component is loaded"


def test_before_and_after():
    program = load_program("steps")
    np.testing.assert_array_equal(program.at(-1.0), 0.0)
    np.testing.assert_array_equal(program.at(np.nan), 0.0)
    np.testing.assert_array_equal(program.at(1e6), program.wrench[-1])


def test_steps_hold_and_lines_interpolate(tmp_path):
    assert load_program("steps").at(1.9999)[0] == 40.0
    path = tmp_path / "ramp.csv"
    path.write_text(",".join(CSV_HEADER) + "\n0,0,0,0,0,0,0\n2,10,0,0,0,0,4\n")
    np.testing.assert_allclose(load_program(str(path)).at(0.5), [2.5, 0, 0, 0, 0, 1.0])


def test_scaled():
    np.testing.assert_allclose(
        load_program("ramps").scaled(-2.0).at(4.0), -2.0 * load_program("ramps").at(4.0)
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected the header"),
        ("a,b\n1,2\n", "expected the header"),
        ("{h}\n0,0,0,0,0,0\n", "line 2: expected 7"),
        ("{h}\n0,0,0,0,0,0,x\n", "line 2: expected a number"),
        ("{h}\n0,0,0,0,0,0,nan\n", "line 2: expected 7 finite"),
        ("{h}\n0,0,0,0,0,0,0\n", "at least two lines"),
        ("{h}\n0,0,0,0,0,0,0\n0,1,0,0,0,0,0\n", "increasing"),
        ("{h}\n1,0,0,0,0,0,0\n2,1,0,0,0,0,0\n", "line 2: expected time from 0"),
        ("{h}\n0,0,0,0,0,0,0\n\n1,0,0,0,0,0,0\n1,5,0,0,0,0,0\n", "line 5: .* got 1 s after 1 s"),
        ("time_s,fx_n,fy_n,fz_n,mx_nmm,my_nmm,mz_nmm\n0,0,0,0,0,0,0\n", "torques in N m"),
        ("{h}\n0,5,0,0,0,0,0\n", "to hold a wrench, repeat it"),
    ],
)
def test_bad_csv(tmp_path, text, message):
    path = tmp_path / "bad.csv"
    path.write_text(text.replace("{h}", ",".join(CSV_HEADER)))
    with pytest.raises(ConfigError, match=message):
        load_program(str(path))


def test_a_byte_order_mark_is_no_number(tmp_path):
    path = tmp_path / "spreadsheet.csv"
    path.write_text(",".join(CSV_HEADER) + "\n0,0,0,0,0,0,0\n1,1,0,0,0,0,0\n", "utf-8-sig")
    assert load_program(str(path)).duration == 1.0


@pytest.mark.parametrize("factor", [np.nan, np.inf, 1e300])
def test_no_scale_makes_wrenches_that_are_no_numbers(factor):
    with pytest.raises(ConfigError, match="scale"):
        load_program("ramps").scaled(factor)


@pytest.mark.parametrize("name", ["", "nothing", "none.csv", "/tmp"])
def test_unknown_programme(name):
    with pytest.raises(ConfigError, match=r"expected one of|cannot be read"):
        load_program(name)


@pytest.mark.parametrize(
    "cell",
    [
        "1_0",
        "\u0967\u0968",
        "\uff11\uff12",
        "1e308",
        "0x10",
        "1e999",
        "+-1",
        "1 0",
        "infinity",
        "1\u2028",
    ],
)
def test_only_plain_numbers_are_read(cell):
    rows = f"{','.join(CSV_HEADER)}\n0,{cell},0,0,0,0,0\n1,0,0,0,0,0,0\n"
    with pytest.raises(ConfigError, match="line 2"):
        parse_csv(rows, "x", "x.csv")


@pytest.mark.parametrize("cell", ["1", "+1.5", "-.5", "2.", "1e-3", " 7 ", "2E+2"])
def test_plain_numbers_are_read(cell):
    rows = f"{','.join(CSV_HEADER)}\r\n0,{cell},0,0,0,0,0\r\n1,0,0,0,0,0,0\r\n"
    assert parse_csv(rows, "x", "x.csv").wrench[0, 0] == float(cell)


@pytest.mark.parametrize("separator", list("\x0b\x0c\x1c\x1d\x1e\x85\u2028\u2029"))
def test_no_other_character_ends_a_line(separator):
    rows = f"{','.join(CSV_HEADER)}\n0,0,0,0,0,0,0{separator}1,0,0,0,0,0,0\n"
    with pytest.raises(ConfigError, match="line 2"):
        parse_csv(rows, "x", "x.csv")
