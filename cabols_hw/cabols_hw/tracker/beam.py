# SPDX-License-Identifier: Apache-2.0
"""Noise of a laser tracker: small along the beam, larger across it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from pydantic.dataclasses import dataclass

from cabols_control.checks import FloatArray, finite_array, in_range
from cabols_control.configuration import STRICT
from cabols_control.errors import OutOfRangeError


@dataclass(frozen=True, config=STRICT)
class BeamNoise:
    """Standard deviations that grow with the distance d: constant + per_metre * d.

    The defaults are typical values of a current tracker: half the maximum errors of a Leica AT500
    (radial 10 um + 0.3 um/m, transverse 15 um + 6 um/m).

    Attributes:
        radial_constant: along the beam [m].
        radial_per_metre: along the beam [m/m].
        transverse_constant: each of the two directions across the beam [m].
        transverse_per_metre: each of the two directions across the beam [m/m].
    """

    radial_constant: float = 5.0e-6
    radial_per_metre: float = 0.15e-6
    transverse_constant: float = 7.5e-6
    transverse_per_metre: float = 3.0e-6

    def __post_init__(self) -> None:
        """Check signs and that no direction is without noise."""
        for name in ("radial", "transverse"):
            in_range(f"{name}_constant", getattr(self, f"{name}_constant"), 1e-9, 1e-2)
            in_range(f"{name}_per_metre", getattr(self, f"{name}_per_metre"), 0.0, 1e-2)

    def sigmas(self, distance_m: float) -> FloatArray:
        """(3,) standard deviations [m]: along the beam, and twice the one across it."""
        radial = self.radial_constant + self.radial_per_metre * distance_m
        transverse = self.transverse_constant + self.transverse_per_metre * distance_m
        return np.array([radial, transverse, transverse])


def beam_axes(position: ArrayLike) -> FloatArray:
    """Axes along and across the beam to a point.

    Args:
        position: (3,) in the tracker's frame [m].

    Returns:
        (3, 3) whose columns are unit vectors in the tracker's frame: along the beam, then two
        across it; right-handed.

    Raises:
        ShapeError: if the position has another shape or is not finite.
        OutOfRangeError: if it is the tracker's own origin, which has no direction.
    """
    point = finite_array("position", position, (3,))
    distance = float(np.linalg.norm(point))
    if not distance > 1e-6:
        raise OutOfRangeError("distance of the position from the tracker", distance, 1e-6, np.inf)
    along = point / distance
    # Across: start from the axis farthest from the beam, to avoid cancellation.
    helper = np.zeros(3)
    helper[int(np.abs(along).argmin())] = 1.0
    across = np.cross(along, helper)
    across /= np.linalg.norm(across)
    return np.column_stack([along, across, np.cross(along, across)])


def predicted_covariance(position: ArrayLike, noise: BeamNoise, factor: float = 1.0) -> FloatArray:
    """Return the covariance of a measured point from its position.

    Args:
        position: (3,) in the tracker's frame [m].
        noise: standard deviations along and across the beam.
        factor: on the variance, such as for averaging; above 0.

    Returns:
        (3, 3) in the tracker's frame [m^2].

    Raises:
        ShapeError: if the position has another shape or is not finite.
        OutOfRangeError: if the position is the tracker's origin or the factor is not above 0.
    """
    in_range("factor", factor, 1e-12, 1e12)
    axes = beam_axes(position)
    sigmas = noise.sigmas(float(np.linalg.norm(np.asarray(position, dtype=np.float64))))
    covariance = (axes * (factor * sigmas**2)) @ axes.T
    return np.asarray(0.5 * (covariance + covariance.T))
