# SPDX-License-Identifier: Apache-2.0
"""A bench run from a bag: joining, judging, drawing, reporting."""

import json
import math
import re
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from cabols_control.bags.reader import Bag, Series
from cabols_control.load_programs.programs import load_program
from cabols_control.rig import load_rig
from cabols_control.run_report.judgement.computer import TimerRecord
from cabols_control.run_report.judgement.figures_of_merit import (
    RunError,
    checks,
    designed_response,
    designed_rise_time,
    join_run,
    summarise,
    table,
)
from cabols_control.run_report.judgement.stalls import stall_numbers
from cabols_control.run_report.pictures.run_figures import decimate, draw_session, write_figures
from cabols_control.run_report.report import write_report
from cabols_control.run_report.run import BenchRun
from cabols_hw.card.config import load_card
from cabols_sim.plant.closed_loop import simulate
from cabols_sim.plant.config import load_plant
from cabols_sim.reproductions import plain, reproduce_gains

START_NS = 1_700_000_000_000_000_000
BEFORE = 300
"""Samples in PRETIGHTENING."""


def series(topic: str, stamps_ns, **columns) -> Series:
    stamps = np.asarray(stamps_ns, np.int64)
    return Series(
        topic=topic,
        type_name="",
        log_time_ns=stamps.copy(),
        publish_time_ns=stamps.copy(),
        sequence=np.zeros_like(stamps),
        stamp_ns=stamps,
        stamp=1e-9 * (stamps - START_NS),
        _columns=columns,
    )


def wrench_columns(wrench):
    names = [f"wrench.{kind}.{axis}" for kind in ("force", "torque") for axis in "xyz"]
    return dict(zip(names, wrench.T, strict=True))


@cache
def trace(program: str, linear: bool):
    rig = load_rig()
    card = load_card()
    plant = load_plant()
    chosen = load_program(program)
    desired = np.array([chosen.at(t) for t in np.arange(0.0, chosen.duration, 0.001)])
    return simulate(rig, card, plant.linear() if linear else plant, desired)


def make_bag(program: str = "multi_axis", linear: bool = False) -> Bag:
    """A bag as the recorder would write it: pre-tightening, loading, stop."""
    data = trace(program, linear)
    loaded = data.time.size
    k, n = BEFORE + loaded, data.tension.shape[1]
    stamps = START_NS + np.arange(k) * 1_000_000
    sequence = np.arange(1, k + 1)
    pad = [(BEFORE, 0), (0, 0)]

    def padded(values, fill=0.0):
        return np.pad(values, pad, constant_values=fill)

    limbs = np.tile(np.arange(n), (k, 1))
    loading_ns = int(stamps[BEFORE])
    status_stamps = stamps[::100]
    zeros = np.zeros(status_stamps.size)
    topics = {
        "limb_state": series(
            "limb_state",
            stamps,
            sequence=sequence.astype(np.uint64),
            tension=padded(data.tension_estimate, np.nan),
            switch_closed=padded(data.tension > 4.7, False),
        ),
        "wrench": series("wrench", stamps, **wrench_columns(padded(data.measured))),
        "tension_command": series(
            "tension_command",
            stamps,
            sequence=sequence.astype(np.uint64),
            limb=limbs,
            tension=padded(data.tension_command),
            feasible=np.ones(k, bool),
            control=np.zeros((k, 6)),
            desired=padded(data.desired),
        ),
        # The node repeats its last stamp with zero current when it ends.
        "motor_current": series(
            "motor_current",
            [*stamps, stamps[-1]],
            sequence=np.append(sequence, k).astype(np.uint64),
            tension_sequence=np.maximum(np.append(sequence, k) - 1, 0).astype(np.uint64),
            limb=np.vstack([limbs, limbs[:1]]),
            current=np.vstack([padded(data.current), np.zeros((1, n))]),
        ),
        # The supervisor's first message comes before any sample: its stamp is zero.
        "mode": series(
            "mode",
            [0, START_NS, loading_ns, loading_ns + 200_000_000],
            mode=np.array([0, 1, 2, 2], np.uint8),
            reason=["start", "requested", "requested", "requested"],
        ),
        "loop_status": series(
            "loop_status",
            status_stamps,
            node=["plant"] * status_stamps.size,
            state=np.ones(status_stamps.size, np.uint8),
            reason=[""] * status_stamps.size,
            cycles=(np.arange(status_stamps.size) * 100).astype(np.uint64),
            lost=zeros,
            late=np.where(np.arange(status_stamps.size) > 10, 7, 2),
            infeasible=zeros,
            work_time=zeros + 1e-4,
            work_time_p99=zeros + 2e-4,
            round_trip=zeros + 5e-4,
            round_trip_p99=zeros + 9e-4,
        ),
    }
    counts = {name: len(entry) for name, entry in topics.items()}
    return Bag(Path("/bags/fake"), {"program": program, "rig": "a: 1\n"}, START_NS, topics, counts)


def make_session() -> Bag:
    """The bag above with free-moving before it, in which the platform moves, and an unloading."""
    bag = make_bag()
    stamps = bag["limb_state"].stamp_ns
    k = stamps.size
    first, loading_ns, last_ns = int(stamps[0]), int(stamps[BEFORE]), int(stamps[-1])
    end_ns = last_ns - 499_000_000
    mode = series(
        "mode",
        [0, first + 20_000_000, loading_ns - 50_000_000, loading_ns, end_ns, last_ns - 299_000_000],
        mode=np.array([0, 3, 1, 2, 5, 0], np.uint8),
        reason=["start", *["requested"] * 3, "on the way to STOPPED", "unloaded"],
    )
    tension = bag["limb_state"]["tension"].copy()
    # No zero is known until 100 ms, then all limbs hold 7 N, but for one peak and one dip.
    tension[100 : BEFORE - 50] = 7.0
    tension[120, 3], tension[150, 5] = 11.5, 2.25
    # What no phase may count: a peak in pre-tightening, the load's own, one while unloading.
    tension[BEFORE - 30, 2] = 60.0
    tension[k - 400, 1] = 44.0
    tension[k - 100, 6] = 9.5
    state = series("limb_state", stamps, **{**bag["limb_state"]._columns, "tension": tension})
    pose_ns = stamps[::4]
    seconds = 1e-9 * (pose_ns - first)
    # 50 mm/s along x from 40 to 240 ms: 10 mm.
    position = {"x": 0.05 * np.clip(seconds - 0.04, 0.0, 0.2), "y": 0 * seconds, "z": 0 * seconds}
    pose = {f"pose.position.{axis}": values for axis, values in position.items()}
    pose |= {
        f"pose.orientation.{axis}": np.full(pose_ns.size, 1.0 * (axis == "w")) for axis in "xyzw"
    }
    status = bag["loop_status"]
    size = len(status)
    return changed(
        bag,
        limb_state=state,
        mode=mode,
        platform_pose=series("platform_pose", pose_ns, **pose),
        joint_states=series("joint_states", pose_ns, position=np.tile(seconds[:, None], (1, 6))),
        reflector_measurement=series(
            "reflector_measurement",
            [first + 200_000_000, first + 210_000_000],
            success=np.array([True, False]),
        ),
        loop_status=series(
            "loop_status",
            status.stamp_ns,
            **{
                **status._columns,
                "node": ["plant" if i % 2 else "abb_tracker_bridge" for i in range(size)],
                "lost": np.minimum(np.arange(size), 6.0),
            },
        ),
    )


@cache
def session_run() -> BenchRun:
    return join_run(make_session())


def keep(entry: Series, rows) -> Series:
    columns = {
        name: [values[k] for k in np.arange(len(entry))[rows]]
        if isinstance(values, list)
        else values[rows]
        for name, values in entry._columns.items()
    }
    return series(entry.topic, entry.stamp_ns[rows], **columns)


def changed(bag: Bag, **topics: Series) -> Bag:
    return replace(bag, topics={**bag.topics, **topics})


@cache
def whole_run() -> BenchRun:
    return join_run(make_bag())


@cache
def whole_summary() -> dict:
    return summarise(whole_run(), load_rig())


def test_topics_are_joined_by_stamp():
    run, data = whole_run(), trace("multi_axis", False)
    loading = run.loading
    assert loading.sum() == data.time.size
    np.testing.assert_allclose(run.time[loading], data.time, atol=1e-9)
    np.testing.assert_array_equal(run.desired[loading], data.desired)
    np.testing.assert_array_equal(run.measured[loading], data.measured)
    np.testing.assert_array_equal(run.tension[loading], data.tension_estimate)
    np.testing.assert_array_equal(run.tension_command[loading], data.tension_command)
    # Also the last row: the zero current that ends the node does not replace the answer.
    np.testing.assert_array_equal(run.current[loading], data.current)
    assert np.isnan(run.tension[~loading]).all()
    assert run.answered.all()
    assert run.feasible.all()
    np.testing.assert_array_equal(run.command_delay[1:], 1.0)
    assert run.lost == {"limb_state": 0, "wrench": 0, "tension_command": 0, "motor_current": 0}


def test_modes_are_intervals_from_the_start_of_loading():
    modes = whole_run().modes
    assert [mode.mode.name for mode in modes] == ["STOPPED", "PRETIGHTENING", "LOADING"]
    assert modes[0].start == pytest.approx(-0.3)
    assert modes[2].start == 0.0
    assert modes[2].end == pytest.approx(whole_run().time[-1])


def test_phases_of_a_session_are_judged_apart():
    summary = summarise(session_run(), load_rig())
    assert summary["free_moving_s"] == pytest.approx(0.23)
    assert summary["free_moving_tension_max_n"] == 11.5
    assert summary["free_moving_tension_min_n"] == 2.25
    assert summary["free_moving_speed_max_m_per_s"] == pytest.approx(0.05, rel=1e-6)
    assert summary["free_moving_way_m"] == pytest.approx(0.01, rel=0.25)
    assert summary["unloading_s"] == pytest.approx(0.2)
    assert summary["unloaded_tension_max_n"] == 9.5
    assert summary["pose_packets_lost"] == 6
    assert summary["reflectors_measured"] == 1
    # The load is judged from its own samples: as without the session, but for its last half second.
    assert summary["samples"] == 20_000
    assert summary["tension_max_n"] == pytest.approx(whole_summary()["tension_max_n"])
    assert summary["loading_ended_by"].startswith("UNLOADING")
    assert len(json.dumps(summary, allow_nan=False)) > 0


@pytest.mark.parametrize(
    ("quantity", "bad"),
    [
        ("free-moving: highest tension", {"free_moving_tension_max_n": 15.1}),
        ("free-moving: lowest tension", {"free_moving_tension_min_n": 0.0}),
        ("after unloading", {"unloaded_tension_max_n": 15.1}),
        ("pose packets lost", {"pose_packets_lost": 1}),
    ],
)
def test_a_session_out_of_its_limits_is_not_met(quantity, bad):
    good = {**summarise(session_run(), load_rig()), "pose_packets_lost": 0}

    def row(summary):
        return next(check for check in checks(summary) if check.quantity.startswith(quantity))

    assert row(good).met is True
    assert row({**good, **bad}).met is False


def test_a_run_without_free_moving_has_no_such_rows():
    assert whole_summary()["free_moving_tension_max_n"] is None
    assert not [c for c in checks(whole_summary()) if "free-moving" in c.quantity]


def test_a_fault_after_the_end_is_only_the_nodes_ending():
    bag = make_session()
    status = bag["loop_status"]
    last = status.stamp_ns.size - 1
    state = np.where(np.arange(last + 1) == last, 2, 1)
    reasons = ["" if s == 1 else "no packet" for s in state]

    def faults(logged_ns):
        entry = series(
            "loop_status", status.stamp_ns, **{**status._columns, "state": state, "reason": reasons}
        )
        entry.log_time_ns[last] = logged_ns
        return summarise(join_run(changed(bag, loop_status=entry)), load_rig())["faults"]

    end_ns = int(bag["limb_state"].stamp_ns[-1])
    assert faults(end_ns + 1) == {}
    assert list(faults(end_ns - 1).values()) == ["no packet"]


def test_counters_are_those_of_loading():
    health = whole_run().health["plant"]
    assert health.late == 5
    assert health.cycles == pytest.approx(whole_run().loading.sum(), abs=100)
    assert health.round_trip == 5e-4
    summary = whole_summary()
    assert summary["late_cycles"] == 5
    assert summary["late_cycles_percent"] == pytest.approx(100 * 5 / health.cycles)
    assert summary["round_trip_p99_s"] == 9e-4


def test_missing_answers_are_nan_and_counted():
    bag = make_bag()
    k = len(bag["tension_command"])
    dropped = np.isin(np.arange(k), [BEFORE + 1000, BEFORE + 1001])
    run = join_run(
        changed(
            bag,
            tension_command=keep(bag["tension_command"], ~dropped),
            motor_current=keep(bag["motor_current"], ~np.append(dropped, False)),
            wrench=keep(bag["wrench"], np.arange(k) != BEFORE + 1500),
            limb_state=keep(bag["limb_state"], np.arange(k) != BEFORE + 1700),
        )
    )
    assert run.lost == {"limb_state": 1, "wrench": 1, "tension_command": 2, "motor_current": 2}
    assert np.isnan(run.desired[BEFORE + 1000]).all()
    assert np.isnan(run.current[BEFORE + 1001]).all()
    assert not run.answered[BEFORE + 1000]
    assert not run.feasible[BEFORE + 1000]
    summary = summarise(run, load_rig())
    assert summary["unanswered_samples"] == 2
    assert summary["rise_time_s"] == pytest.approx(whole_summary()["rise_time_s"], abs=2e-3)


def test_currents_of_two_nodes_are_put_together():
    bag = make_bag()
    answers = bag["motor_current"]
    first, second = keep(answers, slice(None)), keep(answers, slice(None))
    merged = {}
    for name in ("sequence", "tension_sequence"):
        merged[name] = np.concatenate([first[name], second[name]])
    merged["limb"] = [row[:3] for row in first["limb"]] + [row[3:] for row in second["limb"]]
    merged["current"] = [row[:3] for row in first["current"]]
    merged["current"] += [row[3:] for row in second["current"]]
    stamps = np.concatenate([first.stamp_ns, second.stamp_ns])
    run = join_run(changed(bag, motor_current=series("motor_current", stamps, **merged)))
    np.testing.assert_array_equal(run.current, whole_run().current)


def test_wrench_is_turned_to_base_axes():
    bag = make_bag()
    stamps = bag["wrench"].stamp_ns[::4]
    half = np.sqrt(0.5)
    turn = {"x": 0.0, "y": 0.0, "z": half, "w": half}
    columns = {f"pose.orientation.{axis}": np.full(stamps.size, v) for axis, v in turn.items()}
    columns |= {f"pose.position.{axis}": np.zeros(stamps.size) for axis in "xyz"}
    run = join_run(changed(bag, platform_pose=series("platform_pose", stamps, **columns)))
    straight = whole_run().measured
    # A quarter turn about z: the platform's x is the base's y.
    np.testing.assert_allclose(run.measured[:, 1], straight[:, 0], atol=1e-9)
    np.testing.assert_allclose(run.measured[:, 3], -straight[:, 4], atol=1e-9)


def test_fewer_limbs_are_no_problem():
    bag = make_bag()
    state, command, answer = (bag[t] for t in ("limb_state", "tension_command", "motor_current"))

    def six(entry, names):
        cut = {name: entry[name][:, :6] for name in names}
        return series(entry.topic, entry.stamp_ns, **{**entry._columns, **cut})

    run = join_run(
        changed(
            bag,
            limb_state=six(state, ["tension", "switch_closed"]),
            tension_command=six(command, ["limb", "tension"]),
            motor_current=six(answer, ["limb", "current"]),
        )
    )
    assert run.limbs == 6
    assert run.current.shape[1] == 6


def test_a_run_that_never_loaded_says_why():
    bag = make_bag()
    mode = series("mode", [0, START_NS], mode=np.array([0, 4]), reason=["start", "limb 3 slack"])
    with pytest.raises(RunError, match=r"reached LOADING, got the modes STOPPED .*limb 3 slack"):
        join_run(changed(bag, mode=mode))


def test_a_missing_topic_is_named():
    bag = make_bag()
    topics = {name: entry for name, entry in bag.topics.items() if name != "motor_current"}
    with pytest.raises(RunError, match="no messages of motor_current"):
        join_run(replace(bag, topics=topics))


def test_the_full_plant_keeps_what_was_designed():
    summary = whole_summary()
    assert summary["rise_time_designed_s"] == pytest.approx(0.233, abs=1e-3)
    assert summary["rise_time_s"] == pytest.approx(0.233, abs=0.01)
    assert summary["rise_time_min_s"] > 0.203
    assert summary["rise_time_max_s"] < 0.263
    assert summary["cross_coupling_percent"] < 2.0
    assert 0.3 < summary["current_peak_a"] < 3.0
    assert summary["tension_min_n"] > 0.5
    assert summary["tension_max_n"] < 150.0
    assert summary["infeasible_cycles"] == 0
    assert summary["steady_error_percent"] < 0.2
    assert summary["deviation_from_design_percent"] < 2.0
    assert all(check.met is not False for check in checks(summary))


def test_the_linear_plant_follows_the_design():
    summary = summarise(join_run(make_bag("steps", linear=True)), load_rig())
    assert summary["steps"] == 12
    assert summary["rise_time_s"] == pytest.approx(0.233, abs=0.01)
    assert summary["cross_coupling_percent"] < 0.01
    # 0.8 % of a step by sampling; the steps are at most 27 % of rated.
    assert summary["deviation_from_design_percent"] < 0.4


def test_a_smooth_programme_has_no_rise_time():
    summary = summarise(join_run(make_bag("sines")), load_rig())
    assert summary["steps"] == 0
    assert summary["rise_time_s"] is None
    assert summary["cross_coupling_percent"] is None
    assert "not measured" in table(summary)
    assert summary["deviation_from_design_percent"] < 2.0


def test_summary_is_json():
    text = json.dumps(whole_summary(), allow_nan=False)
    assert json.loads(text)["samples"] == 20500


def test_table_shows_what_is_not_met():
    bad = {**whole_summary(), "rise_time_s": 0.4, "faults": {"plant": "a gauge is saturated"}}
    lines = table(bad).splitlines()
    rise = next(line for line in lines if line.startswith("rise time"))
    assert "0.400 s" in rise
    assert "0.233 s designed" in rise
    assert rise.endswith("NOT MET")
    assert lines[-1] == "fault of plant: a gauge is saturated"
    assert max(len(line) for line in lines) < 120


def test_designed_response_is_the_transfer_function():
    rig = load_rig()
    desired = np.zeros((1000, 6))
    desired[:, 2] = 1.0
    response = designed_response(rig, desired, 1e-3)[:, 2]
    time = np.arange(1000) * 1e-3
    poles = np.array([10.0, 40.0, 90.0])
    residues = [-np.prod(poles) / (p * np.prod([q - p for q in poles if q != p])) for p in poles]
    exact = 1.0 + np.exp(-np.outer(time, poles)) @ residues
    # lfilter shows the input's effect one sample after it, as the held input does.
    np.testing.assert_allclose(response, exact, atol=1e-9)
    assert designed_rise_time(rig) == pytest.approx(0.2332, abs=1e-4)


def test_decimation_keeps_peaks_and_order():
    time = np.arange(100_000) * 1e-3
    values = np.sin(time)
    values[54_321], values[77_777], values[5] = 9.0, -9.0, np.nan
    x, y = decimate(time, values, 1000)
    assert x.size <= 1010
    assert (np.diff(x) > 0).all()
    assert (x[0], x[-1]) == (time[0], time[-1])
    assert np.nanmax(y) == 9.0
    assert np.nanmin(y) == -9.0
    assert x[np.nanargmax(y)] == time[54_321]


def test_figures_are_pictures(tmp_path):
    paths = write_figures(whole_run(), tmp_path / "new", whole_summary())
    assert {path.stem for path in paths} == {
        "overview", "wrench", "tensions", "tension_errors", "currents",
    }  # fmt: skip
    for path in paths:
        assert path.read_bytes().startswith(b"\x89PNG")
        assert path.stat().st_size > 20_000


def test_a_session_has_its_own_picture(tmp_path):
    summary = summarise(session_run(), load_rig())
    paths = write_figures(session_run(), tmp_path, summary)
    session = next(path for path in paths if path.stem == "session")
    assert session.stat().st_size > 20_000
    page = write_report(tmp_path / "report.html", session_run(), summary)
    assert "The whole session over time" in page.read_text(encoding="utf-8")
    figure = draw_session(session_run())
    text = " ".join(t.get_text() for axes in figure.axes for t in axes.texts)
    for word in ("free-moving", "loading", "unload", "at most 15 N", "tracker measures"):
        assert word in text
    labels = [axes.get_ylabel() for axes in figure.axes[1:]]
    assert all("[" in label for label in labels)


class Loads(HTMLParser):
    """Collects what a page would load, and its pictures and headings."""

    def __init__(self) -> None:
        super().__init__()
        self.loaded: list[str] = []
        self.text: list[str] = []

    def handle_starttag(self, tag, attrs):
        for name, value in attrs:
            if name in ("src", "href", "srcset", "data", "poster", "action") and value:
                self.loaded.append(value)

    def handle_data(self, data):
        self.text.append(data)


def test_report_needs_no_network(tmp_path):
    gains = reproduce_gains()
    path = write_report(
        tmp_path / "report.html",
        whole_run(),
        whole_summary(),
        {"gains": gains},
        {"commit": "<0123abc>"},
    )
    content = path.read_text(encoding="utf-8")
    page = Loads()
    page.feed(content)
    assert [
        link for link in page.loaded if not link.startswith(("#", "data:image/png;base64,"))
    ] == []
    assert not re.search(r"url\(\s*['\"]?https?:", content.partition("</style>")[0])
    assert not re.search(r"@import", content.partition("</style>")[0])
    text = "".join(page.text)
    assert gains.title in text
    assert "1.0212 *" in text
    assert "<0123abc>" in text
    assert "rise time 10-90 %" in text
    assert "PRETIGHTENING" in text
    assert sum(link.startswith("data:image/png") for link in page.loaded) == 1
    assert content.count("data-root-id") == 9
    assert path.stat().st_size < 15e6


def test_report_without_reproductions(tmp_path):
    path = write_report(tmp_path / "report.html", whole_run(), whole_summary())
    assert "Reproductions" not in path.read_text(encoding="utf-8")


def test_plain_numbers_are_json():
    assert plain({"a": (np.float64(1.5), float("nan"))}) == {"a": [1.5, None]}


def test_a_fault_while_loading_is_not_met():
    bag = make_bag()
    stamps = [0, START_NS, bag["limb_state"].stamp_ns[BEFORE], bag["limb_state"].stamp_ns[5000]]
    reason = ["start", "requested", "requested", "plant: watchdog"]
    mode = series("mode", stamps, mode=np.array([0, 1, 2, 4]), reason=reason)
    run = join_run(changed(bag, mode=mode))
    summary = summarise(run, load_rig())
    assert summary["duration_s"] == pytest.approx(4.699)
    assert summary["loading_ended_by"] == "FAULT (plant: watchdog)"
    ended = next(c for c in checks(summary) if c.quantity == "loading ended by")
    assert ended.met is False


PAUSE_S, PAUSE_AT_S = 0.08, 1.5


def paused_run() -> BenchRun:
    """A run whose bridge stood still for 80 ms, and whose wrench was 60 N off for that long."""
    run = join_run(make_bag())
    after = run.time >= PAUSE_AT_S
    wrong = after & (run.time < PAUSE_AT_S + 0.3)
    program = replace(run.program, smoothed=run.measured.copy(), command=run.measured.copy())
    program.smoothed[wrong, 0] += 60.0
    return replace(run, time=np.where(after, run.time + PAUSE_S, run.time), program=program)


def stood_still(run: BenchRun, at_s: float, behind_s: float) -> TimerRecord:
    """A bare timer that ran all the time and missed one instant."""
    begin, end = run.loading_log_ns
    miss = (begin + round(1e9 * at_s), round(1e9 * behind_s))
    return TimerRecord(1_000_000, begin - 10**9, end + 10**9, [miss])


def test_a_pause_that_bare_timers_shared_is_the_computers():
    run = paused_run()
    found = stall_numbers(run, [stood_still(run, PAUSE_AT_S, PAUSE_S)])
    assert found["bridge_pause_max_s"] == pytest.approx(PAUSE_S + 1e-3)
    assert found["bridge_pause_at_s"] == pytest.approx(PAUSE_AT_S, abs=2e-3)
    assert found["timer_pause_then_s"] == pytest.approx(PAUSE_S)
    assert found["undisturbed_error_rms_force_n"] == pytest.approx(0.0, abs=1e-9)
    assert 80.0 < found["undisturbed_percent"] < 99.0
    assert math.isnan(found["undisturbed_free_moving_tension_max_n"]), "this run has no such mode"


@pytest.mark.parametrize(("at_s", "behind_s"), [(0.2, 0.08), (PAUSE_AT_S, 0.002)])
def test_a_pause_of_the_loop_alone_excuses_nothing(at_s, behind_s):
    run = paused_run()
    found = stall_numbers(run, [stood_still(run, at_s, behind_s)])
    assert found["bridge_pause_max_s"] == pytest.approx(PAUSE_S + 1e-3)
    assert found["timer_pause_then_s"] < PAUSE_S / 2
    assert found["undisturbed_error_rms_force_n"] > 1.0


def test_too_little_that_is_undisturbed_is_not_judged():
    run = paused_run()
    found = stall_numbers(run, [stood_still(run, 0.0, 0.8 * float(run.time[run.loading][-1]))])
    assert "undisturbed_error_rms_force_n" not in found


def test_samples_that_only_the_recorder_missed_are_no_pause():
    run = join_run(make_bag())
    rows = np.ones(run.time.size, bool)
    rows[2000:2100] = False
    fields = ("time", "loading", "sequence", "measured", "answered", "uncertainty", "tension")
    parts = {name: getattr(run, name)[rows] for name in fields}
    program = replace(
        run.program,
        **{name: getattr(run.program, name)[rows] for name in ("command", "smoothed", "ahead")},
    )
    found = stall_numbers(replace(run, program=program, **parts), [])
    assert found["bridge_pause_max_s"] == pytest.approx(1e-3)
