# SPDX-License-Identifier: Apache-2.0
"""Subcommand `workspace design`: optimise attachment points, compare the patterns."""

from __future__ import annotations

import argparse
import time
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import OptimizeResult, differential_evolution

from cabols_control.checks import FloatArray
from cabols_control.errors import CabolsError
from cabols_control.files.output_folder import output_folder
from cabols_control.motion import Motion
from cabols_control.workspace.bodies import Bodies, interference_task
from cabols_control.workspace.design import (
    BENCH,
    GIVEN,
    PATTERNS,
    DesignProblem,
    design_bounds,
    parameters_of,
    reference_of,
    rig_of,
)
from cabols_control.workspace.grid import PoseGrid, WorkspaceMap, box_grid
from cabols_control.workspace.robot import Robot, robot_words
from cabols_control.workspace.surface import level_surface
from cabols_control.workspace.wrench_set import WrenchSet

from . import figures, files
from .workers import Workers, workers

COARSE, FINE = (9, 7, 7), (25, 21, 21)
"""Positions of the optimiser's grid and of the one that its result is judged on."""


LEAST_M = 1e-9
"""Half width of a grid along an axis of one position."""
SPREAD = 0.2
"""Standard deviation of the first generation round the bench, of the bounds' widths."""


class Choices(NamedTuple):
    """What a design is judged by.

    Attributes:
        required: wrenches.
        bodies: for the interference test, or None.
        grid: positions of the optimiser, with the orientations that must all do.
    """

    required: WrenchSet
    bodies: Bodies | None
    grid: PoseGrid


def optimise(problem: DesignProblem, pool: Workers, options: argparse.Namespace) -> OptimizeResult:
    """Minimise the cost by differential evolution, from the reference bench and random rigs.

    Args:
        problem: pattern of the attachment points, and cost of its parameters.
        pool: computes the costs of a generation.
        options: of the command: generations, population (at least 5 are taken), seed.

    Returns:
        scipy's: x the best parameters, as in design_bounds, fun their cost.
    """
    rng = np.random.default_rng(options.seed)
    bounds, reference = np.array(design_bounds(problem.pattern)), reference_of(problem.pattern)
    lower, upper = bounds.T
    start = rng.uniform(lower, upper, (max(options.population, 5), len(bounds)))
    # Half of them are near the bench: a rig drawn from all the bounds rarely has a workspace.
    near = len(start) // 2
    spread = SPREAD * (upper - lower)
    start[:near] = reference + spread * rng.standard_normal((near, len(bounds)))
    start = np.clip(start, lower, upper)
    start[0] = reference
    began = time.monotonic()
    generation = 0

    def report(intermediate_result: OptimizeResult) -> None:
        nonlocal generation
        generation += 1
        print(
            f"\r{problem.pattern}: generation {generation} of {options.generations}, cost "
            f"{intermediate_result.fun:.4f}, {time.monotonic() - began:.0f} s",
            end="",
            flush=True,
        )

    found = differential_evolution(
        problem,
        bounds,
        init=start,
        maxiter=options.generations,
        mutation=(0.4, 0.9),
        recombination=0.8,
        tol=0.0,
        atol=1e-6,
        rng=rng,
        polish=False,
        updating="deferred",
        workers=pool.map,
        callback=report,
    )
    print()
    return found


def _judge(pool: Workers, problem: DesignProblem, parameters: FloatArray) -> WorkspaceMap:
    """Map of a design on the fine grid."""
    geometry = rig_of(parameters, problem.pattern, problem.reference)
    grid = problem.grid
    middle = problem.reference.reference_position
    half = [max(abs(axis[-1] - m), LEAST_M) for axis, m in zip(_axes(grid), middle, strict=True)]
    counts = [n if size > 1 else 1 for n, size in zip(FINE, grid.shape, strict=True)]
    fine = box_grid(
        middle,
        half,
        (counts[0], counts[1], counts[2]),
        grid.angles_deg,
        problem.reference.reference_rotation,
    )
    task = problem.task(geometry)
    bodies = problem.bodies
    touching = None if bodies is None else interference_task(geometry, bodies)
    return pool.evaluate(fine, task, touching, 0.0 if bodies is None else bodies.clearance)


def _axes(grid: PoseGrid) -> tuple[FloatArray, FloatArray, FloatArray]:
    return grid.x, grid.y, grid.z


def _row(name: str, found: WorkspaceMap, parameters: FloatArray) -> dict[str, Any]:
    return {
        "name": name,
        "feasible_volume_m3": found.volume(found.feasible),
        "usable_volume_m3": found.volume(found.usable),
        "least_factor_at_reference": float(
            found.capacity.factor[tuple(np.array(found.grid.shape) // 2)].min()
        ),
        "parameters": parameters_of(parameters),
    }


def _pattern_rows(
    pool: Workers, problem: DesignProblem, options: argparse.Namespace
) -> list[tuple[dict[str, Any], WorkspaceMap | None]]:
    """One pattern with the bench's sizes, and optimised."""
    rows: list[tuple[dict[str, Any], WorkspaceMap | None]] = []
    sizes = "as it is" if problem.pattern == GIVEN else "bench's sizes"
    name, reference = f"{problem.pattern}, {sizes}", reference_of(problem.pattern)
    try:
        found = _judge(pool, problem, reference)
        rows.append((_row(name, found, reference), found))
    except CabolsError as error:
        print(f"{name}: {error}")
        rows.append(({"name": name, "feasible_volume_m3": 0.0, "usable_volume_m3": 0.0}, None))
    best = np.round(optimise(problem, pool, options).x, 4)
    name = f"{problem.pattern}, optimised"
    try:
        found = _judge(pool, problem, best)
        rows.append((_row(name, found, best), found))
    except CabolsError as error:
        print(f"{name}: {error}")
        rows.append(({"name": name, "feasible_volume_m3": 0.0, "usable_volume_m3": 0.0}, None))
    return rows


def run_design(options: argparse.Namespace, robot: Robot, choices: Choices) -> None:
    """Optimise every pattern, compare, and leave the best geometry as YAML.

    Args:
        options: of the command.
        robot: to start from.
        choices: what the options say of it.
    """
    bodies = choices.bodies
    bench = not (options.geometry or options.rig)
    patterns = options.patterns or (list(PATTERNS) if bench else [GIVEN])
    cables, motion = robot.geometry.cables, robot.geometry.motion
    if patterns != [GIVEN] and (motion is not Motion.SPATIAL or cables != len(PATTERNS[BENCH])):
        raise CabolsError(
            f"patterns: expected {GIVEN}, the only one of a robot of {cables} cables with the "
            f"motion {motion.value}, got {', '.join(patterns)}"
        )
    grid = choices.grid
    rows: list[dict[str, Any]] = []
    maps: dict[str, WorkspaceMap] = {}
    with (
        output_folder(options.output, "workspace", keep=True) as folder,
        workers(options.scheduler, options.workers) as pool,
    ):
        print(f"{pool.description}, {grid.poses} poses for each rig of a generation")
        for pattern in patterns:
            problem = DesignProblem(
                reference=robot.geometry,
                pattern=pattern,
                tension_min=robot.tension_min,
                tension_max=robot.tension_max,
                required=choices.required,
                bodies=bodies,
                grid=grid,
                weights=robot.weights,
                platform=robot.platform,
            )
            for row, found in _pattern_rows(pool, problem, options):
                rows.append({"pattern": pattern, **row})
                if found is not None:
                    maps[row["name"]] = found
        _leave(rows, maps, robot, options)
        folder.finish()


def _leave(
    rows: list[dict[str, Any]],
    maps: dict[str, WorkspaceMap],
    robot: Robot,
    options: argparse.Namespace,
) -> None:
    """Print and write the results."""
    reference = robot.geometry
    words = robot_words(robot) if options.geometry else {}
    flat = reference.motion.across is not None
    unit = "m^2" if flat else "m^3"
    print(f"{'':32} feasible      feasible and free")
    for row in rows:
        print(
            f"{row['name']:32} {row['feasible_volume_m3']:.4f} {unit}   "
            f"{row['usable_volume_m3']:.4f} {unit}"
        )
        if "parameters" in row and row["name"].endswith("optimised"):
            geometry = rig_of(list(row["parameters"].values()), row["pattern"], reference)
            path = options.output / f"{row['pattern']}_geometry.yaml"
            files.write_geometry(geometry, path, _comment(row), words)
    best = max(rows, key=lambda row: row["usable_volume_m3"])
    geometry = rig_of(list(best["parameters"].values()), best["pattern"], reference)
    files.write_geometry(geometry, options.output / "geometry.yaml", _comment(best), words)
    if flat:
        rows = [{k.replace("volume_m3", "area_m2"): v for k, v in row.items()} for row in rows]
    files.write_json({"rows": rows, "best": best["name"]}, options.output / "design.json")
    solids = [
        (name, level_surface(found.grid.x, found.grid.y, found.grid.z, found.level()))
        for name, found in maps.items()
        if min(found.grid.shape) > 1
    ]
    if not solids:
        print(f"best: {best['name']}; geometry and table are in {options.output}")
        return
    figures.draw_solids(
        [
            rig_of(list(row["parameters"].values()), row["pattern"], reference)
            for row in rows
            if row["name"] in maps
        ],
        solids,
        options.output / "design.png",
        "Feasible and free of interference at all orientations",
    )
    print(f"best: {best['name']}; geometry, table and figure are in {options.output}")


def _comment(row: dict[str, Any]) -> str:
    values = ", ".join(f"{name} {value:g}" for name, value in row["parameters"].items())
    return (
        f"Written by `workspace design`: {row['name']}.\n"
        f"Feasible and free of interference: {row['usable_volume_m3']:.4f} m^3.\n{values}"
    )
