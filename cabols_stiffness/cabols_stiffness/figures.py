# SPDX-License-Identifier: Apache-2.0
"""Figure 4.13: measured deflection beside the predicted one with its band."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from cabols_control.checks import FloatArray
from cabols_stiffness.identification.validation import Validation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MEASURED, PREDICTED = "#c0392b", "#1f5fa8"
_POSE = ("x", "y", "z", "rotation x", "rotation y", "rotation z")
_POINT = ("x", "y", "z")


def validation_figure(validation: Validation, title: str = "") -> Figure:
    """Draw measured (red) and predicted (blue) deflection over the loads, with the 95 % band.

    Args:
        validation: k samples in the order to draw; poses give six axes, points three.
        title: above the figure.
    """
    names = _POSE if validation.measured.shape[1] == 6 else _POINT
    columns = len(names) // 3
    figure = Figure(figsize=(5.2 * columns + 0.6, 6.6), layout="constrained")
    axes = np.atleast_2d(figure.subplots(3, columns, sharex=True, squeeze=False))
    for index, name in enumerate(names):
        unit = "mm" if index < 3 else "mrad"
        _draw(axes[index % 3, index // 3], validation, index, f"{name} [{unit}]")
    for axis in axes[-1]:
        axis.set_xlabel("load")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", fontsize=10, ncols=3)
    rms = f"normalised error {validation.normalised_rms:.2f}"
    share = f"{100.0 * validation.explained:.2f} % explained"
    figure.suptitle(f"{title + ': ' if title else ''}{share}, {rms}", fontsize=11)
    return figure


def _draw(axis: Axes, validation: Validation, index: int, label: str) -> None:
    load = np.arange(1, validation.measured.shape[0] + 1)
    scale = 1e3
    predicted = scale * validation.predicted[:, index]
    band: FloatArray = scale * validation.band[:, index]
    axis.fill_between(
        load, predicted - band, predicted + band, color=PREDICTED, alpha=0.25, label="95 % band"
    )
    axis.plot(load, predicted, color=PREDICTED, linewidth=1.4, label="predicted")
    axis.plot(
        load,
        scale * validation.measured[:, index],
        color=MEASURED,
        linestyle="none",
        marker="o",
        markersize=3,
        label="measured",
    )
    axis.axhline(0.0, color="0.6", linewidth=0.6)
    axis.set_ylabel(label)
    axis.grid(visible=True, color="0.9")
