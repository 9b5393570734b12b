# SPDX-License-Identifier: Apache-2.0
"""Parsers of bytes: CDR, bags, packets of the robot, answers of its controller and the tracker."""

from __future__ import annotations

import json
import shutil
import sqlite3
import warnings
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import closing
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
from abb_robot_client._egm_protobuf import egm_pb2
from engine import Target
from google.protobuf.message import DecodeError
from mcap.records import DataEnd
from mcap.records import Message as McapMessage
from mcap.stream_reader import StreamReader
from oracles import check, finite
from rclpy.serialization import deserialize_message, serialize_message
from text_targets import scratch

import bag_maker
from cabols_control.bags.definitions import Definitions
from cabols_control.bags.errors import BagError
from cabols_control.bags.reader import read_bag
from cabols_control.bags.recorded_types import KEPT_STORES, store_of
from cabols_control.bags.recover import recover
from cabols_control.bags.storage.records import ChannelInfo, Message, Schema
from cabols_control.bags.storage.salvage import Salvage
from cabols_control.bags.topic_messages import TopicMessages
from cabols_control.cdr import LayoutError
from cabols_control.errors import CabolsError
from cabols_control.geometry import load_geometry
from cabols_control.ros.messages import topics
from cabols_control.ros.messages.layout import Layout
from cabols_hw.abb.egm.sample import EgmSample, read_packet
from cabols_hw.abb.rws.answers import value_of
from cabols_hw.abb.rws.dialects import RWS_1
from cabols_hw.abb.rws.http_exchange import HttpAnswer
from cabols_hw.tracker import tracker_pb2 as pb
from cabols_hw.tracker.client import TrackerClient
from egm_packets import numbered

LIVE = ("limb_state", "wrench", "motor_current", "tension_command", "platform_pose", "mode")
BAGGED = ("limb_state", "loop_status", "campaign_status", "mode")


def filled(message: Any, rng: np.random.Generator, length: int = 8) -> Any:
    """A message with random numbers and a few words."""
    for name, kind in message.get_fields_and_field_types().items():
        value = getattr(message, name)
        if kind == "string":
            setattr(message, name, str(rng.choice(["", "base", "words of it"])))
        elif hasattr(value, "get_fields_and_field_types"):
            filled(value, rng, length)
        elif kind in ("double", "float"):
            setattr(message, name, float(rng.normal()))
        elif kind == "boolean":
            setattr(message, name, bool(rng.integers(2)))
        elif kind.endswith("]"):
            setattr(message, name, np.arange(len(value), dtype=value.dtype))
        elif kind.startswith(("int", "uint")):
            setattr(message, name, int(rng.integers(3)))
        elif kind == "sequence<double>":
            setattr(message, name, rng.normal(size=length).tolist())
        elif kind == "sequence<boolean>":
            setattr(message, name, [True] * length)
        elif kind.startswith("sequence<") and "int" in kind:
            setattr(message, name, list(range(length)))
    return message


def messages_of(names: Sequence[str], seed: int) -> list[bytes]:
    """A good message of each topic; its topic's number among the names before it."""
    rng = np.random.default_rng(seed)
    return [
        bytes([k]) + bytes(serialize_message(filled(topics.TYPES[topic](), rng)))
        for k, topic in enumerate(names)
    ]


def live_messages() -> list[bytes]:
    """A message of each fast topic."""
    return messages_of(LIVE, 7)


def open_live_cdr() -> Callable[[bytes], bool]:
    """The engine of the live graph beside rclpy's own deserialisation."""
    geometry = load_geometry()
    cables = geometry.base_points.shape[0]
    layouts = []
    for topic in LIVE:
        arrays = dict.fromkeys(topics.topic_row(topic).arrays, cables)
        layouts.append(Layout(topics.TYPES[topic], arrays))

    def feed(data: bytes) -> bool:
        layout = layouts[data[0] % len(LIVE)] if data else layouts[0]
        raw = data[1:]
        try:
            found = layout.read(raw)
        except LayoutError:
            return False
        message = deserialize_message(raw, layout.msg_type)
        for name in layout.dtype.names:
            value = message
            for part in name.split("."):
                value = getattr(value, part)
            same = np.array_equal(np.asarray(found[name]), np.asarray(value), equal_nan=True)
            check(same, "live CDR: another value")
        return True

    return feed


def bagged_messages() -> list[bytes]:
    """A message of some topics as a bag holds it."""
    return messages_of(BAGGED, 9)


def open_bag_cdr() -> Callable[[bytes], bool]:
    """The reader's engine beside rosbags' deserialisation."""
    channels, stores = [], []
    for topic in BAGGED:
        name = topics.topic_row(topic).type_name
        schema = Schema(1, name, "ros2msg", Definitions().get(name).text.encode())
        channels.append(ChannelInfo(f"/cabols/{topic}", schema))
        stores.append(store_of(channels[-1]))

    def feed(data: bytes) -> bool:
        index = data[0] % len(channels) if data else 0
        channel, store, raw = channels[index], stores[index], data[1:]
        gathered: Any = TopicMessages("topic")
        gathered.add(channel, Message(channel, 1, 10, 10, raw))
        # A pass makes the store once for all its messages.
        next(iter(gathered._groups.values())).store = store
        try:
            found = gathered.take()
        except BagError:
            return False
        theirs = store.deserialize_cdr(raw, channel.type_name)
        for name, column in found.columns.items():
            value: Any = theirs
            for part in name.split("."):
                value = getattr(value, part)
            ours = column[0]
            if isinstance(value, str):
                check(ours == value, "bag CDR: another text")
            elif isinstance(value, np.ndarray) or np.isscalar(value):
                same = np.array_equal(np.asarray(ours), np.asarray(value), equal_nan=True)
                check(same, "bag CDR: another value")
        return True

    return feed


COUNT = 20
YEAR_NS = 3.2e16


def mcap_files() -> list[bytes]:
    """Small bags: with chunks and index, without, killed, of several channels."""
    path = scratch("good.mcap")
    whole = bag_maker.whole(path, COUNT, 512)
    records = b"".join(
        bag_maker.message(1, i + 1, bag_maker.START_NS + i, bag_maker.wrench(i))
        for i in range(COUNT)
    )
    plain = bag_maker.file(bag_maker.SCHEMA + bag_maker.CHANNEL + records)
    killed = bag_maker.file(bag_maker.SCHEMA + bag_maker.CHANNEL, records, complete=False)
    second = bag_maker.channel(2, 1, "/cabols/desired_wrench")
    packed = bag_maker.zstd(bag_maker.SCHEMA + bag_maker.CHANNEL + second + records)
    chunked = bag_maker.file(
        bag_maker.chunk(bag_maker.SCHEMA + bag_maker.CHANNEL + second + records, "zstd", packed)
    )
    return [whole, plain, killed, chunked]


def _theirs(path: Path, within_ns: float = np.inf) -> list[bytes] | None:
    """Messages by the mcap library, in the file's order; None where it refuses the file.

    Args:
        path: of the bag.
        within_ns: of the bag's start: those of other times are left out [ns].
    """
    try:
        with path.open("rb") as stream:
            records = StreamReader(stream, validate_crcs=True).records
            # What stands behind the data's end is its summary.
            data = takewhile(lambda record: not isinstance(record, DataEnd), records)
            found = [
                record.data
                for record in data
                if isinstance(record, McapMessage)
                and abs(record.log_time - bag_maker.START_NS) <= within_ns
            ]
            deque(records, maxlen=0)
            return found
    except Exception:
        # The library's own errors and those of broken fields, of many kinds.
        return None


def _read(folder: Path) -> tuple[Any, bool]:
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        found = read_bag(folder)
    return found, bool(said)


def open_mcap() -> Callable[[bytes], bool]:
    """The reader of bags beside the mcap library.

    What it keeps of definitions is bounded, and full from the start: what grows afterwards is lost.
    """
    text = Definitions().get(bag_maker.TYPE).text
    for k in range(KEPT_STORES):
        schema = Schema(1, bag_maker.TYPE, "ros2msg", f"# {k}\n{text}".encode())
        store_of(ChannelInfo("/kept", schema))
    folder = scratch("bag")
    counts = ((bag_maker.TOPIC, bag_maker.TYPE, COUNT),)
    bag_maker.put(folder, b"", counts)
    path = folder / "b_0.mcap"

    def feed(data: bytes) -> bool:
        path.write_bytes(data)
        try:
            found, said = _read(folder)
        except CabolsError:
            return False
        theirs = _theirs(path)
        if theirs is None or said:
            return True
        total = sum(len(series) for series in found.topics.values())
        check(total == len(theirs) == COUNT, "bag: another number of messages")
        for series in found.topics.values():
            forces = [float(np.frombuffer(raw[-48:-40], "<f8")[0]) for raw in theirs]
            if len(series) == COUNT and "wrench.force.x" in series.fields:
                same = np.array_equal(series["wrench.force.x"], forces, equal_nan=True)
                check(same, "bag: other values")
        return True

    return feed


def open_recover() -> Callable[[bytes], bool]:
    """`recover`, whose output must be a bag of messages that the damaged file holds."""
    folder = scratch("bag")
    output = folder.with_name("out")
    bag_maker.put(folder, b"", ((bag_maker.TOPIC, bag_maker.TYPE, COUNT),))
    path = folder / "b_0.mcap"

    def feed(data: bytes) -> bool:
        path.write_bytes(data)
        shutil.rmtree(output, ignore_errors=True)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                result = recover(path, output)
            except CabolsError:
                return False
        (made,) = output.glob("*.mcap")
        saved = [item.data for item in Salvage(made, strict=True).messages()]
        check(len(saved) == result.messages, "recover: another number than it says")
        theirs = _theirs(made)
        check(theirs is not None, "recover: the mcap library refuses the saved bag")
        assert theirs is not None
        check(theirs == saved, "recover: others read others")
        # Beside damage a message of another year is one more sign of it: it is dropped, and told.
        before = _theirs(path, YEAR_NS)
        if before is not None:
            lost = len(before) - len(saved) - result.unknown
            check(lost <= 0 or result.dropped_bytes > 0, "recover: lost, and said nothing")
            check(lost <= 0, "recover: lost what the mcap library reads")
        return True

    return feed


def sqlite_files() -> list[bytes]:
    """Small sqlite3 bags."""
    made = []
    for page in (512, 1024):
        path = scratch("good.db3")
        with closing(sqlite3.connect(path)) as base:
            base.execute(f"PRAGMA page_size={page}")
            base.executescript(
                "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT "
                "NULL, serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);"
                "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, "
                "timestamp INTEGER NOT NULL, data BLOB NOT NULL);"
            )
            row = (1, bag_maker.TOPIC, bag_maker.TYPE, "cdr", "")
            base.execute("INSERT INTO topics VALUES (?,?,?,?,?)", row)
            for i in range(COUNT):
                row = (i + 1, 1, bag_maker.START_NS + i, bag_maker.wrench(i))
                base.execute("INSERT INTO messages VALUES (?,?,?,?)", row)
            base.commit()
        made.append(path.read_bytes())
    return made


def open_sqlite() -> Callable[[bytes], bool]:
    """The reader of sqlite3 bags beside the sqlite3 module."""
    folder = scratch("bag")
    bag_maker.put(folder, b"", ((bag_maker.TOPIC, bag_maker.TYPE, COUNT),), storage="sqlite3")
    text = (folder / "metadata.yaml").read_text("utf-8").replace("b_0.mcap", "b_0.db3")
    (folder / "metadata.yaml").write_text(text, encoding="utf-8")
    (folder / "b_0.mcap").unlink()
    path = folder / "b_0.db3"

    def feed(data: bytes) -> bool:
        path.write_bytes(data)
        try:
            found, said = _read(folder)
        except CabolsError:
            return False
        with closing(sqlite3.connect(f"file:{path}?immutable=1", uri=True)) as base:
            rows = base.execute("SELECT topic_id, data FROM messages ORDER BY id").fetchall()
        total = sum(len(series) for series in found.topics.values())
        check(said or total == len(rows), "sqlite3: another number of messages")
        check(said or total == COUNT, "sqlite3: totals differ, and nothing was said")
        return True

    return feed


def open_egm() -> Callable[[bytes], bool]:
    """Packets of the robot; numbers as the message has them, in other units."""

    def feed(data: bytes) -> bool:
        found = read_packet(data, 1.0)
        if not isinstance(found, EgmSample):
            return False
        message = egm_pb2.EgmRobot()
        try:
            message.ParseFromString(data)
        except DecodeError:
            check(right=False, what="EGM: no message")
        pose = message.feedBack.cartesian
        finite(found.joints, "EGM")
        finite(found.position, "EGM")
        finite(found.quaternion, "EGM")
        check(found.joints.shape == (6,), "EGM: another number of joints")
        degrees = np.array(message.feedBack.joints.joints)
        check(bool(np.allclose(found.joints, degrees * np.pi / 180.0)), "EGM: other joints")
        place = np.array([pose.pos.x, pose.pos.y, pose.pos.z]) / 1e3
        check(bool(np.allclose(found.position, place)), "EGM: another position")
        turn = np.array([pose.orient.u1, pose.orient.u2, pose.orient.u3, pose.orient.u0])
        check(bool(np.allclose(found.quaternion, turn, atol=2e-3)), "EGM: another rotation")
        check(found.robot_time_ns >= 0, "EGM: a time before zero")
        check(bool(np.abs(found.joints).max() < 100.0), "EGM: joints beyond any robot's")
        check(bool(np.abs(found.position).max() < 1e3), "EGM: a position beyond any robot's")
        return True

    return feed


def packets() -> list[bytes]:
    """Good packets, as a controller sends them."""
    odd = numbered(3, joints=())
    return [numbered(0), numbered(5, motors=False), numbered(9, rapid=False), odd]


ANSWERS = (
    b'{"_embedded":{"_state":[{"_type":"pnl-opmode","opmode":"AUTO"}]}}',
    b'{"_links":{},"state":[{"_type":"rap-data","value":"12","opmode":"MANR"}]}',
    b'{"_embedded":{"status":{"code":-1073442809,"msg":"rws_resource_rapid.cpp[1] code"}}}',
    b'<?xml version="1.0" encoding="UTF-8"?><html xmlns="http://www.w3.org/1999/xhtml"><body>'
    b'<div class="state"><ul><li class="pnl-opmode"><span class="opmode">AUTO</span></li></ul>'
    b"</div></body></html>",
    b'<html><body><div class="status"><span class="code">-1</span><span class="msg">no</span>'
    b"</div></body></html>",
)
TYPES = (
    "application/json",
    "application/json;charset=utf-8",
    "text/html; charset=latin-1",
    "application/xhtml+xml;v=2.0",
    "",
    "text/html; charset=utf-16",
    "text/plain; charset=zip",
)
STATUSES = (200, 200, 200, 204, 400, 401, 403, 404, 500, 503, 302, 999)  # fmt: skip


def answers() -> list[bytes]:
    """Answers of a controller; numbers of status and type before them."""
    return [bytes([k % 3, k % 2]) + body for k, body in enumerate(ANSWERS)]


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    check(len({key for key, _ in pairs}) == len(pairs), "RWS: took a key twice")
    return dict(pairs)


def open_answers() -> Callable[[bytes], bool]:
    """Answers of Robot Web Services beside the json module."""
    call = RWS_1.operation_mode()

    def feed(data: bytes) -> bool:
        head, body = data[:2].ljust(2, b"\0"), data[2:]
        kind = TYPES[head[1] % len(TYPES)]
        answer = HttpAnswer(STATUSES[head[0] % len(STATUSES)], {"content-type": kind}, (), body)
        try:
            states = value_of(call, answer, "http://robot")
        except CabolsError:
            return False
        values = [state[call.key] for state in states if call.key in state]
        check(bool(values), "RWS: no value")
        if "charset" not in kind and body.startswith(b"{"):
            json.loads(body.decode("utf-8", "replace"), object_pairs_hook=_once)
            for value in values:
                plain = value.isascii() and b"\\" not in body
                check(not plain or value.encode() in body, "RWS: a value from nowhere")
        return True

    return feed


def replies() -> list[bytes]:
    """Good answers of a tracker."""
    good = pb.MeasureReply(
        success=True,
        position_m=pb.Vector3(x=1.0, y=2.0, z=0.5),
        covariance_m2=pb.Symmetric3(xx=4e-11, yy=9e-11, zz=9e-11),
        rms_m=2e-5,
        samples=100,
        averaging_time_s=1.0,
        temperature_c=20.0,
        time_ns=5_000_000_000,
    )
    lost = pb.MeasureReply(success=False, reason=2, message="the beam is broken")
    bare = pb.MeasureReply(
        success=True, position_m=good.position_m, rms_m=1e-5, samples=10, averaging_time_s=1.0
    )
    return [m.SerializeToString() for m in (good, lost, bare)]


def check_reading(reading: Any) -> bool:
    """A measurement that counts must be one that may be used.

    Args:
        reading: of the client.
    """
    if not reading.success:
        check(bool(reading.reason), "tracker: refused without a reason")
        return False
    finite(reading.position, "tracker")
    finite(reading.covariance, "tracker")
    check(bool(np.linalg.eigvalsh(reading.covariance)[0] > 0.0), "tracker: covariance")
    away = np.linalg.norm(reading.position - np.array([1.0, 2.0, 0.5]))
    check(bool(away <= 0.03), "tracker: another reflector")
    finite(reading.rms, "tracker: rms")
    check(not np.isinf(reading.temperature), "tracker: temperature")
    check(reading.samples >= 1 and reading.time_ns >= 0, "tracker: samples or time")
    return True


class _Stub:
    """Answers as a server would."""

    def __init__(self) -> None:
        self.reply: Any = None

    def Aim(self, *_: Any, **__: Any) -> Any:  # noqa: N802
        return pb.BeamReply(success=True, position_m=pb.Vector3(x=1.0, y=2.0, z=0.5))

    def Measure(self, *_: Any, **__: Any) -> Any:  # noqa: N802
        return self.reply

    def GetStatus(self, *_: Any, **__: Any) -> Any:  # noqa: N802
        return pb.Status(ready=True, beam_locked=True, time_ns=6_000_000_000)


def open_reply() -> Callable[[bytes], bool]:
    """Answers of the tracker through its client."""
    client: Any = TrackerClient("127.0.0.1:9")
    client._stub = stub = _Stub()

    def feed(data: bytes) -> bool:
        stub.reply = pb.MeasureReply()
        try:
            stub.reply.ParseFromString(data)
        except DecodeError:
            return False
        client._before_ns = 0
        try:
            reading = client.measure(0, expected=(1.0, 2.0, 0.5))
        except CabolsError:
            return False
        return check_reading(reading)

    return feed


TARGETS = (
    Target("cdr_live", live_messages, open_live_cdr),
    Target("cdr_bag", bagged_messages, open_bag_cdr),
    Target("mcap", mcap_files, open_mcap),
    Target("mcap_recover", mcap_files, open_recover),
    Target("sqlite3", sqlite_files, open_sqlite),
    Target("egm_packet", packets, open_egm),
    Target("rws_answer", answers, open_answers, text=True),
    Target("tracker_reply", replies, open_reply),
)
