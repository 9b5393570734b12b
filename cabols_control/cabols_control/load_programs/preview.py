# SPDX-License-Identifier: Apache-2.0
"""A programme that is known in advance, followed without lag: smoothed, then previewed.

The wrench follows its reference by the designed response G of (3.26). A reference that is the
smoothed programme divided by G gives the smoothed programme itself: inverse of the design as
feed-forward, with the feedback as it is. The smoothing is a window without phase, so that it can
begin before a step does, which only a programme that is known in advance allows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import lfilter

from cabols_control.checks import FloatArray
from cabols_control.errors import ConfigError
from cabols_control.gains import WrenchGains
from cabols_control.load_programs.programs import LoadProgram
from cabols_control.rig import ControlConfig

PERIOD_S = 0.001
"""Between the points of a shaped programme [s]."""
BOXES = 4
"""Moving averages, one after the other: the smoothed curve has three continuous derivatives but the
last, as many as 1 / G asks for."""
DERIVATIVES = 3
"""Each reaches one point farther."""
LONGEST_S = 3600.0
"""Longest programme that is shaped, at a point per millisecond [s]: a gigabyte and 20 s of work."""
SETTLED_S = 0.5
"""After its last point a wrench that is followed by feedback alone has arrived [s]."""
BOX_BANDWIDTH = 0.2266
"""-3 dB of BOXES moving averages of a width T, times T: sinc(x)^4 = 1 / sqrt(2)."""


@dataclass(frozen=True, eq=False)
class ShapedProgram:
    """A programme as it is followed.

    Attributes:
        command: what was asked for.
        smoothed: what the wrench is meant to be; begins `lead` before the command does.
        reference: what the wrench law follows, of the same times.
        lead: how long before the command's start it begins [s].
        bandwidth: -3 dB of the smoothing [Hz].
    """

    command: LoadProgram
    smoothed: LoadProgram
    reference: LoadProgram
    lead: float
    bandwidth: float

    @property
    def name(self) -> str:
        """Of the programme."""
        return self.command.name

    @property
    def duration(self) -> float:
        """From the start of the smoothed programme to its end [s]."""
        return self.smoothed.duration

    def control(self, gains: WrenchGains) -> LoadProgram:
        """Control signal u of (3.17) that the cables have to give, where the wrench is smoothed.

        Args:
            gains: of the wrench law.
        """
        error = self.reference.sample(self.smoothed.time) - self.smoothed.wrench
        integral = gains.integral * PERIOD_S * np.cumsum(error, axis=0)
        return replace(self.smoothed, wrench=gains.proportional * error + integral)


def as_given(program: LoadProgram) -> ShapedProgram:
    """Return a programme that is followed by feedback alone: by the designed response."""
    return ShapedProgram(program, program, program, lead=0.0, bandwidth=np.inf)


def designed_response(program: LoadProgram, design: ControlConfig) -> LoadProgram:
    """Return what the platform feels of a programme by feedback alone: by G of (3.26).

    Args:
        program: as given.
        design: poles and zero of the wrench's response.

    Returns:
        The response, a point per millisecond, until it has settled.
    """
    points = int(np.ceil((program.duration + SETTLED_S) / PERIOD_S)) + 1
    # It begins without a load, whatever the first point asks for.
    time = _clock(-1, points)
    first, *others = design.poles
    found = program.sample(time)
    lead = abs(first) / abs(design.zero)
    found = lead * found + (1.0 - lead) * _lag(found, 1.0 / abs(first))
    for pole in others:
        found = _lag(found, 1.0 / abs(pole))
    return LoadProgram(program.name, time[1:], found[1:], held=False)


def smoothed_rise_time(design: ControlConfig) -> float:
    """10 to 90 % rise of a smoothed step [s]."""
    times, values = np.array([0.0, 1.0]), np.array([[0.0] * 6, [1.0] * 6])
    shaped = shape_program(LoadProgram("step", times, values, held=True), design)
    share = shaped.smoothed.wrench[:, 0]
    low, high = np.interp([0.1, 0.9], share, shaped.smoothed.time)
    return float(high - low)


def check_length(program: LoadProgram) -> None:
    """Refuse a programme that is too long to be shaped.

    Raises:
        ConfigError: if it is longer than LONGEST_S.
    """
    if not program.duration <= LONGEST_S:
        raise ConfigError(
            f"{program.name}: expected at most {LONGEST_S:g} s for a preview, got "
            f"{program.duration:g} s; split it, or follow it by feedback alone (preview:=false)"
        )


def shape_program(
    program: LoadProgram,
    design: ControlConfig,
    held_s: float = 0.0,
    bandwidth: float | None = None,
) -> ShapedProgram:
    """Smooth a programme and divide it by the designed response.

    Args:
        program: as asked for.
        design: poles and zero of the wrench's response, bandwidth of the smoothing, delay of the
            loop beside the design.
        held_s: for how long the wrench law holds each value of the reference [s].
        bandwidth: -3 dB of the smoothing in place of the design's [Hz].

    Returns:
        Smoothed programme and reference, a point per millisecond.

    Raises:
        ConfigError: if the programme is longer than LONGEST_S.
    """
    check_length(program)
    width = BOX_BANDWIDTH / (bandwidth or design.preview_bandwidth)
    # An odd number of points, so that windows are centred; not more than the bandwidth permits.
    box = max(2 * int(0.5 * (width / PERIOD_S - 1.0)) + 1, 3)
    half = BOXES * (box - 1) // 2
    ahead = _ahead(design, held_s)
    lead, tail = half + ahead + DERIVATIVES, half + DERIVATIVES
    points = int(np.ceil(program.duration / PERIOD_S)) + 1
    # The window reaches beyond both ends of what is followed.
    time = _clock(-lead - half, points + tail + half)
    smoothed = program.sample(time)
    for _ in range(BOXES):
        smoothed = _average(smoothed, box)
    reference = _divide(smoothed, design)
    reference = np.vstack([reference[ahead:], np.repeat(reference[-1:], ahead, axis=0)])
    keep = slice(half, time.size - half)
    clock = _clock(0, time[keep].size)
    return ShapedProgram(
        command=program,
        smoothed=LoadProgram(program.name, clock, smoothed[keep], held=False),
        reference=LoadProgram(program.name, clock, reference[keep], held=False),
        lead=PERIOD_S * lead,
        bandwidth=BOX_BANDWIDTH / (box * PERIOD_S),
    )


def aim_at(
    shaped: ShapedProgram, correction: FloatArray, design: ControlConfig, held_s: float = 0.0
) -> ShapedProgram:
    """Aim beside the smoothed curve, which stays what the wrench is meant to be.

    Args:
        shaped: the programme.
        correction: (k, 6) smooth, added to what the reference aims at [N, N m].
        design: as `shape_program`.
        held_s: as `shape_program`.

    Returns:
        The same programme with another reference.
    """
    extra = _divide(correction, design)
    ahead = _ahead(design, held_s)
    extra = np.vstack([extra[ahead:], np.repeat(extra[-1:], ahead, axis=0)])
    reference = shaped.reference.sample(shaped.smoothed.time) + extra
    return replace(shaped, reference=replace(shaped.reference, wrench=reference))


def _ahead(design: ControlConfig, held_s: float) -> int:
    """Points by which a reference comes early: the loop's delay, and what it is held for."""
    return round((design.preview_delay + 0.5 * held_s) / PERIOD_S)


def _clock(first: int, end: int) -> FloatArray:
    """Times of points from one number to before another [s]."""
    return np.asarray(PERIOD_S * np.arange(first, end), dtype=np.float64)


def _average(values: FloatArray, box: int) -> FloatArray:
    """Centred moving average of the rows; beyond the ends they go on as they are there."""
    return np.asarray(uniform_filter1d(values, box, axis=0, mode="nearest"))


def _divide(smoothed: FloatArray, design: ControlConfig) -> FloatArray:
    """1 / G of the smoothed rows: derivatives, and what the zero makes of the rest.

    1 / G = prod(1 - s / p_i) / (1 - s / z); by division a polynomial of third degree in s and a
    first-order lag of 1 / |z|.
    """
    zero = -abs(design.zero)
    numerator = np.poly(design.poles) / np.prod(np.negative(design.poles))
    polynomial, rest = np.polydiv(numerator, [-1.0 / zero, 1.0])
    found = np.zeros_like(smoothed)
    derivative = smoothed
    for coefficient in polynomial[::-1]:
        found += coefficient * derivative
        derivative = np.gradient(derivative, PERIOD_S, axis=0)
    return found + float(rest[-1]) * _lag(smoothed, 1.0 / abs(zero))


def _lag(values: FloatArray, time_constant: float) -> FloatArray:
    """First-order lag of the rows, exact for straight lines between them; starts at rest."""
    share = PERIOD_S / time_constant
    kept = np.exp(-share)
    mean = (1.0 - kept) / share
    steps = lfilter([1.0 - mean, mean - kept], [1.0, -kept], values - values[:1], axis=0)
    return np.asarray(values[:1] + steps)
