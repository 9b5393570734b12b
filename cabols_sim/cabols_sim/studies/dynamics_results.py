# SPDX-License-Identifier: Apache-2.0
"""Results of the dynamics study: balances, the 900 m case, vibration, margins."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from cabols_control.load_programs.programs import load_program
from cabols_control.rig import Rig, load_rig
from cabols_control.rig_folder import rig_file
from cabols_control.run_report.judgement.step_response import analyse_steps
from cabols_control.run_report.pictures.run_figures import DPI
from cabols_hw.abb.configurations import load_configurations
from cabols_sim.devices.robot.robot_config import load_robot_truth
from cabols_sim.devices.robot.robot_target import RobotTarget
from cabols_sim.dynamics.balance import momentum_imbalance, planar_motion, spatial_motion
from cabols_sim.dynamics.bench_vibration import (
    Held,
    along_program,
    margin_numbers,
    target_cases,
)
from cabols_sim.dynamics.planar_case import (
    Effect,
    Motion,
    case_robot,
    compare,
    models,
    run_case,
    study,
)
from cabols_sim.dynamics.robot import CENTRE, MATERIAL
from cabols_sim.dynamics.vibration import VibrationModel
from cabols_sim.plant.closed_loop import Trace, simulate
from cabols_sim.reproductions import plain
from cabols_sim.reproductions.common import bench
from cabols_sim.studies import dynamics_figures as draw

DESIGNS = {"published": "control.yaml", "fast": "control_fast.yaml"}
STEP_BEGIN = 800
"""Sample of the step in the picture of the steps [ms]."""
STEP_FACTORS = (10.0, 1.0, 0.1, 0.01)
TARGET_FACTORS = (1000.0, 10.0, 1.0, 0.1, 0.01, 0.001)


class Output:
    """Folder of the results; says what takes time."""

    def __init__(self, folder: Path) -> None:
        """Make the folder."""
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._began = time.monotonic()
        self.numbers: dict[str, Any] = {}

    def say(self, text: str) -> None:
        """Say what comes next."""
        print(f"[{time.monotonic() - self._began:5.1f} s] {text}", flush=True)

    def figure(self, name: str, figure: Any) -> None:
        """Write a picture.

        Args:
            name: of its file, without the ending.
            figure: of matplotlib.
        """
        figure.savefig(self._folder / f"{name}.png", dpi=DPI)

    def close(self) -> None:
        """Write the numbers."""
        text = json.dumps(plain(self.numbers), indent=2, allow_nan=False)
        (self._folder / "dynamics.json").write_text(text + "\n", encoding="utf-8")
        self.say(f"figures and dynamics.json are in {self._folder}")


def run_study(place: Path) -> bool:
    """Compute everything and write it.

    Args:
        place: folder of figures and dynamics.json; made where it is missing.

    Returns:
        Whether all power balances close.
    """
    output = Output(place)
    closed = balances(output)
    planar_case(output)
    sensitivity(output)
    vibration(output)
    output.close()
    return closed


def balances(output: Output) -> bool:
    """Free motions of 60 s: power, linear and angular momentum; whether the powers close."""
    output.say("power balance over free motions of 60 s")
    print("  robot    cable model   power      momentum, linear and angular")
    drawn, found = {}, {}
    for name, make in (("planar", planar_motion), ("spatial", spatial_motion)):
        for kind, cable in (("as published", CENTRE), ("material", MATERIAL)):
            free = make(cable)
            motion = free.run()
            linear, angular = momentum_imbalance(free.robot, motion)
            print(
                f"  {name:8} {kind:13} {motion.relative_imbalance:8.1e}   "
                f"{linear:8.1e}   {angular:8.1e}"
            )
            *_, by_stream = motion.work.T
            found[f"{name}, {kind}"] = {
                "power_imbalance_relative": motion.relative_imbalance,
                "linear_momentum_imbalance_relative": linear,
                "angular_momentum_imbalance_relative": angular,
                "stream_energy_j": float(np.abs(by_stream).max()),
                "kinetic_energy_max_j": float(motion.kinetic.max()),
            }
            if cable is MATERIAL:
                drawn[name] = motion
    output.numbers["balance_60_s"] = found
    output.figure("balance", draw.draw_balance(drawn))
    return all(entry["power_imbalance_relative"] <= 1e-6 for entry in found.values())


def planar_case(output: Output) -> None:
    """Section 2.5: forces and tensions by the models."""
    output.say("planar case of section 2.5")
    robot, motion = case_robot(), Motion()
    variants = models(robot, motion)
    runs = {name: run_case(variant, motion) for name, variant in variants.items()}
    output.figure("planar_layout", draw.draw_layout(robot, runs["as published"]))
    output.figure("planar_forces", draw.draw_forces(runs))
    output.figure("planar_tensions", draw.draw_tensions(runs))
    published = runs["as published"]
    print(
        f"  cables of {published.length.min():.0f} to {published.length.max():.0f} m, at most "
        f"{np.abs(published.rate).max():.1f} m/s; tensions {published.tension.min():.0f} to "
        f"{published.tension.max():.0f} N; all feasible: {all(r.feasible for r in runs.values())}"
    )
    print("  against the published model      F [N]  tau_z [N m]  tension [N]")
    found = {}
    for name in ("without (2.28)", "constant mass", "material"):
        effect = compare(published, runs[name], variants["as published"], motion)
        print(f"  {name:26} {effect.force:11.1f} {effect.torque:12.0f} {effect.tension:12.1f}")
        found[name] = _effect_numbers(effect)
    output.numbers["planar_case_against_published"] = found


def sensitivity(output: Output) -> None:
    """Density, size and speed, one at a time."""
    output.say("planar case: density, size and pace varied (some 10 s)")
    effects = study()
    output.figure("planar_study", draw.draw_study(effects))
    print(
        "  largest tension difference [N], percent of the largest tension\n"
        "  density   radius  fastest cable   (2.28)          constant mass    published\n"
        "                                    left out        for material     for material"
    )
    for rows in effects.values():
        for stream, constant, published in rows:
            cells = "".join(
                f"{e.tension:9.1f} {e.tension_percent:5.2f} %"
                for e in (stream, constant, published)
            )
            print(
                f"  {stream.density:.4f} {stream.radius:8.0f} m {stream.peak_rate:8.1f} m/s {cells}"
            )
    output.numbers["planar_study"] = {
        name: [
            {
                "without_2_28": _effect_numbers(row[0]),
                "constant_for_material": _effect_numbers(row[1]),
                "published_for_material": _effect_numbers(row[2]),
            }
            for row in rows
        ]
        for name, rows in effects.items()
    }


def _effect_numbers(effect: Effect) -> dict[str, float]:
    return {
        "density_kg_per_m": effect.density,
        "base_radius_m": effect.radius,
        "move_s": effect.move_s,
        "peak_cable_rate_m_per_s": effect.peak_rate,
        "force_n": effect.force,
        "force_percent_of_inertial": effect.force_percent,
        "torque_nm": effect.torque,
        "tension_n": effect.tension,
        "tension_percent": effect.tension_percent,
    }


def vibration(output: Output) -> None:
    """Modes of the bench along a programme; loops and targets."""
    output.say("vibration of the bench, margins of both designs")
    rigs = {name: load_rig(control=rig_file(file)) for name, file in DESIGNS.items()}
    held, rig = held_by_robot(), rigs["published"]
    program = load_program("multi_axis")
    frequencies = along_program(rig, held, program)
    margins = {name: margin_numbers(each) for name, each in rigs.items()}
    crossover = margins["fast"]["limb_crossover_rad_per_s"]
    output.figure("frequencies", draw.draw_frequencies(frequencies, crossover))
    output.figure("loops", draw.draw_loops(rigs))
    for label, values in (
        ("in the robot's hand", frequencies.held),
        ("on the springs alone", frequencies.free),
        ("cables as strings", frequencies.string),
    ):
        low, high = values.min(axis=0) / (2.0 * np.pi), values.max(axis=0) / (2.0 * np.pi)
        text = ", ".join(f"{a:.1f}-{b:.1f}" for a, b in zip(low, high, strict=True))
        print(f"  natural frequencies along multi_axis, {label}: {text} Hz")
    tension = frequencies.tension.mean(axis=0)
    hands = [held_by_robot(index) for index in range(len(load_configurations()))]
    hertz = np.array([hand.vibration(rig, tension).modes()[0] for hand in hands]) / (2.0 * np.pi)
    ranges = zip(hertz.min(axis=0), hertz.max(axis=0), strict=True)
    text = ", ".join(f"{low:.1f}-{high:.1f}" for low, high in ranges)
    print(f"  over the robot's {len(hands)} configurations: {text} Hz")
    output.numbers["natural_frequencies_over_configurations_hz"] = hertz.tolist()
    middle = held.vibration(rig, tension)
    shares = 100.0 * middle.shares()
    print("  elastic energy of the modes in the robot's hand, target / springs / tensions [%]:")
    print("    " + ", ".join(" / ".join(f"{v:.1f}" for v in row) for row in shares))
    output.numbers["natural_frequencies_hz"] = {
        "held": (frequencies.held / (2.0 * np.pi)).tolist(),
        "free": (frequencies.free / (2.0 * np.pi)).tolist(),
    }
    output.numbers["margins"] = margins
    for name, numbers in margins.items():
        print(
            f"  {name:9} wrench loop: {numbers['wrench_gain_margin_db']:.1f} dB, "
            f"{numbers['wrench_phase_margin_deg']:.0f} deg; limb loops: "
            f"{numbers['limb_gain_margin_db']:.1f} and "
            f"{numbers['limb_gain_reduction_margin_db']:.1f} dB, "
            f"{numbers['limb_phase_margin_deg']:.0f} deg, "
            f"{numbers['limb_delay_margin_ms']:.1f} ms more delay"
        )
    output.figure("steps", draw.draw_steps(_steps(rigs), rigs, STEP_BEGIN))
    _targets(output, rigs, middle)
    _ringing(output, rigs, middle)


def _steps(
    rigs: dict[str, Rig], target: VibrationModel | None = None, hold: int = 700
) -> dict[str, Trace]:
    """A step of 40 N in f_x by every design, on the full plant in the compiled loop."""
    setup = bench()
    desired = np.zeros((STEP_BEGIN + hold, 6))
    desired[STEP_BEGIN:, 0] = 40.0
    return {
        name: simulate(rig, setup.card, setup.plant, desired, vibration=target)
        for name, rig in rigs.items()
    }


def _ringing(output: Output, rigs: dict[str, Rig], middle: VibrationModel) -> None:
    print("  step of 40 N on the full plant with a vibrating target:")
    found = []
    for factor in (None, *STEP_FACTORS):
        target = None if factor is None else middle.with_target(factor)
        for name, trace in _steps(rigs, target, 3000).items():
            rated = rigs[name].control.rated
            response = analyse_steps(trace.time, trace.desired, trace.measured, rated)
            step = response.steps[0]
            row = {
                "design": name,
                "target_of_robot_ratio": factor,
                "rise_time_s": step.rise_time,
                "overshoot_percent": 100.0 * step.overshoot,
                "cross_coupling_percent": 100.0 * float(response.cross_coupling.max()),
                "current_peak_a": float(np.abs(trace.current).max()),
            }
            found.append(row)
            label = "rigid" if factor is None else f"{factor:g} of the robot"
            print(
                f"    {label:18} {name:9} rise {row['rise_time_s']:.3f} s, overshoot "
                f"{row['overshoot_percent']:.2f} %, cross-coupling "
                f"{row['cross_coupling_percent']:.2f} %, {row['current_peak_a']:.2f} A"
            )
    output.numbers["steps_on_targets"] = found


def _targets(output: Output, rigs: dict[str, Rig], middle: VibrationModel) -> None:
    print(
        "  target / robot   first mode   design      epsilon  slow poles off  fast poles off"
        "  may be scaled  ended by        stable to"
    )
    found = []
    for name, rig in rigs.items():
        for case in target_cases(rig, rig.control, middle, TARGET_FACTORS):
            hertz = case.first_mode / (2.0 * np.pi)
            print(
                f"  {case.factor:10g} {hertz:14.1f} Hz   {name:9} {case.split.epsilon:9.3f} "
                f"{100 * case.split.slow_error:13.2f} % {100 * case.split.fast_error:13.2f} % "
                f"{case.fastest.scale:13.2f}  {case.fastest.limited_by:15} "
                f"{case.fastest.stable_scale:.2f}"
            )
            found.append(
                {
                    "design": name,
                    "target_of_robot_ratio": case.factor,
                    "first_mode_hz": hertz,
                    "stable": case.split.stable,
                    "epsilon": case.split.epsilon,
                    "slow_poles_error_percent": 100.0 * case.split.slow_error,
                    "fast_poles_error_percent": 100.0 * case.split.fast_error,
                    "scale_with_margins": case.fastest.scale,
                    "scale_ended_by": case.fastest.limited_by,
                    "scale_stable": case.fastest.stable_scale,
                }
            )
    output.numbers["targets"] = found


def held_by_robot(index: int = 0) -> Held:
    """Return the bench's platform in its robot's hand, at a stored configuration."""
    position, rotation, jacobian = RobotTarget().arm.solve(load_configurations().joints(index))
    config = load_robot_truth()
    return Held(
        position,
        rotation,
        jacobian,
        np.array(config.stiffness),
        bench().card.tool_mass,
    )
