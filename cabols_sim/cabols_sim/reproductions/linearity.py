# SPDX-License-Identifier: Apache-2.0
"""(3.22): the closed wrench loop is linear although redundancy resolution is not."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from scipy import signal

from cabols_control.checks import FloatArray
from cabols_control.run_report.judgement.step_response import rise_time
from cabols_control.run_report.pictures.run_figures import LIMB_COLOURS, new_figure, tidy
from cabols_control.run_report.section import ReportSection
from cabols_sim.plant.closed_loop import simulate
from cabols_sim.reproductions.common import PERIOD_S, bench

NAMES = ("f_x", "f_y", "f_z", "m_x", "m_y", "m_z")
LEVELS = (40.0, 40.0, 60.0, 4.0, 4.0, 4.0)
"""Steps of the programme `steps` [N, N m]."""
FACTORS = (0.25, 1.0, 2.0)
"""Of those levels: other cables go slack to their least tension at each."""
BEFORE_S, AFTER_S = 1.0, 1.5
GAIN, POLES = 36000.0, (-10.0, -40.0, -90.0)


def transfer_function(time: FloatArray) -> FloatArray:
    """Unit step response of 36000/((s+10)(s+40)(s+90)) at (k,) times [s]; by scipy."""
    _, value = signal.step((GAIN, np.real(np.poly(POLES))), T=time)
    return np.asarray(value)


def sampled_loop(samples: int) -> FloatArray:
    """Unit step response of the designed loop in z, (k,) samples of 1 ms from the step on.

    Limb 1 by its model (3.11) with the current held; (3.10) and (3.17) with differences and sums
    for derivatives and integrals. All limbs give the same.
    """
    setup = bench()
    gains, model = setup.rig.gains, setup.rig.limbs.models[0]
    limb, k_e = gains.limbs[0], float(setup.rig.springs.nominal[0])
    plant = ([model.gain], [model.time_constant, 1.0, 0.0])
    numerator, denominator, _ = signal.cont2discrete(plant, PERIOD_S)
    held = numerator[0][1:]
    difference, backward = np.array([1.0, -1.0]), np.array([1.0, 0.0])
    # x (A/B + k_I + k_P1 (z - 1)/(z h) + k_I k_P2 k_e h z/(z - 1)) = k_I k_P2 h z/(z - 1) tau_d,
    # multiplied by B z (z - 1).
    factor = limb.integral * limb.tension * PERIOD_S
    common = np.polymul(backward, difference)
    forward = factor * k_e * np.polymul(held, np.polymul(backward, backward))
    inner = np.polymul(denominator, common)
    inner = np.polyadd(inner, limb.integral * np.polymul(held, common))
    velocity = np.polymul(held, np.polymul(difference, difference))
    inner = np.polyadd(inner, limb.velocity / PERIOD_S * velocity)
    inner = np.polyadd(inner, forward)
    # k_Po + k_Io h z/(z - 1)
    control = np.polyadd(gains.proportional * difference, gains.integral * PERIOD_S * backward)
    opened = np.polymul(forward, control)
    closed = np.polyadd(np.polymul(inner, difference), opened)
    opened = np.concatenate([np.zeros(closed.size - opened.size), opened])
    return np.asarray(signal.lfilter(opened, closed, np.ones(samples)))


def step_component(component: int, level: float, linear: bool) -> tuple[FloatArray, FloatArray]:
    """Step one component of the desired wrench in closed loop.

    Args:
        component: 0 to 5.
        level: of the step [N, N m].
        linear: which plant.

    Returns:
        Time from the step [s] and measured wrench over level, (k,) each.
    """
    setup = bench()
    samples = round((BEFORE_S + AFTER_S) / PERIOD_S)
    begin = round(BEFORE_S / PERIOD_S)
    desired = np.zeros((samples, 6))
    desired[begin:, component] = level
    plant = setup.plant.linear() if linear else setup.plant
    trace = simulate(setup.rig, setup.card, plant, desired)
    rest = trace.measured[begin - 100 : begin, component].mean()
    share = (trace.measured[begin:, component] - rest) / (level - rest)
    return trace.time[begin:] - trace.time[begin], share


def reproduce_linearity() -> ReportSection:
    """Step each component by three amplitudes on the linear plant and by one on the full one."""
    linear: dict[tuple[int, float], FloatArray] = {}
    full: list[FloatArray] = []
    time = np.zeros(0)
    for component, level in enumerate(LEVELS):
        for factor in FACTORS:
            time, share = step_component(component, factor * level, linear=True)
            linear[component, factor] = share
        full.append(step_component(component, level, linear=False)[1])
    model = transfer_function(time)
    sampled = sampled_loop(time.size)
    rises = {case: rise_time(time, share, 0.0, 1.0) for case, share in linear.items()}
    rises_full = [rise_time(time, share, 0.0, 1.0) for share in full]
    off = {case: 100.0 * float(np.abs(share - model).max()) for case, share in linear.items()}
    off_full = [100.0 * float(np.abs(share - model).max()) for share in full]
    spread = max(
        100.0 * float(np.ptp([linear[c, f] for f in FACTORS], axis=0).max()) for c in range(6)
    )
    numbers = {
        "rise_time_transfer_function_s": rise_time(time, model, 0.0, 1.0),
        "rise_time_linear_s": [rises[c, 1.0] for c in range(6)],
        "rise_time_full_s": rises_full,
        "deviation_linear_percent": [off[c, 1.0] for c in range(6)],
        "deviation_linear_all_amplitudes_percent": max(off.values()),
        "deviation_linear_from_sampled_loop_percent": 100.0
        * max(float(np.abs(share - sampled).max()) for share in linear.values()),
        "deviation_full_percent": off_full,
        "spread_between_amplitudes_linear_percent": spread,
    }
    rows = tuple(
        (
            NAMES[c],
            f"{LEVELS[c]:g} " + ("N" if c < 3 else "N m"),
            f"{rises[c, 1.0]:.4f}",
            f"{off[c, 1.0]:.2f}",
            f"{rises_full[c]:.4f}",
            f"{off_full[c]:.2f}",
        )
        for c in range(6)
    )
    header = (
        "component",
        "step",
        "rise, linear plant [s]",
        "largest deviation [%]",
        "rise, full plant [s]",
        "largest deviation [%]",
    )
    text = (
        "Closed loop with both laws and redundancy resolution at 1 kHz; each component steps from "
        "zero. Against 36000/((s+10)(s+40)(s+90)) by scipy (rise "
        f"{numbers['rise_time_transfer_function_s']:.4f} s) the linear plant deviates by at most "
        f"{numbers['deviation_linear_all_amplitudes_percent']:.2f} % of the step, and by "
        f"{numbers['deviation_linear_from_sampled_loop_percent']:.4f} % from the same loop in z, "
        "with the current held and the velocity differenced over 1 ms: all of it is sampling. "
        "Steps of a quarter, once and twice the size, which put different cables at their least "
        f"tension, agree within {spread:.4f} %: the loop is linear. On the full plant friction, "
        f"backlash, converter steps and noise add up to {max(off_full):.1f} %."
    )
    data = {"time": time, "transfer_function": model, "sampled": sampled, "full": np.array(full)}
    data["linear"] = np.array([linear[c, 1.0] for c in range(6)])
    figure = _draw(time, model, linear, full)
    title = "Equation (3.22): the wrench loop is linear"
    return ReportSection("linearity", title, text, numbers, header, rows, figure, data)


def _draw(
    time: FloatArray,
    model: FloatArray,
    linear: dict[tuple[int, float], FloatArray],
    full: list[FloatArray],
) -> Figure:
    figure = new_figure(11.0, 6.0)
    grid = figure.subplots(2, 2, sharex=True, height_ratios=(1.6, 1.0))
    shown = time <= 0.8
    for component in range(6):
        colour = LIMB_COLOURS[component]
        name = f"${NAMES[component].replace('_', '_{')}}}$"
        cases = ((0, linear[component, 1.0], name), (1, full[component], name))
        for column, share, label in cases:
            grid[0, column].plot(time[shown], 100.0 * share[shown], color=colour, label=label)
            grid[1, column].plot(time[shown], 100.0 * (share - model)[shown], color=colour, lw=1.1)
    for column, title in enumerate(("linear plant", "full plant")):
        grid[0, column].plot(
            time[shown],
            100.0 * model[shown],
            "--",
            color="#222222",
            label="$36000/((s+10)(s+40)(s+90))$",
        )
        grid[0, column].set_title(title, fontsize=11)
        tidy(grid[0, column], "wrench / step [%]")
        tidy(grid[1, column], "deviation [% of step]", "time after the step [s]")
    grid[0, 0].legend(fontsize=9, ncols=2, loc="lower right")
    return figure
