# SPDX-License-Identifier: Apache-2.0
"""The report: one HTML file without any other file, and without network access."""

from __future__ import annotations

import base64
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from bokeh.models.annotations import Label, Legend, LegendItem
from bokeh.models.annotations.geometry import Span
from bokeh.models.formatters import NumeralTickFormatter
from bokeh.models.ranges import Range1d
from bokeh.models.tickers import FixedTicker
from bokeh.plotting import figure

from cabols_control.checks import FloatArray
from cabols_control.naming import limb_name
from cabols_control.report_page import embed, embedded_picture, render_page
from cabols_control.run_report.judgement.figures_of_merit import checks
from cabols_control.run_report.pictures.run_figures import (
    DESIRED,
    DPI,
    LIMB_COLOURS,
    LIMIT,
    MEASURED,
    decimate,
    draw_session,
    tension_ticks,
)
from cabols_control.run_report.pictures.session_figure import has_session
from cabols_control.run_report.run import BenchRun
from cabols_control.run_report.section import ReportSection

POINTS = 5000
"""Per curve."""
COMPONENTS = ("fx [N]", "fy [N]", "fz [N]", "mx [N m]", "my [N m]", "mz [N m]")
VERSIONS_OF = (
    "cabols_sim", "cabols_control", "cabols_hw", "cabols_msgs",
    "numpy", "scipy", "numba", "matplotlib", "bokeh", "rosbags", "mcap",
)  # fmt: skip
TOOLS = "xpan,box_zoom,xbox_zoom,xwheel_zoom,reset,save"


@dataclass(frozen=True)
class _Plot:
    div: str
    wide: bool


def write_report(
    path: str | Path,
    run: BenchRun,
    summary: Mapping[str, Any],
    reproductions: Mapping[str, ReportSection] | None = None,
    provenance: Mapping[str, str] | None = None,
) -> Path:
    """Write the report of a run.

    Args:
        path: of the HTML file.
        run: from load_run.
        summary: from summarise.
        reproductions: from run_all; None leaves them out.
        provenance: further facts about its origin, text by key.

    Returns:
        The path.
    """
    plots = _plots(run, summary)
    script, divs = embed([plot for plot, _ in plots])
    program = run.metadata.get("program") or run.metadata.get("description")
    text = render_page(
        "cabols_control",
        "report.html.j2",
        title=f"Bench run {program or run.name}",
        subtitle=f"{run.name}: {summary['duration_s']:.1f} s of loading, {summary['samples']} "
        f"samples, {run.limbs} cables, {summary['steps']} steps judged",
        script=script,
        checks=checks(summary),
        faults=summary["faults"],
        session=_session(run) if has_session(run) else "",
        plots=[_Plot(div, wide) for div, (_, wide) in zip(divs, plots, strict=True)],
        modes=run.modes,
        nodes=run.health,
        reproductions=[_shown(item) for item in (reproductions or {}).values()],
        provenance={
            "This report": {str(k): str(v) for k, v in (provenance or {}).items()},
            "Recorded with the bag": run.metadata,
            "Samples missing in the bag": {k: str(v) for k, v in run.lost.items()},
            "Versions": _versions(),
        },
    )
    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(text, encoding="utf-8")
    return target


def _session(run: BenchRun) -> str:
    """Picture of the session as base64."""
    return embedded_picture(draw_session(run), DPI)


def _shown(item: ReportSection) -> dict[str, Any]:
    starred = any(cell.endswith("*") for row in item.rows for cell in row)
    return {
        "key": item.key,
        "title": item.title,
        "text": item.text,
        "picture": base64.b64encode(item.png()).decode("ascii"),
        "header": item.header,
        "rows": item.rows,
        "note": "* misprint" if starred else "",
    }


def _versions() -> dict[str, str]:
    found = {"Python": platform.python_version(), "system": platform.platform()}
    found.update((name, _version(name)) for name in VERSIONS_OF)
    return found


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed as a package"


def _plots(run: BenchRun, summary: Mapping[str, Any]) -> list[tuple[Any, bool]]:
    """Plots with one time axis, and whether each takes the page's width."""
    rows = np.flatnonzero(run.loading)
    time = run.time[rows]
    span: Any = Range1d(start=float(time[0]), end=float(time[-1]), bounds="auto")
    plots: list[tuple[Any, bool]] = []
    for component, label in enumerate(COMPONENTS):
        # Those with a legend above need room for it.
        plot = _plot(span, label, 235 if component < 2 else 210)
        curves = (("measured", run.measured, MEASURED), ("command", run.program.command, DESIRED))
        for name, values, colour in curves:
            dash = "dashed" if name == "command" else "solid"
            _line(plot, time, values[rows, component], colour, name, dash)
        _legend(plot, "above" if component < 2 else "")
        plots.append((plot, False))
    tensions = _plot(span, "cable tension [N]", 360, y_axis_type="log")
    _limbs(tensions, time, run.tension[rows])
    low, high = summary["tension_min_commanded_n"], summary["tension_max_commanded_n"]
    tensions.y_range = Range1d(start=0.7 * low, end=1.9 * high)
    errors = _plot(span, "tension error [N]", 290)
    _limbs(errors, time, (run.tension_command - run.tension)[rows])
    currents = _plot(span, "motor current [A]", 330)
    _limbs(currents, time, run.current[rows])
    limit = summary["current_limit_a"]
    currents.y_range = Range1d(start=-1.3 * limit, end=1.3 * limit)
    tensions.yaxis.ticker = FixedTicker(ticks=tension_ticks(low, high))
    tensions.yaxis.formatter = NumeralTickFormatter(format="0.[0]")
    for plot, limits, unit in ((tensions, (low, high), "N"), (currents, (-limit, limit), "A")):
        for value in limits:
            plot.add_layout(Span(location=value, line_color=LIMIT, line_dash="dashed"))
            plot.add_layout(_limit_label(value, f"limit {value:g} {unit}"))
    return [*plots, (tensions, True), (errors, True), (currents, True)]


def _limit_label(value: float, text: str) -> Any:
    return Label(
        x=6,
        y=value,
        x_units="screen",
        text=text,
        text_color=LIMIT,
        text_font_size="11px",
        y_offset=2,
    )


def _plot(span: Any, label: str, height: int, **options: Any) -> Any:
    plot = figure(
        height=height,
        x_range=span,
        tools=TOOLS,
        active_drag="xbox_zoom",
        sizing_mode="stretch_width",
        min_border_left=62,
        min_border_right=16,
        x_axis_label="time in LOADING [s]",
        y_axis_label=label,
        **options,
    )
    plot.toolbar.logo = None
    plot.toolbar.autohide = True
    plot.xgrid.grid_line_color = plot.ygrid.grid_line_color = "#e3e6e8"
    return plot


def _line(
    plot: Any, time: FloatArray, values: FloatArray, colour: str, name: str, dash: str = "solid"
) -> None:
    x, y = decimate(time, values, POINTS)
    plot.line(
        x.astype(np.float32),
        y.astype(np.float32),
        color=colour,
        line_width=1.4,
        line_dash=dash,
        name=name,
    )


def _limbs(plot: Any, time: FloatArray, values: FloatArray) -> None:
    for limb in range(values.shape[1]):
        colour = LIMB_COLOURS[limb % len(LIMB_COLOURS)]
        dash = "solid" if limb < len(LIMB_COLOURS) else "dotted"
        _line(plot, time, values[:, limb], colour, limb_name(limb), dash)
    _legend(plot, "above")


def _legend(plot: Any, place: str) -> None:
    """Add a legend outside the plot in one line; clicking hides a curve."""
    if not place:
        return
    items = [LegendItem(label=curve.name, renderers=[curve]) for curve in plot.renderers]
    legend = Legend(
        items=items,
        orientation="horizontal",
        click_policy="hide",
        border_line_color=None,
        ncols=4,
        label_text_font_size="12px",
        spacing=8,
    )
    plot.add_layout(legend, place)
