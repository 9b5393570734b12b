# SPDX-License-Identifier: Apache-2.0
"""docs/your_rig.md, followed: its commands, its edits, and a short run of each rig at the end."""

from __future__ import annotations

import configparser
import re
import shlex
import shutil
import subprocess
import sys
import textwrap
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml

from cabols_control.bags.reader import read_bag
from cabols_control.errors import ConfigError, UsageError
from cabols_control.load_programs.motor_demand import fastest_preview
from cabols_control.load_programs.programs import load_program
from cabols_control.rig import load_rig
from cabols_control.rig_folder import FILES, RigWarning, find_rig
from cabols_control.rig_tools.new_rig import make_rig
from cabols_control.run_report.judgement.step_response import analyse_steps
from cabols_hw.card.config import load_card
from cabols_hw.card.quanser import CardError, open_q8
from cabols_sim.bench.run import run_bench
from cabols_sim.check_rig import check_rig
from cabols_sim.plant.closed_loop import simulate
from cabols_sim.plant.config import load_plant
from cabols_stiffness.campaign.plan import load_plan

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "your_rig.md").read_text()
BLOCK = re.compile(r"^( *)```(\w+)\n(.*?)^ *```", re.MULTILINE | re.DOTALL)
PROGRAM = """time_s,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm
0.0,0,0,0,0,0,0
0.4,10,-10,15,0.5,-0.5,0.5
1.2,10,-10,15,0.5,-0.5,0.5
"""


def executables():
    """Module of each executable, by package and name."""
    found = {}
    for path in ROOT.glob("cabols_*/setup.cfg"):
        config = configparser.ConfigParser()
        config.read(path)
        for line in config["options.entry_points"]["console_scripts"].strip().splitlines():
            name, _, target = line.partition("=")
            found[path.parent.name, name.strip()] = target.strip().partition(":")[0]
    return found


def run(line, folder):
    """Run one command of the page."""
    _, _, package, name, *words = shlex.split(line)
    command = [sys.executable, "-m", executables()[package, name], *words]
    return subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True).stdout


def edit(text, folder):
    """Make one edit: the keys of the block replace the file's."""
    head, _, body = text.partition("\n")
    path = folder / head.removeprefix("# ").strip()
    content = {**yaml.safe_load(path.read_text()), **yaml.safe_load(body)}
    path.write_text(yaml.safe_dump(content, default_flow_style=None))


def follow(section, folder):
    """Follow one section of the page; return what check_rig said and the rig that demo runs."""
    part = PAGE.partition(f"## {section}\n")[2].partition("\n## ")[0]
    said, rig = "", ""
    for _, kind, raw in BLOCK.findall(part):
        text = textwrap.dedent(raw)
        if kind == "yaml":
            edit(text, folder)
        for line in text.splitlines() if kind == "sh" else ():
            if line.startswith("ros2 run"):
                said = run(line, folder)
            else:
                rig = re.fullmatch(r'make demo ARGS="--rig (\w+)"', line)[1]
    return said, folder / rig


@pytest.fixture(scope="module")
def followed(tmp_path_factory):
    """What `follow` returns for a section, which is followed once."""

    @cache
    def of(section):
        return follow(section, tmp_path_factory.mktemp("rig"))

    return of


@pytest.mark.parametrize(("section", "cables"), [("Seven cables", 7), ("Ten cables", 10)])
def test_the_page_makes_a_rig(followed, section, cables):
    said, folder = followed(section)
    rig = load_rig(folder)
    assert rig.geometry.cables == cables == len(rig.limbs.gain) == load_plan(rig=folder).limbs
    assert f"{cables} cables of " in said
    assert ("2 cards on one clock" in said) == (cables > 8)
    assert " are allowed" in said
    assert {path.name for path in folder.iterdir()} == {file.name for file in FILES}


@pytest.mark.parametrize(("section", "cables"), [("Seven cables", 7), ("Ten cables", 10)])
def test_the_compiled_loop_reaches_a_wrench(followed, section, cables):
    _, folder = followed(section)
    desired = np.zeros((1500, 6))
    desired[300:] = [10.0, -10.0, 15.0, 0.5, -0.5, 0.5]
    trace = simulate(load_rig(folder), load_card(folder), load_plant(folder), desired)
    assert trace.tension.shape == (1500, cables)
    np.testing.assert_allclose(trace.wrench[-100:].mean(axis=0), desired[-1], atol=0.1)
    assert trace.tension[-100:].min() > 1.0


def largest_overshoot(rig, folder):
    """Of the steps of the demo's programme in the compiled loop, as the report judges them."""
    program, start = load_program("multi_axis"), 1500
    place = (rig.geometry.reference_position, rig.geometry.reference_rotation)
    shaped = fastest_preview(program, rig, *place)
    reference = shaped.reference.sample(np.arange(0.0, shaped.duration, 1e-3))
    desired = np.vstack([np.zeros((start, 6)), reference])
    trace = simulate(rig, load_card(folder), load_plant(folder), desired)
    time, felt = trace.time[start:] - trace.time[start], trace.measured[start:]
    felt = felt - trace.measured[start - 500 : start].mean(axis=0)
    # A response begins as soon as its step is known: a lead before it.
    found = analyse_steps(time, program.sample(time), felt, rig.control.rated)
    assert len(found.steps) >= 20
    return 100.0 * max(step.overshoot for step in found.steps)


@pytest.mark.parametrize(("section", "cables"), [("Seven cables", 7), ("Ten cables", 10)])
def test_steps_of_the_demo_overshoot_little(followed, section, cables):
    _, folder = followed(section)
    rig = load_rig(folder)
    assert largest_overshoot(rig, folder) < 5.0


def test_one_stiffness_for_cables_of_different_lengths_overshoots_and_is_told(followed, tmp_path):
    _, folder = followed("Seven cables")
    same = shutil.copytree(folder, tmp_path / "same")
    edit("# limbs.yaml\nstiffness: 2200.0\naxial_stiffness: null", same)
    assert 8.0 < largest_overshoot(load_rig(same), same) < 12.0
    assert any("one k_e for cables of 1.0" in line for line in check_rig(find_rig(same)))
    assert not any("one k_e" in line for line in check_rig(find_rig(folder)))


def test_a_robot_that_is_too_fast_for_the_held_cables_is_told_before_a_start(followed, tmp_path):
    _, folder = followed("Ten cables")
    fast = shutil.copytree(folder, tmp_path / "fast")
    edit("# robot.yaml\nspeed: 0.06", fast)
    with pytest.raises(ConfigError, match=r"speed of the robot: expected at most 54 mm/s.* got 60"):
        check_rig(find_rig(fast))


def test_a_rig_without_a_robot_is_checked_too():
    assert any("it may move" in line for line in check_rig(find_rig("hanging")))


def test_a_hanging_rig_that_must_not_move_is_told_why(tmp_path):
    copy = shutil.copytree(find_rig("hanging").path, tmp_path / "hangs")
    edit("# card.yaml\nswitch_active_low: true", copy)
    (said,) = (line for line in check_rig(find_rig(copy)) if "must not move" in line)
    assert "switch_active_low: true" in said


def test_a_real_second_card_is_refused_with_the_reason(followed):
    _, folder = followed("Ten cables")
    with pytest.raises(CardError, match=r"one card, got 2.*drift apart"):
        open_q8("0", load_card(folder))


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.timeout(400)
@pytest.mark.parametrize(("section", "cables"), [("Seven cables", 7), ("Ten cables", 10)])
def test_the_rig_of_the_page_runs(followed, tmp_path, section, cables):
    _, folder = followed(section)
    program = tmp_path / "short.csv"
    program.write_text(PROGRAM)
    values = {
        "rig": str(folder),
        "lockstep": True,
        "auto_start": True,
        "program": str(program),
        "exit_when_done": True,
        "output": str(tmp_path / "bag"),
    }
    ended = run_bench(values, lambda *_: None, tmp_path / "log")
    assert (ended.first, ended.code) == ("load_program", 0), (tmp_path / "log").as_posix()
    bag = read_bag(tmp_path / "bag")
    assert bag.metadata["rig"] == folder.name
    tension = bag.topics["limb_state"]["tension"]
    assert tension.shape[1] == cables
    # The last 0.1 s of the programme's hold, by the sensor, in the axes of the platform.
    turn = load_rig(folder).geometry.reference_rotation
    asked, wrench = bag.topics["desired_wrench"], bag.topics["wrench"]
    end_ns = asked.stamp_ns[asked["wrench.force.x"] > 9.999][-1]
    held = (wrench.stamp_ns > end_ns - 100_000_000) & (wrench.stamp_ns <= end_ns)
    parts = [f"wrench.{kind}.{axis}" for kind in ("force", "torque") for axis in "xyz"]
    measured = np.array([wrench[part][held].mean() for part in parts])
    desired = np.array([10.0, -10.0, 15.0, 0.5, -0.5, 0.5])
    expected = np.concatenate([turn.T @ desired[:3], turn.T @ desired[3:]])
    off = np.abs(measured - expected)
    assert (off <= np.array([1.5] * 3 + [0.3] * 3)).all(), (measured, expected)


def test_new_rig_never_overwrites(tmp_path):
    (tmp_path / "mine").mkdir()
    note = tmp_path / "mine" / "notes.txt"
    note.write_text("keep me")
    command = [sys.executable, "-m", "cabols_control.rig_tools.new_rig", "mine"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "expected nothing there" in done.stderr
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["notes.txt"]


def test_a_new_rig_may_hang_on_its_cables(tmp_path):
    make_rig(tmp_path / "crane", hanging=True)
    said = check_rig(find_rig(tmp_path / "crane"))
    assert "nothing but the cables holds the platform, and it may move (docs/safety.md)" in said
    edit("# crane/limbs.yaml\ngear: {friction_current: 0.001, load_current: 0.002}", tmp_path)
    assert any(
        line.startswith("it must not move") for line in check_rig(find_rig(tmp_path / "crane"))
    )
    with pytest.raises(UsageError, match="eight of them and no robot"):
        make_rig(tmp_path / "seven", cables=7, hanging=True)
    assert not (tmp_path / "seven").exists()


def test_copies_for_eight_cables_are_the_bench(tmp_path):
    run("ros2 run cabols_control new_rig mine", tmp_path)
    mine, bench = load_rig(tmp_path / "mine"), load_rig()
    np.testing.assert_array_equal(mine.geometry.base_points, bench.geometry.base_points)
    assert (mine.limbs, mine.control) == (bench.limbs, bench.control)


def test_new_rig_s_switches_fail_to_the_safe_side_and_the_bench_s_stay(tmp_path):
    make_rig(tmp_path / "mine")
    assert not load_card(tmp_path / "mine").switch_active_low
    assert load_card().switch_active_low
    path = tmp_path / "mine" / "card.yaml"
    path.write_text(re.sub(r"(?m)^switch_active_low.*$", "", path.read_text()))
    assert load_card(tmp_path / "mine").switch_active_low, "a file without it means what it meant"


def test_what_may_be_missing_is_said(tmp_path):
    run("ros2 run cabols_control new_rig mine", tmp_path)
    for name in ("plant.yaml", "tracker_truth.yaml"):
        (tmp_path / "mine" / name).unlink()
    said = run("ros2 run cabols_sim check_rig mine", tmp_path)
    assert "no plant.yaml" in said
    assert "no tracker_truth.yaml" in said
    assert issubclass(RigWarning, UserWarning)
