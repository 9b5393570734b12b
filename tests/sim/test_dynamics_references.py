# SPDX-License-Identifier: Apache-2.0
"""Chapter 2's dynamics against pinocchio and MuJoCo, where they can build the model."""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from cabols_sim.dynamics import (
    MATERIAL,
    STRETCHING,
    BodyState,
    CableRobot,
    equations,
    simulate,
    state_at,
    winch_springs,
)
from cabols_sim.dynamics.body import acceleration

INERTIA = np.array([[0.3, 0.02, -0.01], [0.02, 0.4, 0.03], [-0.01, 0.03, 0.5]])
CENTRE_OF_MASS = np.array([0.02, 0.01, -0.03])


def make_robot(rig, density, **options):
    geometry = rig.geometry
    return CableRobot(
        geometry.base_points,
        geometry.platform_points,
        10.0,
        INERTIA,
        np.full(8, density),
        centre_of_mass=CENTRE_OF_MASS,
        **options,
    )


def make_state(rig, random):
    turn = Rotation.from_rotvec(0.3 * random.normal(size=3)).as_matrix()
    position = rig.geometry.reference_position + 0.05 * random.normal(size=3)
    return BodyState.checked(position, turn, random.normal(size=6))


class Rods:
    """Cables as pinocchio sees them: ball joint, slide, and on it a rod, or points at shares of it.

    A rod of the present length that slides through its winch's exit moves, at this instant, as the
    material of a cable that is wound. Two half masses at the right shares move as an evenly
    stretching rod.
    """

    def __init__(self, base, masses, lengths, gravity, shares=None):
        self.model, self.shares = pin.Model(), shares
        self.model.gravity.linear = gravity
        for i, (point, mass, length) in enumerate(zip(base, masses, lengths, strict=True)):
            place = pin.SE3(np.eye(3), point)
            for k, _ in enumerate(shares or (1.0,)):
                ball = self.model.addJoint(0, pin.JointModelSpherical(), place, f"ball{i}{k}")
                slide = self.model.addJoint(
                    ball, pin.JointModelPZ(), pin.SE3.Identity(), f"slide{i}{k}"
                )
                if shares is None:
                    across = mass * length**2 / 12.0
                    rod = pin.Inertia(
                        mass, np.array([0, 0, -length / 2]), np.diag([across] * 2 + [0])
                    )
                else:
                    rod = pin.Inertia(mass / len(shares), np.zeros(3), np.zeros((3, 3)))
                self.model.appendBodyToJoint(slide, rod, pin.SE3.Identity())
        self.data = self.model.createData()

    def point_forces(self, cables, accelerations):
        """(n, 3) forces that must act on the platform's points, by recursive Newton-Euler."""
        q, v, a, turns = [], [], [], []
        for i, point in enumerate(accelerations):
            e, length = cables.axis[i], cables.length[i]
            l_dot, w = cables.rate[i], cables.across[i]
            e_dot = w / length
            l_ddot = e @ point + length * e_dot @ e_dot
            e_ddot = (point - l_ddot * e - 2.0 * l_dot * e_dot) / length
            turn = Rotation.align_vectors(e[None], [[0.0, 0.0, 1.0]])[0].as_matrix()
            spin, spin_dot = np.cross(e, e_dot), np.cross(e, e_ddot)
            for share in self.shares or (1.0,):
                q += [*pin.Quaternion(turn).coeffs(), share * length]
                v += [*(turn.T @ spin), share * l_dot]
                a += [*(turn.T @ spin_dot), share * l_ddot]
                turns.append((i, turn, share))
        tau = pin.rnea(self.model, self.data, np.array(q), np.array(v), np.array(a))
        forces = np.zeros((len(accelerations), 3))
        for (i, turn, share), row in zip(turns, tau.reshape(-1, 4), strict=True):
            e, length = cables.axis[i], cables.length[i]
            # Power: spin = e x B_dot / length, slide = share l_dot.
            forces[i] += np.cross(turn @ row[:3], e) / length + share * row[3] * e
        return forces


def platform_force(robot, state, twist_rate):
    """(6,) force and torque at the origin, base axes, by pinocchio, for the platform alone."""
    model = pin.Model()
    model.gravity.linear = robot.gravity
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "platform")
    body = pin.Inertia(robot.mass, robot.centre_of_mass, robot.inertia)
    model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    turn = state.rotation
    q = np.concatenate([state.position, pin.Quaternion(turn).coeffs()])
    linear, omega = state.twist[:3], state.twist[3:]
    v = np.concatenate([turn.T @ linear, turn.T @ omega])
    # Derivative of the velocity in the body's own axes.
    body_rate = turn.T @ (twist_rate[:3] - np.cross(omega, linear))
    a = np.concatenate([body_rate, turn.T @ twist_rate[3:]])
    tau = pin.rnea(model, model.createData(), q, v, a)
    return np.concatenate([turn @ tau[:3], turn @ tau[3:]])


@pytest.mark.parametrize("freedom", ["planar", "spatial"])
@pytest.mark.parametrize("law", ["variable", "constant"])
def test_inverse_dynamics_equals_pinocchios(rig, random, freedom, law):
    robot, state = make_robot(rig, 0.7, cable=MATERIAL), make_state(rig, random)
    if freedom == "planar":
        flat = np.array([1.0, 1.0, 0.0])
        robot = CableRobot(
            robot.base_points[:4] * flat,
            robot.platform_points[:4] * flat,
            10.0,
            np.diag([0.3, 0.4, 0.5]),
            np.full(4, 0.7),
            centre_of_mass=CENTRE_OF_MASS * flat,
            gravity=np.array([0.0, -9.8, 0.0]),
            freedom=(0, 1, 5),
            cable=MATERIAL,
        )
        place = np.append(rig.geometry.reference_position[:2], 0.2)
        state = state_at(robot, place, random.normal(size=3))
    shares = None
    if law == "constant":
        robot = robot.with_constant_mass(np.full(robot.cables, 1.4), STRETCHING)
        shares = (0.5 - np.sqrt(1.0 / 12.0), 0.5 + np.sqrt(1.0 / 12.0))
    nu_dot = random.normal(size=len(robot.freedom))
    twist_rate = robot.selection @ nu_dot
    cables = state.cables(robot)
    omega, lever = state.twist[3:], cables.lever
    points = twist_rate[:3] + np.cross(twist_rate[3:], lever)
    points = points + np.cross(omega, np.cross(omega, lever))
    masses = robot.cable_mass(cables.length)
    rods = Rods(robot.base_points, masses, cables.length, robot.gravity, shares)
    forces = rods.point_forces(cables, points)
    expected = platform_force(robot, state, twist_rate)
    expected += np.concatenate([forces.sum(axis=0), np.cross(lever, forces).sum(axis=0)])
    terms = equations(robot, state)
    found = terms.inertia @ nu_dot + terms.bias + terms.gravity
    np.testing.assert_allclose(found, expected[list(robot.freedom)], rtol=1e-9, atol=1e-9)


def mujoco_model(rig, stiffness, damping, rest):
    """Platform on massless cables, winches as springs, by MuJoCo's tendons."""
    sites, tendons, anchors = "", "", ""
    for i, (base, point) in enumerate(
        zip(rig.geometry.base_points, rig.geometry.platform_points, strict=True)
    ):
        anchors += f'<site name="a{i}" pos="{base[0]} {base[1]} {base[2]}"/>'
        sites += f'<site name="b{i}" pos="{point[0]} {point[1]} {point[2]}"/>'
        tendons += (
            f'<spatial name="t{i}" stiffness="{stiffness}" damping="{damping}" '
            f'springlength="{rest[i]:.17g}"><site site="a{i}"/><site site="b{i}"/></spatial>'
        )
    full = " ".join(
        str(v) for v in (*np.diag(INERTIA), INERTIA[0, 1], INERTIA[0, 2], INERTIA[1, 2])
    )
    centre = " ".join(str(v) for v in CENTRE_OF_MASS)
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="0.0005" integrator="RK4" gravity="0 0 -9.80665"/>
        <worldbody>{anchors}<body name="platform"><freejoint/>
        <inertial pos="{centre}" mass="10" fullinertia="{full}"/>{sites}</body></worldbody>
        <tendon>{tendons}</tendon></mujoco>"""
    )


def test_massless_limit_equals_mujoco(rig):
    """Cables without mass: one second of motion on springs and dampers, then the acceleration."""
    robot = make_robot(rig, 0.0)
    start = BodyState.checked(
        rig.geometry.reference_position + np.array([0.02, -0.01, 0.03]),
        Rotation.from_rotvec([0.1, -0.05, 0.08]).as_matrix(),
        [0.1, 0.2, -0.1, 0.3, -0.2, 0.4],
    )
    rest = start.cables(robot).length - 0.15
    law = winch_springs(300.0, 5.0, rest, np.zeros(8), robot)
    motion = simulate(robot, start, law, 1.0, samples=2)
    assert motion.tension.min() > 0.0, "MuJoCo's tendons would push"

    model = mujoco_model(rig, 300.0, 5.0, rest)
    data = mujoco.MjData(model)
    quaternion = Rotation.from_matrix(start.rotation).as_quat(scalar_first=True)
    data.qpos[:] = np.concatenate([start.position, quaternion])
    data.qvel[:3] = start.twist[:3]
    data.qvel[3:] = start.rotation.T @ start.twist[3:]
    mujoco.mj_forward(model, data)
    nu_dot = acceleration(robot, start, law(0.0, start), np.zeros(6))
    turned = np.concatenate([nu_dot[:3], start.rotation.T @ nu_dot[3:]])
    np.testing.assert_allclose(data.qacc, turned, rtol=1e-9, atol=1e-9)

    for _ in range(2000):
        mujoco.mj_step(model, data)
    end = motion.states[-1]
    # RK4 with half a millisecond against order 8 with a relative tolerance of 1e-9.
    np.testing.assert_allclose(data.qpos[:3], end.position, atol=1e-7)
    found = Rotation.from_quat(data.qpos[3:], scalar_first=True).as_matrix()
    np.testing.assert_allclose(found, end.rotation, atol=1e-6)
    np.testing.assert_allclose(data.qvel[:3], end.twist[:3], atol=1e-5)
