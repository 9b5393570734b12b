"""Subcommand `workspace design`: optimise attachment points, compare the patterns."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import OptimizeResult, differential_evolution

from cabols_control.checks import FloatArray
from cabols_control.errors import CabolsError
from cabols_control.output_folder import output_folder
from cabols_control.rig import load_rig
from cabols_control.workspace.bodies import interference_task, load_bodies
from cabols_control.workspace.capacity import capacity_task
from cabols_control.workspace.design import (
    PATTERNS,
    REFERENCE,
    DesignProblem,
    design_bounds,
    parameters_of,
    rig_of,
)
from cabols_control.workspace.grid import WorkspaceMap, box_grid, tilts
from cabols_control.workspace.surface import level_surface
from cabols_control.workspace.wrench_set import WrenchSet

from . import figures, files
from .workers import Workers, workers

HALF_WIDTHS = (0.6, 0.5, 0.5)
COARSE, FINE = (9, 7, 7), (25, 21, 21)
"""Positions of the optimiser's grid and of the one that its result is judged on."""


SPREAD = 0.2
"""Standard deviation of the first generation round the bench, of the bounds' widths."""


def add_design(parser: argparse.ArgumentParser) -> None:
    """Options of the subcommand."""
    parser.add_argument(
        "--patterns", nargs="+", choices=PATTERNS, default=list(PATTERNS), help="default: all"
    )
    parser.add_argument("--tilt", type=float, default=15.0, help="+- about each axis [deg]")
    parser.add_argument("--generations", type=int, default=80, help="of differential evolution")
    parser.add_argument("--population", type=int, default=48, help="rigs in a generation")
    parser.add_argument("--seed", type=int, default=1)
    parser.set_defaults(output=Path("build/design"))


def optimise(problem: DesignProblem, pool: Workers, options: argparse.Namespace) -> OptimizeResult:
    """Minimise the cost by differential evolution, from the reference bench and random rigs."""
    rng = np.random.default_rng(options.seed)
    bounds = np.array(design_bounds())
    lower, upper = bounds.T
    start = rng.uniform(lower, upper, (max(options.population, 5), len(bounds)))
    # Half of them are near the bench: a rig drawn from all the bounds rarely has a workspace.
    near = len(start) // 2
    spread = SPREAD * (upper - lower)
    start[:near] = np.array(REFERENCE) + spread * rng.standard_normal((near, len(bounds)))
    start = np.clip(start, lower, upper)
    start[0] = REFERENCE
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
    fine = box_grid(
        problem.reference.reference_position,
        HALF_WIDTHS,
        FINE,
        grid.angles_deg,
        problem.reference.reference_rotation,
    )
    task = capacity_task(geometry, problem.tension_min, problem.tension_max, problem.required)
    bodies = problem.bodies
    touching = None if bodies is None else interference_task(geometry, bodies)
    return pool.evaluate(fine, task, touching, 0.0 if bodies is None else bodies.clearance)


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
    name = f"{problem.pattern}, bench's sizes"
    try:
        found = _judge(pool, problem, np.array(REFERENCE))
        rows.append((_row(name, found, np.array(REFERENCE)), found))
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


def run_design(options: argparse.Namespace, required: WrenchSet) -> None:
    """Optimise every pattern, compare, and leave the best geometry as YAML."""
    rig = load_rig(options.rig, geometry=options.geometry, control=options.control)
    bodies = None if options.no_bodies else load_bodies(options.rig, options.bodies)
    centre, turn = rig.geometry.reference_position, rig.geometry.reference_rotation
    grid = box_grid(centre, HALF_WIDTHS, COARSE, tilts(options.tilt), turn)
    limits = (rig.control.tension_min, rig.control.tension_max)
    rows: list[dict[str, Any]] = []
    maps: dict[str, WorkspaceMap] = {}
    with (
        output_folder(options.output, "workspace", keep=True) as folder,
        workers(options.scheduler, options.workers) as pool,
    ):
        print(f"{pool.description}, {grid.poses} poses for each rig of a generation")
        for pattern in options.patterns:
            problem = DesignProblem(rig.geometry, pattern, *limits, required, bodies, grid)
            for row, found in _pattern_rows(pool, problem, options):
                rows.append({"pattern": pattern, **row})
                if found is not None:
                    maps[row["name"]] = found
        _leave(rows, maps, rig.geometry, options)
        folder.finish()


def _leave(
    rows: list[dict[str, Any]],
    maps: dict[str, WorkspaceMap],
    reference: Any,
    options: argparse.Namespace,
) -> None:
    """Print and write the results."""
    print(f"{'':32} feasible      feasible and free")
    for row in rows:
        print(
            f"{row['name']:32} {row['feasible_volume_m3']:.4f} m^3   "
            f"{row['usable_volume_m3']:.4f} m^3"
        )
        if "parameters" in row and row["name"].endswith("optimised"):
            geometry = rig_of(list(row["parameters"].values()), row["pattern"], reference)
            path = options.output / f"{row['pattern']}_geometry.yaml"
            files.write_geometry(geometry, path, _comment(row))
    best = max(rows, key=lambda row: row["usable_volume_m3"])
    geometry = rig_of(list(best["parameters"].values()), best["pattern"], reference)
    files.write_geometry(geometry, options.output / "geometry.yaml", _comment(best))
    files.write_json({"rows": rows, "best": best["name"]}, options.output / "design.json")
    solids = [
        (name, level_surface(found.grid.x, found.grid.y, found.grid.z, found.level()))
        for name, found in maps.items()
    ]
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
