# SPDX-License-Identifier: Apache-2.0
"""The report's plots."""

from __future__ import annotations

from typing import Any

import numpy as np
from bokeh.models.annotations import Legend, LegendItem
from bokeh.models.annotations.geometry import BoxAnnotation, Span
from bokeh.models.formatters import NumeralTickFormatter
from bokeh.models.ranges import FactorRange
from bokeh.plotting import figure

from cabols_control.checks import FloatArray
from cabols_control.naming import number
from cabols_stiffness.analysis.study import Study
from cabols_stiffness.identification.validation import Validation, validate
from cabols_stiffness.model.robot import JOINTS

MEASURED, PREDICTED, INK = "#c0392b", "#1f5fa8", "#5b6770"
TOOLS = "pan,box_zoom,wheel_zoom,reset,save"
FORCES = (("fx", "#1f5fa8"), ("fy", "#c0392b"), ("fz", "#2e8b57"))
TORQUES = (("mx", "#1f5fa8"), ("my", "#c0392b"), ("mz", "#2e8b57"))
POSE = ("x [mm]", "y [mm]", "z [mm]", "rotation x [mrad]", "rotation y [mrad]", "rotation z [mrad]")


def joint_plots(study: Study) -> list[Any]:
    """Stiffness of each joint at each configuration, with the pooled value and its interval."""
    names = [str(number(index)) for index, _ in study.by_configuration]
    values = np.array([found for _, found in study.by_configuration])
    plots = []
    for j in range(JOINTS):
        plot = _plot("configuration", f"k{number(j)} [N m/rad]", FactorRange(factors=names))
        plot.yaxis.formatter = NumeralTickFormatter(format="0,0")
        known = np.isfinite(values[:, j])
        plot.scatter(
            [name for name, use in zip(names, known, strict=True) if use],
            values[known, j],
            size=8,
            color=MEASURED,
        )
        if study.result.identifiable[j]:
            low, high = study.result.interval[j]
            plot.add_layout(
                BoxAnnotation(bottom=low, top=high, fill_color=PREDICTED, fill_alpha=0.25)
            )
            plot.add_layout(
                Span(location=study.result.stiffness[j], line_color=PREDICTED, line_width=1.5)
            )
        plots.append(plot)
    return plots


def validation_plots(validation: Validation) -> list[Any]:
    """Predicted and measured deflection over the loads, six axes."""
    load = np.arange(1, len(validation.measured) + 1)
    plots = []
    for axis, name in enumerate(POSE):
        plot = _plot("load", name)
        predicted, band = 1e3 * validation.predicted[:, axis], 1e3 * validation.band[:, axis]
        plot.xaxis.ticker = load
        plot.varea(load, predicted - band, predicted + band, color=PREDICTED, alpha=0.25)
        line = plot.line(load, predicted, color=PREDICTED, line_width=1.5)
        dots = plot.scatter(load, 1e3 * validation.measured[:, axis], color=MEASURED, size=7)
        if axis == 0:
            _legend(plot, [("predicted, 95 % band", line), ("measured", dots)])
        plots.append(plot)
    return plots


def load_plots(study: Study) -> list[Any]:
    """Draw wrenches in the order of measurement, and the residuals of the displacements."""
    wrench = study.samples.wrench
    count = np.arange(1, len(wrench) + 1)
    plots = [
        _curves("force [N]", count, wrench[:, :3], FORCES),
        _curves("torque [N m]", count, wrench[:, 3:], TORQUES),
    ]
    found = validate(study.result, study.samples, study.robot)
    left = 1e6 * (found.measured - found.predicted)
    axes = (("x", "#1f5fa8"), ("y", "#c0392b"), ("z", "#2e8b57"))
    residual = _curves("measured minus predicted [um]", count, left, axes, dots=True)
    band = 1e6 * float(np.median(found.band))
    for edge in (-band, band):
        residual.add_layout(Span(location=edge, line_color=INK, line_dash="dashed"))
    plots.append(residual)
    return plots


def _curves(
    label: str,
    count: Any,
    values: FloatArray,
    names: tuple[tuple[str, str], ...],
    dots: bool = False,
) -> Any:
    plot = _plot("measurement", label)
    items = []
    for column, (name, colour) in enumerate(names):
        if dots:
            drawn = plot.scatter(count, values[:, column], color=colour, size=4)
        else:
            drawn = plot.line(count, values[:, column], color=colour, line_width=1.2)
        items.append((name, drawn))
    _legend(plot, items)
    return plot


def _plot(x_label: str, y_label: str, x_range: Any = None) -> Any:
    plot = figure(
        height=270,
        tools=TOOLS,
        sizing_mode="stretch_width",
        x_axis_label=x_label,
        y_axis_label=y_label,
        min_border_left=62,
        **({} if x_range is None else {"x_range": x_range}),
    )
    plot.toolbar.logo = None
    plot.toolbar.autohide = True
    plot.xgrid.grid_line_color = plot.ygrid.grid_line_color = "#e3e6e8"
    return plot


def _legend(plot: Any, items: list[tuple[str, Any]]) -> None:
    legend = Legend(
        items=[LegendItem(label=name, renderers=[drawn]) for name, drawn in items],
        orientation="horizontal",
        border_line_color=None,
        label_text_font_size="12px",
    )
    plot.add_layout(legend, "above")
