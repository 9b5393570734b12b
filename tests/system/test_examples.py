# SPDX-License-Identifier: Apache-2.0
"""The examples run as a reader would run them, stay short, and print what they promise."""

import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_typestore

from cabols_control.bags.metadata import OfferedQos
from cabols_control.bags.writer import BagWriter
from cabols_sim.bench.run import forgiving
from graph_harness import run_scenario

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
LINES = 40
SPEED = 0.2
"""Of the simulated rig that the client drives: a busy machine upsets nothing then."""
UNITS = re.compile(r"\d (N|N m|m|um|s|l|%|A)\b|\[(N|m|um|mrad|N m/rad)[\],]")


@pytest.fixture
def bag(tmp_path):
    """A bag of wrenches and limb states that rise linearly, written message by message."""
    import numpy as np
    from cabols_msgs.msg import LimbState
    from rclpy.serialization import serialize_message

    floats = ("wound_length", "elongation", "tension", "current")
    floats += ("cable_speed", "cable_acceleration")
    store = get_typestore(Stores.ROS2_JAZZY)
    vector = store.types["geometry_msgs/msg/Vector3"]
    with BagWriter(tmp_path / "run", {}) as writer:
        writer.add_topic("wrench", "geometry_msgs/msg/WrenchStamped", OfferedQos(1, "best_effort"))
        writer.add_topic("limb_state", "cabols_msgs/msg/LimbState", OfferedQos(1, "best_effort"))
        for i in range(1, 101):
            time = store.types["builtin_interfaces/msg/Time"](100, i * 1_000_000)
            stamped = store.types["geometry_msgs/msg/WrenchStamped"](
                store.types["std_msgs/msg/Header"](time, "base"),
                store.types["geometry_msgs/msg/Wrench"](vector(0.3 * i, 0, 0), vector(0, 0, 0)),
            )
            raw = bytes(store.serialize_cdr(stamped, "geometry_msgs/msg/WrenchStamped"))
            state = LimbState(
                sequence=i,
                limb=list(range(8)),
                switch_closed=[True] * 8,
                zeroed=[True] * 8,
                **{name: np.full(8, 0.5 * i) for name in floats},
            )
            state.header.stamp.sec, state.header.stamp.nanosec = 100, i * 1_000_000
            now = 100_000_000_000 + i * 1_000_000
            writer.write("wrench", now, now, raw, i)
            writer.write("limb_state", now, now, serialize_message(state), i)
    return tmp_path / "run"


def run(name, monkeypatch, capsys, *arguments):
    """Run an example as the main module, with its folder on the path, and return what it prints."""
    monkeypatch.setattr(sys, "argv", [name, *map(str, arguments)])
    monkeypatch.syspath_prepend(str(EXAMPLES))
    for module in ("identify",):
        monkeypatch.delitem(sys.modules, module, raising=False)
    runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    return capsys.readouterr().out


def faults(text):
    """What keeps a script from being an example."""
    long = ["long"] if len(text.splitlines()) > LINES else []
    return long + ([] if text.startswith('"""') else ["says nothing"])


def numbers(text):
    return [float(found) for found in re.findall(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?", text)]


def test_there_is_a_row_for_every_example():
    text = (EXAMPLES / "README.md").read_text()
    names = {path.name for path in EXAMPLES.glob("*.py")}
    assert set(re.findall(r"\| \[(\w+\.py)\]\(\1\) \|", text)) == names


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.name)
def test_every_example_is_short_and_says_what_it_does(path):
    assert faults(path.read_text()) == []


def test_a_long_example_without_a_word_is_found():
    assert faults("x = 1\n" * 41) == ["long", "says nothing"]


@pytest.mark.parametrize(
    "name", ["distribute.py", "workspace.py", "registration.py", "closed_loop.py"]
)
def test_it_prints_something_with_units(name, monkeypatch, capsys):
    assert UNITS.search(run(name, monkeypatch, capsys))


def test_distribute_distinguishes_feasible_wrenches(monkeypatch, capsys):
    text = run("distribute.py", monkeypatch, capsys)
    assert "40 N up and 3 N m about z: feasible True" in text
    assert "400 N up and 3 N m about z: feasible False" in text


def test_identify_finds_the_stiffness_within_a_few_per_cent(monkeypatch, capsys):
    rows = run("identify.py", monkeypatch, capsys).splitlines()[-6:]
    assert [row[0] for row in rows] == list("123456")
    assert all(abs(numbers(row)[-1]) < 3.0 for row in rows)


def test_compensation_removes_most_of_the_deflection(monkeypatch, capsys):
    lines = run("compensation.py", monkeypatch, capsys).splitlines()
    without, corrected = (numbers(line)[-1] for line in lines[1:3])
    assert without > 100.0
    assert corrected < 0.05 * without


def test_closed_loop_draws_its_figure(monkeypatch, capsys, tmp_path):
    text = run("closed_loop.py", monkeypatch, capsys, tmp_path / "figure.png")
    assert "steady: 40.0" in text or "steady: 39.9" in text
    assert (tmp_path / "figure.png").stat().st_size > 5000


def test_bag_to_arrays_reads_what_was_written(bag, monkeypatch, capsys):
    text = run("bag_to_arrays.py", monkeypatch, capsys, bag)
    assert "largest force 30.0 N" in text
    assert "tensions 0.5 to 50.0 N" in text
    assert "0.10 s, 100 samples" in text


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.timeout(300)
def test_rig_client_drives_the_simulated_rig():
    printed = []

    def scenario(watcher, _):
        domain = str(watcher.context.get_domain_id())
        done = subprocess.run(
            [sys.executable, str(EXAMPLES / "rig_client.py"), str(SPEED)],
            env={**os.environ, "ROS_DOMAIN_ID": domain},
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
        )
        printed.append(done.stdout + done.stderr)
        assert done.returncode == 0, printed[0]

    _, lines, _ = run_scenario({"speed": SPEED, **forgiving(SPEED)}, scenario, watched=("mode",))
    assert printed, "\n".join(lines[-30:])
    assert "refused, as the limbs have no zero yet" in printed[0]
    assert printed[0].endswith("mode: STOPPED\n")
