# SPDX-License-Identifier: Apache-2.0
"""`distribute` on its compiled way: the same answers and refusals as where arrays are converted."""

from __future__ import annotations

import numpy as np
import pytest

from cabols_control.errors import CabolsError
from cabols_control.tension import DEFAULT_WEIGHTS, TensionResolver, distribute
from tension_cases import HIGH, LOW, random_rig

WEIGHTS = np.array(DEFAULT_WEIGHTS)


def slowly(A, wrench, low, high, **more):
    """As lists, which the compiled entry does not take."""
    lists = [np.asarray(value).tolist() for value in (A, wrench)]
    return distribute(*lists, low, high, **more)


def alike(found, other):
    np.testing.assert_allclose(found.tension, other.tension, atol=1e-7)
    np.testing.assert_allclose(found.residual, other.residual, atol=1e-6)
    assert found.feasible == other.feasible
    assert found.method == other.method
    assert found.loss == pytest.approx(other.loss, abs=1e-6)


@pytest.mark.parametrize("n", [6, 7, 8, 10])
@pytest.mark.parametrize("exact", [False, True])
def test_both_ways_agree(n, exact):
    rng = np.random.default_rng(n)
    for k in range(40):
        A = random_rig(rng, n)
        wrench = A @ rng.uniform(LOW, HIGH, n) * rng.choice([1.0, 3.0])
        low, high = (LOW, HIGH) if k % 2 else (np.full(n, LOW), np.full(n, HIGH))
        alike(
            distribute(A, wrench, low, high, exact=exact),
            slowly(A, wrench, low, high, exact=exact),
        )


def spoilt(A, wrench):
    """Arguments that must be refused, by what is wrong with them."""
    nan, infinite, turned = A.copy(), A.copy(), np.ascontiguousarray(A.T)
    nan[2, 3], infinite[5, 7] = np.nan, np.inf
    bad = wrench.copy()
    bad[4] = np.nan
    return {
        "nan in A": (nan, wrench, LOW, HIGH),
        "inf in A": (infinite, wrench, LOW, HIGH),
        "A turned": (turned, wrench, LOW, HIGH),
        "five cables": (np.ascontiguousarray(A[:, :5]), wrench, LOW, HIGH),
        "nan in the wrench": (A, bad, LOW, HIGH),
        "a large wrench": (A, wrench + 1e99, LOW, HIGH),
        "a short wrench": (A, wrench[:5], LOW, HIGH),
        "limits in the wrong order": (A, wrench, HIGH, LOW),
        "one limit in the wrong order": (A, wrench, np.full(8, LOW), np.r_[np.full(7, HIGH), 0.5]),
        "nan as a limit": (A, wrench, LOW, float("nan")),
        "inf as a limit": (A, wrench, LOW, float("inf")),
        "limits of seven cables": (A, wrench, np.full(7, LOW), np.full(8, HIGH)),
        "a masked wrench": (A, np.ma.array(wrench, mask=[1, 0, 0, 0, 0, 0]), LOW, HIGH),
        "complex": (A.astype(complex), wrench, LOW, HIGH),
    }


RIG = random_rig(np.random.default_rng(1), 8)
WRENCH = RIG @ np.linspace(20.0, 60.0, 8)


@pytest.mark.parametrize("kind", sorted(spoilt(RIG, WRENCH)))
def test_what_is_wrong_is_refused_with_a_reason(kind):
    with pytest.raises(CabolsError, match="expected"):
        distribute(*spoilt(RIG, WRENCH)[kind])


def test_other_forms_of_arrays_give_the_same():
    reference = distribute(RIG, WRENCH, LOW, HIGH)
    wide = np.zeros((6, 16))
    wide[:, ::2] = RIG
    forms = [
        (RIG.astype(">f8"), WRENCH.astype(">f8")),
        (np.asfortranarray(RIG), WRENCH),
        (wide[:, ::2], np.repeat(WRENCH, 2)[::2]),
        (RIG.tolist(), tuple(WRENCH)),
        (RIG.view(np.ma.MaskedArray), WRENCH.view(np.ma.MaskedArray)),
        (RIG, WRENCH.astype(object)),
    ]
    read_only = RIG.copy()
    read_only.flags.writeable = False
    forms.append((read_only, WRENCH))
    for A, wrench in forms:
        alike(distribute(A, wrench, LOW, HIGH), reference)
    for low, high in ((1, 150), (np.float64(LOW), np.full(8, HIGH)), (np.full(8, LOW), HIGH)):
        alike(distribute(RIG, WRENCH, low, high), reference)


def test_beyond_the_boundary_the_conditions_of_the_penalty_hold():
    """t = clip(B^T lambda), lambda = (v - B t) / e, e = |v - B t| / rho: enough for the least."""
    rng = np.random.default_rng(3)
    rho, beyond = 100.0 * HIGH, 0
    for _ in range(150):
        A = random_rig(rng, 8)
        wrench = A @ rng.uniform(LOW, HIGH, 8) + 60.0 * rng.standard_normal(6) / WEIGHTS
        found = TensionResolver(A, LOW, HIGH).solve(wrench)
        missed = -WEIGHTS * found.residual
        length = np.linalg.norm(missed)
        if found.feasible or length < 1e-3:
            continue
        beyond += 1
        pull = (WEIGHTS[:, None] * A).T @ missed * (rho / length)
        np.testing.assert_allclose(np.clip(pull, LOW, HIGH), found.tension, atol=1e-6)
    assert beyond > 40
