# SPDX-License-Identifier: Apache-2.0
"""The demo and `ros2 launch` of the bench give the same time-outs, scaled with the rig's pace."""

from __future__ import annotations

import pytest

from cabols_control.bringup.argument_text import read_arguments
from cabols_control.bringup.graph import all_arguments
from cabols_sim.bench.run import forgiving, launched
from cabols_sim.bringup_nodes import LOCKSTEP_WATCH_S

BENCH = [argument for argument in all_arguments() if "bench" in argument.kinds]


def launch_values(**typed):
    """What bench.launch.py gives its nodes: launch fills in the defaults that it declared."""
    own = forgiving()
    texts = {a.name: str(own.get(a.name, a.default)) for a in BENCH}
    return launched(read_arguments(BENCH, {**texts, **typed}), set(typed))


@pytest.mark.parametrize("speed", [1.0, 0.3, 0.04, 0.01])
def test_launch_and_demo_give_the_same_time_outs(speed):
    values, demo = launch_values(speed=str(speed)), forgiving(speed)
    assert {name: values[name] for name in demo} == demo


@pytest.mark.parametrize("speed", [1.0, 0.04, 0.01])
def test_time_outs_are_within_their_bounds(speed):
    for name, value in forgiving(speed).items():
        next(argument for argument in BENCH if argument.name == name).checked(value)


def test_what_is_typed_holds():
    values = launch_values(watchdog="0.01", state_timeout="3", speed="0.5")
    assert (values["watchdog"], values["state_timeout"]) == (0.01, 3.0)


def test_lockstep_keeps_its_patience_with_a_stalled_heartbeat():
    assert launch_values(lockstep="true")["robot_watch"] == LOCKSTEP_WATCH_S
