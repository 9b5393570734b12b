# SPDX-License-Identifier: Apache-2.0
"""Outliers where the stiffness differs between configurations.

A sample of a configuration that is stiffer than the others lies as far from the pooled model as a
gross error does, and must not be left out for it. Its distance is therefore taken with the scatter
between configurations beside its noise (the marginal residual of a mixed model; Laird and Ware,
Biometrics 38 (1982) 963).
"""

from __future__ import annotations

import numpy as np

from cabols_control.checks import BoolArray, FloatArray
from cabols_stiffness.identification.adequacy.normal import (
    LEAST_MEAN,
    Blocks,
    are_different,
    blocks,
    heterogeneity,
    random_effects,
)
from cabols_stiffness.identification.gauss_newton import (
    Fitted,
    Model,
    OutliersError,
    Parameters,
    fit,
    inliers,
    too_many,
)
from cabols_stiffness.identification.observations import Observations, Whitened, whiten

MOST_SCATTER = 0.35
"""Standard deviation between configurations that a sample is allowed."""

MOST_VARIANCE = 1.5
"""Of the residuals within configurations, in units of the stated noise, beyond which scatter does
not explain the misfit."""

MANY = 0.1
"""Share of the loaded samples up to which outliers may be anywhere."""

MOST_OF_ONE = 0.5
"""Share of a configuration's loaded samples beyond which they are no gross errors, if many."""


def fit_without_outliers(observations: Observations, model: Model, start: Parameters) -> Fitted:
    """Fit; samples are outliers only if the scatter between configurations does not explain them.

    Args:
        observations: as fit.
        model: as fit.
        start: as fit.

    Raises:
        IdentificationError: as fit.
    """
    refused: OutliersError | None = None
    found: Fitted | None = None
    try:
        found = fit(observations, model, start)
    except OutliersError as error:
        refused = error
    if found is not None and found.use.all():
        return found
    other = _scattered(observations, model, start)
    if other is not None and (found is None or other.use.sum() > found.use.sum()):
        found = other
    if found is None:
        assert refused is not None
        raise refused
    if _are_concentrated(observations, found.use):
        return fit(observations, model, start, robust=False)
    return found


def _are_concentrated(observations: Observations, use: BoolArray) -> bool:
    """Whether what is left out is many, and most of some configuration: a misfit, no gross errors.

    Without it the model would be judged by the configurations that it happens to fit.
    """
    samples = observations.samples
    loaded = (samples.wrench != 0.0).any(axis=1)
    left_out = loaded & ~use
    if not left_out.sum() > MANY * loaded.sum():
        return False
    _, index = np.unique(samples.configuration, return_inverse=True)
    lost = np.bincount(index.ravel(), left_out)
    return bool((lost > MOST_OF_ONE * np.bincount(index.ravel(), loaded)).any())


def _scattered(observations: Observations, model: Model, start: Parameters) -> Fitted | None:
    """Fit with the samples that scatter explains; None where it does not explain the misfit."""
    whole = fit(observations, model, start, robust=False)
    rows, parts = _parts(observations, whole)
    if not are_different(parts, heterogeneity(parts)):
        return None
    n = whole.deflection.shape[1]
    pooled = random_effects(parts, n)
    mean = np.maximum(1.0 + pooled.change, LEAST_MEAN)
    own = rows.columns[:, :, :n] * (np.minimum(pooled.scatter, MOST_SCATTER) * mean[:n])
    residual = rows.residual - rows.columns @ pooled.change
    spread = own @ own.swapaxes(1, 2) + np.eye(own.shape[1])
    weighted = np.linalg.solve(spread, residual[..., None])[..., 0]
    use: BoolArray = inliers(np.sum(residual * weighted, axis=1), observations.numbers)
    if too_many(observations, use):
        return None
    found = fit(observations, model, whole.parameters, robust=False, use=use)
    return found if _parts(observations, found)[1].variance <= MOST_VARIANCE else None


def _parts(observations: Observations, found: Fitted) -> tuple[Whitened, Blocks]:
    use = found.use
    rows = whiten(found.line, found.columns, observations.samples, use.astype(np.float64))
    measured: FloatArray = observations.numbers[use].astype(np.float64)
    numbers = measured - rows.shared / max(int(use.sum()), 1)
    configuration = observations.samples.configuration[use]
    return rows, blocks(rows.columns[use], rows.residual[use], numbers, configuration)
