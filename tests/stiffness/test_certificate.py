# SPDX-License-Identifier: Apache-2.0
"""Budget, measured compliance and certificate, against robots of plain homogeneous matrices."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import independent_arm as arm
from cabols_control.errors import CabolsError
from cabols_stiffness import identify
from cabols_stiffness.certificate.budget import budget
from cabols_stiffness.certificate.compliance import measured_compliance
from cabols_stiffness.certificate.document import document
from cabols_stiffness.certificate.made import certificate_of
from cabols_stiffness.certificate.pages import write_certificate
from cabols_stiffness.certificate.statement import Kind, Source, load_statement
from cabols_stiffness.ladder.identified import identify_ladder
from cabols_stiffness.table.command import main

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "examples" / "statement.yaml"
LAB = ROOT / "tests" / "cases" / "stiffness" / "lab.csv"
OPTIONS = ["--tool", "0", "0", "0.15", "--reflector", "0", "0.1", "0.05", "--deviation-um", "21"]


@pytest.fixture(scope="module")
def columns():
    """Of six configurations; six loads each, so that each shows its whole compliance."""
    chain, random = arm.Chain(), np.random.default_rng(11)
    Q, W = arm.configurations(random, 6), arm.loads(random, 7)
    return arm.truth(Q, W, lambda i, q, w: chain.settle(q, w))


@pytest.fixture(scope="module")
def samples(columns):
    return arm.noisy(columns, np.random.default_rng(5))


@pytest.fixture(scope="module")
def result(samples):
    return identify(samples, arm.robot())


def with_gain(samples, gain):
    return replace(samples, wrench=samples.wrench * gain)


def turned(samples, angle):
    return replace(samples, position=samples.position @ arm.turn([0.0, 0.0, angle]).T)


def nudged(samples, angle):
    joints = samples.joints + np.array([0.0, angle, 0.0, 0.0, 0.0, 0.0])
    return replace(samples, joints=joints)


@pytest.mark.parametrize(
    ("kind", "component", "change", "unit"),
    [
        (Kind.FORCE_GAIN, 2, lambda s, u: with_gain(s, [1, 1, 1 + u, 1, 1, 1]), 0.01),
        (Kind.TORQUE_GAIN, 0, lambda s, u: with_gain(s, [1, 1, 1, 1 + u, 1, 1]), 0.01),
        (Kind.TRACKER_AXES, 2, turned, 0.005),
        (Kind.KINEMATICS, 1, nudged, 0.005),
        (Kind.TRACKER_SCALE, 0, lambda s, u: replace(s, position=s.position * (1 + u)), 0.01),
    ],
)
def test_sensitivity_is_what_a_wrong_measurement_does(
    samples, result, kind, component, change, unit
):
    """The budget's part against the identification of data that are wrong in one component."""
    wrong = identify(change(samples, unit), arm.robot(), robust=False, judged=False)
    shift = wrong.parameters[:6] / result.parameters[:6] - 1.0
    found = budget(result, samples, arm.robot(), [Source(kind, unit, correlation=0.0)])
    part = found.rows[1].relative
    assert (np.abs(shift) <= 1.1 * part + 0.002).all()
    if kind in (Kind.TRACKER_SCALE,):
        np.testing.assert_allclose(part, np.abs(shift), atol=0.002)


def test_gain_that_all_axes_share_moves_all_joints_alike(samples, result):
    """Force and torque by 1 %, fully correlated: every stiffness by 1 %, and these correlated."""
    found = budget(result, samples, arm.robot(), [Source(Kind.TRACKER_SCALE, 0.01)])
    np.testing.assert_allclose(found.rows[1].relative, 0.01, rtol=0.02)
    assert (found.correlation > -0.5).all()
    assert (found.combined >= found.rows[0].relative).all()


def test_coverage_factor_follows_the_degrees_of_freedom(samples, result):
    plain = budget(result, samples, arm.robot(), [])
    few = budget(result, samples, arm.robot(), [Source(Kind.TRACKER_SCALE, 0.2, freedom=3.0)])
    assert (plain.coverage < 2.1).all()
    np.testing.assert_allclose(few.coverage, 3.18, atol=0.1)


def test_compliance_is_measured_not_predicted(columns, result):
    """Against small forces on the independent robot's flange, with quiet instruments."""
    quiet = {"position_m": 2e-6, "force_n": 0.02, "torque_nm": 0.002}
    samples, chain = arm.noisy(columns, np.random.default_rng(5), **quiet), arm.Chain()
    found = measured_compliance(result, samples, arm.robot())
    assert len(found) == 6
    close = []
    for one in found:
        start = chain.frames(one.joints)[0]
        lever = start[:3, 3] - (start @ arm.TOOL)[:3, 3]
        for axis in range(3):
            force = np.eye(3)[axis] * 10.0
            wrench = np.r_[force, np.cross(lever, force)]
            _, deflection = chain.settle(one.joints, wrench, follows=False)
            moved = chain.frames(one.joints + deflection)[0][:3, 3] - start[:3, 3]
            error = one.compliance[axis] - moved[axis] / 10.0
            close.append(abs(error) / one.deviation[axis])
    known = np.array(close)[np.isfinite(close)]
    assert known.size >= 6
    assert np.mean(known < 2.0) > 0.7
    assert known.max() < 5.0


def test_one_direction_of_load_shows_no_other(samples, result):
    up = np.isin(samples.load, [0, 1, 100])
    fields = type(samples).__dataclass_fields__
    few = type(samples)(**{name: getattr(samples, name)[up] for name in fields})
    assert all(
        np.isnan(one.compliance).any() for one in measured_compliance(result, few, arm.robot())
    )


def test_certificate_says_all_that_it_must(samples, result, tmp_path):
    found = certificate_of(result, samples, arm.robot(), load_statement(EXAMPLE), ["line 3: torn"])
    page, pdf, data = write_certificate(tmp_path, found)
    text = page.read_text("utf-8")
    for word in ("laser tracker", "serial", "operator", "temperature", "torn", "kinematics"):
        assert word in text
    assert pdf.read_bytes().startswith(b"%PDF")
    content = json.loads(data.read_text("utf-8"))
    first = content["measurementResults"][0]["results"][0]["data"][0]["real"]
    assert first["unit"] == r"\newton\metre\per\radian"
    assert first["expandedUnc"]["coverageProbability"] == 0.95
    assert content["administrativeData"]["coreData"]["uniqueIdentifier"] == "0000-00"
    assert found.singles.shape == (6, 6, 3)


def test_ladder_has_a_certificate_too(samples):
    climbed = identify_ladder(samples, arm.robot(), "joints+base")
    found = certificate_of(climbed.result, samples, arm.robot(), load_statement(EXAMPLE))
    assert np.abs(found.residual).mean() < 3.0
    assert len(document(found)["measurementResults"][0]["results"]) == 3


def test_command_writes_it(tmp_path):
    words = ["identify", str(LAB), *OPTIONS, "--output", str(tmp_path / "out")]
    assert main([*words, "--statement", str(EXAMPLE)]) == 0
    for kind in ("html", "pdf", "json"):
        assert (tmp_path / "out" / f"certificate.{kind}").exists()


def test_unknown_source_is_named(tmp_path):
    path = tmp_path / "statement.yaml"
    path.write_text(EXAMPLE.read_text("utf-8").replace("tool_point", "moon"), encoding="utf-8")
    with pytest.raises(CabolsError, match="moon"):
        load_statement(path)
