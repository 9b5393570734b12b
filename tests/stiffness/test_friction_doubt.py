# SPDX-License-Identifier: Apache-2.0
"""Friction of another form than the estimator's: its stiffness is within the stated deviations."""

from __future__ import annotations

import numpy as np
import pytest

import cabols_stiffness.identification.identify as room
import independent_arm as arm
from cabols_stiffness import identify


def measured(form, size, seed, count=(6, 4)):
    """A campaign up and down; friction of a share `size` of each joint's largest torque."""
    rng, chain, states = np.random.default_rng(seed), arm.Chain(), {}
    Q, W = arm.configurations(rng, count[0]), arm.loads(rng, count[1])
    reach = np.max([np.abs(chain.settle(q, w)[1]) for q in Q for w in W], axis=0)

    def settle(i, q, w):
        deflection = chain.settle(q, w)[1]
        before, at = states.get(i, (np.zeros(6), np.zeros(6)))
        held = form(before, deflection - at, 0.5 * reach)
        states[i] = held, deflection
        return chain.settle(q, w, friction=size * arm.STIFFNESS * reach * held)

    return arm.noisy(arm.truth(Q, W, settle, down=True), np.random.default_rng(5))


def dahl(state, step, travel):
    sign = np.sign(step)
    return sign + (state - sign) * np.exp(-3.0 / travel * np.abs(step))


def coulomb(state, step, travel):
    return np.where(np.abs(step) > 1e-7, np.sign(step), state)


def without_doubt(samples, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(room, "with_doubt", lambda observations, found, model: found)
        return identify(samples, arm.robot())


@pytest.mark.parametrize(("form", "seed"), [(dahl, 12), (coulomb, 12)])
def test_another_form_is_within_the_deviations(form, seed, monkeypatch):
    samples = measured(form, 0.05, seed)
    found, plain = identify(samples, arm.robot()), without_doubt(samples, monkeypatch)
    np.testing.assert_allclose(found.parameters, plain.parameters, rtol=1e-12)
    far = np.abs(found.stiffness - arm.STIFFNESS) / found.standard_deviation
    assert np.all((far < 3.0) | ~found.identifiable)


def test_without_friction_the_deviations_stay(monkeypatch):
    samples = measured(dahl, 0.0, 13, (8, 4))
    found, plain = identify(samples, arm.robot()), without_doubt(samples, monkeypatch)
    ratio = found.standard_deviation / plain.standard_deviation
    assert np.all(ratio > 1.0 - 1e-9)
    assert np.median(ratio) < 1.1
    assert np.max(ratio) < 1.5
