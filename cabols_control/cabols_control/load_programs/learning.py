# SPDX-License-Identifier: Apache-2.0
"""What one run of a programme teaches the next: iterative learning of a repeated programme.

Feedback and preview know neither friction nor backlash, and these come back with every run. So the
error of a run, smoothed command minus measured wrench, is added to what the next run aims at:

    aim = smoothed + c,   c <- Q (c + GAIN (smoothed - measured)),   reference = aim / G

with Q the robustness filter: a Butterworth low-pass of ROBUST_ORDER run forwards and backwards,
without phase, -6 dB at ROBUST_HZ. Where the loop answers the aim by P, about 1 with preview, the
error's part at a frequency shrinks by |Q (1 - GAIN P)| a run: it converges while P is within 70
degrees of right, and above ROBUST_HZ nothing is learnt.

What is asked for stays what it is: the smoothed command is not changed, so errors count against it,
and the learnt aim goes through the same checks of limits as any programme. The aim differs from the
smoothed command by at most LARGEST_SHARE of its peak, and by nothing where the cables cannot give
what is asked for. What was learnt holds for one programme, rig and design (`fingerprint`) near one
pose, and is forgotten where the error grows: the target has changed.

Source: Bristow, Tharayil and Alleyne 2006, A survey of iterative learning control, equation (9).
"""

from __future__ import annotations

import hashlib
import zlib
from dataclasses import dataclass, replace
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from scipy.signal import butter, sosfiltfilt

from cabols_control.checks import BoolArray, FloatArray, finite_array, rotation_matrix
from cabols_control.errors import CabolsError, ConfigError
from cabols_control.load_programs.preview import PERIOD_S, ShapedProgram, aim_at
from cabols_control.load_programs.programs import LoadProgram
from cabols_control.rig import Rig
from cabols_control.rotations import angle_between

GAIN = 0.7
ROBUST_HZ, ROBUST_ORDER = 10.0, 4
LARGEST_SHARE = 0.2
"""Largest correction of an axis: this share of the peak force or torque of the programme."""
LEAST_CORRECTION = np.array([2.0, 2.0, 2.0, 0.2, 0.2, 0.2])
"""That is always allowed: friction acts on axes that are not commanded, too [N, N m]."""
GROWN = 1.5
"""Times the best run's error: beyond it what was learnt is forgotten."""
SAME_PLACE = (1e-3, 2e-3)
"""Poses that differ by at most this, in distance and angle, count as one [m], [rad]."""
_TORQUE_ARM_M = 0.15

Place = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class Learnt:
    """What was learnt of a programme.

    Attributes:
        fingerprint: of what it holds for.
        position: (3,) platform's origin where it was first learnt, base frame [m].
        rotation: (3, 3) from platform to base axes there.
        correction: (k, 6) added to the smoothed command, a point per millisecond [N, N m].
        history: (r, 6) rms error of each axis in each run since it began [N, N m].
    """

    fingerprint: str
    position: FloatArray
    rotation: FloatArray
    correction: FloatArray
    history: FloatArray

    @property
    def runs(self) -> int:
        """Number of runs that taught something."""
        return int(self.history.shape[0])

    def is_here(self, position: FloatArray, rotation: FloatArray) -> bool:
        """Whether it was learnt at about a pose.

        Args:
            position: (3,) platform's origin in the base frame [m].
            rotation: (3, 3) from platform to base axes.
        """
        return is_same_place((self.position, self.rotation), (position, rotation))


def is_same_place(one: Place, other: Place, most: tuple[float, float] = SAME_PLACE) -> bool:
    """Whether two poses differ by no more than counts.

    Args:
        one: (3,) position [m] and (3, 3) rotation.
        other: likewise.
        most: distance [m] and angle [rad] that count as none.
    """
    away = float(np.linalg.norm(np.subtract(one[0], other[0])))
    return away <= most[0] and angle_between(one[1], other[1]) <= most[1]


def fingerprint(asked: LoadProgram, frame: bytes, bandwidth: float, rig: Rig) -> str:
    """Return what tells one programme, rig and design from another.

    Args:
        asked: the programme as it was given, in its own frame: measured poses, by which it is moved
            to the base, are never the same twice.
        frame: definition of that frame.
        bandwidth: of its smoothing [Hz].
        rig: geometry, limbs, design.
    """
    digest = hashlib.sha256()
    geometry = rig.geometry
    axes = () if geometry.pulley_axes is None else (geometry.pulley_axes,)
    points = (geometry.base_points, geometry.platform_points, geometry.pulley_radius, *axes)
    for part in (asked.time, asked.wrench, *points):
        # + 0.0, as -0.0 has other bytes.
        digest.update(np.ascontiguousarray(part, dtype=np.float64).__add__(0.0).tobytes())
    digest.update(frame)
    digest.update(repr((rig.control, rig.limbs, asked.held, round(bandwidth, 6))).encode())
    return digest.hexdigest()


def nothing_learnt(
    shaped: ShapedProgram, mark: str, position: FloatArray, rotation: FloatArray
) -> Learnt:
    """Return the state before the first run.

    Args:
        shaped: the programme as it is followed.
        mark: its fingerprint.
        position: (3,) platform's origin in the base frame [m].
        rotation: (3, 3) from platform to base axes.
    """
    return Learnt(
        fingerprint=mark,
        position=np.array(position, dtype=np.float64),
        rotation=np.array(rotation, dtype=np.float64),
        correction=np.zeros_like(shaped.smoothed.wrench),
        history=np.zeros((0, 6)),
    )


def largest_correction(shaped: ShapedProgram) -> FloatArray:
    """(6,) most that may be learnt of a programme [N, N m]."""
    peak = np.abs(shaped.smoothed.wrench).max(axis=0)
    peak = np.repeat([peak[:3].max(), peak[3:].max()], 3)
    return np.asarray(np.maximum(LARGEST_SHARE * peak, LEAST_CORRECTION), dtype=np.float64)


def apply_learnt(shaped: ShapedProgram, learnt: Learnt, rig: Rig, held_s: float) -> ShapedProgram:
    """Return the programme with the reference that aims at what was learnt.

    Args:
        shaped: as followed without learning.
        learnt: of the same programme.
        rig: its design.
        held_s: for how long the wrench law holds each value of the reference [s].

    Raises:
        CabolsError: if it was learnt of another programme.
    """
    if learnt.correction.shape != shaped.smoothed.wrench.shape:
        raise CabolsError(
            f"learnt: expected a correction of shape {shaped.smoothed.wrench.shape}, got "
            f"{learnt.correction.shape}; it belongs to another programme"
        )
    return aim_at(shaped, learnt.correction, rig.control, held_s)


def learn(
    learnt: Learnt,
    shaped: ShapedProgram,
    time: FloatArray,
    measured: FloatArray,
    usable: BoolArray | None = None,
) -> tuple[Learnt, bool]:
    """Learn from one complete run.

    Args:
        learnt: what the run aimed at.
        shaped: the programme that ran.
        time: (m,) of the samples, from the start of the smoothed command [s].
        measured: (m, 6) wrench about the platform's origin, base axes [N, N m].
        usable: (k,) where the cables can give the smoothed command; elsewhere an error teaches
            nothing. None: everywhere.

    Returns:
        What is known now, and whether the run was worse than the best one by GROWN, so that all was
        forgotten.

    Raises:
        CabolsError: if the samples do not cover the run.
    """
    times = finite_array("time", time, (None,))
    values = finite_array("measured", measured, (times.size, 6))
    clock = shaped.smoothed.time
    # A window of a quarter of the filter's period may be missing, at the ends and between samples.
    gap = 0.25 / ROBUST_HZ
    if times.size < 2 or not (
        times[0] <= gap and times[-1] >= clock[-1] - gap and 0.0 <= np.diff(times).max() <= gap
    ):
        raise CabolsError(
            "time: expected samples of the whole run without a gap; nothing is learnt"
        )
    felt = np.column_stack([np.interp(clock, times, column) for column in values.T])
    error = shaped.smoothed.wrench - felt
    fits = np.ones(clock.size, dtype=bool) if usable is None else np.asarray(usable)
    error[~fits] = 0.0
    rms = np.sqrt(np.mean(error**2, axis=0))
    history = np.vstack([learnt.history, rms])
    lengths = np.linalg.norm(history / np.repeat([1.0, _TORQUE_ARM_M], 3), axis=1)
    if learnt.runs > 0 and not lengths[-1] <= GROWN * lengths[:-1].min():
        place = learnt.position, learnt.rotation
        return nothing_learnt(shaped, learnt.fingerprint, *place), True
    most = largest_correction(shaped)
    wanted = np.clip(learnt.correction + GAIN * error, -most, most) * fits[:, None]
    sections = butter(ROBUST_ORDER, ROBUST_HZ, fs=1.0 / PERIOD_S, output="sos")
    ends = min(round(1.0 / (ROBUST_HZ * PERIOD_S)), clock.size - 1)
    correction = sosfiltfilt(sections, wanted, axis=0, padlen=ends) * _fade(clock.size, ends)
    # The filter may overshoot; scaled, not clipped: kinks would come back as peaks in 1 / G.
    correction *= most / np.maximum(np.abs(correction).max(axis=0), most)
    return replace(learnt, correction=correction, history=history), False


def _fade(count: int, ends: int) -> FloatArray:
    """(count, 1) from 0 to 1 and back over the first and last points, without kinks."""
    near = np.minimum(np.arange(count), np.arange(count)[::-1]) / max(ends, 1)
    fade = np.sin(0.5 * np.pi * np.minimum(near, 1.0)) ** 4
    return np.asarray(fade[:, None])


def save_learnt(learnt: Learnt, folder: Path) -> Path:
    """Write what was learnt, complete or not at all; the file is named by programme and place.

    Args:
        learnt: to keep.
        folder: made if it is not there.

    Raises:
        OSError: if it cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    place = hashlib.sha256(learnt.position.tobytes() + learnt.rotation.tobytes()).hexdigest()
    path = folder / f"{learnt.fingerprint[:32]}-{place[:8]}.npz"
    draft = path.with_suffix(".new")
    with draft.open("wb") as stream:
        np.savez_compressed(
            stream,
            mark=learnt.fingerprint,
            position=learnt.position,
            rotation=learnt.rotation,
            correction=learnt.correction,
            history=learnt.history,
        )
    draft.replace(path)
    return path


def load_learnt(
    shaped: ShapedProgram, mark: str, place: Place, folder: Path
) -> tuple[Learnt, list[str]]:
    """Return what was learnt of a programme at about a place; nothing if there is no file for it.

    Args:
        shaped: the programme as it is followed without learning.
        mark: its fingerprint.
        place: (3,) platform's origin in the base frame [m], (3, 3) from platform to base axes.
        folder: where `save_learnt` keeps files.

    Returns:
        What was learnt, and why files that may have held it cannot be used.
    """
    wrong: list[str] = []
    for path in sorted(folder.glob(f"{mark[:32]}-*.npz")):
        try:
            found = _read(path, shaped)
        except (OSError, ValueError, KeyError, EOFError, BadZipFile, zlib.error, CabolsError) as no:
            wrong.append(f"{path}: expected what a run has learnt, got {no}; delete it")
            continue
        if found.fingerprint == mark and found.is_here(*place):
            return found, wrong
    return nothing_learnt(shaped, mark, *place), wrong


def _read(path: Path, shaped: ShapedProgram) -> Learnt:
    """Read a file of `save_learnt`; raises what reading and checking raise."""
    with np.load(path, allow_pickle=False) as stored:
        found = Learnt(
            fingerprint=str(stored["mark"]),
            position=finite_array("position", stored["position"], (3,)),
            rotation=rotation_matrix("rotation", stored["rotation"]),
            correction=finite_array(
                "correction", stored["correction"], shaped.smoothed.wrench.shape
            ),
            history=finite_array("history", stored["history"], (None, 6)),
        )
    most = largest_correction(shaped)
    if not (np.abs(found.correction) <= most * (1.0 + 1e-9)).all():
        raise ConfigError(f"correction: expected at most {most.tolist()} N, N m, got more")
    return found
