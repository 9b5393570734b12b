# SPDX-License-Identifier: Apache-2.0
"""A platform that nothing but its cables holds: against MuJoCo, energy, and what gears allow."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cabols_control.errors import OutOfRangeError, ShapeError
from cabols_sim.plant.free_platform import FreePlatform, RigidBody
from cabols_sim.plant.plant import Plant

MASS, CENTRE = 4.0, np.array([0.02, 0.01, -0.03])
INERTIA = np.array([[0.03, 0.002, -0.001], [0.002, 0.04, 0.003], [-0.001, 0.003, 0.05]])
STIFFNESS = 2200.0


@pytest.fixture
def body():
    return RigidBody.checked(MASS, CENTRE, INERTIA)


def locked(rig, card, plant_config, body, pull):
    """A plant whose motors stand, every cable wound in to a pull [N], and its platform."""
    config = plant_config.linear()
    limbs = replace(config.limbs, self_locking=True, coulomb_current=1.0)
    target = FreePlatform(rig.geometry, body)
    plant = Plant(rig, card, replace(config, limbs=limbs), 1, target)
    plant._rest[:] = plant.cable_length - pull / STIFFNESS
    return plant, target


def mujoco_twin(rig, rest):
    """The same platform on springs that only pull."""
    anchors = sites = tendons = ""
    pairs = zip(rig.geometry.base_points, rig.geometry.platform_points, strict=True)
    for i, (base, point) in enumerate(pairs):
        anchors += f'<site name="a{i}" pos="{base[0]} {base[1]} {base[2]}"/>'
        sites += f'<site name="b{i}" pos="{point[0]} {point[1]} {point[2]}"/>'
        tendons += (
            f'<spatial name="t{i}" stiffness="{STIFFNESS}" springlength="0 {rest[i]:.17g}">'
            f'<site site="a{i}"/><site site="b{i}"/></spatial>'
        )
    full = (*np.diag(INERTIA), INERTIA[0, 1], INERTIA[0, 2], INERTIA[1, 2])
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="0.0001" integrator="RK4" gravity="0 0 -9.80665"/>
        <worldbody>{anchors}<body name="platform"><freejoint/><inertial mass="{MASS}"
        pos="{" ".join(map(str, CENTRE))}" fullinertia="{" ".join(map(str, full))}"/>{sites}</body>
        </worldbody><tendon>{tendons}</tendon></mujoco>"""
    )


def test_falls_into_its_cables_as_in_mujoco(rig, card, plant_config, body):
    """From the stand's pose, with cables of unequal pull, one of them slack and taut by turns."""
    pull = np.array([40.0, 10.0, 25.0, 0.0, 30.0, 8.0, 16.0, 22.0])
    plant, target = locked(rig, card, plant_config, body, pull)
    model = mujoco_twin(rig, plant._rest)
    data = mujoco.MjData(model)
    turn = Rotation.from_matrix(target.rotation)
    data.qpos[:] = np.concatenate([target.position, turn.as_quat(scalar_first=True)])
    start = target.position.copy()
    target.release()
    slack, moved = 0, 0.0
    for _ in range(4):
        for _ in range(1000):
            plant.advance(1e-4)
            slack += int((plant.tension == 0.0).any())
            moved = max(moved, float(np.linalg.norm(target.position - start)))
            mujoco.mj_step(model, data)
        # A step of first order against one of fourth order, over 0.4 s of free vibration.
        np.testing.assert_allclose(target.position, data.qpos[:3], atol=2e-4)
        found = Rotation.from_quat(data.qpos[3:], scalar_first=True).as_matrix()
        np.testing.assert_allclose(target.rotation, found, atol=3e-3)
    assert moved > 0.01
    assert 0 < slack < 4000


def test_energy_and_momentum_of_a_free_fall(rig, body):
    """Tumbling without cables: the turn's momentum and the energy stay; it falls by g t^2 / 2."""
    target = FreePlatform(rig.geometry, body)
    target._momentum[:] = [0.4, -0.8, 1.2, 0.05, -0.2, 0.12]
    target.release()
    start, before = target._momentum.copy(), target.energy
    middle = target.position + target.rotation @ CENTRE
    for _ in range(2000):
        target.step(np.zeros(6), 5e-4)
    place = target.position + target.rotation @ CENTRE
    fall = np.array([0.0, 0.0, -0.5 * 9.80665])
    np.testing.assert_allclose(place, middle + start[:3] / MASS + fall, atol=3e-3)
    np.testing.assert_allclose(target._momentum[3:], start[3:], rtol=1e-12)
    # Momentum first, then the way: every step falls by m g^2 dt^2 / 2 more.
    lost = 0.5 * MASS * 9.80665**2 * 5e-4
    assert target.energy == pytest.approx(before - lost, rel=1e-5)
    np.testing.assert_allclose(target.rotation @ target.rotation.T, np.eye(3), atol=1e-12)


def test_energy_of_a_platform_on_its_cables(rig, card, plant_config, body):
    """With standing motors nothing is gained: 5 s of vibration stay in the energy of the start."""
    plant, target = locked(rig, card, plant_config, body, np.full(8, 20.0))

    def whole():
        return target.energy + 0.5 * float(plant.tension @ plant.tension) / STIFFNESS

    plant.advance(1e-9)
    before = whole()
    target.release()
    seen = []
    for _ in range(5000):
        plant.advance(1e-3)
        seen.append(whole() - before)
    # 8 J are exchanged with the weight for each 0.2 m; the step of 1 ms leaves a ripple.
    assert np.abs(seen).max() < 0.12
    assert abs(np.mean(seen[-500:])) < 0.03


def test_a_stand_holds_until_it_is_released(rig, card, plant_config, body):
    plant, target = locked(rig, card, plant_config, body, np.full(8, 20.0))
    start = target.position.copy()
    for _ in range(50):
        plant.advance(1e-3)
    assert np.array_equal(target.position, start)
    target.release()
    plant.advance(1e-3)
    assert not np.array_equal(target.position, start)


def test_the_sensor_feels_nothing_without_a_robot(rig, card, plant_config, body):
    plant, target = locked(rig, card, plant_config, body, np.full(8, 20.0))
    bias = plant._bias.copy()
    target.release()
    for _ in range(100):
        plant.advance(1e-3)
        np.testing.assert_allclose(plant.sense()[1], bias, atol=1e-9)
    assert plant.wrench[2] > 10.0


@pytest.mark.parametrize(
    "inertia",
    [
        np.diag([1.0, 1.0, -1.0]),
        np.diag([1.0, 1.0, 3.0]),
        INERTIA + np.array([[0.0, 0.01, 0.0], [0.0] * 3, [0.0] * 3]),
        np.diag([np.nan, 1.0, 1.0]),
        np.ones(3),
    ],
)
def test_refuses_inertias_of_no_body(inertia):
    with pytest.raises(ShapeError):
        RigidBody.checked(1.0, CENTRE, inertia)


def test_refuses_a_body_without_mass(rig, body):
    for mass in (0.0, -1.0, np.nan):
        with pytest.raises(OutOfRangeError):
            RigidBody.checked(mass, CENTRE, INERTIA)
    with pytest.raises(OutOfRangeError):
        FreePlatform(rig.geometry, body, damping=[0, 0, -1, 0, 0, 0])
