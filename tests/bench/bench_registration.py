# SPDX-License-Identifier: Apache-2.0
"""Whether the registration's covariances are true: Monte Carlo over geometries and noise.

The normalised estimation error squared (NEES) of p unknowns has the mean p if the covariance is
right; the mean of many draws then lies in the printed 95 % band, in 19 cases of 20.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from record import write_figures
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from cabols_control.geometry import load_geometry
from cabols_control.registration.reflectors import register_frame, register_pose
from cabols_hw.tracker.beam import BeamNoise, predicted_covariance
from cabols_hw.tracker.config import load_tracker_config

NOISES = {
    "typical": BeamNoise(),
    "maximum": BeamNoise(10e-6, 0.3e-6, 15e-6, 6e-6),
    "coarse": BeamNoise(20e-6, 0.0, 300e-6, 30e-6),
}
ROBOT_SIGMA = np.array([37e-6] * 3 + [87e-6] * 3) / 3.0
"""Repeatability of an IRB 1600 (Slamani, Nubiola, Bonev), read as three standard deviations."""


def geometries(config, platform):
    """Name -> (reflectors (n, 3), platform position (3,), rotation (3, 3)), tracker's frame."""
    turn = config.base_rotation.T
    position = turn @ (platform - np.array(config.base_position))
    bench = config.reflector_points
    turned = Rotation.from_euler("XYZ", [25, -30, 40], degrees=True).as_matrix()
    more = np.vstack([bench, [[0.1, 0.05, 0.05], [-0.1, 0.02, -0.06]]])
    return {
        "bench": (bench, position, turn),
        "bench, turned": (bench, position, turn @ turned),
        "wide, 0.28 m": (2.0 * bench, position, turn @ turned),
        "flat, 0.02 m off a line": (
            np.array([[0.1, 0.1, 0.0], [-0.1, 0.1, 0.0], [0.0, 0.1, 0.02]]),
            position,
            turn,
        ),
        "five reflectors": (more, position, turn @ turned),
        "bench, 10 m away": (bench, 10.0 * position / np.linalg.norm(position), turn),
    }


def drawn(random, points, covariances):
    """Points with noise of their covariances."""
    factors = np.linalg.cholesky(covariances)
    return points + np.einsum("...ij,...j->...i", factors, random.standard_normal(points.shape))


def error_of(estimate, position, rotation):
    """(6,) of an estimate: translation [m], rotation vector [rad]."""
    turn = Rotation.from_matrix(rotation @ estimate.rotation.T).as_rotvec()
    return np.concatenate([position - estimate.position, turn])


def summary(name, noise, errors, covariances, chi_squares, freedom):
    """One case's figures."""
    errors, covariances = np.array(errors), np.array(covariances)
    draws = len(errors)
    solved = np.linalg.solve(covariances, errors[..., None])[..., 0]
    mean = float(np.mean(np.sum(errors * solved, axis=1)))
    low, high = (float(v) for v in chi2.ppf([0.025, 0.975], 6 * draws) / draws)
    variances = np.diagonal(covariances, axis1=1, axis2=2).mean(axis=0)
    return {
        "case": name,
        "noise": noise,
        "draws": draws,
        "nees_mean": mean,
        "nees_expected": 6,
        "nees_low": low,
        "nees_high": high,
        "inside": bool(low <= mean <= high),
        "residual_chi_square_mean": float(np.mean(chi_squares)),
        "residual_chi_square_expected": freedom,
        "position_sigma_um": float(1e6 * np.sqrt(variances[:3].sum())),
        "rotation_sigma_urad": float(1e6 * np.sqrt(variances[3:].sum())),
        "position_error_rms_um": float(1e6 * np.sqrt(np.mean(np.sum(errors[:, :3] ** 2, 1)))),
        "rotation_error_rms_urad": float(1e6 * np.sqrt(np.mean(np.sum(errors[:, 3:] ** 2, 1)))),
    }


def pose_case(random, draws, name, geometry, noise_name):
    """Platform's pose from its reflectors."""
    reflectors, position, rotation = geometry
    points = position + reflectors @ rotation.T
    weights = np.array([predicted_covariance(p, NOISES[noise_name]) for p in points])
    errors, covariances, squares = [], [], []
    for _ in range(draws):
        pose = register_pose(reflectors, drawn(random, points, weights), weights)
        errors.append(error_of(pose, position, rotation))
        covariances.append(pose.covariance)
        squares.append(pose.chi_square)
    freedom = 3 * len(reflectors) - 6
    return summary(f"pose: {name}", noise_name, errors, covariances, squares, freedom)


def frame_case(random, draws, config, platform, solve):
    """Tracker's frame from twelve poses of the robot, with the robot's repeatability."""
    count = 12
    positions = platform + 0.2 * random.uniform(-1.0, 1.0, (count, 3))
    rotations = Rotation.from_rotvec(0.35 * random.uniform(-1.0, 1.0, (count, 3))).as_matrix()
    base, turn = np.array(config.base_position), config.base_rotation
    errors, covariances, squares = [], [], []
    for _ in range(draws):
        slip = ROBOT_SIGMA * random.standard_normal((count, 6))
        true = Rotation.from_rotvec(slip[:, 3:]).as_matrix() @ rotations
        points = (positions + slip[:, :3])[:, None] + np.einsum(
            "kij,nj->kni", true, config.reflector_points
        )
        points = (points - base) @ turn
        weights = np.array(
            [[predicted_covariance(p, NOISES["typical"]) for p in row] for row in points]
        )
        frame = register_frame(
            positions,
            rotations,
            config.reflector_points,
            drawn(random, points, weights),
            weights,
            pose_covariance=np.diag(ROBOT_SIGMA**2),
            solve_reflectors=solve,
        )
        errors.append(error_of(frame, base, turn))
        covariances.append(frame.covariance)
        squares.append(frame.chi_square)
    name = "frame: 12 poses" + (", reflectors unknown" if solve else "")
    return summary(name, "typical", errors, covariances, squares, frame.degrees_of_freedom)


def main() -> None:
    """Print and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("build/bench/registration.json"))
    parser.add_argument("--draws", type=int, default=2000)
    parser.add_argument("--frame-draws", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    random = np.random.default_rng(arguments.seed)
    config = load_tracker_config()
    platform = load_geometry().reference_position
    cases = [
        pose_case(random, arguments.draws, name, geometry, noise)
        for name, geometry in geometries(config, platform).items()
        for noise in NOISES
    ]
    cases += [
        frame_case(random, arguments.frame_draws, config, platform, solve)
        for solve in (False, True)
    ]
    poses = [case for case in cases if case["case"].startswith("pose")]
    total = sum(case["draws"] for case in poses)
    pooled = sum(case["nees_mean"] * case["draws"] for case in poses) / total
    low, high = (float(v) for v in chi2.ppf([0.025, 0.975], 6 * total) / total)
    figures = {
        "seed": arguments.seed,
        "cases": cases,
        "pose_nees_mean": pooled,
        "pose_nees_low": low,
        "pose_nees_high": high,
        "cases_inside": sum(case["inside"] for case in cases),
        "cases_total": len(cases),
        "met": bool(low <= pooled <= high),
    }
    write_figures(arguments.output, figures)
    print(f"{'case':36} {'noise':8} {'NEES':>6} {'95 % band':>14} {'sigma um':>9} {'urad':>6}")
    for case in cases:
        print(
            f"{case['case']:36} {case['noise']:8} {case['nees_mean']:6.3f} "
            f"{case['nees_low']:6.3f}-{case['nees_high']:6.3f} "
            f"{case['position_sigma_um']:8.1f} {case['rotation_sigma_urad']:7.0f}"
            f"{'' if case['inside'] else '  outside'}"
        )
    print(
        f"all poses, {total} draws: NEES {pooled:.3f}, band {low:.3f}-{high:.3f}: "
        f"{'met' if figures['met'] else 'NOT met'}; "
        f"{figures['cases_inside']} of {len(cases)} cases inside their own band (19 of 20 expected)"
    )


if __name__ == "__main__":
    main()
