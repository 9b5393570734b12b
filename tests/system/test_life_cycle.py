# SPDX-License-Identifier: Apache-2.0
"""The real graph under load: whatever ends a process, the cables are unloaded first."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from cabols_msgs.msg import Mode

from cabols_sim.bench.run import forgiving
from graph_harness import run_scenario

pytestmark = [pytest.mark.ros, pytest.mark.ordinary_start, pytest.mark.timeout(240)]

LOADED = {"auto_start": True, "program": "ramps", "speed": 0.2, **forgiving(0.2)}
"""Who ends, and how, is judged: a computer that stalls is not the subject here."""
CONTROL_PATH = ("plant", "limb_controller", "wrench_controller", "supervisor")
UNLOADED_N = 10.0


def loading(watcher):
    watcher.wait(lambda: Mode.LOADING in watcher.modes(), "LOADING")
    watcher.wait(lambda: max(watcher.seen["limb_state"][-1].tension) > 12.0, "tensions above 12 N")


def gone(pid):
    """Whether a process has ended; its launcher may not have collected it yet."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except (FileNotFoundError, ProcessLookupError):
        return True


def test_all_signals_at_once_under_load():
    """As by a terminal's Ctrl-C, twice, and SIGTERM: the control path ends by itself."""

    def scenario(watcher, pids):
        loading(watcher)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGINT):
            for name in CONTROL_PATH:
                os.kill(pids[name], number)
        watcher.wait(lambda: all(gone(pids[name]) for name in CONTROL_PATH), "their end")

    ended, _, watcher = run_scenario(LOADED, scenario, keep_going=True)
    assert max(watcher.seen["limb_state"][-1].tension) < UNLOADED_N
    assert Mode.UNLOADING in watcher.modes()
    assert Mode.FAULT not in watcher.modes()
    assert {ended.codes[name] for name in CONTROL_PATH} == {0}


def test_bridge_whose_supervisor_is_dead_unloads_by_itself():
    def scenario(watcher, pids):
        loading(watcher)
        os.kill(pids["supervisor"], signal.SIGKILL)
        os.kill(pids["plant"], signal.SIGTERM)
        watcher.wait(lambda: gone(pids["plant"]), "the bridge's end")

    ended, lines, watcher = run_scenario(LOADED, scenario, keep_going=True)
    assert ended.codes["plant"] == 0
    held = max(watcher.seen["limb_state"][-1].tension)
    assert held < UNLOADED_N or any("the gears hold:" in line for line in lines)


@pytest.mark.long
def test_lost_recorder_ends_a_test_in_order(tmp_path):
    def scenario(watcher, pids):
        loading(watcher)
        os.kill(pids["recorder"], signal.SIGKILL)
        watcher.wait(lambda: watcher.modes()[-1] == Mode.STOPPED, "STOPPED")

    values = {**LOADED, "record": True, "output": str(tmp_path / "bag")}
    ended, _, watcher = run_scenario(values, scenario)
    assert ended.first == "recorder"
    assert max(watcher.seen["limb_state"][-1].tension) < UNLOADED_N
    assert Mode.FAULT not in watcher.modes()


@pytest.mark.long
def test_crashed_console_ends_no_test():
    def scenario(watcher, pids):
        loading(watcher)
        first = pids["console"]
        os.kill(first, signal.SIGKILL)
        watcher.wait(lambda: pids["console"] != first, "another console")
        seen = len(watcher.seen["limb_state"])
        watcher.wait(lambda: len(watcher.seen["limb_state"]) > seen + 500, "limb states")
        assert watcher.modes()[-1] == Mode.LOADING

    run_scenario({**LOADED, "console": True, "console_port": 0}, scenario)


@pytest.mark.long
def test_without_load_every_process_ends_one_by_one():
    """None waits for another, which the 5 s for unloading would be."""

    def scenario(watcher, pids):
        wanted = {"limb_controller", "wrench_controller", "plant", "supervisor"}
        watcher.wait(
            lambda: {m.node for m in watcher.seen["loop_status"] if m.state == 1} >= wanted,
            "the control path",
        )
        for name, pid in pids.items():
            os.kill(pid, signal.SIGTERM)
            watcher.wait(lambda pid=pid: gone(pid), f"the end of {name}")

    ended, _, watcher = run_scenario({"speed": 0.2}, scenario, keep_going=True)
    assert set(ended.codes.values()) == {0}, ended.codes
    assert Mode.UNLOADING not in watcher.modes()
