# SPDX-License-Identifier: Apache-2.0
"""UR over RTDE: what the maker's protocol can do wrong, and what the rig's client makes of it."""

from __future__ import annotations

import inspect
import socket
import struct
import threading

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from abb_harness import PATIENCE_S, running_ur_controller, wait_until
from cabols_hw.abb.configurations import load_configurations
from cabols_hw.abb.errors import MoveAbortedError, RobotError
from cabols_hw.ur.handshake import ERROR, INPUTS, SILENCE_S, ProgramError
from cabols_hw.ur.program import program_text
from cabols_hw.ur.robot import UrRobot
from cabols_hw.ur.rtde import FORMATS, PackageType, Recipe, Splitter, packed
from cabols_sim.devices.ur.controller import UrController
from cases import outcome


@pytest.fixture
def bench():
    """The simulated arm's clock, the controller, and a client."""
    with running_ur_controller() as (clock, controller):
        robot = UrRobot("127.0.0.1", controller.rtde.port)
        yield clock, controller, robot
        robot.close()


def test_a_second_commander_is_refused_and_named(bench):
    _, controller, robot = bench
    robot.info()
    second = UrRobot("127.0.0.1", controller.rtde.port)
    with pytest.raises(RobotError, match=f"refuses .*{INPUTS[0]}.*another client"):
        second.move(1, PATIENCE_S, lambda: "")
    second.close()
    robot.move(1, PATIENCE_S, lambda: "", poll_s=0.02)


def test_a_silent_rig_stops_the_robot_by_itself(bench):
    clock, controller, robot = bench
    seen = []

    def move():
        try:
            robot.move(5, PATIENCE_S, lambda: "", poll_s=0.02)
        except RobotError as error:
            seen.append(error)

    thread = threading.Thread(target=move)
    thread.start()
    wait_until(lambda: clock.robot.moving, "motion")
    controller.program._beat_s = float("-inf")
    controller.program.write = lambda values: None
    wait_until(lambda: not clock.robot.moving, "stand")
    thread.join(PATIENCE_S)
    assert controller.program.outputs[ERROR] == ProgramError.RIG_SILENT
    assert isinstance(seen[0], MoveAbortedError)


def test_the_program_waits_as_long_as_the_rig_assumes():
    assert inspect.signature(UrController).parameters["silence_s"].default == SILENCE_S == 0.1


def test_the_program_does_not_play(bench):
    _, controller, robot = bench
    controller.program.running = False
    with pytest.raises(RobotError, match="program does not run"):
        robot.move(1, PATIENCE_S, lambda: "")


def test_a_stop_that_nobody_confirms_is_said(bench):
    _, controller, robot = bench
    robot.info()
    controller.program.step = lambda truth: None
    with pytest.raises(RobotError, match="MAY STILL MOVE"):
        robot.stop()


def test_the_stream_comes_back_after_a_restart_of_the_controller():
    with running_ur_controller() as (_, controller):
        port = controller.rtde.port
        robot = UrRobot("127.0.0.1", port)
        wait_until(lambda: robot.take(0.1) is not None, "stream")
    assert robot.take(0.05) is None
    with running_ur_controller(rtde_port=port):
        wait_until(lambda: robot.take(0.1) is not None, "stream again")
    robot.close()


def test_nobody_there_and_another_service():
    with pytest.raises(RobotError, match="no RTDE connection"):
        UrRobot("127.0.0.1", 1, timeout_s=0.5).info()
    with socket.create_server(("127.0.0.1", 0)) as other:
        silent = UrRobot("127.0.0.1", other.getsockname()[1], timeout_s=0.2)
        with pytest.raises(RobotError, match="no answer"):
            silent.info()


def test_the_program_has_every_configuration():
    stored = load_configurations()
    text = program_text(stored)
    assert text.count("return [") == len(stored)
    for index in range(len(stored)):
        angles = ", ".join(f"{angle:.9f}" for angle in stored.joints(index))
        assert f"if index == {index}:\n      return [{angles}]\n    end" in text
    # Blocks are closed: as many ends as openings.
    words = [line.strip() for line in text.splitlines()]
    opened = sum(w.endswith(":") and not w.startswith(("else", "elif")) for w in words)
    assert opened == words.count("end")
    assert 'rtde_set_watchdog("input_int_register_27", 10, "stop")' in text


VARIANTS = settings(max_examples=200, derandomize=True)
KINDS = st.sampled_from(sorted(FORMATS))


@VARIANTS
@given(types=st.lists(KINDS, min_size=1, max_size=8), data=st.data())
def test_packages_of_any_recipe_survive_any_cut(types, data):
    names = [f"field_{k}" for k in range(len(types))]
    recipe = Recipe(names, b"\x03" + ",".join(types).encode())
    form = ">B" + "".join(FORMATS[kind] for kind in types)
    count = len(struct.unpack(form, bytes(struct.calcsize(form)))) - 1
    values = data.draw(st.lists(st.integers(0, 1), min_size=count, max_size=count))
    stream = recipe.write(values) * 3
    splitter, found = Splitter(), []
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=6)))
    for begin, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        found += splitter.feed(stream[begin:end])
    assert len(found) == 3
    for package in found:
        assert package.kind == PackageType.DATA_PACKAGE
        read = recipe.read(package.payload)
        flat = [v for n in names for v in (read[n] if isinstance(read[n], tuple) else (read[n],))]
        assert flat == values


@VARIANTS
@given(st.binary(max_size=300), st.binary(max_size=60))
def test_any_bytes_are_packages_or_a_robot_error(stream, answer):
    for call in (lambda: Splitter().feed(stream), lambda: Recipe(("a", "b"), answer)):
        found = outcome(call)
        assert not isinstance(found, Exception) or "RTDE" in str(found)
        assert not isinstance(found, Exception) or isinstance(found, RobotError)


def test_packages_are_as_the_guide_writes_them():
    assert packed(PackageType.START) == bytes([0, 3, 83])
    assert packed(PackageType.REQUEST_PROTOCOL_VERSION, b"\0\2") == bytes([0, 5, 86, 0, 2])
