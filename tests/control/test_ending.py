# SPDX-License-Identifier: Apache-2.0
"""A process notes when it is asked to end, and that its launcher has died, even before that."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest

from cabols_control.bringup.processes import executable_path
from cabols_control.bringup.specs import LAUNCHER
from cabols_control.end_signals import END_SIGNALS
from cabols_control.ros.node import _spin

LOOKS = """
import time
from cabols_control.ros.lifetime.ending import EndedEarly, go_on, take_requests
end = take_requests()
go_on()
print("asked" if end.asked else "not asked", flush=True)
input()
give_up = time.monotonic() + 30.0
while not end.asked and time.monotonic() < give_up:
    time.sleep(0.01)
try:
    go_on()
except EndedEarly:
    print("ended early", flush=True)
"""


COMPILES = """
from cabols_control.ros.lifetime.ending import take_requests
end = take_requests()
try:
    with end.at_once({harmless}):
        print("starts", flush=True)
        input()
    print("started", end.asked, flush=True)
finally:
    print("closed", flush=True)
"""


def start(launcher, text=LOOKS):
    return subprocess.Popen(
        [sys.executable, "-c", text],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, LAUNCHER: str(launcher)},
    )


@pytest.fixture(autouse=True)
def hang_up():
    """Tests that were started by `nohup` let their children hear it all the same."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("number", END_SIGNALS)
def test_signal_during_the_start_is_noted_and_ends_it_at_the_next_point(number):
    with start(os.getpid()) as process:
        assert process.stdout.readline() == "not asked\n"
        os.kill(process.pid, number)
        said, _ = process.communicate("\n", timeout=60.0)
    assert (said, process.returncode) == ("ended early\n", 0)


@pytest.mark.parametrize(("harmless", "said"), [(True, ""), (False, "started True\nclosed\n")])
def test_start_that_opens_nothing_is_cut_short(harmless, said):
    with start(os.getpid(), COMPILES.format(harmless=harmless)) as process:
        assert process.stdout.readline() == "starts\n"
        process.send_signal(signal.SIGINT)
        heard, _ = process.communicate("\n", timeout=60.0)
    assert (heard, process.returncode) == (said, 0)


def test_launcher_that_is_no_parent_is_watched_too():
    with subprocess.Popen(["sleep", "600"]) as launcher, start(launcher.pid) as process:
        assert process.stdout.readline() == "not asked\n"
        launcher.kill()
        launcher.wait()
        said, _ = process.communicate("\n", timeout=60.0)
    assert (said, process.returncode) == ("ended early\n", 0)


def test_launcher_that_died_before_its_node_looked_is_seen():
    with subprocess.Popen(["true"]) as launcher:
        launcher.wait()
    with start(launcher.pid) as process:
        said, _ = process.communicate("\n", timeout=60.0)
        # The first point of the start is passed no more.
    assert "not asked" not in said


def test_simulated_devices_end_when_their_launcher_is_dead():
    dead = subprocess.Popen(["true"])
    dead.wait()
    command = [str(executable_path("cabols_sim", "device_simulator"))]
    command += [f"--{name}-port=0" for name in ("link", "rws", "watch", "tracker")]
    environment = {**os.environ, LAUNCHER: str(dead.pid)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout.readline().startswith("ready")
        assert process.wait(60.0) == 0


class Rests:
    """Stands for a node: it may end once it has been asked a few times."""

    end_limit_s = 60.0

    def __init__(self, kept_for):
        self.context, self.kept_for, self.spun = self, kept_for, 0
        self.runs, self.told = True, False

    def ok(self):
        return self.runs

    def try_shutdown(self):
        self.runs = False

    def end_asked(self):
        self.told = True

    def may_end(self):
        self.kept_for -= 1
        return self.kept_for < 0

    def spin_once(self, timeout_sec):
        self.spun += self.kept_for < 0
        time.sleep(min(timeout_sec, 0.01))


@pytest.mark.parametrize("kept_for", [0, 3])
def test_a_node_that_was_kept_goes_on_for_its_last_cycles(kept_for):
    node, end = Rests(kept_for), SimpleNamespace(asked=True, overdue=lambda limit_s: False)
    _spin(node, node, end)
    assert node.told
    assert (node.spun > 1) == (kept_for > 0)


def test_an_overdue_node_ends_in_any_case():
    node, end = Rests(10**9), SimpleNamespace(asked=True, overdue=lambda limit_s: limit_s == 60.0)
    _spin(node, node, end)
    assert not node.runs
