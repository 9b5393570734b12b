# SPDX-License-Identifier: Apache-2.0
"""Error against the command in the compiled loop: by feedback alone, and with preview.

Each programme runs on the full plant as designed, and on plants that differ from what the rig's
files say: gains and time constants of the motors by up to 20 %, k_e by 5 %, attachment points by
2 mm, sensor gains by 0.5 % and cross-talk by 1 %, friction doubled. Then each rig repeats its
programme and learns, LEARNING times. With `--commissioned` each rig that differs is commissioned
first, by the ramps of `commission --backlash` on its own plant: k_e and the gears' play are then
what it has found itself. Printed is the rms of the axis that is commanded, against the
sensor and against the truth, and of the other axes together; and how many of the samples, axis by
axis, have the truth within the uncertainty that the rig states. A run that was stopped goes on
where it was (`--fresh` begins anew); the commits of the kept runs are written with the figures.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "harness"))

from record import circumstances, write_figures

from cabols_control.frames import load_wrench_frames, load_wrench_uncertainty
from cabols_control.geometry import RigGeometry
from cabols_control.load_programs.learning import apply_learnt, learn, nothing_learnt
from cabols_control.load_programs.motor_demand import fastest_preview
from cabols_control.load_programs.preview import as_given
from cabols_control.load_programs.programs import LoadProgram
from cabols_control.rig import Rig, load_rig
from cabols_hw.card.config import CardConfig, load_card
from cabols_sim.plant.closed_loop import PERIOD_S, Mismatch, Trace, simulate
from cabols_sim.plant.config import PlantConfig, load_plant
from commissioned import commission_ramps
from line_journal import LineJournal

SETTLE_S = 1.5
"""At rest before the programme: the start of a load is not what is judged."""
LIMB_SPREAD, STIFFNESS_SPREAD, POINT_M = 0.2, 0.05, 0.002
GAIN_SPREAD, CROSS_TALK, FRICTION = 0.005, 0.01, 2.0
LEARNING = 5
"""Runs that are learnt from before the one that is judged."""
FORM = "with_uncertainty"
"""Of the runs that are kept."""
TOLD_EVERY = 10
"""Samples between two uncertainties, as a rig tells them."""
AXES = ("fx", "fy", "fz", "mx", "my", "mz")


@dataclass(frozen=True)
class Case:
    """A programme and what its error should be.

    Attributes:
        name: for the table.
        program: makes it.
        axis: that is judged; -1: the worst force and torque axis of all, against the smoothed
            command.
        target: rms to reach with preview [N or N m].
        learnt: and after LEARNING runs.
    """

    name: str
    program: Callable[[], LoadProgram]
    axis: int
    target: float
    learnt: float


def sine(axis: int, amplitude: float, frequency: float) -> Callable[[], LoadProgram]:
    """A sine of at least four periods and 4 s, faded in and out over one."""

    def make() -> LoadProgram:
        duration = max(4.0, 4.0 / frequency)
        time = np.arange(0.0, duration, PERIOD_S)
        fade = np.clip(np.minimum(time, duration - time) * frequency, 0.0, 1.0)
        wrench = np.zeros((time.size, 6))
        wrench[:, axis] = amplitude * fade * np.sin(2.0 * np.pi * frequency * time)
        return LoadProgram(f"{AXES[axis]} {frequency:g} Hz", time, wrench, held=False)

    return make


def gait() -> LoadProgram:
    """A double bump as of a walking step, 100 N along z at 1 Hz, six steps."""
    time = np.arange(0.0, 6.0, PERIOD_S)
    phase = (time % 1.0) / 0.6
    stance = np.clip(phase, 0.0, 1.0)
    shape = np.sin(np.pi * stance) ** 2 * (1.0 - 0.35 * np.sin(np.pi * stance) ** 8)
    wrench = np.zeros((time.size, 6))
    wrench[:, 2] = 100.0 * shape / shape.max()
    return LoadProgram("gait", time, wrench, held=False)


CASES = (
    Case("+-8 N m about x, 0.1 Hz", sine(3, 8.0, 0.1), 3, 0.02, 0.005),
    Case("+-8 N m about x, 1 Hz", sine(3, 8.0, 1.0), 3, 0.06, 0.016),
    Case("+-8 N m about x, 2 Hz", sine(3, 8.0, 2.0), 3, 0.08, 0.02),
    Case("+-60 N along x, 0.3 Hz", sine(0, 60.0, 0.3), 0, 0.15, 0.05),
    Case("+-60 N along z, 0.3 Hz", sine(2, 60.0, 0.3), 2, 0.15, 0.05),
    Case("+-60 N along x, 1 Hz", sine(0, 60.0, 1.0), 0, 0.3, 0.12),
    Case("+-5 N along x, 5 Hz", sine(0, 5.0, 5.0), 0, 0.5, 0.1),
    Case("gait, 100 N along z, 1 Hz", gait, 2, 1.0, 0.3),
)


def wrong_rig(rig: Rig, plant: PlantConfig, seed: int) -> tuple[PlantConfig, Mismatch]:
    """A plant and a mismatch that the rig does not know of, drawn by a seed."""
    random = np.random.default_rng(seed)
    n = rig.geometry.cables

    def near(spread: float, *shape: int) -> np.ndarray:
        return 1.0 + spread * random.uniform(-1.0, 1.0, shape)

    limbs = plant.limbs
    limbs = replace(
        limbs,
        gain=(np.array(limbs.gain) * near(LIMB_SPREAD, n)).tolist(),
        time_constant=(np.array(limbs.time_constant) * near(LIMB_SPREAD, n)).tolist(),
        spring_stiffness=limbs.spring_stiffness * float(near(STIFFNESS_SPREAD)),
        coulomb_current=FRICTION * limbs.coulomb_current,
        viscous_current=FRICTION * limbs.viscous_current,
    )
    points = [
        place + POINT_M / np.sqrt(3.0) * random.uniform(-1.0, 1.0, place.shape)
        for place in (rig.geometry.base_points, rig.geometry.platform_points)
    ]
    geometry: RigGeometry = replace(rig.geometry, base_points=points[0], platform_points=points[1])
    # A newton metre stands beside ten newtons, as in the sensor's ranges.
    scale = np.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.1])
    sensor = np.diag(near(GAIN_SPREAD, 6)) + CROSS_TALK * random.uniform(-1.0, 1.0, (6, 6)) * (
        1.0 - np.eye(6)
    ) * np.outer(scale, 1.0 / scale)
    return replace(plant, limbs=limbs), Mismatch(geometry, sensor)


@dataclass(frozen=True, eq=False)
class Setup:
    """Files of a rig and of its simulation.

    Attributes:
        rig: as its files say, or commissioned.
        card: of the rig.
        plant: as the rig's files say, of which wrong ones are drawn.
        built: the rig of which they are drawn; None: `rig`.
    """

    rig: Rig
    card: CardConfig
    plant: PlantConfig
    built: Rig | None = None


@cache
def commissioned_setup(setup: Setup, seed: int) -> Setup:
    """The files of a rig that was built by a seed, and has been commissioned."""
    plant, wrong = wrong_rig(setup.rig, setup.plant, seed)
    found = commission_ramps(setup.rig, setup.card, plant, wrong, seed)
    return replace(setup, rig=found, built=setup.rig)


def kept_run(
    kept: LineJournal, setup: Setup, case: Case, preview: bool, seed: int | None, cycles: int = 0
) -> list[dict[str, float]]:
    """Errors as `run` gives them; of the journal if it has them.

    Args:
        kept: of this design.
        setup: as `run`.
        case: as `run`.
        preview: as `run`.
        seed: as `run`.
        cycles: as `run`.
    """
    key = f"{case.name}, {preview}, {seed}, {cycles}"
    if key not in kept.found:
        found = run(setup, case, preview, seed, cycles)
        kept.add(key, cycles=found, commit=circumstances()["commit"])
    return list(kept.found[key]["cycles"])


def run(
    setup: Setup, case: Case, preview: bool, seed: int | None, cycles: int = 0
) -> list[dict[str, float]]:
    """Errors of a run, and of those after it, which learn; seed None: plant and rig agree."""
    rig, program = setup.rig, case.program()
    place = (rig.geometry.reference_position, rig.geometry.reference_rotation)
    shaped = fastest_preview(program, rig, *place) if preview else as_given(program)
    rest = np.zeros((round(SETTLE_S / PERIOD_S), 6))
    plant, mismatch = setup.plant, None
    if seed is not None:
        plant, mismatch = wrong_rig(setup.built or rig, plant, seed)
    learnt, followed, found = nothing_learnt(shaped, "", *place), shaped, []
    for cycle in range(cycles + 1):
        reference = followed.reference.sample(np.arange(0.0, shaped.duration, PERIOD_S))
        desired = np.vstack([rest, reference])
        # Another noise in every cycle.
        trace = simulate(
            rig, setup.card, plant, desired, 1000 * cycle + (seed or 0), mismatch=mismatch
        )
        found.append(errors(trace, program, shaped.lead, rest.shape[0], case.axis))
        found[-1] |= stated(rig, trace, rest.shape[0])
        if cycle < cycles:
            start = rest.shape[0]
            felt = trace.measured[start:] - trace.measured[start - 500 : start].mean(axis=0)
            learnt, forgotten = learn(learnt, shaped, trace.time[: felt.shape[0]], felt)
            found[-1]["forgotten"] = float(forgotten)
            followed = apply_learnt(shaped, learnt, rig, 0.0)
    return found


def errors(
    trace: Trace, program: LoadProgram, lead: float, start: int, axis: int
) -> dict[str, float]:
    """Rms of the commanded axis and of the others, and what it took."""
    time = trace.time[start:] - trace.time[start] - lead
    command = program.sample(time)
    ran = (time >= 0.0) & (time <= program.duration)
    measured, true = trace.measured[start:], trace.wrench[start:]
    # The sensor's bias is tared on a rig: it is the mean at rest here.
    rest = trace.measured[start - 500 : start].mean(axis=0)
    rest_true = trace.wrench[start - 500 : start].mean(axis=0)
    error = (measured - rest - command)[ran]
    true_error = (true - rest_true - command)[ran]
    others = [k for k in range(6) if k != axis]
    square = np.mean(error**2, axis=0)
    return {
        "sensor": float(np.sqrt(square[axis])),
        "true": float(np.sqrt(np.mean(true_error[:, axis] ** 2))),
        "off_force_n": float(np.sqrt(sum(square[k] for k in others if k < 3))),
        "off_torque_nm": float(np.sqrt(sum(square[k] for k in others if k >= 3))),
        "peak": float(np.abs(measured[ran, axis]).max() / np.abs(program.wrench[:, axis]).max()),
        "current_a": float(np.abs(trace.current[start:]).max()),
        "infeasible": int((trace.status[start:] != 0).sum()),
    }


def stated(rig: Rig, trace: Trace, start: int) -> dict[str, float]:
    """Share of samples whose truth is within the stated uncertainty, and how wide that is."""
    geometry = rig.geometry
    known = load_wrench_uncertainty(load_wrench_frames(geometry))
    known.tell_tare(geometry.reference_rotation.T @ [0.0, 0.0, -1.0])
    rest = (trace.measured - trace.wrench)[start - 500 : start].mean(axis=0)
    rows = slice(start, None, TOLD_EVERY)
    measured = trace.measured[rows] - rest
    turn, still = np.array(geometry.reference_rotation), np.zeros(3)
    wide = np.array([known.of("", None, turn, still, wrench) for wrench in measured])
    within = np.abs(measured - trace.wrench[rows]) <= wide
    return {
        "within": float(within.mean()),
        "within_worst_axis": float(within.mean(axis=0).min()),
        "uncertainty_n": float(np.percentile(wide[:, :3], 95.0)),
        "uncertainty_nm": float(np.percentile(wide[:, 3:], 95.0)),
    }


def spread(runs: list[dict[str, float]]) -> dict[str, Any]:
    """Median, largest and mean of each figure."""
    return {
        key: {
            "median": float(np.median([r[key] for r in runs])),
            "max": max(r[key] for r in runs),
            "mean": float(np.mean([r[key] for r in runs])),
        }
        for key in runs[0]
    }


def line(name: str, what: str, found: dict[str, Any], target: str = "") -> str:
    """One line of the table."""
    return (
        f"{name:27} {what:22} {found['sensor']['median']:7.3f} {found['sensor']['max']:7.3f} "
        f"{found['true']['median']:7.3f} {found['off_force_n']['median']:7.3f} "
        f"{found['off_torque_nm']['median']:7.4f} {found['current_a']['max']:6.2f} "
        f"{found['uncertainty_n']['median']:6.2f} {found['uncertainty_nm']['median']:6.3f} "
        f"{100.0 * found['within']['mean']:6.1f}  {target}"
    )


def report(case: Case, rows: dict[str, Any], name: str, runs: list[list[dict[str, float]]]) -> None:
    """Print and keep what learning made of the runs of one or more rigs, cycle by cycle."""
    if not runs:
        return
    last = rows[name] = spread([cycles[-1] for cycles in runs])
    each = np.median([[cycle["sensor"] for cycle in cycles] for cycles in runs], axis=0)
    rows[f"{name}, each cycle"] = each.tolist()
    rows[f"{name}, forgotten"] = sum(c.get("forgotten", 0.0) for cycles in runs for c in cycles)
    rows[f"{name}, met"] = met = bool(last["sensor"]["median"] <= case.learnt)
    verdict = f"to reach {case.learnt:g}: {'met' if met else 'NOT met'}; "
    verdict += ", ".join(f"{value:.3f}" for value in each)
    print(line(case.name, f"{name} ({len(runs)})", last, verdict), flush=True)


def main() -> None:
    """Print and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("build/bench/tracking.json"))
    parser.add_argument("--seeds", type=int, default=20, help="wrong rigs, at least 1")
    parser.add_argument("--only", default="", help="cases with this in their name")
    parser.add_argument("--gains", default="", help="YAML of another design, such as control_fast")
    parser.add_argument("--backlash", type=float, default=0.0, help="that the limb law knows [m]")
    parser.add_argument("--commissioned", action="store_true", help="wrong rigs have been")
    parser.add_argument("--preview-delay", type=float, help="in place of the design's [s]")
    parser.add_argument("--fresh", action="store_true", help="forget the runs that are kept")
    arguments = parser.parse_args()
    design = Path(arguments.gains or "control").stem
    if arguments.backlash:
        design += f".backlash_{1e6 * arguments.backlash:g}_um"
    if arguments.preview_delay is not None:
        design += f".delay_{1e3 * arguments.preview_delay:g}_ms"
    if arguments.commissioned:
        design += ".commissioned"
    kept = LineJournal(arguments.output.with_suffix(f".{design}.{FORM}.jsonl"), arguments.fresh)
    rig = load_rig(control=arguments.gains or None)
    rig = replace(rig, limbs=replace(rig.limbs, backlash=arguments.backlash))
    if arguments.preview_delay is not None:
        rig = replace(rig, control=replace(rig.control, preview_delay=arguments.preview_delay))
    setup = Setup(rig, load_card(), load_plant())
    print("rms in N or N m: median and largest against the sensor, against the truth, other axes;")
    print("stated uncertainty, and the samples within it of the truth")
    print(
        f"{'':50} {'sensor':>7} {'worst':>7} {'truth':>7} {'off N':>7} "
        f"{'off N m':>7} {'A':>6} "
        f"{'+- N':>6} {'+- N m':>6} {'in %':>6}"
    )
    figures: dict[str, Any] = {}
    for case in CASES:
        if arguments.only not in case.name:
            continue
        rows = figures[case.name] = {"target": case.target, "learnt target": case.learnt}
        for preview in (False, True):
            name = "preview" if preview else "feedback"
            exact = spread(kept_run(kept, setup, case, preview, None))
            rows[name] = exact
            print(line(case.name, name, exact), flush=True)
        report(case, rows, "learnt", [kept_run(kept, setup, case, True, None, LEARNING)])
        own = partial(commissioned_setup, setup) if arguments.commissioned else lambda _: setup
        wrong = [
            kept_run(kept, own(seed), case, True, seed, LEARNING) for seed in range(arguments.seeds)
        ]
        first = rows["preview, mismatch"] = spread([cycles[0] for cycles in wrong])
        rows["met"] = bool(first["sensor"]["median"] <= case.target)
        verdict = f"to reach {case.target:g}: {'met' if rows['met'] else 'NOT met'}"
        print(line(case.name, f"preview, {arguments.seeds} wrong rigs", first, verdict), flush=True)
        report(case, rows, "learnt, mismatch", wrong)
    commits = sorted({entry["commit"] for entry in kept.found.values()})
    write_figures(arguments.output, {"runs of commits": commits, **figures})


if __name__ == "__main__":
    main()
