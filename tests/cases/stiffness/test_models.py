# SPDX-License-Identifier: Apache-2.0
"""Data or models that are wrong in one thing: said, or covered by the stated deviations.

Six configurations, three reflectors, four loads of an independent robot. Sources: parallelogram
arms and balancers as of IRB 2400, 4400, 6400; bearings and base: papers on elastic models of
industrial arms.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import independent_arm as arm
from cabols_control.errors import CabolsError
from cabols_stiffness import identify, load_robot
from cases import outcome

MOST_DEVIATIONS = 3.0


def honest(result, true=arm.STIFFNESS):
    """Whether every joint is shown, within three of its stated standard deviations."""
    error = np.abs(result.stiffness - true)
    return bool(np.all(error <= MOST_DEVIATIONS * result.standard_deviation))


def flagged(result):
    """Whether an identification says that its numbers are not to be used.

    The word for it is the issue's to choose: a refusal, or a verdict beside the numbers.
    """
    if isinstance(result, CabolsError):
        return True
    return not result.converged or getattr(result, "adequate", True) is False


@pytest.fixture(scope="module")
def chain():
    return arm.Chain()


@pytest.fixture(scope="module")
def campaign():
    """Configurations and wrenches."""
    rng = np.random.default_rng(11)
    return arm.configurations(rng, 6), arm.loads(rng, 4)


@pytest.fixture(scope="module")
def good(chain, campaign):
    """Columns without a fault."""
    return arm.truth(*campaign, lambda i, q, w: chain.settle(q, w))


def identified(columns, change=None, robot=None, **noise):
    """What the identification gives, whatever that is."""
    samples = arm.noisy(columns, np.random.default_rng(5), **noise)
    return outcome(lambda: identify(change(samples) if change else samples, robot or arm.robot()))


def test_right_data_and_model_are_honest_and_not_flagged(good):
    found = identified(good)
    assert honest(found)
    assert not flagged(found)


def scaled_wrench(factors):
    return lambda s: replace(s, wrench=s.wrench * factors)


def turned(degrees):
    matrix = arm.turn([0.0, 0.0, np.radians(degrees)])
    return lambda s: replace(s, position=s.position @ matrix.T)


def in_kilonewtons(s):
    return replace(s, wrench=s.wrench / 1e3, wrench_covariance=s.wrench_covariance * 1e-6)


def in_millimetres(s):
    return replace(
        s,
        position=1e3 * s.position,
        offset=1e3 * s.offset,
        position_covariance=1e6 * s.position_covariance,
    )


def with_outliers(s):
    rng, position = np.random.default_rng(1), s.position.copy()
    hit = rng.choice(len(s), int(0.4 * len(s)), replace=False)
    position[hit] += 3e-4 * rng.choice([-1, 1], (hit.size, 3))
    return replace(s, position=position)


def one_group_shifted(s):
    position = s.position + 0.01 * s.configuration[:, None]
    return replace(s, group=np.zeros(len(s), int), position=position)


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(turned(5), id="base frame turned by 5 deg"),
        pytest.param(turned(90), id="base frame turned by 90 deg"),
        pytest.param(scaled_wrench([1, 1, 1, 1e3, 1e3, 1e3]), id="torque in N mm"),
        pytest.param(in_kilonewtons, id="force in kN"),
        pytest.param(in_millimetres, id="positions in mm"),
        pytest.param(lambda s: replace(s, joints=np.degrees(s.joints)), id="joints in degrees"),
        pytest.param(scaled_wrench(-1.0), id="sign of the sensor"),
        pytest.param(with_outliers, id="40 % outliers of 0.3 mm"),
        pytest.param(one_group_shifted, id="one group, base shifted by 1 cm"),
    ],
)
def test_wrong_data_are_flagged(good, change):
    assert flagged(identified(good, change))


@pytest.mark.parametrize("off_m", [0.01, 0.05])
def test_wrong_tool_point_is_flagged(good, off_m):
    found = identified(good, robot=load_robot(tool_position=[0.0, 0.0, 0.15 + off_m]))
    assert flagged(found) or honest(found)


def test_noise_that_is_stated_too_small_is_flagged(good):
    found = identified(good, stated_m=1e-7)
    assert flagged(found) or honest(found)


def parallelogram(chain):
    """Motor 3 holds q2 + q3."""
    motors = np.eye(6)
    motors[2, 1] = 1.0
    stiffness = motors.T @ np.diag(arm.STIFFNESS) @ motors
    return lambda i, q, w: chain.settle(q, w, stiffness)


def coupled_wrist(chain):
    motors = np.eye(6)
    motors[4, 3] = motors[5, 3] = 0.2
    motors[5, 4] = 0.3
    stiffness = motors.T @ np.diag(arm.STIFFNESS) @ motors
    return lambda i, q, w: chain.settle(q, w, stiffness)


def soft_bearings(chain):
    """Across each joint's axis, 15 times the joint's own stiffness."""
    bearings = np.full((7, 6), np.inf)
    for j, stiffness in enumerate(arm.STIFFNESS):
        across = np.abs(chain.joints[j][1]) < 0.5
        bearings[j + 1, 3:][across] = 15.0 * stiffness
    return lambda i, q, w: chain.settle(q, w, bearings=bearings)


def soft_base(chain):
    bearings = np.full((7, 6), np.inf)
    bearings[0] = [5e7, 5e7, 5e7, 1.5e6, 1.5e6, 3e6]
    return lambda i, q, w: chain.settle(q, w, bearings=bearings)


def balanced(chain):
    """Stiffness of joint 2 varies with its angle."""
    return lambda i, q, w: chain.settle(
        q, w, arm.STIFFNESS * np.r_[1, 1 + 0.6 * np.sin(q[1]), 1, 1, 1, 1]
    )


def with_backlash(chain):
    """Of +-20 urad in each joint."""

    def settle(i, q, w):
        deflection = chain.settle(q, w)[1]
        play = 2e-5 * np.tanh(deflection / 1e-5)
        return chain.frames(q + deflection + play)[0] @ arm.TOOL, deflection

    return settle


@pytest.mark.parametrize(
    "mechanism",
    [parallelogram, coupled_wrist, soft_bearings, soft_base, with_backlash],
)
def test_robot_beyond_the_model_is_flagged_or_covered(chain, campaign, mechanism):
    found = identified(arm.truth(*campaign, mechanism(chain)))
    assert flagged(found) or honest(found)


def test_stiffness_that_varies_is_flagged_or_its_mean_is_covered(chain, campaign):
    """One number for a joint whose stiffness varies is its mean over where it was measured.

    Joint 2 is between 0 and 0.37 rad here, where it is 1.00 to 1.22 times what it is at zero; these
    data are explained by their mean alone (chi-square's p = 0.66), so nothing is there to flag.
    """
    configurations, _ = campaign
    factor = np.ones((len(configurations), 6))
    factor[:, 1] = 1.0 + 0.6 * np.sin(configurations[:, 1])
    mean = arm.STIFFNESS / np.mean(1.0 / factor, axis=0)
    found = identified(arm.truth(*campaign, balanced(chain)))
    assert flagged(found) or honest(found, mean)


def test_creep_within_a_pass_is_flagged_or_covered(good):
    creep = np.zeros_like(good["position"])
    for group in np.unique(good["group"]):
        rows = np.flatnonzero(good["group"] == group)
        share = 1.0 - np.exp(-np.arange(rows.size) / 1.5)
        creep[rows] = np.outer(share, [60e-6, -40e-6, 80e-6])
    samples = arm.noisy(good, np.random.default_rng(5))
    moved = replace(samples, position=samples.position + creep)
    found = outcome(lambda: identify(moved, arm.robot()))
    assert flagged(found) or honest(found)


REACH = np.array([1.3e-4, 2.1e-4, 3e-4, 1.6e-3, 2.9e-3, 4.7e-3])
"""Of the presliding [rad]."""
FRICTION = 0.03 * arm.STIFFNESS * REACH


def dahl(state, step):
    sign = np.sign(step)
    return sign + (state - sign) * np.exp(-5.0 / REACH * np.abs(step))


def coulomb(state, step):
    return np.where(np.abs(step) > 1e-7, np.sign(step), state)


@pytest.mark.parametrize("seed", [31, 33])
@pytest.mark.parametrize("form", [dahl, coulomb])
def test_friction_of_other_forms_is_flagged_or_covered(chain, form, seed):
    """3 % friction of a form that is not the simulator's own, loading and unloading branch."""
    rng, states = np.random.default_rng(seed), {}
    Q, W = arm.configurations(rng, 6), arm.loads(rng, 3)

    def settle(i, q, w):
        deflection = chain.settle(q, w)[1]
        before, at = states.get(i, (np.zeros(6), np.zeros(6)))
        held = form(before, deflection - at)
        states[i] = held, deflection
        return chain.settle(q, w, friction=FRICTION * held)

    columns = arm.truth(Q, W, settle, down=True)
    quiet = {"position_m": 5e-6, "force_n": 0.05, "torque_nm": 0.005}
    samples = arm.noisy(columns, np.random.default_rng(1), **quiet)
    found = outcome(lambda: identify(samples, arm.robot(), hysteresis=True))
    assert flagged(found) or honest(found)
