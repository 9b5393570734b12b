# SPDX-License-Identifier: Apache-2.0
"""What small mistakes in the data, too small to be seen for certain, may have done to a stiffness.

A tool point that is 5 mm off, axes turned by 2 deg, a gain that is wrong by 3 % move a stiffness by
more than its deviation long before a test can name them without naming what is not there. So each
kind is estimated as parameters with a normal prior about none, in two sizes, and these models are
averaged with the one without mistakes by their evidence: the spread of what they make of the
compliances is added to the covariance (Hoeting et al., Statistical Science 14 (1999) 382), as far
as the data make a mistake likelier than it was before them. The estimate itself stays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabols_control.checks import FloatArray
from cabols_stiffness.identification.adequacy.texts import text_of
from cabols_stiffness.model.verdict import Finding, Suspect

_DEGREE = np.pi / 180.0
SIZES: dict[Suspect, tuple[float, ...]] = {
    Suspect.TOOL_POINT: (2e-3, 5e-3),
    Suspect.WRENCH_POINT: (2e-3, 5e-3),
    Suspect.BASE_FRAME: (0.5 * _DEGREE, 1.5 * _DEGREE),
    Suspect.WRENCH_FRAME: (0.5 * _DEGREE, 1.5 * _DEGREE),
    Suspect.WRENCH_GAIN: (0.01, 0.025),
    Suspect.WRENCH_BIAS: (0.01, 0.025),
    Suspect.WEIGHT: (0.01, 0.025),
    Suspect.JOINT_ZERO: (0.5 * _DEGREE, 1.5 * _DEGREE),
}
"""Standard deviations of each kind's parameters [m, rad]; gains relative; bias, weight: of the
largest force and torque."""

NONE = 0.5
"""Probability of no mistake before the data are seen; the kinds and sizes share the rest."""

INDEPENDENT = 1e-6
"""Relative singular value below which columns are one."""

TOLD = 0.5
"""Probability of one kind from which on it is told."""


@dataclass(frozen=True, eq=False)
class Doubt:
    """About a fit's parameters.

    Attributes:
        covariance: (p, p) of the relative parameters, beside that of the noise.
        probability: of each kind of mistake.
        shift: likely change of a joint's compliance by it, relative: the largest.
    """

    covariance: FloatArray
    probability: dict[Suspect, float]
    shift: dict[Suspect, float]


def likely(doubt: Doubt, named: set[Suspect]) -> list[Finding]:
    """Kinds that are likely and not named already, as findings that the deviations hold.

    Args:
        doubt: about the fit.
        named: suspects that a test has found.
    """
    return [
        Finding(
            suspect=suspect,
            text=f"{text_of(suspect, doubt.shift[suspect])}; not certain: the deviations hold it",
            improvement=0.0,
            probability=1.0 - probability,
            shift=doubt.shift[suspect],
            grave=False,
        )
        for suspect, probability in doubt.probability.items()
        if probability > TOLD and suspect not in named
    ]


class SmallMistakes:
    """An average over what may be wrong; kinds are added one by one."""

    def __init__(self, base: FloatArray, target: FloatArray, variance: float) -> None:
        """Take a fit.

        Args:
            base: (r, p) columns of the relative parameters, whitened.
            target: (r,) residual at the fit, whitened.
            variance: of the residuals.
        """
        size = np.maximum(np.linalg.norm(base, axis=0), 1e-300)
        directions, singular, right = np.linalg.svd(base / size, full_matrices=False)
        known = singular > INDEPENDENT * float(singular.max(initial=0.0))
        self._directions = directions[:, known]
        self._back = (right[known].T / singular[known]) / size[:, None]
        self._rest = target - self._directions @ (self._directions.T @ target)
        self._variance = max(variance, 1e-300)
        self._models: list[_Model] = []

    def add(self, suspect: Suspect, columns: FloatArray) -> None:
        """Add a kind of mistake, if it is one of SIZES.

        Args:
            suspect: which.
            columns: (r, m) of its parameters [m, rad, 1], whitened.
        """
        if suspect is Suspect.WRENCH_GAIN:
            # Without what all gains have in common: no misfit sees it, and it is stated apart.
            columns = columns @ _contrasts(columns.shape[1])
        own = self._directions.T @ columns
        across = columns - self._directions @ own
        left, length, turned = np.linalg.svd(across, full_matrices=False)
        along, lead = left.T @ self._rest, self._back @ own
        beyond = np.eye(turned.shape[1]) - turned.T @ turned
        for deviation in SIZES.get(suspect, ()):
            square = (deviation * length) ** 2 / self._variance
            gain = float(np.sum(along**2 * square / (1.0 + square))) / self._variance
            volume = float(np.sum(np.log1p(square)))
            # Posterior of the mistake's parameters, and where it leads the others.
            narrowed = deviation**2 / (1.0 + square)
            mean = turned.T @ (narrowed * length / self._variance * along)
            inside = (turned.T * narrowed) @ turned + deviation**2 * beyond
            self._models.append(
                _Model(suspect, 0.5 * (gain - volume), -lead @ mean, lead @ inside @ lead.T)
            )

    def doubt(self, joints: int) -> Doubt:
        """Average over all that was added, and over no mistake.

        Args:
            joints: number n; their compliances are the first parameters.
        """
        models, p = self._models, self._back.shape[0]
        covariance = np.zeros((p, p))
        probability: dict[Suspect, float] = {}
        shift: dict[Suspect, float] = {}
        prior = np.log((1.0 - NONE) / max(len(models), 1))
        evidence = np.array([np.log(NONE), *(prior + one.evidence for one in models)])
        weight = np.exp(evidence - evidence.max())
        for share, one in zip(weight[1:] / weight.sum(), models, strict=True):
            # What the data make no likelier than it was says nothing of them: a statement of the
            # instruments does.
            more = max(share - float(np.exp(prior)), 0.0)
            covariance += more * (np.outer(one.change, one.change) + one.spread)
            probability[one.suspect] = probability.get(one.suspect, 0.0) + float(share)
            largest = float(np.abs(one.change[:joints]).max(initial=0.0))
            shift[one.suspect] = max(shift.get(one.suspect, 0.0), largest)
        return Doubt(covariance, probability, shift)


def _contrasts(count: int) -> FloatArray:
    """(count, count - 1) orthonormal directions without a common part."""
    return np.asarray(np.linalg.qr(np.eye(count) - 1.0 / count)[0][:, : count - 1])


@dataclass(frozen=True, eq=False)
class _Model:
    """One kind in one size: what it makes of the parameters.

    Attributes:
        suspect: which kind.
        evidence: logarithm of its likelihood over that of no mistake.
        change: (p,) of the parameters.
        spread: (p, p) by what is left unknown of the mistake.
    """

    suspect: Suspect
    evidence: float
    change: FloatArray
    spread: FloatArray
