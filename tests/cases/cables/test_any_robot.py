# SPDX-License-Identifier: Apache-2.0
"""`workspace` and the loader with robots that are not the bench, from one robot file each."""

from __future__ import annotations

import pytest
import yaml

from cabols_control.configuration import read_yaml
from cabols_control.geometry import load_geometry
from cabols_control.rig_folder import rig_file
from cabols_control.workspace.tool.command import main as workspace
from case_robots import FOLDER
from cases import outcome

SMALL = ["--scheduler", "inline", "--counts", "2", "2", "2", "--tilt", "0", "--output"]


def run_map(tmp_path, name, *words):
    geometry = str(FOLDER / f"{name}.yaml")
    return workspace(["map", "--geometry", geometry, *words, *SMALL, str(tmp_path / "out")])


@pytest.mark.parametrize("name", ["robocrane", "segesta10"])
def test_robots_of_six_and_ten_cables_are_mapped(tmp_path, name):
    assert run_map(tmp_path, name, "--no-bodies") == 0


@pytest.mark.parametrize(("name", "low", "high"), [("fast", 12e4, 12e5), ("cablesim", 1e3, 14e3)])
def test_robots_of_large_tensions_are_mapped(tmp_path, name, low, high):
    control = read_yaml(rig_file("control.yaml"))
    control.update(tension_min=low, tension_max=high)
    file = tmp_path / "control.yaml"
    file.write_text(yaml.safe_dump(control), encoding="utf-8")
    assert run_map(tmp_path, name, "--control", str(file), "--no-bodies") == 0


def test_bodies_of_another_rig_are_not_used_silently(tmp_path, capsys):
    code = run_map(tmp_path, "cogiro")
    said = capsys.readouterr()
    assert code != 0 or "bench" in said.out + said.err


@pytest.mark.parametrize("name", ["planar_ex_planar", "planar_kntu", "planar_cross"])
def test_planar_robots_load(name):
    found = outcome(lambda: load_geometry(FOLDER / f"{name}.yaml"))
    assert getattr(found, "cables", None) == 4, found
