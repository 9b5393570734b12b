"""The supervisor of processes: how a run ends."""

from __future__ import annotations

import pytest

from cabols_control.bringup.processes import run
from cabols_control.bringup.specs import NodeSpec


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


def test_run_that_ends_by_itself_is_not_overdue(node):
    nodes = [node("endless", "exec sleep 600"), node("short", "exit 3")]
    ended = run(nodes, on_line=print, limit_s=600.0)
    assert not ended.overdue
    assert (ended.first, ended.code) == ("short", 3)
