# SPDX-License-Identifier: Apache-2.0
"""abb_robot_client's own EGM and RWS, and the rig's clients on them, against the simulation."""

from __future__ import annotations

import json
import os
import select
import signal
import socket
import subprocess
import sys
import time

import numpy as np
import pytest
import requests
from abb_robot_client.egm import EGM
from abb_robot_client.rws import RWS, ABBException

from abb_harness import PATIENCE_S, PlantClock, quiet_port, running_controller, wait_until
from cabols_hw.abb.configurations import load_configurations
from cabols_hw.abb.egm.reader import EgmReader, PacketCounter
from cabols_hw.abb.errors import MoveAbortedError, RobotError
from cabols_hw.abb.rws.motions import RobotMover, judge_motion
from cabols_sim.devices.abb.egm_server import EgmServer
from cabols_sim.devices.abb.rapid import RapidProgram
from cabols_sim.devices.link import DEVICE_TRUTH, DeviceLink, LinkError, PlantLink
from cabols_sim.devices.robot.robot_target import NOWHERE, RobotTarget

PACKET_NS = 4_000_000


class NoMover:
    """A robot that takes commands and never moves."""

    def move(self, index, speed_scale=1.0):
        del index, speed_scale
        return 1

    def halt(self):
        return 2


@pytest.fixture
def reader():
    found = EgmReader(0)
    yield found
    found.close()


@pytest.fixture(scope="module")
def robot():
    return RobotTarget()


def make_server(robot, port) -> EgmServer:
    return EgmServer(RapidProgram(NoMover(), 13), robot.arm, port)


def make_truth(robot, number: int, loss: float = 0.0, delay_s: float = 0.0):
    truth = np.zeros(1, dtype=DEVICE_TRUTH)[0]
    truth["sequence"], truth["time_ns"] = number, 1_700_000_000_000_000_000 + number * PACKET_NS
    truth["encoders"] = robot.encoders + 0.001 * number
    truth["egm_loss"], truth["egm_delay_s"] = loss, delay_s
    return truth


# EGM ----------------------------------------------------------------------------------------


def test_their_egm_class_reads_joints_and_pose(robot):
    client = EGM(0)
    server = make_server(robot, client.socket.getsockname()[1])
    try:
        truth = make_truth(robot, 1)
        server.on_truth(truth)
        found, state = client.receive_from_robot(PATIENCE_S)
    finally:
        server.close()
        client.close()
    assert found
    np.testing.assert_allclose(state.joint_angles, np.rad2deg(truth["encoders"]), atol=1e-12)
    position, rotation, _ = robot.arm.solve(np.array(truth["encoders"]))
    np.testing.assert_allclose(state.cartesian[0], 1000.0 * position, atol=1e-9)
    w, x, y, z = state.cartesian[1]
    np.testing.assert_allclose(rotation[0, 0], 1.0 - 2.0 * (y * y + z * z), atol=1e-12)
    np.testing.assert_allclose(rotation[1, 0], 2.0 * (x * y + w * z), atol=1e-12)
    assert state.motors_on
    assert state.rapid_running
    assert state.robot_message.feedBack.time.sec == 1_700_000_000
    assert state.robot_message.feedBack.time.usec == 4000


def test_reader_takes_the_newest_and_never_answers(robot, reader):
    server = make_server(robot, reader.port)
    try:
        for number in range(1, 51):
            server.on_truth(make_truth(robot, number))
        sample = reader.take(PATIENCE_S)
        assert reader.take(0.0) is None
        assert not select.select([server._socket], [], [], 0.05)[0], "a sensor packet was sent"
    finally:
        server.close()
    assert sample.sequence == 49
    assert reader.counter.received == 50
    assert reader.counter.lost == 0
    np.testing.assert_allclose(sample.joints, robot.encoders + 0.050, atol=1e-12)
    position, _, _ = robot.arm.solve(sample.joints)
    np.testing.assert_allclose(sample.position, position, atol=1e-9)


def test_every_lost_packet_is_counted(robot, reader):
    server = make_server(robot, reader.port)
    try:
        server.on_truth(make_truth(robot, 1))
        for number in range(2, 201):
            server.on_truth(make_truth(robot, number, loss=0.3))
            if number % 20 == 0:
                reader.take(0.0)
        server.on_truth(make_truth(robot, 201))
        reader.take(PATIENCE_S)
    finally:
        server.close()
    # Binomial, 200 at 0.3: four standard deviations.
    assert 60 - 26 <= server.dropped <= 60 + 26
    assert reader.counter.lost == server.dropped
    assert reader.counter.received == 201 - server.dropped


def test_delayed_packets_come_after_their_delay_and_count_as_late(robot, reader):
    server = make_server(robot, reader.port)
    seen = []
    try:
        began = time.monotonic_ns()
        for number in range(60):
            due = began + number * PACKET_NS
            while time.monotonic_ns() < due:
                time.sleep(0.001)
            truth = make_truth(robot, number, delay_s=0.050 if number >= 20 else 0.0)
            truth["time_ns"] = due
            server.on_truth(truth)
            sample = reader.take(0.0)
            if sample is not None:
                seen.append((due, sample.robot_time_ns, reader.counter.late))
    finally:
        server.close()
    delayed = [(now, sent, late) for now, sent, late in seen if sent >= began + 20 * PACKET_NS]
    assert delayed
    assert all(now - sent >= 50_000_000 - 1000 for now, sent, _ in delayed)
    assert reader.counter.late >= len(delayed)
    assert reader.counter.lost == 0


def test_counter_counts_late_lost_repeated_and_reordered():
    counter = PacketCounter(late_after_s=0.010)
    # Controller's clock is 1000 s ahead: only differences count.
    for sequence, delay in ((0, 0.001), (1, 0.001), (4, 0.002), (3, 0.006), (3, 0.007)):
        counter.take(sequence, 1000.0 + 0.004 * sequence, 0.004 * sequence + delay)
    assert (counter.lost, counter.late) == (0, 0)
    assert counter.out_of_order == 2
    assert counter.take(5, 1000.020, 0.020 + 0.0115)
    assert counter.late == 1
    assert not counter.take(5, 1000.020, 0.040)
    assert counter.duplicates == 1
    assert counter.take(9, 1000.036, 0.037)
    assert counter.lost == 3
    assert counter.late == 1


def test_packet_from_before_the_first_makes_no_negative_count():
    counter = PacketCounter()
    assert counter.take(5, 0.020, 0.020)
    assert not counter.take(4, 0.016, 0.021)
    assert (counter.lost, counter.out_of_order) == (0, 1)


def test_controller_that_begins_anew_is_no_late_packet():
    counter = PacketCounter()
    for sequence in (5000, 5001, 0, 1):
        assert counter.take(sequence, 0.004 * sequence, 100.0 + 0.004 * sequence)
    assert counter.restarts == 1
    assert (counter.lost, counter.out_of_order, counter.late) == (0, 0, 0)


def test_garbage_and_strangers_are_refused(robot):
    reader = EgmReader(0, robot_address="127.0.0.1")
    elsewhere = EgmReader(0, robot_address="192.0.2.1")
    server, stranger = make_server(robot, reader.port), make_server(robot, elsewhere.port)
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as raw:
            raw.sendto(b"\xff\xffnot protobuf", ("127.0.0.1", reader.port))
            raw.sendto(b"", ("127.0.0.1", reader.port))
        assert reader.take(0.2) is None
        bad = make_truth(robot, 1)
        bad["encoders"][2] = np.nan
        with pytest.raises(ValueError, match="finite"):
            server.on_truth(bad)
        server.on_truth(make_truth(robot, 2))
        assert reader.take(PATIENCE_S) is not None
        stranger.on_truth(make_truth(robot, 1))
        assert elsewhere.take(0.2) is None
    finally:
        for item in (reader, elsewhere, server, stranger):
            item.close()
    assert reader.malformed == 2
    assert elsewhere.foreign == 1


def test_taken_egm_port_is_named(reader):
    with pytest.raises(RobotError, match="egm_port"):
        EgmReader(reader.port)


# RWS ----------------------------------------------------------------------------------------


@pytest.fixture
def controller():
    with running_controller(quiet_port()) as (clock, found):
        yield clock, found


def url_of(controller) -> str:
    return f"http://127.0.0.1:{controller.rws.port}"


def test_their_rws_class_reads_and_writes(controller):
    clock, found = controller
    wait_until(lambda: clock.link.clients, "link")
    rws = RWS(url_of(found))
    assert rws.get_operation_mode() == "AUTO"
    assert rws.get_controller_state() == "motoron"
    assert rws.get_execution_state().ctrlexecstate == "running"
    assert rws.get_tasks()["T_ROB1"].motiontask
    rws.set_rapid_variable_num("cabols_target", 3)
    assert rws.get_rapid_variable_num("cabols_target") == 3.0
    assert rws.get_rapid_variable("cabols/cabols_done") == "TRUE"
    rws.stop()
    assert rws.get_execution_state().ctrlexecstate == "stopped"
    rws.resetpp()
    rws.start()
    assert rws.get_execution_state().ctrlexecstate == "running"
    with pytest.raises(ABBException, match="running"):
        rws.resetpp()
    rws.set_controller_state("motoroff")
    assert rws.get_controller_state() == "motoroff"
    with pytest.raises(ABBException, match="motors are off"):
        rws.start()
    rws.close()


def test_unknown_variable_and_wrong_type_are_refused(controller):
    rws = RWS(url_of(controller[1]))
    with pytest.raises(ABBException, match="not found"):
        rws.get_rapid_variable("no_such_thing")
    with pytest.raises(ABBException, match="TRUE or FALSE"):
        rws.set_rapid_variable("cabols_go", "perhaps")
    with pytest.raises(ABBException, match="no such resource"):
        rws.get_speedratio()
    rws.close()


def test_wrong_password_is_refused(controller):
    with pytest.raises(Exception, match="401"):
        RWS(url_of(controller[1]), "Default User", "wrong").get_operation_mode()
    mover = RobotMover(url_of(controller[1]), "Default User", "wrong")
    with pytest.raises(RobotError, match="user and password") as caught:
        mover.move(1, 1.0, lambda: "")
    assert "wrong" not in str(caught.value)


def test_answer_cannot_be_replayed(controller):
    url = url_of(controller[1]) + "/rw/panel/opmode"
    first = requests.get(
        url, auth=requests.auth.HTTPDigestAuth("Default User", "robotics"), timeout=5
    )
    assert first.status_code == 200
    header = {"Authorization": first.request.headers["Authorization"]}
    assert requests.get(url, headers=header, timeout=5).status_code == 401
    assert requests.get(url, timeout=5).status_code == 401


def test_mover_moves_the_robot(controller):
    clock, found = controller
    mover = RobotMover(url_of(found), "Default User", "robotics")
    mover.move(4, PATIENCE_S, lambda: "", poll_s=0.01)
    assert clock.robot.target_index == 4
    np.testing.assert_allclose(clock.robot.encoders, load_configurations().joints(4), atol=1e-15)
    mover.move(0, PATIENCE_S, lambda: "", poll_s=0.01)
    assert clock.robot.arrived
    assert clock.robot.target_index == 0
    mover.close()


def test_pose_stream_follows_the_motion_but_not_the_deflection():
    reader = EgmReader(0)
    wrench = [40.0, 0.0, -40.0, 3.0, 0.0, 0.0]
    with running_controller(reader.port, wrench=wrench) as (clock, found):
        mover = RobotMover(url_of(found), "Default User", "robotics")
        mover.move(2, PATIENCE_S, lambda: "", poll_s=0.01)
        wait_until(lambda: not clock.robot.moving, "stands")
        reader.take(PATIENCE_S)
        sample = reader.take(PATIENCE_S)
        np.testing.assert_allclose(sample.joints, load_configurations().joints(2), atol=1e-12)
        rigid, _, _ = clock.robot.arm.solve(sample.joints)
        np.testing.assert_allclose(sample.position, rigid, atol=1e-9)
        assert np.linalg.norm(clock.robot.position - sample.position) > 1e-5
    reader.close()


def begin(clock, mover, index: int) -> None:
    mover.start_move(index)
    wait_until(lambda: clock.robot.moving, "moving")


def test_interrupted_motion_stops_the_robot_and_is_forgotten(controller):
    clock, found = controller
    mover = RobotMover(url_of(found), "Default User", "robotics")
    with pytest.raises(MoveAbortedError, match="the mode is FAULT"):
        mover.move(5, PATIENCE_S, lambda: "the mode is FAULT" if clock.robot.moving else "")
    wait_until(lambda: not clock.robot.moving, "stop")
    assert clock.robot.target_index == NOWHERE
    assert not mover.running()
    mover.move(1, PATIENCE_S, lambda: "", poll_s=0.01)
    assert clock.robot.target_index == 1


def test_start_without_reset_goes_on_as_the_real_one_does(controller):
    clock, found = controller
    mover = RobotMover(url_of(found), "Default User", "robotics")
    begin(clock, mover, 5)
    mover.abort()
    wait_until(lambda: not clock.robot.moving, "stop")
    RWS(url_of(found)).start()
    wait_until(lambda: clock.robot.arrived, "arrival")
    assert clock.robot.target_index == 5


def test_motion_that_takes_too_long_is_aborted(controller):
    clock, found = controller
    mover = RobotMover(url_of(found), "Default User", "robotics")
    clock.held.set()
    with pytest.raises(MoveAbortedError, match=r"not done within 0\.3 s"):
        mover.move(5, 0.3, lambda: "")
    assert not found.program.running


def test_emergency_stop_of_the_robot_ends_the_motion(controller):
    clock, found = controller
    mover = RobotMover(url_of(found), "Default User", "robotics")
    begin(clock, mover, 5)
    clock.coupling.faults.inject("robot_stopped")
    wait_until(lambda: not clock.robot.moving, "stop")
    wait_until(lambda: not found.program.running, "program")
    with pytest.raises(RobotError, match="RAPID has stopped"):
        mover.done()
    with pytest.raises(RobotError, match="emergencystop"):
        mover.move(1, 1.0, lambda: "")
    clock.coupling.faults.inject("none")
    wait_until(lambda: found.program.controller_state == "motoroff", "release")
    RWS(url_of(found)).set_controller_state("motoron")
    mover.move(1, PATIENCE_S, lambda: "", poll_s=0.01)
    assert clock.robot.target_index == 1


def test_unknown_configuration_and_manual_mode_are_refused(controller):
    clock, found = controller
    mover = RobotMover(url_of(found), "Default User", "robotics")
    with pytest.raises(RobotError, match="no such configuration"):
        mover.move(99, PATIENCE_S, lambda: "", poll_s=0.01)
    mover.move(1, PATIENCE_S, lambda: "", poll_s=0.01)
    found.program.operation_mode = "MANR"
    with pytest.raises(RobotError, match="AUTO"):
        mover.move(1, 1.0, lambda: "")
    assert clock.robot.target_index == 1


def test_silent_controller_does_not_hold_the_client():
    with socket.socket() as mute:
        mute.bind(("127.0.0.1", 0))
        mute.listen()
        port = mute.getsockname()[1]
        mover = RobotMover(f"http://127.0.0.1:{port}", "u", "p", timeout_s=0.2)
        with pytest.raises(RobotError, match="no answer"):
            mover.check_ready()
        with pytest.raises(RobotError, match="MAY STILL MOVE"):
            mover.abort()


@pytest.mark.parametrize(
    ("error", "done", "running", "expected"),
    [(0, True, True, True), (0, False, True, False), (0, True, False, True)],
)
def test_judgement_of_a_motion(error, done, running, expected):
    assert judge_motion(error, done, running) is expected


@pytest.mark.parametrize(("error", "running"), [(1, True), (2, True), (7, True), (0, False)])
def test_motion_that_cannot_end_is_an_error(error, running):
    with pytest.raises(RobotError, match="robot:"):
        judge_motion(error, False, running)


# Link and process ---------------------------------------------------------------------------


def test_link_repeats_a_command_until_the_plant_knows_it():
    plant = PlantLink(0)
    device = DeviceLink(plant.port)
    device.start()
    commands = []
    try:
        number = device.move(3)
        # Nothing is acknowledged before the plant speaks; copies are then told apart by number.
        for _ in range(3):
            wait_until(lambda: select.select([plant._socket], [], [], 0)[0], "command")
            commands += plant.receive()
        plant.send()
        wait_until(lambda: device.newest() is not None, "truth")
        wait_until(lambda: device._pending is None, "acknowledgement")
    finally:
        device.stop()
        plant.close()
    assert [int(c["sequence"]) for c in commands] == [number]
    assert int(commands[0]["index"]) == 3
    assert int(device.newest()["acknowledged"]) == number


def test_taken_link_port_is_named():
    plant = PlantLink(0)
    with pytest.raises(LinkError, match="link_port"):
        PlantLink(plant.port)
    plant.close()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_device_simulator_serves_and_ends(number):
    clock, reader = PlantClock(), EgmReader(0)
    arguments = ["--link-port", str(clock.link.port), "--egm-port", str(reader.port)]
    arguments += ["--rws-port", "0", "--no-tracker", "--password", "secret"]
    process = subprocess.Popen(
        [sys.executable, "-m", "cabols_sim.devices.simulator", *arguments],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
    )
    try:
        clock.start()
        line = process.stdout.readline()
        assert line.startswith("ready ")
        ports = json.loads(line[len("ready ") :])
        rws = RWS(f"http://127.0.0.1:{ports['rws']}", "Default User", "secret")
        assert rws.get_operation_mode() == "AUTO"
        assert reader.take(PATIENCE_S) is not None
        process.send_signal(number)
        assert process.wait(timeout=PATIENCE_S) == 0
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
        clock.end()
        reader.close()
