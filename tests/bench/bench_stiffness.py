# SPDX-License-Identifier: Apache-2.0
"""Whether the identified stiffness and its intervals are true: simulated campaigns, many times.

Noise is that of the simulated rig (tracker with drift, force sensor with tare and converter,
registration of the tracker, weight of the tool); only the rig's control is left out.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "harness"))

from record import write_figures

from cabols_control.configuration import packaged
from cabols_sim.devices.robot.robot_target import RobotTarget
from cabols_stiffness import identify
from cabols_stiffness.identification.validation import choose_model, validate
from cabols_stiffness.model.compensation import correct
from cabols_stiffness.model.screws import logarithm
from stiffness_bench import (
    Bench,
    bench_configurations,
    bench_robot,
    bench_truth,
    optimal_peaks,
    ramps,
    random_peaks,
)

PEAKS = 4
LEVELS = (0.5, 1.0)
CUBIC_SHARE = 0.3
"""Of the linear torque, at the largest deflection of each joint."""
FRICTION_SHARE = 0.03
"""Of each joint's largest torque."""


def source_scatter():
    """(6,) standard deviation over the source's ten configurations, relative to the mean."""
    lines = packaged("cabols_stiffness", "table_4_3.csv").read_text(encoding="utf-8").splitlines()
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    values = np.array([[float(row[f"c{c}"]) for c in range(1, 11)] for row in rows])
    return values.std(axis=1, ddof=1) / values.mean(axis=1)


def percent(values, digits=2):
    """Six numbers as percent, in columns."""
    return " ".join(f"{100.0 * v:8.{digits}f}" for v in values)


def monte_carlo(bench, robot, campaigns, begin, say):
    """Identify many campaigns; figures joint by joint."""
    truth = np.array(bench.truth.stiffness)
    found, inside, deviations, rms, outliers, seconds = [], [], [], [], 0, []
    for index in range(campaigns):
        samples = bench.draw(begin + index)
        start = time.perf_counter()
        result = identify(samples, robot)
        seconds.append(time.perf_counter() - start)
        found.append(result.stiffness)
        inside.append((result.interval[:, 0] <= truth) & (truth <= result.interval[:, 1]))
        deviations.append(result.standard_deviation)
        rms.append(result.residual_rms)
        outliers += result.outliers.size
        if (index + 1) % 25 == 0:
            say(f"  {index + 1} of {campaigns} campaigns")
    errors = np.array(found) / truth - 1.0
    return {
        "campaigns": campaigns,
        "samples_each": len(samples),
        "identify_median_s": float(np.median(seconds)),
        "residual_rms_mean": float(np.mean(rms)),
        "outliers_total": int(outliers),
        "bias_relative": errors.mean(axis=0).tolist(),
        "scatter_relative": errors.std(axis=0, ddof=1).tolist(),
        "stated_deviation_relative": (np.mean(deviations, axis=0) / truth).tolist(),
        "largest_error_relative": np.abs(errors).max(axis=0).tolist(),
        "coverage_95": np.mean(inside, axis=0).tolist(),
    }


def print_monte_carlo(name, figures):
    """One campaign's table."""
    print(f"\n{name}: {figures['campaigns']} campaigns of {figures['samples_each']} samples, "
          f"residual rms {figures['residual_rms_mean']:.4f}, {figures['outliers_total']} samples "
          f"taken for outliers, {figures['identify_median_s']:.2f} s each")  # fmt: skip
    print("  joint                        1        2        3        4        5        6")
    for key, label in (
        ("largest_error_relative", "largest error, %"),
        ("bias_relative", "mean error, %"),
        ("scatter_relative", "scatter, %"),
        ("stated_deviation_relative", "stated deviation, %"),
        ("coverage_95", "95 % interval covers, %"),
    ):
        print(f"  {label:24s}{percent(figures[key])}")


def harder_truth(bench):
    """The bench's robot with cubic terms and hysteresis of a size that matters."""
    stiffness = np.array(bench.truth.stiffness)
    reach = np.abs(bench.deflection).max(axis=0)
    torque = stiffness * reach
    return replace(
        bench.truth,
        cubic=list(CUBIC_SHARE * stiffness / reach**2),
        hysteresis_torque=list(FRICTION_SHARE * torque),
        hysteresis_deflection=list(0.1 * reach),
    )


def cubic_case(robot, plan, truth, campaigns, say):
    """Cubic, hysteretic truth: cubic terms, held-out loads; without hysteresis: published bias."""
    bench = Bench(robot, plan, truth)
    smooth = Bench(robot, plan, replace(truth, hysteresis_torque=[0.0] * 6))
    cubic, stiffness = np.array(truth.cubic), np.array(truth.stiffness)
    friction = np.array(truth.hysteresis_torque)
    cubics, inside, known, published, stiffs, frictions, held = [], [], [], [], [], [], []
    for index in range(campaigns):
        samples = bench.draw(5000 + index)
        choice = choose_model(samples, robot)
        result = choice.results["cubic"]
        low, high = result.cubic_interval.T
        cubics.append(result.cubic / cubic)
        inside.append((low <= cubic) & (cubic <= high))
        known.append(result.cubic_identifiable)
        stiffs.append(result.stiffness / stiffness)
        frictions.append(result.friction / friction)
        other = identify(smooth.draw(5000 + index), robot, "as_published")
        published.append(other.cubic / cubic)
        held.append([choice.held_out_error[m] for m in ("linear", "cubic")]
                    + [float(choice.model == "cubic")])  # fmt: skip
        if (index + 1) % 5 == 0:
            say(f"  {index + 1} of {campaigns} campaigns")
    known = np.array(known)
    linear, cubic_error, chosen = np.mean(held, axis=0)
    return {
        "campaigns": campaigns,
        "cubic_identifiable_share": known.mean(axis=0).tolist(),
        "cubic_mean_of_truth": np.nanmean(cubics, axis=0).tolist(),
        "cubic_scatter_of_truth": np.nanstd(cubics, axis=0).tolist(),
        "cubic_coverage_95": [
            float(np.array(inside)[known[:, j], j].mean()) if known[:, j].any() else None
            for j in range(6)
        ],
        "published_cubic_mean_of_truth": np.nanmean(published, axis=0).tolist(),
        "stiffness_mean_of_truth": np.nanmean(stiffs, axis=0).tolist(),
        "friction_mean_of_truth": np.mean(frictions, axis=0).tolist(),
        "held_out_error_linear_m": float(linear),
        "held_out_error_cubic_m": float(cubic_error),
        "held_out_lower_in_all": bool(all(row[1] < row[0] for row in held)),
        "cubic_chosen_share": float(chosen),
    }


def print_cubic(figures):
    """The cubic case's table."""
    print(f"\ncubic, hysteretic truth ({100 * CUBIC_SHARE:.0f} % cubic torque, "
          f"{100 * FRICTION_SHARE:.0f} % friction), {figures['campaigns']} campaigns")  # fmt: skip
    print("  joint                        1        2        3        4        5        6")
    for key, label in (
        ("stiffness_mean_of_truth", "stiffness b, % of truth"),
        ("cubic_mean_of_truth", "cubic a, % of truth"),
        ("cubic_scatter_of_truth", "  scatter, %"),
        ("cubic_identifiable_share", "  identified, %"),
        ("published_cubic_mean_of_truth", "as published*, a, %"),
        ("friction_mean_of_truth", "friction, % of truth"),
    ):
        print(f"  {label:24s}{percent(figures[key], 1)}")
    print("  * without hysteresis, which it does not know")
    covered = [v if v is not None else np.nan for v in figures["cubic_coverage_95"]]
    print(f"  {'95 % interval covers a':24s}{percent(covered, 1)}")
    print(f"  held-out loads: linear {1e6 * figures['held_out_error_linear_m']:.1f} um, cubic "
          f"{1e6 * figures['held_out_error_cubic_m']:.1f} um; cubic chosen in "
          f"{100 * figures['cubic_chosen_share']:.0f} %")  # fmt: skip


def settled(config, joints, wrench):
    """Tool pose of cabols_sim's robot at commanded joints under a wrench in base axes."""
    robot = RobotTarget(config)
    robot.encoders[:] = joints
    for _ in range(300):
        robot.step(wrench, 1e-3)
    return robot.position.copy(), robot.rotation.copy()


def compensation(robot, result, truth, model):
    """Share of the deflection that is left, at configurations and loads of no campaign."""
    random = np.random.default_rng(99)
    before, after = [], []
    for joints in bench_configurations()[10:]:
        ideal = robot.forward(joints)
        for _ in range(6):
            load = random.uniform(-1.0, 1.0, 6) * np.array([70, 70, 70, 7, 7, 7])
            found = correct(result, robot, joints, load)
            for command, into in ((joints, before), (found.joints, after)):
                position, rotation = settled(truth, command, load)
                into.append(np.concatenate([position - ideal[0], logarithm(rotation @ ideal[1].T)]))
    size = [np.linalg.norm(np.array(part).reshape(-1, 2, 3), axis=-1) for part in (before, after)]
    left = size[1] / size[0]
    return {
        "model": model,
        "loads": len(before),
        "deflection_rms_m": float(np.sqrt(np.mean(size[0][:, 0] ** 2))),
        "left_rms_m": float(np.sqrt(np.mean(size[1][:, 0] ** 2))),
        "rotation_rms_rad": float(np.sqrt(np.mean(size[0][:, 1] ** 2))),
        "rotation_left_rms_rad": float(np.sqrt(np.mean(size[1][:, 1] ** 2))),
        "removed_worst": float(1.0 - left.max()),
        "removed_median": float(1.0 - np.median(left)),
    }


def print_compensation(figures):
    """One line for each model."""
    print(f"  {figures['model']:24s}{1e6 * figures['deflection_rms_m']:8.1f} um -> "
          f"{1e6 * figures['left_rms_m']:6.2f} um, "
        f"{1e6 * figures['rotation_rms_rad']:8.1f} urad -> "
          f"{1e6 * figures['rotation_left_rms_rad']:6.2f} urad; removed: median "
          f"{100 * figures['removed_median']:.2f} %, worst "
          f"{100 * figures['removed_worst']:.2f} %")  # fmt: skip


def main():
    """Run the bench."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaigns", type=int, default=200)
    parser.add_argument("--cubic-campaigns", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1000, help="of the first campaign")
    arguments = parser.parse_args()

    def say(text):
        print(text, file=sys.stderr, flush=True)

    robot, configurations = bench_robot(), bench_configurations()[:10]
    peaks, _ = optimal_peaks(configurations, PEAKS)
    plan = ramps(configurations, peaks, LEVELS)
    arbitrary = ramps(configurations, random_peaks(robot, configurations, PEAKS, 3), LEVELS)
    scatter = source_scatter()
    report = {"source_scatter_relative": scatter.tolist()}
    print(f"source's own scatter over ten configurations, %: {percent(scatter)}")
    default = Bench(robot, plan)
    for name, bench, count in (
        ("optimal tensions", default, arguments.campaigns),
        ("arbitrary tensions", Bench(robot, arbitrary), -(-arguments.campaigns // 4)),
    ):
        say(name)
        figures = monte_carlo(bench, robot, count, arguments.seed, say)
        print_monte_carlo(name, figures)
        report[name.replace(" ", "_")] = figures
    say("cubic, hysteretic truth")
    truth = harder_truth(default)
    levels = ramps(configurations, peaks, (0.25, 0.5, 0.75, 1.0))
    report["cubic"] = cubic_case(robot, levels, truth, arguments.cubic_campaigns, say)
    print_cubic(report["cubic"])
    say("compensation")
    print("\ncompensation at configurations and loads of no campaign, cabols_sim's robot")
    linear = identify(default.draw(1), robot)
    harder = Bench(robot, levels, replace(truth, hysteresis_torque=[0.0] * 6))
    cases = (
        ("linear", linear, bench_truth()),
        ("cubic", identify(harder.draw(1), robot, "cubic"), harder.truth),
    )
    report["compensation"] = []
    for model, result, config in cases:
        report["compensation"].append(compensation(robot, result, config, model))
        print_compensation(report["compensation"][-1])
    held = validate(linear, Bench(robot, ramps(
        bench_configurations()[10:], random_peaks(robot, bench_configurations()[10:], 4, 8), LEVELS
    )).draw(2), robot)  # fmt: skip
    report["validation"] = {
        "normalised_rms": held.normalised_rms,
        "explained_share": held.explained,
        "error_rms_m": held.error_rms.tolist(),
    }
    print(f"\nother configurations and wrenches: {100 * held.explained:.3f} % of the deflection "
          f"explained, normalised error {held.normalised_rms:.3f}")  # fmt: skip
    verdict(report)
    write_figures(Path("build/bench/stiffness.json"), report)


def verdict(report):
    """Targets and whether they are met."""
    figures, cubic = report["optimal_tensions"], report["cubic"]
    worst = 100 * max(figures["largest_error_relative"])
    low, high = min(figures["coverage_95"]), max(figures["coverage_95"])
    share = max(figures["coverage_95"]), [v for v in cubic["cubic_coverage_95"] if v is not None]
    removed = 100 * min(case["removed_worst"] for case in report["compensation"])
    ratio = np.array(cubic["published_cubic_mean_of_truth"])
    rows = [
        ("every joint, every campaign, largest error", f"{worst:.2f} %", "at most 2 %", worst <= 2),
        ("95 % interval covers, least and most", f"{100 * low:.1f}, {100 * high:.1f} %",
         "90 to 98 %", low >= 0.9 and high <= 0.98),
        ("95 % interval of cubic terms covers, least", f"{100 * min(share[1]):.1f} %",
         "at least 85 %", min(share[1]) >= 0.85),
        ("as published, cubic terms of truth", f"{ratio.min():.2f} to {ratio.max():.2f}",
         "about 1/3", bool(((ratio > 0.2) & (ratio < 0.5)).all())),
        ("held-out error, cubic lower than linear", f"{cubic['held_out_lower_in_all']}",
         "in all campaigns", cubic["held_out_lower_in_all"]),
        ("deflection removed by compensation, worst load", f"{removed:.1f} %", "at least 95 %",
         removed >= 95),
    ]  # fmt: skip
    print()
    for what, value, target, met in rows:
        print(f"{what:50s}{value:20s}{target:18s}{'met' if met else 'NOT MET'}")
    report["met"] = {what: bool(met) for what, _, _, met in rows}


if __name__ == "__main__":
    main()
