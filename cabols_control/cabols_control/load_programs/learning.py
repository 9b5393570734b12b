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
smoothed command by at most LARGEST_SHARE of its peak. What was learnt holds for one programme, rig,
design and pose (`fingerprint`), and is forgotten where the error grows: the target has changed.

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

from cabols_control.checks import FloatArray, finite_array
from cabols_control.errors import CabolsError, ConfigError
from cabols_control.load_programs.preview import PERIOD_S, ShapedProgram, aim_at
from cabols_control.rig import Rig

GAIN = 0.7
ROBUST_HZ, ROBUST_ORDER = 10.0, 4
LARGEST_SHARE = 0.2
"""Largest correction of an axis: this share of the peak force or torque of the programme."""
LEAST_CORRECTION = np.array([2.0, 2.0, 2.0, 0.2, 0.2, 0.2])
"""That is always allowed: friction acts on axes that are not commanded, too [N, N m]."""
GROWN = 1.5
"""Times the best run's error: beyond it what was learnt is forgotten."""
SAME_PLACE_M, SAME_TURN = 1e-3, 2e-3
"""Poses that differ by less than about this count as one."""
_TORQUE_ARM_M = 0.15


@dataclass(frozen=True, eq=False)
class Learnt:
    """What was learnt of a programme.

    Attributes:
        fingerprint: of what it holds for.
        correction: (k, 6) added to the smoothed command, a point per millisecond [N, N m].
        history: (r, 6) rms error of each axis in each run since it began [N, N m].
    """

    fingerprint: str
    correction: FloatArray
    history: FloatArray

    @property
    def runs(self) -> int:
        """Number of runs that taught something."""
        return int(self.history.shape[0])


def fingerprint(shaped: ShapedProgram, rig: Rig, position: FloatArray, rotation: FloatArray) -> str:
    """Return what tells one programme, rig, design and pose from another.

    Args:
        shaped: the programme as it is followed without learning.
        rig: geometry, limbs, design.
        position: (3,) platform's origin in the base frame [m].
        rotation: (3, 3) from platform to base axes.
    """
    digest = hashlib.sha256()
    for part in (
        shaped.command.time,
        shaped.command.wrench,
        shaped.smoothed.wrench,
        rig.geometry.base_points,
        rig.geometry.platform_points,
        np.round(np.asarray(position) / SAME_PLACE_M),
        np.round(np.asarray(rotation) / SAME_TURN),
    ):
        # + 0.0, as -0.0 has other bytes.
        digest.update(np.ascontiguousarray(part, dtype=np.float64).__add__(0.0).tobytes())
    digest.update(repr((rig.control, rig.limbs)).encode())
    return digest.hexdigest()


def nothing_learnt(shaped: ShapedProgram, mark: str) -> Learnt:
    """Return the state before the first run.

    Args:
        shaped: the programme as it is followed.
        mark: its fingerprint.
    """
    return Learnt(mark, np.zeros_like(shaped.smoothed.wrench), np.zeros((0, 6)))


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
    learnt: Learnt, shaped: ShapedProgram, time: FloatArray, measured: FloatArray
) -> tuple[Learnt, bool]:
    """Learn from one complete run.

    Args:
        learnt: what the run aimed at.
        shaped: the programme that ran.
        time: (m,) of the samples, from the start of the smoothed command [s].
        measured: (m, 6) wrench about the platform's origin, base axes [N, N m].

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
    rms = np.sqrt(np.mean(error**2, axis=0))
    history = np.vstack([learnt.history, rms])
    lengths = np.linalg.norm(history / np.repeat([1.0, _TORQUE_ARM_M], 3), axis=1)
    if learnt.runs > 0 and not lengths[-1] <= GROWN * lengths[:-1].min():
        return nothing_learnt(shaped, learnt.fingerprint), True
    peak = np.abs(shaped.smoothed.wrench).max(axis=0)
    peak = np.repeat([peak[:3].max(), peak[3:].max()], 3)
    most = np.maximum(LARGEST_SHARE * peak, LEAST_CORRECTION)
    wanted = np.clip(learnt.correction + GAIN * error, -most, most)
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
    """Write what was learnt, complete or not at all; the file is named by its fingerprint.

    Args:
        learnt: to keep.
        folder: made if it is not there.

    Raises:
        OSError: if it cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{learnt.fingerprint[:32]}.npz"
    draft = path.with_suffix(".new.npz")
    np.savez_compressed(
        draft, mark=learnt.fingerprint, correction=learnt.correction, history=learnt.history
    )
    draft.replace(path)
    return path


def load_learnt(shaped: ShapedProgram, mark: str, folder: Path) -> Learnt:
    """Return what was learnt of a programme; nothing if there is no file for it.

    Args:
        shaped: the programme as it is followed without learning.
        mark: its fingerprint.
        folder: where `save_learnt` keeps files.

    Raises:
        ConfigError: if the file is damaged.
    """
    path = folder / f"{mark[:32]}.npz"
    if not path.exists():
        return nothing_learnt(shaped, mark)
    try:
        with np.load(path, allow_pickle=False) as stored:
            found = Learnt(str(stored["mark"]), stored["correction"], stored["history"])
        finite_array("correction", found.correction, shaped.smoothed.wrench.shape)
        finite_array("history", found.history, (None, 6))
    except (OSError, ValueError, KeyError, EOFError, BadZipFile, zlib.error, CabolsError) as error:
        raise ConfigError(
            f"{path}: expected what a run has learnt, got {error}; delete it"
        ) from error
    return found if found.fingerprint == mark else nothing_learnt(shaped, mark)
