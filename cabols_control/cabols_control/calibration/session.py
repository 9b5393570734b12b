# SPDX-License-Identifier: Apache-2.0
"""What `calibrate_rig` does: a plan of stops, or a rig from its readings; see command.py."""

from __future__ import annotations

import argparse
from dataclasses import fields
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.checks import FloatArray
from cabols_control.command_line import DONE, FAILED, fail
from cabols_control.errors import UsageError
from cabols_control.frames import load_frames
from cabols_control.rig import Rig, load_rig
from cabols_control.rig_folder import find_rig
from cabols_control.workspace.bodies import load_bodies
from cabols_control.workspace.capacity import capacity_along
from cabols_control.workspace.interference import clearance_along
from cabols_control.workspace.wrench_set import wrench_box

from .design import choose_stops, least_share
from .estimate import Calibration, calibrate, information, uses
from .model import Noise, Readings, predicted, springs_at
from .parameters import Beforehand, Layout, layout_of
from .recording import calibrated_geometry, read_readings, write_plan, write_rig

STANDARD_GRAVITY = 9.80665
HOLD_OUT = 5
"""Every fifth reading is held out."""
FITS = 1.3
"""Weighted rms of readings, fitted or held out, above which they are not of this model."""
CANDIDATES, WORKSPACE = 300, 100
LEAST_WRENCH = (5.0, 5.0, 5.0, 0.5, 0.5, 0.5)
"""That a stop must be able to give [N, N m]."""
TENSION_N = 50.0
PLANNED_PULL_N = (5.0, 60.0)


def poses_in_reach(
    rig: Rig, folder: str | Path, count: int, reach: float, turn: float, seed: int
) -> list[tuple[FloatArray, FloatArray]]:
    """Draw poses at which the cables can pull in all directions and nothing touches.

    Args:
        rig: whose cables.
        folder: of it, for its bodies.
        count: how many.
        reach: from the reference position along each axis [m].
        turn: largest from the reference orientation [rad].
        seed: of the draw.
    """
    rng, geometry = np.random.default_rng(seed), rig.geometry
    bodies, limits = load_bodies(folder), (rig.control.tension_min, rig.control.tension_max)
    found: list[tuple[FloatArray, FloatArray]] = []
    for _ in range(200 * count):
        axis = rng.normal(size=3)
        angle = rng.uniform(0.0, turn) / np.linalg.norm(axis)
        place = geometry.reference_position + rng.uniform(-reach, reach, 3)
        rotation = Rotation.from_rotvec(angle * axis).as_matrix() @ geometry.reference_rotation
        at = (place[None], rotation[None])
        able = capacity_along(geometry, *at, *limits, wrench_box(list(LEAST_WRENCH)))
        if able.feasible[0] and clearance_along(geometry, bodies, *at).least[0] > 0.0:
            found.append((place, rotation))
            if len(found) == count:
                return found
    raise UsageError(
        f"--reach: expected poses within reach, found {len(found)} of {count}; make it smaller"
    )


def held_out_rms(layout: Layout, readings: Readings, noise: Noise) -> float:
    """Weighted rms of a fifth of the readings by the estimate from the others.

    Args:
        layout: of the parameters.
        readings: all.
        noise: of what is read.
    """
    rows = np.arange(len(readings.position))
    out = rows % HOLD_OUT == HOLD_OUT - 1
    found = calibrate(layout, readings.chosen(~out), noise)
    held = readings.chosen(out)
    jacobian, whiten = information(layout, found.values, held, noise)
    read = np.hstack([held.let_out, np.nan_to_num(held.wrench)])
    n, loaded = layout.cables, held.loaded
    read[loaded, :n] = 0.0
    read[~loaded, n:] = 0.0
    misfit = np.einsum("kab,kb->ka", whiten, read - predicted(layout, found.values, held))
    # What the estimate itself is uncertain by belongs to what is expected.
    scale = np.where(layout.spread > 0.0, layout.spread, 1.0)
    known = found.covariance / np.outer(scale, scale)
    expected = np.einsum("kap,pq,kaq->ka", jacobian, known, jacobian)
    used = np.zeros_like(misfit, dtype=bool)
    used[loaded, n:] = True
    used[~loaded, :n] = True
    return float(np.sqrt(np.mean(misfit[used] ** 2 / (1.0 + expected[used]))))


def plan_or_calibrate(options: argparse.Namespace) -> int:
    """Write a plan, or a calibrated rig; 1 where the readings do not fit.

    Args:
        options: of the command.

    Raises:
        CabolsError: if a file or an option cannot be used.
    """
    given = {each.name: getattr(options, f"{each.name}_std") for each in fields(Noise)}
    noise = Noise(**{name: value for name, value in given.items() if value is not None})
    rig, frames = load_rig(options.rig), load_frames(options.rig)
    tension = rig.control.free_tension if options.tension is None else options.tension
    known = Beforehand() if rig.geometry.has_pulleys else Beforehand(radius=0.0)
    weight = STANDARD_GRAVITY * frames.tool_mass
    layout = layout_of(rig, weight, np.array(frames.tool_centre_of_mass), known)
    if options.plan is not None:
        return _plan(options, rig, layout, noise)
    readings = read_readings(options.data, rig.geometry.cables, tension)
    found = calibrate(layout, readings, noise)
    held = held_out_rms(layout, readings, noise)
    _say(found, held)
    if not (found.residual < FITS and held < FITS):
        return fail(
            f"readings: expected a weighted rms of at most {FITS}, got {found.residual:.2f} fitted "
            f"and {held:.2f} held out; are limbs, poses, noise and pulleys right? Nothing written",
            FAILED,
        )
    geometry = calibrated_geometry(rig.geometry, found)
    folder = find_rig(options.rig)
    write_rig(folder, options.output, geometry, found, options.data, noise, held)
    print(f"  {options.output}")
    return DONE


def _plan(options, rig: Rig, layout: Layout, noise: Noise) -> int:  # type: ignore[no-untyped-def]  # noqa: ANN001
    """Choose the stops and write them."""
    drawn = (options.reach, np.deg2rad(options.turn_deg), options.seed)
    candidates = poses_in_reach(rig, options.rig, CANDIDATES, *drawn)
    checked = poses_in_reach(rig, options.rig, WORKSPACE, *drawn[:2], options.seed + 1)
    rng, n = np.random.default_rng(options.seed), layout.cables
    lengths = predicted(layout, layout.start, _still(candidates, n, rig.control.free_tension))
    stops = []
    for (position, rotation), length in zip(candidates, lengths[:, :n], strict=True):
        pulls = np.vstack([np.full(n, 0.0), rng.uniform(*PLANNED_PULL_N, (2, n))])
        wrench = np.full((3, 6), np.nan)
        wrench[1:] = 0.0
        stops.append(
            Readings(
                np.tile(position, (3, 1)),
                np.tile(rotation, (3, 1, 1)),
                length - pulls / springs_at(layout, layout.start, length),
                wrench,
                rig.control.free_tension,
            )
        )
    use = uses(layout, layout.start, *(np.array(part) for part in zip(*checked, strict=True)))
    chosen = choose_stops(layout, stops, use, noise, options.plan)
    write_plan(options.output, [candidates[i] for i in chosen])
    told = np.eye(layout.start.size)
    for i in chosen:
        jacobian, _ = information(layout, layout.start, stops[i], noise)
        flat = jacobian.reshape(-1, layout.start.size)
        told += flat.T @ flat
    covariance = layout.spread[:, None] * np.linalg.inv(told) * layout.spread
    length, force, torque = use.rms(covariance, TENSION_N)
    print(
        f"{options.plan} stops, each read once with tight cables and under two loads of "
        f"{PLANNED_PULL_N[0]:g} to {PLANNED_PULL_N[1]:g} N in every cable, are to leave "
        f"{1e3 * length:.3f} mm of length, {force:.3f} N and {torque:.4f} N m at {TENSION_N:g} N"
    )
    share = least_share(layout, stops, use, noise, chosen)
    print(
        f"no other choice of {options.plan} among {len(stops)} stops drawn in reach leaves less "
        f"than {100.0 * share:.0f} % of that (rms of all three, as they count)"
    )
    print(f"  {options.output}")
    return DONE


def _still(poses: list[tuple[FloatArray, FloatArray]], cables: int, tension: float) -> Readings:
    """Readings without loads at poses, lengths not yet known."""
    positions, rotations = (np.array(part) for part in zip(*poses, strict=True))
    count = len(poses)
    nothing = np.full((count, 6), np.nan)
    return Readings(positions, rotations, np.zeros((count, cables)), nothing, tension)


def _say(found: Calibration, held: float) -> None:
    """Print what was found and what was not told."""
    print(
        f"{found.freedom} degrees of freedom, weighted rms {found.residual:.3f} fitted, "
        f"{held:.3f} held out"
    )
    change, deviation = found.values - found.layout.start, found.deviation
    for name, c, d, told in zip(found.layout.names, change, deviation, found.told, strict=True):
        if told:
            print(f"  {name:28} {c:+12.6g} +- {d:.2g}")
    untold = [n for n, told in zip(found.layout.names, found.told, strict=True) if not told]
    if untold:
        print(f"not told by these data, left as drawn: {', '.join(untold)}")
