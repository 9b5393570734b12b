# SPDX-License-Identifier: Apache-2.0
"""Readings of the laser tracker against what is expected by the robot's pose and earlier readings.

A robot's pose is wrong by half a millimetre, but by almost the same where it comes back to: what
limits a comparison is not that error, but what of it differs from reading to reading. Differences
between measured and expected points are therefore taken as one Gaussian process (Rasmussen and
Williams 2006, chapter 2) of these parts:

- the place of the tracker, as registered: a shift and a turn, the same for all readings;
- each reflector's place on the platform;
- the robot's error, which is the same at the same pose and forgotten over CORRELATED_M;
- its deflection, which is linear in the wrench;
- noise of the tracker and the robot's repeatability, new in each reading.

A reading is judged against its prediction from those before, so that with each of them a smaller
bump of the tracker can be told.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from cabols_control.checks import FloatArray
from cabols_control.rotations import cross_matrix

CORRELATED_M, CORRELATED_RAD = 0.3, 0.3
"""Over which the robot's error is forgotten; see the module."""
KEPT = 60
"""Readings that are kept."""


@dataclass(frozen=True)
class TrackerNoise:
    """Standard deviations of what the differences are made of.

    Attributes:
        shift: of the registered tracker's place [m].
        turn: of its axes [rad].
        nest: of a reflector's place on the platform, each axis [m].
        robot: of the robot's position, each axis [m].
        robot_turn: of its orientation [rad].
        repeat: of its repeatability at a reflector [m].
        per_newton: of the platform's shift by the robot's deflection, for a force [m/N].
        turn_per_newton: of its turn, likewise; and of its shift, for a torque [rad/N].
        turn_per_newton_metre: of its turn, for a torque [rad/(N m)].
    """

    shift: float = 0.0
    turn: float = 0.0
    nest: float = 0.0
    robot: float = 2e-4
    robot_turn: float = 0.0
    repeat: float = 3e-5
    per_newton: float = 0.0
    turn_per_newton: float = 0.0
    turn_per_newton_metre: float = 0.0


@dataclass(frozen=True, eq=False)
class Reading:
    """One reading of the tracker.

    Attributes:
        reflector: index from 0.
        measured: (3,) base frame, by the tracker's registration [m].
        expected: (3,) of it by the robot's pose [m].
        arm: (3,) from the tracker to it, base axes [m].
        position: (3,) of the platform by the robot [m].
        rotation: (3, 3) likewise.
        wrench: (6,) on the platform, base axes [N, N m].
        std: of the reading, each axis [m].
    """

    reflector: int
    measured: FloatArray
    expected: FloatArray
    arm: FloatArray
    position: FloatArray
    rotation: FloatArray
    wrench: FloatArray
    std: float

    @property
    def lever(self) -> FloatArray:
        """(3,) from the platform's origin to the reflector, base axes [m]."""
        return self.expected - self.position

    @property
    def usable(self) -> bool:
        """Whether all of it is finite."""
        parts = (self.measured, self.expected, self.arm, self.position, self.wrench, self.std)
        return all(bool(np.isfinite(part).all()) for part in (*parts, self.rotation))


@dataclass(frozen=True, eq=False)
class Compared:
    """A reading against its prediction.

    Attributes:
        distance: from where it was expected [m].
        deviation: standard deviation of that, each axis, the largest [m].
        away: (3,) measured less predicted, base axes [m].
        probability: of so large a difference or a larger one, where nothing is wrong.
        surprise: square of the difference in its own deviations.
    """

    distance: float
    deviation: float
    away: FloatArray
    probability: float
    surprise: float


class TrackerAgreement:
    """Compares readings with their predictions."""

    def __init__(self, noise: TrackerNoise) -> None:
        """Start without readings.

        Args:
            noise: what the differences are made of.
        """
        self.noise = noise
        self._readings: list[Reading] = []
        self._differences: list[FloatArray] = []

    @property
    def readings(self) -> int:
        """How many are kept."""
        return len(self._readings)

    def compare(self, reading: Reading) -> Compared:
        """Compare a reading with what those before it say; it is not kept.

        Args:
            reading: of the tracker.
        """
        away = reading.measured - reading.expected
        covariance = self._shared(reading, reading) + self._own(reading)
        if self._readings:
            count = len(self._readings)
            known, with_it = np.empty((3 * count, 3 * count)), np.empty((3 * count, 3))
            for i, first in enumerate(self._readings):
                rows = slice(3 * i, 3 * i + 3)
                with_it[rows] = self._shared(first, reading)
                for j, second in enumerate(self._readings[: i + 1]):
                    columns = slice(3 * j, 3 * j + 3)
                    known[rows, columns] = self._shared(first, second)
                    known[columns, rows] = known[rows, columns].T
                known[rows, rows] += self._own(first)
            share = np.linalg.solve(known, with_it).T
            away = away - share @ np.concatenate(self._differences)
            covariance = covariance - share @ with_it
            covariance = 0.5 * (covariance + covariance.T)
        surprise = float(away @ np.linalg.solve(covariance, away))
        return Compared(
            distance=float(np.linalg.norm(away)),
            deviation=float(np.sqrt(np.linalg.eigvalsh(covariance)[-1])),
            away=away,
            probability=float(chi2.sf(surprise, 3)),
            surprise=surprise,
        )

    def keep(self, reading: Reading) -> None:
        """Keep a reading; of many, the oldest is forgotten.

        Args:
            reading: that agrees.
        """
        self._readings = [*self._readings, reading][-KEPT:]
        self._differences = [*self._differences, reading.measured - reading.expected][-KEPT:]

    def _own(self, reading: Reading) -> FloatArray:
        """(3, 3) covariance of what is new in each reading."""
        return (reading.std**2 + self.noise.repeat**2) * np.eye(3)

    def _shared(self, one: Reading, two: Reading) -> FloatArray:
        """(3, 3) covariance between two readings of what both share."""
        noise, same = self.noise, np.eye(3)
        found = noise.shift**2 * same
        found += noise.turn**2 * cross_matrix(one.arm) @ cross_matrix(two.arm).T
        if one.reflector == two.reflector:
            found += noise.nest**2 * one.rotation @ two.rotation.T
        moved = np.linalg.norm(one.position - two.position) / CORRELATED_M
        chord = np.linalg.norm(one.rotation - two.rotation) / np.sqrt(2.0)
        near = np.exp(-0.5 * (moved**2 + (chord / CORRELATED_RAD) ** 2))
        forces = float(one.wrench[:3] @ two.wrench[:3])
        torques = float(one.wrench[3:] @ two.wrench[3:])
        shifts = near * noise.robot**2
        shifts += noise.per_newton**2 * forces + noise.turn_per_newton**2 * torques
        turns = near * noise.robot_turn**2
        turns += noise.turn_per_newton**2 * forces + noise.turn_per_newton_metre**2 * torques
        arms = cross_matrix(one.lever) @ cross_matrix(two.lever).T
        return np.asarray(found + shifts * same + turns * arms)
