# SPDX-License-Identifier: Apache-2.0
"""Data that are wrong as a whole are refused, whatever the design; good ones that scatter are not.

The laboratory is tests/harness/stiffness_lab.py, whose robots are products of matrices.
"""

from __future__ import annotations

import numpy as np
import pytest

import stiffness_lab as lab
from cabols_control.errors import CabolsError
from cabols_stiffness import identify
from cabols_stiffness.model.verdict import Grade, Suspect
from cases import outcome

DESIGNS = {
    "one reflector, few loads": lab.Design(reflectors=1, loads=3, robot="ur10"),
    "poses that scatter by 15 %": lab.Design(reflectors=0, scatter=0.15, configurations=8),
}


@pytest.fixture(scope="module", params=list(DESIGNS))
def data(request):
    """Design, its samples, robot and (c, n) true stiffness."""
    design = DESIGNS[request.param]
    samples, robot, true = lab.measure(design, np.random.default_rng(3))
    return design, samples, robot, true


def harmless(result, true):
    """Whether a result that is shown is right all the same: the data do not see the mistake."""
    mean = 1.0 / np.mean(1.0 / true, axis=0)
    error = np.abs(result.stiffness - mean) / result.standard_deviation
    return bool(np.all(error[result.identifiable] < 4.0))


def test_good_data_are_adequate(data):
    design, samples, robot, true = data
    result = identify(samples, robot)
    assert result.verdict.grade is (Grade.SCATTERED if design.scatter else Grade.GOOD)
    assert harmless(result, true)


@pytest.mark.parametrize("part", range(6))
def test_every_mistake_is_refused_or_harmless(data, part):
    design, samples, robot, true = data
    wrong = []
    for name, change in list(lab.mistakes(design, robot.n))[part::6]:
        found = outcome(lambda change=change: identify(change(samples), robot))
        if isinstance(found, CabolsError) or not found.adequate or harmless(found, true):
            continue
        wrong.append(name)
    assert wrong == []


def test_exchanged_joints_are_named():
    samples, robot, _ = lab.measure(lab.Design(), np.random.default_rng(3))
    for i, j in ((1, 2), (3, 5), (0, 4)):
        verdict = identify(lab.exchanged(i, j)(samples), robot).verdict
        assert verdict.grade is Grade.HOPELESS
        assert verdict.findings[0].suspect is Suspect.JOINT_ORDER
        assert f"{robot.joint_names[i]} and {robot.joint_names[j]}" in verdict.reason


def test_zero_of_a_joint_is_named():
    samples, robot, _ = lab.measure(lab.Design(), np.random.default_rng(3))
    verdict = identify(lab.joint_changed(2, shift=np.pi / 2.0)(samples), robot).verdict
    assert verdict.findings[0].suspect is Suspect.JOINT_ZERO
    assert "-90 deg" in verdict.reason
