# SPDX-License-Identifier: Apache-2.0
"""Surface of a region given by values on a grid: marching tetrahedra, watertight."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cabols_control.checks import FloatArray, finite_array, shaped_array
from cabols_control.errors import ShapeError

IndexArray = NDArray[np.int64]

# Each cube is cut into six tetrahedra round the diagonal 0-7; corner number = 4 dx + 2 dy + dz.
# Neighbouring cubes cut the face between them alike, so no gap opens.
_TETRAHEDRA = np.array(
    [[0, 4, 6, 7], [0, 6, 2, 7], [0, 2, 3, 7], [0, 3, 1, 7], [0, 1, 5, 7], [0, 5, 4, 7]]
)
_CORNERS = np.array([[c >> 2 & 1, c >> 1 & 1, c & 1] for c in range(8)])
INSET = 0.02
"""Share of an edge that the surface keeps away from its ends: no two vertices coincide."""
PAD = 1e-3
"""By how much the grid's ends move in, of a step, to leave room for the surface round them."""


class Mesh(NamedTuple):
    """Closed triangle mesh, normals outwards.

    Attributes:
        vertices: (v, 3) [m].
        faces: (f, 3) indices, counter-clockwise from outside.
    """

    vertices: FloatArray
    faces: IndexArray

    @property
    def volume(self) -> float:
        """Enclosed volume [m^3], by the divergence theorem."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


NO_MESH = Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))


def _padded(axis: FloatArray) -> FloatArray:
    """Add a position on either side: the ends, while the grid's move in a little.

    So the surface stays within the box, and its vertices apart also in single precision.
    """
    step = PAD * float(np.diff(axis).mean())
    inner = axis.copy()
    inner[0] += step
    inner[-1] -= step
    return np.concatenate([axis[:1], inner, axis[-1:]])


def _tetrahedra(shape: tuple[int, ...]) -> IndexArray:
    """(t, 4) flat indices of the corners of all tetrahedra of a grid."""
    cells = np.stack(
        np.meshgrid(*[np.arange(size - 1) for size in shape], indexing="ij"), axis=-1
    ).reshape(-1, 1, 3)
    corner = np.ravel_multi_index(tuple(np.moveaxis(cells + _CORNERS, -1, 0)), shape)
    return np.asarray(corner[:, _TETRAHEDRA].reshape(-1, 4), dtype=np.int64)


def _triangles(inside: IndexArray, outside: IndexArray) -> list[IndexArray]:
    """Edges (inside corner, outside corner) of each triangle, (t, 3, 2), unoriented.

    Args:
        inside: (t, i) corners inside, i = 1, 2 or 3.
        outside: (t, 4 - i) corners outside.
    """
    i = inside.shape[1]
    if i == 2:
        a, b = inside.T
        c, d = outside.T
        ac, ad, bd, bc = (np.stack(edge, axis=-1) for edge in ((a, c), (a, d), (b, d), (b, c)))
        return [np.stack([ac, ad, bd], 1), np.stack([ac, bd, bc], 1)]
    lone, others = (inside, outside) if i == 1 else (outside, inside)
    edges = [
        np.stack([lone[:, 0], others[:, k]][:: 1 if i == 1 else -1], axis=-1) for k in range(3)
    ]
    return [np.stack(edges, axis=1)]


def level_surface(x: ArrayLike, y: ArrayLike, z: ArrayLike, values: ArrayLike) -> Mesh:
    """Surface round the region where values, linear between grid points, are above zero.

    Args:
        x: (nx,) rising, nx >= 2 [m].
        y: (ny,) [m].
        z: (nz,) [m].
        values: (nx, ny, nz); -inf counts as far outside. The grid's boundary closes the region.

    Returns:
        A closed mesh; empty if no value is above zero.

    Raises:
        ShapeError: if an argument has another shape or holds NaN.
    """
    axes = [finite_array(name, axis, (None,)) for name, axis in zip("xyz", (x, y, z), strict=True)]
    shape = tuple(axis.size for axis in axes)
    if min(shape) < 2:
        raise ShapeError(f"x, y, z: expected two positions or more on each, got {shape}")
    level = shaped_array("values", values, shape)
    if np.isnan(level).any():
        raise ShapeError(f"values: expected numbers of shape {shape}, got NaN")
    scale = max(float(np.abs(level[np.isfinite(level)]).max(initial=0.0)), 1e-30)
    level = np.pad(np.clip(level, -scale, scale), 1, constant_values=-1e6 * scale)
    # Zero would put a vertex on a corner, where several edges meet.
    level[level == 0.0] = -1e-12 * scale
    grid = np.stack(np.meshgrid(*[_padded(axis) for axis in axes], indexing="ij"), axis=-1)
    return _march(level, grid.reshape(-1, 3))


def _march(level: FloatArray, points: FloatArray) -> Mesh:
    flat = level.ravel()
    corners = _tetrahedra(level.shape)
    number = (flat[corners] > 0.0).sum(axis=1)
    found = []
    for count in (1, 2, 3):
        chosen = corners[number == count]
        order = np.argsort(flat[chosen] <= 0.0, axis=1, kind="stable")
        ordered = np.take_along_axis(chosen, order, axis=1)
        found += _triangles(ordered[:, :count], ordered[:, count:])
    edges = np.concatenate(found)
    if edges.size == 0:
        return NO_MESH
    keys, index = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
    faces = index.reshape(-1, 3).astype(np.int64)
    inner, outer = flat[keys[:, 0]], flat[keys[:, 1]]
    share = np.clip(inner / (inner - outer), INSET, 1.0 - INSET)[:, None]
    vertices = (1.0 - share) * points[keys[:, 0]] + share * points[keys[:, 1]]
    return Mesh(vertices, _outwards(vertices, faces, points[keys[:, 1]] - points[keys[:, 0]]))


def _outwards(vertices: FloatArray, faces: IndexArray, out: FloatArray) -> IndexArray:
    """Orient each triangle along its edges from inside to outside."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    wrong = np.einsum("ij,ij->i", normal, out[faces].sum(axis=1)) < 0.0
    turned = faces.copy()
    turned[wrong] = faces[wrong][:, [0, 2, 1]]
    return turned
