# SPDX-License-Identifier: Apache-2.0
"""Figure 3.6: tension over elongation of a limb with and without its spring."""

from __future__ import annotations

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.gains import limb_gains
from cabols_control.limb import StiffnessFit, identify_stiffness
from cabols_control.run_report.pictures.run_figures import decimate, new_figure, tidy
from cabols_control.run_report.section import ReportSection
from cabols_sim.reproductions.common import (
    K_CABLE,
    K_SPRING,
    PERIOD_S,
    bench,
    control_limb,
    without_spring,
)

LIMB = 0
RAMP_N_PER_S = 7.5
TOP_N, BOTTOM_N = 150.0, 1.0
POLES = (-10.0, -10.0, -10.0)
SENSOR_AXIS = 2
"""The cable pulls along z of the force/torque sensor."""


def _ramp() -> FloatArray:
    up = np.arange(BOTTOM_N, TOP_N + 1.0, RAMP_N_PER_S * PERIOD_S)
    return np.concatenate([up, up[::-1]])


def _test(k_e: float, seed: int) -> tuple[FloatArray, FloatArray, StiffnessFit, StiffnessFit]:
    """Elongation by the encoder [m], tension by the sensor [N]; fit of both branches and one."""
    setup = bench()
    limbs = setup.plant.limbs if k_e == K_SPRING else without_spring(setup.plant.limbs)
    gains = limb_gains(setup.rig.limbs.models[LIMB], k_e, POLES)
    trace = control_limb(limbs, LIMB, gains, k_e, _ramp())
    newton_per_volt = setup.card.ft_matrix[SENSOR_AXIS, SENSOR_AXIS]
    sensors = setup.plant.sensors
    noise = np.random.default_rng(seed).normal(0.0, sensors.gauge_noise, trace.time.size)
    volts = trace.tension / newton_per_volt + noise
    measured = np.round(volts / sensors.adc_step) * sensors.adc_step * newton_per_volt
    elongation = trace.wound - trace.wound[0] + BOTTOM_N / k_e
    half = trace.time.size // 2
    return (
        elongation,
        measured,
        identify_stiffness(measured, elongation),
        identify_stiffness(measured[:half], elongation[:half]),
    )


def reproduce_stiffness() -> ReportSection:
    """Wind the cable in and out slowly and fit the force/elongation line."""
    cases = {"with": K_SPRING, "without": K_CABLE}
    found = {name: _test(k_e, seed) for seed, (name, k_e) in enumerate(cases.items())}
    numbers: dict[str, float] = {}
    rows = []
    for name, k_e in cases.items():
        _, _, both, up = found[name]
        key = f"{name}_spring"
        numbers[f"k_e_source_{key}_n_per_mm"] = 1e-3 * k_e
        numbers[f"k_e_{key}_n_per_mm"] = 1e-3 * both.stiffness
        numbers[f"k_e_winding_in_{key}_n_per_mm"] = 1e-3 * up.stiffness
        numbers[f"linearity_rms_{key}_n"] = both.linearity_rms
        numbers[f"hysteresis_{key}_n"] = both.hysteresis
        rows.append(
            (
                f"{name} spring",
                f"{1e-3 * k_e:.2f}",
                f"{1e-3 * both.stiffness:.3f}",
                f"{1e-3 * up.stiffness:.3f}",
                f"{both.linearity_rms:.2f}",
                f"{both.hysteresis:.2f}",
            )
        )
    backlash = 1e3 * bench().plant.limbs.backlash
    text = (
        f"Limb 1 on the full plant: closed tension loop, {BOTTOM_N:g} to {TOP_N:g} N and back at "
        f"{RAMP_N_PER_S:g} N/s; tension by the force/torque sensor, elongation by the motor's "
        f"encoder. The gearbox's backlash ({backlash:g} mm) opens the loop by k_e times as much: "
        f"{-numbers['hysteresis_with_spring_n']:.2f} N with the spring, "
        f"{-numbers['hysteresis_without_spring_n']:.2f} N without (negative in the table: at the "
        "same encoder reading the tension is lower while winding in); winding in alone is free of "
        "it."
    )
    header = (
        "",
        "k_e source [N/mm]",
        "in and out [N/mm]",
        "winding in [N/mm]",
        "residual rms [N]",
        "hysteresis [N]",
    )
    figure = new_figure(9.0, 4.4)
    axes = figure.subplots()
    for name, colour in (("without", "#1f77b4"), ("with", "#d95f02")):
        elongation, tension, both, _ = found[name]
        axes.plot(
            *decimate(1e3 * elongation, tension, 4000),
            color=colour,
            lw=1.2,
            label=f"{name} spring, measured",
        )
        line = np.linspace(0.0, (TOP_N - both.offset) / both.stiffness, 2)
        axes.plot(
            1e3 * line,
            both.stiffness * line + both.offset,
            "--",
            color="#222222",
            lw=1.0,
            label=f"fit, {1e-3 * both.stiffness:.2f} N/mm",
        )
    tidy(axes, "tension [N]", "elongation [mm]")
    axes.legend(loc="lower right")
    data = {}
    for name in cases:
        data[f"elongation_{name}"], data[f"tension_{name}"] = found[name][:2]
    title = "Figure 3.6: stiffness of a limb with and without its spring"
    return ReportSection("stiffness", title, text, dict(numbers), header, tuple(rows), figure, data)
