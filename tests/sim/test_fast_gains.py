# SPDX-License-Identifier: Apache-2.0
"""The faster control design on the full plant: through the real nodes, and over many plants."""

from __future__ import annotations

import os

import numpy as np
import pytest

from cabols_control.errors import OutOfRangeError
from cabols_control.load_programs.programs import LoadProgram
from cabols_control.rig import load_rig
from cabols_control.rig_folder import rig_file
from cabols_control.run_report.judgement.figures_of_merit import designed_rise_time
from cabols_sim.bench import run as bench_run
from cabols_sim.plant.closed_loop import simulate
from cabols_sim.reproductions.common import bench
from cabols_sim.studies import fast_gains_proof, gain_search
from graph_harness import next_environment

CONTROL = rig_file("control_fast.yaml")


def test_design_differs_from_the_published_one_in_poles_and_zero_alone(rig):
    fast = load_rig(control=CONTROL).control
    for name in type(fast).__dataclass_fields__:
        same = getattr(fast, name) == getattr(rig.control, name)
        assert same == (name not in ("poles", "zero")), name


@pytest.mark.parametrize("axis", [0, 4])
def test_brisk_design_follows_5_hz_by_feedback_alone(axis):
    """Half a newton metre, or five newtons, on the whole plant with friction and backlash."""
    rig = load_rig(control=rig_file("control_brisk.yaml"))
    time = np.arange(0.0, 1.2, 0.001)
    desired = np.zeros((1700, 6))
    desired[500:, axis] = (5.0 if axis < 3 else 0.5) * np.sin(2.0 * np.pi * 5.0 * time)
    plant = bench("").plant
    trace = simulate(rig, bench("").card, plant, desired)
    turn = np.exp(-2j * np.pi * 5.0 * time[-800:])
    gain = abs(np.mean(trace.measured[-800:, axis] * turn) / np.mean(desired[-800:, axis] * turn))
    assert gain > 10.0 ** (-3.0 / 20.0)
    assert np.abs(trace.current[-800:]).max() < 1.0


def test_rise_time_is_halved_over_drawn_plants(rig):
    fast = load_rig(control=CONTROL)
    assert designed_rise_time(fast) < 0.5 * designed_rise_time(rig)
    found = fast_gains_proof.draw_plants(fast, 4)
    assert found["rise_time_median_max_s"] <= 0.12
    assert found["overshoot_max_percent"] < 5.0
    assert found["current_peak_max_a"] < 3.0
    assert fast_gains_proof.show_drawn(found)
    assert not fast_gains_proof.show_drawn({**found, "current_peak_max_a": 3.0})


@pytest.mark.ros
@pytest.mark.timeout(300)  # 17 s of processor time
def test_rise_overshoot_and_current_through_the_real_nodes(tmp_path, monkeypatch):
    """40 N and back within two seconds, bag and all; `make fast-gains` runs whole programmes."""
    program = tmp_path / "step.csv"
    rows = [
        "time_s,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm",
        "0,0,0,0,0,0,0",
        "0.399,0,0,0,0,0,0",
        "0.4,40,0,0,0,0,0",
        "1.3,40,0,0,0,0,0",
    ]
    program.write_text("\n".join(rows) + "\n")
    environment = next_environment()
    monkeypatch.setattr(bench_run, "isolated_environment", lambda: {**os.environ, **environment})
    summary = fast_gains_proof.run_program(str(program), CONTROL, tmp_path / "run")
    assert summary["steps"] == 1
    assert summary["rise_time_s"] <= 0.12
    assert summary["rise_time_max_s"] <= 0.12
    assert summary["overshoot_percent"] < 5.0
    assert summary["current_peak_a"] < 3.0
    assert summary["tension_min_n"] > 0.5
    assert summary["cross_coupling_percent"] < 2.0
    assert fast_gains_proof.show(summary)
    assert not fast_gains_proof.show({**summary, "overshoot_percent": 5.0})


def test_missed_promises_are_said(capsys):
    good = {key: 0.0 for _, key, *_ in fast_gains_proof.ROWS}
    assert fast_gains_proof.show({**good, "faults": {}})
    assert not fast_gains_proof.show({**good, "current_peak_a": 3.0, "faults": {}})
    assert "NOT MET" in capsys.readouterr().out
    assert not fast_gains_proof.show({**good, "rise_time_s": None, "faults": {}})
    assert not fast_gains_proof.show({**good, "faults": {"plant": "tension"}})


def test_search_finds_a_design_within_its_limits(rig, card, plant_config):
    """Two generations on one step: not the best, but what it says is what the plant does."""
    time, wrench = np.array([0.0, 0.3, 1.3]), np.zeros((3, 6))
    wrench[1:, 0] = 40.0
    program = LoadProgram("step", time, wrench, held=True)
    said = []
    poles, zero, found = gain_search.search(
        rig, card, plant_config, program, 0.15, generations=2, progress=said.append
    )
    assert len(said) == 2
    again = gain_search.redesign(rig, poles, zero)
    trace = simulate(again, card, plant_config, gain_search.program_samples(program))
    assert gain_search.judge(trace, again) == found
    assert found.rise_time_max < 0.155
    assert found.overshoot < 0.05
    assert found.peak_current < 3.0
    with pytest.raises(OutOfRangeError, match="rise_max_s"):
        gain_search.search(rig, card, plant_config, program, float("nan"))
