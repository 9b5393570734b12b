# SPDX-License-Identifier: Apache-2.0
"""Files mean what a person reads in them: forms that only Python takes for numbers are refused."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from cabols_control.errors import CabolsError, ConfigError
from cabols_control.files.plain_numbers import plain_integer, plain_number
from cabols_control.files.strict_yaml import parse
from cabols_control.load_programs.programs import CSV_HEADER, parse_csv
from cabols_control.rig_folder import rig_file
from cabols_control.serial_arms.arm import read_serial_arm
from cabols_control.workspace.tool.files import POSE_COLUMNS, read_poses
from cabols_hw.force_torque.ati import parse_calibration
from cabols_hw.force_torque.sensor_bias import load_bias
from cabols_stiffness.campaign.journal import read_samples
from cabols_stiffness.measurements.measured_load import columns
from cabols_stiffness.table.reading import read_table

ODD = (
    "1_0",
    "\u0661\u0662",
    "\uff11",
    "0x10",
    "1e",
    "1,5",
    "1 2",
    "nan",
    "inf",
    "1e309",
    "",
    "--2",
)
HEAD = ",".join(CSV_HEADER)


@pytest.mark.parametrize("text", ODD)
def test_no_number(text):
    with pytest.raises(ValueError, match=r"expected|could not"):
        plain_number(text)
    with pytest.raises(ValueError, match="expected"):
        plain_integer(text)


@pytest.mark.parametrize("text", ["1", "-1.5", "+2", ".5", "1.", "2e-3", " 7\t", "1E+5", "-0"])
def test_number(text):
    assert plain_number(text) == float(text)


def test_a_cell_that_goes_on_in_the_next_line_is_no_number():
    with pytest.raises(ConfigError):
        parse_csv(f'{HEAD}\n0,0,0,0,0,0,0\n1,"1\n2",0,0,0,0,0\n', "p", "p.csv")


@pytest.mark.parametrize("text", ["1_0", "\u0661", "\uff11\uff12"])
def test_every_file_of_numbers(tmp_path, text):
    path = tmp_path / "file"
    path.write_text(f"{','.join(POSE_COLUMNS)}\n0,0,0,0,0,{text}\n", "utf-8")
    with pytest.raises(CabolsError):
        read_poses(path)
    joints = [f"q{j}_deg" for j in range(1, 7)]
    path.write_text(",".join([*joints, "fx_N"]) + f"\n0,0,0,0,0,{text},1\n", "utf-8")
    with pytest.raises(CabolsError):
        read_table(path, 6)
    names = columns(8)
    path = tmp_path / "samples.csv"
    for column in (3, 20):
        cells = ["0"] * len(names)
        cells[column] = text
        path.write_text(",".join(names) + "\n" + ",".join(cells) + "\n", "utf-8")
        with pytest.raises(CabolsError):
            read_samples(tmp_path)
    calibration = rig_file("sensor.cal").read_text("utf-8")
    odd = re.sub(r'(<UserAxis[^>]*values=")\s*\S+', rf"\g<1>{text}", calibration, count=1)
    with pytest.raises(ConfigError):
        parse_calibration(odd, "odd.cal")


def test_samples_are_finite(tmp_path):
    names = columns(8)
    cells = ["0"] * len(names)
    cells[12] = "nan"
    (tmp_path / "samples.csv").write_text(",".join(names) + "\n" + ",".join(cells) + "\n")
    with pytest.raises(CabolsError, match="line 2"):
        read_samples(tmp_path)


def test_a_table_of_other_ends_of_lines_and_indices(tmp_path):
    path = tmp_path / "table.csv"
    joints = ",".join(f"q{j}_deg" for j in range(1, 7))
    for row in (
        '0,0,0,0,0,0,1,"2\n3"',
        "0,0,0,0,0,0,1.5,2",
        "0,0,0,0,0,0,1e12,2",
    ):
        path.write_text(f"{joints},config,fx_N\n{row}\n", "utf-8")
        with pytest.raises(CabolsError):
            read_table(path, 6)
    path.write_text(f"{joints},config,fx_kN\n0,0,0,0,0,0,1,1e308\n", "utf-8")
    with pytest.raises(CabolsError):
        read_table(path, 6)


@pytest.mark.parametrize(
    "change",
    [
        {"time_ns": True},
        {"time_ns": 1.5},
        {"time_ns": "3"},
        {"time_ns": -1},
        {"volts": [True, 0, 0, 0, 0, 0]},
        {"volts": ["1", 0, 0, 0, 0, 0]},
        {"tare_weight": [None, 0, 0, 0, 0, 0]},
    ],
)
def test_bias_of_other_types(tmp_path, change):
    content = {"form": 1, "serial": "S", "time_ns": 1, "volts": [0] * 6, "tare_weight": [0] * 6}
    path = tmp_path / "bias.json"
    path.write_text(json.dumps(content))
    assert load_bias(path, "S").time_ns == 1
    path.write_text(json.dumps({**content, **change}))
    with pytest.raises(ConfigError):
        load_bias(path, "S")


def test_bias_with_a_key_twice(tmp_path):
    path = tmp_path / "bias.json"
    zeros = [0] * 6
    path.write_text(
        f'{{"form": 1, "serial": "S", "time_ns": 1, "volts": {zeros}, "tare_weight": {zeros}, '
        f'"volts": {[1] * 6}}}'
    )
    with pytest.raises(ConfigError):
        load_bias(path, "S")


@pytest.mark.parametrize(
    "text", ["a: 1\x85b: 2\n", "a: 1\u2028b: 2\n", "a: &x {b: 1}\nc: {<<: *x}\n"]
)
def test_yaml_that_its_versions_read_differently(text):
    with pytest.raises(ConfigError, match=r"line [12]"):
        parse(text)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('<axis xyz="0 1 0"/>', '<axis xiz="0 1 0"/>'),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 1e308 0"/>'),
        ("<origin xyz=", "<origin xy="),
        ("lower=", "lowr="),
        ('name="joint_2"', 'name="joint_1"'),
        ('<child link="link_2"/>', '<child link="link_1"/>'),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 1_0 0"/>'),
    ],
)
def test_urdf_with_a_misspelt_or_doubled_part(tmp_path, old, new):
    text = rig_file("robot.urdf").read_text("utf-8")
    assert old in text
    path = tmp_path / "robot.urdf"
    path.write_text(text.replace(old, new, 1), "utf-8")
    with pytest.raises(ConfigError):
        read_serial_arm(path)


def test_unknown_encodings_of_xml(tmp_path):
    odd = b'<?xml version="1.0" encoding="utf-99"?><robot/>'
    with pytest.raises(ConfigError):
        parse_calibration(odd, "odd.cal")
    (tmp_path / "odd.urdf").write_bytes(odd)
    with pytest.raises(ConfigError):
        read_serial_arm(tmp_path / "odd.urdf")


def test_plain_files_stay_as_they_were():
    assert parse("a: 1e6\nb: [true, ~]\n").content == {"a": 1e6, "b": [True, None]}
    arm = read_serial_arm(rig_file("robot.urdf"))
    assert np.isfinite(arm.origins).all()
