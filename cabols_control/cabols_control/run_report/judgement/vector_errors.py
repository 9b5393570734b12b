# SPDX-License-Identifier: Apache-2.0
"""Sizes of errors of force and torque vectors, for reports and the page."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cabols_control.checks import BoolArray, FloatArray

IDLE = 1e-9
"""Command below which an axis counts as idle: it is commanded to zero [N, N m]."""
KINDS = (("force_n", slice(0, 3)), ("torque_nm", slice(3, 6)))
"""Parts of a wrench, and where they are in it."""


class Sizes(NamedTuple):
    """Of errors: rms over the samples, 95th percentile, largest; NaN of none."""

    rms: float
    p95: float
    largest: float


def lengths(error: FloatArray) -> FloatArray:
    """(k,) lengths of (k, 3) errors."""
    return np.asarray(np.linalg.norm(error, axis=1))


def lengths_where(error: FloatArray, chosen: BoolArray) -> FloatArray:
    """Lengths of errors in the chosen axes alone, of the samples that have one.

    Args:
        error: (k, 3) errors.
        chosen: (k, 3) axes that count.
    """
    return lengths(np.where(chosen, error, 0.0)[chosen.any(axis=1)])


def rms(error: FloatArray) -> float:
    """Root of the mean square; NaN of none."""
    return float(np.sqrt(np.mean(error**2))) if error.size else float("nan")


def sizes(error: FloatArray) -> Sizes:
    """Reduce (k,) errors."""
    if not error.size:
        return Sizes(np.nan, np.nan, np.nan)
    size = np.abs(error)
    return Sizes(rms(size), float(np.percentile(size, 95.0)), float(size.max()))
