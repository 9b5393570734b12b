# SPDX-License-Identifier: Apache-2.0
"""How old the robot's poses are at their stamps, by a recorded motion under load; pure.

The tensions by encoders and pose, and the force/torque sensor, say the same wrench: at any time

    w(t) = A(t) k_e (wound(t) + l(t) - z),

if lengths l and structure matrix A are of the pose at t. With a lag L, which the robot does not
state, the pose at t is the one that is stamped t + L. The lag is where the two agree best, over the
zeros z of the cables, an offset of the sensor, and a part of each cable's length that changes with
its motor's direction (backlash), which are solved for, too: what goes with a speed seems a lag.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation, Slerp

from cabols_control.checks import FloatArray, finite_array
from cabols_control.errors import CabolsError
from cabols_control.kinematics import cable_lengths, structure_matrix
from cabols_control.rig import Rig

RANGE_S = (-0.01, 0.05)
"""Lags among which is looked [s]."""
SAMPLES = 500
"""Of the recording that are used, evenly spaced: each costs a pose at each lag."""
BLOCKS = 4
"""Parts of the recording whose lags are compared."""
SLOWEST = 0.004
"""Mean speed of the platform's origin below which the lag moves nothing [m/s]."""
PLAY = 5e-5
"""Way back after which a motor counts as turned round [m]."""
TORQUE_SCALE = 10.0
"""Newtons that stand beside a newton metre, as in the sensor's ranges [1/m]."""


class PoseLagError(CabolsError):
    """A recording that says nothing about the lag."""


@dataclass(frozen=True)
class PoseLag:
    """An identified lag.

    Attributes:
        lag: age of a pose at its stamp [s].
        deviation: standard deviation, by the scatter between parts of the recording [s].
        residual: rms of the forces that remain between sensor and cables [N].
        residual_without: the same with a lag of zero [N].
    """

    lag: float
    deviation: float
    residual: float
    residual_without: float


@dataclass(frozen=True, eq=False)
class PoseRecording:
    """A motion under load: k samples of bridge and sensor, m poses of the robot, on one clock.

    Attributes:
        time: (k,) of the samples [s].
        wound: (k, n) wound lengths [m].
        wrench: (k, 6) measured, about the platform's origin, platform axes [N, N m].
        pose_time: (m,) stamps [s].
        pose: (m, 7) position [m], quaternion x y z w.
    """

    time: FloatArray
    wound: FloatArray
    wrench: FloatArray
    pose_time: FloatArray
    pose: FloatArray

    def checked(self, cables: int) -> PoseRecording:
        """Return it with sorted poses and as many samples as are used.

        Args:
            cables: of the rig.

        Raises:
            ShapeError, PoseLagError: if it cannot be used.
        """
        time = finite_array("time", self.time, (None,))
        wound = finite_array("wound", self.wound, (time.size, cables))
        wrench = finite_array("wrench", self.wrench, (time.size, 6))
        pose_time = finite_array("pose_time", self.pose_time, (None,))
        pose = finite_array("pose", self.pose, (pose_time.size, 7))
        pose_time, first = np.unique(pose_time, return_index=True)
        early, late = RANGE_S
        inside = np.zeros(0, dtype=np.int64)
        if pose_time.size > 1:
            begins, ends = pose_time.min() - early, pose_time.max() - late
            inside = np.flatnonzero((time >= begins) & (time <= ends))
        if inside.size < 200:
            raise PoseLagError("expected at least 200 samples between the poses, got too few")
        # Means of neighbours, as the sensor is noisy.
        parts = np.array_split(inside, min(SAMPLES, inside.size))
        time, wound, wrench = (
            np.array([values[part].mean(axis=0) for part in parts])
            for values in (time, wound, wrench)
        )
        return PoseRecording(time, wound, wrench, pose_time, pose[first])


def identify_pose_lag(rig: Rig, recording: PoseRecording) -> PoseLag:
    """Identify the lag of the robot's poses.

    Args:
        rig: geometry, stiffness of the springs.
        recording: of a motion under load, best to and fro along several axes at 20 mm/s or more.

    Returns:
        The lag.

    Raises:
        ShapeError, PoseLagError: if the recording cannot be used, or says nothing about the lag.
    """
    used = recording.checked(rig.geometry.cables)
    at = used.pose[:, :3]
    way = float(np.linalg.norm(np.diff(at, axis=0), axis=1).sum())
    speed = way / float(np.ptp(used.pose_time))
    if not speed >= SLOWEST:
        raise PoseLagError(
            f"expected the platform to move at {1e3 * SLOWEST:g} mm/s or more in the mean, got "
            f"{1e3 * speed:.2g} mm/s: no lag can be told from standing"
        )
    turns = Slerp(used.pose_time, Rotation.from_quat(used.pose[:, 3:]))

    def residuals(lag: float) -> FloatArray:
        return _residuals(rig, used, turns, lag)

    def cost(lag: float, rows: slice) -> float:
        return float(np.square(residuals(lag)[rows]).sum())

    whole = slice(None)
    lags = np.linspace(*RANGE_S, 7)
    start = int(np.argmin([cost(lag, whole) for lag in lags]))
    if start in (0, lags.size - 1):
        raise PoseLagError(
            f"expected a lag between {1e3 * RANGE_S[0]:g} and {1e3 * RANGE_S[1]:g} ms; sensor and "
            "cables agree best at the end of that range: is it the bench's geometry and zero?"
        )
    bounds = (lags[start - 1], lags[start + 1])
    options = {"xatol": 5e-5}
    found = minimize_scalar(cost, bounds=bounds, args=(whole,), method="bounded", options=options)
    lag = float(found.x)
    size, step = used.time.size, 0.0005
    # Of each part by the parabola through three lags: the offsets are those of the whole.
    parts = np.array([np.square(residuals(lag + step * k)).sum(axis=1) for k in (-1, 0, 1)])
    shifts = []
    for block in np.array_split(np.arange(size), BLOCKS):
        before, here, after = parts[:, block].sum(axis=1)
        curvature = before - 2.0 * here + after
        shifts.append(0.5 * step * (before - after) / curvature if curvature > 0.0 else np.nan)
    deviation = float(np.std(shifts, ddof=1) / np.sqrt(BLOCKS))
    forces = [np.sqrt(np.mean(np.square(residuals(each)[:, :3]))) for each in (lag, 0.0)]
    return PoseLag(lag, deviation, float(forces[0]), float(forces[1]))


def _residuals(rig: Rig, used: PoseRecording, turns: Slerp, lag: float) -> FloatArray:
    """(k, 6) what remains of the sensor's wrench, base axes, torques in newtons."""
    at = used.time + lag
    places = np.array([np.interp(at, used.pose_time, used.pose[:, k]) for k in range(3)]).T
    rotations = turns(at).as_matrix()
    geometry = rig.geometry
    n = geometry.cables
    sides = _directions(used.wound)
    rows = np.zeros((at.size, 6, 2 * n + 6))
    given = np.zeros((at.size, 6))
    for k in range(at.size):
        pose = places[k], rotations[k]
        length = cable_lengths(geometry, *pose)
        pulled = structure_matrix(geometry, *pose) * rig.springs.stiffness(length)
        stretch = used.wound[k] + length
        measured = np.concatenate([pose[1] @ used.wrench[k, :3], pose[1] @ used.wrench[k, 3:]])
        given[k] = measured - pulled @ stretch
        rows[k, :, :n] = -pulled
        rows[k, :, n : 2 * n] = -pulled * sides[k]
        rows[k, :3, 2 * n : 2 * n + 3] = rows[k, 3:, 2 * n + 3 :] = pose[1]
    scale = np.array([1.0, 1.0, 1.0, TORQUE_SCALE, TORQUE_SCALE, TORQUE_SCALE])
    flat = (rows * scale[:, None]).reshape(-1, 2 * n + 6)
    wanted = (given * scale).ravel()
    solution = np.linalg.lstsq(flat, wanted, rcond=None)[0]
    return np.asarray((wanted - flat @ solution).reshape(-1, 6), dtype=np.float64)


def _directions(wound: FloatArray) -> FloatArray:
    """(k, n) 1 where a motor wound in last, -1 where it paid out, by (k, n) wound lengths [m]."""
    sides = np.zeros_like(wound)
    for i, lengths in enumerate(wound.T):
        side, turned = 0.0, lengths[0]
        for k, length in enumerate(lengths):
            # A motor has turned round once it is PLAY behind where it was.
            if abs(length - turned) > PLAY:
                side = 1.0 if length > turned else -1.0
            if (length - turned) * side > 0.0:
                turned = length
            elif side == 0.0:
                turned = lengths[0]
            sides[k, i] = side
    return sides
