# SPDX-License-Identifier: Apache-2.0
"""Figures of a workspace, drawn without a display."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from cabols_control.checks import FloatArray
from cabols_control.geometry import RigGeometry
from cabols_control.workspace.capacity import Capacity
from cabols_control.workspace.grid import WorkspaceMap
from cabols_control.workspace.interference import Clearance
from cabols_control.workspace.surface import Mesh

DPI = 110
INSIDE, LIMIT, CABLE, FRAME = "#4c9f70", "#b2182b", "#222222", "#999999"
_LIGHT = np.array([0.4, -0.5, 0.8]) / np.linalg.norm([0.4, -0.5, 0.8])


def _tidy(axes: Any, xlabel: str, ylabel: str) -> None:
    axes.grid(visible=True, color="#dddddd", linewidth=0.7)
    axes.set_axisbelow(True)
    axes.set_xlabel(xlabel)
    axes.set_ylabel(ylabel)


def _draw_rig(axes: Any, geometry: RigGeometry) -> None:
    """Draw cables at the reference pose, base points and their box."""
    held = geometry.reference_position + geometry.platform_points @ geometry.reference_rotation.T
    for start, end in zip(geometry.base_points, held, strict=True):
        axes.plot(*np.stack([start, end]).T, color=CABLE, linewidth=0.7)
    axes.scatter(*geometry.base_points.T, color=CABLE, s=12)
    axes.scatter(*held.T, color=LIMIT, s=6)


FLATTEST = 0.1
"""Least side of a drawing in space, of its largest."""


def _draw_mesh(axes: Any, mesh: Mesh, colour: str) -> None:
    corners = mesh.vertices[mesh.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    light = 0.55 + 0.45 * (normal / np.maximum(length, 1e-300)) @ _LIGHT
    rgb = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
    shades = np.clip(light[:, None] * rgb, 0.0, 1.0)
    axes.add_collection3d(Poly3DCollection(corners, facecolors=shades, linewidths=0.0))


def _equal(axes: Any, points: FloatArray) -> None:
    """Give the axes one scale, and limits that hold all the points (k, 3), flat ones included."""
    low, high = points.min(axis=0), points.max(axis=0)
    room = np.maximum(FLATTEST * (high - low).max() - (high - low), 0.0) / 2.0
    low, high = low - room, high + room
    for axis, name in enumerate("xyz"):
        getattr(axes, f"set_{name}lim")(low[axis], high[axis])
        getattr(axes, f"set_{name}label")(f"{name} [m]")
        getattr(axes, f"{name}axis").set_major_locator(MaxNLocator(4))
    axes.set_box_aspect(high - low, zoom=0.88)
    axes.view_init(elev=22, azim=-60)


def draw_solids(
    rigs: list[RigGeometry], solids: list[tuple[str, Mesh]], path: Path, title: str
) -> None:
    """Draw meshes in their rigs, one panel each, with their volumes.

    Args:
        rigs: one for each mesh.
        solids: names and meshes, base frame [m].
        path: of the picture; its suffix names the format.
        title: above it.
    """
    rows = -(-len(solids) // 3)
    columns = -(-len(solids) // rows)
    figure = Figure(figsize=(4.2 * columns, 4.2 * rows + 0.4), layout="constrained")
    points = np.vstack([[*rig.base_points, rig.reference_position] for rig in rigs])
    for k, (geometry, (name, mesh)) in enumerate(zip(rigs, solids, strict=True)):
        axes: Any = figure.add_subplot(rows, columns, k + 1, projection="3d")
        if len(mesh.faces):
            _draw_mesh(axes, mesh, INSIDE)
        _draw_rig(axes, geometry)
        _equal(axes, points)
        axes.set_title(f"{name}: {mesh.volume:.3f} m³", fontsize=10)
    figure.suptitle(title, fontsize=11)
    figure.savefig(path, dpi=DPI)


def _top(factor: FloatArray) -> float:
    """End of the scale of factors; they are infinite where nothing is required."""
    known = factor[np.isfinite(factor)]
    return max(2.0, float(np.percentile(known, 99))) if known.size else 2.0


def draw_slices(found: WorkspaceMap, path: Path, title: str) -> None:
    """Draw the least factor over the orientations in three planes through the grid's middle.

    Args:
        found: a map of a grid in space.
        path: of the picture; its suffix names the format.
        title: above it.
    """
    grid, factor = found.grid, found.capacity.factor.min(axis=-1)
    axes_m = (grid.x, grid.y, grid.z)
    free = found.free.all(axis=-1)
    figure = Figure(figsize=(11.0, 3.9), layout="constrained")
    panels: Any = figure.subplots(1, 3)
    top = _top(factor)
    image = None
    for axes, (across, up) in zip(panels, ((0, 1), (0, 2), (1, 2)), strict=True):
        fixed = 3 - across - up
        middle = axes_m[fixed].size // 2
        plane = np.minimum(np.take(factor, middle, axis=fixed).T, top)
        horizontal, vertical = axes_m[across], axes_m[up]
        image = axes.pcolormesh(horizontal, vertical, plane, vmin=0.0, vmax=top, cmap="viridis")
        if min(plane.shape) > 1:
            axes.contour(horizontal, vertical, plane, levels=[1.0], colors=LIMIT, linewidths=2.0)
            blocked = np.take(~free, middle, axis=fixed).T
            if blocked.any():
                axes.contourf(
                    horizontal, vertical, blocked, levels=[0.5, 1.5], colors="none", hatches=["///"]
                )
        axes.set_aspect("equal")
        axes.set_xlabel(f"{'xyz'[across]} [m]")
        axes.set_ylabel(f"{'xyz'[up]} [m]")
        axes.set_title(f"{'xyz'[fixed]} = {axes_m[fixed][middle]:.3f} m", fontsize=10)
    if image is not None:
        figure.colorbar(image, ax=panels, label="multiple of the required set [-]")
    figure.suptitle(f"{title} (red: 1, the limit; hatched: cables interfere)", fontsize=11)
    figure.savefig(path, dpi=DPI)


def draw_plane(found: WorkspaceMap, geometry: RigGeometry, path: Path, title: str) -> None:
    """Draw the least factor over the orientations of a grid with one flat axis, and the robot.

    Args:
        found: map of such a grid.
        geometry: of the robot.
        path: picture to write.
        title: above it.
    """
    flat = found.grid.flat_axis
    across, up = (k for k in range(3) if k != flat)
    axes_m = (found.grid.x, found.grid.y, found.grid.z)
    factor = np.squeeze(found.capacity.factor.min(axis=-1), axis=flat).T
    figure = Figure(figsize=(6.0, 5.0), layout="constrained")
    axes: Any = figure.subplots()
    top = _top(factor)
    factor = np.minimum(factor, top)
    image = axes.pcolormesh(axes_m[across], axes_m[up], factor, vmin=0.0, vmax=top, cmap="viridis")
    axes.contour(axes_m[across], axes_m[up], factor, levels=[1.0], colors=LIMIT, linewidths=2.0)
    held = geometry.reference_position + geometry.platform_points @ geometry.reference_rotation.T
    for start, end in zip(geometry.base_points, held, strict=True):
        line = np.stack([start, end])
        axes.plot(line[:, across], line[:, up], color=CABLE, linewidth=0.7)
    axes.set_aspect("equal")
    axes.set_xlabel(f"{'xyz'[across]} [m]")
    axes.set_ylabel(f"{'xyz'[up]} [m]")
    axes.set_title(f"{title} (red: 1, the limit)", fontsize=10)
    figure.colorbar(image, ax=axes, label="multiple of the required set [-]")
    figure.savefig(path, dpi=DPI)


def draw_trajectory(
    capacity: Capacity, clearance: Clearance, free_above: float, path: Path
) -> None:
    """Draw capacity margin, factor and clearances along a trajectory.

    Args:
        capacity: of its k poses.
        clearance: of the same; a row that is not finite everywhere is left out [m].
        free_above: clearance that is required, drawn as the limit [m].
        path: of the picture; its suffix names the format.
    """
    number = np.arange(capacity.margin.size)
    figure = Figure(figsize=(8.0, 6.4), layout="constrained")
    panels: Any = figure.subplots(3, 1, sharex=True)
    panels[0].plot(number, capacity.margin, color=INSIDE)
    panels[0].axhline(0.0, color=LIMIT, linewidth=1.2)
    _tidy(panels[0], "", "capacity margin [N]")
    panels[1].plot(number, capacity.factor, color=INSIDE)
    panels[1].axhline(1.0, color=LIMIT, linewidth=1.2)
    _tidy(panels[1], "", "multiple of the\nrequired set [-]")
    for values, name in zip(clearance, ("cables", "platform", "target"), strict=True):
        if np.isfinite(values).all():
            panels[2].plot(number, 1e3 * values, label=f"to {name}")
    panels[2].axhline(1e3 * free_above, color=LIMIT, linewidth=1.2, label="required")
    panels[2].legend(fontsize=8)
    _tidy(panels[2], "pose [-]", "clearance [mm]")
    figure.savefig(path, dpi=DPI)


def draw_turns(x: FloatArray, y: FloatArray, low: FloatArray, high: FloatArray, path: Path) -> None:
    """Draw how far the platform may turn about z without interference, over a plane.

    Args:
        x: (a,) positions, base frame [m].
        y: (b,) likewise.
        low: (a, b) least certified angle, 0 or negative [rad].
        high: (a, b) largest one [rad].
        path: of the picture; its suffix names the format.
    """
    figure = Figure(figsize=(9.0, 3.9), layout="constrained")
    panels: Any = figure.subplots(1, 2)
    for axes, angle, name in zip(panels, (-low, high), ("negative", "positive"), strict=True):
        image = axes.pcolormesh(x, y, np.rad2deg(angle).T, vmin=0.0, vmax=90.0, cmap="viridis")
        axes.set_aspect("equal")
        axes.set_xlabel("x [m]")
        axes.set_ylabel("y [m]")
        axes.set_title(f"{name} turn about z", fontsize=10)
    figure.colorbar(image, ax=panels, label="certified free turn [deg]")
    figure.savefig(path, dpi=DPI)
