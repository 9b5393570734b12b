# SPDX-License-Identifier: Apache-2.0
"""Two rigs on one machine, in one DDS domain: not one message of one reaches the other."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from cabols_msgs.msg import Mode

from cabols_control.bags.compare import payload_digest
from cabols_control.bags.reader import read_bag
from cabols_sim.bench.run import forgiving
from graph_harness import next_environment, run_scenario

pytestmark = [pytest.mark.ros, pytest.mark.timeout(600)]

PACE = {"speed": 0.1, **forgiving(0.1)}
CHILD = """
import json, os, sys
from cabols_sim.bench.run import run_bench
values, environment = json.loads(sys.argv[1]), json.loads(sys.argv[2])
ended = run_bench(values, environment=environment)
print(json.dumps({"first": ended.first, "code": ended.code, "codes": ended.codes}))
"""


def start(environment, **values):
    """Start a rig with a launcher of its own."""
    return subprocess.Popen(
        [sys.executable, "-c", CHILD, json.dumps(values), json.dumps(environment)],
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def outcome(process):
    said, _ = process.communicate(timeout=300.0)
    return json.loads(said.splitlines()[-1]), said


def lockstep(bag, seed, **more):
    run = {"lockstep": True, "steps": 1200, "auto_start": True, "program": "multi_axis"}
    return {**run, "seed": seed, "output": str(bag), **more}


def test_each_of_two_rigs_runs_as_if_it_were_alone(tmp_path):
    """In lockstep, where one message of the other rig would change the bytes of the bag."""
    together = next_environment()
    seeds = {"rig1": 4, "rig2": 5}
    running = [
        start(together, **lockstep(tmp_path / name, seed, namespace=f"/{name}"))
        for name, seed in seeds.items()
    ]
    for process in running:
        found, said = outcome(process)
        assert (found["first"], found["code"]) == ("plant", 0), said
    alone = {name: tmp_path / f"{name}_alone" for name in seeds}
    running = [start(next_environment(), **lockstep(alone[n], seeds[n])) for n in seeds]
    for process in running:
        found, said = outcome(process)
        assert (found["first"], found["code"]) == ("plant", 0), said
    for name in seeds:
        assert payload_digest(tmp_path / name) == payload_digest(alone[name])
        assert read_bag(tmp_path / name).metadata["namespace"] == f"/{name}"
    assert payload_digest(tmp_path / "rig1") != payload_digest(tmp_path / "rig2")


def test_a_second_rig_in_the_same_namespace_is_refused_and_disturbs_nothing():
    environment = {}
    answers = []

    def scenario(watcher, pids):
        watcher.wait(lambda: Mode.LOADING in watcher.modes(), "LOADING")
        environment.update(next_to(pids))
        answers.append(outcome(start(environment, record=False, **PACE)))
        watcher.wait(lambda: watcher.modes()[-1] == Mode.LOADING, "LOADING still")

    values = {"auto_start": True, "program": "ramps", **PACE}
    ended, lines, watcher = run_scenario(values, scenario)
    found, said = answers[0]
    assert found["first"], said
    assert 2 in found["codes"].values(), said
    assert "running already" in said
    assert Mode.FAULT not in watcher.modes(), (watcher.reasons(Mode.FAULT), said)
    assert ended.first == "", lines[-20:]
    assert set(ended.codes.values()) == {0}


@pytest.mark.long
@pytest.mark.realtime
@pytest.mark.parametrize(
    "run", [{"robot": True, "speed": 0.3, **forgiving(0.3)}, forgiving()], ids=["robots", "rigid"]
)
def test_each_rig_hears_its_own_processes_alone(tmp_path, run):
    """Every mode carries its supervisor's session, every report its process's number."""
    together = next_environment()
    run = {**run, "auto_start": True, "program": "steps", "exit_when_done": True}
    running = [
        start(together, **run, seed=seed, output=str(tmp_path / name), namespace=f"/{name}")
        for seed, name in enumerate(("rig1", "rig2"))
    ]
    for process in running:
        found, said = outcome(process)
        assert (found["first"], found["code"]) == ("load_program", 0), said
    sessions, instances = [], []
    for name in ("rig1", "rig2"):
        bag = read_bag(tmp_path / name, ["mode", "loop_status"])
        sessions.append(set(bag["mode"]["session"]))
        reports = bag["loop_status"]
        instances.append(set(zip(reports["node"], reports["instance"], strict=True)))
        assert len(sessions[-1]) == 1
        assert len(instances[-1]) == len({node for node, _ in instances[-1]}) > 4
        # At the start some come before a node follows its supervisor, in any rig.
        loading = bag["mode"].stamp_ns[bag["mode"]["mode"] == Mode.LOADING].min()
        later = reports.stamp_ns > loading
        dropped = set(zip(reports["node"], reports["dropped"], later, strict=True))
        assert len([node for node, _, loaded in dropped if loaded]) == len(instances[-1])
    assert sessions[0].isdisjoint(sessions[1])
    assert {n for _, n in instances[0]}.isdisjoint({n for _, n in instances[1]})


def next_to(pids):
    """Environment of a running rig."""
    content = Path(f"/proc/{next(iter(pids.values()))}/environ").read_bytes()
    pairs = dict(part.split(b"=", 1) for part in content.split(b"\0") if b"=" in part)
    names = ("ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE")
    return {name: pairs[name.encode()].decode() for name in names}
