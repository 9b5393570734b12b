# SPDX-License-Identifier: Apache-2.0
"""The demo's judgement: what this computer missed is told apart from what the software missed."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from cabols_control.bringup.processes import Ended, executable_path
from cabols_control.run_report.acceptance import by_computer, checks, failures, table
from cabols_control.run_report.computer import (
    Missed,
    TimerError,
    TimerRecord,
    advice,
    is_computers,
    missed,
    timer_numbers,
)
from cabols_sim.bench import demo
from cabols_sim.bench.bare_timer import bare_timers
from cabols_sim.bench.busiest import busiest
from graph_harness import next_environment

MS = 1_000_000


def summary(**changed):
    """Numbers of a good run on an idle computer."""
    numbers = {
        "rise_time_s": 0.24,
        "rise_time_designed_s": 0.233,
        "tension_min_commanded_n": 1.0,
        "tension_max_commanded_n": 150.0,
        "tension_min_n": 1.0,
        "tension_max_n": 41.0,
        "loading_ended_by": "UNLOADING (done)",
        "loading_ended_in_fault": False,
        "overshoot_percent": 1.2,
        "steady_error_percent": 0.1,
        "steady_error_force_n": 0.01,
        "steady_error_torque_nm": 0.01,
        "cross_coupling_percent": 0.8,
        "deviation_from_design_percent": 1.6,
        "current_peak_a": 1.3,
        "current_limit_a": 3.0,
        "infeasible_cycles": 0,
        "late_cycles_percent": 0.1,
        "lost_cycles_percent": 0.0,
        "round_trip_median_s": 1.6e-4,
        "round_trip_p99_s": 3.5e-4,
        "limb_work_median_s": 1.2e-4,
        "recorder_lost": 0,
        "free_moving_s": 0.0,
        "pose_packets_lost": 0,
        "faults": {},
        **timer_numbers([Missed(10_000, 0, 0, 0.0)]),
    }
    return {**numbers, **changed}


def record(*misses, period_ns=MS, end_ns=10_000 * MS):
    return TimerRecord(period_ns=period_ns, begin_ns=0, end_ns=end_ns, misses=misses)


def test_a_timer_counts_as_the_simulated_card_does():
    """More than half a period late counts as late; each whole period behind as one lost, too."""
    found = missed(record((5 * MS, 600_000), (9 * MS, 2_300_000)), 0, 10_000 * MS)
    assert (found.instants, found.late, found.lost) == (10_000, 4, 2)
    assert found.worst_s == pytest.approx(2.3e-3)
    assert missed(record((5 * MS, 600_000)), 6 * MS, 10_000 * MS).late == 0


def test_a_timer_that_did_not_run_all_the_time_excuses_nothing():
    with pytest.raises(TimerError, match="ended early"):
        missed(record(end_ns=500 * MS), 0, 1000 * MS)
    with pytest.raises(TimerError):
        TimerRecord.from_mapping({"period_ns": 1})
    assert not is_computers(5.0, 1.0, None)
    assert not is_computers(5.0, 1.0, math.nan)
    assert not is_computers(None, 1.0, 3.0)
    none = summary(late_cycles_percent=5.0, **timer_numbers([]))
    assert [check.quantity for check in failures(none)] == ["late cycles"]


@pytest.mark.parametrize(
    ("late", "timer", "guilty"),
    [
        (0.5, 0.0, "nobody"),
        (4.0, 3.5, "computer"),
        (4.0, 0.0, "software"),
        # What lies beyond the timer's misses and the limit is the loop's own, however busy it is.
        (9.0, 4.0, "software"),
    ],
)
def test_late_cycles_are_the_computers_only_as_far_as_a_bare_timer_is_late(late, timer, guilty):
    found = summary(late_cycles_percent=late, timer_late_percent=timer)
    assert ([c.quantity for c in failures(found)] == ["late cycles"]) == (guilty == "software")
    assert ([c.quantity for c in by_computer(found)] == ["late cycles"]) == (guilty == "computer")


def test_lost_cycles_and_samples_likewise():
    busy = {"timer_lost_percent": 0.3, "timer_lost_cycles": 30}
    excused = summary(lost_cycles_percent=0.261, recorder_lost=20, **busy)
    assert not failures(excused)
    assert {c.quantity for c in by_computer(excused)} == {
        "lost cycles",
        "samples lost by the recorder",
    }
    own = summary(lost_cycles_percent=50.0, recorder_lost=5000, **busy)
    assert {c.quantity for c in failures(own)} == {"lost cycles", "samples lost by the recorder"}


def test_a_stall_of_any_core_may_lose_a_cycle_but_only_the_bridges_makes_it_late():
    found = timer_numbers([Missed(1000, 5, 2, 3e-3), Missed(1000, 100, 80, 9e-3)])
    assert found["timer_late_percent"] == pytest.approx(0.5)
    assert found["timer_lost_percent"] == pytest.approx(8.2)
    assert found["timer_behind_max_s"] == 9e-3


@pytest.mark.parametrize(
    ("undisturbed", "guilty"), [(0.4, "computer"), (0.7, "software"), (None, "software")]
)
def test_an_error_is_the_computers_only_if_it_is_met_outside_the_pauses(undisturbed, guilty):
    previewed = {"preview_lead_s": 0.1, "smoothed_error_rms_force_n": 1.4}
    previewed |= {"smoothed_error_rms_torque_nm": 0.05}
    if undisturbed is not None:
        previewed["undisturbed_error_rms_force_n"] = undisturbed
    found = summary(**previewed)
    name = "rms against the smoothed command, force"
    assert ([c.quantity for c in failures(found)] == [name]) == (guilty == "software")
    assert ([c.quantity for c in by_computer(found)] == [name]) == (guilty == "computer")


def test_a_slow_limb_law_is_the_softwares_on_the_busiest_computer():
    slow = summary(limb_work_median_s=1.1e-3, timer_late_percent=90.0, timer_lost_percent=90.0)
    assert [c.quantity for c in failures(slow)] == ["work of a limb controller's cycle, median"]


def test_figures_of_the_rig_are_never_the_computers():
    bad = summary(overshoot_percent=9.0, timer_late_percent=50.0, timer_lost_percent=50.0)
    assert [c.quantity for c in failures(bad)] == ["overshoot"]


def test_the_table_names_the_loop_that_missed_and_the_advice():
    busy = summary(late_cycles_percent=4.0, timer_late_percent=3.9, timer_behind_max_s=0.012)
    text = table(busy)
    assert "this computer" in text
    assert "NOT MET" not in text
    assert "bare timer beside: late" in text
    said = advice(busy, asked=True)
    assert "--speed 0.3" in said
    assert "--plain" in said
    assert "close what else runs" in said
    assert "--plain" not in advice(busy, asked=False)
    assert all(check.verdict in ("met", "NOT MET", "this computer", "") for check in checks(busy))


def test_the_bare_timer_finds_a_computer_that_stands_still():
    """Its process is stopped for a while: it must count what it missed."""
    code = "from cabols_sim.bench.bare_timer import main; main()"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as timer:
        assert timer.stdout.readline() == "ready\n"
        time.sleep(0.1)
        timer.send_signal(signal.SIGSTOP)
        time.sleep(0.3)
        timer.send_signal(signal.SIGCONT)
        time.sleep(0.1)
        timer.terminate()
        content = json.loads(timer.communicate(timeout=300)[0])
    found = TimerRecord.from_mapping(content)
    assert missed(found, found.begin_ns, found.end_ns).worst_s > 0.2


def test_timers_run_while_the_body_does_and_leave_their_records():
    with bare_timers({}, 0.5) as timers:
        time.sleep(2.0)
    (found,) = timers.records
    assert found.period_ns == 2 * MS
    assert found.end_ns > found.begin_ns


def test_a_busy_program_is_named():
    code = "import time\nend = time.monotonic() + 60\nwhile time.monotonic() < end: pass"
    with subprocess.Popen([sys.executable, "-c", code]) as burner:
        try:
            found = busiest(count=50, over_s=1.0)
        finally:
            burner.kill()
    assert any(name.startswith("python") for name, _ in found)


@pytest.mark.ros
@pytest.mark.realtime
@pytest.mark.timeout(420)
def test_a_millisecond_in_the_limb_law_turns_the_demo_red(tmp_path):
    """However busy this computer is: what bare timers keep, the loop must keep."""
    output = tmp_path / "demo"
    demo = [str(executable_path("cabols_sim", "demo")), "--output", str(output)]
    done = subprocess.run(
        [*demo, "--rigid", "--program", "steps", "--slow-limb-law", "--plain"],
        env={**os.environ, **next_environment()},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 1, done.stdout + done.stderr
    found = json.loads((output / "summary.json").read_text())
    assert found["limb_work_median_s"] > 1e-3
    assert "work of a limb controller's cycle, median" in found["not_met_by_software"]
    assert "lost cycles" in found["not_met_by_software"]


@pytest.mark.parametrize(
    ("interrupted_s", "failure"), [(1.0, ""), (3.0, "aborted"), (None, "aborted")]
)
def test_what_follows_an_interruption_is_no_failure(interrupted_s, failure):
    """The robot's motion is aborted by Ctrl-C, however long the nodes then take to end."""
    session = SimpleNamespace(error=RuntimeError("aborted"), error_s=2.0)
    ended = Ended("", 0, {}, interrupted_s=interrupted_s)
    assert demo._failure(ended, session, Path("log")) == failure
