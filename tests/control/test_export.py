# SPDX-License-Identifier: Apache-2.0
"""Exports, read back by other programs' readers and held against rosbags' own deserialisation."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pyarrow.parquet
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.highlevel import AnyReader
from scipy.io import loadmat

from bag_builder import T0, BagBuilder
from cabols_control.bags.reader import read_bag
from cabols_control.export import command as export_command
from cabols_control.export.command import main
from cabols_control.export.frame import to_pandas
from cabols_control.export.time_base import linear, newest_before, previous, regular
from cabols_control.export.units import FIELDS, column_name
from cabols_control.export.writers import MissingLibraryError, library

MS = 1_000_000
LIMB_STATE = "cabols_msgs/msg/LimbState"
METADATA = {"description": "steps, scale 1", "program": "steps", "tricky": "1e3"}
COUNT = 50


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """Our types beside others': arrays, texts, arrays of messages, lengths that change."""
    folder = tmp_path_factory.mktemp("bags") / "run"
    random = np.random.default_rng(7)
    with BagBuilder(folder, METADATA) as builder:
        vector, wrench = "geometry_msgs/msg/Vector3", "geometry_msgs/msg/Wrench"
        for i in range(COUNT):
            now = T0 + i * MS
            builder.add(
                "limb_state",
                LIMB_STATE,
                now,
                sequence=i + 1,
                limb=np.arange(8, dtype=np.uint8),
                wound_length=random.normal(size=8),
                elongation=np.full(8, np.nan) if i < 3 else random.normal(size=8),
                tension=random.normal(size=8),
                current=random.normal(size=8),
                switch_closed=random.random(8) > 0.5,
                zeroed=np.full(8, i > 3),
            )
            force = builder.make(vector, x=1.0 * i, y=0.1, z=-2.0 * i)
            builder.add(
                "wrench",
                "geometry_msgs/msg/WrenchStamped",
                now,
                wrench=builder.make(wrench, force=force),
            )
            if i % 10 == 0:
                builder.add("mode", "cabols_msgs/msg/Mode", now, mode=i % 5, reason=f"why, {i}")
                builder.add("/chatter", "std_msgs/msg/String", now, data=f'says "{i}"\nand more')
                builder.add(
                    "/scan",
                    "sensor_msgs/msg/LaserScan",
                    now,
                    ranges=np.arange(i // 10, dtype=np.float32),
                )
                pair = builder.make("diagnostic_msgs/msg/KeyValue", key="k", value=str(i))
                status = builder.make(
                    "diagnostic_msgs/msg/DiagnosticStatus", name="n", level=2, values=[pair]
                )
                array = "diagnostic_msgs/msg/DiagnosticArray"
                builder.add("/diagnostics", array, now, status=[status])
    return folder


@pytest.fixture(scope="module")
def expected(bag):
    """By topic: log times and messages, by rosbags itself."""
    found = {}
    with AnyReader([bag]) as reader:
        for connection, time_ns, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            found.setdefault(connection.topic, []).append((time_ns, message))
    return found


def export(bag, folder, kind, *words):
    assert main([str(bag), "--format", kind, "--output", str(folder), *words]) == 0
    return folder


def check_flat(frame, expected):
    """A table of limb_state and of wrench with flat columns, against the messages."""
    states = expected["/cabols/limb_state"]
    state = frame("limb_state")
    assert len(state["stamp_ns"]) == COUNT
    np.testing.assert_array_equal(state["log_time_ns"], [time for time, _ in states])
    stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for _, m in states]
    np.testing.assert_array_equal(state["stamp_ns"], stamps)
    for limb in range(8):
        for name, field in (
            ("tension_{}_n", "tension"),
            ("elongation_{}_m", "elongation"),
            ("current_{}_a", "current"),
            ("switch_closed_{}", "switch_closed"),
        ):
            values = [getattr(message, field)[limb] for _, message in states]
            np.testing.assert_array_equal(
                np.asarray(state[name.format(limb)], float), np.asarray(values, float)
            )
    wrench = frame("wrench")
    forces = [message.wrench.force.z for _, message in expected["/cabols/wrench"]]
    np.testing.assert_array_equal(np.asarray(wrench["force_z_n"], float), forces)
    mode = frame("mode")
    assert list(mode["reason"]) == [m.reason for _, m in expected["/cabols/mode"]]
    assert list(frame("chatter")["data"]) == [m.data for _, m in expected["/chatter"]]
    ranges = [json.loads(text) for text in frame("scan")["ranges"]]
    assert ranges == [m.ranges.tolist() for _, m in expected["/scan"]]
    told = [json.loads(text) for text in frame("diagnostics")["status"]]
    assert told[1][0]["values"] == [{"key": "k", "value": "10"}]


def test_csv_by_pandas_and_the_csv_module(bag, tmp_path, expected):
    folder = export(bag, tmp_path / "out", "csv")
    check_flat(lambda topic: pd.read_csv(folder / f"{topic}.csv"), expected)
    with (folder / "wrench.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["force_x_n"]) for row in rows] == [float(i) for i in range(COUNT)]
    side = json.loads((folder / "limb_state.json").read_text())
    assert side["metadata"]["program"] == "steps"
    assert side["metadata"]["type"] == LIMB_STATE
    assert side["columns"]["tension_n"] == {"field": "tension", "unit": "n", "columns": "8"}


def test_parquet_by_pyarrow_and_pandas(bag, tmp_path, expected):
    folder = export(bag, tmp_path / "out", "parquet")
    check_flat(lambda topic: pd.read_parquet(folder / f"{topic}.parquet"), expected)
    schema = pyarrow.parquet.read_schema(folder / "limb_state.parquet")
    assert schema.metadata[b"description"] == b"steps, scale 1"
    assert schema.field("tension_3_n").metadata == {b"field": b"tension", b"unit": b"n"}
    assert str(schema.field("sequence").type) == "uint64"


def test_hdf5_by_h5py(bag, tmp_path, expected):
    folder = export(bag, tmp_path / "out", "hdf5")
    with h5py.File(folder / "export.h5") as file:
        state = file["limb_state"]
        assert state.attrs["program"] == "steps"
        assert state["tension_n"].attrs["unit"] == "n"
        tensions = [message.tension for _, message in expected["/cabols/limb_state"]]
        np.testing.assert_array_equal(state["tension_n"][:], tensions)
        reasons = [text.decode() for text in file["mode"]["reason"][:]]
        assert reasons == [message.reason for _, message in expected["/cabols/mode"]]
        assert set(file) == {"limb_state", "wrench", "mode", "chatter", "scan", "diagnostics"}


def test_mat_by_scipy(bag, tmp_path, expected):
    folder = export(bag, tmp_path / "out", "mat")
    content = loadmat(folder / "export.mat", simplify_cells=True)
    tensions = [message.tension for _, message in expected["/cabols/limb_state"]]
    np.testing.assert_array_equal(content["limb_state"]["tension_n"], tensions)
    assert content["limb_state"]["metadata"]["program"] == "steps"
    assert list(content["mode"]["reason"]) == [m.reason for _, m in expected["/cabols/mode"]]
    assert content["wrench"]["stamp_ns"][1] == T0 + MS


@pytest.mark.parametrize("size", [1, 7, 1000])
def test_batches_make_no_difference(bag, tmp_path, monkeypatch, size):
    monkeypatch.setattr(export_command, "SIZE", size)
    one = pd.read_parquet(export(bag, tmp_path / "a", "parquet") / "limb_state.parquet")
    monkeypatch.undo()
    other = pd.read_parquet(export(bag, tmp_path / "b", "parquet") / "limb_state.parquet")
    pd.testing.assert_frame_equal(one, other)


def test_one_time_base_from_a_topic(bag, tmp_path):
    words = ("--time-base", "wrench", "--topics", "wrench", "mode")
    folder = export(bag, tmp_path / "out", "csv", *words)
    table = pd.read_csv(folder / "table.csv")
    assert len(table) == COUNT
    np.testing.assert_array_equal(table["time_ns"], T0 + np.arange(COUNT) * MS)
    np.testing.assert_array_equal(table["wrench_force_x_n"], np.arange(COUNT))
    assert list(table["mode_reason"][8:12]) == ["why, 0", "why, 0", "why, 10", "why, 10"]
    side = json.loads((folder / "table.json").read_text())
    assert side["metadata"]["interpolation"] == "previous"


def test_one_time_base_at_a_rate_is_interpolated_if_asked(bag, tmp_path):
    words = ("--time-base", "4000", "--interpolate", "linear", "--topics", "wrench", "limb_state")
    folder = export(bag, tmp_path / "out", "parquet", *words)
    table = pd.read_parquet(folder / "table.parquet")
    # A force that grows by 1 N in 1 ms, at four times the rate.
    np.testing.assert_allclose(table["wrench_force_x_n"], np.arange(len(table)) / 4.0, atol=1e-9)
    # Counters and flags are never made up.
    assert set(table["limb_state_sequence"]) == set(range(1, COUNT + 1))
    metadata = pyarrow.parquet.read_schema(folder / "table.parquet").metadata
    assert (metadata[b"interpolation"], metadata[b"time_base"]) == (b"linear", b"4000")


@given(
    st.lists(st.integers(0, 50), min_size=1, max_size=12),
    st.lists(st.integers(-5, 60), min_size=1, max_size=20),
)
def test_held_and_interpolated_values_against_pandas(times, instants):
    """Second opinions: pandas' merge_asof, numpy's interp."""
    stamps = np.unique(np.array(times, np.int64))
    values = np.sin(stamps.astype(float))
    where = np.array(sorted(instants), np.int64)
    held = previous(values, *newest_before(where, stamps))
    other = pd.merge_asof(
        pd.DataFrame({"t": where}), pd.DataFrame({"t": stamps, "v": values}), on="t"
    )["v"]
    np.testing.assert_array_equal(held, other)
    between = linear(values, where, stamps)
    reference = np.interp(where, stamps, values, left=np.nan, right=np.nan)
    np.testing.assert_allclose(between, reference, rtol=1e-12, atol=1e-12)


def test_a_rate_that_is_no_divisor_keeps_its_pace():
    instants = regular(T0, T0 + 10**9, 3.0)
    np.testing.assert_array_equal(instants - T0, [0, 333333333, 666666667, 1000000000])


@pytest.mark.parametrize(
    ("words", "code", "problem"),
    [
        (["--topics", "limb_stat"], 1, "did you mean limb_state?"),
        (["--time-base", "sometimes"], 1, "expected a rate in Hz or one of"),
        (["--time-base", "-3"], 1, "expected a rate above 0 Hz"),
    ],
)
def test_impossible_requests_are_reported(bag, tmp_path, capsys, words, code, problem):
    output = ["--output", str(tmp_path / "out")]
    assert main([str(bag), "--format", "csv", *output, *words]) == code
    assert problem in capsys.readouterr().err


def test_missing_bag_and_occupied_folder_are_usage_errors(bag, tmp_path, capsys):
    assert main([str(tmp_path / "none"), "--format", "csv"]) == 2
    (tmp_path / "thesis.tex").write_text("x")
    assert main([str(bag), "--format", "csv", "--output", str(tmp_path)]) == 2
    assert "thesis.tex" in capsys.readouterr().err


def test_a_format_without_its_library_says_what_to_install():
    with pytest.raises(MissingLibraryError, match="pip install nothing"):
        library("no_such_library", "pip install nothing")


def test_units_name_fields_that_the_messages_have(bag):
    known = read_bag(bag)
    for topic in ("limb_state", "wrench"):
        series = known[topic]
        assert set(FIELDS[series.type_name]) <= set(series.fields)
    assert column_name("x/msg/Y", "a.b.c") == ("a_b_c", "")


def test_read_bag_gives_a_topic_to_pandas(bag, expected):
    frame = to_pandas(read_bag(bag)["limb_state"])
    tension = [message.tension[4] for _, message in expected["/cabols/limb_state"]]
    np.testing.assert_array_equal(frame["tension_4_n"], tension)
    assert frame.index.name == "time_s"
    assert frame.index[1] == pytest.approx(0.001)


def test_the_pages_example_runs(bag, monkeypatch, capsys):
    """docs/bags.md: its Python, on another bag."""
    page = (Path(__file__).resolve().parents[2] / "docs" / "bags.md").read_text("utf-8")
    (code,) = re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    exec(code.replace("build/demo/bag", str(bag)), {})
    said = capsys.readouterr().out
    assert f"({COUNT}, 8)" in said
    assert "force_z_n" in said
