# SPDX-License-Identifier: Apache-2.0
"""Commands in README and pages: each is known, names what exists, and runs when it is followed."""

import shlex
import sys

import pytest

import follow_docs
from follow_docs import LEAVE, LONG, RUN, SERVE

PAGE = """
Text with `make inline` and `ros2 run cabols_control console` and `no command`.

```sh
# only a comment
make demo ARGS="--rigid"      # and why
ros2 launch cabols_hw rig.launch.py \\
    robot:=true
```

```
make not-a-shell-block
```
"""


@pytest.fixture(scope="module")
def commands():
    return follow_docs.all_commands(follow_docs.ROOT)


def test_every_command_is_known(commands):
    assert [command for command in commands if not command.action] == []


def test_every_command_left_out_has_a_reason(commands):
    assert [c for c in commands if c.action == LEAVE and not c.reason] == []


def test_every_command_names_what_exists(commands):
    assert follow_docs.missing(follow_docs.ROOT, commands) == []


def test_the_two_commands_are_followed(commands):
    actions = {command.text: command.action for command in commands}
    assert (actions["make demo"], actions["make test"]) == (RUN, LONG)


def test_commands_of_a_page():
    found = [command.text for command in follow_docs.commands_in(PAGE, "page.md")]
    assert found == [
        'make demo ARGS="--rigid"',
        "ros2 launch cabols_hw rig.launch.py robot:=true",
        "make inline",
        "ros2 run cabols_control console",
    ]


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("make no-such-target", "no such target"),
        ("ros2 run cabols_control no_such_node", "no such executable"),
        (".venv/lib/cabols_nothing/demo", "no such executable"),
        ("ros2 launch cabols_hw nothing.launch.py", "no such launch file"),
    ],
)
def test_a_command_that_names_nothing_is_found(text, complaint):
    command = follow_docs.Command("page.md", text, *follow_docs.judge(text))
    found = follow_docs.missing(follow_docs.ROOT, [command])
    assert len(found) == 1
    assert complaint in found[0]


def test_a_command_that_no_rule_knows_fails(tmp_path):
    command = follow_docs.Command("page.md", "frobnicate", *follow_docs.judge("frobnicate"))
    assert follow_docs.follow(command, tmp_path).result == "failed"


def test_ros2_run_becomes_the_executable():
    command = follow_docs.Command("p", "ros2 run cabols_sim demo --plain", RUN, "")
    assert command.words == [".venv/lib/cabols_sim/demo", "--plain"]


def server(code, said=""):
    """A server that says something and ends when it is interrupted.

    Not a shell: one that is interrupted as it forks waits for its child, or dies.
    """
    text = (
        "import os, signal, time\n"
        f"end = lambda *_: (print({said!r}, flush=True), os._exit({code}))\n"
        "signal.signal(signal.SIGINT, end)\n"
        "time.sleep(600)"
    )
    return f"{shlex.quote(sys.executable)} -c {shlex.quote(text)}"


@pytest.mark.parametrize(
    ("text", "action", "result"),
    [
        ("sh -c 'echo done'", RUN, "passed"),
        ("sh -c 'exit 1'", RUN, "failed"),
        ("sh -c 'echo done'", SERVE, "failed"),  # a server that ends by itself
        (server(0), SERVE, "passed"),
        (server(0, "Traceback"), SERVE, "failed"),
        (server(3), SERVE, "failed"),
    ],
)
def test_what_becomes_of_a_command(text, action, result, tmp_path, monkeypatch):
    monkeypatch.setitem(follow_docs.PATIENCE_S, SERVE, 4.0)
    command = follow_docs.Command("p", text, action, "")
    assert follow_docs.follow(command, tmp_path).result == result
