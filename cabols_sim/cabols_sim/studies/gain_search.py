# SPDX-License-Identifier: Apache-2.0
"""Search for poles and zero that reach a rise time with the least current, on the full plant."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import differential_evolution

from cabols_control.checks import FloatArray, in_range
from cabols_control.errors import OutOfRangeError
from cabols_control.load_programs.programs import LoadProgram
from cabols_control.rig import Rig
from cabols_control.run_report.judgement.step_response import analyse_steps
from cabols_hw.card.config import CardConfig
from cabols_sim.dynamics.bench_vibration import LOOP_DELAY_S
from cabols_sim.dynamics.loops import design_margins
from cabols_sim.plant.closed_loop import PERIOD_S, Trace, simulate
from cabols_sim.plant.config import PlantConfig

LEAD_S = 0.5
"""Of rest before a programme: the start-up is no step."""
POLE_RANGE, ZERO_RANGE = (15.0, 120.0), (25.0, 150.0)
"""Of real poles and the zero, negated [1/s]."""
OVERSHOOT_MAX, GAIN_MARGIN_MIN, PHASE_MARGIN_MIN_DEG = 0.02, 4.0, 50.0
_OUT = 1e3


@dataclass(frozen=True)
class Judgement:
    """A design on a programme's steps.

    Attributes:
        rise_time: median of the steps [s].
        rise_time_max: slowest step [s].
        overshoot: largest, share of the step.
        peak_current: [A].
    """

    rise_time: float
    rise_time_max: float
    overshoot: float
    peak_current: float


def program_samples(program: LoadProgram) -> FloatArray:
    """(k, 6) desired wrenches of a programme after LEAD_S of rest, one per millisecond."""
    time_s = np.arange(-LEAD_S, program.duration, PERIOD_S)
    return np.array([program.at(float(t)) for t in time_s])


def judge(trace: Trace, rig: Rig) -> Judgement:
    """Reduce a run of the compiled loop to what a design is chosen by.

    Args:
        trace: of a programme of steps.
        rig: its rated wrench decides which changes of the desired one are steps.
    """
    response = analyse_steps(trace.time, trace.desired, trace.measured, rig.control.rated)
    return Judgement(
        rise_time=float(np.median(response.rise_times)),
        rise_time_max=float(response.rise_times.max()),
        overshoot=max(step.overshoot for step in response.steps),
        peak_current=float(np.abs(trace.current).max()),
    )


def redesign(rig: Rig, poles: list[float], zero: float) -> Rig:
    """Return the same rig with other poles and zero.

    Args:
        rig: configuration.
        poles: four of (3.26), with negative real parts [1/s].
        zero: lies at -abs(zero) [1/s].
    """
    return Rig(rig.geometry, rig.limbs, replace(rig.control, poles=poles, zero=zero))


def search(
    rig: Rig,
    card: CardConfig,
    plant: PlantConfig,
    program: LoadProgram,
    rise_max_s: float,
    generations: int = 12,
    seed: int = 1,
    progress: Callable[[str], None] = lambda _text: None,
) -> tuple[list[float], float, Judgement]:
    """Find four real poles and a zero by differential evolution.

    Least peak current among designs whose slowest step is at most rise_max_s long, with an
    overshoot of at most 2 %, and whose limb loops keep 12 dB and 50 deg with LOOP_DELAY_S.

    Args:
        rig: geometry, limbs and limits.
        card: scaling of the card.
        plant: true physics.
        program: whose steps are judged.
        rise_max_s: [s].
        generations: of 40 designs each.
        seed: of the evolution.
        progress: called after every generation.

    Returns:
        Poles and zero [1/s], and the judgement.
    """
    in_range("rise_max_s", rise_max_s, 0.02, 2.0)
    desired = program_samples(program)

    def cost(values: FloatArray) -> float:
        *poles, zero = (-float(value) for value in values)
        try:
            candidate = redesign(rig, poles, zero)
            lacking = _lacking_margins(candidate)
        except OutOfRangeError:
            return _OUT  # the zero is too slow for these poles
        found = judge(simulate(candidate, card, plant, desired), candidate)
        excess = max(found.rise_time_max - rise_max_s, 0.0) / rise_max_s
        excess += max(found.overshoot - OVERSHOOT_MAX, 0.0) + lacking
        value = found.peak_current + 30.0 * excess
        return value if np.isfinite(value) else _OUT

    done = 0

    def tell(best: FloatArray, convergence: float) -> None:
        nonlocal done
        del convergence  # scipy calls it by this name
        done += 1
        text = ", ".join(f"{-value:.1f}" for value in best)
        progress(f"generation {done} of {generations}: poles and zero {text}")

    bounds = [POLE_RANGE] * 4 + [ZERO_RANGE]
    options = {"maxiter": generations, "popsize": 8, "rng": seed, "polish": False}
    best = differential_evolution(cost, bounds, callback=tell, tol=1e-4, **options).x
    *unsorted, zero = (-float(value) for value in best)
    poles = sorted(unsorted)[::-1]
    chosen = redesign(rig, poles, zero)
    return poles, zero, judge(simulate(chosen, card, plant, desired), chosen)


def _lacking_margins(rig: Rig) -> float:
    """By how much the limb loops miss their margins, as shares of them."""
    inner = design_margins(rig.gains, rig.limbs.models, rig.springs.nominal, LOOP_DELAY_S)[1]
    gain = min(margin.gain for margin in inner) / GAIN_MARGIN_MIN
    phase = min(margin.phase for margin in inner) / np.radians(PHASE_MARGIN_MIN_DEG)
    return float(max(1.0 - gain, 0.0) + max(1.0 - phase, 0.0))
