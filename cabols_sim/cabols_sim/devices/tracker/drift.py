# SPDX-License-Identifier: Apache-2.0
"""Slow errors of a laser tracker, as a function of time."""

from __future__ import annotations

import numpy as np

from cabols_control.checks import FloatArray
from cabols_sim.devices.tracker.config import DriftConfig

_WAVES = 8


class Drift:
    """Errors of distance [m], azimuth and elevation [rad]: seeded, smooth, without state.

    Warm-up decays exponentially; wandering is a sum of sines of random period and phase, so that
    it can be asked for any time, in any order, and always answers the same.
    """

    def __init__(self, config: DriftConfig, seed: int) -> None:
        random = np.random.default_rng([seed, 1])
        self._config = config
        warm_up = [config.warm_up_radial, config.warm_up_angle, config.warm_up_angle]
        wander = [config.wander_radial, config.wander_angle, config.wander_angle]
        self._warm_up = np.array(warm_up) * random.standard_normal(3)
        # Of standard deviation 1 / sqrt(waves) each, their sum has that of the configuration.
        self._amplitude = np.array(wander)[:, None] * np.sqrt(2.0 / _WAVES)
        periods = config.wander_time * np.exp(random.uniform(0.0, np.log(10.0), (3, _WAVES)))
        self._rate = 2.0 * np.pi / periods
        self._phase = random.uniform(0.0, 2.0 * np.pi, (3, _WAVES))

    def at(self, time_s: float) -> FloatArray:
        """(3,) errors of distance [m], azimuth, elevation [rad] at a time since the start [s]."""
        waves = self._amplitude * np.sin(self._rate * time_s + self._phase)
        return np.asarray(self._warm_up * self._remaining(time_s) + waves.sum(axis=1))

    def expected(self, time_s: float, distance_m: float) -> float:
        """Bound of the warm-up still to come [m]: two standard deviations, all directions.

        Args:
            time_s: since the tracker was switched on [s].
            distance_m: to the reflector [m].
        """
        config = self._config
        angle = config.warm_up_angle * distance_m
        return float(2.0 * np.sqrt(config.warm_up_radial**2 + 2.0 * angle**2)) * self._remaining(
            time_s
        )

    def on_time(self, time_s: float) -> float:
        """Time since switch-on [s]."""
        return self._config.age + time_s

    def _remaining(self, time_s: float) -> float:
        return float(np.exp(-self.on_time(time_s) / self._config.warm_up_time))


def displaced(point: FloatArray, error: FloatArray) -> FloatArray:
    """A point (3,) with errors of distance, azimuth and elevation (3,) added, exactly.

    Args:
        point: (3,) in the tracker's frame [m].
        error: (3,) of distance [m], azimuth and elevation [rad].
    """
    distance = float(np.linalg.norm(point))
    azimuth = np.arctan2(point[1], point[0]) + error[1]
    elevation = np.arcsin(point[2] / distance) + error[2]
    across = np.cos(elevation)
    return np.asarray(
        (distance + error[0])
        * np.array([across * np.cos(azimuth), across * np.sin(azimuth), np.sin(elevation)])
    )
