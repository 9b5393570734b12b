"""Learning over runs: what was learnt of each programme is kept on disk (learning.py)."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.errors import CabolsError
from cabols_control.files.state_folder import state_folder
from cabols_control.load_programs.learning import (
    Learnt,
    apply_learnt,
    fingerprint,
    learn,
    load_learnt,
    nothing_learnt,
    save_learnt,
)
from cabols_control.load_programs.preview import ShapedProgram
from cabols_control.rig import Rig

FOLDER = "learnt"
MOST_SAMPLES = 4_000_000
"""Samples of one run that are kept: an hour at 1 kHz; a longer run teaches nothing."""


@dataclass(frozen=True, eq=False)
class _Lesson:
    """A programme that aims at what was learnt of it."""

    followed: ShapedProgram
    plain: ShapedProgram
    learnt: Learnt
    rotation: FloatArray


@dataclass(eq=False)
class School:
    """Aims programmes at what their earlier runs taught, and keeps what the present one teaches.

    It holds while the target stands: measured wrenches are turned by the pose of the start.

    Attributes:
        rig: geometry, limbs, design.
        held_s: for how long the wrench law holds each value of a reference [s].
        folder: of the files; None: below the state folder.
    """

    rig: Rig
    held_s: float
    folder: Path | None = None
    _ready: list[_Lesson] = field(default_factory=list)
    _now: _Lesson | None = None
    _times: list[float] = field(default_factory=list)
    _wrenches: list[FloatArray] = field(default_factory=list)

    @property
    def _place(self) -> Path:
        return self.folder or state_folder() / FOLDER

    def apply(
        self, plain: ShapedProgram, position: FloatArray, rotation: FloatArray
    ) -> ShapedProgram:
        """Aim a programme at what was learnt of it at this pose; as it is before the first run.

        Args:
            plain: as it is followed without learning.
            position: (3,) platform's origin in the base frame [m].
            rotation: (3, 3) from platform to base axes.

        Raises:
            ConfigError: if what is stored is damaged.
        """
        mark = fingerprint(plain, self.rig, position, rotation)
        learnt = load_learnt(plain, mark, self._place)
        followed = apply_learnt(plain, learnt, self.rig, self.held_s)
        # A check shapes programmes, too, that never run: the last few are enough.
        self._ready = [*self._ready[-7:], _Lesson(followed, plain, learnt, np.array(rotation))]
        return followed

    def begin(self, program: ShapedProgram) -> None:
        """Begin to keep a run.

        Args:
            program: that `apply` gave; another one teaches nothing.
        """
        found = [lesson for lesson in self._ready if lesson.followed is program]
        self._now = found[0] if found else None
        self._times, self._wrenches = [], []

    def note(self, time_s: float, wrench: FloatArray) -> None:
        """Keep a sample.

        Args:
            time_s: since the smoothed command began [s].
            wrench: (6,) measured, about the platform's origin, platform axes [N, N m].
        """
        late = not self._times or time_s > self._times[-1]
        if self._now is not None and late and len(self._times) < MOST_SAMPLES:
            self._times.append(time_s)
            self._wrenches.append(np.array(wrench, dtype=np.float64))

    def finish(self) -> str:
        """Learn from a run that was completed; what came of it, in words."""
        lesson, self._now = self._now, None
        if lesson is None or not self._times:
            return "nothing was learnt: no wrench was measured"
        turned = np.array(self._wrenches).reshape(-1, 2, 3) @ lesson.rotation.T
        try:
            known, forgotten = learn(
                lesson.learnt, lesson.plain, np.array(self._times), turned.reshape(-1, 6)
            )
            save_learnt(known, self._place)
        except (CabolsError, OSError) as error:
            return f"nothing was learnt: {error}"
        if forgotten:
            return "the error has grown, the target is another: what was learnt is forgotten"
        force, torque = known.history[-1, :3].max(), known.history[-1, 3:].max()
        return (
            f"run {known.runs} of this programme: rms error of the worst axes {force:.3f} N, "
            f"{torque:.4f} N m; the next run aims beside it"
        )

    def forget(self, plain: ShapedProgram, position: FloatArray, rotation: FloatArray) -> None:
        """Forget what was learnt of a programme at a pose.

        Args:
            plain: as it is followed without learning.
            position: (3,) platform's origin in the base frame [m].
            rotation: (3, 3) from platform to base axes.
        """
        mark = fingerprint(plain, self.rig, position, rotation)
        save_learnt(nothing_learnt(plain, mark), self._place)
