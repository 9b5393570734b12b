# SPDX-License-Identifier: Apache-2.0
"""What the running load programme asked for, at every sample of a recorded run."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from cabols_control.bags.reader import Bag, Series
from cabols_control.checks import FloatArray, IntArray
from cabols_control.run_report.user_frame import UserFrame

TOPIC = "program_wrench"
AXES = tuple(f"{kind}.{axis}" for kind in ("force", "torque") for axis in "xyz")
GAP_NS = 100_000_000
"""Longest time between two messages of a programme that runs [ns]."""


@dataclass(frozen=True, eq=False)
class RecordedProgram:
    """A programme beside a run of k samples; rows are NaN while none ran.

    Attributes:
        command: (k, 6) as given, base axes [N, N m].
        smoothed: (k, 6) as it was meant to be felt [N, N m].
        ahead: (k, 6) command one lead later: what the smoothed curve has begun to follow [N, N m].
        lead: how long before the command's start the run of a previewed programme began [s]; 0 for
            one that is followed by feedback alone.
        frame: in which it was given; None: it is not known where that was, so that all of it is
            taken for base axes.
    """

    command: FloatArray
    smoothed: FloatArray
    ahead: FloatArray
    lead: float
    frame: UserFrame | None = field(default_factory=UserFrame)

    def in_its_frame(self, wrench: FloatArray) -> FloatArray:
        """Return (k, 6) wrenches in the programme's frame, of (k, 6) in base axes [N, N m]."""
        return wrench if self.frame is None else self.frame.from_base(wrench)


def join_program(
    bag: Bag, samples_ns: IntArray, desired: FloatArray, frame: UserFrame | None = None
) -> RecordedProgram:
    """Bring a programme to the samples' times.

    Args:
        bag: of the run.
        samples_ns: (k,) stamps, increasing [ns].
        desired: (k, 6) reference in force [N, N m]: what was asked for, in a bag without the topic.
        frame: in which the programme was given; None: base axes are assumed.
    """
    if TOPIC not in bag or len(bag[TOPIC]) < 2:
        return RecordedProgram(desired, desired, desired, 0.0)
    series = bag[TOPIC]
    order = np.argsort(series.stamp_ns, kind="stable")
    stamps = series.stamp_ns[order]
    lead = float(np.max(np.asarray(series["lead"], dtype=np.float64)))
    command, smoothed = (_wrenches(series, name)[order] for name in ("command", "smoothed"))
    later = samples_ns + round(1e9 * lead)
    place = UserFrame() if frame is None else frame
    return RecordedProgram(
        command=place.to_base(_held(stamps, command, samples_ns)),
        smoothed=place.to_base(_between(stamps, smoothed, samples_ns)),
        ahead=place.to_base(_held(stamps, command, later)),
        lead=lead,
        frame=frame,
    )


def _wrenches(series: Series, name: str) -> FloatArray:
    columns = [np.asarray(series[f"{name}.{axis}"], dtype=np.float64) for axis in AXES]
    return np.column_stack(columns)


def _held(stamps: IntArray, values: FloatArray, samples_ns: IntArray) -> FloatArray:
    """Newest value at each sample; NaN where there is none, or an old one."""
    newest = np.searchsorted(stamps, samples_ns, side="right") - 1
    known = (newest >= 0) & (samples_ns - stamps[np.maximum(newest, 0)] <= GAP_NS)
    return np.where(known[:, None], values[np.maximum(newest, 0)], np.nan)


def _between(stamps: IntArray, values: FloatArray, samples_ns: IntArray) -> FloatArray:
    """Straight lines between the messages: the curve is smooth, its messages are rarer."""
    found = _held(stamps, values, samples_ns)
    known = np.isfinite(found).all(axis=1)
    times, moments = stamps - stamps[0], samples_ns[known] - stamps[0]
    for found_axis, axis in zip(found.T, values.T, strict=True):
        found_axis[known] = np.interp(moments, times, axis)
    return found
