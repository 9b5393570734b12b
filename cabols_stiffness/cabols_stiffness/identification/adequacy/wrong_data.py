# SPDX-License-Identifier: Apache-2.0
"""What a table may have wrong as a whole: a sign, a unit, axes, the order of joints.

Each mistake of trials.py is tried: compliances (none negative) are fitted to the undeflected arm's
statics with it, and the misfit is compared with that of the data as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from scipy.optimize import nnls
from scipy.stats import norm

from cabols_control.checks import FloatArray
from cabols_stiffness.identification.adequacy.trials import Data, Statics, Trial
from cabols_stiffness.identification.observations import (
    Linearised,
    Observations,
    Partial,
    whiten,
)
from cabols_stiffness.measurements.samples import PointSamples, select
from cabols_stiffness.model.balance import Law
from cabols_stiffness.model.robot import RobotModel
from cabols_stiffness.model.verdict import Finding, Suspect

BETTER = 16.0
"""Least decrease of chi-square, in units of what the mistake leaves for each number. Two models
that are no part of each other and of which the first is right differ by so much with a probability
of 3e-5 at most, however little they differ."""

LIKELIER = 6.0
"""Least decrease of the deviance where configurations differ: their scatter, not the noise, then
says what is chance."""

EFFECTS = 2
"""Joints whose scatter makes up most of the misfit: it counts as so many independent numbers for
each configuration."""

LEAST_GAIN = 0.7
"""Share of the excess misfit that a mistake explains if it is the reason; with less it is named
as a suspicion beside others."""

MOST = 3
"""Mistakes that are named, best first."""

NUMBERS = 3_000_000
"""Of an array of columns that are whitened together."""

MOST_SAMPLES = 1000
"""Samples on which mistakes are tried; of more, whole groups are drawn."""


@dataclass(frozen=True)
class Tried:
    """Misfit with a mistake.

    Attributes:
        suspect: what kind of it.
        text: for people.
        gain: share of the excess misfit that it explains.
        better: decrease of chi-square, in units of what is left for each number.
        likelier: decrease of the deviance if the misfit is of the configurations' scatter.
    """

    suspect: Suspect
    text: str
    gain: float
    better: float
    likelier: float


def wrong_data(
    samples: Data, robot: RobotModel, line: Linearised | None = None, scattered: bool = False
) -> list[Finding]:
    """Mistakes with which the data fit beyond doubt better, best first.

    Args:
        samples: as given.
        robot: with its tool.
        line: a fit's, whose weights are used; None: the measurement's noise alone.
        scattered: whether configurations differ beyond doubt.
    """
    tried = try_mistakes(samples, robot, line)
    most = tried[0].gain if tried else 0.0
    return [
        Finding(
            suspect=one.suspect,
            text=f"{one.text}: so changed, the data lose {100.0 * one.gain:.1f} % of their misfit",
            improvement=one.gain,
            probability=0.0 if is_reason(one) else float(norm.sf(np.sqrt(one.better))),
            shift=float("inf"),
            grave=True,
        )
        for one in tried[:MOST]
        if one.better >= BETTER
        and (one.likelier >= LIKELIER or not scattered)
        and 1.0 - one.gain <= 4.0 * (1.0 - most) + 0.02
    ]


def is_reason(one: Tried | Finding) -> bool:
    """Whether a mistake explains the misfit, and not only some of it.

    Args:
        one: of the mistakes.
    """
    gain = one.gain if isinstance(one, Tried) else one.improvement
    return gain >= LEAST_GAIN


def try_mistakes(samples: Data, robot: RobotModel, line: Linearised | None = None) -> list[Tried]:
    """Every mistake with its gain, best first.

    Args:
        samples: as wrong_data.
        robot: as wrong_data.
        line: as wrong_data.
    """
    n = robot.n
    if line is None:
        line = Observations(samples, robot).linearise(Law(np.full(n, 1e12), np.zeros(n)))
    samples, line = _drawn(samples, line)
    statics = Statics(samples, robot)
    (before,), numbers = _misfits([statics.right()], samples, line)
    count = max(1, NUMBERS // max(line.residual.size * (n + 1), 1))
    effects = EFFECTS * max(np.unique(samples.configuration).size - 1, 1)
    found: list[Tried] = []
    trials = statics.trials()
    while some := list(islice(trials, count)):
        misfits, _ = _misfits(some, samples, line)
        for trial, after in zip(some, misfits, strict=True):
            less = before - after
            gain = less / max(before - numbers, less, 1e-300)
            better = less / max(1.0, after / max(numbers, 1.0))
            likelier = effects * np.log(max(before, 1e-300) / max(after, 1e-300))
            found.append(Tried(trial.suspect, trial.text, gain, better, float(likelier)))
    found.sort(key=lambda one: -one.better)
    return found


def _drawn(samples: Data, line: Linearised) -> tuple[Data, Linearised]:
    """At most about MOST_SAMPLES, in whole groups."""
    if len(samples) <= MOST_SAMPLES:
        return samples, line
    group = samples.group if isinstance(samples, PointSamples) else np.arange(len(samples))
    names, index, sizes = np.unique(group, return_inverse=True, return_counts=True)
    order = np.random.default_rng(0).permutation(names.size)
    taken = np.cumsum(sizes[order]) <= MOST_SAMPLES
    taken[0] = True
    chosen = np.zeros(names.size, dtype=np.bool_)
    chosen[order[taken]] = True
    rows = np.flatnonzero(chosen[index.ravel()])[: 4 * MOST_SAMPLES]
    partial = line.partial
    if partial is not None:
        partial = Partial(partial.basis[rows], partial.seen[rows])
    part = replace(
        line,
        residual=line.residual[rows],
        motion=line.motion[rows],
        covariance=line.covariance[rows],
        partial=partial,
    )
    if isinstance(samples, PointSamples):
        return select(samples, rows), part
    return select(samples, rows), part


def _misfits(trials: Sequence[Trial], samples: Data, line: Linearised) -> tuple[list[float], float]:
    """Chi-square of each trial's best fit, and how much noise alone would leave."""
    value = samples.position if isinstance(samples, PointSamples) else samples.deflection
    parts = [
        np.concatenate([(value - one.predicted)[..., None], one.columns], axis=2) for one in trials
    ]
    stacked = np.nan_to_num(np.concatenate(parts, axis=2))
    rows = whiten(line, stacked, samples, np.ones(len(samples)))
    width = parts[0].shape[2]
    matrix = rows.columns.reshape(-1, len(parts), width).swapaxes(0, 1)
    misfits = [_misfit(one) for one in np.linalg.qr(matrix, mode="r")]
    measured = int((np.abs(rows.residual) > 0.0).sum())
    return misfits, float(measured - rows.shared - (width - 1))


def _misfit(triangle: FloatArray) -> float:
    """Least squares without negative compliance, of the triangle (n + 1, n + 1)."""
    (target,), matrix = triangle[:, :1].T, triangle[:, 1:]
    length = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    _, left = nnls(matrix / length, target)
    return float(left) ** 2
