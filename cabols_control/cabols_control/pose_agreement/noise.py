# SPDX-License-Identifier: Apache-2.0
"""What counts as agreement between the sources of the platform's pose.

What the sensor shows beside what the springs give has two parts. One is new in each sample. The
other comes from what is wrong all the time: stiffnesses, the robot's absolute error, its bending.
It is larger, but nearly the same in samples that are near each other in pose and load, so that a
sudden change shows in far smaller differences than the whole would allow.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.rotations import angle_between

from .hypotheses import Frame
from .tracker import CORRELATED_M, CORRELATED_RAD, TrackerNoise

APART_M, APART_RAD = 2e-3, 0.01
"""Motion between two moments that are kept."""
APART_N = 10.0
"""Or change of the tensions, all together."""
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
        repeat: of it, from sample to sample [m].
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
    repeat: float = 3e-5
    per_newton: float = 0.0
    turn_per_newton: float = 0.0
    turn_per_newton_metre: float = 0.0
    mass: float = 0.0
    tracker: TrackerNoise = field(default_factory=TrackerNoise)
    samples: int = 10

    def own(self, frame: Frame) -> FloatArray:
        """(6, 6) covariance of what is new in each sample, base axes.

        Args:
            frame: one moment.
        """
        inertia2 = (self.mass * frame.acceleration) ** 2
        force2, torque2 = self.force**2 + inertia2, self.torque**2 + LEVER_M**2 * inertia2
        pulled = (self.repeat**2 + frame.travel**2) * frame.pulled @ frame.pulled.T
        return np.asarray(pulled + np.diag(np.repeat([force2, torque2], 3)))

    def shared(self, one: Frame, two: Frame) -> FloatArray:
        """(6, 6) covariance between two moments of what is wrong all the time, base axes.

        Args:
            one: moment.
            two: moment, or the same.
        """
        moved = float(np.linalg.norm(one.position - two.position)) / CORRELATED_M
        chord = float(np.linalg.norm(one.rotation - two.rotation)) / np.sqrt(2.0)
        near = np.exp(-0.5 * (moved**2 + (chord / CORRELATED_RAD) ** 2))
        pulls = self.stiffness**2 * one.pull * two.pull
        found: FloatArray = (one.matrix * pulls) @ two.matrix.T
        found += (near * self.length**2) * one.pulled @ two.pulled.T
        forces = float(one.wrench[:3] @ two.wrench[:3])
        torques = float(one.wrench[3:] @ two.wrench[3:])
        # A torque moves the platform as a force turns it (Maxwell and Betti).
        moves = self.per_newton**2 * forces + self.turn_per_newton**2 * torques
        turns = self.turn_per_newton**2 * forces + self.turn_per_newton_metre**2 * torques
        bent = one.gain * np.repeat([moves, turns], 3)
        return np.asarray(found + bent @ two.gain.T)


def joint_covariance(noise: AgreementNoise, frames: list[Frame]) -> FloatArray:
    """(6 k, 6 k) covariance of the residuals of k moments where nothing is wrong.

    Args:
        noise: what counts as agreement.
        frames: the moments.
    """
    found = np.empty((6 * len(frames), 6 * len(frames)))
    for i, one in enumerate(frames):
        rows = slice(6 * i, 6 * i + 6)
        for j, two in enumerate(frames[: i + 1]):
            columns = slice(6 * j, 6 * j + 6)
            found[rows, columns] = noise.shared(one, two)
            found[columns, rows] = found[rows, columns].T
        found[rows, rows] += noise.own(one)
    return found


class Baseline:
    """Moments since zeroing at which all agreed, and what they say about the next one.

    Attributes:
        frames: the moments, spread over the way.
        surprise: sum of squares of their residuals, in the deviations of all of them together.
    """

    def __init__(self, noise: AgreementNoise, most: int) -> None:
        """Start without any.

        Args:
            noise: what counts as agreement.
            most: moments that are kept.
        """
        self._noise, self._most = noise, most
        self.frames: list[Frame] = []
        self.surprise = 0.0
        self._known = np.zeros((0, 0))
        self._inverse = np.zeros((0, 0))
        self._residual = np.zeros(0)

    def keep(self, frame: Frame) -> None:
        """Take a moment; of too many, the one nearest to its predecessor is left out.

        Args:
            frame: the moment.
        """
        size = 6 * len(self.frames)
        known = np.empty((size + 6, size + 6))
        known[:size, :size] = self._known
        known[size:, size:] = frame.covariance
        for i, other in enumerate(self.frames):
            rows = slice(6 * i, 6 * i + 6)
            known[rows, size:] = self._noise.shared(other, frame)
            known[size:, rows] = known[rows, size:].T
        self.frames.append(frame)
        if len(self.frames) > self._most:
            out = nearest_to_predecessor(self.frames)
            del self.frames[out]
            left = np.delete(np.arange(size + 6), slice(6 * out, 6 * out + 6))
            known = known[np.ix_(left, left)]
        self._known = known
        self._inverse = np.asarray(np.linalg.inv(known), dtype=np.float64)
        self._residual = np.concatenate([other.residual for other in self.frames])
        self.surprise = float(self._residual @ self._inverse @ self._residual)

    def change(self, frame: Frame) -> tuple[FloatArray, FloatArray]:
        """(6,) what a moment's residual adds to what is known of it, and its (6, 6) covariance.

        Args:
            frame: the moment.
        """
        if not self.frames:
            return frame.residual, frame.covariance
        with_it = np.hstack([self._noise.shared(frame, other) for other in self.frames])
        share = with_it @ self._inverse
        return frame.residual - share @ self._residual, frame.covariance - share @ with_it.T


def nearest_to_predecessor(frames: list[Frame]) -> int:
    """Index of the moment that is nearest to the one before it; neither the first nor the last.

    Args:
        frames: three or more.
    """
    gaps = [
        float(np.linalg.norm(one.position - two.position)) / APART_M
        + angle_between(one.rotation, two.rotation) / APART_RAD
        for one, two in zip(frames[1:-1], frames[:-2], strict=True)
    ]
    return 1 + int(np.argmin(gaps))
