# SPDX-License-Identifier: Apache-2.0
"""Compliance that varies smoothly over the workspace: features of the joints' positions.

A Gaussian process over the configurations (kriging; Rasmussen and Williams, Gaussian Processes for
Machine Learning, 2006, chapter 2) in the basis of its kernel's largest eigenvectors. Features have
mean zero over the configurations that were measured, so that a joint's own compliance stays the
mean over those.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from cabols_control.checks import BoolArray, FloatArray

FEATURES_MAX = 12
"""Of one joint."""

SMALLEST = 1e-3
"""Eigenvalue below which a feature is left out, of the largest."""


class Over(StrEnum):
    """What a joint's compliance varies over."""

    OWN = "own"
    """Its own position."""
    EACH = "each"
    """The positions of all joints, as a sum over them."""
    ALL = "all"
    """The positions of all joints together."""


@dataclass(frozen=True, eq=False)
class Variation:
    """Features of n joints; the weights of the kernel's eigenvectors are parameters.

    Attributes:
        over: see Over.
        length: over which the compliance varies [rad, m].
        slides: (n,) joints that slide.
        centres: (c, n) configurations that were measured [rad, m].
        projection: for each joint, (c, r) from the kernel's row to its r features.
        middle: for each joint, (r,) mean of the features over the centres.
    """

    over: Over
    length: float
    slides: BoolArray
    centres: FloatArray
    projection: tuple[FloatArray, ...]
    middle: tuple[FloatArray, ...]

    def features(self, joints: FloatArray) -> list[FloatArray]:
        """(k, r) features of each joint, at (k, n) positions [rad, m]."""
        # Many samples are of few configurations.
        places, index = np.unique(joints, axis=0, return_inverse=True)
        rows = kernels(self.over, self.length, self.slides, places, self.centres)
        return [
            (row @ projection - middle)[index.ravel()]
            for row, projection, middle in zip(rows, self.projection, self.middle, strict=True)
        ]


def variation(over: Over, length: float, slides: BoolArray, centres: FloatArray) -> Variation:
    """Make the features of measured configurations.

    Args:
        over: what compliance varies over.
        length: over which it does [rad, m].
        slides: (n,) joints that slide.
        centres: (c, n) configurations [rad, m].
    """
    projection, middle = [], []
    for matrix in kernels(over, length, slides, centres, centres):
        values, vectors = np.linalg.eigh(matrix)
        values, vectors = values[::-1], vectors[:, ::-1]
        kept = min(int((values > SMALLEST * values[0]).sum()), FEATURES_MAX)
        root = np.sqrt(values[:kept])
        projection.append(vectors[:, :kept] / root)
        middle.append((vectors[:, :kept] * root).mean(axis=0))
    return Variation(over, length, slides, centres, tuple(projection), tuple(middle))


def kernels(
    over: Over, length: float, slides: BoolArray, one: FloatArray, other: FloatArray
) -> list[FloatArray]:
    """(k, c) covariance of each joint's variation between (k, n) and (c, n) positions.

    Args:
        over: what compliance varies over.
        length: over which it does [rad, m].
        slides: (n,) joints that slide; the others come round after a turn.
        one: (k, n) [rad, m].
        other: (c, n) [rad, m].
    """
    apart = one[:, None, :] - other[None]
    apart = np.where(slides, apart, 2.0 * np.sin(0.5 * apart)) / length
    near = np.exp(-0.5 * apart**2)
    if over is Over.OWN:
        return [near[:, :, j] for j in range(one.shape[1])]
    common = near.mean(axis=2) if over is Over.EACH else near.prod(axis=2)
    return [common] * one.shape[1]
