# SPDX-License-Identifier: Apache-2.0
"""What a result is used for: prediction, compensation, compliance; and the design of campaigns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cabols_control.errors import CabolsError
from cabols_control.rig import load_rig
from cabols_sim.devices.robot.robot_target import RobotTarget
from cabols_stiffness import identify
from cabols_stiffness.design import (
    Information,
    candidate_configurations,
    candidate_loads,
    choose,
)
from cabols_stiffness.figures import validation_figure
from cabols_stiffness.identification.validation import validate
from cabols_stiffness.model.balance import balance
from cabols_stiffness.model.compensation import correct
from cabols_stiffness.model.compliance import cartesian_compliance, compliance_table
from cabols_stiffness.model.identity import require_inside
from cabols_stiffness.model.prediction import law_of, predict
from cabols_stiffness.model.screws import logarithm, turn
from stiffness_bench import (
    TENSION,
    WRENCH_LIMIT,
    Bench,
    bench_configurations,
    bench_robot,
    bench_setup,
    bench_truth,
    optimal_peaks,
    ramps,
)

ROBOT = bench_robot()
LOAD = np.array([60.0, -40.0, 50.0, 5.0, -6.0, 4.0])


@pytest.fixture(scope="module")
def result():
    configurations = bench_configurations()[[0, 1, 3, 7]]
    peaks, _ = optimal_peaks(configurations, 3)
    return identify(Bench(ROBOT, ramps(configurations, peaks, (1.0,))).draw(0), ROBOT)


def test_prediction_is_what_the_simulated_robot_does(result):
    joints = bench_configurations()[11]
    predicted = predict(result, ROBOT, joints, LOAD)
    robot = RobotTarget(bench_truth())
    robot.encoders[:] = joints
    for _ in range(300):
        robot.step(LOAD, 1e-3)
    position, rotation = ROBOT.forward(joints)
    moved = np.concatenate([robot.position - position, logarithm(robot.rotation @ rotation.T)])
    error = moved - predicted.deflection
    normalised = error @ np.linalg.solve(predicted.covariance, error)
    assert normalised < 30.0
    assert np.linalg.norm(error[:3]) < 0.02 * np.linalg.norm(moved[:3])
    assert not predicted.extrapolated
    assert predict(result, ROBOT, joints, 8.0 * LOAD).extrapolated


def test_prediction_covariance_is_the_parameters_and_the_wrenchs(result):
    joints, eps = bench_configurations()[2], 1e-4
    columns = []
    for j in range(6):
        moved = []
        for sign in (1.0, -1.0):
            parameters = result.parameters.copy()
            parameters[j] *= 1.0 + sign * eps
            moved.append(predict(replace(result, parameters=parameters), ROBOT, joints, LOAD))
        step = 2.0 * eps * result.parameters[j]
        columns.append((moved[0].deflection - moved[1].deflection) / step)
    expected = np.array(columns).T @ result.parameter_covariance[:6, :6] @ np.array(columns)
    np.testing.assert_allclose(
        np.diag(predict(result, ROBOT, joints, LOAD).covariance), np.diag(expected), rtol=2e-2
    )
    noisy = predict(result, ROBOT, joints, LOAD, wrench_covariance=np.eye(6))
    compliance = cartesian_compliance(result, ROBOT, joints)
    np.testing.assert_allclose(
        np.diag(noisy.covariance - predict(result, ROBOT, joints, LOAD).covariance),
        np.diag(compliance @ compliance.T),
        rtol=3e-2,
    )


@settings(max_examples=20)
@given(st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6), st.booleans())
def test_corrected_robot_stands_where_it_was_meant_to(result, share, follows):
    joints = bench_configurations()[5]
    bent = replace(result, parameters=np.r_[result.parameters[:6], 1e11, 1e11, 1e10, 1e7, 1e7, 1e6])
    wrench = np.array(share) * [100, 100, 100, 10, 10, 10]
    found = correct(bent, ROBOT, joints, wrench, follows=follows)
    rest = balance(ROBOT, found.joints[None], wrench[None], law_of(bent), follows)
    position, rotation = ROBOT.forward(joints)
    np.testing.assert_allclose(rest.posture.position[0], position, atol=1e-10)
    np.testing.assert_allclose(rest.posture.rotation[0], rotation, atol=1e-10)


def test_compensation_removes_the_deflection_of_the_simulated_robot(result):
    """With the identified stiffness, not the true one, at a load that was never measured."""
    joints = bench_configurations()[12]
    found = correct(result, ROBOT, joints, LOAD)
    ideal = ROBOT.forward(joints)
    errors = []
    for command in (joints, found.joints):
        robot = RobotTarget(bench_truth())
        robot.encoders[:] = command
        for _ in range(300):
            robot.step(LOAD, 1e-3)
        turned = np.linalg.norm(logarithm(robot.rotation @ ideal[1].T))
        errors.append((np.linalg.norm(robot.position - ideal[0]), turned))
    assert errors[1][0] < 0.05 * errors[0][0]
    assert errors[1][1] < 0.05 * errors[0][1]


def test_compensation_refuses_what_it_cannot_do(result):
    joints = bench_configurations()[0]
    with pytest.raises(CabolsError, match="all joints identified"):
        correct(replace(result, identifiable=np.array([True] * 5 + [False])), ROBOT, joints, LOAD)
    with pytest.raises(CabolsError, match="can balance"):
        correct(result, ROBOT, joints, 1e4 * LOAD)
    beyond = joints.copy()
    beyond[4] = ROBOT.limits[4, 0]
    # A torque that bends joint 5 outwards, so that the command goes past its limit.
    bending = np.linalg.solve(ROBOT.jacobian(beyond).T, 5.0 * np.eye(6)[4])
    with pytest.raises(CabolsError, match="within"):
        correct(result, ROBOT, beyond, bending, anywhere=True)


@pytest.mark.parametrize("joint", range(6))
def test_compensation_refuses_poses_far_from_the_data(result, joint):
    low, high = result.origin.joints[joint]
    for outside in (low - 0.6, high + 0.6):
        joints = bench_configurations()[0].copy()
        joints[joint] = outside
        with pytest.raises(CabolsError, match=rf"joint_{joint + 1} near the identified"):
            correct(result, ROBOT, joints, 0.1 * LOAD)
    joints[joint] = high + 0.2
    assert correct(result, ROBOT, joints, 0.1 * LOAD).joints.shape == (6,)


def test_compensation_refuses_loads_beyond_the_data(result):
    joints = bench_configurations()[0]
    with pytest.raises(CabolsError, match="identify with larger loads"):
        correct(result, ROBOT, joints, 8.0 * LOAD)
    assert correct(result, ROBOT, joints, 8.0 * LOAD, anywhere=True).prediction.extrapolated


def test_a_joint_that_has_turned_whole_turns_is_where_it_was(result):
    joints = bench_configurations()[0]
    turned = joints + 2.0 * np.pi * np.array([0, 0, 0, 0, 0, 1])
    require_inside(result, ROBOT, turned)


def test_compliance_table_is_that_of_the_jacobian(result):
    joints = bench_configurations()[0]
    rows = compliance_table(result, ROBOT, joints, 60.0)
    assert [row.direction for row in rows] == ["+x", "-x", "+y", "-y", "+z", "-z"]
    expected = np.repeat(np.diag(cartesian_compliance(result, ROBOT, joints))[:3], 2)
    found = [row.displacement[0] / row.force[0] for row in rows]
    # 6 N bend the arm so little that its Jacobian stays what it was.
    np.testing.assert_allclose(found, expected, rtol=5e-3)
    assert all((row.deviation > 0.0).all() for row in rows)


def test_figure_has_labelled_axes(result):
    configurations = bench_configurations()[[10, 11]]
    peaks, _ = optimal_peaks(configurations, 2)
    data = Bench(ROBOT, ramps(configurations, peaks, (0.5, 1.0))).draw(1, register=False)
    figure = validation_figure(validate(result, data, ROBOT), "held out")
    assert [axis.get_ylabel() for axis in figure.axes] == ["x [mm]", "y [mm]", "z [mm]"]


def test_candidates_keep_the_limits():
    rig = load_rig()
    joints = candidate_configurations(
        ROBOT, rig.geometry, bench_configurations()[0], 5, position_range=0.1, rotation_range=0.2
    )
    found = candidate_loads(
        ROBOT, rig.geometry, joints, 4, tension=TENSION, wrench_limit=WRENCH_LIMIT
    )
    assert found.tension.shape == (20, 8)
    assert found.tension.min() >= TENSION[0]
    assert found.tension.max() <= TENSION[1]
    for index, wrench in zip(found.configuration, found.wrench, strict=True):
        position, rotation = ROBOT.forward(joints[index])
        assert (np.abs(turn(rotation.T, wrench)) <= WRENCH_LIMIT * (1 + 1e-6)).all()
        assert np.abs(position - rig.geometry.reference_position).max() <= 0.1 + 1e-9


def test_information_is_what_identification_finds():
    """Predicted deviations are those of a simulated campaign of the same loads."""
    configurations = bench_configurations()[[0, 1, 3, 7]]
    peaks, design = optimal_peaks(configurations, 3)
    result = identify(Bench(ROBOT, ramps(configurations, peaks, (1.0,))).draw(5), ROBOT)
    found = result.standard_deviation / result.stiffness
    # The guess is 10 % off, drifts are estimated, references come after every load.
    np.testing.assert_allclose(design.deviation, found, rtol=0.35)


@pytest.mark.parametrize("criterion", ["D", "A"])
def test_optimal_loads_beat_arbitrary_ones(criterion):
    rig = load_rig()
    joints = bench_configurations()[:6]
    candidates = candidate_loads(
        ROBOT, rig.geometry, joints, 8, tension=TENSION, wrench_limit=WRENCH_LIMIT
    )
    information = Information(bench_setup(), candidates)
    best = choose(information, 12, 6, criterion, most=2)
    assert np.unique(candidates.configuration[best.chosen]).size == 6
    random = np.random.default_rng(0)
    others = []
    for _ in range(50):
        counts = np.zeros(48)
        counts[random.choice(48, 12, replace=False)] = 1.0
        others.append(information.of(counts))
    if criterion == "D":
        least = min(-np.linalg.slogdet(other)[1] for other in others)
        assert -np.linalg.slogdet(best.information)[1] < least
    else:
        least = min(np.trace(np.linalg.inv(other)) for other in others)
        assert np.trace(np.linalg.inv(best.information)) < least


def test_design_refuses_what_it_cannot_do():
    rig = load_rig()
    candidates = candidate_loads(
        ROBOT,
        rig.geometry,
        bench_configurations()[:1],
        2,
        tension=TENSION,
        wrench_limit=WRENCH_LIMIT,
    )
    information = Information(bench_setup(), candidates)
    with pytest.raises(CabolsError, match="one of D, A"):
        choose(information, 2, 1, "E")
    with pytest.raises(CabolsError, match="to hold 4 loads"):
        choose(information, 4, 1, most=2)
