# SPDX-License-Identifier: Apache-2.0
"""Pictures of whatever topics a bag has: one part for each topic; missing ones are named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from cabols_control.bags.reader import Bag, Series
from cabols_control.checks import FloatArray
from cabols_control.naming import joint_name, limb_name
from cabols_control.rig import Rig
from cabols_control.run_report.motion import POSITION
from cabols_control.run_report.pictures.run_figures import (
    COMPONENTS,
    DESIRED,
    LIMB_COLOURS,
    MEASURED,
    POINTS,
    decimate,
    limit_line,
    new_figure,
    tidy,
)
from cabols_control.run_report.pictures.session_figure import MODE_COLOURS, MODE_NAMES
from cabols_control.run_report.programme import AXES
from cabols_control.run_report.run import QUATERNION
from cabols_control.run_report.user_frame import (
    frame_of,
    poses_at,
    recorded_frames,
    user_frame,
)
from cabols_control.supervision.modes import OperatingMode

TIME = "time from the start of the recording [s]"
Drawer = Callable[[Bag, Rig], Figure]


@dataclass(frozen=True)
class Part:
    """One picture of a report.

    Attributes:
        title: what it shows.
        topic: that it needs.
        draw: makes the picture.
    """

    title: str
    topic: str
    draw: Drawer


def times(bag: Bag, series: Series) -> FloatArray:
    """Return a topic's times from the start of the recording [s].

    Args:
        bag: that was recorded.
        series: of one of its topics.
    """
    if series.stamp.size:
        return series.stamp
    first = min(int(each.log_time_ns.min()) for each in bag.topics.values() if len(each))
    return np.multiply(1e-9, series.log_time_ns - first)


def table(series: Series, field: str) -> FloatArray:
    """Return a field as (k, n) numbers; shorter rows end in NaN.

    Args:
        series: of a topic.
        field: with a list in each message.
    """
    values = series[field]
    if isinstance(values, np.ndarray):
        return np.asarray(values.reshape(len(values), -1), np.float64)
    found = np.full((len(values), max((len(row) for row in values), default=0)), np.nan)
    for k, row in enumerate(values):
        found[k, : len(row)] = row
    return found


def by_limb(series: Series, field: str) -> FloatArray:
    """Return a field as (k, n) numbers, each in its limb's column; nodes may serve subsets.

    Args:
        series: of a topic whose messages name their limbs.
        field: with a value for each of them.
    """
    limbs, values = table(series, "limb"), table(series, field)
    known = limbs[np.isfinite(limbs)]
    found = np.full((len(series), int(known.max()) + 1 if known.size else 0), np.nan)
    for column in range(limbs.shape[1]):
        rows = np.flatnonzero(np.isfinite(limbs[:, column]))
        found[rows, limbs[rows, column].astype(int)] = values[rows, column]
    return found


def _lines(
    axes: Axes, time: FloatArray, values: FloatArray, name: Callable[[int], str] = limb_name
) -> None:
    for k in range(values.shape[1]):
        colour = LIMB_COLOURS[k % len(LIMB_COLOURS)]
        style = "-" if k < len(LIMB_COLOURS) else ":"
        x, y = decimate(time, values[:, k], POINTS)
        axes.plot(x, y, color=colour, ls=style, lw=1.2, label=name(k))
    if values.shape[1]:
        axes.legend(ncols=4, fontsize=8, loc="upper right")


def _one(time: FloatArray, values: FloatArray, label: str) -> tuple[Figure, Axes]:
    figure = new_figure(11.0, 3.6)
    axes = figure.subplots()
    _lines(axes, time, values)
    tidy(axes, label, TIME)
    return figure, axes


def _tension_scale(axes: Axes) -> None:
    """Show least and largest tensions at once; below zero only if there is anything."""
    axes.set_yscale("symlog", linthresh=1.0)
    if axes.dataLim.ymin >= 0.0:
        axes.set_ylim(bottom=0.0)


def draw_modes(bag: Bag, rig: Rig) -> Figure:
    """Draw the operating modes as bands.

    Args:
        bag: with mode.
        rig: not used; all parts are drawn alike.
    """
    del rig
    series = bag["mode"]
    time = times(bag, series)
    end = max(float(np.nanmax(times(bag, each))) for each in bag.topics.values() if len(each))
    figure = new_figure(11.0, 1.6)
    axes = figure.subplots()
    numbers = np.asarray(series["mode"]).astype(int)
    first = int(np.flatnonzero(np.isfinite(time))[0]) if np.isfinite(time).any() else 0
    changes = [first, *(k for k in range(first + 1, len(time)) if numbers[k] != numbers[k - 1])]
    for k, begin in enumerate(changes):
        until = float(time[changes[k + 1]]) if k + 1 < len(changes) else end
        mode = OperatingMode(int(numbers[begin]))
        axes.axvspan(float(time[begin]), until, color=MODE_COLOURS[mode], lw=0)
        axes.text(
            0.5 * (float(time[begin]) + until),
            0.5,
            MODE_NAMES[mode],
            ha="center",
            va="center",
            fontsize=8,
            clip_on=True,
            transform=axes.get_xaxis_transform(),
        )
    axes.set_yticks([])
    tidy(axes, "", TIME)
    return figure


def draw_tensions(bag: Bag, rig: Rig) -> Figure:
    """Draw the estimated cable tensions with their limits.

    Args:
        bag: with limb_state.
        rig: whose limits are drawn.
    """
    series = bag["limb_state"]
    figure, axes = _one(times(bag, series), by_limb(series, "tension"), "cable tension [N]")
    limit_line(axes, rig.control.tension_max, f"limit {rig.control.tension_max:g} N")
    limit_line(axes, rig.control.tension_min, f"least {rig.control.tension_min:g} N")
    _tension_scale(axes)
    return figure


def draw_commands(bag: Bag, rig: Rig) -> Figure:
    """Draw the setpoints of the tensions with their limits.

    Args:
        bag: with tension_command.
        rig: whose limits are drawn.
    """
    series = bag["tension_command"]
    label = "setpoint of the tension [N]"
    figure, axes = _one(times(bag, series), by_limb(series, "tension"), label)
    limit_line(axes, rig.control.tension_max, f"limit {rig.control.tension_max:g} N")
    limit_line(axes, rig.control.tension_min, f"least {rig.control.tension_min:g} N")
    _tension_scale(axes)
    return figure


def draw_currents(bag: Bag, rig: Rig) -> Figure:
    """Draw the motor currents with their limits.

    Args:
        bag: with motor_current or limb_state.
        rig: whose limits are drawn.
    """
    series = bag["motor_current"]
    figure, axes = _one(times(bag, series), by_limb(series, "current"), "motor current [A]")
    limit = rig.control.current_limit
    limit_line(axes, limit, f"limit {limit:g} A")
    limit_line(axes, -limit, f"limit {-limit:g} A")
    return figure


def draw_wrench(bag: Bag, rig: Rig) -> Figure:
    """Draw the measured wrench, and what was asked for, in the frame in which it was asked for.

    Args:
        bag: with wrench, and what was asked for as far as it is recorded.
        rig: not used; all parts are drawn alike.
    """
    del rig
    figure = new_figure(11.0, 8.0)
    panels = figure.subplots(3, 2, sharex=True).T.ravel()
    asked, prefix, label = "program_wrench", "command.", "command"
    if asked not in bag:
        asked, prefix, label = "desired_wrench", "wrench.", "desired"
    felt, where = _felt(bag, asked)
    lines = [("wrench", felt, f"measured, {where}", MEASURED)]
    if asked in bag:
        series = bag[asked]
        values = np.column_stack([np.asarray(series[prefix + axis], float) for axis in AXES])
        name = frame_of(bag, asked)
        lines.append((asked, values, f"{label}, in {name}" if name else label, DESIRED))
    for topic, values, text, colour in lines:
        time = times(bag, bag[topic])
        for axes, column in zip(panels, values.T, strict=True):
            x, y = decimate(time, column, POINTS)
            axes.plot(x, y, color=colour, lw=1.2, label=text)
    for axes, label in zip(panels, COMPONENTS, strict=True):
        tidy(axes, label)
    for axes in panels[2::3]:
        axes.set_xlabel(TIME)
    panels[0].legend(fontsize=8)
    return figure


def _felt(bag: Bag, asked: str) -> tuple[FloatArray, str]:
    """Return the measured wrench in the frame of what was asked for, and what that frame is."""
    series = bag["wrench"]
    felt = np.column_stack([np.asarray(series[f"wrench.{axis}"], float) for axis in AXES])
    poses = poses_at(bag, series.stamp_ns)
    if poses is None:
        return felt, "platform's axes"
    turned = np.hstack(
        [np.einsum("kij,kj->ki", poses.rotation, part) for part in np.hsplit(felt, 2)]
    )
    name = frame_of(bag, asked)
    frame = user_frame(recorded_frames(bag.metadata), name, poses)
    if frame is None:
        return turned, "base axes"
    return frame.from_base(turned), f"in {name}" if name else "base axes"


def draw_pose(bag: Bag, rig: Rig) -> Figure:
    """Draw how far the platform moved and turned from its first pose.

    Args:
        bag: with platform_pose.
        rig: not used; all parts are drawn alike.
    """
    del rig
    series = bag["platform_pose"]
    time = times(bag, series)
    position = np.column_stack([np.asarray(series[name], float) for name in POSITION])
    quaternion = np.column_stack([np.asarray(series[name], float) for name in QUATERNION])
    figure = new_figure(11.0, 5.0)
    way, turn = figure.subplots(2, 1, sharex=True)
    _lines(way, time, 1e3 * (position - position[0]), lambda k: "xyz"[k])
    tidy(way, "change of position [mm]")
    rotation = Rotation.from_quat(quaternion)
    angle = np.degrees((rotation * rotation[0].inv()).magnitude())
    turn.plot(*decimate(time, angle, POINTS), color=DESIRED, lw=1.2)
    tidy(turn, "turned by [deg]", TIME)
    return figure


def draw_joints(bag: Bag, rig: Rig) -> Figure:
    """Draw how far the robot's joints moved from their first angles.

    Args:
        bag: with joint_states.
        rig: not used; all parts are drawn alike.
    """
    del rig
    series = bag["joint_states"]
    angles = np.degrees(table(series, "position"))
    figure = new_figure(11.0, 3.6)
    axes = figure.subplots()
    _lines(axes, times(bag, series), angles - angles[0], joint_name)
    tidy(axes, "change of joint angle [deg]", TIME)
    return figure


PARTS = (
    Part("Operating modes", "mode", draw_modes),
    Part("Wrench on the platform", "wrench", draw_wrench),
    Part("Cable tensions, estimated", "limb_state", draw_tensions),
    Part("Cable tensions, setpoints", "tension_command", draw_commands),
    Part("Motor currents", "motor_current", draw_currents),
    Part("Platform", "platform_pose", draw_pose),
    Part("Robot's joints", "joint_states", draw_joints),
)
TOPICS = (
    *(part.topic for part in PARTS),
    *("desired_wrench", "program_wrench", "loop_status", "reflector_measurement"),
)
