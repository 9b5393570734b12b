# SPDX-License-Identifier: Apache-2.0
"""CDR layouts against rclpy's own serialisation."""

from __future__ import annotations

import numpy as np
import pytest
from cabols_msgs.msg import LimbState, MotorCurrent, TensionCommand
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.serialization import deserialize_message, serialize_message

from cabols_control.ros.messages import topics
from cabols_control.ros.messages.layout import Layout, LayoutError


def fill(record, layout, random):
    for name in layout.dtype.names:
        view = record[name]
        if view.dtype.kind == "b":
            view[:] = random.random(view.size) < 0.5
        elif view.dtype.kind == "f":
            view[:] = random.normal(size=view.size)
        elif name == "header.stamp.nanosec":
            view[:] = random.integers(0, 10**9)
        else:
            view[:] = random.integers(0, 100, view.size)


JOINED = ("wrench", "pose")


def layouts(geometry):
    return [
        topics.limb_state_layout(geometry),
        topics.tension_command_layout(geometry),
        topics.motor_current_layout(geometry, 3),
        topics.wrench_layout("a_frame_with_a_long_name"),
        topics.wrench_layout(""),
        topics.pose_layout(geometry),
        topics.mode_layout("why not"),
        topics.loop_status_layout("node", "reason"),
    ]


@pytest.mark.parametrize("index", range(8))
def test_rclpy_reads_and_writes_the_same_bytes(rig, random, index):
    layout = layouts(rig.geometry)[index]
    record = layout.record()
    fill(record, layout, random)
    raw = record.raw()
    message = deserialize_message(raw, layout.msg_type)
    again = bytes(serialize_message(message))
    assert len(again) == len(raw)
    # rclpy leaves padding bytes as they were in memory; ours are zero. Numbers must agree.
    mine, theirs = layout.read(raw), layout.read(again)
    for name in layout.dtype.names:
        np.testing.assert_array_equal(mine[name], theirs[name], err_msg=name)
        if name in JOINED:
            continue
        assert np.array_equal(
            np.ravel(mine[name]), np.ravel(attribute(message, name)).astype(mine[name].dtype)
        ), name


def attribute(message, name):
    for part in name.split("."):
        message = getattr(message, part)
    return message


def test_joined_fields_are_their_parts():
    record = topics.wrench_layout("x").record()
    record["wrench"][:] = np.arange(6)
    assert record["wrench.force.y"][0] == 1.0
    assert record["wrench.torque.z"][0] == 5.0


def test_padding_is_zero(rig):
    layout = topics.tension_command_layout(rig.geometry)
    assert layout.record().raw() == layout.record().raw()
    record = layout.record()
    record.stamp(12_345_678_901)
    assert layout.stamp_of(record.raw()) == 12_345_678_901


def test_other_frame_is_read_all_the_same():
    layout = topics.wrench_layout("rig_base")
    message = WrenchStamped()
    message.header.frame_id = "somewhere_else"
    message.wrench.torque.y = 4.5
    raw = bytes(serialize_message(message))
    assert not layout.matches(raw)
    assert layout.read(raw)["wrench.torque.y"] == 4.5
    assert layout.strings(raw) == {"header.frame_id": "somewhere_else"}


def test_wrong_length_names_the_field(rig):
    layout = topics.tension_command_layout(rig.geometry)
    message = TensionCommand(tension=[1.0] * 7, limb=list(range(8)))
    with pytest.raises(LayoutError, match=r"TensionCommand\.tension: expected 8 values, got 7"):
        layout.read(bytes(serialize_message(message)))


@pytest.mark.parametrize("raw", [b"", b"\x00", b"\x00\x01\x00\x00", b"\xff" * 50])
def test_garbage(rig, raw):
    with pytest.raises(LayoutError):
        topics.limb_state_layout(rig.geometry).read(raw)


def test_missing_length():
    with pytest.raises(LayoutError, match="expected a length"):
        Layout(MotorCurrent, {"limb": 8})


@pytest.mark.parametrize("msg_type", [LimbState, PoseStamped])
def test_types_match_the_topics(msg_type):
    assert msg_type in topics.TYPES.values()
