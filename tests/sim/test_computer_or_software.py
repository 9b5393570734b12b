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

import numpy as np
import pytest

from cabols_control.bringup.processes import Ended, executable_path
from cabols_control.run_report.judgement.acceptance import by_computer, checks, failures, table
from cabols_control.run_report.judgement.computer import (
    Missed,
    TimerError,
    TimerRecord,
    advice,
    is_computers,
    missed,
    timer_numbers,
)
from cabols_sim.bench import demo
from cabols_sim.bench.attempt import Attempt
from cabols_sim.bench.bare_timer import Timers, bare_timers
from cabols_sim.bench.busiest import busiest
from graph_harness import next_environment

MS = 1_000_000
FREE_MOVING = {
    "free_moving_s": 20.0,
    "free_moving_tension_max_n": 15.4,
    "free_moving_tension_min_n": 1.2,
    "free_moving_speed_max_m_per_s": 0.06,
    "free_moving_way_m": 0.4,
    "unloaded_tension_max_n": 8.0,
    "reflectors_measured": 4,
}


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
        **timer_numbers(Missed(10_000, 0, 0, 0.0)),
    }
    return {**numbers, **changed}


def record(*misses, period_ns=MS, end_ns=10_000 * MS):
    return TimerRecord(period_ns=period_ns, begin_ns=0, end_ns=end_ns, misses=misses)


def test_a_timer_counts_as_the_simulated_card_does():
    """More than half a period late counts as late; each whole period behind as one lost, too."""
    found = missed([record((5 * MS, 600_000), (9 * MS, 2_300_000))], 0, 10_000 * MS)
    assert (found.instants, found.late, found.lost) == (10_000, 4, 2)
    assert found.worst_s == pytest.approx(2.3e-3)
    assert found.together_s == 0.0
    assert missed([record((5 * MS, 600_000))], 6 * MS, 10_000 * MS).late == 0


@pytest.mark.parametrize(("behind_ns", "lost"), [(740_000, 0), (760_000, 1), (1_760_000, 2)])
def test_a_pause_that_leaves_a_loop_no_time_to_answer_loses_the_cycle(behind_ns, lost):
    assert missed([record((5 * MS, behind_ns))], 0, 10_000 * MS).lost == lost


def test_what_several_timers_missed_at_once_counts_once():
    first = record((5 * MS, 3_100_000), (50 * MS, 600_000), (60 * MS, 2 * MS))
    second = record((6 * MS, 4_100_000), (90 * MS, 1_100_000))
    found = missed([first, second], 0, 10_000 * MS)
    # From 5 to 10.1 ms one of them stood still, from 6 to 8.1 ms both.
    assert found.lost == 5 + 2 + 1
    assert found.together_s == pytest.approx(2.1e-3)
    assert found.worst_s == pytest.approx(4.1e-3)
    assert found.late == 6 + 2, "a stall of the second core makes no cycle late"


def test_pauses_of_many_timers_count_as_a_sampled_clock_counts_them():
    """Merged spans against every microsecond of a second, looked at one by one."""
    random = np.random.default_rng(5)
    for _ in range(20):
        still = np.zeros((3, 1000_000), dtype=bool)
        records = []
        for row in still:
            begins = 1000 * np.sort(random.choice(950, 8, replace=False))
            lengths = random.integers(510, 30_000, 8)
            lengths[:-1] = np.minimum(lengths[:-1], np.diff(begins))
            for begin, length in zip(begins, lengths, strict=True):
                row[begin : begin + length] = True
            misses = zip(1000 * begins, 1000 * lengths, strict=True)
            records.append(record(*((int(at), int(behind)) for at, behind in misses)))
        found = missed(records, 0, 1000 * MS)
        assert found.together_s == pytest.approx(1e-6 * longest_run(still.all(axis=0)))
        whole = np.diff(np.flatnonzero(np.diff(np.pad(still.any(axis=0), 1).astype(int))))[::2]
        assert found.lost == sum((length + 250) // 1000 for length in whole)


def longest_run(flags):
    edges = np.flatnonzero(np.diff(np.pad(flags, 1).astype(int)))
    return np.max(edges[1::2] - edges[::2], initial=0)


def test_a_timer_that_did_not_run_all_the_time_excuses_nothing():
    with pytest.raises(TimerError, match="ended early"):
        missed([record(), record(end_ns=500 * MS)], 0, 1000 * MS)
    with pytest.raises(TimerError, match="at least one"):
        missed([], 0, 1000 * MS)
    with pytest.raises(TimerError):
        TimerRecord.from_mapping({"period_ns": 1})
    assert not is_computers(5.0, 1.0, None)
    assert not is_computers(5.0, 1.0, math.nan)
    assert not is_computers(None, 1.0, 3.0)
    none = summary(late_cycles_percent=5.0, **timer_numbers(None))
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


def test_numbers_are_shares_of_the_windows_instants():
    found = timer_numbers(Missed(1000, 5, 82, 9e-3, 4e-3))
    assert found["timer_late_percent"] == pytest.approx(0.5)
    assert found["timer_lost_percent"] == pytest.approx(8.2)
    assert found["timer_behind_max_s"] == 9e-3
    assert found["timers_together_max_s"] == 4e-3


@pytest.mark.parametrize(
    ("calm", "guilty"), [(9.0, "computer"), (15.2, "software"), (None, "software")]
)
def test_a_tension_of_free_moving_is_the_computers_only_outside_the_pauses(calm, guilty):
    found = summary(**FREE_MOVING, undisturbed_free_moving_tension_max_n=calm)
    name = "free-moving: highest tension estimate"
    assert ([c.quantity for c in failures(found)] == [name]) == (guilty == "software")
    assert ([c.quantity for c in by_computer(found)] == [name]) == (guilty == "computer")


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


def test_what_a_slow_limb_law_loses_is_not_the_computers_though_it_starves_the_timers():
    """As seen on two cores, with a busy loop on one of them."""
    slow = summary(
        limb_work_median_s=1.2e-3,
        late_cycles_percent=26.4,
        lost_cycles_percent=29.5,
        timer_late_percent=35.1,
        timer_lost_percent=34.7,
    )
    blamed = {check.quantity for check in failures(slow)}
    assert blamed == {"late cycles", "lost cycles", "work of a limb controller's cycle, median"}
    assert not by_computer(slow)


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
    assert "virtual machine" not in said
    assert "virtual machine" in advice({**busy, "timers_together_max_s": 0.0063}, asked=True)
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
    assert missed([found], found.begin_ns, found.end_ns).worst_s > 0.2


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
@pytest.mark.ordinary_start
@pytest.mark.realtime
@pytest.mark.timeout(420)
def test_a_millisecond_in_the_limb_law_turns_the_demo_red(tmp_path):
    """However busy this computer is: what bare timers keep, the loop must keep."""
    output = tmp_path / "demo"
    demo = [str(executable_path("cabols_sim", "demo")), "--output", str(output)]
    done = subprocess.run(
        [*demo, "--rigid", "--program", "steps", "--slow-limb-law", "--plain", "--tries", "1"],
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


def attempt(failure, stall_ns=0):
    """How a run ended whose two timers both missed that much."""
    timers = Timers([record((5 * MS, stall_ns))] * 2 if stall_ns else [record()] * 2)
    return Attempt(failure, interrupted=False, timers=timers)


@pytest.mark.parametrize(
    ("attempts", "code"),
    [
        ([attempt("")], 0),
        # The software's own failure is never run again, nor is any after the last try.
        ([attempt("aborted"), attempt("")], 1),
        ([attempt("aborted", 52 * MS), attempt("")], 0),
        ([attempt("aborted", 52 * MS), attempt("aborted", 52 * MS), attempt("")], 1),
        ([attempt("aborted", 52 * MS), attempt("aborted")], 1),
    ],
)
def test_a_run_is_tried_again_only_where_the_computer_stood_still(
    tmp_path, monkeypatch, capsys, attempts, code
):
    left = iter(attempts)

    def run(arguments, *_):
        (arguments.output / "bag").mkdir()
        return next(left)

    monkeypatch.setattr(demo, "_attempt", run)
    monkeypatch.setattr(demo, "_report", lambda *_: 0)
    options = SimpleNamespace(rigid=True, rig="bench", speed=1.0, tries=2, output=tmp_path)
    ended, _ = demo._run(options, SimpleNamespace(name="steps"), None)
    assert ended == code
    text = capsys.readouterr()
    stalled = attempts[0].stalled
    assert (tmp_path / "bag_failed_1").exists() == stalled, "nothing that was recorded is lost"
    assert (tmp_path / "bag").exists()
    assert ("52 ms" in text.out) == stalled
    assert ("All cores stood still at once, for up to 52.0 ms" in text.out) == stalled
