# SPDX-License-Identifier: Apache-2.0
"""The supervisor of processes: how a run ends."""

from __future__ import annotations

import os
import resource
import signal
import time
from dataclasses import replace

import pytest

from cabols_control.bringup import processes
from cabols_control.bringup.processes import run
from cabols_control.bringup.specs import NodeSpec, Role


@pytest.fixture
def node(tmp_path, monkeypatch):
    """Make an executable of a few lines of shell, found as `ros2 run` finds it."""
    folder = tmp_path / "lib" / "toys"
    folder.mkdir(parents=True)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))

    def make(name, script):
        path = folder / name
        path.write_text(f"#!/bin/sh\n{script}\n")
        path.chmod(0o755)
        return NodeSpec("toys", name, (), ())

    return make


def test_run_that_takes_longer_than_its_limit_is_ended(node):
    ended = run([node("endless", "exec sleep 600")], on_line=print, limit_s=0.2)
    assert ended.overdue
    assert ended.first == ""
    assert ended.codes["endless"] != 0


def test_an_interruption_is_told_with_its_instant(node):
    began = time.monotonic()

    def interrupt(_):
        os.kill(os.getpid(), signal.SIGTERM)

    ended = run([node("endless", "exec sleep 600")], on_line=print, on_start=interrupt)
    assert ended.first == ""
    assert ended.interrupted_s >= began
    assert run([node("short", "exit 3")], on_line=print).interrupted_s is None


COUNTED = 'echo x >> "$0.count"; [ $(wc -l < "$0.count") -gt {crashes} ] && exec sleep 600; exit 7'


def starts(spec, folder):
    return (folder / "lib" / "toys" / f"{spec.executable}.count").read_text().count("x")


LASTS = 'while [ $(wc -l < "{file}") -lt {lines} ]; do sleep 0.05; done; exit 5'
"""A node that ends once a file has so many lines: the run has gone on until then."""
ENOUGH_S = 100.0


def test_node_that_may_restart_ends_nothing(node, tmp_path, monkeypatch):
    monkeypatch.setattr(processes, "RESTART_S", 0.01)
    page = replace(node("page", COUNTED.format(crashes=2)), restarts=True)
    counts = tmp_path / "lib" / "toys" / "page.count"
    counts.touch()
    other = node("other", LASTS.format(file=counts, lines=3))
    ended = run([page, other], on_line=print, limit_s=ENOUGH_S)
    assert not ended.overdue
    assert (ended.first, ended.code) == ("other", 5)
    assert starts(page, tmp_path) == 3


def test_node_that_ends_again_and_again_is_given_up(node, tmp_path, monkeypatch):
    monkeypatch.setattr(processes, "RESTART_S", 0.01)
    page = replace(node("page", COUNTED.format(crashes=1000)), restarts=True)
    told = tmp_path / "told"
    told.touch()

    def tell(name, text):
        with told.open("a") as stream:
            stream.write(f"{name}: {text}\n")

    # A line for each new start, and one that there is none any more.
    other = node("other", LASTS.format(file=told, lines=processes.RESTARTS + 1))
    ended = run([page, other], on_line=tell, limit_s=ENOUGH_S)
    assert not ended.overdue
    assert (ended.first, ended.code) == ("other", 5)
    assert starts(page, tmp_path) == 1 + processes.RESTARTS


def test_wrong_command_line_of_a_node_that_may_restart_ends_all(node):
    page = replace(node("page", "exit 2"), restarts=True)
    ended = run([page, node("other", "exec sleep 600")], on_line=print, limit_s=60.0)
    assert (ended.first, ended.code) == ("page", 2)


def test_killed_launcher_asks_its_nodes_to_end(node, tmp_path):
    """By SIGTERM, which a node under load may answer later; SIGKILL would leave the load."""
    script = (
        'trap "echo asked > $0.asked; exit 0" TERM; echo $$ > $0.pid; while :; do sleep 0.05; done'
    )
    spec = node("loaded", script)
    folder = tmp_path / "lib" / "toys"
    launcher = os.fork()
    if launcher == 0:
        run([spec], on_line=lambda *_: None)
        os._exit(0)
    wait_for(folder / "loaded.pid")
    os.kill(launcher, signal.SIGKILL)
    os.waitpid(launcher, 0)
    wait_for(folder / "loaded.asked")


def wait_for(path):
    give_up = time.monotonic() + 30.0
    while not path.exists():
        assert time.monotonic() < give_up, f"waited in vain for {path}"
        time.sleep(0.01)


TALKS = "head -c 300000 /dev/zero | tr '\\0' x; echo; echo last; printf end; exit 3"


def test_a_long_line_stops_no_node(node):
    lines = []
    ended = run([node("talks", TALKS)], on_line=lambda _, text: lines.append(text), limit_s=60.0)
    assert (ended.overdue, ended.code) == (False, 3)
    assert lines[-2:] == ["last", "end"]
    assert sum(map(len, lines)) == 300_000 + len("lastend")


@pytest.mark.parametrize("excess", [-1, 0, 1])
def test_a_long_line_has_no_empty_one_behind_it(node, excess):
    """Its newline may come alone, once all of the line has been shown."""
    length = 2 * processes.LONGEST_LINE + excess
    script = f"head -c {length} /dev/zero | tr '\\0' x; sleep 0.3; printf '\\n\\nlast\\n'; exit 3"
    lines = []
    ended = run([node("talks", script)], on_line=lambda _, text: lines.append(text), limit_s=60.0)
    assert (ended.overdue, ended.code) == (False, 3)
    assert lines[-2:] == ["", "last"]
    assert all(lines[:-2])
    assert sum(map(len, lines)) == length + len("last")


@pytest.mark.parametrize("error", [BrokenPipeError(), ValueError("closed file")])
def test_a_closed_terminal_stops_no_node(error, node, tmp_path):
    def closed(*_):
        raise error

    ended = run([node("talks", TALKS)], on_line=closed, log_folder=tmp_path / "log", limit_s=60.0)
    assert (ended.overdue, ended.code) == (False, 3)
    assert (tmp_path / "log" / "talks.log").read_text().endswith("x\nlast\nend\n")


def test_a_full_disk_stops_no_node(node, tmp_path):
    launcher = os.fork()
    if launcher == 0:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
        ended = run(
            [node("talks", "yes | head -c 300000; exit 3")],
            on_line=lambda *_: None,
            log_folder=tmp_path / "log",
            limit_s=60.0,
        )
        os._exit(0 if (ended.overdue, ended.code) == (False, 3) else 1)
    assert os.waitpid(launcher, 0)[1] == 0
    assert (tmp_path / "log" / "talks.log").stat().st_size <= 1000


def test_run_that_ends_by_itself_is_not_overdue(node):
    nodes = [node("endless", "exec sleep 600"), node("short", "exit 3")]
    ended = run(nodes, on_line=print, limit_s=600.0)
    assert not ended.overdue
    assert (ended.first, ended.code) == ("short", 3)


def test_node_that_still_starts_is_not_waited_for(node):
    """It holds the signals back, and would go on to start for seconds on a busy computer."""
    starting = replace(node("starting", "exec sleep 600"), role=Role.CONTROLLER)
    ended = run([starting, node("short", "exit 3")], on_line=print, limit_s=600.0, grace_s=300.0)
    assert (ended.first, ended.codes) == ("short", {"starting": 0, "short": 3})
