# SPDX-License-Identifier: Apache-2.0
"""Write the files of the corpus: small ones of this project, in the forms that others write.

Run once; the files are kept, so that a change of a library that writes them changes nothing.
"""

from __future__ import annotations

import re
import shutil
import sqlite3
import struct
import sys
from pathlib import Path

import zstandard

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "harness"))

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
    whole,
    wrench,
    zstd,
)
from cabols_control.rig_folder import rig_file

PLAIN = SCHEMA + CHANNEL + MESSAGES
EMPTY = CDR + bytes(8)
HERE = Path(__file__).resolve().parent
BAGS, CALIBRATIONS = HERE / "bags", HERE / "cal"


def beside(odd, payload=EMPTY):
    """One message of channel 2 before the 50 wrenches."""
    return file(chunk(SCHEMA + CHANNEL + odd + message(2, 1, START_NS, payload) + MESSAGES))


def bag(name, data, counts=((TOPIC, TYPE, COUNT),), **options):
    put(BAGS / name, data, counts, **options)


def metadata(folder, names, storage, mode=""):
    """metadata.yaml of 50 wrenches in some files."""
    lines = (BAGS / "plain" / "metadata.yaml").read_text("utf-8")
    lines = lines.replace("storage_identifier: mcap", f"storage_identifier: {storage}")
    lines = lines.replace("[b_0.mcap]", f"[{', '.join(names)}]")
    if mode:
        lines = lines.replace("compression_format: ''", "compression_format: zstd")
        lines = lines.replace("compression_mode: ''", f"compression_mode: {mode}")
    (folder / "metadata.yaml").write_text(lines, encoding="utf-8")


def sqlite(name, definitions, columns=True):
    """A bag as rosbag2's sqlite3 storage writes it; before Iron without definitions."""
    folder = BAGS / name
    folder.mkdir()
    connection = sqlite3.connect(folder / "b_0.db3")
    more = ", offered_qos_profiles TEXT NOT NULL" if columns else ""
    connection.execute(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
        f"serialization_format TEXT NOT NULL{more})"
    )
    connection.execute(
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, "
        "timestamp INTEGER NOT NULL, data BLOB NOT NULL)"
    )
    row = (1, TOPIC, TYPE, "cdr", *([""] if columns else []))
    connection.execute(f"INSERT INTO topics VALUES({','.join('?' * len(row))})", row)
    if definitions:
        connection.execute(
            "CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL, "
            "encoding TEXT NOT NULL, encoded_message_definition TEXT NOT NULL, "
            "type_description_hash TEXT NOT NULL)"
        )
        values = (1, TYPE, "ros2msg", DEFINITION.decode(), "")
        connection.execute("INSERT INTO message_definitions VALUES(?,?,?,?,?)", values)
    for i in range(COUNT):
        values = (i + 1, 1, START_NS + i * STEP_NS, wrench(i))
        connection.execute("INSERT INTO messages VALUES(?,?,?,?)", values)
    connection.commit()
    connection.close()
    metadata(folder, ["b_0.db3"], "sqlite3")


def packed():
    """Compressed by rosbag2 itself: the whole file, and message by message."""
    folder = BAGS / "compressed_file"
    folder.mkdir()
    data = zstandard.ZstdCompressor().compress(file(chunk(PLAIN)))
    (folder / "b_0.mcap.zstd").write_bytes(data)
    metadata(folder, ["b_0.mcap.zstd"], "mcap", "FILE")
    folder = BAGS / "compressed_messages"
    messages = b"".join(
        message(1, i + 1, START_NS + i * STEP_NS, zstd(wrench(i))) for i in range(COUNT)
    )
    bag("compressed_messages", file(chunk(SCHEMA + CHANNEL + messages)))
    metadata(folder, ["b_0.mcap"], "mcap", "MESSAGE")


def split(name, complete):
    """Two files of 25 wrenches; the recorder of an incomplete bag was killed."""
    half = len(MESSAGES) // 2
    folder = BAGS / name
    folder.mkdir()
    for k, part in enumerate((MESSAGES[:half], MESSAGES[half:])):
        data = file(chunk(SCHEMA + CHANNEL + part), complete=complete or k == 0)
        (folder / f"b_{k}.mcap").write_bytes(data)
    if complete:
        metadata(folder, ["b_0.mcap", "b_1.mcap"], "mcap")


def unclosed(data):
    """A zstd frame that was flushed and never closed."""
    compressor = zstandard.ZstdCompressor().compressobj()
    return compressor.compress(data) + compressor.flush(zstandard.COMPRESSOBJ_FLUSH_BLOCK)


def damaged():
    """A complete bag of 600 in many chunks: a hole, a flipped bit of a length, of an opcode."""
    target = BAGS / "whole.tmp"
    raw = whole(target, 600, 4096)
    target.unlink()
    at, chunks = 8, []
    while at < len(raw) - 8:
        opcode, length = struct.unpack_from("<BQ", raw, at)
        if opcode == 6:
            chunks.append((at, 9 + length))
        at += 9 + length
    counts = ((TOPIC, TYPE, 600),)
    start, size = chunks[len(chunks) // 2]
    for name, place, new in (
        ("hole", start + 60, bytes(size // 2)),
        ("length_bit", start + 2, bytes([raw[start + 2] ^ 0x40])),
        ("opcode_bit", start, bytes([raw[start] ^ 0x80])),
    ):
        changed = bytearray(raw)
        changed[place : place + len(new)] = new
        bag(name, bytes(changed), counts)


def bags():
    bag("plain", file(chunk(PLAIN)))
    bag("no_chunks", file(PLAIN))
    bag("no_definition", beside(schema(2, "my_msgs/msg/Foo", "", b"") + channel(2, 2, "/foo")))
    event = schema(2, "example_interfaces/srv/AddTwoInts_Event", "ros2msg",
                   b"service_msgs/ServiceEventInfo info\n")  # fmt: skip
    bag("service_events", beside(event + channel(2, 2, "/add/_service_event")))
    json = schema(2, "Foo", "jsonschema", b"{}") + channel(2, 2, "/foo", "json")
    bag("json", beside(json, b'{"a": 1}'))
    bag("short_record", file(chunk(SCHEMA + CHANNEL + record(5, b"\1\0") + MESSAGES)))
    short = message(1, 1, START_NS, CDR)
    bag("short_payload", file(chunk(SCHEMA + CHANNEL + short + MESSAGES)), ((TOPIC, TYPE, 51),))
    late = message(1, 1, 2**64 - 1, wrench(0))
    bag("late_time", file(chunk(SCHEMA + CHANNEL + MESSAGES + late)), ((TOPIC, TYPE, 51),))
    old = schema(1, "geometry_msgs/WrenchStamped", "ros2msg", DEFINITION)
    bag("old_type_name", file(chunk(old + CHANNEL + MESSAGES)),
        ((TOPIC, "geometry_msgs/WrenchStamped", COUNT),))  # fmt: skip
    crlf = schema(1, TYPE, "ros2msg", DEFINITION.replace(b"\n", b"\r\n"))
    bag("crlf", file(chunk(crlf + CHANNEL + MESSAGES)))
    bag("reindexed", file(chunk(PLAIN)), storage='""')
    bag("two_frames", file(chunk(PLAIN, "zstd", zstd(PLAIN[:1000]) + zstd(PLAIN[1000:]))))
    bag("unclosed_frame", file(chunk(PLAIN, "zstd", unclosed(PLAIN))))
    bag("fewer_than_announced", file(chunk(PLAIN)), ((TOPIC, TYPE, 60),))
    half = len(MESSAGES) // 2
    again = schema(2, TYPE, "ros2msg", DEFINITION + b"\n# again\n") + channel(2, 2, TOPIC)
    rest = b"".join(
        message(2, i + 1, START_NS + i * STEP_NS, wrench(i)) for i in range(COUNT // 2, COUNT)
    )
    bag("two_texts", file(chunk(SCHEMA + CHANNEL + MESSAGES[:half]), chunk(again + rest)))
    kind, topic = "my_msgs/msg/P", "/cabols/p"
    pair = schema(1, kind, "ros2msg", b"float64 x\nfloat64 y\n") + channel(1, 1, topic)
    pair += schema(2, kind, "ros2msg", b"float64 y\nfloat64 x\n") + channel(2, 2, topic)
    pair += message(1, 1, START_NS, CDR + struct.pack("<2d", 1, 2))
    pair += message(2, 2, START_NS + 1, CDR + struct.pack("<2d", 2, 1))
    bag("two_definitions", file(pair), ((topic, kind, 2),))
    sqlite("sqlite3", definitions=True)
    sqlite("sqlite3_humble", definitions=False)
    sqlite("sqlite3_oldest", definitions=False, columns=False)
    packed()
    split("split", complete=True)
    split("split_killed", complete=False)
    damaged()


def calibrations():
    text = rig_file("sensor.cal").read_text("utf-8")

    def put_attribute(name, value):
        return re.sub(rf'{name}="[^"]*"', f'{name}="{value}"', text, count=1)

    slopes = '<BiasSlope values="0 0 1e-3 0 0 0"/><Thermistor value="2.8"/>'
    software = put_attribute("HWTempComp", "False")
    block = text[text.index("<Calibration") : text.index("</FTSensor>")]
    other = block.replace("SI-165-15", "SI-16-1.5")
    files = {
        "plain": text,
        "nm": put_attribute("TorqueUnits", "Nm"),
        "nmm": put_attribute("TorqueUnits", "Nmm"),
        "knm": put_attribute("TorqueUnits", "kNm"),
        "lbf_in": put_attribute("TorqueUnits", "lbf-in"),
        "seven_gauges": put_attribute("NumGages", "7"),
        "half_range": put_attribute("OutputRange", "10"),
        "unipolar": put_attribute("OutputBipolar", "False"),
        "digital": put_attribute("OutputMode", "EtherCAT"),
        "temperature_in_software": software.replace("<BasicTransform", slopes + "<BasicTransform"),
        "two_calibrations": text.replace("</FTSensor>", other + "</FTSensor>"),
        "crlf_bom": "\ufeff" + text.replace("\n", "\r\n"),
    }
    CALIBRATIONS.mkdir()
    for name, content in files.items():
        (CALIBRATIONS / f"{name}.cal").write_bytes(content.encode())


if __name__ == "__main__":
    for place in (BAGS, CALIBRATIONS):
        shutil.rmtree(place, ignore_errors=True)
    BAGS.mkdir()
    bags()
    calibrations()
