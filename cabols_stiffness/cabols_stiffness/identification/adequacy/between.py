# SPDX-License-Identifier: Apache-2.0
"""Whether one cause explains why configurations differ.

Where stiffness scatters from configuration to configuration, a cause that the model leaves out (a
parallelogram, a wrong tool point) looks like scatter, too: in each configuration by itself the
joints' stiffness takes it up. What tells them apart is prediction: with the cause, each
configuration follows from the others; scatter follows from nothing. So every configuration is held
out in turn, and the error there without and with the cause's parameters is compared.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import f as fisher

from cabols_control.checks import FloatArray, IntArray

CHANCE = 1e-3
"""Chance of a cause that is not there to predict as well as one that is named."""

SHARE = 0.8
"""Least share of what configurations differ by that a cause must predict."""

FOLDS = 30
"""Parts at most; of more configurations several are held out together."""


def predicted_share(
    columns: FloatArray,
    more: FloatArray,
    residual: FloatArray,
    configuration: IntArray,
    noise: float,
) -> tuple[float, float]:
    """Share of the held-out misfit that further columns predict, and the chance of as much.

    Args:
        columns: (r, p) of the joints, whitened.
        more: (r, m) of the cause.
        residual: (r,) whitened, at the joints' fit.
        configuration: (r,) of each row.
        noise: sum of squares that noise alone leaves.

    Returns:
        Share, 1 if the configurations follow from each other but for the noise; negative if the
        cause predicts worse. Then the probability of so large a share by chance, for as many
        configurations.
    """
    _, index = np.unique(configuration, return_inverse=True)
    part: IntArray = index.ravel() % FOLDS
    count = int(part.max(initial=0)) + 1
    before = _held_out(columns, residual, part, count) - noise
    spare = count - 2
    if spare < 1 or not before > 0.0:
        return 0.0, 1.0
    after = _held_out(np.hstack([columns, more]), residual, part, count) - noise
    share = 1.0 - after / before
    if not share > 0.0:
        return float(share), 1.0
    ratio = share / max(1.0 - share, 1e-6) * spare
    return float(share), float(fisher.sf(ratio, 1, spare))


def _held_out(columns: FloatArray, residual: FloatArray, part: IntArray, count: int) -> float:
    """Sum of squared errors at each configuration, predicted from the others.

    Less what the uncertainty of the prediction is expected to add, for noise of unit size. No
    parameter moves the data by more than ten times their whole misfit: the prior of each.
    """
    length = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    scaled = columns / length
    prior = 1e-2 * np.eye(length.size) / max(float(residual @ residual), 1.0)
    gram, target = scaled.T @ scaled + prior, scaled.T @ residual
    total = 0.0
    for each in range(count):
        here = part == each
        mine, left = scaled[here], residual[here]
        inverse = np.linalg.inv(gram - mine.T @ mine)
        error = left - mine @ (inverse @ (target - mine.T @ left))
        total += float(error @ error) - float(np.sum((mine @ inverse) * mine))
    return total
