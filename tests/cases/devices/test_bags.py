# SPDX-License-Identifier: Apache-2.0
"""Bags as other programs write them, or damaged: what can be read is read, and saved.

Sources beside each test. One unusable part must not make all unusable, and of entries that must
agree the first one must not win.
"""

from __future__ import annotations

import struct

import numpy as np
import pytest

from bag_maker import (
    CDR,
    CHANNEL,
    COUNT,
    DEFINITION,
    MESSAGES,
    SCHEMA,
    START_NS,
    TOPIC,
    TYPE,
    channel,
    chunk,
    file,
    message,
    put,
    schema,
    whole,
    zstd,
)
from cabols_control.bags.errors import BagError
from cabols_control.bags.reader import read_bag
from cabols_control.bags.recover import recover
from cases import outcome

OLD_TYPE = "geometry_msgs/WrenchStamped"
EMPTY = CDR + bytes(8)
DAMAGED_COUNT = 6000


def wrenches(bag, topics=None):
    """How many wrenches are read; or the error."""
    return outcome(lambda: len(read_bag(bag, topics)["wrench"]))


def saved(source, tmp_path):
    """How many messages are saved; or the error."""
    return outcome(lambda: recover(source, tmp_path / "out").messages)


def test_plain_bag_is_read(tmp_path):
    assert wrenches(put(tmp_path / "bag", file(chunk(SCHEMA + CHANNEL + MESSAGES)))) == COUNT


class TestChannelWithoutDefinition:
    """ros-tooling/rosbag2_storage_mcap#70, foxglove/mcap#709, ros2/rosbag2#1922."""

    @pytest.fixture
    def bag(self, tmp_path):
        odd = schema(2, "my_msgs/msg/Foo", "", b"") + channel(2, 2, "/foo")
        odd += message(2, 1, START_NS, EMPTY)
        return put(tmp_path / "bag", file(chunk(SCHEMA + CHANNEL + odd + MESSAGES)))

    def test_requested_topics_are_read(self, bag):
        assert wrenches(bag, ["wrench"]) == COUNT

    def test_all_is_saved(self, bag, tmp_path):
        assert saved(bag / "b_0.mcap", tmp_path) in (COUNT, COUNT + 1)


def test_wrenches_beside_service_events_are_saved(tmp_path):
    """ros2/rosbag2 rosbag2_cpp/test/rosbag2_cpp/bags/topics_and_services.mcap."""
    definition = b"service_msgs/ServiceEventInfo info\n"
    event = schema(2, "example_interfaces/srv/AddTwoInts_Event", "ros2msg", definition)
    event += channel(2, 2, "/add/_service_event") + message(2, 1, START_NS, EMPTY)
    bag = put(tmp_path / "bag", file(chunk(SCHEMA + CHANNEL + event + MESSAGES)))
    assert saved(bag / "b_0.mcap", tmp_path) in (COUNT, COUNT + 1)


def test_two_definitions_of_a_type_are_distinguished(tmp_path):
    """foxglove/mcap#374, ros-foxglove-bridge#253: merged, or split across an upgrade."""
    kind, topic = "my_msgs/msg/P", "/cabols/p"
    first = schema(1, kind, "ros2msg", b"float64 x\nfloat64 y\n") + channel(1, 1, topic)
    second = schema(2, kind, "ros2msg", b"float64 y\nfloat64 x\n") + channel(2, 2, topic)
    messages = message(1, 1, START_NS, CDR + struct.pack("<2d", 1, 2))
    messages += message(2, 2, START_NS + 1, CDR + struct.pack("<2d", 2, 1))
    bag = put(tmp_path / "bag", file(first, second, messages), [(topic, kind, 2)])
    found = outcome(lambda: read_bag(bag)["p"]["x"])
    assert isinstance(found, BagError) or np.array_equal(found, [1.0, 1.0])


def test_hole_in_the_middle_costs_its_own_chunks(tmp_path):
    """foxglove/mcap#1390, PR#1372; ros2/rosbag2#2133: 4 KiB of zeros in a bag of 40 chunks."""
    raw = bytearray(whole(tmp_path / "whole.mcap", DAMAGED_COUNT, 16384))
    middle = len(raw) // 2 // 4096 * 4096
    raw[middle : middle + 4096] = bytes(4096)
    bag = put(tmp_path / "bag", bytes(raw), [(TOPIC, TYPE, DAMAGED_COUNT)])
    found = saved(bag / "b_0.mcap", tmp_path)
    assert isinstance(found, int)
    assert found >= 0.9 * DAMAGED_COUNT


class TestTypeNameWithoutMsg:
    """ros2/rosbag2 rosbag2_transport/test/resources/mcap/test_bag_for_seek."""

    @pytest.fixture
    def bag(self, tmp_path):
        old = schema(1, OLD_TYPE, "ros2msg", DEFINITION) + CHANNEL + MESSAGES
        return put(tmp_path / "bag", file(chunk(old)), [(TOPIC, OLD_TYPE, COUNT)])

    def test_it_is_read(self, bag):
        assert wrenches(bag) == COUNT

    def test_it_is_saved(self, bag, tmp_path):
        assert saved(bag / "b_0.mcap", tmp_path) == COUNT


def test_bag_that_was_reindexed_is_read(tmp_path):
    """ros2/rosbag2#2175: `ros2 bag reindex` leaves storage_identifier empty."""
    data = file(chunk(SCHEMA + CHANNEL + MESSAGES))
    assert wrenches(put(tmp_path / "bag", data, storage='""')) == COUNT


def test_split_bag_of_a_killed_recorder_is_saved(tmp_path):
    """ros2/rosbag2#1619, #2003; rosbag2_py/test/resources/mcap/reindex_test_bags/multiple_files."""
    split = tmp_path / "split"
    split.mkdir()
    for k in range(3):
        data = file(chunk(SCHEMA + CHANNEL + MESSAGES), complete=k < 2)
        (split / f"b_{k}.mcap").write_bytes(data)
    assert saved(split, tmp_path) == 3 * COUNT


def test_chunk_of_two_zstd_frames_is_read(tmp_path):
    """Valid by zstd's format, and read by other readers."""
    records = SCHEMA + CHANNEL + MESSAGES
    body = zstd(records[:1000]) + zstd(records[1000:])
    assert wrenches(put(tmp_path / "bag", file(chunk(records, "zstd", body)))) == COUNT
