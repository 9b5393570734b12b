# SPDX-License-Identifier: Apache-2.0
"""A campaign's bag in the forms of `ros2 bag record`: analysed to the same digits.

The bags are rewritten by rosbags' own writer, split by hand as rosbag2 splits them.
"""

from __future__ import annotations

import itertools
import shutil

import numpy as np
import pytest
import yaml
from bench.long_bag import write_bag
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from cabols_control.bags.compare import payload_digest
from cabols_control.bags.definitions import Definitions, parse_definition
from cabols_control.bags.recover import recover
from cabols_stiffness.analysis.bag import read_loads

MCAP, SQLITE = StoragePlugin.MCAP, StoragePlugin.SQLITE3
FORMS = [
    *itertools.product(
        (MCAP, SQLITE), (CompressionMode.NONE, CompressionMode.FILE, CompressionMode.MESSAGE)
    ),
    (MCAP, CompressionMode.STORAGE),
]


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags") / "long"
    write_bag(folder, 6)
    return folder


def rewritten(bag, folder, plugin, mode, part=slice(None)):
    """Write a bag, or a part of its messages, with rosbags."""
    writer = Writer(folder, version=9, storage_plugin=plugin)
    if mode is not CompressionMode.NONE:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    store = get_typestore(Stores.ROS2_JAZZY)
    with AnyReader([bag]) as reader, writer:
        known = {}
        for connection, time_ns, raw in list(reader.messages())[part]:
            if connection.topic not in known:
                kind = connection.msgtype
                types = parse_definition(kind, Definitions().get(kind).text)
                store.register({k: v for k, v in types.items() if k not in store.fielddefs})
                known[connection.topic] = writer.add_connection(
                    connection.topic, kind, typestore=store
                )
            writer.write(known[connection.topic], time_ns, raw)
    return folder


def same_loads(bag, other):
    first, second = read_loads(bag), read_loads(other)
    assert len(first.loads) == len(second.loads) > 0
    assert first.wrenches == second.wrenches
    for one, again in zip(first.loads, second.loads, strict=True):
        np.testing.assert_array_equal(one.average.wrench, again.average.wrench)
        np.testing.assert_array_equal(one.average.joints, again.average.joints)
        np.testing.assert_array_equal(one.position, again.position)
        np.testing.assert_array_equal(one.tension, again.tension)


@pytest.mark.parametrize(
    ("plugin", "mode"), FORMS, ids=[f"{plugin.name}-{mode.name}" for plugin, mode in FORMS]
)
def test_every_storage_and_compression(bag, tmp_path, plugin, mode):
    other = rewritten(bag, tmp_path / "other", plugin, mode)
    same_loads(bag, other)
    assert payload_digest(other) == payload_digest(bag)
    recover(other, tmp_path / "saved")
    same_loads(bag, tmp_path / "saved")


@pytest.mark.parametrize("plugin", [MCAP, SQLITE], ids=["mcap", "sqlite3"])
@pytest.mark.parametrize("mode", [CompressionMode.NONE, CompressionMode.FILE])
def test_split(bag, tmp_path, plugin, mode):
    folder, names = tmp_path / "split", []
    with AnyReader([bag]) as reader:
        count = reader.message_count
    folder.mkdir()
    edges = [0, count // 3, count // 2, count]
    whole = None
    for k, (begin, end) in enumerate(itertools.pairwise(edges)):
        piece = rewritten(bag, tmp_path / f"piece_{k}", plugin, mode, slice(begin, end))
        content = yaml.safe_load((piece / "metadata.yaml").read_text())
        information = content["rosbag2_bagfile_information"]
        (name,) = information["relative_file_paths"]
        suffix = name[name.index(".") :]
        names.append(f"split_{k}{suffix}")
        shutil.move(piece / name, folder / names[-1])
        whole = whole or content
    information = whole["rosbag2_bagfile_information"]
    information["relative_file_paths"] = names
    for entry in information["topics_with_message_count"]:
        with AnyReader([bag]) as reader:
            name = entry["topic_metadata"]["name"]
            entry["message_count"] = reader.topics[name].msgcount
    with AnyReader([bag]) as reader:
        known = {entry["topic_metadata"]["name"] for entry in
                 information["topics_with_message_count"]}  # fmt: skip
        for name, topic in reader.topics.items():
            if name not in known:
                information["topics_with_message_count"].append(
                    {
                        "topic_metadata": {
                            "name": name,
                            "type": topic.msgtype,
                            "serialization_format": "cdr",
                            "offered_qos_profiles": [],
                            "type_description_hash": "",
                        },
                        "message_count": topic.msgcount,
                    }
                )
    information["message_count"] = count
    (folder / "metadata.yaml").write_text(yaml.safe_dump(whole))
    same_loads(bag, folder)
    (folder / "metadata.yaml").unlink()
    recover(folder, tmp_path / "saved")
    same_loads(bag, tmp_path / "saved")
