# SPDX-License-Identifier: Apache-2.0
"""Laser tracker: the service seen by a stranger, our client, the beam, the noise and the drift."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from cabols_control.errors import ConfigError, OutOfRangeError, ShapeError
from cabols_control.registration.reflectors import register_pose
from cabols_hw.tracker import tracker_pb2, tracker_pb2_grpc
from cabols_hw.tracker.beam import beam_axes
from cabols_hw.tracker.client import TrackerClient, TrackerError
from cabols_hw.tracker.config import load_tracker_config
from cabols_sim.devices.tracker.config import DriftConfig, load_tracker_truth
from cabols_sim.devices.tracker.drift import Drift, displaced
from cabols_sim.devices.tracker.model import Loss, TrackerModel
from cabols_sim.devices.tracker.server import TrackerServer

PROTO = Path(tracker_pb2.__file__).with_name("tracker.proto")
STILL = DriftConfig(warm_up_radial=0.0, warm_up_angle=0.0, wander_radial=0.0, wander_angle=0.0)
RECORD = np.dtype(
    [
        ("time_ns", "i8"),
        ("position", "f8", 3),
        ("rotation", "f8", (3, 3)),
        ("speed", "f8"),
        ("beam_blocked", "u1"),
    ]
)


class Rig:
    """The truth's seam. Each look at it lets `step_s` of the rig's time pass."""

    def __init__(self, step_s=0.01):
        self.step_s = step_s
        self.record = np.zeros(1, RECORD)
        self.record["position"] = [0.0, 1.234615, 0.792718]
        self.record["rotation"] = Rotation.from_euler("XYZ", [4, -3, 8], degrees=True).as_matrix()
        self.runs = True
        self.velocity = np.zeros(3)
        self.block_after = None
        self.lock = threading.Lock()

    def newest(self):
        with self.lock:
            if not self.runs:
                return None
            self.record["time_ns"] += round(1e9 * self.step_s)
            self.record["position"] += self.velocity * self.step_s
            self.record["speed"] = np.linalg.norm(self.velocity)
            if self.block_after is not None:
                self.block_after -= 1
                self.record["beam_blocked"] = self.block_after < 0
            return self.record[0].copy()

    @property
    def pose(self):
        return self.record["position"][0], self.record["rotation"][0]


def in_tracker(truth, rig, index):
    """Where a reflector truly is, written out anew."""
    position, rotation = rig.pose
    point = position + rotation @ np.array(truth.reflectors[index])
    return truth.base_rotation.T @ (point - np.array(truth.base_position))


@pytest.fixture
def rig():
    return Rig()


@pytest.fixture
def truth():
    return load_tracker_truth()


@pytest.fixture
def config():
    return load_tracker_config()


@pytest.fixture
def serve(rig, truth):
    started = []

    def start(settings=truth, source=rig):
        server = TrackerServer(source, settings)
        port = server.start()
        started.append(server)
        return f"127.0.0.1:{port}"

    yield start
    for server in started:
        server.stop()


@pytest.fixture
def client(serve, config, rig):
    with TrackerClient(serve(), config, lambda i: config.expected(i, *rig.pose)) as made:
        yield made


def protoc(folder, *arguments):
    command = [sys.executable, "-m", "grpc_tools.protoc", f"-I{folder}", *arguments]
    subprocess.run(command, check=True, timeout=60, capture_output=True)


def test_generated_code_is_that_of_the_proto(tmp_path):
    root = PROTO.parents[2]
    out = tmp_path / "set.bin"
    protoc(root, f"--descriptor_set_out={out}", str(PROTO))
    fresh = FileDescriptorSet.FromString(out.read_bytes()).file[0]
    for message in fresh.message_type:
        for field in message.field:
            field.ClearField("json_name")
    committed = FileDescriptorProto()
    tracker_pb2.DESCRIPTOR.CopyToProto(committed)
    assert committed == fresh, "tracker_pb2*.py are stale: docs/tracker.md says how to renew them"
    methods = {method.name for service in fresh.service for method in service.method}
    assert methods == {n for n in vars(tracker_pb2_grpc.LaserTrackerServicer) if n[0] != "_"}
    package = f"{fresh.package}.{fresh.service[0].name}"
    text = Path(tracker_pb2_grpc.__file__).read_text()
    assert all(f"'/{package}/{name}'" in text for name in methods)


STRANGER = """
import json, sys
import grpc, stranger_pb2 as pb, stranger_pb2_grpc as rpc

assert "cabols_hw" not in sys.modules
channel = grpc.insecure_channel(sys.argv[1], options=[("grpc.enable_http_proxy", 0)])
tracker = rpc.LaserTrackerStub(channel)
x, y, z = map(float, sys.argv[2:])
target = pb.Target(position_m=pb.Vector3(x=x, y=y, z=z))
found = {}
found["early"] = tracker.Measure(pb.MeasureRequest(averaging_time_s=0.1), timeout=20).reason
aim = tracker.Aim(pb.AimRequest(target=target), timeout=20)
found["aim"] = [aim.success, aim.reason]
search = tracker.Search(pb.SearchRequest(target=target, search_radius_m=0.03), timeout=20)
found["search"] = [search.success, search.position_m.x, search.position_m.y, search.position_m.z]
one = tracker.Measure(pb.MeasureRequest(averaging_time_s=0.5, rate_hz=200), timeout=20)
p, c = one.position_m, one.covariance_m2
found["measure"] = [one.success, p.x, p.y, p.z]
found["covariance"] = [[c.xx, c.xy, c.xz], [c.xy, c.yy, c.yz], [c.xz, c.yz, c.zz]]
found["samples"], found["averaging"] = one.samples, one.averaging_time_s
found["rms"], found["temperature"] = one.rms_m, one.temperature_c
status = tracker.GetStatus(pb.StatusRequest(), timeout=20)
found["status"] = [status.ready, status.beam_locked, status.warming_up, status.range_m]
again = pb.Target(direction=pb.Vector3(x=p.x, y=p.y, z=p.z))
found["direction"] = tracker.Aim(pb.AimRequest(target=again), timeout=20).success
away = pb.Target(direction=pb.Vector3(x=-p.x, y=-p.y, z=p.z))
nowhere = pb.SearchRequest(target=away, search_radius_m=0.03)
found["away"] = tracker.Search(nowhere, timeout=20).reason
found["errors"] = []
nan = pb.Target(position_m=pb.Vector3(x=float("nan")))
for call, request in (
    (tracker.Aim, pb.AimRequest(target=nan)),
    (tracker.Aim, pb.AimRequest()),
    (tracker.Search, pb.SearchRequest(target=target)),
    (tracker.Measure, pb.MeasureRequest(averaging_time_s=-1.0)),
):
    try:
        call(request, timeout=20)
        found["errors"].append("none")
    except grpc.RpcError as error:
        found["errors"].append(error.code().name)
print(json.dumps(found))
"""


def test_a_client_written_from_the_proto_alone(serve, truth, config, rig, tmp_path):
    shutil.copy(PROTO, tmp_path / "stranger.proto")
    protoc(tmp_path, f"--python_out={tmp_path}", f"--grpc_python_out={tmp_path}", "stranger.proto")
    (tmp_path / "stranger.py").write_text(STRANGER)
    expected = config.expected(1, *rig.pose)
    command = [sys.executable, "-I", "-c", f"import sys; sys.path.insert(0, {str(tmp_path)!r}); "
               f"exec(open({str(tmp_path / 'stranger.py')!r}).read())"]  # fmt: skip
    ran = subprocess.run(
        [*command, serve(), *map(repr, map(float, expected))],
        timeout=60,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    found = json.loads(ran.stdout)
    true = in_tracker(truth, rig, 1)
    assert found["early"] == tracker_pb2.REASON_NOT_LOCKED
    # The nominal place is millimetres off: a search is needed.
    assert found["aim"] == [False, tracker_pb2.REASON_NOT_FOUND]
    assert found["search"][0] is True
    np.testing.assert_allclose(found["search"][1:], true, atol=2e-4)
    assert found["measure"][0] is True
    np.testing.assert_allclose(found["measure"][1:], true, atol=2e-4)
    assert found["samples"] == 100
    assert found["averaging"] == pytest.approx(0.5)
    assert 5e-6 < found["rms"] < 60e-6
    assert found["temperature"] == 20.0
    along = true / np.linalg.norm(true)
    covariance = np.array(found["covariance"])
    floor = truth.averaging_floor**2
    factor = np.sqrt(floor + (1.0 - floor) / 100.0)
    sigmas = factor * truth.noise.sigmas(np.linalg.norm(true))
    assert np.sqrt(along @ covariance @ along) == pytest.approx(sigmas[0], rel=1e-3)
    assert np.sqrt(np.linalg.eigvalsh(covariance)[1:]) == pytest.approx(sigmas[1:], rel=1e-3)
    assert found["status"] == [True, True, False, pytest.approx(np.linalg.norm(true))]
    assert found["direction"] is True
    assert found["away"] == tracker_pb2.REASON_NOT_FOUND
    assert found["errors"] == ["INVALID_ARGUMENT"] * 4


def test_three_reflectors_through_the_socket_give_the_pose(client, config, truth, rig):
    rng = range(3)
    readings = [client.measure(i, 0.5) for i in rng]
    assert [reading.reason for reading in readings] == ["", "", ""]
    # With the truth's reflectors, as calibrated; drift, of micrometres when warm, comes on top.
    pose = register_pose(
        truth.reflectors,
        [reading.position for reading in readings],
        [reading.covariance + 4e-12 * np.eye(3) for reading in readings],
    )
    position, rotation = rig.pose
    expected = truth.base_rotation.T @ (position - np.array(truth.base_position))
    turn = Rotation.from_matrix(truth.base_rotation.T @ rotation @ pose.rotation.T).as_rotvec()
    error = np.concatenate([expected - pose.position, turn])
    assert np.linalg.norm(error[:3]) < 200e-6
    assert error @ np.linalg.solve(pose.covariance, error) < 3.0 * chi2.isf(1e-6, 6)
    assert readings[0].samples == 500
    assert readings[0].averaging_s == pytest.approx(0.5)
    assert readings[1].time_ns > readings[0].time_ns


def test_beam_blocked_during_a_measurement_and_regained(client, truth, rig):
    # Aimed at where it truly is, no search is needed: the block falls into the averaging time.
    expected = in_tracker(truth, rig, 0)
    assert client.measure(0, 0.1, expected=expected).success
    rig.block_after = 400
    reading = client.measure(0, 60.0, expected=expected)
    assert not reading.success
    assert reading.reason.startswith("beam broken: the beam is blocked")
    assert np.isnan(reading.position).all()
    assert np.isnan(reading.covariance).all()
    status = client.status()
    assert not status.beam_locked
    assert status.beam_lost == tracker_pb2.REASON_BEAM_BROKEN
    blocked = client.measure(0, 0.1)
    assert not blocked.success
    assert "blocked" in blocked.reason
    rig.block_after, rig.record["beam_blocked"] = None, 0
    without_search = client.measure(0, 0.1, search=False)
    assert not without_search.success
    assert "not found" in without_search.reason
    assert client.measure(0, 0.1).success


def test_beam_breaks_while_nobody_measures(client, rig):
    assert client.aim(2).success
    rig.velocity = np.array([0.0, 0.0, 0.6])
    lost = threading.Event()
    for _ in range(500):
        if not client.status().beam_locked:
            lost.set()
            break
        lost.wait(0.01)
    assert lost.is_set()
    rig.velocity = np.zeros(3)
    rig.record["position"] = [0.0, 1.234615, 0.792718]
    assert client.measure(2, 0.1).success


def test_slow_motion_of_the_reflector_is_followed(serve, config, truth, rig):
    start = rig.record["position"][0].copy()
    expected = config.expected(0, *rig.pose)
    rig.step_s = 0.001
    with TrackerClient(serve(replace(truth, drift=STILL)), config) as client:
        assert client.aim(0, expected=expected).success
        rig.velocity = np.array([0.01, 0.0, 0.0])
        reply = client._stub.Measure(tracker_pb2.MeasureRequest(averaging_time_s=0.1), timeout=20)
    # 1 mm in the averaging time: rms of a ramp is its length over sqrt(12).
    assert reply.success
    assert reply.rms_m == pytest.approx(1e-3 / np.sqrt(12.0), rel=0.1)
    assert np.linalg.norm(rig.record["position"][0] - start) > 1e-3


def test_another_reflector_than_the_expected_is_refused(client, config, rig):
    wrong = 1.02 * config.expected(0, *rig.pose)
    reading = client.measure(0, 0.1, expected=wrong)
    assert not reading.success
    assert "another reflector" in reading.reason


def test_arguments_are_checked(client, serve, config):
    with pytest.raises(OutOfRangeError, match="reflector"):
        client.measure(3, 0.1)
    with pytest.raises(ShapeError, match="expected"):
        client.measure(0, 0.1, expected=[np.nan, 0.0, 0.0])
    with pytest.raises(OutOfRangeError, match="averaging_s"):
        client.measure(0, np.nan)
    with (
        TrackerClient(client.address, config) as blind,
        pytest.raises(TrackerError, match="pass expected="),
    ):
        blind.measure(0, 0.1)


def test_rig_that_stands_still_ends_the_measurement(client, rig, config):
    assert client.aim(0).success
    rig.step_s = 0.0
    hasty = replace(config, aim_timeout=2.0)
    with TrackerClient(client.address, hasty, lambda i: config.expected(i, *rig.pose)) as impatient:
        reading = impatient.measure(0, 0.1)
    assert not reading.success
    assert reading.reason.startswith("timed out")


def test_rig_that_does_not_run(serve, config):
    off = Rig()
    off.runs = False
    hasty = replace(config, aim_timeout=2.0)
    with TrackerClient(serve(source=off), hasty, lambda i: config.expected(i, *off.pose)) as asks:
        assert not asks.status().ready
        reading = asks.measure(0, 0.1)
    assert not reading.success
    assert reading.reason.startswith("not ready")


def test_truth_that_is_not_finite_breaks_the_beam(client, rig):
    assert client.aim(0).success
    expected = client.config.expected(0, *rig.pose)
    rig.record["position"] = np.nan
    reading = client.measure(0, 0.1, expected=expected)
    assert not reading.success


def test_second_client_gets_busy(client, config, rig):
    assert client.aim(0).success
    readings = []
    rig.step_s = 0.0
    patient = threading.Thread(
        target=lambda: readings.append(client._stub.Measure(
            tracker_pb2.MeasureRequest(averaging_time_s=0.05), timeout=30))
    )  # fmt: skip
    patient.start()
    for _ in range(500):
        if client.status().busy:
            break
        patient.join(0.01)
    with TrackerClient(client.address, config, lambda i: config.expected(i, *rig.pose)) as second:
        refused = second.measure(1, 0.1)
    rig.step_s = 0.01
    patient.join(30.0)
    assert not refused.success
    assert refused.reason.startswith("busy")
    assert readings[0].success


def test_no_server_there(config):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    with (
        TrackerClient(address, config) as client,
        pytest.raises(TrackerError, match="start the tracker's server") as caught,
    ):
        client.status()
    assert caught.value.code == "UNAVAILABLE"


def test_server_that_never_answers(config):
    with socket.socket() as deaf:
        deaf.bind(("127.0.0.1", 0))
        deaf.listen(1)
        address = f"127.0.0.1:{deaf.getsockname()[1]}"
        with (
            TrackerClient(address, replace(config, call_timeout=0.3)) as client,
            pytest.raises(TrackerError, match=r"within 0.3 s") as caught,
        ):
            client.status()
    assert caught.value.code == "DEADLINE_EXCEEDED"


def test_server_that_stopped(serve, rig, truth, config):
    server = TrackerServer(rig, truth)
    port = server.start()
    with TrackerClient(
        f"127.0.0.1:{port}", config, lambda i: config.expected(i, *rig.pose)
    ) as client:
        assert client.measure(0, 0.05).success
        server.stop()
        with pytest.raises(TrackerError, match="laser tracker at"):
            client.measure(0, 0.05)


@pytest.fixture
def model(truth, rig):
    made = TrackerModel(replace(truth, drift=STILL))
    show(made, rig)
    return made


def show(model, rig, **changes):
    record = rig.newest()
    given = {name: record[name] for name in RECORD.names} | changes
    model.observe(
        int(given["time_ns"]),
        given["position"],
        given["rotation"],
        float(given["speed"]),
        bool(given["beam_blocked"]),
    )


def test_noise_agrees_with_the_covariance_that_is_reported(model, truth, rig):
    point = in_tracker(truth, rig, 0)
    assert model.aim(point, 0.001) is Loss.NONE
    draws, samples = 1500, 5
    errors, squares = [], []
    for _ in range(draws):
        average = model.average([0, 5_000_000], [point, point], 1000.0)
        assert average.samples == samples
        errors.append(average.position - point)
        squares.append(errors[-1] @ np.linalg.solve(average.covariance, errors[-1]))
    low, high = chi2.ppf([0.0005, 0.9995], 3 * draws) / draws
    assert low <= np.mean(squares) <= high
    along = np.array(errors) @ beam_axes(point)
    floor = truth.averaging_floor**2
    expected = np.sqrt(floor + (1.0 - floor) / samples) * np.array([5.42e-6, 15.8e-6, 15.8e-6])
    np.testing.assert_allclose(along.std(axis=0), expected, rtol=0.08)


def test_averaging_lowers_the_noise_to_its_floor_only(model, truth, rig):
    point = in_tracker(truth, rig, 0)
    one, many = (model.average([0, round(1e6 * n)], [point, point], 1000.0) for n in (1, 10_000))
    ratio = np.sqrt(np.trace(many.covariance) / np.trace(one.covariance))
    assert ratio == pytest.approx(truth.averaging_floor, rel=0.01)
    errors = [
        np.linalg.norm(model.average([0, 10**9], [point, point], 1000.0).position - point)
        for _ in range(200)
    ]
    across = truth.averaging_floor * 15.8e-6
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(np.sqrt(2.1) * across, rel=0.15)


@pytest.mark.parametrize(
    ("changes", "loss"),
    [
        ({"speed": 0.6}, Loss.FAST),
        ({"speed": np.nan}, Loss.FAST),
        ({"beam_blocked": 1}, Loss.BLOCKED),
        ({"rotation": Rotation.from_euler("z", 180, degrees=True).as_matrix()}, Loss.TURNED),
        ({"position": np.full(3, np.nan)}, Loss.UNKNOWN),
        ({"position": np.array([0.6, 3.6, 1.1]), "speed": 0.0}, Loss.RANGE),
        ({"speed": 0.4}, Loss.NONE),
    ],
)
def test_what_breaks_the_beam(model, truth, rig, changes, loss):
    assert model.aim(in_tracker(truth, rig, 0), 0.001) is Loss.NONE
    assert model.locked == 0
    show(model, rig, **changes)
    assert model.locked == (0 if loss is Loss.NONE else None)
    if loss is not Loss.NONE:
        assert model.loss is loss
    # The beam does not come back by itself.
    show(model, rig)
    assert model.locked == (0 if loss is Loss.NONE else None)


def test_beam_breaks_when_the_platform_only_turns_fast(model, truth, rig):
    assert model.aim(in_tracker(truth, rig, 0), 0.001) is Loss.NONE
    turn = Rotation.from_euler("z", 4, degrees=True).as_matrix() @ rig.pose[1]
    show(model, rig, rotation=turn)  # 7 rad/s at 0.14 m, with the platform's origin at rest
    assert model.loss is Loss.FAST


def test_beam_finds_the_reflector_nearest_to_the_line_of_sight(model, truth, rig):
    points = [in_tracker(truth, rig, i) for i in range(3)]
    for index, point in enumerate(points):
        assert model.aim(1.01 * point, 0.02) is Loss.NONE
        assert model.locked == index
    assert model.aim(-points[0], 0.02, direction=True) is Loss.NOT_FOUND
    assert model.aim(points[0] + [0.0, 0.0, -0.02], 0.01) is Loss.NOT_FOUND
    assert model.aim(0.1 * points[0], 0.02) is Loss.RANGE
    with pytest.raises(ShapeError, match="finite"):
        model.aim([np.nan, 0.0, 0.0], 0.02)


def test_drift_dies_out_after_switch_on(truth, rig):
    cold = DriftConfig(age=0.0, wander_radial=0.0, wander_angle=0.0)
    starts = np.array([Drift(cold, seed).at(0.0) for seed in range(400)])
    np.testing.assert_allclose(starts.std(axis=0), [10e-6, 15e-6, 15e-6], rtol=0.15)
    drift = Drift(cold, 1)
    later = drift.at(2.0 * 3600.0)
    np.testing.assert_allclose(later, np.exp(-4.0) * drift.at(0.0), rtol=1e-9)
    assert drift.expected(0.0, 3.0) > np.linalg.norm(
        displaced(in_tracker(truth, rig, 0), drift.at(0.0)) - in_tracker(truth, rig, 0)
    )
    model = TrackerModel(replace(truth, drift=cold))
    show(model, rig)
    assert model.warming_up
    show(model, rig, time_ns=rig.record["time_ns"][0] + 7200 * 10**9)
    assert not model.warming_up
    assert model.on_time() == pytest.approx(7200.0, abs=1.0)


def test_drift_moves_what_is_measured(truth, rig):
    model = TrackerModel(replace(truth, drift=DriftConfig(age=0.0)))
    show(model, rig)
    point = in_tracker(truth, rig, 0)
    early, late = (
        np.mean(
            [model.average([t, t + 10**8], [point, point], 1000.0).position for _ in range(50)],
            axis=0,
        )
        for t in (0, 7200 * 10**9)
    )
    drift = Drift(model.config.drift, truth.seed)
    expected = displaced(point, drift.at(7200.0)) - displaced(point, drift.at(0.0))
    assert np.linalg.norm(expected) > 20e-6
    np.testing.assert_allclose(late - early, expected, atol=4e-6)


def test_wandering_is_the_same_in_any_order_and_of_the_right_size():
    config = DriftConfig(warm_up_radial=0.0, warm_up_angle=0.0)
    drift = Drift(config, 3)
    times = np.linspace(0.0, 3e5, 2000)
    values = np.array([drift.at(t) for t in times])
    np.testing.assert_array_equal(values[::-1], [drift.at(t) for t in times[::-1]])
    np.testing.assert_allclose(values.std(axis=0), 0.5e-6, rtol=0.1)
    assert np.abs(drift.at(1.0) - drift.at(0.0)).max() < 0.05e-6


def test_configuration_refuses_what_cannot_work(config, tmp_path):
    line = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.2, 0.0, 0.0]]
    for change, message in (
        ({"reflectors": line}, "not on one line"),
        ({"reflectors": line[:2]}, "at least 3"),
        ({"search_radius": 0.08}, "search_radius"),
        ({"averaging_time": float("nan")}, "averaging_time"),
        ({"base_position": [0.0, 1.0]}, "base_position"),
    ):
        with pytest.raises((ConfigError, OutOfRangeError, ShapeError, ValueError), match=message):
            replace(config, **change)
    bad = tmp_path / "tracker.yaml"
    bad.write_text("reflectors: []\nspeed: 3\n")
    with pytest.raises(ConfigError, match="speed"):
        load_tracker_config(path=bad)


def test_nominal_and_true_reflectors_are_within_the_search_radius(config, truth, rig):
    """Else no search would find them: what the two configurations owe to each other."""
    for index in range(3):
        away = config.expected(index, *rig.pose) - in_tracker(truth, rig, index)
        assert truth.capture_radius < np.linalg.norm(away) < 0.5 * config.search_radius
