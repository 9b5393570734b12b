# SPDX-License-Identifier: Apache-2.0
"""Figures of commissioned limbs, drawn without a display."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cabols_control.checks import FloatArray
from cabols_control.commissioning.results import LimbResult
from cabols_control.limb import LimbModel, step_response
from cabols_control.naming import limb_name
from cabols_control.rig import Rig

MEASURED, FITTED, CONFIGURED = "#d95f02", "#222222", "#9ecae1"
DPI = 130
POINTS = 2000
MOVING_M_PER_S = 0.002


def _tidy(axes: Axes, xlabel: str, ylabel: str) -> None:
    axes.grid(visible=True, color="#dddddd", linewidth=0.7)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.set_xlabel(xlabel)
    axes.set_ylabel(ylabel)


def _thin(*arrays: FloatArray) -> list[FloatArray]:
    every = max(arrays[0].size // POINTS, 1)
    return [array[::every] for array in arrays]


def modelled_step(
    time: FloatArray, current: FloatArray, wound: FloatArray, model: LimbModel, friction: float
) -> FloatArray:
    """Compute the wound length by model and dry friction for the recorded current.

    Args:
        time: (k,) [s].
        current: (k,) held between samples [A].
        wound: (k,) measured; its direction is that of the friction [m].
        model: identified.
        friction: identified [A].

    Returns:
        (k,) [m], from the first measured value on.
    """
    speed = np.gradient(wound, time)
    direction = np.where(np.abs(speed) > MOVING_M_PER_S, np.sign(speed), 0.0)
    response = step_response(model, time, current - friction * direction)
    return np.asarray(wound[0] + response, dtype=np.float64)


def draw_limb(
    result: LimbResult,
    step: Mapping[str, FloatArray] | None,
    ramp: Mapping[str, FloatArray] | None,
) -> Figure:
    """Step and ramp of one limb beside what was fitted.

    Args:
        result: what was identified.
        step: time, current, wound_length and modelled, (k,) each; None if there was no step.
        ramp: elongation [m] and tension [N] by the force/torque sensor, (k,); None likewise.
    """
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    if step is not None:
        thin = _thin(step["time"], step["wound_length"], step["modelled"], step["current"])
        time, wound, modelled, current = thin
        left.plot(time, wound, color=MEASURED, lw=2.4, label="encoder")
        left.plot(time, modelled, "--", color=FITTED, lw=1.3, label="(3.11) and dry friction")
        left.set_title(
            f"step: k {result.gain:.4f} m/s/A, T {result.time_constant:.4f} s, "
            f"fit {100.0 * result.fit:.2f} %",
            fontsize=10,
        )
        _tidy(left, "time [s]", "cable wound in [m]")
        twin = left.twinx()
        twin.plot(time, current, color=CONFIGURED, lw=1.0)
        twin.set_ylabel("current [A]", color=CONFIGURED)
        left.legend(loc="upper center")
    if ramp is not None:
        elongation, tension = _thin(ramp["elongation"], ramp["tension"])
        right.plot(1e3 * elongation, tension, color=MEASURED, lw=2.0, label="force/torque sensor")
        middle = elongation.mean(), tension.mean()
        line = middle[1] + result.stiffness * (elongation - middle[0])
        right.plot(1e3 * elongation, line, "--", color=FITTED, lw=1.2, label="fitted")
        right.set_title(
            f"ramp: $k_e$ {result.stiffness:.1f} N/m, fit {100.0 * result.stiffness_fit:.2f} %",
            fontsize=10,
        )
        _tidy(right, "elongation by the encoder [mm]", "tension [N]")
        right.legend(loc="upper left")
    figure.suptitle(limb_name(result.limb))
    return figure


def draw_overview(rig: Rig, results: Mapping[int, LimbResult]) -> Figure:
    """Identified beside configured values of all limbs.

    Args:
        rig: with the configured values.
        results: identified, by the limb's index from 0.
    """
    figure = Figure(figsize=(11.0, 3.8), layout="constrained")
    panels = figure.subplots(1, 3)
    limbs = range(len(rig.limbs.gain))
    number = np.arange(1, len(limbs) + 1)
    configured = (
        rig.limbs.gain,
        rig.limbs.time_constant,
        [rig.limbs.stiffness] * len(limbs),
    )
    names = ("gain", "time_constant", "stiffness")
    labels = ("k [m/s/A]", "T [s]", "$k_e$ [N/m]")
    for axes, name, label, before in zip(panels, names, labels, configured, strict=True):
        found = [getattr(results[i], name) if i in results else np.nan for i in limbs]
        axes.bar(number - 0.2, before, 0.4, color=CONFIGURED, label="configured")
        axes.bar(number + 0.2, found, 0.4, color=MEASURED, label="identified")
        axes.set_xticks(number)
        _tidy(axes, "limb", label)
    handles = panels[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper center", ncols=2)
    return figure


def save(figure: Figure, path: Path) -> Path:
    """Write a figure as PNG; return its path.

    Args:
        figure: to be written.
        path: of the PNG.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=DPI)
    return path
