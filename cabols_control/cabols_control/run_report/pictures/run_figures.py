# SPDX-License-Identifier: Apache-2.0
"""Figures of a recorded run, drawn without a display."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cabols_control.checks import FloatArray
from cabols_control.naming import limb_name
from cabols_control.rig import load_rig
from cabols_control.run_report.judgement.figures_of_merit import summarise
from cabols_control.run_report.pictures.session_figure import (
    FREE_SCALE_N,
    draw_bands,
    draw_motion,
    finish,
    free_limit,
    has_session,
    session_panels,
)
from cabols_control.run_report.run import BenchRun

COMPONENTS = ("$f_x$ [N]", "$f_y$ [N]", "$f_z$ [N]", "$m_x$ [N m]", "$m_y$ [N m]", "$m_z$ [N m]")
LIMB_COLOURS = (
    "#1f77b4",
    "#d95f02",
    "#2ca02c",
    "#c51b7d",
    "#7f7f7f",
    "#8c564b",
    "#17becf",
    "#6a3d9a",
)
DESIRED, MEASURED, LIMIT = "#222222", "#d95f02", "#b2182b"
POINTS = 3000
"""Points of a curve: more than a picture has pixels."""
DPI = 130


def decimate(time: FloatArray, values: FloatArray, points: int) -> tuple[FloatArray, FloatArray]:
    """Keep the lowest and the highest sample of each stretch, so that no peak is lost.

    Args:
        time: (k,) any unit.
        values: (k,) any unit; NaN is left out where a stretch has numbers.
        points: approximate number that remains.

    Returns:
        Time and values of what remains, in order.
    """
    size = int(np.ceil(2 * time.size / max(points, 2)))
    if size <= 2:
        return time, values
    whole = time.size // size * size
    blocks = values[:whole].reshape(-1, size)
    starts = np.arange(blocks.shape[0]) * size
    lowest = starts + np.argmin(np.where(np.isnan(blocks), np.inf, blocks), axis=1)
    highest = starts + np.argmax(np.where(np.isnan(blocks), -np.inf, blocks), axis=1)
    rest = np.arange(whole, time.size)
    ends = [0, time.size - 1]
    kept = np.unique(np.concatenate([lowest, highest, rest, ends])).astype(np.int64)
    return time[kept], values[kept]


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure that lays itself out; inches.

    Args:
        width: [inch].
        height: [inch].
    """
    return Figure(figsize=(width, height), layout="constrained")


def tidy(axes: Axes, ylabel: str = "", xlabel: str = "") -> None:
    """Set grid and labels; remove the upper and right frame.

    Args:
        axes: to be changed.
        ylabel: quantity and unit.
        xlabel: quantity and unit.
    """
    axes.grid(visible=True, color="#dddddd", linewidth=0.7)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    if ylabel:
        axes.set_ylabel(ylabel)
    if xlabel:
        axes.set_xlabel(xlabel)


def limit_line(axes: Axes, value: float, label: str) -> None:
    """Draw a limit across the axes, named at its left end.

    Args:
        axes: to draw in.
        value: of the limit, in the axes' unit.
        label: for the legend.
    """
    axes.axhline(value, color=LIMIT, linestyle="--", linewidth=1.2)
    axes.annotate(
        label,
        (0.005, value),
        xycoords=("axes fraction", "data"),
        xytext=(0, 2),
        textcoords="offset points",
        color=LIMIT,
        fontsize=8,
        va="bottom",
    )


def _curve(axes: Axes, time: FloatArray, values: FloatArray, **style: Any) -> None:
    axes.plot(*decimate(time, values, POINTS), **style)


def _shown(run: BenchRun) -> Any:
    return np.flatnonzero(run.loading)


def _draw_wrench(axes: Axes, run: BenchRun, component: int) -> None:
    rows = _shown(run)
    time = run.time[rows]
    _curve(axes, time, run.measured[rows, component], color=MEASURED, lw=1.5, label="measured")
    asked = run.program.command[rows, component]
    _curve(axes, time, asked, color=DESIRED, lw=1.1, ls="--", label="command")
    tidy(axes, COMPONENTS[component])
    axes.margins(x=0.01)


def _share_scale(panels: list[Axes]) -> None:
    """Give all forces one scale, and all torques another one."""
    for group in (panels[:3], panels[3:]):
        low = min(axes.get_ylim()[0] for axes in group)
        high = max(axes.get_ylim()[1] for axes in group)
        for axes in group:
            axes.set_ylim(low, high)


def draw_wrench(run: BenchRun) -> Figure:
    """Desired and measured wrench, as figure 3.11."""
    figure = new_figure(11.0, 7.0)
    grid = figure.subplots(3, 2, sharex=True)
    panels = list(grid.T.ravel())
    for component, axes in enumerate(panels):
        _draw_wrench(axes, run, component)
    _share_scale(panels)
    for axes in grid[2]:
        axes.set_xlabel("time in LOADING [s]")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return figure


def _draw_limbs(axes: Axes, run: BenchRun, values: FloatArray, ylabel: str) -> None:
    rows = _shown(run)
    for limb in range(run.limbs):
        colour = LIMB_COLOURS[limb % len(LIMB_COLOURS)]
        style = "-" if limb < len(LIMB_COLOURS) else ":"
        label = limb_name(limb)
        _curve(
            axes, run.time[rows], values[rows, limb], color=colour, ls=style, lw=1.2, label=label
        )
    tidy(axes, ylabel, "time in LOADING [s]")
    axes.margins(x=0.01)


def tension_ticks(low: float, high: float) -> list[float]:
    """Round numbers from the least to the highest tension [N], for a logarithmic axis.

    Args:
        low: least tension of the axis [N].
        high: largest tension of the axis [N].
    """
    decades = [scale * 10.0**power for power in range(-1, 4) for scale in (1.0, 2.0, 5.0)]
    return [tick for tick in decades if 0.99 * low <= tick <= 1.01 * high]


def _draw_tensions(axes: Axes, run: BenchRun, summary: Mapping[str, Any]) -> None:
    low, high = summary["tension_min_commanded_n"], summary["tension_max_commanded_n"]
    _draw_limbs(axes, run, run.tension, "cable tension [N]")
    # A logarithmic axis shows both limits and the tensions between them.
    axes.set_yscale("log")
    ticks = tension_ticks(low, high)
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.set_ylim(0.7 * low, 1.5 * high)
    limit_line(axes, high, f"most {high:g} N")
    limit_line(axes, low, f"least {low:g} N")


def _draw_currents(axes: Axes, run: BenchRun, summary: Mapping[str, Any]) -> None:
    limit = summary["current_limit_a"]
    _draw_limbs(axes, run, run.current, "motor current [A]")
    axes.set_ylim(-1.2 * limit, 1.2 * limit)
    limit_line(axes, limit, f"limit {limit:g} A")
    limit_line(axes, -limit, f"limit -{limit:g} A")


def draw_tensions(run: BenchRun, summary: Mapping[str, Any]) -> Figure:
    """Tension estimates between their limits, as figure 3.12.

    Args:
        run: that was recorded.
        summary: its figures of merit, see figures_of_merit.summarise.
    """
    figure = new_figure(11.0, 4.2)
    axes = figure.subplots()
    _draw_tensions(axes, run, summary)
    figure.legend(loc="outside right upper")
    return figure


def draw_tension_errors(run: BenchRun) -> Figure:
    """Commanded minus estimated tension, as figure 3.13."""
    figure = new_figure(11.0, 4.2)
    axes = figure.subplots()
    _draw_limbs(axes, run, run.tension_command - run.tension, "tension error [N]")
    figure.legend(loc="outside right upper")
    return figure


def draw_currents(run: BenchRun, summary: Mapping[str, Any]) -> Figure:
    """Motor currents between their limits, as figure 3.16.

    Args:
        run: that was recorded.
        summary: its figures of merit, see figures_of_merit.summarise.
    """
    figure = new_figure(11.0, 4.2)
    axes = figure.subplots()
    _draw_currents(axes, run, summary)
    figure.legend(loc="outside right upper")
    return figure


def draw_overview(run: BenchRun, summary: Mapping[str, Any]) -> Figure:
    """Wrench, tensions and currents in one picture, legible at half its size.

    Args:
        run: that was recorded.
        summary: its figures of merit, see figures_of_merit.summarise.
    """
    figure = new_figure(12.0, 9.6)
    grid = figure.subplots(4, 3, height_ratios=(1.0, 1.0, 1.05, 1.05))
    panels = [*grid[0], *grid[1]]
    for component, axes in enumerate(panels):
        _draw_wrench(axes, run, component)
    _share_scale(panels)
    for axes in panels[:3]:
        axes.set_xticklabels([])
    for axes in panels[3:]:
        axes.set_xlabel("time in LOADING [s]")
    panels[0].legend(loc="lower left", fontsize=10)
    shape = grid[0, 0].get_gridspec()
    for row in (2, 3):
        for axes in grid[row]:
            axes.remove()
    tensions, currents = (figure.add_subplot(shape[row, :]) for row in (2, 3))
    _draw_tensions(tensions, run, summary)
    _draw_currents(currents, run, summary)
    tensions.set_xlabel("")
    tensions.legend(
        ncols=8,
        fontsize=10,
        loc="upper right",
        bbox_to_anchor=(1.0, 0.93),
        columnspacing=1.0,
        handlelength=1.4,
    )
    for axes in figure.axes:
        axes.yaxis.label.set_fontsize(13)
        axes.xaxis.label.set_fontsize(12)
        axes.tick_params(labelsize=11)
        for text in axes.texts:
            text.set_fontsize(11)
    rise = summary["rise_time_s"]
    title = f"{run.metadata.get('program') or run.name}: wrench on the platform, tensions, currents"
    if rise is not None:
        title += f"  (rise {rise:.3f} s, designed {summary['rise_time_designed_s']:.3f} s)"
    figure.suptitle(title, fontsize=14)
    return figure


def draw_session(run: BenchRun) -> Figure:
    """The whole session over time: modes, joints, the platform's speed, tensions twice.

    In the upper of the two the scale shows free-moving, in the lower the load.
    """
    figure = new_figure(13.0, 11.0)
    panels = session_panels(figure)
    start = float(run.time[0])
    draw_bands(panels, run, start)
    _, joints, speed, low, whole = panels
    draw_motion(joints, speed, run.motion, start)
    tidy(joints, "joint change [deg]")
    tidy(speed, "platform [mm/s]")
    speed.set_ylim(bottom=0.0)
    for axes, label in ((low, "tension, low [N]"), (whole, "tension [N]")):
        for limb in range(run.limbs):
            colour = LIMB_COLOURS[limb % len(LIMB_COLOURS)]
            curve = (run.time - start, run.tension[:, limb])
            _curve(axes, *curve, color=colour, lw=1.1, label=limb_name(limb))
        tidy(axes, label)
    free_limit(low, run, start, LIMIT)
    low.set_ylim(-1.0, FREE_SCALE_N)
    handles = whole.get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=8, fontsize=12)
    finish(panels, run, start)
    figure.suptitle("The session: modes, robot, tensions (estimates)", fontsize=15)
    return figure


def write_figures(
    run: BenchRun, folder: str | Path, summary: Mapping[str, Any] | None = None
) -> list[Path]:
    """Write all figures of a run as PNG.

    Args:
        run: from load_run.
        folder: made if it is missing.
        summary: from summarise, for limits and rise times; None: judged by the reference bench.

    Returns:
        Paths: overview.png, wrench.png, tensions.png, tension_errors.png, currents.png, and
        session.png if the rig was free-moving.
    """
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    numbers = summary if summary is not None else summarise(run, load_rig())
    drawings: dict[str, Callable[[], Figure]] = {
        "overview": lambda: draw_overview(run, numbers),
        "wrench": lambda: draw_wrench(run),
        "tensions": lambda: draw_tensions(run, numbers),
        "tension_errors": lambda: draw_tension_errors(run),
        "currents": lambda: draw_currents(run, numbers),
    }
    if has_session(run):
        drawings["session"] = lambda: draw_session(run)
    paths = []
    for name, draw in drawings.items():
        path = target / f"{name}.png"
        draw().savefig(path, dpi=DPI)
        paths.append(path)
    return paths
