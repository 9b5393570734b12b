# SPDX-License-Identifier: Apache-2.0
"""Required wrench set: the wrenches that a rig must be able to give."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, finite_array
from cabols_control.errors import CabolsError, ShapeError

MAX_VERTICES_OF = 12
"""Generators beyond which the 2^p sign patterns of a zonotope are not listed."""


@dataclass(frozen=True, eq=False)
class WrenchSet:
    """Convex set held + conv(points) + sum of the segments [-g, g]: polytopes, boxes, zonotopes.

    Attributes:
        points: (q, m) wrenches, q >= 1, whose convex hull is taken [N, N m].
        generators: (p, m) half axes g that are added, p >= 0 [N, N m].
        held: (m,) constant part that no multiple of the set changes, such as the wrench that
            holds the weight, in base axes always [N, N m]; empty for none.
    """

    points: FloatArray
    generators: FloatArray
    held: FloatArray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        """Check shapes and finiteness."""
        points = finite_array("points", self.points, (None, None))
        if points.shape[0] < 1:
            raise ShapeError("points: expected at least one wrench, got none; the zero wrench?")
        m = points.shape[1]
        if m < 1:
            raise ShapeError(f"points: expected wrenches of one component or more, got {m}")
        generators = self.generators if np.size(self.generators) else np.zeros((0, m))
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "generators", finite_array("generators", generators, (None, m)))
        held = finite_array("held", self.held, (m,)) if np.size(self.held) else np.zeros(m)
        object.__setattr__(self, "held", held)

    @property
    def dimension(self) -> int:
        """Number m of wrench components: 6 in space, 3 in a plane."""
        return int(self.points.shape[1])

    def vertices(self) -> FloatArray:
        """List points that include every vertex, (q 2^p, m), for checks by other means.

        Raises:
            CabolsError: with more than 12 generators.
        """
        p = self.generators.shape[0]
        if p > MAX_VERTICES_OF:
            raise CabolsError(
                f"generators: expected at most {MAX_VERTICES_OF} to list vertices, got {p}; the "
                "hyperplane test needs no list"
            )
        signs = np.array(list(product((-1.0, 1.0), repeat=p))).reshape(2**p, p)
        corners = self.points[:, None, :] + (signs @ self.generators)[None, :, :]
        return corners.reshape(-1, self.dimension) + self.held

    def scaled(self, factor: float) -> WrenchSet:
        """Return the set times a factor, about the zero wrench; what is held stays."""
        return WrenchSet(factor * self.points, factor * self.generators, self.held)


def wrench_box(
    half_widths: ArrayLike, centre: ArrayLike | None = None, held: ArrayLike | None = None
) -> WrenchSet:
    """Box of wrenches, all components at once.

    Args:
        half_widths: (m,) largest deviation of each component [N, N m]; zeros make it flat.
        centre: (m,) [N, N m]; None for zero.
        held: (m,) constant part of the set, see WrenchSet [N, N m]; None for none.

    Raises:
        ShapeError: if an argument is not (m,) or not finite.
        CabolsError: if a half width is negative.
    """
    half = finite_array("half_widths", half_widths, (None,))
    if not (half >= 0.0).all():
        raise CabolsError(f"half_widths: expected none below zero, got {half}; drop the signs")
    middle = np.zeros(half.size) if centre is None else finite_array("centre", centre, half.shape)
    fixed = np.zeros(half.size) if held is None else finite_array("held", held, half.shape)
    return WrenchSet(middle[None, :], np.diag(half)[half > 0.0], fixed)


def wrench_zonotope(generators: ArrayLike, centre: ArrayLike) -> WrenchSet:
    """Zonotope: centre plus the segments [-g, g] of generators (p, m) [N, N m].

    Args:
        generators: (p, m) half axes [N, N m].
        centre: (m,) of the set [N, N m].

    Raises:
        ShapeError: if an argument has another shape or is not finite.
    """
    middle = finite_array("centre", centre, (None,))
    return WrenchSet(middle[None, :], finite_array("generators", generators, (None, middle.size)))


def wrench_polytope(points: ArrayLike) -> WrenchSet:
    """Convex hull of wrenches (q, m) [N, N m].

    Raises:
        ShapeError: if there is none, or they are not (q, m) or not finite.
    """
    array = finite_array("points", points, (None, None))
    return WrenchSet(array, np.zeros((0, array.shape[1])))
