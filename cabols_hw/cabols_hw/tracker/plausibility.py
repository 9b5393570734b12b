# SPDX-License-Identifier: Apache-2.0
"""Numbers of a tracker's server, held against each other and against the configured noise.

A server may report in millimetres, report standard deviations as variances, leave a field at zero
or repeat an old measurement. A covariance that is wrong by a factor of a million would decide what
a measurement counts in the identification.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from cabols_control.checks import FloatArray
from cabols_hw.tracker.config import TrackerConfig

SPREAD = 3.0
"""A standard deviation may exceed rms and configured noise, of one sample, by this factor."""

UNBELIEVABLE = 0.1
"""A mean is never better than this share of rms / sqrt(samples)."""

FINEST = 0.003
"""Smallest believable standard deviation, as a share of the configured noise of one sample."""

AIR_C = (-50.0, 80.0)
"""Air in which a tracker measures [degrees Celsius]; one that knows none says NaN or nothing."""

TIME_S = 5.0
"""Largest disagreement of a measurement's time with the tracker's clock [s]."""

DAY_S = 86400.0


@dataclass(frozen=True)
class AskedFor:
    """What a measurement was asked for, and when.

    Attributes:
        averaging_s: averaging time [s].
        clock_ns: the tracker's clock when it had answered [ns]; 0 if it does not tell.
        before_ns: time of the measurement before [ns]; 0 for none.
    """

    averaging_s: float
    clock_ns: int = 0
    before_ns: int = 0


def measure_fault(
    reply: Any, covariance: FloatArray | None, position: FloatArray, config: TrackerConfig
) -> str:
    """Return why the numbers of a successful MeasureReply cannot be used; empty if they can.

    Args:
        reply: MeasureReply of tracker.proto.
        covariance: (3, 3) that it reports [m^2]; None if it reports none.
        position: (3,) measured, tracker's frame [m].
        config: of the client.
    """
    if reply.reason:
        return (
            f"success, but with the reason {int(reply.reason)} of a failure ({reply.message}): the "
            "server contradicts itself"
        )
    if not reply.samples >= 1:
        return "expected at least one sample, got none: nothing was averaged"
    rms = float(reply.rms_m)
    if not 0.0 <= rms <= config.rms_max:
        return (
            f"expected samples within {1e3 * config.rms_max:.3g} mm rms of their mean, got "
            f"{1e3 * rms:.4g} mm: does the platform move, or does the server report in other units?"
        )
    temperature = float(reply.temperature_c)
    if not (math.isnan(temperature) or AIR_C[0] <= temperature <= AIR_C[1]):
        return f"expected an air temperature of {AIR_C[0]:g} to {AIR_C[1]:g} C, got {temperature:g}"
    if covariance is None or not (np.isfinite(position).all() and np.isfinite(covariance).all()):
        return ""
    return _covariance_fault(covariance, rms, int(reply.samples), position, config)


def _covariance_fault(
    covariance: FloatArray, rms: float, samples: int, position: FloatArray, config: TrackerConfig
) -> str:
    sigmas = config.noise.sigmas(float(np.linalg.norm(position)))
    values = np.linalg.eigvalsh(covariance)
    largest = math.sqrt(max(float(values[-1]), 0.0))
    smallest = math.sqrt(max(float(values[0]), 0.0))
    most = SPREAD * max(rms, float(sigmas.max()))
    least = max(UNBELIEVABLE * rms / math.sqrt(3.0 * samples), FINEST * float(sigmas.min()))
    if not largest <= most:
        return (
            f"expected standard deviations of at most {1e6 * most:.3g} um (rms "
            f"{1e6 * rms:.3g} um, configured noise {1e6 * sigmas.max():.3g} um), the covariance "
            f"gives {1e6 * largest:.3g} um: does the server report mm^2, or deviations in place of "
            "variances? Let it leave the covariance out, and the configured noise is used"
        )
    if not smallest >= least:
        return (
            f"expected standard deviations of at least {1e6 * least:.3g} um ({samples} samples of "
            f"rms {1e6 * rms:.3g} um), the covariance gives {1e6 * smallest:.3g} um: let the "
            "server leave it out, and the configured noise is used"
        )
    return ""


def time_fault(reply: Any, asked: AskedFor, stretch: float) -> str:
    """Return why a measurement is not the one that was asked for; empty if it is.

    Args:
        reply: MeasureReply of tracker.proto.
        asked: for what.
        stretch: wall time in a second of the tracker's time.
    """
    averaged = float(reply.averaging_time_s)
    tolerance = 0.1 * asked.averaging_s + 0.02
    if averaged and not abs(averaged - asked.averaging_s) <= tolerance:
        return (
            f"expected an averaging time of {asked.averaging_s:.4g} s, got {averaged:.4g} s: does "
            "another client use the tracker, or does the server report in ms?"
        )
    taken_ns = int(reply.time_ns)
    if not taken_ns:
        return ""
    if taken_ns == asked.before_ns:
        return "got the measurement before once more: the server repeats an old answer"
    local_ns = time.time_ns()
    clock_ns = asked.clock_ns
    if not clock_ns and abs(local_ns - taken_ns) < 1e9 * DAY_S:
        clock_ns = local_ns
    away = 1e-9 * (clock_ns - taken_ns) if clock_ns else 0.0
    if not abs(away) <= TIME_S * max(stretch, 1.0) + asked.averaging_s:
        return (
            f"expected a measurement of now, its time is {away:.4g} s before the "
            f"{'tracker' if asked.clock_ns else 'computer'}'s clock: an old measurement, or a "
            "clock that is not set"
        )
    return ""
