# SPDX-License-Identifier: Apache-2.0
"""A process that the tests' fork server starts is what subprocess.Popen would have started."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

import forked_start
from cabols_control.bringup.processes import _prepare_child, executable_path
from cabols_control.bringup.specs import LAUNCHER, ONE_BLAS_THREAD
from forked_start import ForkedPopen, forked_starts

MODULE = "cabols_sim_probe"
PROBE = """
import atexit, json, os, signal, stat, sys, threading, time

def kind(number):
    mode = os.fstat(number).st_mode
    return [stat.S_ISFIFO(mode), stat.S_ISREG(mode), stat.S_ISCHR(mode)]

way = sys.argv[1]
if way == "facts":
    umask = os.umask(0)
    os.umask(umask)
    parent = os.getppid()
    print(json.dumps({
        "argv": sys.argv,
        "name": __name__,
        "path": [sys.path[0], *(each for each in sys.path if "cabols" in each)],
        "environment": dict(os.environ),
        "cwd": os.getcwd(),
        "is child of": parent,
        "leads its group": os.getpgrp() == os.getpid(),
        "in the parent's group": os.getpgrp() == os.getpgid(parent),
        "leads its session": os.getsid(0) == os.getpid(),
        "in the parent's session": os.getsid(0) == os.getsid(parent),
        "cores": sorted(os.sched_getaffinity(0)),
        "policy": os.sched_getscheduler(0),
        "niceness": os.nice(0),
        "umask": umask,
        "blocked": sorted(signal.pthread_sigmask(signal.SIG_BLOCK, ())),
        "signals": {n: str(signal.getsignal(n)) for n in sorted(signal.valid_signals())},
        "open": {n: kind(n) for n in range(1024) if os.path.exists(f"/proc/self/fd/{n}")},
        "buffered": [sys.stdout.line_buffering, sys.stderr.line_buffering],
        "threads": [each.name for each in threading.enumerate()],
        "given": sys.stdin.read(),
    }))
    print("numba" in sys.modules, file=sys.stderr)
elif way == "words":
    atexit.register(print, "at the end")
    print("without a flush")
    sys.exit("one last word")
elif way == "threads":
    import rclpy
    started = [threading.Thread(target=time.sleep, args=(0.2,)) for _ in range(30)]
    for each in started:
        each.start()
    for each in started:
        each.join()
    # One that has been joined lives on in the kernel for a moment.
    counts = [len(os.listdir("/proc/self/task")) for _ in range(60) if not time.sleep(0.01)]
    print(min(counts))
elif way == "code":
    sys.exit(3)
elif way == "error":
    raise ValueError("a wrong value")
elif way == "killed":
    os.kill(os.getpid(), signal.SIGKILL)
elif way == "interrupted":
    print("ready", flush=True)
    while True:
        time.sleep(0.1)
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / f"{MODULE}.py").write_text(PROBE)
    return tmp_path


def started(popen, folder, way="facts", text="", **options):
    """Output, errors and exit code of the probe."""
    options = {"cwd": folder, "env": {**os.environ, **ONE_BLAS_THREAD}, **options}
    process = popen(
        [sys.executable, "-m", MODULE, way, "and more"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )
    said, wrong = process.communicate(text, timeout=60.0)
    return said, wrong, process.returncode


def facts(popen, folder, **options):
    said, wrong, code = started(popen, folder, text="some text", **options)
    assert code == 0, wrong
    return json.loads(said), wrong.strip()


def pass_one(folder):
    return {"pass_fds": (os.open(folder / f"{MODULE}.py", os.O_RDONLY),)}


WAYS = {
    "plain": lambda folder: {},
    "environment": lambda folder: {"env": {"PATH": "x", **kept(os.environ), "A": "b=ü"}},
    "path": lambda folder: {
        "env": {**os.environ, **ONE_BLAS_THREAD, "PYTHONPATH": os.pathsep.join(sys.path)}
    },
    "session": lambda folder: {"start_new_session": True},
    "group": lambda folder: {"process_group": 0},
    "umask": lambda folder: {"umask": 0o27},
    "descriptor": pass_one,
    "launcher's node": lambda folder: {"preexec_fn": partial(_prepare_child, 3, True)},
}


def kept(environment):
    return {**forked_start.read_at_start(environment), **ONE_BLAS_THREAD}


@pytest.mark.parametrize("way", WAYS)
def test_it_has_what_an_ordinary_process_has(folder, way):
    options = WAYS[way](folder)
    ordinary, alone = facts(subprocess.Popen, folder, **options)
    forked, shared = facts(ForkedPopen, folder, **options)
    assert forked == ordinary
    assert forked["is child of"] == os.getpid()
    assert (alone, shared) == ("False", "True"), "imported before"


def test_it_is_in_the_state_that_its_parent_is_in_now(folder):
    cores, before = os.sched_getaffinity(0), signal.getsignal(signal.SIGHUP)
    try:
        os.sched_setaffinity(0, {min(cores)})
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGUSR1})
        ordinary, _ = facts(subprocess.Popen, folder)
        forked, _ = facts(ForkedPopen, folder)
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGUSR1})
        signal.signal(signal.SIGHUP, before)
        os.sched_setaffinity(0, cores)
    assert forked == ordinary
    assert forked["cores"] == [min(cores)]
    assert forked["blocked"] == [signal.SIGUSR1]


@pytest.mark.parametrize(
    "lost",
    [
        {"cwd": "/"},
        {"environment": {}},
        {"blocked": frozenset({signal.SIGUSR2})},
        {"ignored": frozenset({signal.SIGHUP})},
        {"umask": 0o77},
        {"new_session": True},
    ],
    ids=str,
)
def test_what_gets_lost_on_the_way_is_seen(folder, monkeypatch, lost):
    ordinary, _ = facts(subprocess.Popen, folder)
    whole = forked_start._request
    monkeypatch.setattr(forked_start, "_request", lambda asked: replace(whole(asked), **lost))
    if "cwd" in lost:
        monkeypatch.setattr(forked_start, "MODULE", MODULE, raising=False)
        _, wrong, code = started(ForkedPopen, folder)
        assert code == 1, "the module is in its working directory"
        assert MODULE in wrong
        return
    assert facts(ForkedPopen, folder)[0] != ordinary


@pytest.mark.parametrize(
    ("way", "code"),
    [("words", 1), ("threads", 0), ("code", 3), ("error", 1), ("killed", -signal.SIGKILL)],
)
def test_it_ends_as_an_ordinary_process(folder, way, code):
    ordinary = started(subprocess.Popen, folder, way)
    forked = started(ForkedPopen, folder, way)
    assert forked[2] == ordinary[2] == code
    assert forked[0] == ordinary[0]
    assert forked[1].splitlines()[-1:] == ordinary[1].splitlines()[-1:]


@pytest.mark.parametrize("popen", [subprocess.Popen, ForkedPopen])
def test_an_interrupt_ends_it(folder, popen):
    with popen(
        [sys.executable, "-m", MODULE, "interrupted"],
        cwd=folder,
        env={**os.environ, **ONE_BLAS_THREAD},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        assert process.stdout.readline() == "ready\n"
        process.send_signal(signal.SIGINT)
        assert process.wait(60.0) == -signal.SIGINT


def test_a_function_that_fails_before_the_start_is_said(folder):
    with pytest.raises(subprocess.SubprocessError, match="ZeroDivisionError"):
        started(ForkedPopen, folder, preexec_fn=partial(divmod, 1, 0))
    assert facts(ForkedPopen, folder), "and the server goes on"


@pytest.mark.parametrize(
    "options",
    [
        {"env": {**os.environ, "OPENBLAS_NUM_THREADS": "2"}},
        {"env": {**os.environ, **ONE_BLAS_THREAD, "PYTHONHASHSEED": "1"}},
        {"env": {**os.environ, **ONE_BLAS_THREAD, "PYTHONPATH": "/elsewhere"}},
        {"preexec_fn": lambda: None},
    ],
    ids=["threads", "hash seed", "path", "local function"],
)
def test_what_no_running_process_can_become_is_started_the_ordinary_way(folder, options):
    _, shared = facts(ForkedPopen, folder, **options)
    assert shared == "False"


def test_other_commands_are_started_the_ordinary_way():
    with forked_starts():
        code = "import sys; print('numba' in sys.modules)"
        command = [sys.executable, "-c", code]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
    assert subprocess.Popen is not ForkedPopen


def test_an_executable_of_this_project_is_forked(monkeypatch):
    asked = []
    whole = forked_start._request
    monkeypatch.setattr(forked_start, "_request", lambda a: asked.append(whole(a)) or asked[-1])
    command = [str(executable_path("cabols_control", "limb_controller")), "--nothing"]
    environment = {**os.environ, **ONE_BLAS_THREAD}
    with forked_starts():
        done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert asked[0] is not None
    assert done.returncode == 2
    assert "limb_controller --help" in done.stderr


LAUNCHES = """
import os, subprocess, sys, time
from functools import partial
from cabols_control.bringup.processes import _prepare_child
from forked_start import ForkedPopen, server

child = ForkedPopen(
    [sys.executable, "-m", sys.argv[1], "interrupted"],
    env=server().environment,
    stdout=subprocess.PIPE,
    preexec_fn=partial(_prepare_child, 0, False),
)
child.stdout.readline()
print(child.pid, server().process.pid, flush=True)
time.sleep(600.0)
"""


def is_gone(pid):
    """Whether a process has ended; one that nobody has waited for yet has."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except FileNotFoundError:
        return True
    return stat.rpartition(")")[2].split()[0] == "Z"


def test_it_ends_with_its_launcher_and_so_does_the_server(folder):
    harness = str(Path(forked_start.__file__).parent)
    path = os.pathsep.join([harness, *(p for p in sys.path if p)])
    with subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(LAUNCHES), MODULE],
        cwd=folder,
        env={**os.environ, **ONE_BLAS_THREAD, "PYTHONPATH": path, LAUNCHER: ""},
        stdout=subprocess.PIPE,
        text=True,
    ) as launcher:
        pids = list(map(int, launcher.stdout.readline().split()))
        assert len(pids) == 2
        assert not any(map(is_gone, pids))
        launcher.kill()
        launcher.wait()
    give_up = time.monotonic() + 60.0
    while not all(map(is_gone, pids)):
        assert time.monotonic() < give_up, pids
        time.sleep(0.01)
