# SPDX-License-Identifier: Apache-2.0
"""Rigs of 0.1 become folders: what they say is kept, nothing is written over, all is said."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from cabols_control.configuration import read_yaml
from cabols_control.frames import load_frames
from cabols_control.rig import load_rig
from cabols_control.rig_tools.migrate import frames_of, kind_of, main, without_keys
from cabols_hw.abb.configurations import load_configurations
from cabols_hw.card.config import load_card
from cabols_hw.safety.config import load_safety
from cabols_hw.tracker.config import load_tracker_config
from cabols_sim.devices.robot.robot_config import load_robot_truth
from cabols_sim.devices.tracker.config import load_tracker_truth
from cabols_sim.plant.config import load_plant
from cabols_stiffness.campaign.plan import load_plan

OLD = Path(__file__).parents[1] / "data" / "v0_1"
LOADERS = (
    *(load_rig, load_card, load_safety, load_configurations, load_tracker_config),
    *(load_plant, load_robot_truth, load_tracker_truth),
)


@pytest.fixture
def old(tmp_path):
    """0.1's files of a rig, to be changed."""
    return Path(shutil.copytree(OLD / "rig", tmp_path / "old"))


def migrate(monkeypatch, *words):
    monkeypatch.setattr(sys, "argv", ["migrate", *map(str, words)])
    return main()


def change(path, **values):
    """Set top-level keys of a YAML file."""
    path.write_text(yaml.safe_dump({**read_yaml(path), **values}), encoding="utf-8")


def test_every_file_of_0_1_is_known_by_its_name_and_its_keys(old):
    for path in sorted(old.iterdir()):
        by_name = kind_of(path)
        assert by_name is not None, path.name
        renamed = path.rename(path.with_name(f"my_{path.stem.partition('_')[2]}_x{path.suffix}"))
        if by_name and "_" not in by_name.replace("robot_truth", "").replace("tracker_truth", ""):
            assert kind_of(renamed) == by_name


def test_migrated_bench_loads_and_is_the_bench(old, tmp_path, monkeypatch, capsys):
    assert migrate(monkeypatch, old) == 0
    folder = tmp_path / "old_rig"
    for load in LOADERS:
        load(folder)
    assert load_plan(rig=folder).configurations == load_plan().configurations
    found, bench = load_rig(folder), load_rig()
    np.testing.assert_array_equal(found.geometry.base_points, bench.geometry.base_points)
    assert found.limbs == bench.limbs
    assert load_card(folder) == load_card()
    said = capsys.readouterr().out
    assert "bench_card.yaml -> card.yaml; to frames.yaml:" in said
    assert "no longer needed" in said


def test_numbers_that_moved_are_the_rigs_own(old, tmp_path, monkeypatch):
    turned = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    change(old / "bench_card.yaml", tool_mass=3.25, sensor_rotation=turned)
    change(old / "bench_tracker.yaml", base_position=[1.0, 2.0, 3.0])
    for name in ("bench_plant.yaml", "bench_scene.yaml", "bench_campaign.yaml"):
        (old / name).unlink()
    folder = tmp_path / "mine"
    assert migrate(monkeypatch, old, "--output", folder) == 0
    frames = load_frames(folder)
    assert frames.tool_mass == 3.25
    assert frames.tracker_frame.position == [1.0, 2.0, 3.0]
    np.testing.assert_allclose(frames.sensor_frame.rotation_xyz_deg, [0.0, 0.0, 90.0])


def test_single_file_makes_a_rig_with_the_bench_for_the_rest(old, tmp_path, monkeypatch, capsys):
    points = np.array(read_yaml(old / "bench_geometry.yaml")["base_points"])
    points[0, 0] += 0.01
    mine = old / "my_lab.yaml"
    shutil.copy(old / "bench_geometry.yaml", mine)
    change(mine, base_points=points.tolist())
    assert migrate(monkeypatch, mine, "--output", tmp_path / "lab") == 0
    np.testing.assert_array_equal(load_rig(tmp_path / "lab").geometry.base_points, points)
    said = capsys.readouterr().out
    assert "my_lab.yaml -> geometry.yaml" in said
    assert "limbs.yaml: the bench's, as no file of 0.1 says it" in said


def test_nothing_is_written_over(old, tmp_path, monkeypatch, capsys):
    before = {path.name: path.read_bytes() for path in old.iterdir()}
    assert migrate(monkeypatch, old, "--output", old) == 2
    assert "expected nothing there" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in old.iterdir()} == before


def test_two_files_for_one_place_are_refused(old, tmp_path, monkeypatch, capsys):
    shutil.copy(old / "bench_limbs.yaml", old / "other.yaml")
    assert migrate(monkeypatch, old, "--output", tmp_path / "new") == 2
    assert "expected one file for limbs.yaml" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("name", ["bags/rigid", "campaign", "campaign/result.yaml"])
def test_what_opens_directly_is_left_alone(monkeypatch, capsys, name):
    assert migrate(monkeypatch, OLD / name) == 0
    assert "nothing to do" in capsys.readouterr().out


def test_missing_source_is_a_wrong_command_line(tmp_path, monkeypatch, capsys):
    assert migrate(monkeypatch, tmp_path / "nowhere") == 2
    assert "nothing there" in capsys.readouterr().err


def test_keys_go_with_all_that_belongs_to_them():
    text = "# head\na: 1\nb:\n  - [1, 2]\n  # inside\n  - [3, 4]\nc: {d: 1,\n  e: 2}\nf: 3\n"
    assert without_keys(text, ["b", "c"]) == "# head\na: 1\nf: 3\n"


def test_frames_take_the_names_of_today():
    content = {"tool_position": [1, 2, 3], "tool_quaternion": [1, 0, 0, 0], "configurations": []}
    assert frames_of("robot.yaml", content) == {
        "tool_frame": {"position": [1, 2, 3], "quaternion_wxyz": [1, 0, 0, 0]}
    }
