# SPDX-License-Identifier: Apache-2.0
"""Samples of limbs and sensor with the platform's pose at their time.

Slow copies of the topics come at their own times, some 45 ms apart. A sample is used once poses
from before and after it are there: between them the pose is interpolated, and what the motion may
have done meanwhile is stated, so that a platform that accelerates is judged more mildly.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from cabols_control.checks import FloatArray

KEPT = 64
"""Samples, wrenches and poses that are kept; copies of three seconds."""
LONGEST_GAP_S = 0.3
"""Between two poses; over a longer one, nothing is said about the motion."""
OTHER_CLOCK_S = 0.5
"""Stamps further from the newest sample's are of another clock, and the arrival counts."""
STAMP_STD_S = 1e-3
"""Standard deviation of a pose's time by its stamp [s]."""
ARRIVAL_STD_S = 0.03
"""Likewise by its arrival [s]."""
STILL_M, STILL_RAD = 1e-4, 3e-4
"""Motion within a reading of the tracker that counts as none."""


@dataclass(frozen=True, eq=False)
class LimbSample:
    """What the bridge says of the limbs at one sample.

    Attributes:
        time: stamp [s].
        wound: (n,) wound in since power-up [m].
        elongation: (n,) of springs and cables [m]; NaN before zeroing.
        zeroing: number of the pre-tightening that the zeros are of; 0 for none.
    """

    time: float
    wound: FloatArray
    elongation: FloatArray
    zeroing: int

    @property
    def zeroed(self) -> bool:
        """Whether all limbs have zeros."""
        return self.zeroing > 0 and bool(np.isfinite(self.elongation).all())


@dataclass(frozen=True, eq=False)
class PoseAt:
    """The platform's pose by the robot, at one time.

    Attributes:
        time: on the samples' clock [s].
        position: (3,) base frame [m].
        rotation: (3, 3) from platform to base axes.
        std: standard deviation of its time [s].
    """

    time: float
    position: FloatArray
    rotation: FloatArray
    std: float = STAMP_STD_S


@dataclass(frozen=True, eq=False)
class Moment:
    """A sample of limbs and sensor, with the pose at its time.

    Attributes:
        limbs: the sample.
        wrench: (6,) of the cables on the platform by the sensor, platform axes [N, N m].
        pose: of the platform by the robot.
        travel: how far the interpolated pose may be off by the motion, standard deviation [m].
        acceleration: of the platform, about [m/s^2].
    """

    limbs: LimbSample
    wrench: FloatArray
    pose: PoseAt
    travel: float
    acceleration: float


class MomentJoiner:
    """Joins what comes from bridge and robot."""

    def __init__(self, lag_s: float = 0.0, still: PoseAt | None = None) -> None:
        """Start empty.

        Args:
            lag_s: age of a pose at its stamp [s].
            still: pose of a platform that no robot moves, used until poses come; None: there is
                a robot.
        """
        self._lag_s, self._still = lag_s, still
        self._samples: deque[LimbSample] = deque(maxlen=KEPT)
        self._wrenches: deque[tuple[float, FloatArray]] = deque(maxlen=KEPT)
        self._poses: deque[PoseAt] = deque(maxlen=KEPT)
        self._newest_s = -np.inf

    def limbs(self, sample: LimbSample) -> None:
        """Take a sample of the limbs.

        Args:
            sample: of them.
        """
        if sample.time < self._newest_s:
            # Another run of the bridge, or another clock: what was heard before does not count.
            for heard in (self._samples, self._wrenches, self._poses):
                heard.clear()
        self._newest_s = sample.time
        self._samples.append(sample)

    def wrench(self, time_s: float, wrench: FloatArray) -> None:
        """Take a wrench.

        Args:
            time_s: its stamp [s].
            wrench: (6,) platform axes [N, N m].
        """
        self._wrenches.append((time_s, np.array(wrench, dtype=np.float64)))

    def pose(self, time_s: float, position: FloatArray, rotation: FloatArray) -> None:
        """Take a pose of the robot.

        Args:
            time_s: its stamp [s].
            position: (3,) base frame [m].
            rotation: (3, 3) from platform to base axes.
        """
        own = abs(time_s - self._newest_s) <= OTHER_CLOCK_S
        at = (time_s if own else self._newest_s) - self._lag_s
        if not np.isfinite(at) or (self._poses and at <= self._poses[-1].time):
            return
        std = STAMP_STD_S if own else ARRIVAL_STD_S
        self._poses.append(PoseAt(at, np.array(position), np.array(rotation), std))

    def take(self) -> list[Moment]:
        """Return the moments that are complete, oldest first; each comes once."""
        wrenches, found = dict(self._wrenches), []
        while self._samples:
            sample = self._samples[0]
            wrench, between = wrenches.get(sample.time), self._between(sample.time)
            if wrench is not None and between is not None:
                found.append(Moment(sample, wrench, *between))
            elif not self._past(sample.time):
                break
            self._samples.popleft()
        return found

    def _past(self, time_s: float) -> bool:
        """Whether nothing that completes a sample can come any more."""
        poses = self._poses[-1].time if self._poses else -np.inf
        wrenches = self._wrenches[-1][0] if self._wrenches else -np.inf
        later = self._newest_s > time_s + 2.0 * OTHER_CLOCK_S
        return bool((poses >= time_s and wrenches > time_s) or later)

    def _between(self, time_s: float) -> tuple[PoseAt, float, float] | None:
        """Pose at a time, by those round it; how far it may be off, and the acceleration."""
        if self._still is not None and not self._poses:
            return self._still, 0.0, 0.0
        poses = list(self._poses)
        after = next((k for k, pose in enumerate(poses) if pose.time >= time_s), 0)
        if after == 0:
            return None
        one, two = poses[after - 1], poses[after]
        gap = two.time - one.time
        if not gap <= LONGEST_GAP_S:
            return None
        share = (time_s - one.time) / gap
        turn = Rotation.from_matrix(two.rotation @ one.rotation.T).as_rotvec()
        rotation = Rotation.from_rotvec(share * turn).as_matrix() @ one.rotation
        speed = (two.position - one.position) / gap
        change = 0.0
        if after >= 2 and one.time - poses[after - 2].time <= LONGEST_GAP_S:
            before = one.time - poses[after - 2].time
            earlier = (one.position - poses[after - 2].position) / before
            change = float(np.linalg.norm(speed - earlier))
        # A turn moves the ends of the cables, about 0.2 m from the platform's origin.
        swift = float(np.linalg.norm(speed)) + 0.2 * float(np.linalg.norm(turn)) / gap
        travel = swift * max(one.std, two.std) + 0.125 * change * gap
        position = one.position + share * (two.position - one.position)
        pose = PoseAt(time_s, position, rotation, max(one.std, two.std))
        return pose, travel, change / gap

    def standing(self, begin_s: float, end_s: float) -> PoseAt | None:
        """Return the pose at which the platform stood, if it did.

        Args:
            begin_s: of the time [s].
            end_s: of it [s].

        Returns:
            The mean of its poses; None where it moved, or where no pose is known.
        """
        if self._still is not None and not self._poses:
            return self._still
        within = [pose for pose in self._poses if begin_s <= pose.time <= end_s]
        if not within:
            return None
        places = np.array([pose.position for pose in within])
        turns = np.array([pose.rotation for pose in within])
        moved = np.ptp(places, axis=0).max() > STILL_M
        turned = np.ptp(turns, axis=0).max() > STILL_RAD
        if moved or turned:
            return None
        middle = within[len(within) // 2]
        return PoseAt(0.5 * (begin_s + end_s), places.mean(axis=0), middle.rotation)

    def near(self, time_s: float) -> FloatArray:
        """(6,) wrench nearest to a time, platform axes [N, N m]; zeros where there is none.

        Args:
            time_s: on the samples' clock [s].
        """
        if not self._wrenches:
            return np.zeros(6)
        return min(self._wrenches, key=lambda pair: abs(pair[0] - time_s))[1]
