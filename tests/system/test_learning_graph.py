# SPDX-License-Identifier: Apache-2.0
"""Learning through the real nodes: a programme that is repeated is followed better each time."""

from __future__ import annotations

import numpy as np
import pytest

from cabols_control.ros.rig_client import RigClient
from cabols_control.supervision.modes import OperatingMode
from graph_harness import Watcher, run_scenario

pytestmark = [pytest.mark.ros, pytest.mark.timeout(300)]

RUNS = 2
AMPLITUDE = (25.0, 1.5)
"""Along x [N] and about z [N m], at 0.5 Hz for two seconds."""


def six(wrench):
    """(6,) of a Wrench message."""
    return [*(getattr(wrench.force, k) for k in "xyz"), *(getattr(wrench.torque, k) for k in "xyz")]


def stamp(message):
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


def test_a_repeated_programme_is_followed_better_and_what_it_taught_is_kept(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    time = np.arange(0.0, 2.0 + 1e-9, 0.02)
    shape = np.sin(np.pi * time) * np.clip(2.0 * np.minimum(time, 2.0 - time), 0.0, 1.0)
    rows = [
        f"{t:.3f},{25.0 * s:.6f},0,0,0,0,{1.5 * s:.6f}" for t, s in zip(time, shape, strict=True)
    ]
    file = tmp_path / "repeated.csv"
    file.write_text("\n".join(["time_s,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm", *rows]) + "\n")

    def scenario(watcher: Watcher, pids: dict[str, int]) -> None:
        del pids
        with RigClient(domain=watcher.context.get_domain_id(), speed=0.2) as rig:
            rig.wait_running()
            rig.pretighten()
            rig.enter(OperatingMode.LOADING)
            for _ in range(RUNS):
                # Its frame follows the platform, so that poses that are measured count.
                assert rig.run("run_program", program=str(file), frame="platform").success

    # Not `wrench`: a reader of the loop's own topics would be taken for one of the loop.
    topics = ("mode", "loop_status", "frame_wrench", "program_wrench")
    values = {"lockstep": True, "learn": True, "console": False}
    ended, lines, watcher = run_scenario(values, scenario, topics)
    said = [line for line in lines if "of this programme" in line]
    assert ended.first == "", "\n".join(lines)
    kept = list((tmp_path / "state" / "cabols" / "learnt").glob("*.npz"))
    assert len(kept) == 1
    with np.load(kept[0]) as stored:
        history = stored["history"]
    assert history.shape == (RUNS, 6), said
    # What the topics say of it, without any of the node's own arithmetic.
    felt = {stamp(m): six(m.measured) for m in watcher.seen["frame_wrench"]}
    ran = [m for m in watcher.seen["program_wrench"] if m.lead > 0.0]
    runs = []
    # Each lasts as long as the other, so that the middle of all stamps lies between them, whichever
    # messages a busy computer has lost.
    middle = (stamp(ran[0]) + stamp(ran[-1])) / 2
    for asked in (
        [m for m in ran if stamp(m) < middle],
        [m for m in ran if stamp(m) > middle],
    ):
        both = [m for m in asked if stamp(m) in felt]
        assert len(both) > 100
        at = np.array([stamp(m) for m in both], dtype=float)
        error = np.array([np.subtract(felt[stamp(m)], six(m.smoothed)) for m in both])
        every = np.arange(at[0], at[-1], 1e6)
        runs.append(np.array([np.interp(every, at, axis) for axis in error.T]).T)
    rms = np.array([np.sqrt(np.mean(run**2, axis=0)) for run in runs])
    assert history == pytest.approx(rms, rel=0.05)
    for axis in (0, 1, 2):
        assert rms[-1, axis] < 0.75 * rms[0, axis], rms
    assert not any("compiled during operation" in line for line in lines)
