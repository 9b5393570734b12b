# SPDX-License-Identifier: Apache-2.0
"""Chapter 2's dynamics: Lagrange by finite differences, Newton, energy, momentum over a minute."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cabols_control.errors import CabolsError, DegenerateGeometryError, ShapeError
from cabols_sim.dynamics import (
    CENTRE,
    MATERIAL,
    PLANAR_CASE,
    STRETCHING,
    BodyState,
    CableRobot,
    bias,
    forward_dynamics,
    gravity,
    inverse_dynamics,
    kinetic_energy,
    mass_matrix,
    planar_robot,
    potential_energy,
    power,
    robot_of_rig,
    simulate,
    state_at,
    stream,
    transmission,
)
from cabols_sim.dynamics.balance import momentum_imbalance, planar_motion, spatial_motion
from cabols_sim.dynamics.body import acceleration
from cabols_sim.dynamics.newton import momentum, platform_imbalance

CABLES = {
    "centre": CENTRE,
    "material": MATERIAL,
    "stretching": STRETCHING,
    "planar_case": PLANAR_CASE,
}


def spatial(rig):
    inertia = np.array([[0.3, 0.02, -0.01], [0.02, 0.4, 0.03], [-0.01, 0.03, 0.5]])
    return robot_of_rig(rig.geometry, 10.0, inertia, 0.5, centre_of_mass=(0.02, 0.01, -0.03))


def planar():
    base = [[-4.0, -3.0], [5.0, -3.0], [4.0, 4.0], [-4.0, 5.0], [0.0, 6.0]]
    points = [[0.3, -0.2], [-0.3, -0.2], [-0.3, 0.3], [0.3, 0.3], [0.0, 0.4]]
    return planar_robot(base, points, 8.0, 0.6, [0.3, 0.4, 0.5, 0.6, 0.7])


@pytest.fixture(params=["planar", "spatial"])
def robot(request, rig):
    return planar() if request.param == "planar" else spatial(rig)


def anywhere(robot, rig, random):
    m = len(robot.freedom)
    x = 0.2 * random.normal(size=m)
    if m == 6:
        x[:3] = rig.geometry.reference_position + 0.2 * x[:3]
    return x, *random.normal(size=(2, m))


def with_law(robot, law):
    return (
        robot.with_constant_mass(np.full(robot.cables, 1.4))
        if law == "constant"
        else (robot.with_options(mass_law=law))
    )


def gradient(function, x, step=1e-6):
    """Central differences; with steps of 1e-6 of numbers near one, good to about 1e-9."""
    return np.array(
        [
            (function(x + step * e) - function(x - step * e)) / (2.0 * step)
            for e in np.eye(np.size(x))
        ]
    )


@pytest.mark.parametrize("law", ["variable", "no_stream", "constant"])
@pytest.mark.parametrize("cable", CABLES)
def test_equations_are_lagranges_by_finite_differences(robot, rig, random, cable, law):
    """(2.18) with T and V as functions: every derivative in D, c and G at once."""
    model = with_law(robot.with_options(cable=CABLES[cable]), law)
    x, x_dot, x_ddot = anywhere(model, rig, random)
    step = 1e-6

    def impulse(sign):
        ahead = x + sign * step * x_dot, x_dot + sign * step * x_ddot
        return mass_matrix(model, ahead[0]) @ ahead[1]

    changing = (impulse(1.0) - impulse(-1.0)) / (2.0 * step)
    by_place = gradient(lambda y: kinetic_energy(model, state_at(model, y, x_dot)), x)
    height = gradient(lambda y: potential_energy(model, state_at(model, y)), x)
    expected = changing - by_place + height - stream(model, x, x_dot)
    found = inverse_dynamics(model, x, x_dot, x_ddot)
    np.testing.assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())
    assert np.any(stream(model, x, x_dot)) == (law == "variable")


def test_mass_matrix_is_the_sources_product_of_jacobians(robot, rig, random):
    """(2.17): J_x^T M J_x + J_phi^T I J_phi with the Jacobians of (2.2) by finite differences."""
    x, _, _ = anywhere(robot, rig, random)
    state = state_at(robot, x)
    n, m = robot.cables, len(robot.freedom)
    length = state.cables(robot).length

    def centre(y):
        moved = state_at(robot, y)
        return (
            0.5 * (robot.base_points + moved.position + robot.platform_points @ moved.rotation.T)
        ).ravel()

    def along(y):
        return state_at(robot, y).cables(robot).axis.ravel()

    axis, axis_by = along(x).reshape(n, 3), gradient(along, x).reshape(m, n, 3)
    rods = np.repeat(robot.density * length, 3)
    translating = gradient(centre, x)
    expected = translating @ (rods[:, None] * translating.T)
    turning = np.cross(axis[None], axis_by)  # omega_c of each cable per x_dot
    for i in range(n):
        # (2.14): slender, so turning about the cable itself stores nothing.
        across = robot.density[i] * length[i] ** 3 / 12.0
        inertia = across * (np.eye(3) - np.outer(axis[i], axis[i]))
        expected += turning[:, i] @ inertia @ turning[:, i].T
    massless = robot.with_options(density=np.zeros(n))
    expected += mass_matrix(massless, x)
    np.testing.assert_allclose(mass_matrix(robot, x), expected, rtol=1e-7, atol=1e-7)


def test_printed_planar_jacobian_is_no_angular_velocity():
    """(2.32) prints J_ww = (E x S) / l, which is the length's; omega_c needs (E . S) / l."""
    robot = planar()
    x = np.array([0.3, -0.2, 0.25])

    def angle(y):
        axis = state_at(robot, y).cables(robot).axis
        return np.arctan2(axis[:, 1], axis[:, 0])

    by_turn = gradient(angle, x)[2]
    cables = state_at(robot, x).cables(robot)
    lever, axis, length = cables.lever, cables.axis, cables.length
    right = np.einsum("ij,ij->i", lever, axis) / length
    printed = (lever[:, 0] * axis[:, 1] - lever[:, 1] * axis[:, 0]) / length
    np.testing.assert_allclose(by_turn, right, rtol=1e-8)
    assert np.abs(by_turn - printed).max() > 0.5 * np.abs(by_turn).max()


@pytest.mark.parametrize("law", ["variable", "no_stream", "constant"])
def test_forward_undoes_inverse(robot, rig, random, law):
    model = with_law(robot, law)
    x, x_dot, x_ddot = anywhere(model, rig, random)
    tension = random.uniform(5.0, 50.0, model.cables)
    needed = inverse_dynamics(model, x, x_dot, x_ddot) - transmission(model, x) @ tension
    found = forward_dynamics(model, x, x_dot, tension, needed)
    np.testing.assert_allclose(found, x_ddot, rtol=1e-9, atol=1e-9)


def test_terms_vanish_where_they_must(robot, rig, random):
    x = anywhere(robot, rig, random)[0]
    assert not bias(robot, x, np.zeros(x.size)).any()
    assert not gravity(robot.with_options(gravity=np.zeros(3)), x).any()
    np.testing.assert_allclose(mass_matrix(robot, x), mass_matrix(robot, x).T, rtol=1e-12)
    assert np.linalg.eigvalsh(mass_matrix(robot, x))[0] > 0.0


def test_gravity_of_the_frames_datum_depends_on_its_origin(rig):
    """(2.22) counts the mass that winches give out from the frame: G then moves with the frame."""
    up = np.array([0.0, 0.0, 30.0])

    def lifted(robot):
        return replace(robot, base_points=robot.base_points + up)

    x = np.append(rig.geometry.reference_position, np.zeros(3))
    moved = x + np.append(up, np.zeros(3))
    winch, frame = spatial(rig), spatial(rig).with_options(datum="frame")
    np.testing.assert_allclose(gravity(lifted(winch), moved), gravity(winch, x), atol=1e-9)
    assert np.abs(gravity(lifted(frame), moved) - gravity(frame, x)).max() > 1.0


@pytest.mark.parametrize("cable", ["centre", "material"])
def test_newtons_laws_hold_for_material_cables_alone(robot, rig, random, cable):
    """Cable material followed by its acceleration, no variable-mass formula: same accelerations."""
    model = robot.with_options(cable=CABLES[cable])
    x, x_dot, _ = anywhere(model, rig, random)
    state = state_at(model, x, x_dot)
    tension = random.uniform(5.0, 50.0, model.cables)
    nu_dot = acceleration(model, state, tension, np.zeros(6))
    missing = np.abs(platform_imbalance(model, state, nu_dot, tension)[list(model.freedom)]).max()
    if cable == "material":
        assert missing < 1e-11
    else:
        assert missing > 0.1, "the source's centre of mass moves at half the material's speed"


@pytest.mark.parametrize("make", [planar_motion, spatial_motion], ids=["planar", "spatial"])
def test_power_and_momentum_balance_over_a_minute(make):
    free = make(MATERIAL)
    motion = free.run(60.0)
    assert motion.time[-1] == 60.0
    assert motion.relative_imbalance <= 1e-6
    linear, angular = momentum_imbalance(free.robot, motion)
    assert linear <= 1e-6
    assert angular <= 1e-6
    # The stream's share is no rounding: without it nothing would balance.
    assert np.abs(motion.work[:, 2]).max() > 1e-4 * motion.kinetic.max()


@pytest.mark.parametrize("make", [planar_motion, spatial_motion], ids=["planar", "spatial"])
def test_power_balances_for_the_published_model_over_a_minute(make):
    assert make(CENTRE).run(60.0, samples=61).relative_imbalance <= 1e-6


def test_stream_power_is_the_kinetic_energy_that_mass_brings(rig, random):
    robot = spatial(rig).with_options(cable=MATERIAL)
    x, x_dot, _ = anywhere(robot, rig, random)
    state = state_at(robot, x, x_dot)
    rate = state.cables(robot).rate
    brought = np.sum(robot.density * rate * 0.5 * rate**2)
    assert power(robot, state, np.zeros(8), np.zeros(6)).stream == pytest.approx(brought)
    by_force = stream(robot, x, x_dot) @ x_dot
    assert by_force == pytest.approx(brought)


@pytest.mark.parametrize("freedom", ["planar", "spatial"])
def test_angular_momentum_about_one_winch_point_is_kept(freedom, random):
    """All cables leave from the origin, nothing weighs: no torque about it, nor by the inflow."""
    points = random.normal(size=(4, 3))
    points[:, 2] *= freedom == "spatial"
    inertia = np.diag([2.0, 3.0, 4.0])
    robot = CableRobot(
        np.zeros((4, 3)),
        points,
        5.0,
        inertia,
        np.full(4, 0.4),
        gravity=np.zeros(3),
        freedom=(0, 1, 2, 3, 4, 5) if freedom == "spatial" else (0, 1, 5),
        cable=MATERIAL,
    )
    twist = np.array([0.5, 4.0, 0.0, 0.0, 0.0, 0.8])
    if freedom == "spatial":
        twist[2:5] = 0.5, 0.3, -0.2
    start = BodyState.checked([8.0, 1.0, 0.0], twist=twist)

    def pull(time, state):
        lengths = state.cables(robot).length
        return 3.0 + 0.6 * np.maximum(lengths - 7.0, 0.0) + np.sin(time + np.arange(4.0))

    motion = simulate(robot, start, pull, 60.0, samples=121)
    about = np.array([momentum(robot, state)[3:] for state in motion.states])
    assert np.abs(about - about[0]).max() <= 1e-8 * np.abs(about[0]).max()
    assert np.ptp([s.cables(robot).length.mean() for s in motion.states]) > 1.0
    assert motion.relative_imbalance <= 1e-6


def test_bad_input(rig):
    robot = spatial(rig)
    with pytest.raises(ShapeError, match="expected shape"):
        mass_matrix(robot, np.zeros(5))
    with pytest.raises(CabolsError, match="away from 90 deg"):
        mass_matrix(robot, [0.0, 1.0, 1.0, 0.0, np.pi / 2.0, 0.0])
    flat = planar_robot([[0.3, -0.2]] * 4, [[0.3, -0.2]] * 4, 1.0, 1.0, 0.1)
    with pytest.raises(DegenerateGeometryError, match="cable 1:"):
        mass_matrix(flat, np.zeros(3))
    with pytest.raises(CabolsError, match="positive definite"):
        robot_of_rig(rig.geometry, 1.0, -np.eye(3), 0.1)
    with pytest.raises(CabolsError, match="with_constant_mass"):
        robot.with_options(mass_law="constant")
    with pytest.raises(CabolsError, match="density"):
        robot_of_rig(rig.geometry, 1.0, np.eye(3), np.nan)
    with pytest.raises(CabolsError, match="beside it"):
        replace(robot, freedom=(0, 1, 5))
