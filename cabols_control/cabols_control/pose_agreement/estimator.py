# SPDX-License-Identifier: Apache-2.0
"""Pose estimator: what bridge, robot and tracker send, in; which of them disagrees, out.

It takes the zeros as the bridge has set them, places the tracker where frames.yaml has it, and
turns wrenches and readings into the rig's base frame. Pure logic; times are the samples' stamps.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.frames import RigFrames
from cabols_control.kinematics import cable_lengths
from cabols_control.rig import Rig

from .hypotheses import Suspect
from .moments import LimbSample, Moment, MomentJoiner, PoseAt
from .monitor import Agreement, AgreementMonitor
from .noise import AgreementNoise
from .tracker import Compared, Reading, TrackerNoise

FARTHEST_M = 100.0
"""Lengths and places beyond this are no numbers of a rig [m]."""
STALE_S = 1.0
"""Without a complete sample for so long, nothing is known [s]."""
WAITING_READINGS = 20
"""Readings that wait for the poses of their time, at most."""
ROBOT_STD = (5e-4, 1e-3)
"""Of the robot's pose, position [m] and turn [rad]."""
STILL_STD = (2e-3, 5e-3)
"""Likewise of a platform that no robot carries, where the rig's reference pose has it."""


class State(IntEnum):
    """What is known of the sources; the constants of PoseAgreement."""

    UNKNOWN = 0
    AGREE = 1
    CANDIDATES = 2
    NAMED = 3


@dataclass(frozen=True, eq=False)
class Measured:
    """A reading of the tracker as it comes.

    Attributes:
        begin: of its averaging, on the samples' clock [s].
        end: of it [s].
        reflector: index from 0.
        position: (3,) tracker's frame [m].
        std: each axis, the largest [m].
    """

    begin: float
    end: float
    reflector: int
    position: FloatArray
    std: float


@dataclass(frozen=True, eq=False)
class Estimate:
    """The newest answer.

    Attributes:
        time: stamp of the sample that was judged [s].
        state: what is known.
        agreement: of the sources; None where nothing is known.
        compared: the last reading of the tracker; None before the first.
        readings: of the tracker that were compared.
        reason: for people.
    """

    time: float
    state: State
    agreement: Agreement | None
    compared: Compared | None
    readings: int
    reason: str

    @property
    def suspects(self) -> tuple[Suspect, ...]:
        """What may disagree."""
        return () if self.agreement is None else self.agreement.candidates


def rig_noise(frames: RigFrames) -> AgreementNoise:
    """What counts as agreement on a rig with a robot, as far as nobody has measured it.

    Springs within 2 % over the workspace; a robot with an absolute error of 0.5 mm that bends as
    the published stiffness of an industrial robot says (6e-6 m/N at the platform); a tracker set
    down within 20 mm and 20 mrad of its nominal place; reflectors within 0.5 mm.

    Args:
        frames: of the rig.
    """
    return AgreementNoise(
        force=0.3,
        torque=0.03,
        stiffness=0.02,
        length=3e-4,
        per_newton=6e-6,
        turn_per_newton=2e-5,
        turn_per_newton_metre=3e-4,
        mass=frames.tool_mass,
        tracker=TrackerNoise(
            shift=0.02,
            turn=0.02,
            nest=5e-4,
            robot=5e-4,
            robot_turn=5e-4,
            per_newton=6e-6,
            turn_per_newton=2e-5,
            turn_per_newton_metre=3e-4,
        ),
    )


class PoseEstimator:
    """Holds the sources of the platform's pose against each other."""

    def __init__(
        self,
        rig: Rig,
        frames: RigFrames,
        robot: bool = True,
        noise: AgreementNoise | None = None,
    ) -> None:
        """Start; nothing is known before the limbs have zeros.

        Args:
            rig: that is watched.
            frames: where tracker and reflectors are.
            robot: whether a robot carries the platform.
            noise: what counts as agreement; None: `rig_noise`.
        """
        self._geometry, self._frames = rig.geometry, frames
        self._springs = rig.springs
        self._monitor = AgreementMonitor(
            rig.geometry,
            rig.springs.nominal,
            noise or rig_noise(frames),
            ROBOT_STD if robot else STILL_STD,
        )
        reference = PoseAt(0.0, rig.geometry.reference_position, rig.geometry.reference_rotation)
        self.joiner = MomentJoiner(rig.control.pose_lag, None if robot else reference)
        self._zeroing = 0
        self._wound_zero = np.zeros(rig.geometry.cables)
        self._length_zero = np.zeros(rig.geometry.cables)
        self._waiting: deque[Measured] = deque(maxlen=WAITING_READINGS)
        self._compared: Compared | None = None
        self._readings = 0
        self._newest_s = -np.inf
        self._last: tuple[float, Agreement] | None = None

    def limbs(self, sample: LimbSample) -> None:
        """Take a sample of the limbs; one with lengths of no rig is left out.

        Args:
            sample: of them.
        """
        # Written so that NaN is left out, but for an elongation without a zero.
        usable = np.isfinite(sample.time) and (np.abs(sample.wound) <= FARTHEST_M).all()
        if not usable or (np.abs(sample.elongation) > FARTHEST_M).any():
            return
        if sample.time < self._newest_s:
            self._zeroing, self._last = 0, None
            self._waiting.clear()
        self._newest_s = sample.time
        self.joiner.limbs(sample)

    def measured(self, reading: Measured) -> None:
        """Take a reading of the tracker; one with numbers of no rig is left out.

        Args:
            reading: one that succeeded.
        """
        usable = np.isfinite([reading.begin, reading.end]).all() and 0.0 <= reading.std < np.inf
        usable = usable and (np.abs([*reading.position, reading.std]) <= FARTHEST_M).all()
        if usable and 0 <= reading.reflector < len(self._frames.reflectors):
            self._waiting.append(reading)

    def look(self) -> Estimate:
        """Judge what has come; return the newest answer."""
        for moment in self.joiner.take():
            self._judge(moment)
        while self._waiting and self._waiting[0].end <= self._newest_s - 0.1:
            self._compare(self._waiting.popleft())
        return self._estimate()

    def _judge(self, moment: Moment) -> None:
        sample, pose = moment.limbs, moment.pose
        if not sample.zeroed:
            self._zeroing, self._last = 0, None
            return
        length = cable_lengths(self._geometry, pose.position, pose.rotation)
        if sample.zeroing != self._zeroing:
            self._zeroing = sample.zeroing
            # What was wound where the elongation is zero, by the bridge's own zeros.
            self._wound_zero, self._length_zero = sample.wound - sample.elongation, length
            self._monitor.zero(pose.position, pose.rotation, sample.wound)
        elongation = sample.wound - self._wound_zero + length - self._length_zero
        wrench = (moment.wrench.reshape(2, 3) @ pose.rotation.T).ravel()
        found = self._monitor.cables(
            pose.position,
            pose.rotation,
            sample.wound,
            self._springs.stiffness(length) * elongation,
            wrench,
            moment.travel,
            moment.acceleration,
        )
        if found is not None:
            self._last = sample.time, found

    def _compare(self, reading: Measured) -> None:
        """Hold a reading against the robot's pose, where the platform stood meanwhile."""
        pose = self.joiner.standing(reading.begin, reading.end)
        if pose is None:
            return
        tracker = self._frames.tracker_frame
        arm = tracker.rotation @ reading.position
        point = pose.rotation @ np.asarray(self._frames.reflectors[reading.reflector])
        wrench = self.joiner.near(pose.time).reshape(2, 3) @ pose.rotation.T
        made = Reading(
            reflector=reading.reflector,
            measured=np.asarray(tracker.position) + arm,
            expected=pose.position + point,
            arm=arm,
            position=pose.position,
            rotation=pose.rotation,
            wrench=wrench.ravel(),
            std=reading.std,
        )
        found = self._monitor.reflector(made.measured, made.expected, made.std, made)
        if found is not None:
            self._compared, self._readings = found, self._readings + 1
            if self._last is not None:
                self._last = self._last[0], self._monitor.again()

    def _estimate(self) -> Estimate:
        if self._last is None or not self._last[0] >= self._newest_s - STALE_S:
            why = "limbs have no zeros" if not self._zeroing else "pose or wrench are missing"
            return self._answer(self._newest_s, State.UNKNOWN, None, f"not judged: {why}")
        time_s, agreement = self._last
        if agreement.agree:
            return self._answer(time_s, State.AGREE, agreement, "")
        if agreement.named is not None:
            text = f"{agreement.named} disagrees with all others"
            return self._answer(time_s, State.NAMED, agreement, text)
        text = " or ".join(str(suspect) for suspect in agreement.candidates[:4])
        more = len(agreement.candidates) - 4
        text += f" or one of {more} more" if more > 0 else ""
        text = text or "nothing that is known of explains it: several things at once?"
        return self._answer(
            time_s, State.CANDIDATES, agreement, f"sources of the pose disagree: {text}"
        )

    def _answer(
        self, time_s: float, state: State, agreement: Agreement | None, reason: str
    ) -> Estimate:
        return Estimate(time_s, state, agreement, self._compared, self._readings, reason)
