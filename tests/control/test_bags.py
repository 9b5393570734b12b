# SPDX-License-Identifier: Apache-2.0
"""Bags on disk: writing, recovering and reading, against rosbags and mcap as second opinions."""

import dataclasses
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from cabols_control.bags.compare import payload_digest
from cabols_control.bags.definitions import Definitions, parse_definition, verified
from cabols_control.bags.errors import BagError
from cabols_control.bags.lost_messages import LostMessages
from cabols_control.bags.metadata import OfferedQos
from cabols_control.bags.reader import iterate, read_bag
from cabols_control.bags.recover import main, recover
from cabols_control.bags.writer import BagWriter

T0 = 1_700_000_000_000_000_000
LIMB_STATE = "cabols_msgs/msg/LimbState"
MODE = "cabols_msgs/msg/Mode"
WRENCH = "geometry_msgs/msg/WrenchStamped"
TYPES = [LIMB_STATE, MODE, WRENCH, "cabols_msgs/msg/LoopStatus", "sensor_msgs/msg/JointState"]
METADATA = {"description": "a test", "tricky": "1e3", "yes": "no", "text": "one: 1\n  two: 2\n"}


@pytest.fixture(scope="module")
def store():
    found = get_typestore(Stores.ROS2_JAZZY)
    definitions = Definitions()
    for name in (LIMB_STATE, MODE, "cabols_msgs/msg/LoopStatus"):
        definition = definitions.get(name)
        types = parse_definition(name, definition.text)
        found.register({k: v for k, v in types.items() if k not in found.fielddefs})
    return found


def header(store, time_ns, frame="base"):
    time = store.types["builtin_interfaces/msg/Time"](time_ns // 10**9, time_ns % 10**9)
    return store.types["std_msgs/msg/Header"](time, frame)


def limb_state(store, i, limbs=8, frame="base"):
    values = np.arange(limbs) + 0.001 * i
    message = store.types[LIMB_STATE](
        header(store, T0 + i * 1_000_000, frame),
        i + 1,
        np.arange(limbs, dtype=np.uint8),
        values,
        np.full(limbs, np.nan) if i == 0 else 2 * values,
        3 * values,
        -values,
        np.arange(limbs) % 2 == i % 2,
        np.ones(limbs, bool),
        zeroing=1,
        mode=2,
        session=1,
        cable_speed=0.5 * values,
        cable_acceleration=np.full(limbs, np.nan),
    )
    return bytes(store.serialize_cdr(message, LIMB_STATE))


def mode(store, i, reason):
    stamp, lifted = header(store, T0 + i * 1_000_000, ""), np.arange(8, dtype=np.uint64)
    message = store.types[MODE](stamp, i % 5, reason, 2, "", 1, 1, lifted)
    return bytes(store.serialize_cdr(message, MODE))


def wrench(store, i):
    vector = store.types["geometry_msgs/msg/Vector3"]
    message = store.types[WRENCH](
        header(store, T0 + i * 1_000_000, "platform"),
        store.types["geometry_msgs/msg/Wrench"](vector(i, 2.0, 3.0), vector(4.0, 5.0, 6.0)),
    )
    return bytes(store.serialize_cdr(message, WRENCH))


def fill(writer, store, count=40, flush_every=10, flushed=None):
    """Write limb_state and wrench each time and mode now and then."""
    writer.add_topic("limb_state", LIMB_STATE, OfferedQos(1, "best_effort"))
    writer.add_topic("wrench", WRENCH, OfferedQos(1, "best_effort"))
    writer.add_topic("mode", MODE, OfferedQos(1, "reliable", "transient_local"))
    written = []
    for i in range(count):
        items = [("limb_state", limb_state(store, i)), ("wrench", wrench(store, i))]
        if i % 7 == 0:
            items.append(("mode", mode(store, i, f"reason {i}")))
        for topic, data in items:
            writer.write(topic, T0 + i * 1_000_000 + 500, T0 + i * 1_000_000 + 200, data, i + 1)
            written.append(("/cabols/" + topic, data))
        if (i + 1) % flush_every == 0:
            writer.flush()
            if flushed is not None:
                flushed.append((writer.path.stat().st_size, len(written)))
    return written


def read_any(folder):
    with AnyReader([folder]) as reader:
        return [(connection.topic, raw) for connection, _, raw in reader.messages()]


@pytest.fixture
def bag(tmp_path, store):
    folder = tmp_path / "run"
    with BagWriter(folder, METADATA) as writer:
        fill(writer, store)
    return folder


@pytest.mark.parametrize("type_name", TYPES)
def test_type_hash_is_that_of_ros(type_name):
    path = Path(sys.prefix) / "share" / f"{type_name}.json"
    hashes = {h["type_name"]: h["hash_string"] for h in json.loads(path.read_text())["type_hashes"]}
    assert Definitions().get(type_name).type_hash == hashes[type_name]


def test_a_type_in_another_prefix_is_found_with_what_it_nests(tmp_path, monkeypatch):
    share = tmp_path / "share" / "other_msgs" / "msg"
    share.mkdir(parents=True)
    (share / "Outer.msg").write_text("other_msgs/Inner[] inner\ncabols_msgs/Mode mode\n")
    (share / "Inner.msg").write_text("float64 x\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    definition = Definitions().get("other_msgs/msg/Outer")
    types = parse_definition(definition.type_name, definition.text)
    assert {"other_msgs/msg/Inner", MODE, "std_msgs/msg/Header"} < set(types)


def test_an_unknown_type_names_itself_and_the_package():
    with pytest.raises(BagError, match=r"nothing_msgs/msg/A: expected .* build and source nothing"):
        Definitions().get("nothing_msgs/msg/A")
    with pytest.raises(BagError, match="LimbState: expected a type such as"):
        Definitions().get("LimbState")


def test_round_trip_by_rosbags_and_by_mcap(tmp_path, store):
    with BagWriter(tmp_path / "run", METADATA) as writer:
        written = fill(writer, store)
    assert sorted(read_any(tmp_path / "run")) == sorted(written)
    with (tmp_path / "run" / "run_0.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        found = [(c.topic, m.data, m) for _, c, m in reader.iter_messages()]
        assert sorted((topic, data) for topic, data, _ in found) == sorted(written)
        first = found[0][2]
        assert (first.log_time, first.publish_time) == (T0 + 500, T0 + 200)
        assert first.sequence == 1
        assert reader.get_header().profile == "ros2"
        assert [m.metadata for m in reader.iter_metadata() if m.name == "cabols"] == [METADATA]
        channels = {c.topic: c for c in reader.get_summary().channels.values()}
    qos = yaml.safe_load(channels["/cabols/mode"].metadata["offered_qos_profiles"])
    assert qos[0]["durability"] == "transient_local"
    assert channels["/cabols/mode"].metadata["topic_type_hash"] == Definitions().get(MODE).type_hash


def test_messages_decode_by_mcap_ros2(bag):
    decoder = pytest.importorskip("mcap_ros2.decoder")
    with (bag / "run_0.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[decoder.DecoderFactory()])
        found = [m for *_, m in reader.iter_decoded_messages(topics=["/cabols/limb_state"])]
    assert [m.sequence for m in found] == list(range(1, 41))
    assert found[3].tension[2] == pytest.approx(3 * 2.003)


def test_metadata_yaml_is_rosbag2s_version_9(bag):
    content = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert content["version"] == 9
    assert content["storage_identifier"] == "mcap"
    assert content["custom_data"] == METADATA
    assert content["message_count"] == 86
    assert content["duration"]["nanoseconds"] == 39_000_000
    assert content["starting_time"]["nanoseconds_since_epoch"] == T0 + 500
    topic = content["topics_with_message_count"][0]["topic_metadata"]
    assert topic["name"] == "/cabols/limb_state"
    assert topic["offered_qos_profiles"][0]["reliability"] == "best_effort"


def test_custom_data_stays_text_for_readers_of_yaml_1_2(bag):
    """`1e3` unquoted is text in YAML 1.1 (PyYAML) and a number in 1.2 (ruamel, in rosbags)."""
    ruamel = pytest.importorskip("ruamel.yaml")
    content = ruamel.YAML(typ="safe").load((bag / "metadata.yaml").read_text())
    assert content["rosbag2_bagfile_information"]["custom_data"] == METADATA


def test_an_existing_bag_is_not_written_into(bag):
    before = {p.name: p.read_bytes() for p in bag.iterdir()}
    with pytest.raises(BagError, match=r"run: expected a new or empty folder .* got .*metadata"):
        BagWriter(bag, {})
    assert {p.name: p.read_bytes() for p in bag.iterdir()} == before
    with pytest.raises(BagError, match="expected to create a folder"):
        BagWriter(bag / "metadata.yaml", {})


def test_topics_are_added_once_and_before_their_messages(tmp_path):
    with BagWriter(tmp_path / "run", {}) as writer:
        writer.add_topic("mode", MODE)
        with pytest.raises(BagError, match="/cabols/mode: expected a new topic"):
            writer.add_topic("/cabols/mode", MODE)
        with pytest.raises(BagError, match=r"/cabols/wrench: expected a topic .*/cabols/mode"):
            writer.write("wrench", 0, 0, b"")


def test_a_disk_that_refuses_is_an_error_that_names_recover(tmp_path, store):
    """A limit on file size stands in for a full disk."""
    script = (
        "import resource, os, sys\n"
        "from cabols_control.bags.writer import BagWriter\n"
        "from cabols_control.bags.errors import BagError\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))\n"
        "writer = BagWriter(sys.argv[1], {})\n"
        f"writer.add_topic('mode', '{MODE}')\n"
        "try:\n"
        "    for i in range(100):\n"
        "        writer.write('mode', i, i, os.urandom(5000)); writer.flush()\n"
        "except BagError as error:\n"
        "    writer.abandon(); print(error); sys.exit(3)\n"
    )
    command = [sys.executable, "-c", script, str(tmp_path / "run")]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == 3, result.stderr
    assert re.search(r"expected to write the bag, got File too large; .* recover", result.stdout)
    assert recover(tmp_path / "run").messages in range(15, 21)


def cut_copy(source, folder, size):
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    (folder / source.name).write_bytes(source.read_bytes()[:size])
    return folder


def test_a_recording_cut_anywhere_gives_all_that_was_flushed(tmp_path, store):
    flushed = []
    writer = BagWriter(tmp_path / "run", METADATA)
    written = fill(writer, store, flushed=flushed)
    writer.close()
    whole = writer.path.stat().st_size
    edges = [edge + d for edge, _ in flushed for d in (-1, 0, 1)]
    for size in sorted({*range(0, 40, 9), *range(40, whole, 211), *edges, whole - 1, whole}):
        folder = cut_copy(writer.path, tmp_path / "cut", min(size, whole))
        saved = recover(folder)
        safe = max([count for edge, count in flushed if edge <= size], default=0)
        assert saved.messages >= safe, size
        assert [p.name for p in sorted(folder.iterdir())] == ["metadata.yaml", "run_0.mcap"]
        if safe:
            found = [(f"/cabols/{topic}", raw) for topic, _, raw in iterate(folder)]
            assert found == written[: saved.messages], size
        if size in edges:
            assert sorted(read_any(folder)) == sorted(written[: saved.messages])
            assert not safe or read_bag(folder).metadata == METADATA


def test_the_beginning_of_a_cut_chunk_is_saved(tmp_path, store):
    """What zstd can still give of a chunk that was cut while being written."""
    rng = np.random.default_rng(1)
    writer = BagWriter(tmp_path / "run", {})
    writer.add_topic("mode", MODE)
    for i in range(1000):
        text = rng.integers(65, 90, 300, dtype=np.uint8).tobytes().decode()
        writer.write("mode", i, i, mode(store, i, text))
    writer.flush()
    size = writer.path.stat().st_size
    writer.abandon()
    saved = recover(cut_copy(writer.path, tmp_path / "cut", size - 30_000))
    assert 0 < saved.messages < 1000
    assert saved.dropped_bytes > 0


@settings(max_examples=40, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_damage_anywhere_never_surprises(tmp_path_factory, store, data):
    base = tmp_path_factory.getbasetemp() / "damage"
    if not base.exists():
        with BagWriter(base, METADATA) as writer:
            fill(writer, store, 20, 5)
    source = next(base.glob("*.mcap"))
    content = bytearray(source.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        position = data.draw(st.integers(0, len(content) - 1))
        content[position] = data.draw(st.integers(0, 255))
    folder = tmp_path_factory.getbasetemp() / "damaged"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    (folder / source.name).write_bytes(content)
    try:
        saved = recover(folder)
    except BagError:
        assert (folder / source.name).read_bytes() == content
    else:
        assert saved.messages <= 46
        with AnyReader([folder]) as reader:
            assert reader.message_count == saved.messages


@pytest.mark.parametrize(
    "text",
    [
        Definitions().get(WRENCH).text.replace("float64 x", "float32 x", 1),
        Definitions().get(WRENCH).text.replace("float64 y", "float64 v", 1),
        "no definition",
    ],
)
def test_a_damaged_definition_is_found_by_its_hash(text):
    good = Definitions().get(WRENCH)
    assert verified(good) is good
    assert text != good.text
    assert verified(dataclasses.replace(good, text=text)) == good


def test_a_damaged_chunk_in_the_middle_costs_only_itself(tmp_path, store):
    flushed = []
    writer = BagWriter(tmp_path / "run", METADATA)
    fill(writer, store, flushed=flushed)
    writer.close()
    content = bytearray(writer.path.read_bytes())
    content[flushed[0][0] + 200] ^= 0xFF
    writer.path.write_bytes(content)
    with pytest.raises(BagError, match=r"damaged chunk.*recover"):
        read_bag(tmp_path / "run")
    saved = recover(tmp_path / "run")
    assert saved.messages == 86 - (flushed[1][1] - flushed[0][1])
    assert saved.dropped_bytes > 0
    assert read_bag(tmp_path / "run")["limb_state"]["sequence"].tolist()[9:11] == [10, 21]


def test_recover_leaves_a_complete_bag_as_it_is(bag, capsys):
    before = (bag / "run_0.mcap").stat().st_mtime_ns
    assert not recover(bag).changed
    assert (bag / "run_0.mcap").stat().st_mtime_ns == before
    assert main([str(bag)]) == 0
    assert "complete already" in capsys.readouterr().out


def test_recover_to_another_folder_leaves_the_source(bag, tmp_path, capsys):
    (bag / "metadata.yaml").unlink()
    content = (bag / "run_0.mcap").read_bytes()
    (bag / "run_0.mcap").write_bytes(content[:-50])
    assert main([str(bag / "run_0.mcap"), "--output", str(tmp_path / "saved")]) == 0
    assert "86 messages" in capsys.readouterr().out
    assert (bag / "run_0.mcap").read_bytes() == content[:-50]
    assert not (bag / "metadata.yaml").exists()
    assert len(read_any(tmp_path / "saved")) == 86


def test_recover_refuses_what_it_should_not_touch(bag, tmp_path, capsys):
    assert main([str(tmp_path / "nowhere")]) == 2
    assert "expected a bag's folder" in capsys.readouterr().err
    text = tmp_path / "text" / "a.mcap"
    text.parent.mkdir()
    text.write_text("something else entirely")
    with pytest.raises(
        BagError, match="expected an MCAP file, got one that begins with b'somethin"
    ):
        recover(text)
    assert text.read_text() == "something else entirely"
    assert [p.name for p in text.parent.iterdir()] == ["a.mcap"]
    with pytest.raises(BagError, match="expected a new or empty folder"):
        recover(bag, text.parent)
    shutil.copy(bag / "run_0.mcap", bag / "run_1.mcap")
    with pytest.raises(BagError, match=r"expected the folder of a split bag.* one of 2 files"):
        recover(bag / "run_1.mcap")
    with pytest.raises(SystemExit) as exit_info:
        main([])
    assert exit_info.value.code == 2


def test_a_bag_that_is_being_recorded_is_not_recovered(tmp_path, store):
    writer = BagWriter(tmp_path / "run", {})
    fill(writer, store)
    with pytest.raises(BagError, match="being written; stop its recorder"):
        recover(tmp_path / "run")
    writer.close()
    assert len(read_any(tmp_path / "run")) == 86


def test_recover_killed_before_its_end_loses_nothing(tmp_path, store, monkeypatch):
    writer = BagWriter(tmp_path / "run", METADATA)
    written = fill(writer, store)
    writer.abandon()
    for victim in ("replace", "unlink"):
        with monkeypatch.context() as patch:

            def killed(*_: object, **__: object) -> None:
                raise KeyboardInterrupt

            patch.setattr(Path, victim, killed)
            with pytest.raises(KeyboardInterrupt):
                recover(tmp_path / "run")
    assert recover(tmp_path / "run").messages == len(written)
    assert sorted(read_any(tmp_path / "run")) == sorted(written)


def test_read_bag_gives_arrays_by_dotted_name(bag):
    found = read_bag(bag)
    assert found.metadata == METADATA
    assert found.start_ns == T0
    states = found["limb_state"]
    assert states["tension"].shape == (40, 8)
    assert states["tension"][3] == pytest.approx(3 * (np.arange(8) + 0.003))
    assert states["switch_closed"].dtype == bool
    assert states["limb"].dtype == np.uint8
    assert states["header.frame_id"] == ["base"] * 40
    assert np.isnan(states["elongation"][0]).all()
    assert states.stamp == pytest.approx(np.arange(40) * 1e-3)
    assert states.stamp_ns[1] == T0 + 1_000_000
    assert states.log_time_ns[0] == T0 + 500
    assert states.sequence.tolist() == list(range(1, 41))
    assert found["/cabols/wrench"]["wrench.force.x"].tolist() == list(range(40))
    assert found["mode"]["reason"] == [f"reason {i}" for i in range(0, 40, 7)]
    assert len(found["mode"]) == 6


def flatten(message, prefix=""):
    for field in dataclasses.fields(message):
        value = getattr(message, field.name)
        if field.name.startswith("__") or field.name.isupper():  # type name, constants
            continue
        if dataclasses.is_dataclass(value):
            yield from flatten(value, f"{prefix}{field.name}.")
        else:
            yield prefix + field.name, value


def same(a, b):
    if isinstance(b, np.ndarray) and b.dtype.kind == "f":
        return np.array_equal(a, b, equal_nan=True)
    return np.array_equal(a, b)


@pytest.mark.parametrize("many_texts", [False, True])
def test_reader_agrees_with_rosbags_where_lengths_and_texts_change(tmp_path, store, many_texts):
    joints = store.types["sensor_msgs/msg/JointState"]
    status = store.types["diagnostic_msgs/msg/DiagnosticStatus"]
    array = store.types["diagnostic_msgs/msg/DiagnosticArray"]
    names = {
        "joint_states": "sensor_msgs/msg/JointState",
        "diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
        "mode": MODE,
        "limb_state": LIMB_STATE,
    }
    with BagWriter(tmp_path / "run", {}) as writer:
        for topic, type_name in names.items():
            writer.add_topic(topic, type_name)
        for i in range(100):
            frame = f"frame {i}" if many_texts else "base"
            stamp = header(store, T0 + i, frame)
            a = joints(stamp, ["a", "b" * (i % 3)], np.arange(2.0), np.zeros(i % 2), np.zeros(0))
            b = array(stamp, [status(0, "n" * (i % 4), "", "", [])] * (i % 3))
            little = i % 5 != 0
            for topic, message in (("joint_states", a), ("diagnostics", b)):
                raw = store.serialize_cdr(message, names[topic], little_endian=little)
                writer.write(topic, T0 + i, T0 + i, bytes(raw))
            writer.write("mode", T0 + i, T0 + i, mode(store, i, f"x{i}" if many_texts else ""))
            writer.write("limb_state", T0 + i, T0 + i, limb_state(store, i, 8 - i % 2, frame))
    found = read_bag(tmp_path / "run")
    with AnyReader([tmp_path / "run"]) as reader:
        for topic in names:
            series = found[topic]
            chosen = [c for c in reader.connections if c.topic == f"/cabols/{topic}"]
            count = 0
            for i, (connection, _, raw) in enumerate(reader.messages(chosen)):
                for name, value in flatten(reader.deserialize(raw, connection.msgtype)):
                    if topic == "diagnostics" and name == "status":
                        assert [s.name for s in series[name][i]] == [s.name for s in value]
                    else:
                        assert same(series[name][i], value), (topic, name, i)
                count += 1
            assert len(series) == count == 100


def test_iterate_yields_in_order_of_recording(bag, store):
    found = list(iterate(bag, ["mode"]))
    assert found[1] == ("mode", T0 + 7_000_500, mode(store, 7, "reason 7"))
    assert len(list(iterate(bag))) == 86


def test_payload_digest_ignores_when_things_were_recorded(tmp_path, store):
    for folder, shift in (("a", 0), ("b", 12345)):
        with BagWriter(tmp_path / folder, {"run": folder}) as writer:
            writer.add_topic("wrench", WRENCH)
            for i in range(5):
                writer.write("wrench", T0 + i + shift, T0 + i, wrench(store, i))
    first, second = payload_digest(tmp_path / "a"), payload_digest(tmp_path / "b")
    assert first == second
    assert list(first) == ["wrench"]
    with BagWriter(tmp_path / "c", {}) as writer:
        writer.add_topic("wrench", WRENCH)
        writer.write("wrench", T0, T0, wrench(store, 0))
    assert payload_digest(tmp_path / "c") != first


def test_errors_name_topic_by_topic_what_was_expected_and_came(bag, tmp_path):
    with pytest.raises(BagError) as error:
        read_bag(bag, {"limb_state": WRENCH, "pose": WRENCH, "mode": MODE})
    text = str(error.value)
    assert f"limb_state: expected {WRENCH}, got {LIMB_STATE}" in text
    assert f"pose: expected {WRENCH}, not in the bag" in text
    assert "mode:" not in text
    found = read_bag(bag, ["mode"])
    with pytest.raises(BagError, match=r"wrench: expected a topic that was read \(mode\), got 40"):
        found["wrench"]
    with pytest.raises(BagError, match=r"mode: expected one of .*reason.*, got 'weather'"):
        found["mode"]["weather"]
    with pytest.raises(BagError, match="expected a bag's folder, got nothing"):
        read_bag(tmp_path / "nowhere")
    (bag / "metadata.yaml").write_text("a: 1\n")
    with pytest.raises(BagError, match="expected rosbag2's metadata"):
        read_bag(bag)
    (bag / "metadata.yaml").unlink()
    with pytest.raises(BagError, match=r"expected a bag with metadata\.yaml, got none; .*recover"):
        read_bag(bag)


def test_an_empty_bag_says_so(tmp_path):
    with BagWriter(tmp_path / "run", {}) as writer:
        writer.add_topic("mode", MODE)
    with pytest.raises(BagError, match="expected messages, got an empty bag"):
        read_bag(tmp_path / "run")
    assert read_any(tmp_path / "run") == []


def test_a_node_without_time_yet_does_not_shift_the_zero(tmp_path, store):
    """loop_status is stamped zero until its node has seen a sample."""
    with BagWriter(tmp_path / "run", {}) as writer:
        writer.add_topic("mode", MODE)
        writer.add_topic("wrench", WRENCH)
        none = np.zeros(8, dtype=np.uint64)
        waiting = store.types[MODE](header(store, 0), 0, "", 0, "", 0, 0, none)
        writer.write("mode", T0, T0, bytes(store.serialize_cdr(waiting, MODE)))
        writer.write("wrench", T0, T0, wrench(store, 3))
    found = read_bag(tmp_path / "run")
    assert found["wrench"].stamp[0] == 0.0
    assert np.isnan(found["mode"].stamp[0])
    assert read_bag(tmp_path / "run", ["mode"]).start_ns == found.start_ns


def test_gaps_are_counted_for_each_of_several_publishers():
    one = LostMessages(lambda: 1)
    for number in (5, 6, 9, 10):
        one.add(number)
    assert one.lost == 2
    one.add(1)  # restarted
    one.add(2)
    assert one.lost == 2
    two = LostMessages(lambda: 2)
    for number in (1, 100, 2, 3, 101, 104, 4, 6):
        two.add(number)
    assert two.lost == 3


def test_reading_needs_no_ros_installation(bag):
    script = (
        "import sys\n"
        "from cabols_control.bags.reader import read_bag\n"
        f"print(len(read_bag({str(bag)!r})['mode']))\n"
        "assert not {'rclpy', 'cabols_msgs'} & set(sys.modules)\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env={**os.environ, "AMENT_PREFIX_PATH": ""},
    )
    assert result.stdout == "6\n", result.stderr
