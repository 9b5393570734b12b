# SPDX-License-Identifier: Apache-2.0
"""Self-calibration of simulated rigs that differ from their drawing, in process.

Every rig has errors of 5 mm in each coordinate of its points, 2 mm of its pulleys' radii, 2 % of
each k_e, and a sensor that is turned, shifted and biased. It stops at 60 poses; at each, lengths
are read with the cables just tight, then the sensor's wrench under three loads. The readings come
from the product's kernels, not from the estimator's model. Printed: errors of what counts and their
bound, for designed and random poses of the tracker and for poses of a robot; share of 95 %
intervals that hold the truth. A rig's parameters have errors in common, so their intervals hold or
fail together, and a binomial band is no measure of them: it is of independent combinations of the
parameters (errors whitened by the stated covariance), counted beside. Resumes: rigs in the output's
.rows.jsonl are not run again.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "harness"))

import numpy as np
from record import write_figures
from scipy.spatial.transform import Rotation
from scipy.stats import binom

from cabols_control.cable_kernels import (
    cable_lengths_unchecked,
    cable_records,
    structure_matrix_unchecked,
)
from cabols_control.calibration.design import choose_stops
from cabols_control.calibration.estimate import calibrate, errors_of, information, uses
from cabols_control.calibration.model import Noise, Readings
from cabols_control.calibration.parameters import layout_of
from cabols_control.rig import load_rig
from cabols_control.workspace.bodies import load_bodies
from cabols_control.workspace.capacity import capacity_along
from cabols_control.workspace.interference import clearance_along
from cabols_control.workspace.wrench_set import wrench_box
from line_journal import LineJournal

RADIUS_M, WEIGHT_N, FREE_TENSION_N, TENSION_N = 0.04, 20.0, 7.0, 50.0
STOPS, LOADS, CANDIDATES = 60, 3, 400
REACH, RANDOM = (0.45, 0.7), (0.25, 0.5)
"""Half width [m] and largest turn [rad] of the candidates and of the random set."""
ERRORS = {
    "base": 5e-3, "platform": 5e-3, "radius": 2e-3, "offset": 0.05, "sensor_turn": 5e-3,
    "sensor_shift": 1e-3, "weight": 1.0, "moment": 0.1,
}  # fmt: skip
STIFFNESS_ERROR, BIAS_FORCE, BIAS_TORQUE = 0.02, 5.0, 0.5
NOISES = {"tracker": Noise(), "robot": Noise(position=5e-4, rotation=5e-4)}
USED = ("length_mm", "force_n", "torque_nm")
UNITS = np.array([1e3, 1.0, 1.0])


class Study:
    """The bench over pulleys, its candidates for stops, and what its calibration is for."""

    def __init__(self) -> None:
        """Choose what all rigs share; the same at every call."""
        rng, bench = np.random.default_rng(1), load_rig()
        self.rig = replace(bench, geometry=replace(bench.geometry, pulley_radius=RADIUS_M))
        self.layout = layout_of(self.rig, WEIGHT_N, np.zeros(3))
        self.rated = self.rig.control.rated
        self.bodies = load_bodies()
        self.candidates = self.stops(rng, CANDIDATES, REACH)
        self.random = self.stops(rng, STOPS, RANDOM)
        position, turn = self.poses(rng, 150, RANDOM)
        self.at = position, turn
        self.use = uses(self.layout, self.layout.start, position, turn)
        chosen = choose_stops(self.layout, self.candidates, self.use, NOISES["tracker"], STOPS)
        self.designed = [self.candidates[i] for i in chosen]

    def poses(self, rng, count, reach):
        """Poses within the cables' reach: no cable slack or touching at them."""
        geometry = self.rig.geometry
        positions, rotations = [], []
        while len(positions) < count:
            place = geometry.reference_position + rng.uniform(-reach[0], reach[0], 3)
            turn = rng.normal(size=3)
            turn *= rng.uniform(0.0, reach[1]) / np.linalg.norm(turn)
            rotation = Rotation.from_rotvec(turn).as_matrix()
            pose = (place[None], rotation[None])
            found = capacity_along(geometry, *pose, 1.0, 150.0, wrench_box([5.0] * 3 + [0.5] * 3))
            if found.feasible[0] and clearance_along(geometry, self.bodies, *pose).cables[0] > 0.0:
                positions.append(place)
                rotations.append(rotation)
        return np.array(positions), np.array(rotations)

    def stops(self, rng, count, reach):
        """Stops with tensions in place of let-out lengths, which depend on the rig."""
        positions, rotations = self.poses(rng, count, reach)
        cables, found = self.rig.geometry.records(), []
        for position, rotation in zip(positions, rotations, strict=True):
            matrix = structure_matrix_unchecked(cables, position, rotation)
            tensions = [np.full(len(cables), FREE_TENSION_N)]
            while len(tensions) <= LOADS:
                tension = rng.uniform(5.0, 80.0, len(cables))
                excess = np.abs(matrix @ tension) / (0.9 * self.rated)
                tensions.append(5.0 + (tension - 5.0) / max(excess.max(), 1.0))
            rows = len(tensions)
            wrench = np.full((rows, 6), np.nan)
            wrench[1:] = 0.0
            at = (np.tile(position, (rows, 1)), np.tile(rotation, (rows, 1, 1)))
            found.append(self.let_out(Readings(*at, np.array(tensions), wrench, FREE_TENSION_N)))
        return found

    def let_out(self, stop):
        """Make let-out lengths of the drawing of a stop's tensions."""
        cables, k_e = self.rig.geometry.records(), self.rig.limbs.stiffness
        lengths = [
            cable_lengths_unchecked(cables, p, r)
            for p, r in zip(stop.position, stop.rotation, strict=True)
        ]
        return replace(stop, let_out=np.array(lengths) - stop.let_out / k_e)

    def true_values(self, rng):
        """(p,) of a rig that was built with errors."""
        values = self.layout.start.copy()
        own = self.layout.parts(values)
        for name, error in ERRORS.items():
            own[name] += error * rng.standard_normal(own[name].shape)
        own["stiffness"] *= 1.0 + STIFFNESS_ERROR * rng.standard_normal(len(own["stiffness"]))
        own["bias"] += np.repeat([BIAS_FORCE, BIAS_TORQUE], 3) * rng.standard_normal(6)
        return values

    def record(self, stops, values, noise, rng):
        """Readings of a built rig, by the kernels; the motors make the drawing's tensions."""
        own, n = self.layout.parts(values), self.layout.cables
        cables = cable_records(own["base"], own["platform"], own["radius"], self.layout.axes)
        nominal, k_e = self.rig.geometry.records(), self.rig.limbs.stiffness
        positions, rotations, out, wrenches = [], [], [], []
        turn = Rotation.from_rotvec(own["sensor_turn"]).as_matrix()
        for stop in stops:
            for row in range(len(stop.position)):
                position, rotation = stop.position[row], stop.rotation[row]
                drawn = cable_lengths_unchecked(nominal, position, rotation)
                tension = k_e * (drawn - stop.let_out[row])
                length = cable_lengths_unchecked(cables, position, rotation)
                let_out = length - own["offset"] - tension / own["stiffness"]
                wrench = structure_matrix_unchecked(cables, position, rotation) @ tension
                wrench[2] -= own["weight"][0]
                wrench[3:] += np.cross(rotation @ own["moment"], [0.0, 0.0, -1.0])
                force, torque = rotation.T @ wrench[:3], rotation.T @ wrench[3:]
                torque = torque - np.cross(own["sensor_shift"], force)
                read = np.concatenate([turn @ force, turn @ torque]) + own["bias"]
                read += np.repeat([noise.force, noise.torque], 3) * rng.standard_normal(6)
                wrenches.append(read if row else np.full(6, np.nan))
                out.append(let_out + noise.length * rng.standard_normal(n))
                positions.append(position + noise.position * rng.standard_normal(3))
                error = Rotation.from_rotvec(noise.rotation * rng.standard_normal(3)).as_matrix()
                rotations.append(error @ rotation)
        return Readings(
            *(np.array(rows) for rows in (positions, rotations, out, wrenches)), FREE_TENSION_N
        )

    def errors(self, values, estimate):
        """(3,) rms errors of lengths [mm], force [N], torque [N m] over the workspace."""
        found, true = (errors_of(self.layout, v, *self.at) for v in (estimate, values))
        length, wrench = found[0] - true[0], TENSION_N * (found[1] - true[1])
        parts = (length, wrench[:, :3], wrench[:, 3:])
        return UNITS * [np.sqrt(np.mean(np.square(part))) for part in parts]

    def run(self, seed):
        """Figures of one rig."""
        rng = np.random.default_rng(1000 + seed)
        values = self.true_values(rng)
        row = {}
        before = self.layout.start.copy()
        self.layout.parts(before)["offset"][:] = self.layout.parts(values)["offset"]
        row["before"] = self.errors(values, before).tolist()
        for name, noise, stops in (
            ("designed", NOISES["tracker"], self.designed),
            ("random", NOISES["tracker"], self.random),
            ("robot", NOISES["robot"], self.designed),
        ):
            readings = self.record(stops, values, noise, rng)
            found = calibrate(self.layout, readings, noise)
            score = (found.values - values) / found.deviation
            apart = np.linalg.solve(np.linalg.cholesky(self._correlation(found)), score)
            bound = UNITS * self.use.rms(found.covariance, TENSION_N)
            row[name] = {
                "error": self.errors(values, found.values).tolist(),
                "bound": bound.tolist(),
                "inside": int((np.abs(score) < 1.959964).sum()),
                "inside_apart": int((np.abs(apart) < 1.959964).sum()),
                "count": int(score.size),
                "square": float(score @ np.linalg.solve(self._correlation(found), score)),
                "residual": found.residual,
                "told": int(found.told.sum()),
                "points_mm": self._points(found.values - values).tolist(),
                "points_bound_mm": self._points(found.deviation).tolist(),
            }
        return row

    def _points(self, differences):
        """(2,) rms of base and platform points [mm]."""
        own = self.layout.parts(differences)
        return 1e3 * np.array([np.sqrt(np.mean(own[name] ** 2)) for name in ("base", "platform")])

    @staticmethod
    def _correlation(found):
        return found.covariance / np.outer(found.deviation, found.deviation)

    def free_bound(self):
        """Bounds of random stops without loads: base, platform points [mm], by tracker, robot."""
        found = {}
        for name, noise in NOISES.items():
            rows = [stop.chosen(np.array([0])) for stop in self.random]
            known = np.eye(self.layout.start.size)
            for stop in rows:
                jacobian, _ = information(self.layout, self.layout.start, stop, noise)
                flat = jacobian.reshape(-1, self.layout.start.size)
                known += flat.T @ flat
            spread = self.layout.spread
            found[name] = self._points(spread * np.sqrt(np.diag(np.linalg.inv(known)))).tolist()
        return found


def main() -> int:
    """Run, print, write; a rig at a time."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rigs", type=int, default=200)
    parser.add_argument("--short", action="store_true", help="20 rigs")
    parser.add_argument("--fresh", action="store_true", help="run all anew")
    parser.add_argument("--output", type=Path, default=Path("build/bench/calibration.json"))
    options = parser.parse_args()
    kept = LineJournal(options.output.with_suffix(".jsonl"), options.fresh)
    wanted = 20 if options.short else options.rigs
    study = Study()
    for seed in range(wanted):
        if seed not in kept.found:
            kept.add(seed, **study.run(seed))
    figures = summarise([kept.found[seed] for seed in range(wanted)])
    figures["lengths_alone_points_bound_mm"] = study.free_bound()
    print_figures(figures)
    write_figures(options.output, figures)
    return 0


def summarise(rows):
    """Figures over all rigs."""
    figures = {"rigs": len(rows)}
    rms = lambda values: np.sqrt(np.mean(np.square(values), axis=0))  # noqa: E731
    figures["before"] = dict(zip(USED, rms([row["before"] for row in rows]), strict=True))
    for name in ("designed", "random", "robot"):
        parts = [row[name] for row in rows]
        error, bound = (rms([part[key] for part in parts]) for key in ("error", "bound"))
        inside, count = (sum(part[key] for part in parts) for key in ("inside", "count"))
        low, high = binom.interval(0.999, count, 0.95)
        figures[name] = {
            "error": dict(zip(USED, error, strict=True)),
            "bound": dict(zip(USED, bound, strict=True)),
            "error_over_bound": dict(zip(USED, error / bound, strict=True)),
            "inside_95": inside / count,
            "inside_95_apart": sum(part["inside_apart"] for part in parts) / count,
            "band": [low / count, high / count],
            "mean_square_per_parameter": float(
                np.mean([part["square"] / part["count"] for part in parts])
            ),
            "residual_rms": float(np.mean([part["residual"] for part in parts])),
            "told": float(np.mean([part["told"] for part in parts])),
            "points_mm": rms([part["points_mm"] for part in parts]).tolist(),
            "points_bound_mm": rms([part["points_bound_mm"] for part in parts]).tolist(),
        }  # fmt: skip
    figures["designed_bound_over_random"] = {
        name: figures["designed"]["bound"][name] / figures["random"]["bound"][name] for name in USED
    }
    return figures


def print_figures(figures):
    """Print a table of what counts."""
    print(f"{figures['rigs']} rigs, {STOPS} stops of {1 + LOADS} readings")
    print(f"{'':22} {'lengths':>22} {'force':>20} {'torque':>22}")
    row = figures["before"]
    print(
        f"{'drawing believed':22} {row['length_mm']:19.3f} mm {row['force_n']:18.3f} N "
        f"{row['torque_nm']:18.4f} N m"
    )
    for name in ("designed", "random", "robot"):
        part = figures[name]
        cells = [
            f"{part['error'][key]:.4f} ({part['bound'][key]:.4f}, {ratio:.2f})"
            for key, ratio in part["error_over_bound"].items()
        ]
        print(f"{name:22} {cells[0]:>22} {cells[1]:>20} {cells[2]:>22}")
        print(
            f"{'':22} 95 % intervals hold {100 * part['inside_95']:.2f} %, of independent "
            f"combinations {100 * part['inside_95_apart']:.2f} % (band "
            f"{100 * part['band'][0]:.2f} to {100 * part['band'][1]:.2f}), chi2 per parameter "
            f"{part['mean_square_per_parameter']:.3f}, readings' rms {part['residual_rms']:.3f}, "
            f"points {part['points_mm'][0]:.2f} and {part['points_mm'][1]:.3f} mm"
        )
    for name, ratio in figures["designed_bound_over_random"].items():
        print(f"  bound, designed over random, {name}: {ratio:.2f} (at most 0.5)")
    for name, points in figures["lengths_alone_points_bound_mm"].items():
        print(
            f"  lengths alone at the random stops, {name}: bound of base points {points[0]:.2f} "
            f"mm, of platform points {points[1]:.2f} mm"
        )


if __name__ == "__main__":
    raise SystemExit(main())
