# SPDX-License-Identifier: Apache-2.0
"""Client of the laser tracker's service; see tracker.proto and docs/tracker.md."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import grpc
import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, finite_array, in_range
from cabols_control.errors import CabolsError
from cabols_control.naming import reflector_name
from cabols_hw.tracker import tracker_pb2 as pb
from cabols_hw.tracker.beam import predicted_covariance
from cabols_hw.tracker.config import TrackerConfig, load_tracker_config
from cabols_hw.tracker.plausibility import AskedFor, measure_fault, time_fault
from cabols_hw.tracker.reading import TrackerReading, failed, fault_of
from cabols_hw.tracker.tracker_pb2_grpc import LaserTrackerStub

Expected = Callable[[int], ArrayLike]

# A proxy in the environment is never meant for an instrument on the local network. A tracker that
# was switched on again must be found within a second, not within gRPC's two minutes.
_OPTIONS = (
    ("grpc.enable_http_proxy", 0),
    ("grpc.initial_reconnect_backoff_ms", 100),
    ("grpc.max_reconnect_backoff_ms", 1000),
)
_MAX_TIMEOUT_S = 3600.0


class TrackerError(CabolsError):
    """The tracker's server cannot be reached, does not answer in time or rejects the request.

    Attributes:
        code: gRPC's status code, such as UNAVAILABLE or DEADLINE_EXCEEDED.
    """

    def __init__(self, message: str, code: str) -> None:
        super().__init__(message)
        self.code = code


class TrackerClient:
    """Aims a laser tracker at reflectors and measures them, one at a time.

    After a measurement `newest_status` is the tracker's Status, None if its server has none.

    The answers report the beam's state; an exception means that the tracker's server itself
    failed. Calls may come from any thread; the tracker refuses a second one meanwhile.
    """

    def __init__(
        self,
        address: str | None = None,
        config: TrackerConfig | None = None,
        expected: Expected | None = None,
    ) -> None:
        """Prepare; the first call connects.

        Args:
            address: host:port; None for the configuration's.
            config: reflectors, averaging, limits; None for the reference bench's.
            expected: reflector -> (3,) where it should be now, in the tracker's frame [m], such as
                `lambda i: config.expected(i, position, rotation)` with the newest platform pose.
        """
        self.config = config if config is not None else load_tracker_config()
        self.address = address if address is not None else self.config.address
        self._expected = expected
        self._before_ns = 0
        self.newest_status: Any = None
        self._channel = grpc.insecure_channel(self.address, options=_OPTIONS)
        self._stub = LaserTrackerStub(self._channel)

    def close(self) -> None:
        """Drop the connection; calls under way end with a TrackerError."""
        self._channel.close()

    def __enter__(self) -> TrackerClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def status(self) -> Any:
        """Return the tracker's Status of tracker.proto.

        Raises:
            TrackerError: if the tracker's server does not answer.
        """
        return self._call("GetStatus", pb.StatusRequest(), self.config.call_timeout)

    def aim(
        self, reflector: int, search: bool = True, expected: ArrayLike | None = None
    ) -> TrackerReading:
        """Point the beam at a reflector and lock on it.

        Args:
            reflector: index, from 0.
            search: search around the expected position if the reflector is not there.
            expected: (3,) where it should be, tracker's frame [m]; None: ask the callable.

        Returns:
            success and reason; position is one of a single sample, with success.

        Raises:
            TrackerError: if the tracker's server does not answer, or not in time.
            OutOfRangeError, ShapeError: if there is no such reflector or expected is no point.
        """
        point = self._where(reflector, expected)
        target = pb.Target(position_m=pb.Vector3(x=point[0], y=point[1], z=point[2]))
        radius = self.config.search_radius
        reply = self._call(
            "Aim",
            pb.AimRequest(target=target, search_radius_m=radius),
            self._wall(self.config.aim_timeout),
        )
        if search and not reply.success and reply.reason == pb.REASON_NOT_FOUND:
            reply = self._call(
                "Search",
                pb.SearchRequest(target=target, search_radius_m=radius),
                self._wall(self.config.search_timeout),
            )
        if not reply.success:
            return failed(_why(reply))
        # A single sample has the covariance of the noise model.
        return self._reading(_vector(reply.position_m), None, point, 1, 0.0, reply)

    def measure(
        self,
        reflector: int,
        averaging_s: float | None = None,
        search: bool = True,
        expected: ArrayLike | None = None,
    ) -> TrackerReading:
        """Aim at a reflector and measure it.

        Args:
            reflector: index, from 0.
            averaging_s: averaging time [s]; None or 0: the configuration's.
            search: search around the expected position if the reflector is not there.
            expected: (3,) where it should be, tracker's frame [m]; None: ask the callable.

        Returns:
            The measurement. A broken beam, no reflector, or one too far from where it should be
            is success False with a reason, never an exception.

        Raises:
            TrackerError: if the tracker's server does not answer, or not in time.
            OutOfRangeError, ShapeError: if there is no such reflector, the averaging time is none
                or expected is no point.
        """
        seconds = averaging_s if averaging_s else self.config.averaging_time
        in_range("averaging_s", seconds, 1e-3, 600.0)
        point = self._where(reflector, expected)
        aimed = self.aim(reflector, search, point)
        if not aimed.success:
            return aimed
        reply = self._call(
            "Measure",
            pb.MeasureRequest(averaging_time_s=seconds, rate_hz=self.config.rate),
            self._wall(self.config.measure_timeout + seconds),
        )
        answered_ns = time.time_ns()
        if not reply.success:
            return failed(_why(reply))
        covariance = _matrix(reply.covariance_m2) if reply.HasField("covariance_m2") else None
        fault = measure_fault(reply, covariance, _vector(reply.position_m), self.config)
        fault = fault or self._not_now(reply, seconds)
        if fault:
            return failed(f"implausible: {fault}")
        reading = self._reading(
            _vector(reply.position_m),
            covariance,
            point,
            int(reply.samples),
            # A server that does not say it has averaged for as long as it was asked to.
            float(reply.averaging_time_s) or (seconds if reply.samples > 1 else 0.0),
            reply,
        )
        if not reading.success:
            return reading
        averaged_s = reading.averaging_s * max(1.0, self.config.time_stretch)
        return replace(reading, middle_ns=answered_ns - round(0.5e9 * averaged_s))

    def _not_now(self, reply: Any, seconds: float) -> str:
        """Why a measurement is none of now, with a beam; the tracker's state tells, if it can."""
        clock_ns = 0
        try:
            status = self.status()
        except TrackerError as error:
            if error.code != "UNIMPLEMENTED":
                raise
        else:
            if not status.beam_locked:
                why = status.message or "no reason given"
                return f"success, but the beam is lost ({why}): aim again, then measure again"
            clock_ns = int(status.time_ns)
            self.newest_status = status
        asked = AskedFor(seconds, clock_ns, self._before_ns)
        fault = time_fault(reply, asked, self.config.time_stretch)
        self._before_ns = int(reply.time_ns)
        return fault

    def _where(self, reflector: int, expected: ArrayLike | None) -> FloatArray:
        self.config.point(reflector)
        if expected is None:
            if self._expected is None:
                raise TrackerError(
                    f"{reflector_name(reflector)}: expected its nominal position, got "
                    "nothing; pass expected=, or a callable to TrackerClient",
                    "INVALID_ARGUMENT",
                )
            expected = self._expected(reflector)
        return finite_array("expected", expected, (3,))

    def _reading(
        self,
        position: FloatArray,
        covariance: FloatArray | None,
        expected: FloatArray,
        samples: int,
        averaging_s: float,
        reply: Any,
    ) -> TrackerReading:
        if covariance is None and np.isfinite(position).all() and np.linalg.norm(position) > 1e-3:
            floor = self.config.averaging_floor**2
            factor = floor + (1.0 - floor) / max(samples, 1)
            covariance = predicted_covariance(position, self.config.noise, factor)
        if covariance is None:
            covariance = np.full((3, 3), np.nan)
        fault = fault_of(position, covariance, expected, self.config.search_radius)
        if fault:
            return failed(fault)
        return TrackerReading(
            position=position,
            covariance=covariance,
            rms=float(getattr(reply, "rms_m", 0.0)),
            temperature=float(getattr(reply, "temperature_c", np.nan)),
            samples=samples,
            averaging_s=averaging_s,
            success=True,
            reason="",
            time_ns=int(getattr(reply, "time_ns", 0)),
        )

    def _wall(self, seconds: float) -> float:
        return min(seconds * max(1.0, self.config.time_stretch), _MAX_TIMEOUT_S)

    def _call(self, name: str, request: Any, timeout_s: float) -> Any:
        try:
            return getattr(self._stub, name)(request, timeout=timeout_s)
        except grpc.RpcError as error:
            code = error.code().name
            raise TrackerError(self._explain(name, timeout_s, code, error), code) from error
        except ValueError as error:
            # gRPC raises this if the channel was closed.
            raise TrackerError(f"laser tracker: {error}; make a new client", "CLOSED") from error

    def _explain(self, name: str, timeout_s: float, code: str, error: Any) -> str:
        what = f"laser tracker at {self.address}: {name}"
        details = error.details() or ""
        if code == "UNAVAILABLE":
            return (
                f"{what}: expected an answer, got no connection ({details}); start the tracker's "
                "server and check the address in the tracker's configuration"
            )
        if code == "DEADLINE_EXCEEDED":
            return (
                f"{what}: expected an answer within {timeout_s:.3g} s, got none; is the tracker "
                "busy or its computer hung? Raise the time-outs in its configuration if it is slow"
            )
        if code == "UNIMPLEMENTED":
            return (
                f"{what}: expected the service cabols.tracker.v1.LaserTracker, got a server "
                "without it; is this the tracker's address, and its server of the same version?"
            )
        if code == "CANCELLED":
            return f"{what}: the connection was closed meanwhile; make a new client"
        return f"{what}: expected an answer, got {code} ({details})"


def _why(reply: Any) -> str:
    name = pb.Reason.Name(reply.reason) if reply.reason in pb.Reason.values() else "REASON_UNKNOWN"
    text = name.removeprefix("REASON_").lower().replace("_", " ")
    return f"{text}: {reply.message}" if reply.message else text


def _vector(message: Any) -> FloatArray:
    return np.array([message.x, message.y, message.z])


def _matrix(message: Any) -> FloatArray:
    return np.array(
        [
            [message.xx, message.xy, message.xz],
            [message.xy, message.yy, message.yz],
            [message.xz, message.yz, message.zz],
        ]
    )
