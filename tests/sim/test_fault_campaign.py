# SPDX-License-Identifier: Apache-2.0
"""The fault campaign: its judgement on made-up trials, and one trial on the real graph."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from cabols_sim.fault_campaign.crossed import CROSSED, STATES, TWINS, crossed_claims
from cabols_sim.fault_campaign.judgement import Report, TrialData, judge
from cabols_sim.fault_campaign.kinds import KINDS, PROCESSES
from cabols_sim.fault_campaign.table import holds, read_trials, summarise, text
from cabols_sim.faults import KINDS as INJECTED
from graph_harness import next_environment


def data(reports, tension=50.0, current=0.0, time=None):
    time = np.arange(0.0, 0.5, 0.001) if time is None else time
    return TrialData(
        0.0,
        time,
        np.broadcast_to(np.asarray(tension, dtype=float).reshape(-1, 1), (time.size, 8)),
        np.broadcast_to(np.asarray(current, dtype=float).reshape(-1, 1), (time.size, 8)),
        np.zeros((time.size, 6)),
        tuple(reports),
    )


def report(stamp_s, node="plant", fault=True):
    return Report(stamp_s, node, "cable: limb 3", fault)


def test_nothing_said_is_undetected():
    result = judge("x", 0, data([]))
    assert not result.detected
    assert result.as_dict()["detection_time_s"] is None


def test_safe_when_the_bridge_guards_and_nothing_rises():
    result = judge("x", 0, data([report(0.02), report(0.03, "supervisor")], current=0.1))
    assert result.detected
    assert result.detection_time_s == pytest.approx(0.02)
    assert result.safe_time_s == pytest.approx(0.0)


def test_another_nodes_report_is_safe_once_the_currents_are_zero():
    time = np.arange(0.0, 0.5, 0.001)
    current = np.where(time < 0.07, 0.1, 0.0)
    result = judge("x", 0, data([report(0.02, "supervisor")], current=current, time=time))
    assert result.safe_time_s == pytest.approx(0.05, abs=0.0011)


def test_a_tension_that_still_rises_is_not_safe():
    time = np.arange(0.0, 0.5, 0.001)
    tension = np.where((time > 0.1) & (time < 0.2), 60.0, 50.0)
    result = judge("x", 0, data([report(0.02)], tension=tension, time=time))
    assert result.safe_time_s == pytest.approx(0.179, abs=0.002)
    assert result.peak_tension_n == 60.0


def test_currents_that_never_end_are_never_safe():
    result = judge("x", 0, data([report(0.02, "supervisor")], current=0.1))
    assert result.as_dict()["safe_time_s"] is None


@pytest.mark.parametrize(("current", "safe_s"), [(0.0, 0.0), (0.1, None)])
def test_frozen_bridge_is_judged_by_what_the_card_had_done(current, safe_s):
    time = np.r_[np.arange(0.0, 0.005, 0.001), np.arange(0.4, 0.6, 0.001)]
    currents = np.where(time < 0.1, 0.1, current)
    result = judge("x", 0, data([report(0.05, "abb_tracker_bridge")], current=currents, time=time))
    assert result.detection_time_s == pytest.approx(0.05)
    assert result.as_dict()["safe_time_s"] == safe_s


def test_claims_fail_for_each_reason():
    good = judge("cable breaks", 0, data([report(0.02)])).as_dict()
    order = [kind.name for kind in KINDS]
    assert holds(summarise([good], order))
    assert not holds(summarise([], order))
    for change in (
        {"detected": False},
        {"safe_time_s": 0.06},
        {"safe_time_s": None},
        {"peak_tension_n": 150.0},
    ):
        summary = summarise([good, {**good, **change}], order)
        assert not holds(summary)
        assert "cable breaks" in text(summary)


def test_torn_line_of_a_killed_campaign_is_left_out(tmp_path):
    path = tmp_path / "trials.jsonl"
    path.write_text('{"kind": "a", "seed": 1}\n{"kind": "b", "se', encoding="utf-8")
    assert read_trials(path) == [{"kind": "a", "seed": 1}]
    assert read_trials(tmp_path / "none") == []


def test_every_kind_can_be_made():
    for kind in KINDS:
        known = {"inject": {*INJECTED, "egm_bad"}, "pretighten": INJECTED, "beam": INJECTED}
        assert kind.how == "demand" or kind.fault in known.get(kind.how, PROCESSES)
    assert len({kind.name for kind in KINDS}) == len(KINDS)


def test_every_crossed_kind_can_be_made_and_has_its_twin():
    assert len(CROSSED) >= 60
    assert {kind.state for kind in CROSSED} == set(STATES)
    for kind in CROSSED:
        assert kind.fault in INJECTED
        assert not TWINS[kind.name].latent
        limbs = kind.pick_limbs(np.random.default_rng(1), np.arange(8.0))
        assert limbs == [-1] or set(limbs) <= set(range(8))
        assert (limbs != [-1]) == INJECTED[kind.fault].per_limb


def test_crossed_kinds_are_judged_by_time_but_where_a_motor_coasts_or_a_robot_brakes():
    def made(kind, **changes):
        usual = {"kind": kind, "detected": True, "safe_time_s": 0.0, "peak_tension_n": 80.0}
        return {**usual, **changes}

    fine = [
        made("loading: cable breaks"),
        made("loading: amplifier offset", safe_time_s=0.3),
        made("robot moves: motor jams", safe_time_s=0.2),
        made("free: amplifier delivers all", peak_tension_n=160.0),
    ]
    assert not any(crossed_claims(fine).values())
    broken = (
        made("free: gauge flat", detected=False),
        made("robot moves: encoder jumps", safe_time_s=0.06),
        made("loading: amplifier offset", peak_tension_n=150.1),
    )
    for trial in broken:
        assert sum(crossed_claims([*fine, trial]).values()) == 1


@pytest.mark.ros
@pytest.mark.ordinary_start
@pytest.mark.slow
@pytest.mark.realtime
@pytest.mark.timeout(240)
def test_a_trial_on_the_real_graph(tmp_path):
    """A cable breaks in the loaded rig, with robot and tracker: found, safe, written down."""
    code = "import sys\nfrom cabols_sim.ros.fault_campaign import main\nsys.exit(main())\n"
    options = ["--output", str(tmp_path), "--only", "cable breaks", "--seeds", "1"]
    options += ["--part", "nodes"]
    done = subprocess.run(
        [sys.executable, "-c", code, *options, "--speed", "0.15"],
        env={**os.environ, **next_environment()},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    summary = json.loads((tmp_path / "faults.json").read_text(encoding="utf-8"))
    assert summary["rows"][0]["detected"] == 1
    assert summary["rows"][0]["found_by"] == ["plant: cable"]
