"""What counts as agreement between the sources of the platform's pose."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from cabols_control.checks import FloatArray

from .tracker import TrackerNoise

LEVER_M = 0.1
"""Of the platform's inertia, about its origin [m]."""


@dataclass(frozen=True)
class AgreementNoise:
    """What counts as agreement.

    Attributes:
        force: standard deviation of the sensor's force [N].
        torque: likewise [N m].
        stiffness: of each k_e, relative.
        length: of a length by encoder and robot's pose, each cable [m].
        per_newton: of the platform's place, by the robot's deflection under a force [m/N].
        turn_per_newton: of its turn, likewise [rad/N].
        turn_per_newton_metre: under a torque [rad/(N m)].
        mass: of what the sensor carries [kg].
        tracker: readings of the tracker.
        samples: in a row that noise must not explain, until something is wrong.
    """

    force: float = 0.1
    torque: float = 0.01
    stiffness: float = 0.01
    length: float = 1e-4
    per_newton: float = 0.0
    turn_per_newton: float = 0.0
    turn_per_newton_metre: float = 0.0
    mass: float = 0.0
    tracker: TrackerNoise = field(default_factory=TrackerNoise)
    samples: int = 10

    def deflected(self, wrench: FloatArray) -> FloatArray:
        """(6, 6) covariance of the platform's pose by the robot's deflection.

        Args:
            wrench: (6,) on the platform [N, N m].
        """
        force, torque = float(np.linalg.norm(wrench[:3])), float(np.linalg.norm(wrench[3:]))
        turned = np.hypot(self.turn_per_newton * force, self.turn_per_newton_metre * torque)
        # A torque moves the platform as a force turns it (Maxwell and Betti).
        moved = np.hypot(self.per_newton * force, self.turn_per_newton * torque)
        return np.diag(np.repeat([moved**2, turned**2], 3))

    def covariance(
        self,
        matrix: FloatArray,
        stiffness: FloatArray,
        tension: FloatArray,
        wrench: FloatArray,
        travel: float,
        acceleration: float,
    ) -> FloatArray:
        """(6, 6) covariance of the sensor's wrench less A tension where nothing is wrong.

        Args:
            matrix: (6, n) structure matrix.
            stiffness: (n,) k_e [N/m].
            tension: (n,) k_e times elongation [N].
            wrench: (6,) by the sensor, base axes [N, N m].
            travel: how far the pose may be off by the motion, standard deviation [m].
            acceleration: of the platform, about [m/s^2].
        """
        length = np.hypot(self.length, travel)
        scatter = np.hypot(self.stiffness * np.abs(tension), stiffness * length)
        found = (matrix * scatter**2) @ matrix.T
        inertia2 = (self.mass * acceleration) ** 2
        force2, torque2 = self.force**2 + inertia2, self.torque**2 + LEVER_M**2 * inertia2
        found += np.diag(np.repeat([force2, torque2], 3))
        gain = (matrix * stiffness) @ matrix.T
        return np.asarray(found + gain @ self.deflected(wrench) @ gain.T)
