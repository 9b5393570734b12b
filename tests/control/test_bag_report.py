# SPDX-License-Identifier: Apache-2.0
"""`report BAG`: any recorded run of a rig; what a bag lacks is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bag_builder import T0, BagBuilder
from cabols_control.rig import load_rig
from cabols_control.rig_folder import rig_file
from cabols_control.run_report.bag_report import report_bag
from cabols_control.run_report.command import main
from cabols_control.run_report.pictures import bag_parts
from cabols_control.supervision.modes import OperatingMode

MS = 1_000_000
LIMBS = np.arange(8, dtype=np.uint8)


def write(folder, topics, metadata=None):
    """Write 200 ms of some topics."""
    with BagBuilder(folder, metadata) as builder:
        quaternion = builder.make("geometry_msgs/msg/Quaternion", w=1.0)
        pose = builder.make("geometry_msgs/msg/Pose", orientation=quaternion)
        ones = np.ones(8)
        samples = {
            "limb_state": ("cabols_msgs/msg/LimbState", {"limb": LIMBS, "tension": 20.0 * ones}),
            "wrench": ("geometry_msgs/msg/WrenchStamped", {}),
            "desired_wrench": ("geometry_msgs/msg/WrenchStamped", {}),
            "motor_current": ("cabols_msgs/msg/MotorCurrent", {"limb": LIMBS, "current": ones}),
            "tension_command": ("cabols_msgs/msg/TensionCommand", {"limb": LIMBS, "tension": ones}),
            "platform_pose": ("geometry_msgs/msg/PoseStamped", {"pose": pose}),
            "joint_states": ("sensor_msgs/msg/JointState", {"position": np.zeros(6)}),
            "mode": ("cabols_msgs/msg/Mode", {"mode": int(OperatingMode.STOPPED), "reason": "x"}),
            "loop_status": (
                "cabols_msgs/msg/LoopStatus",
                {"node": "plant", "state": 2, "reason": "sensor saturated"},
            ),
            "/chatter": ("std_msgs/msg/String", {"data": "hello"}),
        }
        for i in range(200):
            for topic in topics:
                type_name, fields = samples[topic]
                builder.add(topic, type_name, T0 + i * MS, **fields)
    return folder


ALONE = [part.topic for part in bag_parts.PARTS]


@pytest.mark.parametrize("topic", ALONE)
def test_a_bag_with_one_topic_is_enough(tmp_path, topic):
    bag = write(tmp_path / "run", [topic])
    written = report_bag(bag, tmp_path / "report.html")
    assert written.shown == [part.title for part in bag_parts.PARTS if part.topic == topic]
    assert len(written.missing) == len(bag_parts.PARTS) - 1 + 1
    assert not written.judged
    text = written.path.read_text()
    for other in ALONE:
        assert (f"no messages of {other}" in text) == (other != topic)
    assert 'src="http' not in text


def test_the_command_names_what_is_missing_and_writes_over_its_own_report_alone(tmp_path, capsys):
    bag = write(tmp_path / "run", ["limb_state", "loop_status", "desired_wrench"])
    assert main([str(bag)]) == 0
    assert main([str(bag)]) == 0
    out = capsys.readouterr().out
    assert "missing: Motor currents: no messages of motor_current" in out
    text = (tmp_path / "run_report.html").read_text()
    assert "sensor saturated" in text
    assert "the bag carries no rig" in text
    thesis = tmp_path / "thesis.html"
    thesis.write_text("years of work")
    assert main([str(bag), "--output", str(thesis)]) == 2
    assert thesis.read_text() == "years of work"


def test_limits_are_those_of_the_rig_in_the_bag(tmp_path, monkeypatch):
    texts = {
        name: rig_file(f"{name}.yaml").read_text() for name in ("geometry", "limbs", "control")
    }
    limit = load_rig().control.tension_max
    assert f"tension_max: {limit:g}" in texts["control"]
    texts["control"] = texts["control"].replace(f"tension_max: {limit:g}", "tension_max: 77")
    bag = write(
        tmp_path / "run", ["limb_state"], {f"{name}_yaml": text for name, text in texts.items()}
    )
    drawn = []
    monkeypatch.setattr(bag_parts, "limit_line", lambda axes, value, label: drawn.append(label))
    written = report_bag(bag, tmp_path / "report.html")
    assert "limit 77 N" in drawn
    assert "files in the bag" in written.path.read_text()


def test_subsets_of_limbs_by_several_nodes_come_together(tmp_path):
    with BagBuilder(tmp_path / "run") as builder:
        for i in range(4):
            limbs = np.array([0, 1] if i % 2 else [2], np.uint8)
            builder.add(
                "motor_current",
                "cabols_msgs/msg/MotorCurrent",
                T0 + i * MS,
                limb=limbs,
                current=1.0 + limbs,
            )
    from cabols_control.bags.reader import read_bag

    found = bag_parts.by_limb(read_bag(tmp_path / "run")["motor_current"], "current")
    nan = np.nan
    np.testing.assert_array_equal(found, [[nan, nan, 3], [1, 2, nan]] * 2)


def test_a_foreign_and_a_missing_bag_are_reported(tmp_path, capsys):
    assert main([str(write(tmp_path / "run", ["/chatter"]))]) == 1
    assert "got /chatter; `export` writes any topics" in capsys.readouterr().err
    assert main([str(tmp_path / "none")]) == 2


def test_a_bag_of_version_0_1_with_a_load_is_judged(tmp_path):
    folder = Path(__file__).resolve().parents[1] / "data" / "v0_1" / "bags" / "rigid"
    written = report_bag(folder, tmp_path / "report.html")
    assert written.judged
    assert written.missing == ["Robot's joints: no messages of joint_states"]
    text = written.path.read_text()
    assert "peak current" in text
    assert "files in the bag" in text
