# SPDX-License-Identifier: Apache-2.0
"""The recorder as a process: orderly ends, kills, full disks."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
import rclpy
import yaml
from cabols_msgs.msg import LoopStatus
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Log
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import serialize_message
from rosbags.highlevel import AnyReader
from std_msgs.msg import String
from std_srvs.srv import SetBool

from cabols_control.bags.compare import payload_digest
from cabols_control.bags.errors import BagError
from cabols_control.bags.reader import read_bag
from cabols_control.bags.recover import recover
from cabols_control.bags.storage.salvage import Salvage
from cabols_control.bringup.free_domains import claim_domain
from cabols_control.geometry import load_geometry
from cabols_control.nodes.recorder import lack_of_space
from cabols_control.realtime.scheduling import may_use_fifo
from cabols_control.ros.messages import topics
from cabols_control.ros.messages.qos import control_qos, latched_qos, status_qos
from cabols_control.topics import NAMESPACE, RECORDED
from stalls import Stalls

pytestmark = [pytest.mark.ros]

FLUSH_PERIOD_S = 0.5
MARGIN_S = 0.3
"""Beyond the flush period: 20 ms of gathering, 25 ms to write and compress half a second of
messages, and what two busy cores may delay a thread."""
PATIENCE_S = 180.0


@pytest.fixture
def domain():
    """One for each test: a recorder that was killed haunts its domain for 20 s."""
    return claim_domain()


@pytest.fixture
def node(domain):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        context = Context()
        rclpy.init(context=context, domain_id=domain)
        found = rclpy.create_node("rig", namespace=NAMESPACE, context=context)
        yield found
        found.destroy_node()
        context.shutdown()


class Rig:
    """Publishes what the bench does at 1 kHz."""

    def __init__(self, node, lockstep):
        geometry = load_geometry()
        layouts = {
            "limb_state": topics.limb_state_layout(geometry),
            "wrench": topics.wrench_layout("platform"),
            "motor_current": topics.motor_current_layout(geometry, geometry.cables),
            "tension_command": topics.tension_command_layout(geometry),
        }
        self._node = node
        qos = control_qos(lockstep)
        self.records = {name: layout.record() for name, layout in layouts.items()}
        self.publishers = {
            name: node.create_publisher(layout.msg_type, name, qos)
            for name, layout in layouts.items()
        }
        self.mode = node.create_publisher(topics.TYPES["mode"], "mode", latched_qos(lockstep))
        self.status = node.create_publisher(LoopStatus, "loop_status", status_qos())
        self.sent_ns = []

    def wait(self, process):
        """Wait until the recorder has met all publishers."""
        wait_for(lambda: all(p.get_subscription_count() for p in self._all()), process)

    def _all(self):
        return (*self.publishers.values(), self.mode, self.status)

    def run(self, cycles):
        due = time.perf_counter()
        for _ in range(cycles):
            due += 1e-3
            time.sleep(max(0.0, due - time.perf_counter()))
            now = time.time_ns()
            self.sent_ns.append(now)
            for name, record in self.records.items():
                record.stamp(now)
                if name != "wrench":
                    record["sequence"][0] = len(self.sent_ns)
                self.publishers[name].publish(record.raw())

    def close(self):
        for publisher in self._all():
            self._node.destroy_publisher(publisher)


@pytest.fixture
def rig(node, request):
    found = Rig(node, getattr(request, "param", False))
    yield found
    found.close()


@pytest.fixture
def record(domain, tmp_path):
    """Start recorders; those that still run at the end are killed."""
    started = []

    def start(*parameters, limit=None, **given):
        values = {"output": str(tmp_path / "bag"), **given}
        arguments = [f"-p{key}:={value}" for key, value in values.items()]
        arguments = [part for a in arguments for part in ("-p", a[2:])]
        code = "import sys\nfrom cabols_control.nodes.recorder import main\nsys.exit(main())\n"
        if limit is not None:
            limits = f"resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))"
            code = f"import resource\n{limits}\n{code}"
        command = ["-m", "cabols_control.nodes.recorder"] if limit is None else ["-c", code]
        process = subprocess.Popen(
            [sys.executable, *command, "--ros-args", *arguments],
            env={
                **os.environ,
                "ROS_DOMAIN_ID": str(domain),
                "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            },
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=tmp_path,
        )
        started.append(process)
        return process

    yield start
    for process in started:
        if process.poll() is None:
            process.kill()
        process.communicate(timeout=PATIENCE_S)


def wait_for(condition, process=None):
    give_up = time.monotonic() + PATIENCE_S
    while not condition():
        if process is not None and process.poll() is not None:
            raise AssertionError(f"recorder ended early: {process.communicate()}")
        assert time.monotonic() < give_up
        time.sleep(0.01)


def end(process, number=signal.SIGINT):
    """Signal, and return output and seconds until the end, less those of the machine's stalls."""
    time.sleep(0.1)  # what was just published travels through the middleware
    with Stalls(process.pid) as stalls:
        started = time.monotonic()
        process.send_signal(number)
        output, errors = process.communicate(timeout=PATIENCE_S)
        ended = time.monotonic()
    return output, errors, ended - started - stalls.total_s


def test_the_loops_own_readers_are_met_before_the_recorder(node, record):
    """Whom a publisher met first it serves first; without a bridge there is nothing to record."""
    qos = control_qos(False)
    current = node.create_publisher(topics.TYPES["motor_current"], "motor_current", qos)
    mode = node.create_publisher(topics.TYPES["mode"], "mode", latched_qos(False))
    process = record()
    wait_for(mode.get_subscription_count, process)
    assert current.get_subscription_count() == 0
    bridge = node.create_subscription(topics.TYPES["motor_current"], "motor_current", print, qos)
    wait_for(current.get_subscription_count, process)
    assert node.get_subscriptions_info_by_topic("/cabols/motor_current")[0].node_name == "rig"
    state = node.create_publisher(topics.TYPES["limb_state"], "limb_state", qos)
    wait_for(lambda: current.get_subscription_count() == 2, process)
    wait_for(state.get_subscription_count, process)
    node.destroy_subscription(bridge)
    for publisher in (current, mode, state):
        node.destroy_publisher(publisher)


@pytest.mark.skipif(not may_use_fifo(), reason="this process may not use SCHED_FIFO")
def test_bags_are_begun_outside_the_real_time_class(node, record):
    """That takes 70 ms: the robot's bridge, on the same core, would call its robot silent."""
    process = record(record_at_start="false", fifo_priority=3)
    client = node.create_client(SetBool, "record")
    assert client.wait_for_service(timeout_sec=PATIENCE_S)
    done = client.call_async(SetBool.Request(data=True))
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    executor.spin_until_future_complete(done, timeout_sec=PATIENCE_S)
    executor.shutdown()
    assert done.result().success, done.result().message
    threads = Path(f"/proc/{process.pid}/task")

    def classes():
        return {int(t.name): os.sched_getscheduler(int(t.name)) for t in threads.iterdir()}

    wait_for(lambda: os.SCHED_FIFO in classes().values(), process)
    wait_for(lambda: classes()[process.pid] == os.SCHED_OTHER, process)
    node.destroy_client(client)


@pytest.mark.parametrize("rig", [True], indirect=True)
def test_a_lockstep_run_is_recorded_whole(rig, record, tmp_path):
    process = record(lockstep="true", description="a run")
    rig.wait(process)
    rig.mode.publish(topics.TYPES["mode"](mode=2, reason="for the test"))
    rig.run(1500)
    output, errors, took = end(process)
    assert process.returncode == 0, errors
    assert took < 1.0 + MARGIN_S
    assert "6001 messages, 0 lost" in output
    bag = read_bag(tmp_path / "bag")
    assert bag.counts == {
        **dict.fromkeys(RECORDED, 0),
        **dict.fromkeys(rig.publishers, 1500),
        "mode": 1,
    }, "nothing else: a status report would hold wall-clock content"
    assert bag["limb_state"]["sequence"].tolist() == list(range(1, 1501))
    assert bag["limb_state"].stamp_ns.tolist() == rig.sent_ns
    assert (np.diff(bag["limb_state"].log_time_ns) >= 0).all()
    assert bag["limb_state"].sequence.tolist() == list(range(1, 1501))
    assert bag["mode"]["reason"] == ["for the test"]
    assert bag.metadata["description"] == "a run"
    assert "base_points" in bag.metadata["geometry_yaml"]
    assert len(bag.metadata["control_sha256"]) == 64
    assert set(payload_digest(tmp_path / "bag")) == {*rig.publishers, "mode"}
    with AnyReader([tmp_path / "bag"]) as reader:
        assert reader.message_count == 6001
        states = [c for c in reader.connections if c.topic == "/cabols/limb_state"]
        connection, _, raw = next(reader.messages(states))
        assert reader.deserialize(raw, connection.msgtype).sequence == 1


def test_a_real_time_run_counts_what_best_effort_lost(rig, record, tmp_path):
    process = record()
    rig.wait(process)
    rig.run(2000)
    output, errors, took = end(process, signal.SIGTERM)
    assert process.returncode == 0, errors
    assert took < 1.0 + MARGIN_S
    bag = read_bag(tmp_path / "bag")
    for topic in rig.publishers:
        lost = int(re.search(rf" {topic}  \(lost (\d+)\)", output)[1])
        # Best effort: what was sent before the reader had met the writer is not its loss.
        before = bag[topic].sequence[0] - 1
        assert before + len(bag[topic]) + lost == 2000, topic
    status = bag["loop_status"]
    assert "recorder" in status["node"]
    assert status["cycles"][-1] > 0
    # Received when the middleware had it, not when the recorder came to take it.
    delay_ms = 1e-6 * (bag["limb_state"].log_time_ns - bag["limb_state"].stamp_ns)
    assert 0 < np.median(delay_ms) < 10


def test_kill_9_loses_no_more_than_the_flush_period(rig, record, tmp_path):
    process = record(flush_period=FLUSH_PERIOD_S)
    rig.wait(process)
    with Stalls() as stalls:
        rig.run(2300)
        killed_ns = time.time_ns()
        process.kill()
        process.wait(timeout=PATIENCE_S)
    assert not (tmp_path / "bag" / "metadata.yaml").exists()
    saved = recover(tmp_path / "bag")
    bag = read_bag(tmp_path / "bag")
    assert saved.topics["limb_state"] == len(bag["limb_state"]) > 1000
    for topic in rig.publishers:
        silent_s = 1e-9 * (killed_ns - bag[topic].stamp_ns[-1])
        assert silent_s - stalls.total_s < FLUSH_PERIOD_S + MARGIN_S, topic
    assert "base_points" in bag.metadata["geometry_yaml"]
    with AnyReader([tmp_path / "bag"]) as reader:
        assert reader.message_count == saved.messages


def test_a_full_disk_ends_the_recorder_with_a_clear_word(rig, record, tmp_path):
    """A limit on file size stands in for a full disk; the middleware needs 1 MB of its own."""
    process = record(limit=4_000_000)
    rig.wait(process)
    noise = np.random.default_rng(0)
    for _ in range(60):
        text = noise.integers(33, 126, 200_000, dtype=np.uint8).tobytes().decode()
        rig.status.publish(serialize_message(LoopStatus(reason=text)))
        time.sleep(0.02)
    _, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1
    assert re.search(r"error: .*expected to write the bag, got File too large; .*recover", errors)
    assert recover(tmp_path / "bag").messages > 0


def test_no_bag_is_begun_without_space(tmp_path):
    assert lack_of_space(tmp_path / "not" / "yet", 1e-6) == ""
    lack = lack_of_space(tmp_path / "not" / "yet", 1e9)
    assert "free_space" in lack
    assert "not/yet" in lack


def test_the_recorder_refuses_an_existing_bag_and_unknown_topics(record, tmp_path):
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "bag_0.mcap").touch()
    process = record()
    _, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 2
    assert "expected a new or empty folder for the bag, got one with bag_0.mcap" in errors
    process = record(topics="[mode, moods]", output=tmp_path / "other")
    _, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 2
    assert re.search(r"topics: expected some of limb_state, .* got moods", errors)
    assert not (tmp_path / "other").exists()


def spin_until(node, condition, process):
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)

    def turned():
        executor.spin_once(timeout_sec=0.05)
        return condition()

    wait_for(turned, process)
    executor.shutdown()


@pytest.mark.parametrize("killed", [False, True])
def test_the_bag_has_what_the_running_nodes_answered(node, record, tmp_path, killed):
    """What ran counts, not what was to run; a kill loses none of it once it is flushed."""
    other = tmp_path / "tight.yaml"
    other.write_text("a: 1\n")
    node.declare_parameter("tension_method", "p_norm")
    node.declare_parameter("safety_file", str(other))
    node.declare_parameter("gains", [1.0, 2.0])
    process = record(description="census", flush_period=0.1)
    bag = tmp_path / "bag"

    def told():
        """What a kill would leave has the answers, and a message: the recorder's own state."""
        if not any(b"parameters_rig" in f.read_bytes() for f in bag.glob("*")):
            return False
        with TemporaryDirectory(dir=tmp_path) as folder:
            copy = shutil.copytree(bag, Path(folder) / "bag")
            return recover(copy).messages > 0

    spin_until(node, told, process)
    if killed:
        process.kill()
        process.communicate(timeout=PATIENCE_S)
        recover(bag)
    else:
        _, errors, _ = end(process)
        assert process.returncode == 0, errors
    texts = read_bag(bag).metadata
    asked = yaml.safe_load(texts["parameters_rig"])
    assert asked["gains"] == [1.0, 2.0]
    assert texts["tension_method"] == asked["tension_method"] == "p_norm"
    assert (texts["safety_file"], texts["safety_yaml"]) == ("tight.yaml", "a: 1\n")
    assert yaml.safe_load(texts["parameters_recorder"])["description"] == "census"
    assert texts["description"] == "census"


def is_written(bag, words):
    """Whether a message with some words is in a bag that is being recorded."""
    for path in bag.glob("*.mcap"):
        with suppress(BagError):
            if any(words in item.data for item in Salvage(path, strict=False).messages()):
                return True
    return False


def test_topics_of_ros_and_of_the_site_are_recorded_at_choice(node, record, tmp_path):
    site = "/site/room:std_msgs/msg/String"
    also = f"/rosout,/diagnostics,{site}"
    process = record(record_also=also, flush_period=0.1, split_duration=0.2)
    room = node.create_publisher(String, "/site/room", 10)
    wait_for(room.get_subscription_count, process)
    for number in range(20):
        room.publish(String(data=f"{number} degrees"))
        time.sleep(0.01)
    spin_until(node, lambda: node.count_subscribers("/rosout") > 0, process)
    heard = []
    node.create_subscription(DiagnosticArray, "/diagnostics", heard.append, 10)
    # The recorder's own reader besides this one; what comes then it records, too.
    spin_until(node, lambda: node.count_subscribers("/diagnostics") > 1, process)
    heard.clear()
    spin_until(node, lambda: len(heard) >= 2, process)
    spoken = node.create_publisher(Log, "/rosout", 10)
    wait_for(spoken.get_subscription_count, process)
    spoken.publish(Log(name="site", msg="the door is open"))
    wait_for(lambda: is_written(tmp_path / "bag", b"the door is open"), process)
    _, errors, _ = end(process)
    assert process.returncode == 0, errors
    with AnyReader([tmp_path / "bag"]) as reader:
        found = {}
        for connection, _, raw in reader.messages():
            found.setdefault(connection.topic, []).append(
                reader.deserialize(raw, connection.msgtype)
            )
    assert len([*(tmp_path / "bag").glob("*.mcap")]) > 1
    assert found["/site/room"][-1].data == "19 degrees"
    assert "the door is open" in [message.msg for message in found["/rosout"]]
    assert found["/diagnostics"]


def test_a_topic_without_a_known_type_is_refused_with_what_is_expected(record):
    process = record(record_also="/rosuot")
    _, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 2
    assert "record_also: expected /diagnostics" in errors


def test_simulated_time_is_refused_with_the_reason(record):
    """A node whose timers wait for /clock would neither report nor watch."""
    process = record(use_sim_time="true")
    _, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 2
    assert "use_sim_time: expected false" in errors
