# SPDX-License-Identifier: Apache-2.0
"""Small MCAP bags, record by record (format: mcap.dev/spec): each oddity where it belongs."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import zstandard
from mcap.writer import CompressionType, Writer

from cabols_control.bags.definitions import Definitions

TYPE, TOPIC = "geometry_msgs/msg/WrenchStamped", "/cabols/wrench"
START_NS, STEP_NS = 1_700_000_000_000_000_000, 1_000_000
MAGIC = b"\x89MCAP0\r\n"
DEFINITION = Definitions().get(TYPE).text.encode()
CDR = b"\0\1\0\0"
COUNT = 50
"""Wrenches of MESSAGES."""


def wrench(i):
    """CDR of a WrenchStamped whose force x is i."""
    stamp = struct.pack("<iI", 1_700_000_000 + i // 1000, i % 1000 * STEP_NS)
    head = stamp + struct.pack("<I", 5) + b"base\0"
    return CDR + head + b"\0" * (-len(head) % 8) + struct.pack("<6d", i, 0, 0, 0, 0, 0)


def record(opcode, content):
    """One record."""
    return struct.pack("<BQ", opcode, len(content)) + content


def text(value):
    """A string with its length."""
    return struct.pack("<I", len(value.encode())) + value.encode()


def schema(number, name, encoding, data):
    """Schema record."""
    head = struct.pack("<H", number) + text(name) + text(encoding)
    return record(3, head + struct.pack("<I", len(data)) + data)


def channel(number, schema_number, topic, encoding="cdr"):
    """Channel record without metadata."""
    head = struct.pack("<HH", number, schema_number) + text(topic) + text(encoding)
    return record(4, head + struct.pack("<I", 0))


def message(number, sequence, time_ns, data):
    """Message record."""
    return record(5, struct.pack("<HIQQ", number, sequence, time_ns, time_ns) + data)


def chunk(records, compression="", body=None):
    """Chunk record; body: the compressed records."""
    body = records if body is None else body
    head = struct.pack("<QQQI", 0, 0, len(records), zlib.crc32(records)) + text(compression)
    return record(6, head + struct.pack("<Q", len(body)) + body)


def file(*parts, complete=True):
    """A file; not complete: without footer, as a kill leaves it."""
    end = record(15, struct.pack("<I", 0)) + record(2, struct.pack("<QQI", 0, 0, 0)) + MAGIC
    return MAGIC + record(1, text("ros2") + text("t")) + b"".join(parts) + end * complete


SCHEMA, CHANNEL = schema(1, TYPE, "ros2msg", DEFINITION), channel(1, 1, TOPIC)
MESSAGES = b"".join(message(1, i + 1, START_NS + i * STEP_NS, wrench(i)) for i in range(COUNT))


def zstd(data):
    """One zstd frame."""
    return zstandard.ZstdCompressor().compress(data)


def put(folder, data, counts=((TOPIC, TYPE, COUNT),), storage="mcap"):
    """Write a bag's folder whose metadata.yaml announces the counts; return the folder."""
    folder = Path(folder)
    folder.mkdir(parents=True)
    (folder / "b_0.mcap").write_bytes(data)
    lines = [
        "rosbag2_bagfile_information:",
        "  version: 9",
        f"  storage_identifier: {storage}",
        "  duration: {nanoseconds: 1}",
        f"  starting_time: {{nanoseconds_since_epoch: {START_NS}}}",
        f"  message_count: {sum(count for _, _, count in counts)}",
        "  topics_with_message_count:",
    ]
    for topic, kind, count in counts:
        lines.append(
            f"    - {{topic_metadata: {{name: {topic}, type: {kind}, serialization_format: cdr, "
            f"offered_qos_profiles: ''}}, message_count: {count}}}"
        )
    lines += [
        "  compression_format: ''",
        "  compression_mode: ''",
        "  relative_file_paths: [b_0.mcap]",
    ]
    (folder / "metadata.yaml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder


def whole(path, count, chunk_size):
    """Bytes of a complete file with index, statistics and checksums, written to a path."""
    with path.open("wb") as stream:
        writer = Writer(
            stream, chunk_size=chunk_size, compression=CompressionType.ZSTD, enable_crcs=True
        )
        writer.start("ros2", "test")
        number = writer.register_schema(TYPE, "ros2msg", DEFINITION)
        topic = writer.register_channel(TOPIC, "cdr", number, {"offered_qos_profiles": ""})
        for i in range(count):
            time_ns = START_NS + i * STEP_NS
            writer.add_message(topic, time_ns, wrench(i), time_ns, i + 1)
        writer.finish()
    return path.read_bytes()
