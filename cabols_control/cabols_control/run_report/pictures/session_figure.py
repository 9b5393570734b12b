# SPDX-License-Identifier: Apache-2.0
"""Picture of a whole session over time: modes, joints, the platform's speed, tensions."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cabols_control.naming import number
from cabols_control.run_report.judgement.phases import FREE_TENSION_MAX_N, phases
from cabols_control.run_report.motion import RecordedMotion
from cabols_control.run_report.run import BenchRun
from cabols_control.supervision.modes import OperatingMode

MODE_COLOURS = {
    OperatingMode.STOPPED: "#d9d9d9",
    OperatingMode.FREE_MOVING: "#b7e1cd",
    OperatingMode.PRETIGHTENING: "#fde5a8",
    OperatingMode.LOADING: "#c6dbef",
    OperatingMode.UNLOADING: "#dcd0ea",
    OperatingMode.COMMISSIONING: "#f5d5c5",
    OperatingMode.FAULT: "#f2a6a0",
}
MODE_NAMES = {
    OperatingMode.STOPPED: "stopped",
    OperatingMode.FREE_MOVING: "free-moving",
    OperatingMode.PRETIGHTENING: "pre-\ntighten",
    OperatingMode.LOADING: "loading",
    OperatingMode.UNLOADING: "unload",
    OperatingMode.COMMISSIONING: "commissioning",
    OperatingMode.FAULT: "FAULT",
}
NARROW, HAIR = 0.1, 0.015
"""Shares of the picture below which a band's name is upright, or beside it."""
FREE_SCALE_N = 20.0
LABEL, TICKS = 14, 12


def has_session(run: BenchRun) -> bool:
    """Whether there is more to draw than a load, i.e. the rig was free-moving."""
    return bool(phases(run, OperatingMode.FREE_MOVING))


def session_panels(figure: Figure) -> list[Axes]:
    """Make the axes: a strip for the modes, four panels below it, one time axis."""
    grid = figure.subplots(5, 1, sharex=True, height_ratios=(0.45, 1.0, 0.8, 1.1, 1.1))
    return list(grid)


def draw_bands(panels: list[Axes], run: BenchRun, start: float) -> None:
    """Colour the modes' times in all panels and name them in the first; start becomes 0 [s].

    Args:
        panels: one above the other.
        run: that was recorded.
        start: instant of the recording that becomes 0 [s].
    """
    length = float(run.time[-1]) - start
    strip = panels[0]
    strip.set_yticks([])
    strip.set_ylabel("mode", rotation=0, ha="right", va="center", fontsize=LABEL)
    for side in ("top", "right", "left", "bottom"):
        strip.spines[side].set_visible(False)
    for interval in run.modes:
        if interval.end <= interval.start:
            continue
        begin, end = interval.start - start, interval.end - start
        colour = MODE_COLOURS[interval.mode]
        strip.axvspan(begin, end, color=colour, lw=0)
        for axes in panels[1:]:
            axes.axvspan(begin, end, color=colour, alpha=0.4, lw=0)
        share = (end - begin) / length
        beside = share < HAIR
        strip.text(
            begin if beside else 0.5 * (begin + end),
            0.5,
            MODE_NAMES[interval.mode],
            rotation=90 if share < NARROW else 0,
            ha="right" if beside else "center",
            va="center",
            fontsize=TICKS if share >= NARROW else TICKS - 2,
            linespacing=0.9,
            transform=strip.get_xaxis_transform(),
        )


def draw_motion(joints: Axes, speed: Axes, motion: RecordedMotion, start: float) -> None:
    """Draw the joints' change, the platform's speed, the tracker's measurements.

    Args:
        joints: panel of the joints.
        speed: panel of the platform's speed.
        motion: of the robot and the tracker, as recorded.
        start: instant of the recording that becomes 0 [s].
    """
    if motion.joint_time.size:
        change = np.degrees(motion.joints - motion.joints[0])
        for joint in range(change.shape[1]):
            label = f"{number(joint)}"
            joints.plot(motion.joint_time - start, change[:, joint], lw=1.6, label=label)
        joints.legend(
            title="joint", ncols=2, fontsize=TICKS - 2, title_fontsize=TICKS - 2, loc="upper right"
        )
    time, value = motion.speed()
    speed.plot(time - start, 1e3 * value, color="#222222", lw=1.4)
    for instant in motion.measured_time - start:
        speed.axvline(instant, color="#6a3d9a", lw=1.4, ls=":")
        speed.annotate(
            "tracker measures",
            (instant, 0.82),
            xycoords=("data", "axes fraction"),
            xytext=(4, 0),
            textcoords="offset points",
            color="#6a3d9a",
            fontsize=TICKS - 1,
        )


def free_limit(axes: Axes, run: BenchRun, start: float, colour: str) -> None:
    """Draw the limit of 15 N during free-moving, where it holds.

    Args:
        axes: panel of the tensions.
        run: that was recorded.
        start: instant of the recording that becomes 0 [s].
        colour: of the line.
    """
    intervals = phases(run, OperatingMode.FREE_MOVING)
    for interval in intervals:
        axes.hlines(
            FREE_TENSION_MAX_N,
            interval.start - start,
            interval.end - start,
            color=colour,
            ls="--",
            lw=1.8,
        )
    axes.annotate(
        f"free-moving: at most {FREE_TENSION_MAX_N:g} N",
        (intervals[-1].start - start, FREE_TENSION_MAX_N),
        xytext=(2, 3),
        textcoords="offset points",
        color=colour,
        fontsize=TICKS - 1,
        va="bottom",
    )


def finish(panels: list[Axes], run: BenchRun, start: float) -> Any:
    """Set the properties of all panels.

    Args:
        panels: one above the other.
        run: that was recorded.
        start: instant of the recording that becomes 0 [s].
    """
    for axes in panels:
        axes.yaxis.label.set_fontsize(LABEL)
        axes.tick_params(labelsize=TICKS)
    panels[-1].set_xlabel("time from the start of the recording [s]", fontsize=LABEL)
    panels[0].set_xlim(0.0, float(run.time[-1]) - start)
    panels[0].tick_params(bottom=False, labelbottom=False)
