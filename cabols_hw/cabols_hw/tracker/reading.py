# SPDX-License-Identifier: Apache-2.0
"""A measurement of the tracker, checked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cabols_control.checks import FloatArray


@dataclass(frozen=True, eq=False)
class TrackerReading:
    """One reflector, measured; or why it was not.

    Attributes:
        position: (3,) in the tracker's frame [m]; NaN without success.
        covariance: (3, 3) of the averaged position, without drift [m^2]; NaN without success.
        rms: root mean square distance of the samples from their mean [m]; NaN without success.
        temperature: of the air [degrees Celsius]; NaN without success.
        samples: averaged.
        averaging_s: from the first to the last sample [s].
        success: whether the reflector was measured.
        reason: why not, and what to do; empty with success.
        time_ns: middle of the averaging time, the tracker's clock [ns]; 0 without success.
        middle_ns: the same on this computer's clock [ns]: half the averaging time before the
            answer came; 0 without success.
    """

    position: FloatArray
    covariance: FloatArray
    rms: float
    temperature: float
    samples: int
    averaging_s: float
    success: bool
    reason: str
    time_ns: int = 0
    middle_ns: int = 0


def failed(reason: str) -> TrackerReading:
    """Return a reading without success."""
    nan = float("nan")
    return TrackerReading(
        np.full(3, nan), np.full((3, 3), nan), nan, nan, 0, 0.0, success=False, reason=reason
    )


def fault_of(
    position: FloatArray, covariance: FloatArray, expected: FloatArray, radius: float
) -> str:
    """Return why an answer cannot be used; empty if it can.

    Args:
        position: (3,) [m].
        covariance: (3, 3) [m^2].
        expected: (3,) where the reflector should be [m].
        radius: largest distance from there [m].
    """
    away = float(np.linalg.norm(position - expected))
    if not away <= radius:
        return (
            f"expected the reflector within {1e3 * radius:.3g} mm of its nominal position, "
            f"measured one {1e3 * away:.4g} mm away; another reflector, or the tracker's frame or "
            "the platform's pose is wrong: register the tracker's frame"
        )
    if not (np.isfinite(covariance).all() and np.linalg.eigvalsh(covariance)[0] > 0.0):
        return (
            f"expected a positive definite covariance from the tracker, got {covariance.tolist()};"
            " let its server leave it out, and the configured noise is used"
        )
    return ""
