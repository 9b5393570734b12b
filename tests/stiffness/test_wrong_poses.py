# SPDX-License-Identifier: Apache-2.0
"""Poses and reflectors with one thing wrong, and good ones with a few gross errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import stiffness_lab as lab
from cabols_stiffness import identify
from cabols_stiffness.identification.gauss_newton import IdentificationError

POSES = lab.Design(robot="ur10", configurations=10, loads=6, reflectors=0)


def drawn(design=POSES, seed=3):
    return lab.measure(design, np.random.default_rng(seed))


def torques_about_the_base(samples, robot):
    arm = robot.posture(samples.joints).position
    wrench = samples.wrench.copy()
    wrench[:, 3:] += np.cross(arm, wrench[:, :3])
    return replace(samples, wrench=wrench)


def in_tool_axes(samples, robot):
    back = robot.posture(samples.joints).rotation.swapaxes(1, 2)
    both = [np.einsum("kij,kj->ki", back, part) for part in np.split(samples.deflection, 2, axis=1)]
    return replace(samples, deflection=np.hstack(both))


def a_row_later(samples, robot):
    del robot
    return replace(samples, deflection=np.roll(samples.deflection, 1, axis=0))


def lengths(factor):
    return lambda samples, robot: lab.whole_lengths(factor)(samples)


def rotations(factor):
    return lambda samples, robot: lab.rotations_times(factor)(samples)


def torques(factor):
    return lambda samples, robot: lab.wrench_times(np.repeat([1.0, factor], 3))(samples)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (torques_about_the_base, "about the base's origin"),
        (in_tool_axes, "the deflections seem to be in the tool's axes"),
        (a_row_later, "in the row before its deflection"),
        (lengths(1.0 / 25.4), "inches, read as mm"),
        (lengths(0.1), "cm, read as mm"),
        (rotations(206264.8), "arcsec"),
        (rotations(1e-3), "rad, read as mrad"),
        (torques(4.4482), "N m beside lbf"),
        (torques(100.0), "N cm"),
    ],
)
def test_what_is_wrong_is_named_first(change, said):
    samples, robot, _ = drawn()
    verdict = identify(change(samples, robot), robot).verdict
    assert not verdict.adequate
    assert said in verdict.findings[0].text


def test_exchanged_reflectors_are_named():
    samples, robot, _ = drawn(replace(POSES, reflectors=3))
    offset = samples.offset.copy()
    first, second = samples.reflector == 0, samples.reflector == 1
    offset[first], offset[second] = samples.offset[second], samples.offset[first]
    verdict = identify(replace(samples, offset=offset), robot).verdict
    assert not verdict.adequate
    assert "reflectors 1 and 2 seem to be exchanged" in verdict.findings[0].text


@pytest.mark.parametrize("reflectors", [0, 3])
def test_gross_errors_of_any_size_move_no_stiffness(reflectors):
    """From ten deviations to decimetres, in up to a tenth of the rows: each as without them."""
    for seed in range(6):
        samples, robot, _ = drawn(replace(POSES, reflectors=reflectors), seed)
        clean = identify(samples, robot, judged=False)
        rng = np.random.default_rng(seed)
        name = "position" if reflectors else "deflection"
        values = getattr(samples, name).copy()
        loaded = np.flatnonzero((samples.wrench != 0.0).any(axis=1) & (samples.load > 0))
        bad = rng.choice(loaded, max(len(loaded) // 10, 1), replace=False)
        size = 10.0 ** rng.uniform(-3.3, -1.0, bad.size) * rng.choice([-1.0, 1.0], bad.size)
        values[bad, rng.integers(0, 3, bad.size)] += size
        found = identify(replace(samples, **{name: values}), robot, judged=False)
        assert set(bad) <= set(found.outliers)
        assert found.outliers.size <= bad.size + 2
        np.testing.assert_allclose(found.stiffness, clean.stiffness, rtol=0.06)


def test_errors_in_most_rows_are_refused():
    samples, robot, _ = drawn()
    values = samples.deflection.copy()
    values[::2, 0] += np.random.default_rng(0).uniform(0.01, 0.1, values[::2, 0].size)
    try:
        found = identify(replace(samples, deflection=values), robot)
    except IdentificationError:
        return
    assert not found.adequate
