# SPDX-License-Identifier: Apache-2.0
"""Verdict on a fit: chi-square, Cochran's Q, and a score test of each suspect."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2
from scipy.stats import f as fisher

from cabols_control.checks import FloatArray, IntArray
from cabols_stiffness.identification.adequacy.between import CHANCE, SHARE, predicted_share
from cabols_stiffness.identification.adequacy.normal import (
    CERTAIN,
    RandomEffects,
    are_different,
    blocks,
    heterogeneity,
    leave_one_out,
    random_effects,
    whitened_by_scatter,
)
from cabols_stiffness.identification.adequacy.small_mistakes import SIZES, SmallMistakes, likely
from cabols_stiffness.identification.adequacy.span import wrong_span
from cabols_stiffness.identification.adequacy.suspects import suspects
from cabols_stiffness.identification.adequacy.texts import text_of
from cabols_stiffness.identification.adequacy.wrong_data import is_reason, wrong_data
from cabols_stiffness.identification.gauss_newton import Fitted, Model
from cabols_stiffness.identification.observations import Observations, whiten
from cabols_stiffness.model.verdict import Finding, Grade, Suspect, Verdict

FALSE_ALARM = 1e-4
"""Chance of each test to name a suspect that is not there."""

TOO_LARGE = 1.25
"""Root mean square of the normalised residuals beyond which noise that is stated too small no
longer explains a certain misfit."""

UNSUSPICIOUS = 0.5
"""Probability of chi-square above which no wrong sign, unit, frame or order is looked for."""

MOST_SCATTER = 0.8
"""Standard deviation of the stiffness between configurations beyond which it is no robot's."""

TOLD = 0.05
"""Relative deviation by noise alone beyond which a joint's own scatter is not judged."""

MATTERS = 0.005
"""Relative change of a joint's stiffness below which a suspect does no harm."""

LEAST_EXPLAINED = 0.5
"""Share of the motion's sum of squares below which the data contradict the model."""

PLAUSIBLE = (1e3, 5e7)
"""Least and largest median stiffness of a robot's joints that turn [N m/rad]: from a light arm's
gears to those of a robot for a tonne."""

SATURATED = 0.45
"""Share of a joint's largest motion after which its friction must be at its full size."""

LARGE_FRICTION = 0.1
"""Share of the elastic torque that friction may take without that."""

BUNCH = 4_000_000
"""Numbers of suspects' columns that are whitened together."""

INDEPENDENT = 1e-4
"""Relative singular value below which a suspect's columns are those of the joints."""


@dataclass(frozen=True, eq=False)
class Judged:
    """A verdict, and what it makes of the covariance.

    Attributes:
        verdict: on the fit.
        between: how configurations that differ are pooled; None where they do not.
        doubt: (p, p) covariance of the relative parameters by small mistakes in the data.
    """

    verdict: Verdict
    between: RandomEffects | None
    doubt: FloatArray


def judge(observations: Observations, found: Fitted, model: Model, travel: FloatArray) -> Judged:
    """Judge a fit.

    Args:
        observations: of the robot.
        found: the fit of them.
        model: of that fit.
        travel: (n,) motion over which each joint's friction rises, 0 where there is none [rad].
    """
    n, use = found.deflection.shape[1], found.use
    rows = whiten(found.line, found.columns, observations.samples, use.astype(np.float64))
    base, residual = rows.columns[use], rows.residual[use]
    numbers: FloatArray = observations.numbers[use].astype(np.float64) - rows.shared / max(
        int(use.sum()), 1
    )
    configuration = observations.samples.configuration[use]
    parts = blocks(base, residual, numbers, configuration)
    differ = heterogeneity(parts)
    freedom = max(found.freedom, 1)
    chance = float(chi2.sf(found.chi_square, freedom))
    scattered = are_different(parts, differ)
    between = random_effects(parts, n) if scattered else None
    weigh = _weights(base, configuration, between, parts.variance)
    matrix = base.reshape(residual.size, -1)
    unit = parts.variance if scattered else found.chi_square / freedom
    small = SmallMistakes(weigh(matrix), weigh(residual.ravel()), max(unit, 1.0))
    guessed = suspects(observations, found, model.cubic)
    tried = _noted(_whitened(observations, found, guessed), small, weigh)
    freedom_left = parts.within_freedom if scattered else found.freedom
    apart = configuration if scattered else 0 * configuration
    noise = float(numbers.sum()) * parts.variance if scattered else None
    named = _named(
        base, residual, tried, (apart, configuration), max(freedom_left, 1), found, noise
    )
    doubt = small.doubt(n)
    findings = [*named, *_magnitude(found), *_friction(found, travel)]
    findings += likely(doubt, {one.suspect for one in named})
    inside = parts.variance if scattered else found.chi_square / freedom
    inside_freedom = parts.within_freedom if scattered else freedom
    unlikely = float(chi2.sf(inside * inside_freedom, inside_freedom)) < CERTAIN
    rms = float(np.sqrt(inside))
    if unlikely:
        grave = rms > TOO_LARGE and not any(one.grave for one in named)
        text = text_of(Suspect.NOISE, rms)
        findings.append(Finding(Suspect.NOISE, text, 0.0, chance, 0.0, grave))
    if between is not None:
        # A joint of which the data say little scatters by chance.
        deviation = np.sqrt(np.diagonal(found.covariance)[:n] * parts.variance)
        told = ~found.unidentifiable[:n] & (deviation <= TOLD)
        largest = float(between.scatter[told].max(initial=0.0))
        far = not largest <= MOST_SCATTER
        text = text_of(Suspect.SCATTER if far else Suspect.CONFIGURATIONS, largest)
        share = differ.q / max(found.chi_square, 1e-300)
        findings.append(
            Finding(
                Suspect.SCATTER if far else Suspect.CONFIGURATIONS,
                text,
                share,
                differ.probability,
                float(np.abs(between.change[:n]).max()),
                far,
            )
        )
    mistakes = wrong_span(observations.samples, observations.robot)
    if not chance > UNSUSPICIOUS or scattered:
        mistakes += wrong_data(observations.samples, observations.robot, found.line, scattered)
    findings += mistakes
    findings.sort(key=lambda one: (not one.grave, one.probability, -one.improvement))
    explained, by_axis, share_of_joint = _explained(base, residual, found, n)
    grade = Grade.SCATTERED if between is not None else Grade.GOOD
    if any(one.grave for one in findings):
        contradicted = not explained > LEAST_EXPLAINED
        hopeless = contradicted or any(is_reason(one) for one in mistakes)
        grade = Grade.HOPELESS if hopeless else Grade.DOUBTFUL
        between = None
    return Judged(
        Verdict(
            grade=grade,
            chi_square=found.chi_square,
            degrees_of_freedom=found.freedom,
            probability=chance,
            explained=explained,
            explained_by_axis=by_axis,
            share_of_joint=share_of_joint,
            cochran_q=differ.q,
            cochran_freedom=differ.freedom,
            cochran_probability=differ.probability,
            scatter=np.zeros(n) if between is None else between.scatter,
            leave_one_out=leave_one_out(parts, n),
            findings=tuple(findings),
        ),
        between,
        doubt.covariance,
    )


def _weights(
    base: FloatArray, configuration: IntArray, between: RandomEffects | None, variance: float
) -> Callable[[FloatArray], FloatArray]:
    """What whitens rows (k m, ...) where configurations scatter."""
    if between is None:
        return np.asarray
    n, m = between.scatter.size, base.shape[1]
    joints = base.reshape(-1, base.shape[2])[:, :n]
    size = between.scatter * (1.0 + between.change[:n]) / np.sqrt(variance)
    rows = np.repeat(configuration, m)
    places = [np.flatnonzero(rows == each) for each in np.unique(configuration)]

    def weigh(values: FloatArray) -> FloatArray:
        found = values.copy()
        for at in places:
            found[at] = whitened_by_scatter(joints[at], size, values[at])
        return found

    return weigh


def _noted(
    tried: Iterable[tuple[Suspect, FloatArray]],
    small: SmallMistakes,
    weigh: Callable[[FloatArray], FloatArray],
) -> Iterator[tuple[Suspect, FloatArray]]:
    """Each suspect on its way to the score tests, added to the small mistakes."""
    for suspect, columns in tried:
        if suspect in SIZES:
            small.add(suspect, weigh(columns.reshape(-1, columns.shape[2])))
        yield suspect, columns


def _whitened(
    observations: Observations, found: Fitted, tried: dict[Suspect, FloatArray]
) -> Iterator[tuple[Suspect, FloatArray]]:
    """Each suspect with its whitened columns (rows in use, m, p), a bounded number at a time."""
    use, weights = found.use, found.use.astype(np.float64)
    bunch: list[Suspect] = []
    for suspect in [*tried, None]:
        if suspect is not None:
            bunch.append(suspect)
            if sum(tried[one].size for one in bunch) < BUNCH:
                continue
        if bunch:
            columns = np.concatenate([tried[one] for one in bunch], axis=2)
            white = whiten(found.line, columns, observations.samples, weights).columns[use]
            ends = np.cumsum([tried[one].shape[2] for one in bunch])[:-1]
            yield from zip(bunch, np.split(white, ends, axis=2), strict=True)
        bunch = []


def _named(
    columns: FloatArray,
    residual: FloatArray,
    tried: Iterable[tuple[Suspect, FloatArray]],
    apart: tuple[IntArray, IntArray],
    freedom: int,
    found: Fitted,
    noise: float | None,
) -> list[Finding]:
    """Score tests, beside parameters of its own for each number in the first of apart (k,).

    With the noise's sum of squares also whether a suspect explains how configurations (second of
    apart) differ.
    """
    target = residual.ravel()
    base = columns.reshape(target.size, -1)
    p = base.shape[1]
    groups, configuration = (np.repeat(one, residual.shape[1]) for one in apart)
    bases = _bases(base, groups)
    rest = _across(bases, target[:, None])[:, 0]
    squares, deviation = float(rest @ rest), _deviation(base)
    results = []
    for suspect, own_columns in tried:
        matrix = own_columns.reshape(target.size, -1)
        length = np.linalg.norm(matrix, axis=0)
        matrix = matrix[:, length > 0.0] / length[length > 0.0]
        across = _across(bases, matrix)
        directions, sizes, _ = np.linalg.svd(across, full_matrices=False)
        directions = directions[:, sizes > INDEPENDENT]
        count = directions.shape[1]
        if count == 0 or freedom - count < 1:
            continue
        gain = float(np.sum((directions.T @ rest) ** 2))
        ratio = gain / count / max((squares - gain) / (freedom - count), 1e-300)
        chance = float(fisher.sf(ratio, count, freedom - count))
        between = noise is not None and not chance < FALSE_ALARM
        if noise is not None and between:
            told, chance = predicted_share(base, matrix, target, configuration, noise)
            if not (told >= SHARE and chance < CHANCE):
                continue
        elif not chance < FALSE_ALARM:
            continue
        scale = np.maximum(np.linalg.norm(base, axis=0), 1e-300)
        both = np.hstack([base / scale, matrix])
        change = np.linalg.lstsq(both, target, rcond=INDEPENDENT)[0][:p] / scale
        elastic = found.elastic
        shift = np.abs(change[elastic])
        grave = bool(((shift > MATTERS) & (shift > deviation[elastic])).any())
        # Stiffness that varies with the angle does scatter, and pooling holds that.
        grave = grave and not (between and suspect is Suspect.VARYING)
        share = gain / max(found.chi_square, 1e-300)
        text = text_of(suspect, float(shift.max()))
        results.append(Finding(suspect, text, share, chance, float(shift.max()), grave))
    return results


def _bases(base: FloatArray, apart: IntArray) -> list[tuple[IntArray, FloatArray]]:
    """Rows of each number in apart (r,), and an orthonormal basis of base (r, p) there."""
    found = []
    order = np.argsort(apart, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(apart[order])) + 1):
        own = base[rows]
        length = np.linalg.norm(own, axis=0)
        own = own[:, length > 0.0] / length[length > 0.0]
        basis, singular, _ = np.linalg.svd(own, full_matrices=False)
        found.append((rows, basis[:, singular > 1e-6 * singular[0]] if singular.size else basis))
    return found


def _across(bases: list[tuple[IntArray, FloatArray]], matrix: FloatArray) -> FloatArray:
    """What the bases leave of matrix (r, c)."""
    left = matrix.copy()
    for rows, basis in bases:
        left[rows] -= basis @ (basis.T @ matrix[rows])
    return left


def _deviation(base: FloatArray) -> FloatArray:
    """(p,) standard deviation of the parameters for noise of unit size, relative."""
    inverse = np.linalg.pinv(base.T @ base, rcond=1e-12, hermitian=True)
    return np.asarray(np.sqrt(np.maximum(np.diag(inverse), 0.0)))


def _explained(
    base: FloatArray, residual: FloatArray, found: Fitted, n: int
) -> tuple[float, FloatArray, FloatArray]:
    """Share of the motion that the model explains: in all, by axis, and each joint's part."""
    by_joint = base[:, :, :n]
    model = by_joint.sum(axis=2)
    total = float(np.sum((model + residual) ** 2))
    explained = 1.0 - float(np.sum(residual**2)) / max(total, 1e-300)
    root = np.linalg.cholesky(found.line.covariance)[found.use]
    scale = np.sqrt(np.einsum("kii->ki", found.line.covariance))[found.use]
    left = np.einsum("kij,kj->ki", root, residual) / scale
    moved = np.einsum("kij,kj->ki", root, model) / scale
    by_axis = 1.0 - np.sum(left**2, axis=0) / np.maximum(
        np.sum((left + moved) ** 2, axis=0), 1e-300
    )
    share = np.einsum("kmj,km->j", by_joint, model) / max(float(np.sum(model**2)), 1e-300)
    return explained, np.asarray(by_axis), np.asarray(share)


def _friction(found: Fitted, travel: FloatArray) -> list[Finding]:
    """Friction that rises over most of a joint's motion: nothing tells it from stiffness."""
    motion = np.maximum(np.abs(found.deflection[found.use]).max(axis=0, initial=0.0), 1e-12)
    share = np.abs(found.parameters.friction) * found.parameters.compliance / motion
    mixed = (travel > SATURATED * motion) & (share > LARGE_FRICTION)
    if not mixed.any():
        return []
    largest = float(share[mixed].max())
    text = text_of(Suspect.FRICTION, largest)
    return [Finding(Suspect.FRICTION, text, 0.0, 0.0, largest, True)]


def _magnitude(found: Fitted) -> list[Finding]:
    stiffness = 1.0 / found.parameters.compliance
    return wrong_magnitude(stiffness[~found.unidentifiable[: stiffness.size]])


def wrong_magnitude(stiffness: FloatArray) -> list[Finding]:
    """One finding if no robot has the median of such stiffness, else none.

    Args:
        stiffness: of the joints that are known [N m/rad].
    """
    middle = float(np.median(stiffness)) if stiffness.size else PLAUSIBLE[0]
    least, largest = PLAUSIBLE
    if least <= middle <= largest:
        return []
    text = text_of(Suspect.MAGNITUDE, middle)
    return [Finding(Suspect.MAGNITUDE, text, 0.0, 0.0, 0.0, True)]
