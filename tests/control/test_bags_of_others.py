# SPDX-License-Identifier: Apache-2.0
"""Bags as other programs write them: what can be read is read, and what cannot is said."""

from __future__ import annotations

import itertools
import struct
import warnings

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
    STEP_NS,
    TOPIC,
    TYPE,
    channel,
    chunk,
    file,
    message,
    put,
    record,
    schema,
    text,
    whole,
    wrench,
)
from cabols_control.bags.errors import BagError, BagWarning
from cabols_control.bags.reader import iterate, read_bag
from cabols_control.bags.recover import main, recover
from cabols_control.bags.storage.salvage import Salvage

WRENCHES = [wrench(i) for i in range(COUNT)]
FIRST = slice(0, COUNT)


def saved(source, output):
    """Messages of a recovered bag as (topic, log time, bytes), and the recovery."""
    recovery = recover(source, output)
    found = []
    for path in sorted(output.glob("*.mcap")):
        items = Salvage(path, strict=True).messages()
        found += [(item.channel.topic, item.log_time_ns, item.data) for item in items]
    return found, recovery


ODD = {
    "JSON": schema(2, "pkg/msg/J", "jsonschema", b'{"type": "object"}')
    + channel(2, 2, "/odd", "json"),
    "ros2idl": schema(2, "pkg/msg/I", "ros2idl", b"module pkg { unfinished")
    + channel(2, 2, "/odd"),
    "empty definition": schema(2, "pkg/msg/E", "ros2msg", b"") + channel(2, 2, "/odd"),
    "no schema": channel(2, 0, "/odd"),
    "lost schema": channel(2, 77, "/odd"),
    "not UTF-8": schema(2, "pkg/msg/L", "ros2msg", b"float64 x # \xe9\xff\n")
    + channel(2, 2, "/odd"),
    "nested type missing": schema(2, "pkg/srv/S_Event", "ros2msg", b"service_msgs/Nothing info\n")
    + channel(2, 2, "/odd/_service_event"),
    "protobuf": schema(2, "pkg.P", "protobuf", b"\x0a\x00") + channel(2, 2, "/odd", "protobuf"),
}


@pytest.mark.parametrize("odd", ODD.values(), ids=ODD)
def test_odd_channel_keeps_no_other_away_and_is_copied_byte_for_byte(odd, tmp_path):
    payload = b"\x7b\x22odd\x22\x7d"
    data = file(chunk(SCHEMA + CHANNEL + odd + message(2, 7, START_NS, payload) + MESSAGES))
    name = "/odd/_service_event" if b"_service_event" in odd else "/odd"
    bag = put(tmp_path / "bag", data, [(TOPIC, TYPE, COUNT), (name, "pkg/msg/X", 1)])
    assert len(read_bag(bag, ["wrench"])["wrench"]) == COUNT
    with pytest.warns(BagWarning, match="left out"):
        assert len(read_bag(bag)["wrench"]) == COUNT
    with pytest.raises(BagError):
        read_bag(bag, [name])
    found, recovery = saved(bag / "b_0.mcap", tmp_path / "out")
    assert (name, START_NS, payload) in found
    assert recovery.messages == len(found) == COUNT + 1
    before = Salvage(bag / "b_0.mcap", strict=True)
    after = Salvage(tmp_path / "out" / "out_0.mcap", strict=True)
    assert len(list(before.messages())) == len(list(after.messages()))
    a, b = (
        [c for c in s.channels if c.topic == name][0]  # noqa: RUF015
        for s in (before, after)
    )
    assert (a.schema.name, a.schema.encoding, a.schema.data, a.encoding) == (
        b.schema.name,
        b.schema.encoding,
        b.schema.data,
        b.encoding,
    )


def test_ros2idl_is_decoded(tmp_path):
    idl = (
        b"="
        * 80
        + b"\nIDL: pkg/msg/Pair\nmodule pkg { module msg { struct Pair { double x; double y; }; "
        b"}; };\n"
    )

    data = file(
        schema(1, "pkg/msg/Pair", "ros2idl", idl),
        channel(1, 1, "/cabols/pair"),
        message(1, 1, START_NS, CDR + struct.pack("<2d", 1.0, 2.0)),
    )
    bag = put(tmp_path / "bag", data, [("/cabols/pair", "pkg/msg/Pair", 1)])
    assert read_bag(bag)["pair"]["y"].tolist() == [2.0]


@pytest.mark.parametrize("size", [0, 3, 21])
@pytest.mark.parametrize("chunked", [True, False])
def test_short_message_record_costs_itself(size, chunked, tmp_path):
    short = record(5, bytes([1, 0, *[0] * 19])[:size])
    half = len(MESSAGES) // 2
    records = SCHEMA + CHANNEL + MESSAGES[:half] + short + MESSAGES[half:]
    bag = put(tmp_path / "bag", file(chunk(records) if chunked else records))
    with pytest.warns(BagWarning, match=f"record of {size} bytes is left out"):
        assert np.array_equal(read_bag(bag)["wrench"]["wrench.force.x"], np.arange(COUNT))
    found, recovery = saved(bag / "b_0.mcap", tmp_path / "out")
    assert [data for _, _, data in found] == WRENCHES
    assert recovery.dropped_bytes == 9 + size


@pytest.mark.parametrize("payload", [b"", b"\0", CDR, CDR + bytes(9), b"\0\x07\0\0" + bytes(60)])
def test_short_payload_costs_itself_and_is_said(payload, tmp_path):
    records = SCHEMA + CHANNEL + message(1, 9, START_NS - 1, payload) + MESSAGES
    bag = put(tmp_path / "bag", file(chunk(records)), [(TOPIC, TYPE, COUNT + 1)])
    with pytest.warns(BagWarning, match=r"1 of 51 messages are no .* at 1699999999999999999 ns"):
        series = read_bag(bag)["wrench"]
    assert np.array_equal(series["wrench.force.x"], np.arange(COUNT))
    assert series.log_time_ns[0] == START_NS
    found, _ = saved(bag / "b_0.mcap", tmp_path / "out")
    assert found[0][2] == payload


@pytest.mark.parametrize("time_ns", [2**63, 2**64 - 1, 0])
def test_times_beyond_the_range_of_ros_are_read_as_ros_does_and_copied(time_ns, tmp_path):
    records = SCHEMA + CHANNEL + message(1, 9, time_ns, wrench(99)) + MESSAGES
    bag = put(tmp_path / "bag", file(chunk(records)), [(TOPIC, TYPE, COUNT + 1)])
    series = read_bag(bag)["wrench"]
    assert series.log_time_ns[0] == (time_ns if time_ns < 2**63 else time_ns - 2**64)
    found, _ = saved(bag / "b_0.mcap", tmp_path / "out")
    assert found[0][1] == time_ns
    assert len(read_bag(tmp_path / "out")["wrench"]) == COUNT + 1


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d.replace(b"\n", b"\r\n"),
        lambda d: b"\xef\xbb\xbf" + d,
        lambda d: b"# caf\xe9\n" + d,
        lambda d: d.replace(b"float64 x", b"float64    x   # [N]"),
        lambda d: d + b"\n\n",
    ],
    ids=["CRLF", "BOM", "latin-1", "comments", "blank lines"],
)
def test_definitions_of_other_editors_are_read_and_kept(change, tmp_path):
    data = change(DEFINITION)
    bag = put(tmp_path / "bag", file(chunk(schema(1, TYPE, "ros2msg", data) + CHANNEL + MESSAGES)))
    bag_read = read_bag(bag)
    assert np.array_equal(bag_read["wrench"]["wrench.force.x"], np.arange(COUNT))
    assert bag_read.start_ns == 1_700_000_000 * 10**9
    saved(bag / "b_0.mcap", tmp_path / "out")
    copy = Salvage(tmp_path / "out" / "out_0.mcap", strict=True)
    list(copy.messages())
    assert copy.channels[0].schema.data == data


PAIR = [
    ("float64 x\nfloat64 y\n", "float64 x\nfloat64 y # again\n", True),
    ("float64 x\nfloat64 y\n", "float64 y\nfloat64 x\n", True),
    ("float64 x\nfloat64 y\n", "float64 x\nint64 y\n", False),
    ("float64 x\nfloat64 y\n", "float64 x\nfloat64 z\n", False),
    ("float64 x\nfloat64 y\n", "float64 x\n", False),
]


@pytest.mark.parametrize(("first", "second", "agree"), PAIR)
def test_each_message_is_decoded_by_its_own_definition_or_refused(first, second, agree, tmp_path):
    kind, topic = "pkg/msg/P", "/cabols/p"
    records, values = b"", {"x": 1.0, "y": 2.0, "z": 3.0}
    for number, definition in ((1, first), (2, second)):
        records += schema(number, kind, "ros2msg", definition.encode())
        records += channel(number, number, topic)
        body = b""
        for line in definition.splitlines():
            code = "<d" if line.startswith("float64") else "<q"
            body += struct.pack(code, (float if code == "<d" else int)(values[line.split()[1]]))
        records += message(number, 1, START_NS + number, CDR + body)
    bag = put(tmp_path / "bag", file(chunk(records)), [(topic, kind, 2)])
    if agree:
        found = read_bag(bag)["p"]
        assert found["x"].tolist() == [1.0, 1.0]
        assert found["y"].tolist() == [2.0, 2.0]
    else:
        with pytest.raises(BagError, match="two that disagree on"):
            read_bag(bag)
    assert [data for _, _, data in iterate(bag)] == [
        data for *_, data in saved(bag, tmp_path / "o")[0]
    ]


def test_two_types_on_one_topic_are_refused_by_name(tmp_path):
    records = SCHEMA + CHANNEL + schema(2, "std_msgs/msg/Float64", "ros2msg", b"float64 data\n")
    records += channel(2, 2, TOPIC) + MESSAGES + message(2, 1, START_NS, CDR + bytes(8))
    bag = put(tmp_path / "bag", file(chunk(records)), [(TOPIC, TYPE, COUNT + 1)])
    with pytest.raises(BagError, match=r"geometry_msgs/msg/WrenchStamped and std_msgs/msg/Float64"):
        read_bag(bag)


def test_channel_number_that_is_used_again_is_another_channel(tmp_path):
    second = channel(1, 1, "/cabols/other") + message(1, 1, START_NS, wrench(7))
    counts = [(TOPIC, TYPE, COUNT), ("/cabols/other", TYPE, 1)]
    bag = put(tmp_path / "bag", file(chunk(SCHEMA + CHANNEL + MESSAGES), chunk(second)), counts)
    found = read_bag(bag)
    assert len(found["wrench"]) == COUNT
    assert found["other"]["wrench.force.x"].tolist() == [7.0]
    assert saved(bag, tmp_path / "out")[1].topics == {"wrench": COUNT, "other": 1}


def test_attachments_metadata_and_private_records_are_copied(tmp_path):
    attached = (
        struct.pack("<QQ", 1, 2) + text("a.bin") + text("x/y") + struct.pack("<Q", 3) + b"abc"
    )
    other = record(9, attached + struct.pack("<I", 0))
    pairs = text("key") + text("value")
    other += record(12, text("calibration") + struct.pack("<I", len(pairs)) + pairs)
    other += record(0x90, b"somebody's own")
    bag = put(tmp_path / "bag", file(chunk(SCHEMA + CHANNEL + MESSAGES), other))
    saved(bag / "b_0.mcap", tmp_path / "out")
    before = [
        r for r in Salvage(bag / "b_0.mcap", strict=True).records() if not hasattr(r, "channel")
    ]
    after = list(Salvage(tmp_path / "out" / "out_0.mcap", strict=True).records())
    assert len(before) == 3
    assert all(r in after for r in before)


def test_fewer_messages_than_metadata_yaml_announces_are_said(tmp_path, capsys):
    bag = put(tmp_path / "bag", file(chunk(SCHEMA + CHANNEL + MESSAGES)), [(TOPIC, TYPE, 60)])
    with pytest.warns(BagWarning, match="wrench: 50 of 60 messages"):
        read_bag(bag)
    assert main([str(bag)]) == 0
    assert "50 of the 60 messages that it announced" in capsys.readouterr().out
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(read_bag(bag)["wrench"]) == COUNT


@pytest.mark.parametrize("bit", range(8))
@pytest.mark.parametrize("byte", [0, 1, 2, 5, 8])
def test_flipped_bit_of_a_chunks_frame_costs_nothing(byte, bit, tmp_path):
    raw = bytearray(whole(tmp_path / "whole.mcap", 600, 4096))
    at = chunk_places(raw)[3]
    raw[at + byte] ^= 1 << bit
    bag = put(tmp_path / "bag", bytes(raw), [(TOPIC, TYPE, 600)])
    with pytest.raises(BagError, match="recover"):
        read_bag(bag)
    found, recovery = saved(bag, tmp_path / "out")
    assert [data for *_, data in found] == [wrench(i) for i in range(600)]
    assert recovery.dropped_bytes == 0


def chunk_places(raw):
    """Offsets of the chunks of an undamaged file."""
    at, found = 8, []
    while at < len(raw) - 8:
        opcode, length = struct.unpack_from("<BQ", raw, at)
        if opcode == 6:
            found.append(at)
        at += 9 + length
    return found


@pytest.mark.parametrize("index", [True, False])
@pytest.mark.parametrize("hole", [1, 9, 100, 4096, 9000])
@pytest.mark.parametrize("fraction", [0.0, 0.31, 0.5, 0.77])
def test_hole_costs_the_chunks_that_it_touches(index, hole, fraction, tmp_path):
    count = 3000
    raw = whole(tmp_path / "whole.mcap", count, 8192)
    if not index:
        places = chunk_places(raw)
        raw = raw[: places[-1]]
    good = [item.data for item in Salvage(tmp_path / "whole.mcap", strict=True).messages()]
    places = [*chunk_places(raw), len(raw)]
    start = places[0] + int(fraction * (len(raw) - places[0] - hole)) if index else places[3] + 50
    damaged = bytearray(raw)
    damaged[start : start + hole] = bytes(byte ^ 0xFF for byte in raw[start : start + hole])
    touched = sum(a < start + hole and start < b for a, b in itertools.pairwise(places))
    bag = put(tmp_path / "bag", bytes(damaged), [(TOPIC, TYPE, count)])
    found, _ = saved(bag / "b_0.mcap", tmp_path / "out")
    data = [data for *_, data in found]
    assert set(data) <= set(good)
    each = count / (len(chunk_places(whole(tmp_path / "again.mcap", count, 8192))))
    whole_count = len(good) if index else count - each
    assert len(data) >= whole_count - (touched + (0 if index else 1)) * (each + 2)


def test_damaged_unchunked_file_goes_on_at_the_next_message(tmp_path):
    raw = bytearray(file(SCHEMA + CHANNEL + MESSAGES))
    at = len(file(SCHEMA + CHANNEL, complete=False)) + 20 * len(message(1, 1, 0, wrench(0)))
    raw[at + 1] ^= 0x40
    bag = put(tmp_path / "bag", bytes(raw))
    found, _ = saved(bag / "b_0.mcap", tmp_path / "out")
    data = [data for *_, data in found]
    assert len(data) >= COUNT - 2
    assert set(data) <= set(WRENCHES)


def test_first_chunk_lost_leaves_the_others_their_channel_from_the_index(tmp_path):
    raw = bytearray(whole(tmp_path / "whole.mcap", 600, 4096))
    places = chunk_places(raw)
    raw[places[0] + 60] ^= 0xFF
    bag = put(tmp_path / "bag", bytes(raw), [(TOPIC, TYPE, 600)])
    found, recovery = saved(bag, tmp_path / "out")
    assert recovery.unknown == 0
    assert len(found) > 600 * (1 - 1.5 / len(places))
    assert recovery.expected == 600


class TestSplit:
    @pytest.fixture
    def split(self, tmp_path):
        folder = tmp_path / "split"
        folder.mkdir()
        for k in (0, 1, 2, 10):
            shifted = b"".join(
                message(1, i + 1, START_NS + (1000 * k + i) * STEP_NS, wrench(1000 * k + i))
                for i in range(COUNT)
            )
            data = file(chunk(SCHEMA + CHANNEL + shifted), complete=k != 10)
            (folder / f"b_{k}.mcap").write_bytes(data)
        return folder

    def test_recovered_in_place_in_the_order_of_numbers(self, split):
        whole_before = (split / "b_2.mcap").read_bytes()
        assert recover(split).messages == 4 * COUNT
        assert (split / "b_2.mcap").read_bytes() == whole_before
        times = read_bag(split)["wrench"].log_time_ns
        assert times.size == 4 * COUNT
        assert (np.diff(times) > 0).all()
        assert not recover(split).changed

    def test_one_of_its_files_needs_an_output(self, split, tmp_path):
        with pytest.raises(BagError, match=r"name .*split, or an output"):
            recover(split / "b_2.mcap")
        assert recover(split / "b_2.mcap", tmp_path / "one").messages == COUNT
