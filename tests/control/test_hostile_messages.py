# SPDX-License-Identifier: Apache-2.0
"""Every field of every message that the nodes beside the control loop hear, hostile in turn.

Nodes run in this process, each of their subscriptions is fed directly. None may raise out of a
callback, publish numbers that are none, or keep what strangers send without a bound.
"""

from __future__ import annotations

import gc
import importlib
import json
import tracemalloc
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy
from cabols_msgs.msg import LoopStatus
from rclpy.serialization import deserialize_message

from cabols_control.bringup.free_domains import claim_domain
from cabols_control.ros.messages import topics
from cabols_control.ros.messages.topics import message_type
from cabols_control.topics import TOPICS
from fed_nodes import Feeder
from hostile_messages import hostile, numbers_of

GROWTH = 4_000_000
"""Most that a whole round may leave behind [bytes]: a hundred reports and events, all bounded."""
WORST_TEXT = 1100
DRAWN = ("limb_state", "platform_pose", "joint_states", "tension_command")
BETWEEN = 5
"""Hostile messages from one healthy set of all topics to the next."""
UNKNOWN = {"pose_agreement": {"limb_state", "platform_pose", "wrench", "reflector_measurement"}}
"""Messages whose fields are NaN for what is not known, as their definitions say."""


class TfMessage:
    """Stands for tf2_msgs/msg/TFMessage, which has no wheel."""

    def __init__(self, transforms=()):
        self.transforms = list(transforms)

    @classmethod
    def get_fields_and_field_types(cls):
        return {"transforms": "sequence<geometry_msgs/TransformStamped>"}


def made_frames(feeder, patch):
    module = importlib.import_module("cabols_control.nodes.frames")
    real = topics.class_of
    patch.setattr(topics, "class_of", lambda name: TfMessage if "TFM" in name else real(name))

    def publisher(_node, _kind, topic):
        return SimpleNamespace(publish=lambda m: feeder.published.append((topic, m)))

    patch.setattr(module, "publisher", publisher)
    node = module.FramesNode()
    return node, node.tick


def made_ticking(module, name):
    def make(_feeder, _patch):
        node = getattr(importlib.import_module(module), name)()
        return node, node.tick

    return make


def made_ros2_control(_feeder, _patch):
    module = importlib.import_module("cabols_control.nodes.ros2_control_bridge")
    node = module.Ros2ControlBridgeNode()

    def turn():
        node._mode.take()
        node._wrench.take()
        if node._state.take():
            node._step()

    return node, turn


def made_campaign(_feeder, _patch):
    module = importlib.import_module("cabols_stiffness.nodes.stiffness_campaign")
    node = module.StiffnessCampaignNode()

    def turn():
        node._intake._look()
        node._lead()

    return node, turn


def made_supervisor(_feeder, _patch):
    node = importlib.import_module("cabols_control.nodes.supervisor").SupervisorNode()
    return node, node._tick


def made_identifier(_feeder, _patch):
    module = importlib.import_module("cabols_stiffness.nodes.stiffness_identifier")
    return module.StiffnessIdentifierNode(), lambda: None


def made_recorder(_feeder, _patch):
    node = importlib.import_module("cabols_control.nodes.recorder").RecorderNode()
    recording = node._recording

    def turn():
        # As its two threads do.
        recording._take()
        recording._write()

    return node, turn


def made_console(feeder, _patch):
    """Feed of the page: what it shows must be JSON."""
    calls = importlib.import_module("cabols_control.ros.console.feed")
    latest = importlib.import_module("cabols_control.console.latest").LatestValues()
    node = importlib.import_module("cabols_control.ros.node").ControlNode("console")
    feed = calls.Feed(node, node.rig, latest, node.rig_folder)
    seen = [0]

    def turn():
        feed.look()
        json.loads(latest.frame()[1], parse_constant=pytest.fail)
        json.loads(latest.state_text()[1], parse_constant=pytest.fail)
        newest = latest.events_after(seen[0])
        assert all(len(event.text) <= WORST_TEXT for event in newest)
        seen[0] = newest[-1].number if newest else seen[0]

    return node, turn


MAKERS = {
    "frames with robot": made_frames,
    "frames": made_frames,
    "markers": made_ticking("cabols_control.nodes.markers", "MarkersNode"),
    "pose_estimator": made_ticking("cabols_control.nodes.pose_estimator", "PoseEstimatorNode"),
    "ros2_control_bridge": made_ros2_control,
    "stiffness_campaign": made_campaign,
    "stiffness_identifier": made_identifier,
    "supervisor": made_supervisor,
    "recorder": made_recorder,
    "console": made_console,
}


def usual(topic, kind, rig, turn):
    """A message as it comes in a healthy rig, `turn` milliseconds after its start."""
    geometry = rig.geometry
    n = geometry.cables
    made = kind()
    if topic == "limb_state":
        record = topics.limb_state_layout(geometry).record()
        record["limb"][:] = np.arange(n)
        record["elongation"][:], record["tension"][:] = 0.01, 20.0
        record["zeroed"][:], record["zeroing"][0], record["mode"][0] = 1, 1, 2
        made = deserialize_message(record.raw(), kind)
    elif topic == "wrench":
        record = topics.wrench_layout(geometry.platform_frame).record()
        made = deserialize_message(record.raw(), kind)
    elif topic == "platform_pose":
        record = topics.pose_layout(geometry).record()
        record["pose"][:] = [*geometry.reference_position, 0.0, 0.0, 0.0, 1.0]
        made = deserialize_message(record.raw(), kind)
    elif topic == "tension_command":
        record = topics.tension_command_layout(geometry).record()
        record["limb"][:], record["tension"][:] = np.arange(n), 20.0
        made = deserialize_message(record.raw(), kind)
    elif topic == "joint_states":
        made = kind(name=[f"joint_{i + 1}" for i in range(6)], position=[0.1] * 6)
    elif topic == "mode":
        made = kind(mode=2, session=5, cause=2)
    elif topic == "limb_joint_commands":
        made = kind(name=[f"cable_{i + 1}" for i in range(n)], effort=[20.0] * n)
    elif topic == "reflector_measurement":
        made = kind(success=True, covariance=(1e-10 * np.eye(3)).ravel())
    elif topic == "stiffness_load":
        made = kind(success=True)
    elif topic == "loop_status":
        made = kind(node="plant", state=LoopStatus.RUNNING, instance=1)
    if hasattr(made, "header"):
        made.header.stamp.sec, milliseconds = 100 + turn // 1000, turn % 1000
        made.header.stamp.nanosec = 1_000_000 * milliseconds
    return made


class Fed:
    """One node, fed."""

    def __init__(self, name, patch):
        self.feeder = Feeder(patch)
        self.node, self.turn = MAKERS[name](self.feeder, patch)
        self.kinds = self.feeder.topics(self.node)
        if name == "markers":
            # It draws frames of the console's feed, which is fed whole below.
            self.kinds = {topic: self.kinds[topic] for topic in DRAWN}
        self.turns = 0

    def healthy(self):
        self.turns += 1
        for topic, kind in self.kinds.items():
            message = usual(topic, kind, self.node.rig, self.turns)
            assert self.feeder.send(self.node, topic, message)
        self.turn()

    def round(self):
        """Send everything hostile, each beside a healthy one; return how many were sent."""
        sent = 0
        for topic, kind in self.kinds.items():
            for message in hostile(kind, usual(topic, kind, self.node.rig, self.turns)):
                self.feeder.published.clear()
                if not self.feeder.send(self.node, topic, message):
                    continue
                sent += 1
                try:
                    self.turn()
                    if sent % BETWEEN == 0:
                        self.healthy()
                except Exception as error:
                    raise AssertionError(f"{topic}: {str(message)[:300]}") from error
                self.judge(topic)
        return sent

    def judge(self, topic):
        for name, message in self.feeder.published:
            if topic not in UNKNOWN.get(name, ()):
                values = np.array(list(numbers_of(message)))
                known = (
                    values if topic not in ("wrench", "limb_state") else values[values == values]
                )
                assert (np.abs(known) < 1e9).all() or name == "limb_joint_states", (topic, name)
            assert len(getattr(message, "reason", "")) <= WORST_TEXT, (topic, name)


@pytest.fixture
def context(request, tmp_path):
    name = request.node.callspec.params["name"]
    words = [f"robot:={'false' if name == 'frames' else 'true'}"]
    if name == "recorder":
        words.append(f"output:={tmp_path / 'bag'}")
    rclpy.init(
        args=["--ros-args", *(w for word in words for w in ("-p", word))], domain_id=claim_domain()
    )
    yield
    rclpy.shutdown()


@pytest.mark.timeout(600)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("name", MAKERS)
def test_nothing_hostile_ends_a_node_or_stays(name, context, monkeypatch):
    fed = Fed(name, monkeypatch)
    assert fed.kinds
    known = {*TOPICS, "/diagnostics", "/rosout", "/parameter_events"}
    assert set(fed.kinds) <= known, "a topic that the table does not have"
    for topic in set(fed.kinds) & set(TOPICS):
        assert fed.kinds[topic] is message_type(topic)
    for _ in range(30):
        fed.healthy()
    sent = fed.round()
    assert sent > 50
    gc.collect()
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        fed.round()
        gc.collect()
        assert tracemalloc.get_traced_memory()[0] - before < GROWTH
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("name", ["frames"])
def test_planted_callback_that_raises_is_found(name, context, monkeypatch):
    fed = Fed(name, monkeypatch)
    fed.turn = lambda: 1 / sum(len(m) for m, _ in fed.feeder.published) if fed.turns > 3 else None
    with pytest.raises(AssertionError):
        fed.round()
