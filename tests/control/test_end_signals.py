# SPDX-License-Identifier: Apache-2.0
"""Signals that come before a process can end in order wait until it can, through exec as well."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

from cabols_control.bringup.processes import executable_path
from cabols_control.end_signals import END_SIGNALS, held_by, holding_words
from graph_harness import PATIENCE_S, next_environment

HOLDS = """
import os, sys
from cabols_control import end_signals
end_signals.hold()
print("held", flush=True)
sys.stdin.readline()
os.execv(sys.executable, [sys.executable, "-c", {then!r}])
"""
HANDLES = """
from cabols_control import end_signals
heard = []
print("nothing heard" if not heard else heard, flush=True)
end_signals.handle(lambda number, frame: heard.append(number))
print("heard", heard, flush=True)
end_signals.ignore()
import os
os.kill(os.getpid(), {number})
"""
HANGS_UP = """
import os, signal
signal.signal(signal.SIGHUP, signal.SIG_IGN)
from cabols_control import end_signals
heard = []
end_signals.handle(lambda number, frame: heard.append(number))
os.kill(os.getpid(), signal.SIGHUP)
print("heard", heard)
"""


@pytest.mark.parametrize("number", END_SIGNALS)
def test_a_signal_waits_until_it_is_handled(number):
    then = HANDLES.format(number=int(number))
    command = [sys.executable, "-c", HOLDS.format(then=then)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "held\n"
        os.kill(process.pid, number)
        os.kill(process.pid, number)
        said, _ = process.communicate("go on\n", timeout=60.0)
    assert said == f"nothing heard\nheard [{int(number)}]\n"
    assert process.returncode == 0


def test_a_hang_up_that_is_ignored_stays_ignored():
    done = subprocess.run(
        [sys.executable, "-c", HANGS_UP], capture_output=True, text=True, timeout=60.0, check=True
    )
    assert done.stdout == "heard []\n"


def test_who_holds_them_is_seen_from_outside():
    then = "from cabols_control import end_signals\nend_signals.handle(print)\n"
    then += "print(1, flush=True)\ninput()\n"
    command = [sys.executable, "-c", HOLDS.format(then=then)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "held\n"
        assert held_by(process.pid)
        process.stdin.write("go on\n")
        process.stdin.flush()
        assert process.stdout.readline() == "1\n"
        assert not held_by(process.pid)
        process.communicate("\n", timeout=60.0)
    assert not held_by(process.pid)
    assert not held_by(os.getpid())


def test_end_signals_are_those_of_terminals_and_service_managers():
    assert set(END_SIGNALS) == {signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT}


@pytest.mark.ros
@pytest.mark.skipif(not holding_words(), reason="this system's env holds no signals back")
@pytest.mark.parametrize("number", END_SIGNALS)
@pytest.mark.parametrize("after_s", [0.0, 0.1, 0.3])
def test_a_node_that_is_interrupted_while_python_starts_ends_in_order(number, after_s):
    """By the words that launch files put before a node's command."""
    command = [*holding_words(), str(executable_path("cabols_control", "supervisor"))]
    environment = {**os.environ, **next_environment()}
    node = subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    give_up = time.monotonic() + PATIENCE_S
    while not held_by(node.pid) and time.monotonic() < give_up:
        time.sleep(0.001)
    time.sleep(after_s)
    node.send_signal(number)
    said, _ = node.communicate(timeout=PATIENCE_S)
    assert node.returncode == 0, said
    assert "Traceback" not in said
