# SPDX-License-Identifier: Apache-2.0
"""Rows that an identification can use: measured, not repeated, with a sensor that has noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabols_control.checks import IntArray
from cabols_control.errors import CabolsError
from cabols_stiffness.measurements.samples import PointSamples, Samples, select


@dataclass(frozen=True, eq=False)
class Usable:
    """What is left of a table.

    Attributes:
        samples: the rows to use.
        rows: (k,) their indices in the table.
        missing: rows left out that hold no number.
        repeated: rows left out that repeat an earlier one, number for number.
    """

    samples: PointSamples | Samples
    rows: IntArray
    missing: int
    repeated: int


def usable_rows(samples: PointSamples | Samples) -> Usable:
    """Leave out rows without a number and repeated ones; refuse a sensor without noise.

    Raises:
        CabolsError: if a wrench other than zero is stated to be exact.
    """
    exact = (np.einsum("kii->ki", samples.wrench_covariance) <= 0.0).all(axis=1)
    wrong = exact & (samples.wrench != 0.0).any(axis=1)
    if wrong.any():
        raise CabolsError(
            f"wrench_covariance[{int(np.flatnonzero(wrong)[0])}]: expected the sensor's "
            "uncertainty, got zero for a wrench that is not; state its noise, or the scale's"
        )
    if isinstance(samples, PointSamples):
        value = samples.position
        more = np.column_stack([samples.time, samples.group, samples.reflector, samples.offset])
    else:
        value, more = samples.deflection, samples.joints[:, :0]
    index = np.column_stack([samples.configuration, samples.load, samples.branch])
    key = np.column_stack([index, more, samples.joints, samples.wrench, value])
    measured = np.isfinite(value).any(axis=1)
    _, first = np.unique(np.nan_to_num(key), axis=0, return_index=True)
    once = np.zeros(len(samples), dtype=np.bool_)
    once[first] = True
    rows = np.flatnonzero(measured & once)
    missing, repeated = int((~measured).sum()), int((measured & ~once).sum())
    if rows.size == len(samples):
        return Usable(samples, rows, 0, 0)
    # One branch for each kind of table, which `select` keeps.
    if isinstance(samples, PointSamples):
        return Usable(select(samples, rows), rows, missing, repeated)
    return Usable(select(samples, rows), rows, missing, repeated)
