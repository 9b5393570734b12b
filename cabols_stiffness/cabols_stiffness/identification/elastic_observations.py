# SPDX-License-Identifier: Apache-2.0
"""Measurements against an elastic arm: residuals, what is measured of its motion, covariances."""

from __future__ import annotations

import numpy as np

from cabols_control.checks import FloatArray
from cabols_stiffness.identification.hysteresis import stays
from cabols_stiffness.identification.observations import Observations
from cabols_stiffness.measurements.samples import PointSamples, Samples
from cabols_stiffness.model.elastic.arm import Arm, settle, softness
from cabols_stiffness.model.elastic.blocks import Statics
from cabols_stiffness.model.elastic.friction import Form, friction_along
from cabols_stiffness.model.screws import logarithm, point_motion, turning

DRAWN = 3
"""Rounds in which friction is drawn along the deflections, and these follow it."""


def residual_of(observations: Observations, arm: Arm, state: Statics) -> FloatArray:
    """(k, m) measured minus predicted; zero for what was not measured.

    Args:
        observations: of the robot.
        arm: what gives way.
        state: of the samples.
    """
    samples, posture = observations.samples, state.frames.posture
    if isinstance(samples, PointSamples):
        offset = np.einsum("kij,kj->ki", posture.rotation, samples.offset)
        return np.asarray(np.nan_to_num(samples.position - posture.position - offset))
    assert samples.reference_wrench is not None
    nothing = np.zeros_like(samples.joints)
    start = settle(
        observations.robot, arm, samples.joints, samples.reference_wrench, False, nothing
    ).frames.posture
    turned = logarithm(posture.rotation @ start.rotation.swapaxes(1, 2))
    predicted = np.concatenate([posture.position - start.position, turned], axis=1)
    return np.asarray(np.nan_to_num(samples.deflection - predicted))


def motion_of(observations: Observations, state: Statics) -> FloatArray:
    """(k, m, 6) what is measured of a small motion of the tool.

    Args:
        observations: of the robot.
        state: of the samples.
    """
    samples = observations.samples
    if isinstance(samples, PointSamples):
        rotation = state.frames.posture.rotation
        return point_motion(np.einsum("kij,kj->ki", rotation, samples.offset))
    return np.broadcast_to(np.eye(6), (len(samples), 6, 6))


def covariance_of(observations: Observations, arm: Arm, state: Statics) -> FloatArray:
    """(k, m, m) of the residual: the measurement's, and the wrench's through the soft arm.

    Args:
        observations: of the robot.
        arm: what gives way.
        state: of the samples.
    """
    samples = observations.samples
    posture = state.frames.posture
    through = motion_of(observations, state) @ softness(arm, state)
    noise = samples.deflection_covariance if isinstance(samples, Samples) else None
    if isinstance(samples, PointSamples):
        through = through @ turning(posture.rotation)
        noise = samples.position_covariance
    assert noise is not None
    return np.asarray(noise + through @ samples.wrench_covariance @ through.swapaxes(1, 2))


def draw(
    observations: Observations, deflection: FloatArray, form: Form, travel: FloatArray, kept: bool
) -> FloatArray:
    """(k, ..., n) share of friction in each sample.

    Args:
        observations: whose order counts.
        deflection: (k, n) of the joints [rad].
        form: of the friction.
        travel: (..., n) [rad].
        kept: whether it is kept when the robot moves to another configuration.
    """
    found = np.zeros((deflection.shape[0], *travel.shape))
    extra = (1,) * (travel.ndim - 1)
    for members in stays(observations.samples, kept):
        path = deflection[members].reshape(members.size, *extra, deflection.shape[1])
        found[members] = friction_along(form, path, travel)
    return found


def settled(observations: Observations, arm: Arm) -> Statics:
    """Balance of all samples, friction drawn in the order of measurement.

    Args:
        observations: of the robot.
        arm: what gives way.
    """
    samples = observations.samples
    drawn, friction, deflection = np.zeros_like(samples.joints), arm.friction, None
    for _ in range(1 if friction is None else DRAWN):
        state = settle(
            observations.robot, arm, samples.joints, samples.wrench, observations.follows,
            drawn, deflection,
        )  # fmt: skip
        deflection = state.deflection
        if friction is not None:
            drawn = draw(observations, deflection, friction.form, friction.travel, False)
    return state
