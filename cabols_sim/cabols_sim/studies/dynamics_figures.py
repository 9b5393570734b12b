# SPDX-License-Identifier: Apache-2.0
"""Figures of the dynamics study, drawn without a display."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cabols_control.checks import FloatArray
from cabols_control.naming import cable_name, number
from cabols_control.rig import Rig
from cabols_control.run_report.judgement.figures_of_merit import designed_response
from cabols_control.run_report.pictures.run_figures import (
    LIMB_COLOURS,
    LIMIT,
    limit_line,
    new_figure,
    tidy,
)
from cabols_sim.dynamics.bench_vibration import LOOP_DELAY_S, Frequencies
from cabols_sim.dynamics.loops import FREQUENCIES, ComplexArray, limb_loop, wrench_loop
from cabols_sim.dynamics.planar_case import TENSION_MIN, CaseRun, Effect
from cabols_sim.dynamics.robot import CableRobot
from cabols_sim.dynamics.simulation import Trajectory
from cabols_sim.plant.closed_loop import Trace

MODEL_STYLES = {
    "as published": {"color": "#1f77b4", "lw": 2.6},
    "without (2.28)": {"color": "#d95f02", "lw": 1.4, "ls": "--"},
    "constant mass": {"color": "#2ca02c", "lw": 1.6},
    "material": {"color": "#222222", "lw": 1.2, "ls": ":"},
}
PAIR = ("#1f77b4", "#d95f02")


def draw_layout(robot: CableRobot, run: CaseRun) -> Figure:
    """Layout of the planar case and its trajectory, as figures 2.3 and 2.4.

    Args:
        robot: attachment points; x and y of the plane count [m].
        run: of the case; the platform is drawn where it is at half time.
    """
    figure = new_figure(10.5, 4.2)
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.25))
    middle = run.coordinates[run.time.size // 2]
    turn = np.array(
        [[np.cos(middle[2]), -np.sin(middle[2])], [np.sin(middle[2]), np.cos(middle[2])]]
    )
    for i, (base, point) in enumerate(zip(robot.base_points, robot.platform_points, strict=True)):
        end = middle[:2] + turn @ point[:2]
        left.plot([base[0], end[0]], [base[1], end[1]], color=LIMB_COLOURS[i], lw=1.6)
        left.annotate(f"$A_{number(i)}$", base[:2], fontsize=11)
    left.plot(run.coordinates[:, 0], run.coordinates[:, 1], color="#b2182b", lw=3)
    left.set_aspect("equal")
    tidy(left, "y [m], up", "x [m]")
    for column, colour, name in ((0, PAIR[0], "x [m]"), (1, PAIR[1], "y [m]")):
        right.plot(run.time, run.coordinates[:, column], color=colour, label=name)
    right.plot(
        run.time,
        np.degrees(run.coordinates[:, 2]),
        color="#2ca02c",
        label=r"$\varphi$ [deg]",
    )
    tidy(right, "displacement [m, deg]", "time [s]")
    right.legend(fontsize=10)
    return figure


def draw_forces(runs: Mapping[str, CaseRun]) -> Figure:
    """Forces in Cartesian space, as figure 2.5 (a), and what leaving (2.28) out changes."""
    figure = new_figure(11.0, 6.0)
    grid = figure.subplots(2, 3, sharex=True, height_ratios=(1.5, 1.0))
    names = ("$F_x$", "$F_y$", r"$\tau_z$")
    units = ("kN", "kN", "kN m")
    for column in range(3):
        for name, run in runs.items():
            grid[0, column].plot(
                run.time, 1e-3 * run.force[:, column], label=name, **MODEL_STYLES[name]
            )
        tidy(grid[0, column], f"{names[column]} [{units[column]}]")
        published = runs["as published"]
        other = runs["without (2.28)"]
        grid[1, column].plot(
            other.time, (other.force - published.force)[:, column], color=PAIR[1], lw=1.6
        )
        unit = "N" if column < 2 else "N m"
        tidy(grid[1, column], f"without (2.28)\nminus published [{unit}]", "time [s]")
    grid[0, 0].legend(fontsize=9)
    return figure


def draw_tensions(runs: Mapping[str, CaseRun]) -> Figure:
    """Tensions in the cables, as figure 2.5 (b), and what leaving (2.28) out changes.

    The dashed line of the lower cables is the least tension.
    """
    figure = new_figure(11.0, 6.0)
    cables = runs["as published"].tension.shape[1]
    grid = figure.subplots(2, cables, sharex=True, height_ratios=(1.5, 1.0))
    for i in range(cables):
        for name, run in runs.items():
            grid[0, i].plot(run.time, 1e-3 * run.tension[:, i], label=name, **MODEL_STYLES[name])
        grid[0, i].set_title(cable_name(i), fontsize=11)
        if i < 2:
            limit_line(grid[0, i], 1e-3 * TENSION_MIN, "")
        change = runs["without (2.28)"].tension - runs["as published"].tension
        grid[1, i].plot(runs["as published"].time, change[:, i], color=PAIR[1], lw=1.6)
        tidy(grid[0, i])
        tidy(grid[1, i], xlabel="time [s]")
    grid[0, 0].set_ylabel("tension [kN]")
    grid[1, 0].set_ylabel("without (2.28)\nminus published [N]")
    handles = grid[0, 0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper center", ncols=4, fontsize=10)
    return figure


def draw_study(study: Mapping[str, Sequence[tuple[Effect, Effect, Effect]]]) -> Figure:
    """How the differences between the models grow with density, size and speed."""
    figure = new_figure(11.0, 3.8)
    panels = figure.subplots(1, 3, sharey=True)
    labels = (
        "(2.28) left out",
        "constant mass instead of material",
        "published instead of material",
    )
    axis_of = {
        "density": ("density [kg/m]", "density"),
        "size": ("base radius [m]", "radius"),
        "pace": ("fastest cable [m/s]", "peak_rate"),
    }
    for axes, (name, effects) in zip(panels, study.items(), strict=True):
        label, field = axis_of[name]
        for kind in range(3):
            rows = [effect[kind] for effect in effects]
            axes.loglog(
                [getattr(row, field) for row in rows],
                [row.tension for row in rows],
                "o-",
                color=(PAIR[1], "#2ca02c", PAIR[0])[kind],
                label=labels[kind],
            )
        ticks = [getattr(effect[0], field) for effect in effects]
        axes.set_xticks(ticks, [f"{tick:.4g}" if tick < 1.0 else f"{tick:.0f}" for tick in ticks])
        axes.minorticks_off()
        tidy(axes, "", label)
    panels[0].set_ylabel("largest tension difference [N]")
    handles = panels[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper center", ncols=3, fontsize=10)
    return figure


def draw_balance(motions: Mapping[str, Trajectory]) -> Figure:
    """Energy of free motions and what is missing in their balance."""
    figure = new_figure(11.0, 5.4)
    grid = figure.subplots(2, len(motions), sharex=True, squeeze=False, height_ratios=(1.6, 1.0))
    for column, (name, motion) in enumerate(motions.items()):
        top, bottom = grid[:, column]
        scale = 1e-3
        potential = motion.potential - motion.potential[0]
        by_winches, _, by_stream = motion.work.T
        for values, label, colour in (
            (motion.kinetic, "kinetic", "#1f77b4"),
            (potential, "potential, change", "#2ca02c"),
            (by_winches, "work of the winches", "#d95f02"),
            (100.0 * by_stream, "brought by the stream, x 100", "#6a3d9a"),
        ):
            top.plot(motion.time, scale * values, color=colour, label=label, lw=1.4)
        top.set_title(name, fontsize=11)
        tidy(top, "energy [kJ]")
        share = np.abs(motion.imbalance) / motion.kinetic.max()
        bottom.semilogy(motion.time[1:], np.maximum(share[1:], 1e-16), color="#222222", lw=1.0)
        bottom.set_ylim(1e-14, 1e-5)
        limit_line(bottom, 1e-6, "1e-6")
        tidy(bottom, "imbalance / largest\nkinetic energy", "time [s]")
    handles = grid[0, 0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper center", ncols=4, fontsize=10)
    return figure


def draw_frequencies(found: Frequencies, fastest: float) -> Figure:
    """Natural frequencies along a load programme, below the tensions that cause them.

    Args:
        found: frequencies and tensions of k instants.
        fastest: crossover of a limb's loop, drawn as the limit [rad/s].
    """
    figure = new_figure(10.5, 6.4)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(1.0, 1.6))
    for i in range(found.tension.shape[1]):
        style = {"color": LIMB_COLOURS[i % len(LIMB_COLOURS)], "lw": 1.3, "where": "post"}
        top.step(found.time, found.tension[:, i], label=cable_name(i), **style)
    tidy(top, "tension [N]")
    top.legend(fontsize=8, ncols=2, loc="upper right")
    curves: list[tuple[FloatArray, str, str]] = [
        (found.held, "#1f77b4", "platform in the robot's hand"),
        (found.free, "#d95f02", "platform on the springs alone"),
        (found.string, "#999999", "cables as strings, first"),
    ]
    for values, colour, label in curves:
        hertz = values / (2.0 * np.pi)
        for k, mode in enumerate(hertz.T):
            bottom.semilogy(found.time, mode, color=colour, lw=1.3, label="" if k else label)
    bottom.axhline(
        fastest / (2.0 * np.pi), color=LIMIT, ls="--", lw=1.4, label="crossover of the limb loops"
    )
    tidy(bottom, "natural frequency [Hz]", "time [s]")
    bottom.set_ylim(4.0, 400.0)
    bottom.legend(fontsize=9, ncols=2, loc="upper right")
    return figure


def draw_steps(traces: Mapping[str, Trace], rigs: Mapping[str, Rig], begin: int) -> Figure:
    """One component's step with every design: measured and designed wrench, all limbs' currents.

    Args:
        traces: of the compiled loop, by design.
        rigs: their configurations.
        begin: sample of the step, whose component is the one that then changes most.
    """
    figure = new_figure(10.5, 4.4)
    left, *panels = figure.subplots(1, 1 + len(traces), width_ratios=(1.5, *[1.0] * len(traces)))
    for (name, trace), colour, axes in zip(traces.items(), PAIR, panels, strict=False):
        component = int(np.argmax(np.abs(trace.desired[begin] - trace.desired[begin - 1])))
        shown = slice(begin - 50, begin + 600)
        time = trace.time[shown] - trace.time[begin]
        designed = designed_response(rigs[name], trace.desired, float(trace.time[1]))
        left.plot(time, trace.measured[shown, component], color=colour, lw=1.6, label=name)
        left.plot(time, designed[shown, component], color="#222222", lw=1.0, ls=":")
        for i, current in enumerate(trace.current[shown].T):
            axes.plot(time, current, color=LIMB_COLOURS[i % len(LIMB_COLOURS)], lw=1.0)
        limit = rigs[name].control.current_limit
        for value in (limit, -limit):
            limit_line(axes, value, f"{value:g} A")
        axes.set_title(f"{name}: currents", fontsize=11)
        axes.set_ylim(-1.15 * limit, 1.15 * limit)
        tidy(axes, "current [A]", "time after the step [s]")
    left.set_title("measured; dotted: designed", fontsize=11)
    left.legend(fontsize=10, loc="lower right")
    tidy(left, "$f_x$ [N]", "time after the step [s]")
    return figure


def draw_loops(rigs: Mapping[str, Rig]) -> Figure:
    """Open loops of designs, with the delay that margins are computed with."""
    figure = new_figure(10.5, 6.0)
    grid = figure.subplots(2, 2, sharex=True)
    s = np.multiply(1j, FREQUENCIES)
    for colour, (name, rig) in zip(PAIR, rigs.items(), strict=False):
        model, stiffness = rig.limbs.models[0], float(rig.springs.nominal[0])
        outer = wrench_loop(rig.gains, model, stiffness, s, LOOP_DELAY_S)
        inner = limb_loop(model, rig.gains.limbs[0], stiffness, s) * np.exp(-s * LOOP_DELAY_S)
        for column, loop in ((0, outer), (1, inner)):
            _bode(grid[:, column], np.asarray(loop), colour, name)
    for column, title in enumerate(("wrench loop, rigid target", "limb loop, limb 1")):
        grid[0, column].set_title(title, fontsize=11)
        limit_line(grid[0, column], 0.0, "")
        limit_line(grid[1, column], -180.0, "-180 deg")
        tidy(grid[0, column], "gain [dB]")
        tidy(grid[1, column], "phase [deg]", "frequency [rad/s]")
    grid[0, 0].legend(fontsize=9)
    return figure


def _bode(axes: Sequence[Axes], loop: ComplexArray, colour: str, name: str) -> None:
    shown = FREQUENCIES <= 1500.0
    phase = np.degrees(np.unwrap(np.angle(loop)))
    # The first point lies in the lower half plane: an integrator's phase is between -270 and 0.
    phase -= 360.0 * np.ceil(phase[0] / 360.0)
    gain = 20.0 * np.log10(np.abs(loop))
    axes[0].semilogx(FREQUENCIES[shown], gain[shown], color=colour, lw=1.6, label=name)
    axes[1].semilogx(FREQUENCIES[shown], phase[shown], color=colour, lw=1.6)
