# SPDX-License-Identifier: Apache-2.0
"""What version 0.1 wrote still opens: its bags, its campaign's folder, its rig's YAML files.

tests/data/v0_1/README.md says how 0.1 made each of them.
"""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from cabols_control.bags.reader import read_bag
from cabols_control.bags.recover import main as recover
from cabols_control.configuration import read_yaml
from cabols_control.console.view3d.scene import load_scene
from cabols_control.geometry import load_geometry
from cabols_control.rig import load_rig
from cabols_control.run_report.judgement.figures_of_merit import summarise
from cabols_control.run_report.run import load_run
from cabols_control.workspace.bodies import load_bodies
from cabols_hw.abb.configurations import load_configurations
from cabols_hw.card.config import load_card
from cabols_hw.safety.config import load_safety
from cabols_hw.tracker.config import load_tracker_config
from cabols_sim.devices.robot.robot_config import load_robot_truth
from cabols_sim.devices.tracker.config import load_tracker_truth
from cabols_sim.plant.config import load_plant
from cabols_stiffness import load_robot
from cabols_stiffness.analysis.analyze import main as analyze
from cabols_stiffness.campaign.journal import Journal, read_samples
from cabols_stiffness.campaign.plan import load_plan
from cabols_stiffness.model.prediction import predict
from cabols_stiffness.model.result_file import read_result

OLD = Path(__file__).parents[1] / "data" / "v0_1"
RIG = OLD / "rig"
RUN_TOPICS = ("limb_state", "wrench", "motor_current", "tension_command", "mode", "loop_status")
"""Topics that every bag of a run holds."""


@pytest.fixture
def killed(tmp_path):
    """A copy of the bag whose recorder was killed: recovering writes into it."""
    return Path(shutil.copytree(OLD / "bags" / "killed", tmp_path / "killed"))


@pytest.fixture
def campaign(tmp_path):
    """A copy of the campaign's folder."""
    return Path(shutil.copytree(OLD / "campaign", tmp_path / "campaign"))


@pytest.mark.parametrize("name", ["rigid", "robot"])
def test_bag_is_read_whole(name):
    """As many messages of each topic as its metadata.yaml announces, stamps in order."""
    folder = OLD / "bags" / name
    text = (folder / "metadata.yaml").read_text("utf-8")
    announced = dict(
        re.findall(r"name: (/cabols/\w+).*?message_count: (\d+)", text, flags=re.DOTALL)
    )
    bag = read_bag(folder)
    assert all(len(bag[topic]) for topic in RUN_TOPICS)
    for topic, count in announced.items():
        if int(count):
            assert len(bag[topic]) == int(count), topic
    state = bag["limb_state"]
    assert np.all(np.diff(state.stamp_ns) == 1_000_000), "lockstep: a sample each millisecond"
    assert np.asarray(state["tension"]).shape == (len(state), 8)


def test_run_report_judges_the_bag():
    """The programme of 20 N was on, and 0.1's own load_run found the same interval of LOADING."""
    run = load_run(OLD / "bags" / "rigid")
    loading = run.time[run.loading]
    assert loading[-1] - loading[0] == pytest.approx(0.28, abs=0.1)
    assert run.desired[run.loading][:, 0].max() == pytest.approx(20.0)
    assert run.metadata["description"] == "short programme, rigid target, lockstep"
    summary = summarise(run, load_rig())
    assert summary["infeasible_cycles"] == 0


def test_killed_bag_is_recovered(killed, capsys):
    assert not (killed / "metadata.yaml").exists()
    assert recover([str(killed)]) == 0
    assert "saved" in capsys.readouterr().out
    bag = read_bag(killed)
    assert len(bag["limb_state"]) > 100
    assert len(bag["wrench"]) == pytest.approx(len(bag["limb_state"]), abs=2)


def test_rig_files_say_what_the_bench_says():
    """0.1's bench and today's are the same rig: every number that control reads is equal."""
    old = load_rig(
        geometry=RIG / "bench_geometry.yaml",
        limbs=RIG / "bench_limbs.yaml",
        control=RIG / "bench_control.yaml",
    )
    new = load_rig()
    np.testing.assert_array_equal(old.geometry.base_points, new.geometry.base_points)
    np.testing.assert_array_equal(old.geometry.platform_points, new.geometry.platform_points)
    assert old.limbs == new.limbs
    assert old.control == new.control
    assert [g.integral for g in old.gains.limbs] == [g.integral for g in new.gains.limbs]


def test_designed_geometry_and_fast_control_load():
    rig = load_rig(geometry=RIG / "designed_geometry.yaml", control=RIG / "fast_control.yaml")
    assert rig.geometry.cables == 8
    assert load_geometry(RIG / "designed_geometry.yaml").platform_radius > 0.0


@pytest.mark.parametrize(
    ("load", "name"),
    [
        (load_card, "bench_card.yaml"),
        (load_robot_truth, "bench_robot.yaml"),
    ],
)
def test_device_files_load_as_the_bench_does(load, name):
    assert load(path=RIG / name) == load()


def test_safety_file_loads_as_it_was():
    """The bench's file is stricter since and allows paths; what a laboratory wrote stands."""
    old, new = load_safety(path=RIG / "bench_safety.yaml"), load_safety()
    assert old.encoder_jump == 0.5 > new.encoder_jump
    assert old.path_speeds == (old.speed_loaded, old.rotation_speed_loaded)
    since = {"speed_path": None, "rotation_speed_path": None}
    assert old == replace(new, encoder_jump=old.encoder_jump, **since)


def test_plant_file_loads():
    old, new = load_plant(path=RIG / "bench_plant.yaml"), load_plant()
    assert old.limbs == new.limbs
    assert old.sensors.tool_weight == pytest.approx(new.sensors.tool_weight, abs=1e-4)


def test_files_with_loaders_of_their_own_load():
    assert len(load_configurations(path=RIG / "bench_robot_configurations.yaml")) >= 10
    assert load_tracker_config(path=RIG / "bench_tracker.yaml")
    assert load_tracker_truth(path=RIG / "bench_tracker_truth.yaml")
    assert load_scene(path=RIG / "bench_scene.yaml")
    assert load_bodies(path=RIG / "bench_bodies.yaml")
    assert load_plan(RIG / "bench_campaign.yaml").configurations
    assert load_robot(RIG / "irb1600_6_145.urdf").limits.shape == (6, 2)


def stiffness(file):
    joints = yaml.safe_load(file.read_text("utf-8"))["joints"]
    return np.array([joint["stiffness_nm_per_rad"] or np.nan for joint in joints])


def test_campaign_is_analysed_as_0_1_did(campaign, tmp_path):
    """From the bag alone: what 0.1's own analysis of the same folder found, digit by digit."""
    assert analyze([str(campaign), "--output", str(tmp_path / "again")]) == 0
    np.testing.assert_allclose(
        stiffness(tmp_path / "again" / "result.yaml"), stiffness(OLD / "campaign" / "result.yaml")
    )


def test_campaign_goes_on(campaign):
    """The journal takes the loads that 0.1 finished as finished."""
    loads = read_samples(campaign)
    assert len(loads) == len((campaign / "samples.csv").read_text("utf-8").splitlines()) - 1
    before = (campaign / "samples.csv").read_bytes()
    journal = Journal(campaign)
    assert len(journal.loads) == len(loads)
    journal.close()
    assert (campaign / "samples.csv").read_bytes() == before


def test_result_predicts():
    result = read_result(OLD / "campaign" / "result.yaml")
    found = predict(result, load_robot(), [0.5, 0.3, -0.2, 0.4, 0.8, 0.3], [50, 0, -50, 0, 0, 2])
    assert 1e-5 < np.linalg.norm(found.deflection[:3]) < 2e-3


def test_commissioned_limbs_load(rig):
    """One limb commissioned, the others as configured; the gains beside follow from the limbs."""
    folder = OLD / "commission"
    again = load_rig(limbs=folder / "limbs.yaml")
    limbs = read_yaml(folder / "limbs.yaml")
    assert list(again.limbs.gain) == limbs["gain"]
    changed = np.flatnonzero(np.array(again.limbs.gain) != np.array(rig.limbs.gain))
    assert changed.tolist() == [2]
    gains = read_yaml(folder / "gains.yaml")
    np.testing.assert_allclose(gains["k_I"], [g.integral for g in again.gains.limbs], rtol=1e-5)
