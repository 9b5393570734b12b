# SPDX-License-Identifier: Apache-2.0
"""Common parts of both registrations: Kabsch's rotation, and Gauss-Newton with covariance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.checks import FloatArray, finite_array
from cabols_control.errors import CabolsError, ShapeError

MAX_CONDITION = 1e7
"""Largest condition number of the scaled, whitened Jacobian; beyond it the data leave an unknown
undetermined."""

State = TypeVar("State")


class RegistrationError(CabolsError):
    """The measured points do not determine the unknowns."""


def kabsch(source: FloatArray, target: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Translation (3,) and rotation (3, 3) with target = t + R source, unweighted least squares.

    Kabsch, Acta Cryst. A32 (1976) 922. Shapes (n, 3), unchecked; never a reflection.

    Args:
        source: (n, 3) points [m].
        target: (n, 3) the same points after the motion [m].
    """
    centre_source, centre_target = source.mean(axis=0), target.mean(axis=0)
    found, _ = Rotation.align_vectors(target - centre_target, source - centre_source)
    rotation = np.asarray(found.as_matrix())
    return centre_target - rotation @ centre_source, rotation


def turned(rotation: FloatArray, vector: FloatArray) -> FloatArray:
    """exp([vector]x) R: the left perturbation of a rotation by a rotation vector [rad].

    Args:
        rotation: (3, 3).
        vector: (3,) rotation vector [rad].
    """
    return np.asarray(Rotation.from_rotvec(vector).as_matrix() @ rotation)


def whitener(name: str, covariance: FloatArray) -> FloatArray:
    """(..., n, n) matrices W with W^T W the inverse of covariances (..., n, n).

    Args:
        name: what the caller calls them, for the message.
        covariance: (..., n, n).

    Raises:
        ShapeError: if a covariance is not symmetric or not positive definite.
    """
    size = np.abs(covariance).max(axis=(-2, -1))
    skewed = np.abs(covariance - np.swapaxes(covariance, -2, -1)).max(axis=(-2, -1))
    if not (skewed <= 1e-6 * size).all():
        raise ShapeError(f"{name}: expected symmetric matrices, got {covariance.tolist()}")
    try:
        return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))
    except np.linalg.LinAlgError as error:
        raise ShapeError(
            f"{name}: expected positive definite matrices [m^2], got eigenvalues "
            f"{np.linalg.eigvalsh(covariance).tolist()}"
        ) from error


def require_spread(name: str, points: FloatArray) -> None:
    """Refuse points (n, 3) that lie on a line or in one place: they leave a rotation free.

    Args:
        name: what the caller calls them, for the message.
        points: (n, 3) [m].

    Raises:
        RegistrationError: if the second singular value of the centred points is under 1 % of
            the first, or the first under 1 mm.
    """
    finite_array(name, points, (None, 3))
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if not (spread[0] >= 1e-3 and spread[1] >= 0.01 * spread[0]):
        raise RegistrationError(
            f"{name}: expected three or more points that are not on one line, got a spread of "
            f"{spread[0]:.3g} m along and {spread[1]:.3g} m across it; move one off the line"
        )


def sees_mirror(points: FloatArray) -> bool:
    """Whether points (n, 3) [m] tell a body from its mirror image: whether they fill space."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(points.shape[0] > 3 and spread.min() > 0.01 * spread.max())


def step_in(residuals: FloatArray) -> str:
    """Say after which pose the residuals (k, n, 3) step, if they do: the tracker was moved."""
    means = np.array([np.nanmean(pose, axis=0) for pose in residuals if np.isfinite(pose).any()])
    found, largest, size = 0, 0.0, 0.0
    for cut in range(2, len(means) - 1):
        before, after = means[:cut], means[cut:]
        step = after.mean(axis=0) - before.mean(axis=0)
        left = np.sum((before - before.mean(axis=0)) ** 2) + np.sum(
            (after - after.mean(axis=0)) ** 2
        )
        share = float(step @ step) * cut * (len(means) - cut) / len(means) / max(left, 1e-30)
        if share > largest:
            found, largest, size = cut, share, float(np.linalg.norm(step))
    # The step explains more than what it leaves.
    if largest <= 1.0:
        return ""
    return (
        f", as if the tracker had been moved by some {1e3 * size:.2g} mm after {found} of "
        f"{len(means)} poses"
    )


@dataclass(frozen=True, eq=False)
class Fit(Generic[State]):
    """Result of gauss_newton: state, covariance (p, p), chi_square, iterations, converged."""

    state: State
    covariance: FloatArray
    chi_square: float
    iterations: int
    converged: bool


def gauss_newton(
    state: State,
    linearise: Callable[[State], tuple[FloatArray, FloatArray]],
    retract: Callable[[State, FloatArray], State],
    undetermined: str,
    limit: int = 50,
) -> Fit[State]:
    """Minimise the sum of squares of whitened residuals; at most `limit` steps.

    Args:
        state: start.
        linearise: state -> whitened residuals (m,) and their Jacobian (m, p).
        retract: state and step (p,) -> state.
        undetermined: message if the data leave an unknown free.
        limit: of the number of steps.

    Returns:
        The fit; its covariance is (J^T J)^-1 at the solution.

    Raises:
        RegistrationError: if an unknown is not determined.
    """
    converged = False
    iterations = 0
    while True:
        residual, jacobian = linearise(state)
        scale = np.linalg.norm(jacobian, axis=0)
        scale[~(scale > 0.0)] = 1.0
        left, singular, right = np.linalg.svd(jacobian / scale, full_matrices=False)
        if not singular[-1] * MAX_CONDITION >= singular[0]:
            raise RegistrationError(
                f"{undetermined} (condition {singular[0] / max(singular[-1], 1e-300):.2g})"
            )
        if converged or iterations == limit:
            break
        step = -(right.T @ ((left.T @ residual) / singular))
        state = retract(state, step / scale)
        iterations += 1
        # step is in standard deviations, or close to it: a thousandth no longer matters, and
        # the covariance is taken at the new state.
        converged = bool(np.linalg.norm(step) <= 1e-6)
    inverse = right.T / singular
    covariance = (inverse @ inverse.T) / np.outer(scale, scale)
    return Fit(state, covariance, float(residual @ residual), iterations, converged)
