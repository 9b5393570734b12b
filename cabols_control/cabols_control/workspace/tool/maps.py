# SPDX-License-Identifier: Apache-2.0
"""What the subcommands of `workspace` do; see command.py."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.errors import CabolsError
from cabols_control.files.output_folder import output_folder
from cabols_control.geometry import RigGeometry
from cabols_control.motion import Motion
from cabols_control.workspace.bodies import (
    Bodies,
    InterferenceTask,
    interference_task,
    load_bodies,
)
from cabols_control.workspace.capacity import CapacityTask, capacity_along, capacity_task
from cabols_control.workspace.grid import (
    PoseGrid,
    WorkspaceMap,
    box_grid,
    piece_count,
    tilts,
)
from cabols_control.workspace.interference import clearance_along, free_turn
from cabols_control.workspace.robot import Robot, load_robot
from cabols_control.workspace.surface import Mesh
from cabols_control.workspace.wrench_set import WrenchSet, wrench_box, wrench_polytope

from . import figures, files
from .design_command import COARSE, Choices, run_design
from .exchange_command import run_export, run_import
from .loss_command import run_loss
from .pieces import piece_folder
from .stiffness_command import run_stiffness
from .workers import workers

TURN_POINTS = 13
BENCH_BOX = (50.0, 50.0, 50.0, 5.0, 5.0, 5.0)
BENCH_HALF_WIDTHS = (0.6, 0.5, 0.5)
FIXED_DEG = 1e-6
"""Turn about an axis about which the platform cannot turn, beyond which it is one."""
MESHES = {
    "closed": "wrench-closed",
    "feasible": "wrench-feasible",
    "usable": "feasible and free",
}
"""Regions that are drawn, with their names."""


def required_wrenches(options: argparse.Namespace, robot: Robot) -> WrenchSet:
    """Return the set that the options, or the robot's file, describe.

    Args:
        options: of the command.
        robot: whose `required_wrench` is taken where the options give none.

    Raises:
        CabolsError: if the file does not hold six finite columns.
        OSError: if it cannot be read.
    """
    if options.wrenches is None:
        if options.box is not None:
            return wrench_box(options.box)
        if robot.required is None and not robot.own_bodies:
            print(
                "note: required wrenches are those of the bench, 50 N and 5 N m; for others: "
                "--box, --wrenches, or required_wrench in the robot's file"
            )
        return wrench_box(BENCH_BOX if robot.required is None else robot.required)
    try:
        table = np.loadtxt(options.wrenches, delimiter=",", ndmin=2, comments="#")
    except ValueError as error:
        raise CabolsError(f"{options.wrenches}: expected rows of six numbers: {error}") from error
    return wrench_polytope(table)


def _robot(options: argparse.Namespace) -> Robot:
    """Read the robot and say what was not of it."""
    robot = load_robot(options.rig, options.geometry, options.control)
    for note in robot.notes:
        print(f"note: {note}")
    return robot


def _bodies(options: argparse.Namespace, robot: Robot) -> Bodies | None:
    if options.no_bodies:
        return None
    if robot.own_bodies or options.bodies:
        return load_bodies(options.rig, options.bodies)
    if robot.bodies is None:
        print(
            "note: interference is left out: the bench's platform and target are not this robot's; "
            "for its own: bodies in the robot's file, or --bodies FILE"
        )
    return robot.bodies


def _progress(start_s: float) -> Callable[[int, int], None]:
    def show(done: int, total: int) -> None:
        print(f"\r{done} of {total} pieces, {time.monotonic() - start_s:.1f} s", end="", flush=True)
        if done == total:
            print()

    return show


def grid_of(options: argparse.Namespace, geometry: RigGeometry) -> PoseGrid:
    """Return the grid that the options describe, along what the platform can move.

    Args:
        options: half_widths, counts and tilt.
        geometry: of the robot.
    """
    counts, motion = list(options.counts), geometry.motion
    angles = tilts(options.tilt) if options.tilt != 0.0 else np.zeros((1, 3))
    if motion.across is not None:
        counts[motion.across] = 1
    if motion is not Motion.SPATIAL:
        # Turns of `tilts` are about the reference pose's own axes.
        turned = angles @ geometry.reference_rotation.T
        fixed = [k for k in range(3) if k + 3 not in motion.directions]
        angles = angles[np.abs(turned[:, fixed]).max(axis=1) < FIXED_DEG]
    return box_grid(
        geometry.reference_position,
        options.half_widths,
        (counts[0], counts[1], counts[2]),
        angles,
        geometry.reference_rotation,
    )


def map_figures(
    found: WorkspaceMap, solids: dict[str, Mesh], seconds: float, by: str
) -> dict[str, Any]:
    """Numbers of a map, units in the keys; volumes are those of the meshes.

    Args:
        found: the map.
        solids: its meshes by region.
        seconds: that the evaluation took [s].
        by: who evaluated it.
    """
    return {
        "poses": found.grid.poses,
        "orientations": len(found.grid.angles_deg),
        "evaluated_by": by,
        "seconds_s": seconds,
        "poses_feasible": int(found.feasible.sum()),
        "poses_usable": int(found.usable.sum()),
        "feasible_share": float(found.feasible.all(axis=-1).mean()),
        "usable_share": float(found.usable.all(axis=-1).mean()),
        **(
            {f"{name}_volume_m3": mesh.volume for name, mesh in solids.items()}
            if found.grid.flat_axis is None
            else {f"{name}_area_m2": area for name, area in found.areas().items()}
        ),
    }


def run_map(options: argparse.Namespace) -> None:
    """Map the workspace and leave table, meshes, figures."""
    robot = _robot(options)
    geometry, bodies = robot.geometry, _bodies(options, robot)
    if options.half_widths is None:
        options.half_widths = (
            robot.half_widths() if options.geometry or options.rig else BENCH_HALF_WIDTHS
        )
    required = required_wrenches(options, robot)
    limits = (robot.tension_min, robot.tension_max)
    axes = options.platform_axes
    task = capacity_task(geometry, *limits, required, axes, robot.weights, robot.platform)
    touching = None if bodies is None else interference_task(geometry, bodies)
    free_above = 0.0 if bodies is None else bodies.clearance
    grid = grid_of(options, geometry)
    print(f"{grid.poses} poses: {grid.shape} positions, {len(grid.angles_deg)} orientations")
    if options.in_pieces:
        _map_in_pieces(options, grid, task, touching, free_above)
        return
    # Map, trajectory and designs may share a folder; each replaces its own files alone.
    with (
        output_folder(options.output, "workspace", keep=True) as folder,
        workers(options.scheduler, options.workers) as pool,
    ):
        start = time.monotonic()
        found = pool.evaluate(grid, task, touching, free_above, _progress(start))
        seconds = time.monotonic() - start
        solids = found.solids()
        summary = map_figures(found, solids, seconds, pool.description)
        _leave_map(found, solids, summary, geometry, options)
        if bodies is not None and geometry.has_pulleys:
            print("note: no range of turn about z is certified over pulleys; no turns.png")
        elif bodies is not None and geometry.motion is Motion.SPATIAL:
            _map_turns(geometry, bodies, options)
        folder.finish()
    print(f"table, meshes and figures are in {options.output}")


def _map_in_pieces(
    options: argparse.Namespace,
    grid: PoseGrid,
    task: CapacityTask,
    touching: InterferenceTask | None,
    free_above: float,
) -> None:
    """Write what is missing of a map's pieces, then its figures."""
    folder = piece_folder(options.output, grid, task, touching, free_above)
    left, start = folder.missing(), time.monotonic()
    there = piece_count(grid) - len(left)
    if there:
        print(f"{there} pieces are there from before")
    with workers(options.scheduler, options.workers) as pool:
        show = _progress(start)
        for done, (k, piece) in enumerate(pool.stream(grid, task, touching, left), start=1):
            folder.write(k, piece)
            show(done, len(left))
    for name, value in folder.figures().items():
        print(f"  {name:22} {value:.4g}" if isinstance(value, float) else f"  {name:22} {value}")
    print(f"the pieces are in {options.output}")


def _leave_map(
    found: WorkspaceMap,
    solids: dict[str, Mesh],
    summary: dict[str, Any],
    geometry: RigGeometry,
    options: argparse.Namespace,
) -> None:
    """Print the figures; write table, meshes and pictures."""
    for name, value in summary.items():
        print(f"  {name:22} {value:.4g}" if isinstance(value, float) else f"  {name:22} {value}")
    files.write_json(summary, options.output / "workspace.json")
    files.write_map(found, options.output / "workspace.csv")
    if found.grid.flat_axis is not None:
        title = f"Least over {len(found.grid.angles_deg)} orientations"
        figures.draw_plane(found, geometry, options.output / "slices.png", title)
    if min(found.grid.shape) > 1:
        shown = [(name, solids[region]) for region, name in MESHES.items()]
        title = f"Workspace at {len(found.grid.angles_deg)} orientations"
        for name, mesh in shown:
            stem = options.output / name.replace(" ", "_")
            files.write_stl(mesh, stem.with_suffix(".stl"))
            files.write_ply(mesh, stem.with_suffix(".ply"))
        rigs = [geometry] * len(shown)
        figures.draw_solids(rigs, shown, options.output / "workspace.png", title)
        figures.draw_slices(found, options.output / "slices.png", "Least over the orientations")


def _map_turns(geometry: RigGeometry, bodies: Bodies, options: argparse.Namespace) -> None:
    """Certified turn about z over the middle plane."""
    centre, half = geometry.reference_position, options.half_widths
    x = np.linspace(centre[0] - half[0], centre[0] + half[0], TURN_POINTS)
    y = np.linspace(centre[1] - half[1], centre[1] + half[1], TURN_POINTS)
    turns = np.array([[_turn(geometry, bodies, (a, b, centre[2])) for b in y] for a in x])
    low, high = np.moveaxis(turns, -1, 0)
    figures.draw_turns(x, y, low, high, options.output / "turns.png")
    least, largest = np.rad2deg(_turn(geometry, bodies, tuple(centre)))
    print(f"  at the reference position cables stay free from {least:.1f} to {largest:.1f} deg")


def _turn(
    geometry: RigGeometry, bodies: Bodies, position: tuple[float, ...]
) -> tuple[float, float]:
    axis = (0.0, 0.0, 1.0)
    return free_turn(geometry, bodies, position, geometry.reference_rotation, axis)


def run_trajectory(options: argparse.Namespace) -> None:
    """Margins along a trajectory: table and figure."""
    robot = _robot(options)
    bodies = _bodies(options, robot)
    positions, rotations = files.read_poses(options.poses)
    capacity = capacity_along(
        robot.geometry,
        positions,
        rotations,
        robot.tension_min,
        robot.tension_max,
        required_wrenches(options, robot),
        options.platform_axes,
        robot.weights,
        robot.platform,
    )
    clearance = clearance_along(
        robot.geometry, bodies or Bodies(0.0, 0.0, 0.05, 0.05), positions, rotations
    )
    free_above = bodies.clearance if bodies else 0.0
    columns = files.MAP_COLUMNS[len(files.POSE_COLUMNS) : -1]
    rows: FloatArray = np.column_stack([*capacity, *clearance])
    with output_folder(options.output, "workspace", keep=True) as folder:
        files.write_rows(columns, rows, options.output / "trajectory.csv")
        figures.draw_trajectory(capacity, clearance, free_above, options.output / "trajectory.png")
        folder.finish()
    worst = int(capacity.margin.argmin())
    print(f"{len(positions)} poses, {int(capacity.feasible.sum())} feasible")
    print(f"  least margin    {capacity.margin[worst]:.2f} N at pose {worst}")
    print(f"  least factor    {capacity.factor.min():.3f}")
    print(f"  least clearance {1e3 * clearance.least.min():.1f} mm, {1e3 * free_above:g} required")
    print(f"table and figure are in {options.output}")


def run_design_of(options: argparse.Namespace) -> None:
    """Optimise attachment points from the given robot."""
    robot = _robot(options)
    own = not (options.geometry or options.rig)
    options.half_widths = BENCH_HALF_WIDTHS if own else robot.half_widths()
    options.counts = COARSE
    choices = Choices(
        required_wrenches(options, robot),
        _bodies(options, robot),
        grid_of(options, robot.geometry),
    )
    run_design(options, robot, choices)


def run_stiffness_of(options: argparse.Namespace) -> None:
    """Map how far loads move the platform."""
    robot = _robot(options)
    if options.half_widths is None:
        options.half_widths = robot.half_widths()
    required = required_wrenches(options, robot)
    run_stiffness(options, robot, required, grid_of(options, robot.geometry))


def run_export_of(options: argparse.Namespace) -> None:
    """Write the given robot in another program's format."""
    run_export(options, _robot(options))


def run_loss_of(options: argparse.Namespace) -> None:
    """Tell what remains of the wrenches when a cable parts."""
    run_loss(options, _robot(options))


RUN = {
    "map": run_map,
    "trajectory": run_trajectory,
    "design": run_design_of,
    "stiffness": run_stiffness_of,
    "loss": run_loss_of,
    "import": run_import,
    "export": run_export_of,
}
"""What each subcommand does."""
