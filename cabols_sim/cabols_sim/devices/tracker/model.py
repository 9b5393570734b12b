# SPDX-License-Identifier: Apache-2.0
"""Physics of the simulated laser tracker: visibility, broken beam, measurement.

Pure: time and the platform's true motion come in as arguments.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from cabols_control.checks import FloatArray, finite_array, in_range
from cabols_control.errors import ShapeError
from cabols_hw.tracker.beam import beam_axes, predicted_covariance
from cabols_sim.devices.tracker.config import TrackerTruthConfig
from cabols_sim.devices.tracker.drift import Drift, displaced


class Loss(Enum):
    """Why the beam does not follow a reflector."""

    NONE = ""
    NOT_FOUND = "no reflector there"
    BLOCKED = "the beam is blocked"
    TURNED = "the reflector is turned away from the tracker"
    FAST = "the reflector moves too fast"
    RANGE = "the target is nearer or farther than the tracker measures"
    UNKNOWN = "the rig's truth is not known"


@dataclass(frozen=True, eq=False)
class Average:
    """Mean (3,) of the samples [m], its covariance (3, 3) [m^2], rms [m], number of samples."""

    position: FloatArray
    covariance: FloatArray
    rms: float
    samples: int


class TrackerModel:
    """One beam, some reflectors on a moving platform.

    Attributes:
        locked: index of the reflector that the beam follows, or None.
        loss: why there is none.
    """

    def __init__(self, config: TrackerTruthConfig) -> None:
        self.config = config
        self.locked: int | None = None
        self.loss = Loss.UNKNOWN
        self._random = np.random.default_rng([config.seed, 0])
        self._drift = Drift(config.drift, config.seed)
        axis = np.array(config.reflector_axis)
        self._axis = axis / np.linalg.norm(axis)
        self._least_cosine = float(np.cos(np.deg2rad(config.acceptance_deg)))
        self._time_ns: int | None = None
        self._start_ns = 0
        self._points = np.full((len(config.reflectors), 3), np.nan)
        self._looks = np.full(3, np.nan)
        self._speeds = np.full(len(config.reflectors), np.nan)
        self._blocked = False

    @property
    def time_ns(self) -> int | None:
        """The rig's newest time [ns]; None before the first observation."""
        return self._time_ns

    def observe(
        self,
        time_ns: int,
        position: ArrayLike,
        rotation: ArrayLike,
        speed: float,
        blocked: bool,
    ) -> None:
        """Take the platform's newest true motion; the beam may break.

        Args:
            time_ns: the rig's time [ns].
            position: (3,) of the platform in the base [m].
            rotation: (3, 3) from platform to base axes.
            speed: of the platform's origin [m/s].
            blocked: whether something is in the way.
        """
        frame = self.config.base_rotation
        turn = np.asarray(rotation, dtype=np.float64)
        origin = np.asarray(position, dtype=np.float64) - self.config.base_position
        points = (origin + self.config.reflector_points @ turn.T) @ frame
        elapsed_s = 0.0 if self._time_ns is None else 1e-9 * (time_ns - self._time_ns)
        if self._time_ns is None or elapsed_s < 0.0:
            # The first observation, or the rig was restarted.
            self.locked, self.loss = None, Loss.NOT_FOUND
            self._start_ns = time_ns
            self._speeds = np.full(len(points), float(speed))
        elif elapsed_s > 0.0:
            # A reflector also moves when the platform only turns.
            moved = np.linalg.norm(points - self._points, axis=1) / elapsed_s
            self._speeds = np.maximum(moved, float(speed))
        self._time_ns = time_ns
        self._points, self._looks = points, frame.T @ turn @ self._axis
        self._blocked = bool(blocked)
        if self.locked is not None:
            loss = self._obstacle(self.locked)
            if loss is not Loss.NONE:
                self.locked, self.loss = None, loss

    def aim(self, target: ArrayLike, radius_m: float, direction: bool = False) -> Loss:
        """Point the beam; lock on the reflector nearest to it within a radius [m] across it.

        Args:
            target: (3,) point, or direction, in the tracker's frame.
            radius_m: how far beside the beam a reflector may be.
            direction: whether target is one.

        Returns:
            Loss.NONE with a locked beam, or why there is none.
        """
        point = finite_array("target", target, (3,))
        distance = float(np.linalg.norm(point))
        if not distance > 0.0:
            raise ShapeError("target: expected a point or direction other than zero, got zeros")
        self.locked = None
        self.loss = self._catch(point / distance, None if direction else distance, radius_m)
        return self.loss

    def search_time(self, radius_m: float) -> float:
        """Duration of a spiral over a radius [s]."""
        return float(np.pi * radius_m**2 / self.config.search_speed)

    def sample(self) -> FloatArray:
        """(3,) one sample of the locked reflector [m]."""
        point = self.point()
        return np.asarray(
            point + self._noisy(point, 1, 1.0)[0] + self._offset(point, self._elapsed())
        )

    def point(self) -> FloatArray:
        """(3,) true position of the locked reflector, in the tracker's frame [m]."""
        if self.locked is None:
            raise ShapeError(f"beam: expected a locked one, got none ({self.loss.value})")
        return np.asarray(self._points[self.locked])

    def average(self, times_ns: ArrayLike, points: ArrayLike, rate_hz: float) -> Average:
        """Measure along a path.

        Args:
            times_ns: (k,) when the reflector was at the points; rising.
            points: (k, 3) where it truly was, tracker's frame [m].
            rate_hz: of the samples.

        Returns:
            The average from the first to the last time.
        """
        where = finite_array("points", points, (None, 3))
        times = 1e-9 * (np.asarray(times_ns, dtype=np.int64) - self._start_ns)
        in_range("rate_hz", rate_hz, 1e-3, 1e5)
        samples = max(1, round(float(times[-1] - times[0]) * rate_hz))
        at = np.linspace(times[0], times[-1], samples)
        path = np.column_stack([np.interp(at, times, where[:, axis]) for axis in range(3)])
        floor = self.config.averaging_floor**2
        middle = path.mean(axis=0)
        single = path + self._noisy(middle, samples, 1.0 - floor)
        # The part that averaging does not remove stays constant during a measurement.
        mean = single.mean(axis=0) + self._noisy(middle, 1, floor)[0]
        mean = mean + self._offset(middle, 0.5 * float(times[0] + times[-1]))
        scatter = single - single.mean(axis=0)
        covariance = predicted_covariance(mean, self.config.noise, floor + (1.0 - floor) / samples)
        rms = float(np.sqrt(np.mean(np.sum(scatter**2, axis=1))))
        return Average(mean, covariance, rms, samples)

    def expected_drift(self) -> float:
        """Bound of the warm-up still to come, at the newest distance [m]."""
        distance = 3.0 if self.locked is None else float(np.linalg.norm(self.point()))
        return self._drift.expected(self._elapsed(), distance)

    def on_time(self) -> float:
        """Time since switch-on [s]."""
        return self._drift.on_time(self._elapsed())

    @property
    def warming_up(self) -> bool:
        """Whether the drift since switch-on has not yet died out."""
        return self._drift.expected(self._elapsed(), 3.0) > self.config.drift.warm_below

    def _elapsed(self) -> float:
        return 0.0 if self._time_ns is None else 1e-9 * (self._time_ns - self._start_ns)

    def _catch(self, along: FloatArray, distance: float | None, radius_m: float) -> Loss:
        config = self.config
        if self._time_ns is None:
            return Loss.UNKNOWN
        if distance is not None and not config.nearest <= distance <= config.farthest:
            return Loss.RANGE
        depth = self._points @ along
        beside = np.linalg.norm(self._points - np.outer(depth, along), axis=1)
        found = Loss.NOT_FOUND
        for index in np.argsort(beside):
            if not (beside[index] <= radius_m and depth[index] > 0.0):
                continue
            obstacle = self._obstacle(int(index))
            if obstacle is Loss.NONE:
                self.locked = int(index)
                return Loss.NONE
            if found is Loss.NOT_FOUND:
                found = obstacle
        return found

    def _obstacle(self, index: int) -> Loss:
        # Written so that NaN in the truth breaks the beam.
        point, config = self._points[index], self.config
        distance = float(np.linalg.norm(point))
        if not np.isfinite(distance):
            return Loss.UNKNOWN
        if self._blocked:
            return Loss.BLOCKED
        if not config.nearest <= distance <= config.farthest:
            return Loss.RANGE
        if not -float(self._looks @ point) / distance >= self._least_cosine:
            return Loss.TURNED
        if not self._speeds[index] <= config.max_speed:
            return Loss.FAST
        return Loss.NONE

    def _noisy(self, point: FloatArray, samples: int, variance: float) -> FloatArray:
        sigmas = np.sqrt(variance) * self.config.noise.sigmas(float(np.linalg.norm(point)))
        drawn = sigmas * self._random.standard_normal((samples, 3))
        return np.asarray(drawn @ beam_axes(point).T)

    def _offset(self, point: FloatArray, time_s: float) -> FloatArray:
        return displaced(point, self._drift.at(time_s)) - point
