# SPDX-License-Identifier: Apache-2.0
"""A campaign from its bag alone: the truth is found, foreign bags are refused topic by topic."""

from __future__ import annotations

import re
import shutil

import numpy as np
import pytest
import yaml
from bench.long_bag import TRUE, write_bag
from cabols_msgs.msg import StiffnessLoad
from rclpy.serialization import serialize_message

from cabols_control.bags.errors import BagError
from cabols_control.bags.reader import batches, iterate, read_bag
from cabols_control.bags.writer import BagWriter
from cabols_stiffness.analysis.analyze import main as analyze
from cabols_stiffness.analysis.bag import NEEDED, campaign_text, read_loads
from cabols_stiffness.analysis.source import read_source
from cabols_stiffness.errors import CampaignError

SECONDS = 40
"""20 loads: one configuration and a part of the next."""


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags") / "long"
    write_bag(folder, SECONDS)
    return folder


def copy(bag, folder, change):
    """The same bag with each message changed: change(topic, raw) gives topic, type, raw or None."""
    with BagWriter(folder, {}) as writer:
        known = set()
        whole = read_bag(bag)
        for topic, time_ns, raw in iterate(bag):
            changed = change(topic, whole[topic].type_name, raw)
            if changed is None:
                continue
            name, type_name, data = changed
            if name not in known:
                writer.add_topic(name, type_name)
                known.add(name)
            writer.write(name, time_ns, time_ns, data)
    return folder


def test_loads_are_found_whatever_the_batches(bag, monkeypatch):
    whole = read_loads(bag)
    assert len(whole.loads) == SECONDS // 2
    assert whole.wrenches == 1000 * SECONDS
    monkeypatch.setattr("cabols_stiffness.analysis.bag.BATCH", 37)
    pieces = read_loads(bag)
    for one, other in zip(whole.loads, pieces.loads, strict=True):
        np.testing.assert_array_equal(one.average.wrench, other.average.wrench)
        np.testing.assert_array_equal(one.position, other.position)
        assert one.average.samples == 101


def test_average_is_that_of_the_window(bag):
    load = read_loads(bag).loads[3]
    series = read_bag(bag, NEEDED)["wrench"]
    inside = (series.stamp_ns >= load.begin_ns) & (series.stamp_ns <= load.end_ns)
    np.testing.assert_allclose(
        load.average.wrench[2], series["wrench.force.z"][inside].mean(), rtol=1e-12
    )


def test_batches_are_the_whole_bag(bag):
    sizes = [len(part["wrench"]["header.stamp.sec"]) for part in batches(bag, NEEDED, 5000)]
    assert sum(sizes) == 1000 * SECONDS
    assert max(sizes) <= 5000


def test_analysis_of_a_bag_finds_the_truth_and_says_where_it_is_from(bag, tmp_path, capsys):
    assert analyze([str(bag), "--output", str(tmp_path)]) == 0
    assert "held-out" in capsys.readouterr().out
    content = yaml.safe_load((tmp_path / "result.yaml").read_text("utf-8"))
    found = np.array([j["stiffness_nm_per_rad"] or np.nan for j in content["joints"]])
    np.testing.assert_allclose(found / TRUE, 1.0, atol=0.08)
    provenance = content["provenance"]
    assert all(len(digest) == 64 for digest in provenance["bags_sha256"].values())
    assert provenance["parameters"]["version of scipy"]
    report = (tmp_path / "report.html").read_text("utf-8")
    assert "Joint stiffness" in report
    assert f"<strong>{content['verdict']['grade']}</strong>" in report
    assert "Cochran" in report
    assert not re.search(r'<(script|link|img)[^>]*(src|href)="?http', report)
    header, first, *_ = (tmp_path / "stiffness.csv").read_text("utf-8").splitlines()
    assert header.startswith("joint,configuration_1_nm_per_rad")
    assert first.startswith("1,")


def test_analysis_climbs_the_ladder_on_request(bag, tmp_path, capsys):
    assert analyze([str(bag), "--output", str(tmp_path), "--model", "joints+base"]) == 0
    assert "ladder of models" in capsys.readouterr().out
    content = yaml.safe_load((tmp_path / "result.yaml").read_text("utf-8"))
    assert [step["rung"] for step in content["ladder"]["steps"]] == ["joints", "base"]
    assert "Ladder of models" in (tmp_path / "report.html").read_text("utf-8")
    assert (tmp_path / "elastic.npz").exists()


@pytest.mark.parametrize("topic", sorted(NEEDED))
def test_missing_topic_is_named(bag, tmp_path, topic):
    broken = copy(bag, tmp_path / "bag", lambda *m: None if m[0] == topic else m)
    with pytest.raises(BagError, match=f"{topic}: expected {NEEDED[topic]}, not in the bag"):
        read_loads(broken)


def test_topic_of_another_type_is_named(bag, tmp_path):
    def change(topic, type_name, raw):
        if topic != "joint_states":
            return topic, type_name, raw
        return topic, "std_msgs/msg/Header", raw

    broken = copy(bag, tmp_path / "bag", change)
    with pytest.raises(BagError, match="joint_states: expected sensor_msgs/msg/JointState, got"):
        read_loads(broken)


def test_other_frame_is_named(bag, tmp_path):
    def change(topic, type_name, raw):
        if topic == "wrench":
            raw = raw.replace(b"platform", b"elsewher")
        return topic, type_name, raw

    broken = copy(bag, tmp_path / "bag", change)
    with pytest.raises(CampaignError, match="wrench: expected the frame platform, got elsewher"):
        read_loads(broken)


def test_bag_without_a_successful_load_is_refused(bag, tmp_path):
    message = StiffnessLoad(success=False, reason="the beam is blocked", tension=[1.0] * 8)
    failed = serialize_message(message)

    def change(topic, type_name, raw):
        return topic, type_name, failed if topic == "stiffness_load" else raw

    broken = copy(bag, tmp_path / "bag", change)
    with pytest.raises(CampaignError, match="expected at least one load that succeeded, got none"):
        read_loads(broken)


def test_window_without_its_measurement_is_named(bag, tmp_path):
    count = []

    def change(topic, type_name, raw):
        if topic == "reflector_measurement":
            count.append(raw)
            if len(count) == 2:
                return None
        return topic, type_name, raw

    broken = copy(bag, tmp_path / "bag", change)
    with pytest.raises(CampaignError, match="configuration 1, reflector 1, load 2, got none"):
        read_loads(broken)


def test_bag_without_a_campaign_requires_one(bag, tmp_path, capsys):
    foreign = copy(bag, tmp_path / "bag", lambda *m: m)
    with pytest.raises(CampaignError, match="--campaign FILE"):
        read_source(foreign)
    assert analyze([str(foreign)]) == 1
    assert "--campaign FILE" in capsys.readouterr().err
    assert analyze([str(tmp_path / "nowhere")]) == 2


def test_campaign_that_was_cut_is_analysed_as_it_is(bag, tmp_path):
    folder = tmp_path / "campaign"
    shutil.copytree(bag, folder / "bags" / "0001")
    mcap = next((folder / "bags" / "0001").glob("*.mcap"))
    content = mcap.read_bytes()
    mcap.write_bytes(content[: int(0.8 * len(content))])
    (folder / "bags" / "0001" / "metadata.yaml").unlink()
    (folder / "bags" / "0002").mkdir()
    (folder / "campaign.yaml").write_text(campaign_text(bag), encoding="utf-8")
    found = read_source(folder)
    assert 0 < len(found.loads) < SECONDS // 2
    assert not (folder / "bags" / "0001" / "metadata.yaml").exists(), "the folder is left alone"
