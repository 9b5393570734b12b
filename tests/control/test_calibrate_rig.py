# SPDX-License-Identifier: Apache-2.0
"""The command calibrate_rig: a plan, a table of readings, a rig's folder; and wrong tables."""

from __future__ import annotations

import csv
import shutil
import sys

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from cabols_control.cable_kernels import (
    cable_lengths_unchecked,
    cable_records,
    structure_matrix_unchecked,
)
from cabols_control.calibration.command import main
from cabols_control.calibration.recording import (
    POSE_COLUMNS,
    WRENCH_COLUMNS,
    length_columns,
    read_readings,
)
from cabols_control.errors import DataFileError
from cabols_control.rig import load_rig
from cabols_control.rig_folder import find_rig

K_E, OFFSET_M, WEIGHT_N, FREE_N = 2250.0, 0.4, 19.0, 7.0
COLUMNS = (*POSE_COLUMNS, *length_columns(8), *WRENCH_COLUMNS)


@pytest.fixture(scope="module")
def drawing(tmp_path_factory):
    """The bench's folder with pulleys of 40 mm."""
    folder = tmp_path_factory.mktemp("rigs") / "lab"
    shutil.copytree(find_rig().path, folder)
    file = folder / "geometry.yaml"
    file.write_text(file.read_text() + "pulley_radius: 0.04\n")
    return folder


@pytest.fixture(scope="module")
def built(drawing):
    """Records of the rig as it was built: every point up to some millimetres off."""
    rng, geometry = np.random.default_rng(1), load_rig(drawing).geometry
    return cable_records(
        geometry.base_points + 4e-3 * rng.standard_normal((8, 3)),
        geometry.platform_points + 4e-3 * rng.standard_normal((8, 3)),
        geometry.pulley_radius + 1e-3 * rng.standard_normal(8),
        geometry.pulley_axes,
    )


@pytest.fixture(scope="module")
def table(built, tmp_path_factory):
    """Path of a table of readings of the built rig."""
    rng = np.random.default_rng(2)
    path = tmp_path_factory.mktemp("data") / "readings.csv"
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for _ in range(40):
            place = np.array([0.0, 1.234615, 0.792718]) + rng.uniform(-0.3, 0.3, 3)
            turn = Rotation.from_rotvec(rng.uniform(-0.4, 0.4, 3))
            for loaded in (False, True, True):
                tension = rng.uniform(5.0, 60.0, 8) if loaded else np.full(8, FREE_N)
                length = cable_lengths_unchecked(built, place, turn.as_matrix())
                let_out = length - OFFSET_M - tension / K_E + 1e-4 * rng.standard_normal(8)
                wrench = structure_matrix_unchecked(built, place, turn.as_matrix()) @ tension
                wrench[2] -= WEIGHT_N
                parts = [turn.inv().apply(part) for part in (wrench[:3], wrench[3:])]
                noise = np.repeat([0.05, 0.005], 3) * rng.standard_normal(6)
                felt = np.concatenate(parts) + noise
                seen = place + 2e-5 * rng.standard_normal(3)
                error = Rotation.from_rotvec(1.4e-4 * rng.standard_normal(3))
                pose = [*seen, *(error * turn).as_quat()]
                writer.writerow([*pose, *let_out, *(felt if loaded else [""] * 6)])
    return path


def call(monkeypatch, *words):
    monkeypatch.setattr(sys, "argv", ["calibrate_rig", *map(str, words)])
    return main()


def test_a_table_becomes_a_rig(monkeypatch, tmp_path, drawing, built, table, capsys):
    target = tmp_path / "calibrated"
    words = (table, "--rig", drawing, "--output", target, "--tension", FREE_N)
    assert call(monkeypatch, *words) == 0
    assert "held out" in capsys.readouterr().out
    rig = load_rig(target)
    pose = (rig.geometry.reference_position, rig.geometry.reference_rotation)
    wrench = [
        structure_matrix_unchecked(cables, *(np.array(part) for part in pose))
        for cables in (rig.geometry.records(), load_rig(drawing).geometry.records(), built)
    ]
    left, before = (np.abs(wrench[k] - wrench[2]).max(axis=1) for k in (0, 1))
    assert (left < 0.2 * before).all()
    record = yaml.safe_load((target / "calibration.yaml").read_text())
    parameters = {row["name"]: row for row in record["parameters"]}
    for name, true in (("cable 4, k_e", K_E), ("weight", WEIGHT_N)):
        row = parameters[name]
        assert row["told"]
        assert abs(row["value"] - true) < 4.0 * row["deviation"]
    assert rig.limbs.stiffness == pytest.approx([K_E] * 8, rel=0.01)
    assert record["sha256"][:16] in (target / "geometry.yaml").read_text()
    assert call(monkeypatch, *words) == 2


def test_readings_of_another_rig_write_nothing(monkeypatch, tmp_path, table, capsys):
    """The bench without pulleys does not fit what was read over pulleys."""
    target = tmp_path / "calibrated"
    assert call(monkeypatch, table, "--output", target, "--tension", FREE_N) == 1
    assert "Nothing written" in capsys.readouterr().err
    assert not target.exists()


@pytest.mark.parametrize(
    ("column", "value", "match"),
    [
        ("x_m", "", "line 4.*finite"),
        ("let_out_3_m", "far", "line 4.*numbers"),
        ("f_y_n", "", "line 4.*whole wrench"),
        ("q_w", "3.0", "reading 3.*unit quaternion"),
        ("let_out_8_m", None, "missing let_out_8_m"),
    ],
)
def test_wrong_tables_are_refused(tmp_path, table, column, value, match):
    rows = list(csv.DictReader(table.read_text().splitlines()))[:6]
    columns = [name for name in COLUMNS if value is not None or name != column]
    if value is not None:
        rows[2][column] = value
    path = tmp_path / "wrong.csv"
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, columns, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)
    with pytest.raises(DataFileError, match=match):
        read_readings(path, 8, FREE_N)


def test_a_plan_is_poses_in_reach(monkeypatch, tmp_path, drawing, capsys):
    for name, count in (("CANDIDATES", 20), ("WORKSPACE", 10)):
        monkeypatch.setattr(f"cabols_control.calibration.session.{name}", count)
    plan = tmp_path / "plan.csv"
    assert call(monkeypatch, "--rig", drawing, "--plan", 8, "--output", plan) == 0
    assert "8 stops" in capsys.readouterr().out
    rows = list(csv.DictReader(plan.read_text().splitlines()))
    assert len(rows) == 8
    assert set(rows[0]) == set(POSE_COLUMNS)


def test_either_a_plan_or_data(monkeypatch, tmp_path, table):
    assert call(monkeypatch, "--output", tmp_path / "x") == 2
    assert call(monkeypatch, table, "--plan", 3, "--output", tmp_path / "x") == 2


ROW = [0.0, 1.2, 0.8, 0.0, 0.0, 0.0, 1.0, *[0.01 * k for k in range(8)], *[1.5] * 6]


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda head, row: (head, [*row[:-1], ""]), "whole wrench or none"),
        (lambda head, row: (head, [*row, "7"]), "as many cells as columns"),
        (lambda head, row: (head, row[:-1]), "as many cells as columns"),
        (lambda head, row: ([*head, "x_m"], [*row, "1"]), "each column once"),
        (lambda head, row: (head, ["1_0", *row[1:]]), "expected numbers"),
        (lambda head, row: (head, ["nan", *row[1:]]), "expected numbers"),
        (lambda head, row: (head, [*row[:3], "0.5", *row[4:]]), "unit quaternion"),
    ],
)
def test_a_table_that_does_not_say_what_it_means_is_refused(tmp_path, wrong, said):
    head, row = wrong(list(COLUMNS), [str(value) for value in ROW])
    path = tmp_path / "readings.csv"
    path.write_text(",".join(head) + "\n" + ",".join(row) + "\n", encoding="utf-8")
    with pytest.raises(DataFileError, match=said):
        read_readings(path, 8, 7.0)


def test_a_table_of_a_spreadsheet_is_read(tmp_path):
    path = tmp_path / "readings.csv"
    row = [str(value) for value in ROW]
    text = "\r\n".join([",".join(COLUMNS), ",".join(row), ",".join([*row[:-6], *[""] * 6]), ""])
    path.write_text(text, encoding="utf-8-sig")
    found = read_readings(path, 8, 7.0)
    assert found.loaded.tolist() == [True, False]
    assert found.let_out[1, 3] == 0.03
