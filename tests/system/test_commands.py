# SPDX-License-Identifier: Apache-2.0
"""Every executable: help starts nothing; mistakes are told at once, with exit code 2."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace

import pytest

from cabols_control import entry_points, node_command
from cabols_control.command_line import CommandParser, command, existing_file
from cabols_control.errors import CabolsError, UsageError
from cabols_control.parameters.declared import declared_parameters
from commands_table import CASES, ROOT, Executable, calls, executables, observe_all, page

pytestmark = pytest.mark.timeout(900)
"""Over a hundred processes, two at a time: some 90 s of processor time."""


@pytest.fixture(scope="module")
def outcomes():
    return observe_all()


def test_every_executable_behaves(outcomes):
    """The whole table at once, so that a failure shows all that is wrong."""
    assert {outcome.executable.name for outcome in outcomes} == {e.name for e in executables()}
    wrong = [o for o in outcomes if o.code != (0 if o.case == "--help" else 2)]
    assert not [f"{o.executable.name} {o.words}: {o.code}, {o.errors[-300:]}" for o in wrong]
    assert not [f"{o.executable.name} {o.words}: {o.started}" for o in outcomes if o.started]


def test_mistakes_take_one_line_and_no_traceback(outcomes):
    for outcome in outcomes:
        if outcome.case == "--help":
            assert f"usage: {outcome.executable.name}" in outcome.output
            assert "--version" in outcome.output
            continue
        assert outcome.errors.startswith("error: "), (outcome.words, outcome.errors)
        assert "Traceback" not in outcome.errors
        assert len(outcome.errors.strip().splitlines()) <= 2


def test_misspelt_words_come_with_a_suggestion(outcomes):
    for outcome in outcomes:
        if outcome.case == "wrong option":
            assert "unknown option --hlep (did you mean --help?)" in outcome.errors
        elif outcome.case == "misspelt parameter":
            given = outcome.words[-1].partition(":=")[0]
            assert f"unknown parameter {given} (did you mean " in outcome.errors


def test_the_page_has_every_command(outcomes):
    text = page(outcomes)
    written = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    for executable in executables():
        assert f"| `{executable.name}` | 0: help |" in text
        assert f"| `{executable.name}` | 0: help |" in written, "run `make commands-table`"


def test_a_command_that_starts_something_would_be_found(outcomes):
    """The planted violation: a table with a started command, or a wrong code, says so."""
    bad = replace(outcomes[0], started=["bags"])
    assert "STARTED" in page([bad])
    assert bad.case == CASES[0]


def test_help_of_a_node_needs_no_rclpy_and_no_compiler():
    code = (
        "import sys\n"
        "from cabols_control import entry_points\n"
        "import cabols_hw.entry_points, cabols_sim.entry_points, cabols_stiffness.entry_points\n"
        "sys.argv = ['limb_controller', '--help']\n"
        "try:\n    entry_points.limb_controller()\nexcept SystemExit: pass\n"
        "print({'rclpy', 'numba', 'numpy', 'pinocchio'} & set(sys.modules))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.splitlines()[-1] == "set()"
    assert "command_timeout (default 0.0, 0.0 to 0.2)" in done.stdout


@pytest.mark.parametrize("name", ["supervisor", "commission"])
def test_what_needs_ros_says_so_without_it(monkeypatch, capsys, name):
    monkeypatch.setattr(node_command, "find_spec", lambda name: None)
    monkeypatch.setattr(sys, "argv", [name])
    assert getattr(entry_points, name)() == 2
    assert "error: expected ROS 2 with this project's messages" in capsys.readouterr().err


def test_nodes_have_every_case():
    (node,) = [e for e in executables() if e.name == "supervisor"]
    assert node == Executable("cabols_control", "supervisor", is_node=True)
    cases = [case for case, _ in calls(node)]
    assert cases == ["--help", "wrong option", "misspelt parameter", "missing file"]


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["--ros-args", "-p", "progrm:=steps"], "progrm (did you mean program?)"),
        (["--ros-args", "-p", "load_program:scle:=2.0"], "scle (did you mean scale?)"),
        (["--ros-args", "--param", "zzz:=1"], "unknown parameter zzz\n"),
        (["--ros-args", "-r", "__ns:=/x", "--", "--scale"], "unknown option --scale"),
        (["steps"], "unexpected argument 'steps'"),
    ],
)
def test_what_a_node_does_not_know(capsys, words, problem):
    with pytest.raises(SystemExit) as ended:
        node_command.check_node_arguments(
            "load_program", "cabols_control.nodes.load_program", words
        )
    assert ended.value.code == 2
    assert problem in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["--ros-args", "-r", "__ns:=/x", "--log-level", "warn"],
        ["--ros-args", "-p", "program:=steps", "-p", "use_sim_time:=false"],
        ["--ros-args", "-p", "other_node:progrm:=steps"],
    ],
)
def test_what_ros_passes_is_left_alone(words):
    module = "cabols_control.nodes.load_program"
    node_command.check_node_arguments("load_program", module, words)


def test_parameter_files_are_read_for_this_node_alone(tmp_path, capsys):
    path = tmp_path / "parameters.yaml"
    path.write_text(
        "/**:\n  ros__parameters: {of_others: 1}\n"
        "/cabols/load_program:\n  ros__parameters: {scael: 2.0}\n"
    )
    words = ["--ros-args", "--params-file", str(path)]
    with pytest.raises(SystemExit):
        node_command.check_node_arguments(
            "load_program", "cabols_control.nodes.load_program", words
        )
    assert "scael (did you mean scale?)" in capsys.readouterr().err
    node_command.check_node_arguments("markers", "cabols_control.nodes.markers", words)


def test_declared_parameters_are_followed_into_what_a_node_uses():
    limb = {p.name: p for p in declared_parameters("cabols_control.nodes.limb_controller")}
    assert {"limbs", "command_timeout", "lockstep", "fifo_priority", "robot"} <= set(limb)
    assert "program" not in limb
    assert limb["command_timeout"].bounds == "0.0, 0.2"
    plant = {p.name: p for p in declared_parameters("cabols_sim.nodes.plant")}
    assert plant["link_port"].default == "6520"
    assert {"watchdog", "plant_file", "truth"} <= set(plant)


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (UsageError("a"), 2),
        (CabolsError("b"), 1),
        (FileNotFoundError(2, "No such file", "x"), 2),
        (OSError(28, "No space left on device", "x"), 1),
        (KeyboardInterrupt(), 130),
        (BrokenPipeError(), 1),
    ],
)
def test_exit_codes_of_errors(error, code, capsys):
    @command
    def main() -> int:
        raise error

    assert main() == code
    assert "Traceback" not in capsys.readouterr().err


def test_options_are_not_abbreviated_and_version_is_printed(capsys):
    parser = CommandParser("demo", "A demo.")
    parser.add_argument("--output")
    parser.add_argument("--file", type=existing_file)
    for words in (["--outp", "x"], ["--file", os.devnull + "/none"]):
        with pytest.raises(SystemExit) as ended:
            parser.parse_args(words)
        assert ended.value.code == 2
    with pytest.raises(SystemExit) as ended:
        parser.parse_args(["--version"])
    assert ended.value.code == 0
    assert "cabols 0.1.0" in capsys.readouterr().out


LEAVING = """
import atexit, sys, threading, time
from concurrent.futures import ThreadPoolExecutor
from cabols_control.node_command import leave

def late(word):
    time.sleep(0.2)
    sys.stdout.write(word)

atexit.register(sys.stdout.write, "registered ")
threading.Thread(target=late, args=["thread "]).start()
ThreadPoolExecutor().submit(late, "pool ")
leave(3)
"""


def test_a_node_leaves_nothing_undone_when_it_ends_its_process():
    done = subprocess.run(
        [sys.executable, "-c", LEAVING], capture_output=True, text=True, check=False
    )
    assert done.returncode == 3, done.stderr
    assert set(done.stdout.split()) == {"thread", "pool", "registered"}
    assert done.stdout.endswith("registered ")
