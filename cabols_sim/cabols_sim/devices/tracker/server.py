# SPDX-License-Identifier: Apache-2.0
"""The simulated laser tracker's server: tracker.proto on the simulated rig.

Time is the rig's: a second is a second of the truth's time_ns, at whatever speed the rig runs,
within a limit of wall time.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

import grpc
import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.errors import CabolsError
from cabols_hw.tracker import tracker_pb2 as pb
from cabols_hw.tracker.tracker_pb2_grpc import (
    LaserTrackerServicer,
    add_LaserTrackerServicer_to_server,
)
from cabols_sim.devices.tracker.config import TrackerTruthConfig
from cabols_sim.devices.tracker.model import Loss, TrackerModel
from cabols_sim.devices.tracker.watch import Truth, Watch

_ANSWER_MARGIN_S = 0.5
"""Reserve of the caller's deadline [s], for the reason in place of a bare DEADLINE_EXCEEDED."""


class TrackerServer:
    """Serves the simulated tracker on 127.0.0.1, from threads of its own."""

    def __init__(self, truth: Truth, config: TrackerTruthConfig, port: int = 0) -> None:
        """Not yet listening.

        Args:
            truth: of the rig.
            config: of the tracker.
            port: 0 for any free one.
        """
        self._port = port
        self._watch = Watch(truth, TrackerModel(config))
        # Two calls that wait, one that answers BUSY, one for the status.
        self._server = grpc.server(
            ThreadPoolExecutor(4, thread_name_prefix="tracker"), options=[("grpc.so_reuseport", 0)]
        )
        add_LaserTrackerServicer_to_server(_Service(self._watch, config), self._server)

    def start(self) -> int:
        """Open the port.

        Returns:
            The port.

        Raises:
            CabolsError: if the port is taken.
        """
        try:
            port = int(self._server.add_insecure_port(f"127.0.0.1:{self._port}"))
        except RuntimeError as error:
            raise CabolsError(
                f"simulated tracker: expected port {self._port} to be free, it is taken; end the "
                "other server or choose another port (0: any)"
            ) from error
        self._watch.start()
        self._server.start()
        return port

    def stop(self) -> None:
        """End calls and threads; within about a second."""
        self._watch.stop()
        self._server.stop(grace=0.2).wait(1.0)


class _RefusedError(Exception):
    """A call without success: name of the Reason, and the message."""

    def __init__(self, reason: str, message: str) -> None:
        super().__init__(message)
        self.reason = reason


class _Service(LaserTrackerServicer):  # type: ignore[misc]
    """Conversion between messages and the model."""

    def __init__(self, watch: Watch, config: TrackerTruthConfig) -> None:
        self._watch = watch
        self._model = watch.model
        self._config = config
        self._one_call = threading.Lock()

    def GetStatus(self, request: Any, context: Any) -> Any:  # noqa: ARG002, N802
        with self._watch.news:
            model = self._model
            locked = model.locked is not None
            return pb.Status(
                ready=self._watch.ready and not self._watch.fault,
                busy=self._one_call.locked(),
                beam_locked=locked,
                beam_lost=pb.REASON_UNSPECIFIED if locked else _LOST[model.loss],
                message=self._watch.fault or ("" if locked else model.loss.value),
                range_m=float(np.linalg.norm(model.point())) if locked else 0.0,
                on_time_s=model.on_time(),
                warming_up=model.warming_up,
                expected_drift_m=model.expected_drift(),
                temperature_c=self._config.temperature,
                max_speed_m_s=self._config.max_speed,
                model="simulated",
                serial_number=str(self._config.seed),
                time_ns=model.time_ns or 0,
            )

    def Aim(self, request: Any, context: Any) -> Any:  # noqa: N802
        target, direction = _target(request.target, context)
        radius = self._config.capture_radius
        if request.search_radius_m != 0.0:
            _check("search_radius_m", request.search_radius_m, 1e-6, 10.0, context)
            radius = min(radius, request.search_radius_m)
        return self._point(target, direction, radius, self._config.aim_time, context)

    def Search(self, request: Any, context: Any) -> Any:  # noqa: N802
        target, direction = _target(request.target, context)
        radius = request.search_radius_m
        _check("search_radius_m", radius, 1e-6, 10.0, context)
        return self._point(target, direction, radius, self._model.search_time(radius), context)

    def _point(
        self, target: FloatArray, direction: bool, radius: float, duration_s: float, context: Any
    ) -> Any:
        try:
            with self._alone(context) as until:
                self._model.locked, self._model.loss = None, Loss.NOT_FOUND
                self._pass_time(duration_s, until, context)
                loss = self._model.aim(target, radius, direction)
                if loss is not Loss.NONE:
                    raise _RefusedError(
                        "REASON_OUT_OF_RANGE" if loss is Loss.RANGE else "REASON_NOT_FOUND",
                        f"{loss.value}; looked {1e3 * radius:.3g} mm around the line of sight",
                    )
                return pb.BeamReply(success=True, position_m=_vector(self._model.sample()))
        except _RefusedError as refused:
            return pb.BeamReply(success=False, reason=refused.reason, message=str(refused))

    def Measure(self, request: Any, context: Any) -> Any:  # noqa: N802
        seconds, rate = request.averaging_time_s, request.rate_hz
        _check("averaging_time_s", seconds, 1e-4, 3600.0, context)
        if rate != 0.0:
            _check("rate_hz", rate, 1e-2, 1e5, context)
        rate = rate or self._config.rate
        _check("samples (averaging_time_s * rate_hz)", seconds * rate, 0.0, 1e6, context)
        try:
            with self._alone(context) as until:
                if self._model.locked is None:
                    raise _RefusedError(
                        "REASON_NOT_LOCKED",
                        f"no beam to measure with ({self._model.loss.value}); aim or search first",
                    )
                self._watch.path = [(self._model.time_ns or 0, self._model.point())]
                self._pass_time(seconds, until, context, beam=True)
                return self._averaged(self._watch.path, seconds, rate)
        except _RefusedError as refused:
            return pb.MeasureReply(success=False, reason=refused.reason, message=str(refused))

    def _averaged(self, path: list[tuple[int, FloatArray]], seconds: float, rate: float) -> Any:
        times = np.array([entry[0] for entry in path])
        points = np.array([entry[1] for entry in path])
        # The last observation may be late: only the requested time is averaged.
        end = times[0] + round(1e9 * seconds)
        last = np.array([np.interp(end, times, points[:, axis]) for axis in range(3)])
        before = times < end
        times = np.append(times[before], end)
        average = self._model.average(times, np.vstack([points[before], last]), rate)
        return pb.MeasureReply(
            success=True,
            position_m=_vector(average.position),
            covariance_m2=_symmetric(average.covariance),
            rms_m=average.rms,
            samples=average.samples,
            averaging_time_s=1e-9 * float(times[-1] - times[0]),
            temperature_c=self._config.temperature,
            time_ns=int(times[0] + (times[-1] - times[0]) // 2),
        )

    @contextmanager
    def _alone(self, context: Any) -> Iterator[float]:
        """One call at a time, with the model held; gives the wall time (monotonic) to end by."""
        left = context.time_remaining()
        limit = self._config.wall_limit
        if left is not None:
            limit = min(limit, left - min(_ANSWER_MARGIN_S, 0.25 * left))
        until = time.monotonic() + limit
        if not self._one_call.acquire(blocking=False):
            raise _RefusedError("REASON_BUSY", "another call is under way; wait for its end")
        try:
            self._watch.hurry.set()
            with self._watch.news:
                yield until
        finally:
            self._watch.hurry.clear()
            self._watch.path = None
            self._one_call.release()

    def _pass_time(self, seconds: float, until: float, context: Any, beam: bool = False) -> None:
        """Wait for the rig's time to pass; with beam, refuse as soon as it breaks."""
        model, watch = self._model, self._watch
        if not watch.wait(lambda: model.time_ns is not None, until, context):
            raise _RefusedError("REASON_NOT_READY", "the simulated rig does not run; start it")
        end_ns = (model.time_ns or 0) + round(1e9 * seconds)

        def done() -> bool:
            lost = beam and model.locked is None
            return lost or bool(watch.fault) or (model.time_ns or 0) >= end_ns

        in_time = watch.wait(done, until, context)
        if watch.fault:
            raise _RefusedError("REASON_FAULT", watch.fault)
        if beam and model.locked is None:
            raise _RefusedError("REASON_BEAM_BROKEN", f"{model.loss.value}; aim or search again")
        if not in_time:
            missing = 1e-9 * (end_ns - (model.time_ns or 0))
            raise _RefusedError(
                "REASON_TIMED_OUT",
                f"{missing:.3g} s of the rig's time were still missing; does the rig run? Raise "
                "the time-out if it runs in slow motion",
            )


_LOST = {
    Loss.NONE: pb.REASON_UNSPECIFIED,
    Loss.UNKNOWN: pb.REASON_NOT_READY,
    Loss.NOT_FOUND: pb.REASON_NOT_FOUND,
    Loss.RANGE: pb.REASON_OUT_OF_RANGE,
    Loss.BLOCKED: pb.REASON_BEAM_BROKEN,
    Loss.TURNED: pb.REASON_BEAM_BROKEN,
    Loss.FAST: pb.REASON_BEAM_BROKEN,
}


def _target(target: Any, context: Any) -> tuple[FloatArray, bool]:
    kind = target.WhichOneof("target")
    if kind is None:
        context.abort(
            grpc.StatusCode.INVALID_ARGUMENT, "target: expected position_m or direction, got none"
        )
    message = getattr(target, kind)
    point = np.array([message.x, message.y, message.z])
    if not (np.isfinite(point).all() and np.linalg.norm(point) > 1e-9):
        context.abort(
            grpc.StatusCode.INVALID_ARGUMENT,
            f"target.{kind}: expected finite numbers that are not all zero, got {point.tolist()}",
        )
    return point, kind == "direction"


def _check(name: str, value: float, lower: float, upper: float, context: Any) -> None:
    if not lower <= value <= upper:
        context.abort(
            grpc.StatusCode.INVALID_ARGUMENT,
            f"{name}: expected {lower:g} to {upper:g}, got {value!r}",
        )


def _vector(point: FloatArray) -> Any:
    return pb.Vector3(x=point[0], y=point[1], z=point[2])


def _symmetric(matrix: FloatArray) -> Any:
    return pb.Symmetric3(
        xx=matrix[0, 0],
        xy=matrix[0, 1],
        xz=matrix[0, 2],
        yy=matrix[1, 1],
        yz=matrix[1, 2],
        zz=matrix[2, 2],
    )
