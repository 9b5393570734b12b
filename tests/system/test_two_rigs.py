# SPDX-License-Identifier: Apache-2.0
"""Two rigs on one machine, in one DDS domain: not one message of one reaches the other."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from cabols_msgs.msg import Mode

from cabols_control.bags.compare import payload_digest
from cabols_control.bags.reader import read_bag
from cabols_sim.bench.run import forgiving
from graph_harness import next_environment, run_scenario

pytestmark = [pytest.mark.ros, pytest.mark.ordinary_start, pytest.mark.timeout(600)]

STEPS = 2400
"""Samples of the lockstep runs: of the programme the first step and what follows it."""
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
    run = {"lockstep": True, "steps": STEPS, "auto_start": True, "program": "multi_axis"}
    return {**run, "seed": seed, "output": str(bag), **more}


@pytest.fixture(scope="module")
def lockstep_bags(tmp_path_factory):
    """Two rigs beside each other in one domain, and the same rigs each in a domain of its own."""
    folder, together = tmp_path_factory.mktemp("lockstep"), next_environment()
    seeds = {"rig1": 4, "rig2": 5}
    for place in ("together", "alone"):
        (folder / place).mkdir()
        running = [
            start(together, **lockstep(folder / place / name, seed, namespace=f"/{name}"))
            if place == "together"
            else start(next_environment(), **lockstep(folder / place / name, seed))
            for name, seed in seeds.items()
        ]
        for process in running:
            found, said = outcome(process)
            assert (found["first"], found["code"]) == ("plant", 0), said
    return {
        (place, name): folder / place / name for place in ("together", "alone") for name in seeds
    }


def test_each_of_two_rigs_runs_as_if_it_were_alone(lockstep_bags):
    """In lockstep, where one message of the other rig would change the bytes of the bag."""
    for name in ("rig1", "rig2"):
        together, alone = lockstep_bags["together", name], lockstep_bags["alone", name]
        assert payload_digest(together) == payload_digest(alone)
        assert read_bag(together).metadata["namespace"] == f"/{name}"
    first, second = (lockstep_bags["together", name] for name in ("rig1", "rig2"))
    assert payload_digest(first) != payload_digest(second)


def test_lockstep_same_seed_same_bytes(lockstep_bags):
    runs = (("alone", "rig1"), ("together", "rig1"), ("alone", "rig2"))
    first, second, other = (payload_digest(lockstep_bags[run]) for run in runs)
    assert first == second
    assert first["wrench"] != other["wrench"]


def test_lockstep_loses_nothing_and_loads(lockstep_bags):
    bag = read_bag(lockstep_bags["alone", "rig1"])
    state, current, command = bag["limb_state"], bag["motor_current"], bag["tension_command"]
    np.testing.assert_array_equal(state["sequence"], np.arange(1, STEPS + 1))
    np.testing.assert_array_equal(current["sequence"], np.arange(1, STEPS + 1))
    np.testing.assert_array_equal(command["sequence"], np.arange(1, STEPS + 1))
    np.testing.assert_array_equal(current["tension_sequence"], np.arange(1, STEPS + 1))
    assert Mode.LOADING in bag["mode"]["mode"]
    loaded = command["active"].astype(bool)
    assert loaded.sum() > 500
    # The first step of the programme, fx = 40 N at 1 s, is on its way.
    assert command["desired"][-1, 0] == pytest.approx(40.0) or loaded.sum() < 1000
    assert np.abs(current["current"]).max() <= 3.0
    assert state["tension"][loaded].min() > 0.5


def test_a_second_rig_in_the_same_namespace_is_refused_and_disturbs_nothing():
    environment = {}
    answers = []

    def scenario(watcher, pids):
        watcher.wait(lambda: Mode.LOADING in watcher.modes(), "LOADING")
        environment.update(next_to(pids))
        answers.append(outcome(start(environment, record=False, **PACE)))
        watcher.wait(lambda: watcher.modes()[-1] == Mode.LOADING, "LOADING still")

    # No programme: a busy computer whose loops stall while tensions grow overshoots by itself.
    values = {"auto_start": True, **PACE}
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
