# SPDX-License-Identifier: Apache-2.0
"""The ladder of models on robots of plain homogeneous matrices, none of the estimator's code."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import independent_arm as arm
from cabols_control.errors import CabolsError, ConfigError
from cabols_stiffness.identification.validation import validate
from cabols_stiffness.ladder.identified import identify_ladder
from cabols_stiffness.model.compensation import correct
from cabols_stiffness.model.elastic.prediction import predict_elastic
from cabols_stiffness.model.model_words import Rung, rungs_of
from cabols_stiffness.model.prediction import predict
from cabols_stiffness.model.result_file import read_result, write_result
from cabols_stiffness.model.verdict import Suspect
from hidden_campaign import campaign as campaign_of
from hidden_campaign import hidden_robot


@pytest.fixture(scope="module")
def chain():
    return arm.Chain()


def campaign(seed=11, count=12, loads=6):
    rng = np.random.default_rng(seed)
    return arm.configurations(rng, count), arm.loads(rng, loads)


def parallelogram(chain):
    motors = np.eye(6)
    motors[2, 1] = 1.0
    return lambda i, q, w: chain.settle(q, w, motors.T @ np.diag(arm.STIFFNESS) @ motors)


def soft_base(chain):
    bearings = np.full((7, 6), np.inf)
    bearings[0] = [5e7, 5e7, 5e7, 1.5e6, 1.5e6, 3e6]
    return lambda i, q, w: chain.settle(q, w, bearings=bearings)


def soft_bearings(chain):
    bearings = np.full((7, 6), np.inf)
    for j, stiffness in enumerate(arm.STIFFNESS):
        across = np.abs(chain.joints[j][1]) < 0.5
        bearings[j + 1, 3:][across] = 15.0 * stiffness
    return lambda i, q, w: chain.settle(q, w, bearings=bearings)


def plain(chain):
    return lambda i, q, w: chain.settle(q, w)


def varying(chain):
    """Of joints 2 and 5, with their own angles."""
    return lambda i, q, w: chain.settle(
        q,
        w,
        arm.STIFFNESS * np.r_[1, 1 + 0.5 * np.sin(2 * q[1]), 1, 1, 1 + 0.3 * np.cos(2 * q[4]), 1],
    )


def samples_of(settle, seed=5, count=12):
    return arm.noisy(arm.truth(*campaign(count=count), settle), np.random.default_rng(seed))


def explained(found, settle, seed=77):
    """Share of noise-free deflections that is predicted, at other configurations and loads."""
    Q, W = campaign(seed, 8, 5)
    joints, wrench = np.repeat(Q, len(W), axis=0), np.tile(W, (len(Q), 1))
    moved = np.array(
        [
            settle(0, q, w)[0][:3, 3] - settle(0, q, np.zeros(6))[0][:3, 3]
            for q, w in zip(joints, wrench, strict=True)
        ]
    )
    predicted = predict_elastic(found.elastic, joints, wrench, follows=True)
    error = predicted.deflection[:, :3] - moved
    band = 1.96 * np.sqrt(np.einsum("kii->ki", predicted.covariance)[:, :3])
    return 1.0 - np.sqrt(np.mean(error**2) / np.mean(moved**2)), np.mean(np.abs(error) <= band)


@pytest.mark.parametrize(
    ("mechanism", "rung", "share"),
    [
        (plain, None, 0.995),
        (parallelogram, Rung.COUPLING, 0.98),
        (soft_base, Rung.BASE, 0.98),
        (soft_bearings, Rung.LINKS, 0.97),
        (varying, Rung.VARYING, 0.96),
    ],
)
def test_ladder_takes_the_rung_that_the_robot_needs(chain, mechanism, rung, share):
    settle = mechanism(chain)
    found = identify_ladder(
        samples_of(settle, count=24 if rung is Rung.VARYING else 12), arm.robot()
    )
    taken = [step.rung for step in found.choice.steps if step.taken]
    assert taken[0] is Rung.JOINTS
    assert taken[1:2] == ([] if rung is None else [rung])
    assert found.result.adequate
    of_motion, _ = explained(found, settle)
    assert of_motion > share


def test_plain_robot_keeps_its_stiffness(chain):
    found = identify_ladder(samples_of(plain(chain)), arm.robot())
    error = np.abs(found.result.stiffness - arm.STIFFNESS)
    assert (error <= 3.0 * found.result.standard_deviation).all()
    assert (found.lower_bound < arm.STIFFNESS * 1.05).all()


def test_rungs_by_name_are_taken_whatever_they_gain(chain):
    found = identify_ladder(samples_of(plain(chain)), arm.robot(), "joints+base+coupling")
    taken = {step.rung for step in found.choice.steps if step.taken}
    assert taken == {Rung.JOINTS, Rung.BASE, Rung.COUPLING}


def test_unknown_rung_is_an_error():
    with pytest.raises(CabolsError, match="joined by"):
        rungs_of("joints+gearbox")


def test_unidentified_joint_has_a_bound_in_place_of_nothing(chain):
    """Forces through the axis of joint 1 alone."""
    rng = np.random.default_rng(2)
    Q = arm.configurations(rng, 6)
    Q[:, 0] = 0.0
    Q[:, 3:] = 0.0
    weak = np.array([[20.0, 0, 0, 0, 0.5, 0], [0, 0, 30.0, 0, 0, 0], [5.0, 0, 20.0, 0, 1.0, 0]])
    columns = arm.truth(Q, weak, lambda i, q, w: chain.settle(q, w))
    found = identify_ladder(arm.noisy(columns, rng), arm.robot(), "joints")
    assert not found.result.identifiable[0]
    assert np.isfinite(found.lower_bound).all()
    assert found.lower_bound[0] < arm.STIFFNESS[0]


@pytest.mark.parametrize("off_m", [0.01, 0.02])
def test_wrong_tool_point_is_not_taken_for_soft_links(chain, off_m):
    robot = arm.robot().with_tool([0.0, off_m, 0.15])
    found = identify_ladder(samples_of(plain(chain)), robot)
    assert not found.result.adequate
    assert found.choice.fault.suspect is Suspect.TOOL_POINT


def test_sensor_with_a_wrong_gain_is_not_taken_for_soft_links(chain):
    samples = samples_of(plain(chain))
    wrong = replace(samples, wrench=samples.wrench * [1, 1, 1.2, 1, 1, 1])
    found = identify_ladder(wrong, arm.robot())
    assert not found.result.adequate


def test_file_holds_the_whole_arm(chain, tmp_path):
    found = identify_ladder(samples_of(soft_base(chain)), arm.robot())
    write_result(tmp_path / "result.yaml", found.result, arm.robot())
    read = read_result(tmp_path / "result.yaml")
    q, w = arm.MIDDLE, np.array([40.0, -30.0, 60.0, 3.0, 2.0, -4.0])
    one, other = (predict(each, arm.robot(), q, w) for each in (found.result, read))
    np.testing.assert_allclose(one.deflection, other.deflection, rtol=1e-9)
    np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-6)
    (tmp_path / "elastic.npz").unlink()
    with pytest.raises(ConfigError, match="keep both files together"):
        read_result(tmp_path / "result.yaml")


def test_command_makes_up_for_all_that_gives_way(chain):
    settle = soft_bearings(chain)
    found = identify_ladder(samples_of(settle), arm.robot())
    Q, W = campaign(78, 4, 1)
    for q in Q:
        wanted = settle(0, q, np.zeros(6))[0][:3, 3]
        command = correct(found.result, arm.robot(), q, W[0], follows=True).joints
        before = settle(0, q, W[0])[0][:3, 3] - wanted
        after = settle(0, command, W[0])[0][:3, 3] - wanted
        assert np.linalg.norm(after) < 0.08 * np.linalg.norm(before)


def test_unloaded_references_show_where_the_joints_are():
    """Half a millimetre and half a milliradian, in a robot of which the estimator has the URDF."""
    robot = hidden_robot(2, "smooth")
    found = identify_ladder(campaign_of(robot, 2, count=14, peaks=3), arm.robot())
    nominal, kinematic, weights = found.calibration.steps
    assert kinematic.taken
    assert weights.taken
    assert kinematic.rms < 0.7 * nominal.rms
    assert weights.rms < 0.5 * kinematic.rms
    assert found.result.origin.kinematics == arm.robot().kinematics


def test_validation_goes_by_all_that_gives_way(chain):
    settle = soft_base(chain)
    found = identify_ladder(samples_of(settle), arm.robot())
    others = arm.noisy(arm.truth(*campaign(seed=78, count=3), settle), np.random.default_rng(6))
    checked = validate(found.result, others, arm.robot())
    assert checked.normalised_rms < 1.15
    assert checked.explained > 0.99
