# SPDX-License-Identifier: Apache-2.0
"""One table in the forms in which programs write it: all say the same, or are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow
import pytest
from pyarrow import parquet

from cabols_stiffness.data_files.cells import read_cells
from cabols_stiffness.errors import TableError
from cabols_stiffness.table.reading import read_table
from cabols_stiffness.table.units import meaning

LAB = (Path(__file__).parent.parent / "cases" / "stiffness" / "lab.csv").read_text("utf-8")
HEADER, *ROWS = LAB.splitlines()


def with_header(change):
    return "\n".join([",".join(change(word) for word in HEADER.split(",")), *ROWS])


def units_below(mark=""):
    names = [word.rsplit("_", 1)[0] if "_" in word else word for word in HEADER.split(",")]
    units = [word.rsplit("_", 1)[1] if "_" in word else "-" for word in HEADER.split(",")]
    below = [f"[{unit}]" if mark else unit for unit in units]
    return "\n".join([",".join(names), ",".join(below), *ROWS])


def with_named_configurations():
    rows = [f"pose {row}" for row in ROWS]
    return "\n".join([HEADER, *rows])


OTHER = {
    "q1_deg": "Joint 1 [°]",
    "q2_deg": "A2 in deg",
    "Fx_N": "Force X (N)",
    "Fy_N": "F_y <N>",
    "Mx_Nm": "Torque_x {N⋅m}",
    "My_Nm": "Ty N-m",
    "dx_mm": "u_x [mm]",
    "dy_mm": "deflection y mm",
}

FORMS = {
    "semicolons": LAB.replace(",", ";"),
    "decimal commas": LAB.replace(",", ";").replace(".", ","),
    "tabs and decimal commas": LAB.replace(",", "\t").replace(".", ","),
    "blanks": LAB.replace(",", "   "),
    "bars": LAB.replace(",", " | "),
    "separator named": "sep=;\n" + LAB.replace(",", ";"),
    "byte order mark, CRLF": "\ufeff" + LAB.replace("\n", "\r\n"),
    "units in a line below": units_below(),
    "units in brackets below": units_below("["),
    "blank before the unit": with_header(lambda word: word.replace("_", " ")),
    "slash before the unit": with_header(lambda word: word.replace("_", "/")),
    "commas at the ends": "\n".join(line + "," for line in LAB.splitlines()),
    "empty rows": LAB + "\n" + "," * HEADER.count(",") + "\n\n",
    "sign of typesetting": LAB.replace("-", "\u2212"),
    "headers in a comment": "# " + LAB,
    "headers in a comment of MATLAB": "%" + LAB.replace(",", ";"),
    "lines above the headers": "Tracker AT960;S/N 1\nOperator;N. N.\n\n" + LAB.replace(",", ";"),
    "title above the headers": "Loads of robot 3, second day\n# checked\n" + LAB,
    "commas at the rows' ends": "\n".join([HEADER, *(row + "," for row in ROWS)]),
    "other names": with_header(lambda word: OTHER.get(word, word)),
    "named configurations": with_named_configurations(),
    "rows repeated": "\n".join([LAB.rstrip(), *ROWS[:3]]),
}


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    path = tmp_path_factory.mktemp("plain") / "lab.csv"
    path.write_text(LAB, encoding="utf-8")
    return read_table(path, 6)


def equal(found, plain):
    np.testing.assert_allclose(found.joints, plain.joints, rtol=1e-14)
    np.testing.assert_allclose(found.wrench, plain.wrench, rtol=1e-14)
    np.testing.assert_allclose(found.together("d"), plain.together("d"), rtol=1e-14)
    np.testing.assert_array_equal(found.index("configuration"), plain.index("configuration"))
    assert found.unread == ()
    assert found.skipped == ()


@pytest.mark.parametrize("form", FORMS)
def test_every_form_is_the_same_table(tmp_path, plain, form):
    path = tmp_path / "lab.csv"
    path.write_text(FORMS[form], encoding="utf-8", newline="")
    found = read_table(path, 6)
    equal(found, plain)
    assert len(found.repeated) == (3 if form == "rows repeated" else 0)


def test_unicode_text_of_a_spreadsheet_is_read(tmp_path, plain):
    path = tmp_path / "lab.txt"
    path.write_bytes(LAB.replace(",", "\t").encode("utf-16"))
    equal(read_table(path, 6), plain)


@pytest.mark.parametrize("units", ["in the header", "in the fields' metadata"])
def test_parquet_is_read(tmp_path, plain, units):
    columns = dict(
        zip(HEADER.split(","), np.array([row.split(",") for row in ROWS], float).T, strict=True)
    )
    table = pyarrow.table(columns)
    if units != "in the header":
        fields = [
            pyarrow.field(name.split("_")[0], pyarrow.float64(), metadata={"unit": unit})
            for name, _, unit in (word.partition("_") for word in HEADER.split(","))
        ]
        table = table.rename_columns([field.name for field in fields]).cast(pyarrow.schema(fields))
    parquet.write_table(table, tmp_path / "lab.parquet")
    equal(read_table(tmp_path / "lab.parquet", 6), plain)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (LAB.replace(".", ","), "decimal commas need another mark"),
        (LAB.replace(",", ";").replace("-110.968", "-110,968"), "got both"),
        (LAB.replace("-110.968", '"-1,110.968"'), "expected a number such as"),
        (LAB.replace("-110.968", "?"), r"line 2: Fy_N: expected a number such as .* got '\?'"),
        (LAB.replace("dz_mm", "dx_um"), "expected one column for dx, got 'dx_um'"),
        (LAB.replace("q2_deg", "elbow_deg"), "got none for q2; the headers are config, load"),
    ],
)
def test_what_may_mean_two_things_is_refused(tmp_path, text, said):
    path = tmp_path / "lab.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(TableError, match=said):
        read_table(path, 6)


def test_text_of_another_encoding_is_refused_with_the_remedy(tmp_path):
    path = tmp_path / "lab.csv"
    path.write_bytes(LAB.replace("_deg", " [°]").encode("latin-1"))
    with pytest.raises(TableError, match="save it as UTF-8"):
        read_cells(path)


def test_something_else_named_parquet_is_refused(tmp_path):
    path = tmp_path / "lab.parquet"
    path.write_text(LAB, encoding="utf-8")
    with pytest.raises(TableError, match="expected a table in Parquet"):
        read_cells(path)


@pytest.mark.parametrize(
    ("header", "role", "factor"),
    [
        ("Mz [lbf ft]", "mz", 4.4482216152605 * 0.3048),
        ("Mz_lbf_in", "mz", 4.4482216152605 * 0.0254),
        ("fx/kN", "fx", 1e3),
        ("dx cm", "dx", 1e-2),
        ("Mx N cm", "mx", 1e-2),
        ("q1 degrees", "q1", np.pi / 180.0),
        ("dx [\u03bcm]", "dx", 1e-6),
        ("dx [\u00b5m]", "dx", 1e-6),
        ("dz in inch", "dz", 0.0254),
        ("dz in", "dz", 0.0254),
        ("rx_arcsec", "rx", np.pi / 648000.0),
    ],
)
def test_units_of_other_laboratories(header, role, factor):
    found = meaning(header)
    assert found.role == role
    assert found.factor == pytest.approx(factor, rel=1e-15)


@pytest.mark.parametrize("start", [b"PK\x03\x04rest", b"\xd0\xcf\x11\xe0rest"])
def test_a_spreadsheet_is_refused_with_the_remedy(tmp_path, start):
    path = tmp_path / "lab.xlsx"
    path.write_bytes(start)
    with pytest.raises(TableError, match=r"a spreadsheet .* save the sheet as CSV"):
        read_table(path, 6)


def test_hung_masses_are_forces_down(tmp_path):
    path = tmp_path / "lab.csv"
    header = ",".join([*HEADER.split(",")[:8], "mass_kg", "dx_mm", "dy_mm", "dz_mm"])
    rows = [row.split(",") for row in ROWS]
    rows = [",".join([*row[:8], "2.5", *row[14:]]) for row in rows]
    path.write_text("\n".join([header, *rows]), encoding="utf-8")
    wrench = read_table(path, 6).wrench
    np.testing.assert_allclose(wrench[:, 2], -2.5 * 9.80665)
    assert not wrench[:, [0, 1, 3, 4, 5]].any()
    path.write_text(LAB.replace("Fx_N", "mass_kg"), encoding="utf-8")
    with pytest.raises(TableError, match="either hung masses or a measured wrench"):
        read_table(path, 6)


def test_other_numbers_of_branches_are_refused(tmp_path):
    path = tmp_path / "lab.csv"
    rows = [f"{row},{1 + i % 2}" for i, row in enumerate(ROWS)]
    path.write_text("\n".join([HEADER + ",branch", *rows]), encoding="utf-8")
    with pytest.raises(TableError, match="expected up or down"):
        read_table(path, 6)


def test_words_of_the_branch(tmp_path):
    path = tmp_path / "lab.csv"
    rows = [f"{row},{'up' if i % 2 else 'down'}" for i, row in enumerate(ROWS)]
    path.write_text("\n".join([HEADER + ",branch", *rows]), encoding="utf-8")
    branch = read_table(path, 6).index("branch")
    np.testing.assert_array_equal(branch, np.where(np.arange(len(ROWS)) % 2, 1, -1))


@pytest.mark.parametrize("slip", ["1e", "0x10", "1O", "-1-", "2b", ".1.", "1_0x"])
def test_a_slip_in_a_number_is_no_name_of_a_configuration(tmp_path, slip):
    path = tmp_path / "lab.csv"
    path.write_text("\n".join([HEADER, slip + ROWS[0].partition(",")[1] + ROWS[0][2:], *ROWS[1:]]))
    with pytest.raises(TableError, match=r"line 2: config: "):
        read_table(path, 6)


@pytest.mark.parametrize("names", [("1a", "1b"), ("home", "2nd"), ("A1", "A2")])
def test_names_of_configurations_may_be_any_words(tmp_path, names):
    path = tmp_path / "lab.csv"
    rows = [names[row.startswith("0,")] + row[row.index(",") :] for row in ROWS]
    path.write_text("\n".join([HEADER, *rows]))
    assert set(read_table(path, 6).index("configuration").tolist()) == {0, 1}


def test_names_may_stand_beside_numbers(tmp_path):
    path = tmp_path / "lab.csv"
    path.write_text("\n".join([HEADER, "home" + ROWS[0][1:], *ROWS[1:]]))
    assert read_table(path, 6).index("configuration")[0] == 0
