# SPDX-License-Identifier: Apache-2.0
"""What friction of another form, or too small to be found, may have done to the stiffness.

Friction is estimated where it is significant, in one form. Another form explains the same branches
with other compliances, and friction of a joint that is not significant still bends its curve. So
the data are fitted with friction of every form in all joints, of a size that robots have, beside
the fit as it is, and the models are averaged by their evidence: the spread of their compliances is
added to the covariance (Hoeting et al., Statistical Science 14 (1999) 382). Evidence has the price
of friction that the data would show and do not. The estimate itself stays.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cabols_control.checks import FloatArray
from cabols_stiffness.identification.elastic_observations import draw
from cabols_stiffness.identification.gauss_newton import Fitted, Model
from cabols_stiffness.identification.hysteresis import has_branches
from cabols_stiffness.identification.observations import Observations, whiten
from cabols_stiffness.model.elastic.friction import Form

TRAVELS = np.array([0.02, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6])
"""Motion after which friction is drawn, of a joint's largest deflection."""

USUAL = 0.05
"""Standard deviation of a joint's friction about none, of its largest torque in the data."""

SWEEPS = 2


@dataclass(frozen=True, eq=False)
class _Way:
    """One way in which friction may be.

    Attributes:
        chi_square: with the penalty of its friction's size.
        volume: logarithm of how much the data narrow down its friction.
        change: (p,) of the elastic parameters.
        covariance: (p, p) of them, for noise of unit size.
        joints: that have friction.
    """

    chi_square: float
    volume: float
    change: FloatArray
    covariance: FloatArray
    joints: int


def with_doubt(observations: Observations, found: Fitted, model: Model) -> Fitted:
    """Return a fit that knows how far friction may have moved its elastic parameters.

    Args:
        observations: of the robot.
        found: fit of them.
        model: of that fit.
    """
    if not has_branches(observations.samples):
        return found
    elastic = np.flatnonzero(model.estimated)[found.elastic]
    own = found.covariance[np.ix_(elastic, elastic)]
    unit = max(found.chi_square / max(found.freedom, 1), 1.0)
    ways = [_as_it_is(observations, found, unit)]
    for form in Form:
        ways += [_way(observations, found, model, form, kept, unit) for kept in (False, True)]
    criterion = np.array([way.chi_square / unit + way.volume for way in ways])
    weight = np.exp(-0.5 * (criterion - criterion.min()))
    weight = weight / weight.sum()
    added = np.zeros_like(own)
    for share, way in zip(weight, ways, strict=True):
        added += share * (way.covariance - ways[0].covariance)
        added += share * np.outer(way.change, way.change) / unit
    values, vectors = np.linalg.eigh(added)
    doubt = np.zeros_like(found.covariance)
    doubt[np.ix_(elastic, elastic)] = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return replace(found, doubt=doubt)


def _as_it_is(observations: Observations, found: Fitted, unit: float) -> _Way:
    """The fit itself, its friction among the others."""
    weights = found.use.astype(np.float64)
    rows = whiten(found.line, found.columns, observations.samples, weights)
    matrix = rows.columns[found.use].reshape(-1, found.elastic.size)
    target = rows.residual[found.use].ravel()
    base, friction = matrix[:, found.elastic], matrix[:, ~found.elastic]
    way = _solved(base, friction, target, unit, np.inf)
    return replace(way, change=np.zeros(base.shape[1]))


def _way(
    observations: Observations,
    found: Fitted,
    model: Model,
    form: Form,
    kept: bool,
    unit: float,
) -> _Way:
    """The data with friction of one form in all joints."""
    line, use = found.line, found.use
    n = found.deflection.shape[1]
    reach = np.abs(found.deflection[use]).max(axis=0, initial=0.0)
    travels = TRAVELS[:1] if form is Form.COULOMB else TRAVELS
    travel = np.maximum(travels[:, None] * reach, 1e-9)
    share = draw(observations, found.deflection, form, travel, kept)
    # In units of the joint's own largest torque, as the compliances are of their own.
    softened = -line.motion @ (line.balance.softness / found.parameters.compliance * reach)
    tried = softened[:, :, None, :] * share[:, None]
    base = found.columns[:, :, found.elastic]
    drawn = np.zeros((*base.shape[:2], 1))
    if model.friction_state is not None:
        torque = model.friction_state * found.parameters.friction
        drawn = -(line.motion @ line.balance.softness @ torque[..., None])
    parts = [base, drawn, tried.reshape(*base.shape[:2], -1)]
    rows = whiten(line, np.concatenate(parts, axis=2), observations.samples, use.astype(np.float64))
    matrix = rows.columns[use].reshape(-1, base.shape[2] + 1 + tried[0, 0].size)
    count = base.shape[2]
    target = rows.residual[use].ravel() + matrix[:, count]
    friction = matrix[:, count + 1 :].reshape(target.size, len(travels), n)
    basis, _ = np.linalg.qr(matrix[:, :count])
    apart = friction - np.einsum("rp,pfj->rfj", basis, np.einsum("rp,rfj->pfj", basis, friction))
    left = target - basis @ (basis.T @ target)
    chosen = np.full(n, len(travels) // 2)
    for _ in range(SWEEPS if len(travels) > 1 else 0):
        for j in range(n):
            beside = apart[:, np.delete(chosen, j), np.delete(np.arange(n), j)]
            chosen[j] = _most(apart[:, :, j], left, beside)
    columns = friction[:, chosen, np.arange(n)]
    way = _solved(matrix[:, :count], columns, target, unit, USUAL)
    # The travels were chosen: each is one of several that were as likely before.
    return replace(way, volume=way.volume + way.joints * float(np.log(len(travels))))


def _solved(
    base: FloatArray, friction: FloatArray, target: FloatArray, unit: float, usual: float
) -> _Way:
    """Least squares; friction that would drive a joint is left out, the worst first.

    Args:
        base: (r, p) columns of the elastic parameters, whitened.
        friction: (r, f) of friction, in units of the joints' largest torques.
        target: (r,).
        unit: variance of the residuals, in the stated noise.
        usual: deviation of the friction's prior; infinite: none but in the volume.
    """
    count = base.shape[1]
    kept = np.flatnonzero(np.linalg.norm(friction, axis=0) > 0.0)
    while True:
        both = np.hstack([base, friction[:, kept]])
        penalty = np.concatenate([np.zeros(count), np.full(kept.size, unit / usual**2)])
        gram = both.T @ both + np.diag(penalty)
        size = np.sqrt(np.maximum(np.diagonal(gram), 1e-300))
        inverse = np.linalg.pinv(gram / np.outer(size, size), rcond=1e-10, hermitian=True)
        inverse = inverse / np.outer(size, size)
        value = inverse @ (both.T @ target)
        against = value[count:]
        if np.isinf(usual) or not (against < 0.0).any():
            break
        kept = np.delete(kept, int(np.argmin(against * size[count:])))
    error = target - both @ value
    basis, _ = np.linalg.qr(base)
    apart = both[:, count:] - basis @ (basis.T @ both[:, count:])
    narrowed = np.eye(kept.size) + USUAL**2 / unit * (apart.T @ apart)
    volume = float(np.linalg.slogdet(narrowed)[1])
    chi_square = float(error @ error + np.sum(penalty * value**2))
    return _Way(chi_square, volume, value[:count], inverse[:count, :count], int(kept.size))


def _most(tried: FloatArray, target: FloatArray, beside: FloatArray) -> int:
    """Which column (r, t) explains most of a target with a positive sign, beside others."""
    basis, _ = np.linalg.qr(beside)
    rest = tried - basis @ (basis.T @ tried)
    length = np.linalg.norm(rest, axis=0)
    usable = length > 1e-6 * max(float(length.max(initial=0.0)), 1e-300)
    along = rest.T @ (target - basis @ (basis.T @ target))
    return int(np.argmax(np.where(usable, along / np.where(usable, length, 1.0), 0.0)))
