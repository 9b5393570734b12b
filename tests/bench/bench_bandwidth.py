# SPDX-License-Identifier: Apache-2.0
"""Bandwidth of every axis by feedback alone, margins beside it; and steps with preview.

The compiled loop with the whole plant (friction, backlash, converters, noise) follows sines of 5 N
or 0.5 N m along one axis after the other. Printed for each design: gain at each frequency and where
it falls by 3 dB, the peak current at each frequency, gain and phase margins of the loops with the
delay that docs/dynamics.md assumes, and the rise from 10 to 90 % of a step of 40 N or 4 N m with
preview.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from record import write_figures

from cabols_control.load_programs.motor_demand import fastest_preview
from cabols_control.load_programs.programs import LoadProgram
from cabols_control.rig import Rig, load_rig
from cabols_control.rig_folder import find_rig
from cabols_control.run_report.judgement.step_response import rise_time
from cabols_hw.card.config import load_card
from cabols_sim.dynamics.bench_vibration import margin_numbers
from cabols_sim.plant.closed_loop import PERIOD_S, Trace, simulate
from cabols_sim.plant.config import load_plant

AXES = ("fx", "fy", "fz", "mx", "my", "mz")
SIZES = (5.0, 5.0, 5.0, 0.5, 0.5, 0.5)
STEPS = (40.0, 40.0, 40.0, 4.0, 4.0, 4.0)
FREQUENCIES = (0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
SETTLE_S, KEPT_S = 1.5, 2.0
LIMIT_HZ, LIMIT_A = 5.0, 3.0
HALF_DB = -3.0


def run(rig: Rig, desired: np.ndarray) -> Trace:
    """The whole loop of the bench, from rest."""
    rest = np.zeros((round(SETTLE_S / PERIOD_S), 6))
    return simulate(rig, load_card(), load_plant(), np.vstack([rest, desired]))


def line(values: np.ndarray, frequency: float) -> complex:
    """Amplitude and phase of a signal at a frequency, over whole periods."""
    time = PERIOD_S * np.arange(values.size)
    return complex(2.0 * np.mean(values * np.exp(-2j * np.pi * frequency * time)))


def followed(rig: Rig, axis: int, frequency: float) -> tuple[complex, float]:
    """Response to a sine, and the peak current meanwhile [A]."""
    lead, periods = np.ceil(SETTLE_S * frequency) / frequency, np.ceil(KEPT_S * frequency)
    time = np.arange(0.0, lead + periods / frequency, PERIOD_S)
    desired = np.zeros((time.size, 6))
    desired[:, axis] = SIZES[axis] * np.sin(2.0 * np.pi * frequency * time)
    trace = run(rig, desired)
    kept = round(periods / frequency / PERIOD_S)
    wanted, got = desired[-kept:, axis], trace.measured[-kept:, axis]
    current = float(np.abs(trace.current[-kept:]).max())
    return line(got, frequency) / line(wanted, frequency), current


def crossing(gains_db: np.ndarray) -> float:
    """Frequency at which the gain first falls by 3 dB [Hz]; inf: beyond all that were tried."""
    below = np.flatnonzero(gains_db <= HALF_DB)
    if not below.size:
        return float("inf")
    k = int(below[0])
    if k == 0:
        return FREQUENCIES[0]
    logs = np.log(FREQUENCIES[k - 1 : k + 1])
    share = (gains_db[k - 1] - HALF_DB) / (gains_db[k - 1] - gains_db[k])
    return float(np.exp(logs[0] + share * (logs[1] - logs[0])))


def stepped(rig: Rig, axis: int) -> tuple[float, float, float]:
    """10 to 90 % rise of a previewed step [s], its overshoot [%], and the peak current [A]."""
    time = np.arange(0.0, 3.0, 0.01)
    wrench = np.zeros((time.size, 6))
    wrench[time >= 1.0, axis] = STEPS[axis]
    geometry = rig.geometry
    place = geometry.reference_position, geometry.reference_rotation
    shaped = fastest_preview(LoadProgram("step", time, wrench, held=True), rig, *place)
    moments = np.arange(0.0, shaped.duration, PERIOD_S)
    trace = run(rig, shaped.reference.sample(moments))
    start = round(SETTLE_S / PERIOD_S)
    felt = trace.measured[start:, axis] - trace.measured[start - 500 : start, axis].mean()
    moments = PERIOD_S * np.arange(felt.size)
    smooth = np.convolve(felt, np.full(9, 1.0 / 9.0), mode="same")
    before = round((1.0 + shaped.lead - 0.6) / PERIOD_S)
    after = round((1.0 + shaped.lead + 1.0) / PERIOD_S)
    rise = rise_time(moments[before:after], smooth[before:after], 0.0, STEPS[axis])
    overshoot = 100.0 * (smooth[before:after].max() / STEPS[axis] - 1.0)
    return rise, float(overshoot), float(np.abs(trace.current[start:]).max())


def judge(name: str, rig: Rig) -> dict[str, Any]:
    """Measure one design and print its tables."""
    margins = margin_numbers(rig)
    print(f"{name}: poles {rig.control.poles}, zero {rig.control.zero:g} 1/s")
    print(
        f"  wrench loop: gain margin {margins['wrench_gain_margin_db']:.1f} dB, phase margin "
        f"{margins['wrench_phase_margin_deg']:.0f} deg; limb loops: "
        f"{margins['limb_gain_margin_db']:.1f} dB, {margins['limb_phase_margin_deg']:.0f} deg, "
        f"{margins['limb_delay_margin_ms']:.1f} ms more delay"
    )
    head = "".join(f"{frequency:>13g}" for frequency in FREQUENCIES)
    print(f"  gain [dB] and peak current [A] at{head} Hz;  -3 dB at")
    found: dict[str, Any] = {"margins": margins}
    for axis, letters in enumerate(AXES):
        responses = [followed(rig, axis, frequency) for frequency in FREQUENCIES]
        gains = np.array([20.0 * np.log10(abs(ratio)) for ratio, _ in responses])
        bandwidth = crossing(gains)
        current = max(a for (_, a), f in zip(responses, FREQUENCIES, strict=True) if f <= LIMIT_HZ)
        found[letters] = {
            "bandwidth_hz": bandwidth,
            "gain_db": dict(zip(map(str, FREQUENCIES), gains.tolist(), strict=True)),
            "phase_deg": {
                str(f): float(np.degrees(np.angle(ratio)))
                for (ratio, _), f in zip(responses, FREQUENCIES, strict=True)
            },
            "current_a": {str(f): a for (_, a), f in zip(responses, FREQUENCIES, strict=True)},
            "met": bool(bandwidth >= LIMIT_HZ and current <= LIMIT_A),
        }
        cells = "".join(f"{g:7.2f} {a:5.2f}" for g, (_, a) in zip(gains, responses, strict=True))
        verdict = "met" if found[letters]["met"] else "NOT met"
        print(f"  +-{SIZES[axis]:g} along {letters:22}{cells}   {bandwidth:6.2f} Hz, {verdict}")
    for axis, letters in enumerate(AXES):
        rise, overshoot, current = stepped(rig, axis)
        found[letters] |= {
            "preview_rise_s": rise,
            "preview_overshoot_percent": overshoot,
            "preview_current_a": current,
        }
        print(
            f"  previewed step of {STEPS[axis]:g} along {letters}: 10-90 % in {rise:.3f} s, "
            f"overshoot {overshoot:.1f} %, {current:.2f} A"
        )
    return found


def main() -> int:
    """Print and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("build/bench/bandwidth.json"))
    parser.add_argument("--control", action="append", help="YAML of a design; may be repeated")
    options = parser.parse_args()
    designs = options.control or ["control.yaml", "control_fast.yaml", "control_brisk.yaml"]
    figures: dict[str, Any] = {}
    for name in designs:
        path = Path(name) if Path(name).exists() else find_rig().file(name)
        figures[Path(name).stem] = judge(Path(name).stem, load_rig(control=path))
    write_figures(options.output, figures)
    best = list(figures.values())[-1]
    return 0 if all(best[letters]["met"] for letters in AXES) else 1


if __name__ == "__main__":
    raise SystemExit(main())
