# SPDX-License-Identifier: Apache-2.0
"""Two hundred variants of each kind of bag: only BagError escapes, nothing is silently different,
and nothing is lost that lies outside the damage."""

from __future__ import annotations

import itertools
import shutil
import struct
import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bag_maker import (
    CDR,
    CHANNEL,
    COUNT,
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
    record,
    schema,
    whole,
    wrench,
)
from cabols_control.bags.errors import BagError
from cabols_control.bags.reader import read_bag
from cabols_control.bags.recover import recover
from cabols_control.bags.storage.salvage import Salvage

VARIANTS = settings(
    max_examples=200,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
MANY = 600


def pieces_of(raw):
    """(begin, end, messages) of each chunk of an undamaged file."""
    at, found = 8, []
    while at < len(raw) - 8:
        opcode, length = struct.unpack_from("<BQ", raw, at)
        if opcode == 6:
            found.append((at, at + 9 + length))
        at += 9 + length
    return found


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """Bytes of a complete bag; its chunks; its messages by chunk."""
    path = tmp_path_factory.mktemp("good") / "b_0.mcap"
    raw = whole(path, MANY, 4096)
    chunks = pieces_of(raw)
    parts = []
    for begin, end in chunks:
        part = path.with_name("part.mcap")
        part.write_bytes(raw[:8] + raw[chunks[0][0] : chunks[0][1]] + raw[begin:end])
        first = 0 if begin == chunks[0][0] else len(parts[0])
        items = [item.data for item in Salvage(part, strict=False).messages()]
        parts.append(items[first:] if first else items[: len(items) // 2])
    assert sum(map(len, parts)) == MANY
    return raw, chunks, parts


def outcome_of(call):
    """What a call gives, or the BagError; whether something was said. Others escape."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            return call(), bool(said)
        except BagError as error:
            return error, True


def fresh(tmp_path):
    for name in ("bag", "out"):
        shutil.rmtree(tmp_path / name, ignore_errors=True)
    return tmp_path / "bag", tmp_path / "out"


def saved_messages(folder, count):
    """Messages that are saved of a bag, in order."""
    found, _ = outcome_of(lambda: recover(folder / "b_0.mcap", folder.parent / "out"))
    if isinstance(found, BagError):
        return None
    (path,) = (folder.parent / "out").glob("*.mcap")
    assert found.expected <= max(count, found.messages)
    return [item.data for item in Salvage(path, strict=True).messages()]


def holds_in_order(some, everything):
    """Whether a list is a part of another, in its order."""
    rest = iter(everything)
    return all(any(item == other for other in rest) for item in some)


@VARIANTS
@given(data=st.data())
def test_damage_costs_its_own_chunks(good, tmp_path, data):
    raw, chunks, parts = good
    whole_file = data.draw(st.booleans(), "with index")
    last = len(chunks) - 1
    content = bytearray(raw if whole_file else raw[: chunks[last][0]])
    kept = parts if whole_file else parts[:last]
    touched = set()
    for _ in range(data.draw(st.integers(1, 3), "places")):
        size = data.draw(st.sampled_from([1, 1, 1, 8, 64, 1024, 5000]))
        start = data.draw(st.integers(chunks[0][0], len(content) - 1))
        end = min(start + size, len(content))
        how = data.draw(st.sampled_from(["zeros", "ones", "flip", "noise"]))
        if how == "flip":
            content[start] ^= 1 << data.draw(st.integers(0, 7))
            end = start + 1
        elif how == "noise":
            content[start:end] = np.random.default_rng(start).bytes(end - start)
        else:
            content[start:end] = bytes([0 if how == "zeros" else 255]) * (end - start)
        touched |= {k for k, (a, b) in enumerate(chunks) if a < end and start < b}
    bag, _ = fresh(tmp_path)
    put(bag, bytes(content), [(TOPIC, TYPE, MANY)])
    series, said = outcome_of(lambda: read_bag(bag)["wrench"])
    if not isinstance(series, BagError):
        assert said or np.array_equal(series["wrench.force.x"], np.arange(MANY))
    found = saved_messages(bag, MANY)
    everything = [item for part in parts for item in part]
    # The first chunk names the channel; the index repeats it, if it is whole.
    names_lost = 0 in touched
    if found is None:
        assert names_lost
        return
    assert holds_in_order(found, everything)
    if not names_lost:
        safe = [item for k, part in enumerate(kept) for item in part if k not in touched]
        assert set(safe) <= set(found)


@VARIANTS
@given(cut=st.floats(0.0, 1.0))
def test_cut_file_gives_all_chunks_before_the_cut(good, tmp_path, cut):
    raw, chunks, parts = good
    size = int(cut * len(raw))
    bag, _ = fresh(tmp_path)
    put(bag, raw[:size], [(TOPIC, TYPE, MANY)])
    safe = sum(len(part) for (_, end), part in zip(chunks, parts, strict=True) if end <= size)
    found = saved_messages(bag, MANY)
    everything = [item for part in parts for item in part]
    assert found == everything[: len(found)]
    assert len(found) >= safe


@VARIANTS
@given(data=st.data())
def test_unchunked_file_loses_what_the_damage_touches(tmp_path, data):
    """Nothing but the order proves a message there: the touched ones may come as they are."""
    raw = bytearray(file(SCHEMA + CHANNEL + MESSAGES))
    first = len(file(SCHEMA + CHANNEL, complete=False))
    size = len(MESSAGES) // COUNT
    start = data.draw(st.integers(first, first + len(MESSAGES) - 1))
    length = data.draw(st.sampled_from([1, 4, 100, 300]))
    end = min(start + length, first + len(MESSAGES))
    raw[start:end] = bytes(byte ^ 0xFF for byte in raw[start:end])
    bag, _ = fresh(tmp_path)
    put(bag, bytes(raw))
    outcome_of(lambda: read_bag(bag))
    found = saved_messages(bag, COUNT)
    touched = range((start - first) // size, (end - 1 - first) // size + 1)
    safe = {wrench(i) for i in range(COUNT) if i not in touched}
    # One more may go where its neighbour's frame cannot be trusted.
    assert len(safe - set(found)) <= 1


ODD_CHANNELS = st.tuples(
    st.sampled_from(["ros2msg", "ros2idl", "jsonschema", "protobuf", "", "x"]),
    st.binary(max_size=60),
    st.sampled_from(["cdr", "json", "", "protobuf"]),
    st.text(max_size=12),
    st.lists(st.binary(max_size=40), min_size=1, max_size=4),
)


@VARIANTS
@given(channels=st.lists(ODD_CHANNELS, min_size=1, max_size=3), compressed=st.booleans())
def test_odd_channels_are_copied_and_keep_nothing_away(tmp_path, channels, compressed):
    odd, payloads = b"", []
    for number, (encoding, definition, form, name, messages) in enumerate(channels, start=2):
        odd += schema(number, name, encoding, definition) + channel(
            number, number, f"/odd_{number}", form
        )
        odd += b"".join(message(number, 1, START_NS, payload) for payload in messages)
        payloads += messages
    records = SCHEMA + CHANNEL + odd + MESSAGES
    bag, _ = fresh(tmp_path)
    put(bag, file(chunk(records) if compressed else records))
    series, _ = outcome_of(lambda: read_bag(bag, ["wrench"])["wrench"])
    assert np.array_equal(series["wrench.force.x"], np.arange(COUNT))
    assert saved_messages(bag, COUNT) == payloads + [wrench(i) for i in range(COUNT)]
    for number in range(2, 2 + len(channels)):
        outcome_of(lambda number=number: read_bag(bag, [f"/odd_{number}"]))


FIELDS = st.lists(
    st.tuples(
        st.sampled_from(["float64", "float32", "int32", "uint8", "bool", "int64"]),
        st.sampled_from("xyz"),
    ),
    min_size=1,
    max_size=3,
    unique_by=lambda field: field[1],
)
CODES = {"float64": "d", "float32": "f", "int32": "i", "uint8": "B", "bool": "?", "int64": "q"}
VALUES = {"x": 1, "y": 2, "z": 3}


def serialised(fields):
    """CDR of a message whose fields have the values of VALUES."""
    body = b""
    for kind, name in fields:
        code = CODES[kind]
        size = struct.calcsize("<" + code)
        body += b"\0" * (-len(body) % size)
        body += struct.pack("<" + code, VALUES[name])
    return CDR + body


@VARIANTS
@given(first=FIELDS, second=FIELDS)
def test_definitions_that_disagree_are_each_used_or_refused(tmp_path, first, second):
    kind, topic, records = "pkg/msg/P", "/cabols/p", b""
    for number, fields in ((1, first), (2, second)):
        text = "".join(f"{kind_} {name}\n" for kind_, name in fields)
        records += schema(number, kind, "ros2msg", text.encode()) + channel(number, number, topic)
        records += message(number, 1, START_NS + number, serialised(fields))
    bag, _ = fresh(tmp_path)
    put(bag, file(chunk(records)), [(topic, kind, 2)])
    series, _ = outcome_of(lambda: read_bag(bag)["p"])
    if isinstance(series, BagError):
        assert sorted(first) != sorted(second)
        return
    for name in series.fields:
        wanted = bool(VALUES[name]) if series[name].dtype == bool else VALUES[name]
        assert series[name].tolist() == [wanted, wanted]


@VARIANTS
@given(payloads=st.lists(st.binary(max_size=120), min_size=1, max_size=4), at=st.integers(0, COUNT))
def test_payloads_of_any_bytes_are_copied_and_said(tmp_path, payloads, at):
    each = len(MESSAGES) // COUNT
    odd = b"".join(message(1, 1, START_NS, payload) for payload in payloads)
    records = SCHEMA + CHANNEL + MESSAGES[: at * each] + odd + MESSAGES[at * each :]
    bag, _ = fresh(tmp_path)
    count = COUNT + len(payloads)
    put(bag, file(chunk(records)), [(TOPIC, TYPE, count)])
    series, said = outcome_of(lambda: read_bag(bag)["wrench"])
    assert said or len(series) == count
    expected = [wrench(i) for i in range(COUNT)]
    assert saved_messages(bag, count) == expected[:at] + payloads + expected[at:]


@VARIANTS
@given(contents=st.lists(st.tuples(st.integers(0, 255), st.binary(max_size=60)), max_size=6))
def test_records_of_any_kind_between_the_chunks_cost_no_message(tmp_path, contents):
    half = len(MESSAGES) // 2
    odd = b"".join(record(opcode, content) for opcode, content in contents)
    data = file(chunk(SCHEMA + CHANNEL + MESSAGES[:half]), odd, chunk(MESSAGES[half:]))
    bag, _ = fresh(tmp_path)
    put(bag, data)
    outcome_of(lambda: read_bag(bag))
    found = saved_messages(bag, COUNT)
    strange = any(opcode in (1, 2, 3, 4, 5, 15) for opcode, _ in contents)
    if not strange:
        assert found == [wrench(i) for i in range(COUNT)]
    assert holds_in_order([wrench(i) for i in range(COUNT // 2)], found)


@VARIANTS
@given(text=st.text(max_size=200) | st.binary(max_size=200).map(lambda b: b.decode("latin-1")))
def test_metadata_of_any_text_gives_a_bag_error(tmp_path, text):
    bag, _ = fresh(tmp_path)
    put(bag, file(chunk(SCHEMA + CHANNEL + MESSAGES)))
    (bag / "metadata.yaml").write_bytes(text.encode("utf-8", "surrogatepass"))
    found, _ = outcome_of(lambda: read_bag(bag))
    assert isinstance(found, BagError)
    assert saved_messages(bag, COUNT) == [wrench(i) for i in range(COUNT)]


def test_order_of_messages_is_that_of_the_file():
    assert holds_in_order([1, 3], [1, 2, 3])
    assert not holds_in_order([3, 1], list(itertools.chain([1, 2], [3])))
