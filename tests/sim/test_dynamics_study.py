# SPDX-License-Identifier: Apache-2.0
"""What `make dynamics` leaves: numbers, pictures, and a failure that counts."""

from __future__ import annotations

import json

import numpy as np

from cabols_sim.studies import dynamics_results


def test_case_and_vibration_leave_pictures_and_numbers(tmp_path, monkeypatch):
    monkeypatch.setattr(dynamics_results, "TARGET_FACTORS", (1.0,))
    monkeypatch.setattr(dynamics_results, "STEP_FACTORS", (1.0,))
    output = dynamics_results.Output(tmp_path)
    dynamics_results.planar_case(output)
    dynamics_results.vibration(output)
    output.close()
    pictures = {path.stem for path in tmp_path.glob("*.png")}
    assert pictures == {
        "planar_layout",
        "planar_forces",
        "planar_tensions",
        "frequencies",
        "loops",
        "steps",
    }
    numbers = json.loads((tmp_path / "dynamics.json").read_text())
    case = numbers["planar_case_against_published"]
    assert case["without (2.28)"]["torque_nm"] > 100.0
    assert case["material"]["tension_n"] > case["without (2.28)"]["tension_n"]
    held = np.array(numbers["natural_frequencies_hz"]["held"])
    assert held.shape[1] == 6
    assert held.min() > 10.0
    steps = {
        (row["design"], row["target_of_robot_ratio"]): row for row in numbers["steps_on_targets"]
    }
    assert steps["fast", 1.0]["rise_time_s"] < 0.5 * steps["published", 1.0]["rise_time_s"]


def test_an_open_balance_fails_the_command(tmp_path, monkeypatch):
    class Motion:
        relative_imbalance = 2e-6
        work, kinetic = np.zeros((2, 3)), np.ones(2)

    class Free:
        robot = None

        def run(self):
            return Motion()

    monkeypatch.setattr(dynamics_results, "planar_motion", lambda cable: Free())
    monkeypatch.setattr(dynamics_results, "spatial_motion", lambda cable: Free())
    monkeypatch.setattr(dynamics_results, "momentum_imbalance", lambda robot, motion: (0.0, 0.0))
    monkeypatch.setattr(dynamics_results.Output, "figure", lambda *_: None)
    monkeypatch.setattr(dynamics_results.draw, "draw_balance", lambda motions: None)
    assert not dynamics_results.balances(dynamics_results.Output(tmp_path))
    Motion.relative_imbalance = 5e-7
    assert dynamics_results.balances(dynamics_results.Output(tmp_path))
    Motion.relative_imbalance = float("nan")
    assert not dynamics_results.balances(dynamics_results.Output(tmp_path))
