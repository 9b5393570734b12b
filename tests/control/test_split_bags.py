# SPDX-License-Identifier: Apache-2.0
"""A bag that goes on in further files: the same messages, for us and for rosbags and mcap."""

from __future__ import annotations

import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from cabols_control.bags.metadata import OfferedQos
from cabols_control.bags.reader import iterate, read_bag
from cabols_control.bags.recover import recover
from cabols_control.bags.writer import BagWriter, Split

T0 = 1_700_000_000_000_000_000
TEXT = "std_msgs/msg/String"
METADATA = {"description": "a split run"}


def text(i):
    """CDR of a string of 200 letters, which no compression makes small."""
    letters = "".join(chr(97 + (i * 7919 + k * k * (i + 3)) % 26) for k in range(200))
    return b"\0\1\0\0" + (201).to_bytes(4, "little") + letters.encode() + b"\0"


def fill(writer, count=60, flush_every=5):
    """Two topics, one of which has a message at the beginning alone, as latched ones."""
    writer.add_topic("said", TEXT, OfferedQos(1, "best_effort"))
    writer.add_topic("once", TEXT, OfferedQos(1, "reliable", "transient_local"))
    written = []
    for i in range(count):
        for topic in ("said", *["once"] * (i == 0)):
            writer.write(topic, T0 + i * 10**9, T0 + i * 10**9 - 5, text(i), i + 1)
            written.append((f"/cabols/{topic}", text(i)))
        if (i + 1) % flush_every == 0:
            writer.flush()
    return written


def read_by_rosbags(folder):
    with AnyReader([folder]) as reader:
        return [(connection.topic, bytes(raw)) for connection, _, raw in reader.messages()]


@pytest.mark.parametrize(
    ("split", "files"),
    [
        (Split(), 1),
        (Split(duration_s=9.0), 6),
        (Split(duration_s=14.0), 4),
        (Split(duration_s=1e6, size=10**9), 1),
        (Split(size=1), 12),
        (Split(size=4000), None),
    ],
)
def test_split_bag_holds_what_was_written(split, files, tmp_path):
    folder = tmp_path / "run"
    with BagWriter(folder, METADATA, split) as writer:
        written = fill(writer)
        assert writer.messages == {"/cabols/said": 60, "/cabols/once": 1}
    parts = sorted(folder.glob("*.mcap"), key=lambda path: int(path.stem.rpartition("_")[2]))
    assert files in (None, len(parts))
    assert len(parts) > 1 or files == 1
    assert read_by_rosbags(folder) == written
    assert [(f"/cabols/{topic}", raw) for topic, _, raw in iterate(folder)] == written
    assert read_bag(folder).metadata == METADATA
    information = yaml.safe_load((folder / "metadata.yaml").read_text())[
        "rosbag2_bagfile_information"
    ]
    assert information["relative_file_paths"] == [part.name for part in parts]
    assert information["message_count"] == len(written)
    assert information["duration"]["nanoseconds"] == 59 * 10**9
    counts = {
        t["topic_metadata"]["name"]: t["message_count"]
        for t in information["topics_with_message_count"]
    }
    assert counts == {"/cabols/said": 60, "/cabols/once": 1}
    found = []
    for part in parts:
        with part.open("rb") as stream:
            reader = make_reader(stream)
            # Each file can be read alone: topics and types are in it.
            channels = {c.topic for c in reader.get_summary().channels.values()}
            assert channels == {"/cabols/said", "/cabols/once"}
            found += [(c.topic, m.data) for _, c, m in reader.iter_messages()]
    assert found == written


@pytest.mark.parametrize("count", [60, 61])
@pytest.mark.parametrize("split", [Split(size=1), Split(duration_s=9.0)])
def test_killed_recorder_leaves_a_split_bag_that_is_recovered(count, split, tmp_path):
    """Also one that was killed right after it had begun another file."""
    folder = tmp_path / "run"
    writer = BagWriter(folder, METADATA, split)
    written = fill(writer, count)
    if count == 61:
        writer.flush()
    else:
        writer._go_on()
    writer.abandon()
    assert not (folder / "metadata.yaml").exists()
    saved = recover(folder)
    assert saved.messages == len(written)
    assert read_by_rosbags(folder) == written
    assert read_bag(folder).metadata == METADATA
