# SPDX-License-Identifier: Apache-2.0
"""A tracker's reading as a message, and its state as numbers for /diagnostics."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from cabols_msgs.msg import ReflectorMeasurement

from cabols_control.stamps import set_time
from cabols_control.supervision.faults import Fault, FaultName
from cabols_hw.tracker.reading import TrackerReading

LARGEST_DRIFT_M = 1.0


def measurement_message(
    request: Any, reading: TrackerReading | None, reason: object, stamp_ns: int, frame: str
) -> ReflectorMeasurement:
    """Return a reading as a message: what was done, not what was asked for.

    Args:
        request: goal of MeasureReflector.
        reading: what the tracker gave; None if it gave nothing.
        reason: why it gave nothing.
        stamp_ns: middle of the averaging time, the rig's clock [ns].
        frame: of the measured position.
    """
    message = ReflectorMeasurement(reflector=request.reflector)
    set_time(message.header.stamp, max(stamp_ns, 0))
    message.header.frame_id = frame
    good = reading is not None and bool(reading.success)
    position = np.asarray(reading.position) if reading and good else np.full(3, np.nan)
    covariance = np.asarray(reading.covariance) if reading and good else np.full((3, 3), np.nan)
    for axis, value in zip("xyz", position.tolist(), strict=True):
        setattr(message.position, axis, value)
    message.covariance = covariance.ravel().tolist()
    message.success = good
    if reading is not None:
        message.rms, message.temperature = float(reading.rms), float(reading.temperature)
        message.samples = int(reading.samples)
        message.averaging_time = float(reading.averaging_s)
        reason = reading.reason
    message.reason = "" if good else str(reason)
    return message


def status_notes(status: Any) -> dict[str, int]:
    """Return the tracker's warm-up as numbers by name.

    Args:
        status: Status of tracker.proto.
    """
    drift_m = float(status.expected_drift_m)
    if not 0.0 <= drift_m <= LARGEST_DRIFT_M:
        drift_m = LARGEST_DRIFT_M
    on_time_s = float(status.on_time_s)
    return {
        "tracker_warming_up": int(status.warming_up),
        "tracker_on_time_s": int(on_time_s) if math.isfinite(on_time_s) else -1,
        "tracker_expected_drift_nm": int(1e9 * drift_m),
    }


def warm_up_note(status: Any) -> Fault | None:
    """Return what is to be said of the tracker's warm-up; None once it is warm.

    Args:
        status: Status of tracker.proto.
    """
    if not status.warming_up:
        return None
    drift_um = 1e-3 * status_notes(status)["tracker_expected_drift_nm"]
    return Fault(
        FaultName.TRACKER_WARM_UP,
        f"tracker: it warms up, {drift_um:.0f} um of drift are still to be expected: wait, or "
        "measure the first configuration again at the end",
    )
