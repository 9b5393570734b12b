# SPDX-License-Identifier: Apache-2.0
"""Pure logic of the pose estimator: robot, encoders, sensor and tracker against each other.

At each sample the sensor's wrench is compared with what the springs give by the robot's pose and
the encoders. Where noise does not explain what is left for a while, moments at different poses are
gathered, and every suspect whose effect explains them stays a candidate: exchanged encoders and a
wrong tool also the moments before, since zeroing, when all seemed to agree. What alone explains
them is named. The tracker is compared at each of its measurements; it is named where the cables
agree with the robot and could tell if they did not, or where it agreed before.

It observes: nothing here stops or moves anything. What acts on it must judge its answers itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from cabols_control.checks import FloatArray
from cabols_control.geometry import RigGeometry
from cabols_control.kinematics import structure_matrix
from cabols_control.rotations import angle_between

from .explanations import Explanations
from .hypotheses import Fault, Frame, Suspect, tool_residual
from .noise import (
    APART_M,
    APART_N,
    APART_RAD,
    AgreementNoise,
    Baseline,
    nearest_to_predecessor,
)
from .tracker import Compared, Reading, TrackerAgreement

NEVER = 1e-6
"""Probability of what noise does not explain: of `samples` in a row, or one reading."""
ODD_WRENCH = float(chi2.isf(NEVER, 6))
"""Square of a residual beyond that."""
AGAIN = 5
"""Moments after which what is named by FRAMES is judged again."""
FRAMES = 10
"""Moments that are gathered at most."""
TURN_FOR_TOOL = np.deg2rad(5.0)
"""Turn over which a wrong tool can be told from all else."""


@dataclass(frozen=True, eq=False)
class Agreement:
    """What the sources say.

    Attributes:
        agree: whether noise explains all differences.
        named: what disagrees with the others, where it can be told.
        candidates: what may; more than one until it can be told, none where all agree, or where
            nothing that is known of explains what is seen.
        residual: (6,) sensor's wrench less what the cables give, base axes [N, N m].
        deviation: (6,) standard deviation of each where all agree.
        position: (3,) of the platform by all of them, base frame [m].
        rotation: (3, 3) from platform to base axes.
        covariance: (6, 6) of position [m] and rotation vector [rad], base axes.
    """

    agree: bool
    named: Suspect | None
    candidates: tuple[Suspect, ...]
    residual: FloatArray
    deviation: FloatArray
    position: FloatArray
    rotation: FloatArray
    covariance: FloatArray


class AgreementMonitor:
    """Compares the sources of the platform's pose, sample by sample."""

    def __init__(
        self,
        geometry: RigGeometry,
        stiffness: FloatArray,
        noise: AgreementNoise | None = None,
        robot_std: tuple[float, float] = (5e-4, 1e-3),
    ) -> None:
        """Start without zeros: nothing is judged until `zero`.

        Args:
            geometry: of n cables.
            stiffness: (n,) k_e [N/m].
            noise: what counts as agreement.
            robot_std: standard deviations of the robot's position [m] and turn [rad].
        """
        self.geometry, self.stiffness = geometry, np.asarray(stiffness, dtype=np.float64)
        self._cables = geometry.records()
        self.noise = noise or AgreementNoise()
        self._prior = np.diag(np.repeat(np.square(robot_std), 3))
        self._explanations = Explanations(self.noise, self.stiffness, self._cables)
        self._zero: Frame | None = None
        self._frames: list[Frame] = []
        self._doubtful: list[Frame] = []
        self._newest: Frame | None = None
        self._baseline = Baseline(self.noise, FRAMES)
        self._in_doubt, self._gathered, self._most_turned = 0, 0, 0.0
        self._readings = TrackerAgreement(self.noise.tracker)
        self._tracker: tuple[Suspect, ...] = ()
        self._tracker_named = self._tracker_agreed = False
        self._judged: tuple[Suspect | None, tuple[Suspect, ...]] = (None, ())

    def zero(self, position: FloatArray, rotation: FloatArray, wound: FloatArray) -> None:
        """Take the moment at which the limbs were zeroed; what was gathered is forgotten.

        Args:
            position: (3,) by the robot [m].
            rotation: (3, 3) by the robot.
            wound: (n,) wound in by the encoders [m].
        """
        self._wound_at_zero = np.array(wound, dtype=np.float64)
        matrix = structure_matrix(self.geometry, position, rotation)
        still = np.zeros(len(wound))
        self._zero = self._frame(matrix, still, still, position, rotation, np.zeros(6))
        self._baseline = Baseline(self.noise, FRAMES)
        self._frames, self._doubtful, self._most_turned = [], [], 0.0
        self._in_doubt, self._gathered, self._judged = 0, 0, (None, ())
        self._tracker, self._tracker_named, self._tracker_agreed = (), False, False

    def cables(
        self,
        position: FloatArray,
        rotation: FloatArray,
        wound: FloatArray,
        tension: FloatArray,
        wrench: FloatArray,
        travel: float = 0.0,
        acceleration: float = 0.0,
    ) -> Agreement | None:
        """Take one sample.

        Args:
            position: (3,) by the robot, base frame [m].
            rotation: (3, 3) by the robot.
            wound: (n,) wound in by the encoders [m].
            tension: (n,) k_e times elongation [N].
            wrench: (6,) of the cables on the platform by the sensor, about the platform's origin,
                base axes [N, N m].
            travel: how far the pose may be off by the motion, standard deviation [m].
            acceleration: of the platform, about [m/s^2].

        Returns:
            What the sources say; None before the zeros, or where the sample is not finite.
        """
        given = np.concatenate(
            [position, np.ravel(rotation), wound, tension, wrench, [travel, acceleration]]
        )
        if self._zero is None or not np.isfinite(given).all():
            return None
        matrix = structure_matrix(self.geometry, position, rotation)
        wound_since = np.asarray(wound) - self._wound_at_zero
        frame = self._frame(
            matrix, tension, wound_since, position, rotation, wrench, travel, acceleration
        )
        frame = replace(frame, covariance=self.noise.shared(frame, frame) + self.noise.own(frame))
        self._newest = frame
        odd = _square(frame.residual, frame.covariance) > ODD_WRENCH
        odd = odd or _square(*self._baseline.change(frame)) > ODD_WRENCH
        if not self._frames:
            self._doubt(frame, odd)
        new = _differs(frame, self._frames)
        if self._frames and new:
            self._frames.append(frame)
            if len(self._frames) > FRAMES:
                del self._frames[nearest_to_predecessor(self._frames)]
            self._gathered += 1
        # What is named by much data is looked at again now and then.
        if self._frames and new and (self._gathered <= FRAMES or self._gathered % AGAIN == 0):
            self._judged = self._judge()
        return self._agreement(frame)

    def _doubt(self, frame: Frame, odd: bool) -> None:
        """Keep a moment at which all agree; or begin to gather those at which they did not."""
        self._in_doubt = self._in_doubt + 1 if odd else 0
        if odd:
            if _differs(frame, self._doubtful):
                self._doubtful = [*self._doubtful, frame][-FRAMES:]
        else:
            self._doubtful = []
            if _differs(frame, self._baseline.frames):
                self._baseline.keep(frame)
                # What grows slowly is odd at none of the moments, but at all of them together.
                if self._baseline.surprise > chi2.isf(NEVER, 6 * len(self._baseline.frames)):
                    self._in_doubt = self.noise.samples
        if self._in_doubt >= self.noise.samples:
            self._frames = self._doubtful or [frame]
            self._gathered, self._doubtful = len(self._frames), []
            self._judged = self._judge()

    def _frame(
        self,
        matrix: FloatArray,
        tension: FloatArray,
        wound: FloatArray,
        position: FloatArray,
        rotation: FloatArray,
        wrench: FloatArray,
        travel: float = 0.0,
        acceleration: float = 0.0,
    ) -> Frame:
        """One moment, without its covariance."""
        pulled, pull = matrix * self.stiffness, np.maximum(tension, 0.0)
        return Frame(
            residual=wrench - matrix @ pull,
            matrix=matrix,
            pulled=pulled,
            gain=pulled @ matrix.T,
            tension=np.array(tension),
            wound=np.array(wound),
            rotation=np.array(rotation),
            position=np.array(position),
            wrench=np.array(wrench),
            travel=travel,
            acceleration=acceleration,
        )

    def reflector(
        self, measured: FloatArray, expected: FloatArray, std: float, at: Reading | None = None
    ) -> Compared | None:
        """Take a measurement of the tracker, of the newest sample's pose unless told otherwise.

        Args:
            measured: (3,) of the reflector, base frame by the tracker's registration [m].
            expected: (3,) of it by the robot's pose [m].
            std: standard deviation of the measurement, each axis [m].
            at: the same with all that is known of it; the other arguments are then not used.

        Returns:
            How far it is from where it was expected; None before the first sample.
        """
        frame = self._newest
        if frame is None:
            return None
        reading = at or Reading(
            reflector=0,
            measured=np.asarray(measured, dtype=np.float64),
            expected=np.asarray(expected, dtype=np.float64),
            arm=np.zeros(3),
            position=frame.position,
            rotation=frame.rotation,
            wrench=frame.wrench,
            std=std,
        )
        if not reading.usable:
            return None
        found = self._readings.compare(reading)
        if found.probability >= NEVER:
            self._readings.keep(reading)
            self._tracker_agreed = True
            return found
        tracker, tool = Suspect(Fault.TRACKER), Suspect(Fault.ROBOT_TOOL)
        # A tool that was right since the zeros does not change by itself.
        right = self._tracker_agreed or self._would_tell(found.away)
        self._tracker_named = not self._frames and right
        self._tracker = (tracker,) if self._tracker_named else (tracker, tool)
        return found

    def again(self) -> Agreement:
        """Answer for the newest sample, after a measurement of the tracker.

        Raises:
            RuntimeError: before the first sample.
        """
        if self._newest is None:
            raise RuntimeError("expected a sample of the cables first")
        return self._agreement(self._newest)

    def _would_tell(self, away: FloatArray) -> bool:
        """Whether the cables would show a tool that is wrong by what the tracker sees."""
        frame, zero = self._newest, self._zero
        if frame is None or zero is None:
            return False
        error = np.concatenate([frame.rotation.T @ away, np.zeros(3)])
        seen = tool_residual([frame], zero, self.stiffness, self._cables, error)
        return bool(_square(seen, frame.covariance) > ODD_WRENCH)

    def _judge(self) -> tuple[Suspect | None, tuple[Suspect, ...]]:
        """Return the suspect that is named, if any, and all that explain what was gathered."""
        zero = self._zero
        if zero is None:
            return None, ()
        frames, before = [*self._baseline.frames, *self._frames], len(self._baseline.frames)
        turns = [angle_between(frame.rotation, zero.rotation) for frame in self._frames]
        self._most_turned = max(self._most_turned, *turns)
        fitting = self._explanations.fitting(zero, frames, before)
        chosen = fitting[0] if len(fitting) == 1 else None
        if chosen is not None and chosen.fault is Fault.ROBOT_TOOL and not self._turned():
            chosen = None
        if self._judged[0] in fitting:
            # What once alone explained everything stays named while it does explain it.
            chosen = self._judged[0]
            return chosen, (chosen,) if chosen is not None else tuple(fitting)
        return chosen, tuple(fitting)

    def _turned(self) -> bool:
        """Whether the moments since zeroing span the turn that a wrong tool takes to be told."""
        return len(self._frames) >= 3 and self._most_turned >= TURN_FOR_TOOL

    def _agreement(self, frame: Frame) -> Agreement:
        """Answer: suspects, and the pose by robot, encoders and sensor together."""
        named, candidates = self._judged
        wrong = bool(self._frames)
        if self._tracker and not wrong:
            candidates = self._tracker
            named = self._tracker[0] if self._tracker_named else None
        # A wrong pose by d changes the residual by A K A^T d.
        gain = frame.gain
        both = gain @ self._prior @ gain.T + frame.covariance
        share = self._prior @ gain.T @ np.linalg.inv(both)
        move = np.zeros(6) if wrong else -share @ frame.residual
        covariance = self._prior - share @ gain @ self._prior
        return Agreement(
            agree=not (wrong or self._tracker),
            named=named,
            candidates=candidates,
            residual=frame.residual,
            deviation=np.sqrt(np.diag(frame.covariance)),
            position=frame.position + move[:3],
            rotation=_turned_by(move[3:]) @ frame.rotation,
            covariance=0.5 * (covariance + covariance.T),
        )


def _differs(frame: Frame, kept: list[Frame]) -> bool:
    """Whether a moment's pose or tensions differ from the last that was kept."""
    if not kept:
        return True
    moved = float(np.linalg.norm(frame.position - kept[-1].position))
    turned = angle_between(frame.rotation, kept[-1].rotation)
    pulled = float(np.linalg.norm(frame.tension - kept[-1].tension))
    return bool(moved > APART_M or turned > APART_RAD or pulled > APART_N)


def _square(residual: FloatArray, covariance: FloatArray) -> float:
    """Square of a residual in its own deviations."""
    return float(residual @ np.linalg.solve(covariance, residual))


def _turned_by(vector: FloatArray) -> FloatArray:
    """(3, 3) rotation by a rotation vector [rad]."""
    return np.asarray(Rotation.from_rotvec(vector).as_matrix())
