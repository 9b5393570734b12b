# SPDX-License-Identifier: Apache-2.0
"""Arguments as compiled code finds them: the same answers for every form, refusals, no crash."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from cabols_control.errors import CabolsError
from cabols_control.tension import RigTensionResolver, TensionResolver, calls, distribute
from cabols_control.tension.kernels.array_objects import layout_is_known
from tension_cases import CENTRE, HIGH, LOW, REFERENCE, matrix_of, reference_points

WRENCH = REFERENCE @ np.linspace(20.0, 60.0, 8)
EYE = np.eye(3)


def read_only(values):
    fixed = np.array(values)
    fixed.flags.writeable = False
    return fixed


def strided(values):
    return np.repeat(np.array(values), 2, axis=-1)[..., ::2]


def unaligned(values):
    array = np.array(values)
    raw = np.zeros(array.nbytes + 1, np.uint8)
    view = raw[1:].view(np.float64).reshape(array.shape)
    view[...] = array
    return view


FORMS = {
    "list": lambda values: np.array(values).tolist(),
    "read-only": read_only,
    "strided": strided,
    "turned": np.asfortranarray,
    "byte-swapped": lambda values: np.array(values).astype(">f8"),
    "unpickled": lambda values: pickle.loads(pickle.dumps(np.array(values))),
    "unaligned": unaligned,
    "subclass": np.ma.array,
    "longdouble": lambda values: np.array(values, dtype=np.longdouble),
}


def test_layout_is_known_here():
    """Else every entry takes numba's way, which is right but slower."""
    assert layout_is_known()


@pytest.mark.parametrize("form", FORMS)
def test_every_form_gives_the_same(form):
    turn = FORMS[form]
    expected = distribute(REFERENCE, WRENCH, LOW, HIGH).tension
    fixed = TensionResolver(REFERENCE, LOW, HIGH)
    moving = RigTensionResolver(*reference_points(), LOW, HIGH)
    tension = np.empty(8)
    found = [
        distribute(turn(REFERENCE), turn(WRENCH), LOW, HIGH).tension,
        distribute(REFERENCE, WRENCH, turn(np.full(8, LOW)), turn(np.full(8, HIGH))).tension,
        fixed.solve(turn(WRENCH)).tension,
        moving.solve(turn(CENTRE), turn(EYE), turn(WRENCH)).tension,
    ]
    for resolver, arguments in ((fixed, []), (moving, [turn(CENTRE), turn(EYE)])):
        assert resolver.solve_into(*arguments, turn(WRENCH), tension)
        found.append(tension.copy())
    assert fixed.feasible(turn(WRENCH))
    for other in found:
        np.testing.assert_allclose(other, expected, atol=1e-9)


@pytest.mark.parametrize(
    "wrong",
    [None, 1.0, "wrench", object, (), {}, np.float64(3.0), np.zeros(0), np.zeros(7), EYE],
    ids=repr,
)
def test_what_is_no_wrench_is_refused(wrong):
    fixed = TensionResolver(REFERENCE, LOW, HIGH)
    moving = RigTensionResolver(*reference_points(), LOW, HIGH)
    tension = np.empty(8)
    for call in (
        lambda: fixed.solve(wrong),
        lambda: fixed.feasible(wrong),
        lambda: fixed.solve_into(wrong, tension),
        lambda: moving.solve(CENTRE, EYE, wrong),
        lambda: moving.solve(CENTRE, wrong, np.zeros(8)),
        lambda: moving.solve_into(CENTRE, EYE, wrong, tension),
        lambda: distribute(REFERENCE, wrong, LOW, HIGH),
    ):
        with pytest.raises(CabolsError, match="expected"):
            call()


@pytest.mark.parametrize(
    "output",
    [read_only(np.zeros(8)), np.zeros(16)[::2], np.zeros(9), np.zeros(8, np.float32), [0.0] * 8],
    ids=["read-only", "strided", "nine", "float32", "list"],
)
def test_only_an_array_that_can_be_filled_is(output):
    before = np.array(output)
    fixed = TensionResolver(REFERENCE, LOW, HIGH)
    moving = RigTensionResolver(*reference_points(), LOW, HIGH)
    with pytest.raises(CabolsError, match=r"tension: expected"):
        fixed.solve_into(WRENCH, output)
    with pytest.raises(CabolsError, match=r"tension: expected"):
        moving.solve_into(CENTRE, EYE, WRENCH, output)
    np.testing.assert_array_equal(output, before)


def test_a_work_array_that_is_none_is_no_crash():
    fixed = TensionResolver(REFERENCE, LOW, HIGH)
    fixed.work = None
    with pytest.raises(CabolsError, match="expected"):
        fixed.solve(WRENCH)


def flat_rig(height):
    """A rig whose points are nearly in one plane."""
    rng = np.random.default_rng(7)
    base, platform = rng.uniform(-1.0, 1.0, (8, 3)), rng.uniform(-0.2, 0.2, (8, 3))
    base[:, 2] *= height
    platform[:, 2] *= height
    return base, platform


@pytest.mark.parametrize("height", [1.0, 1e-2, 1e-4, 1e-6])
def test_all_ways_give_up_the_same_where_tensions_are_steep(height):
    """The short way for eight cables took steep least-norm tensions as they were."""
    rng = np.random.default_rng(8)
    points = flat_rig(height)
    A, moving = matrix_of(*points, np.zeros(3)), RigTensionResolver(*points, LOW, HIGH)
    fixed = TensionResolver(A, LOW, HIGH)
    for _ in range(20):
        wrench = A @ rng.uniform(LOW, HIGH, 8)
        expected = fixed.solve(wrench)
        for found in (
            distribute(A, wrench, LOW, HIGH),
            distribute(A.tolist(), wrench.tolist(), LOW, HIGH),
            moving.solve(np.zeros(3), EYE, wrench),
        ):
            assert found.feasible == expected.feasible
            assert found.loss == pytest.approx(expected.loss, abs=1e-7)
            np.testing.assert_allclose(found.tension, expected.tension, atol=1e-6)


@pytest.mark.long
def test_numbas_way_gives_the_same(monkeypatch):
    """For builds of Python whose objects look otherwise."""
    monkeypatch.setattr(calls, "layout_is_known", lambda: False)
    entry, work = calls._load("solve_into_entry"), TensionResolver(REFERENCE, LOW, HIGH).work
    tension, expected = np.empty(8), np.empty(8)
    assert entry(calls.PATTERN, work, WRENCH, tension) == 0
    assert calls.solve_into_entry(calls.PATTERN, work, WRENCH, expected) == 0
    np.testing.assert_array_equal(tension, expected)
    for wrong in (WRENCH.astype(">f8"), None, WRENCH[:5], np.ma.array(WRENCH), WRENCH[::-1]):
        assert entry(calls.PATTERN, work, wrong, tension) > 1
