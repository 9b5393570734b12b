# SPDX-License-Identifier: Apache-2.0
"""Figure 3.8: tension step of one limb with three poles at -10 1/s, with and without its spring."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy import signal

from cabols_control.checks import FloatArray
from cabols_control.gains import limb_gains
from cabols_control.run_report.judgement.step_response import rise_time
from cabols_control.run_report.pictures.run_figures import new_figure, tidy
from cabols_control.run_report.section import ReportSection
from cabols_sim.plant.config import LimbPlantConfig
from cabols_sim.reproductions.common import (
    K_CABLE,
    K_SPRING,
    PERIOD_S,
    LimbTrace,
    bench,
    control_limb,
    without_spring,
)

LIMB = 0
POLES = (-10.0, -10.0, -10.0)
LOW_N, HIGH_N = 10.0, 60.0
UP_S, DOWN_S, END_S = 0.5, 3.0, 5.5
GEAR_FRICTION_A, GEAR_BACKLASH_M = 0.06, 0.0005
"""Of the second gear: 2 % of the rated current, half a millimetre at the cable."""


@dataclass(frozen=True)
class StepFigures:
    """What a trace shows; shares are of the step.

    Attributes:
        deviation: largest of true tension from the model.
        deviation_estimate: largest of estimated tension from the model.
        estimation_error: largest of estimated from true tension.
        end_error: true tension minus command at the end, after the step down.
        rise_time: true tension, 10 to 90 % of the step up [s].
    """

    deviation: float
    deviation_estimate: float
    estimation_error: float
    end_error: float
    rise_time: float


def _command() -> FloatArray:
    time = np.arange(round(END_S / PERIOD_S)) * PERIOD_S
    return np.where((time >= UP_S) & (time < DOWN_S), HIGH_N, LOW_N)


def model_response(time: FloatArray, command: FloatArray) -> FloatArray:
    """1000/(s + 10)^3 on a command held between samples, from rest at its first value; by scipy.

    Args:
        time: (k,) evenly spaced [s].
        command: (k,) [N].

    Returns:
        (k,) tension [N].
    """
    system = ([-np.prod(POLES)], np.real(np.poly(POLES)))
    numerator, denominator, _ = signal.cont2discrete(system, time[1] - time[0])
    change = signal.lfilter(numerator[0], denominator, command - command[0])
    return np.asarray(command[0] + change)


def run_step(limbs: LimbPlantConfig, limb: int, k_e: float) -> LimbTrace:
    """Step a limb's tension up and down again.

    Args:
        limbs: true physics of all limbs, with springs.
        limb: index from 0.
        k_e: stiffness that the limb law is designed for [N/m]; with any other than K_SPRING the
            limbs run without their springs.
    """
    gains = limb_gains(bench().rig.limbs.models[limb], k_e, POLES)
    fitted = limbs if k_e == K_SPRING else without_spring(limbs)
    return control_limb(fitted, limb, gains, k_e, _command())


def judge(trace: LimbTrace) -> StepFigures:
    """Compare a trace with the model."""
    size = HIGH_N - LOW_N
    model = model_response(trace.time, trace.command)
    up = slice(round(UP_S / PERIOD_S), round(DOWN_S / PERIOD_S))
    return StepFigures(
        deviation=float(np.abs(trace.tension - model).max() / size),
        deviation_estimate=float(np.abs(trace.estimate - model).max() / size),
        estimation_error=float(np.abs(trace.estimate - trace.tension).max() / size),
        end_error=float((trace.tension[-100:].mean() - LOW_N) / size),
        rise_time=rise_time(trace.time[up], trace.tension[up], LOW_N, HIGH_N),
    )


def reproduce_tension_step() -> ReportSection:
    """Step limb 1 on two gears, with and without spring; all limbs on the bench's gear."""
    setup = bench()
    bench_gear = setup.plant.limbs
    gears = {
        "bench gear": bench_gear,
        "rougher gear": replace(
            bench_gear, coulomb_current=GEAR_FRICTION_A, backlash=GEAR_BACKLASH_M
        ),
    }
    springs = {"with spring": K_SPRING, "without spring": K_CABLE}
    traces = {
        (gear, spring): run_step(limbs, LIMB, k_e)
        for gear, limbs in gears.items()
        for spring, k_e in springs.items()
    }
    found = {case: judge(trace) for case, trace in traces.items()}
    numbers: dict[str, object] = {"rise_time_model_s": _model_rise_time()}
    for (gear, spring), figures in found.items():
        key = f"{gear}_{spring}".replace(" ", "_")
        numbers[f"deviation_{key}_percent"] = 100.0 * figures.deviation
        numbers[f"deviation_of_estimate_{key}_percent"] = 100.0 * figures.deviation_estimate
        numbers[f"estimation_error_{key}_percent"] = 100.0 * figures.estimation_error
        numbers[f"end_error_{key}_percent"] = 100.0 * figures.end_error
        numbers[f"rise_time_{key}_s"] = figures.rise_time
    for spring, k_e in springs.items():
        all_limbs = [judge(run_step(bench_gear, limb, k_e)) for limb in range(len(bench_gear.gain))]
        key = spring.replace(" ", "_")
        numbers[f"deviation_all_limbs_{key}_percent"] = [100.0 * f.deviation for f in all_limbs]
        numbers[f"rise_time_all_limbs_{key}_s"] = [f.rise_time for f in all_limbs]
    rows = tuple(_row(*case, figures) for case, figures in found.items())
    header = (
        "",
        "",
        "rise [s]",
        "true from model [%]",
        "estimate from model [%]",
        "estimate from true [%]",
        "error left at the end [%]",
    )
    data = {}
    for (gear, spring), trace in traces.items():
        key = f"{gear}_{spring}".replace(" ", "_")
        data[f"tension_{key}"], data[f"estimate_{key}"] = trace.tension, trace.estimate
    return ReportSection(
        "tension_step",
        "Figure 3.8: tension step of one limb with and without its spring",
        _text(found, numbers),
        numbers,
        header,
        rows,
        _draw(traces, found, gears),
        data,
    )


def _model_rise_time() -> float:
    time = np.arange(0.0, 3.0, PERIOD_S)
    command = np.where(time > 0.0, 1.0, 0.0)
    return rise_time(time, model_response(time, command), 0.0, 1.0)


def _row(gear: str, spring: str, f: StepFigures) -> tuple[str, ...]:
    shares = (f.deviation, f.deviation_estimate, f.estimation_error, f.end_error)
    return (gear, spring, f"{f.rise_time:.3f}", *(f"{100.0 * share:.1f}" for share in shares))


def _text(found: dict[tuple[str, str], StepFigures], numbers: dict[str, object]) -> str:
    def percent(gear: str, spring: str) -> str:
        return f"{100.0 * found[gear, spring].deviation:.0f} %"

    rough = found["rougher gear", "without spring"]
    return (
        f"Limb 1, poles -10, -10, -10 1/s, {LOW_N:g} to {HIGH_N:g} N and back, gains by (3.15) for "
        "k_e = 2.20 and 10.72 N/mm; the model is 1000/(s + 10)^3 by scipy, rise "
        f"{numbers['rise_time_model_s']:.3f} s. Largest deviation of the true tension, as a share "
        f"of the step: {percent('bench gear', 'with spring')} with the spring and "
        f"{percent('bench gear', 'without spring')} without on the bench's gear; "
        f"{percent('rougher gear', 'with spring')} and {percent('rougher gear', 'without spring')} "
        f"on a gear of this experiment's own with {GEAR_FRICTION_A:g} A of dry friction and "
        f"{1e3 * GEAR_BACKLASH_M:g} mm of backlash. Without the spring the motor needs so "
        "little current that dry friction holds it until the integral has grown (the late starts), "
        "and the backlash is worth k_e times its width in tension, unseen by the encoder: "
        f"{100.0 * abs(rough.end_error):.0f} % of the step stay as an error after the step down. "
        "10 to 90 % rise times hardly show it, as they begin after the late start."
    )


def _draw(
    traces: dict[tuple[str, str], LimbTrace],
    found: dict[tuple[str, str], StepFigures],
    gears: dict[str, LimbPlantConfig],
) -> Figure:
    figure = new_figure(11.0, 6.6)
    grid = figure.subplots(2, 2, sharex=True, sharey=True)
    for (case, trace), axes in zip(traces.items(), grid.flat, strict=True):
        gear, spring = case
        _draw_case(axes, trace)
        k_e = 2.20 if spring == "with spring" else 10.72
        limbs = gears[gear]
        axes.set_title(
            f"{spring} ({k_e:.2f} N/mm), {gear}: {limbs.coulomb_current:g} A, "
            f"{1e3 * limbs.backlash:g} mm",
            fontsize=10.5,
        )
        axes.annotate(
            f"largest deviation\n{100.0 * found[case].deviation:.1f} % of the step",
            (0.62, 0.55),
            xycoords="axes fraction",
            fontsize=10,
        )
    left, *_ = grid.T
    for axes in left:
        axes.set_ylabel("tension [N]")
    for axes in grid[1]:
        axes.set_xlabel("time [s]")
    grid[0, 0].legend(loc=(0.22, 0.06), fontsize=9)
    return figure


def _draw_case(axes: Axes, trace: LimbTrace) -> None:
    axes.plot(trace.time, trace.tension, color="#d95f02", lw=2.2, label="true tension")
    axes.plot(trace.time, trace.estimate, color="#1f77b4", lw=1.2, label="estimate (3.9)")
    model = model_response(trace.time, trace.command)
    axes.plot(trace.time, model, "--", color="#2ca02c", lw=1.4, label="$1000/(s+10)^3$")
    tidy(axes)
