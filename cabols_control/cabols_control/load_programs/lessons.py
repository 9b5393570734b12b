# SPDX-License-Identifier: Apache-2.0
"""Learning over runs: what was learnt of each programme is kept on disk (learning.py)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from cabols_control.checks import BoolArray, FloatArray
from cabols_control.errors import CabolsError
from cabols_control.files.state_folder import state_folder
from cabols_control.load_programs.feasibility import check_program, check_shaped
from cabols_control.load_programs.learning import (
    Learnt,
    Place,
    apply_learnt,
    fingerprint,
    is_same_place,
    learn,
    load_learnt,
    nothing_learnt,
    save_learnt,
)
from cabols_control.load_programs.motor_demand import CURRENT_SHARE, motor_current
from cabols_control.load_programs.preview import ShapedProgram
from cabols_control.load_programs.programs import LoadProgram
from cabols_control.rig import Rig

FOLDER = "learnt"
MOST_SAMPLES = 4_000_000
"""Samples of one run that are kept: an hour at 1 kHz; a longer run teaches nothing."""


STANDS = (2e-3, 5e-3)
"""Most that the platform may move during a run, or nothing is learnt [m], [rad]."""
SAME_CLOCK_S = (-0.002, 0.015)
"""Median age of the newest sample; outside, bridge and programme have different clocks [s]."""
SHARES = (1.0, 0.5, 0.25, 0.0)
"""Of what was learnt, that are tried until cables, sensor and motors bear it."""


@dataclass(frozen=True, eq=False)
class _Lesson:
    """A programme that aims at what was learnt of it."""

    followed: ShapedProgram
    plain: ShapedProgram
    learnt: Learnt
    place: Place
    usable: BoolArray
    """(k,) where the cables can give the smoothed command within the limits."""


@dataclass(eq=False)
class School:
    """Aims programmes at what their earlier runs taught, and keeps what the present one teaches.

    It holds while the target stands: measured wrenches are turned by the pose of the start.

    Attributes:
        rig: geometry, limbs, design.
        held_s: for how long the wrench law holds each value of a reference [s].
        folder: of the files; None: below the state folder.
        notes: what should be known of what was stored; emptied by whoever tells it.
    """

    rig: Rig
    held_s: float
    folder: Path | None = None
    notes: list[str] = field(default_factory=list)
    _ready: list[_Lesson] = field(default_factory=list)
    _now: _Lesson | None = None
    _times: list[float] = field(default_factory=list)
    _wrenches: list[FloatArray] = field(default_factory=list)
    _ages: list[float] = field(default_factory=list)
    _moved: bool = False

    @property
    def _place(self) -> Path:
        return self.folder or state_folder() / FOLDER

    def apply(
        self,
        plain: ShapedProgram,
        position: FloatArray,
        rotation: FloatArray,
        asked: tuple[LoadProgram, bytes] | None = None,
    ) -> ShapedProgram:
        """Aim a programme at what was learnt of it at this pose; as it is before the first run.

        Args:
            plain: as it is followed without learning.
            position: (3,) platform's origin in the base frame [m].
            rotation: (3, 3) from platform to base axes.
            asked: the programme in its own frame, and that frame's definition; None: base axes.
        """
        place = (np.array(position, dtype=np.float64), np.array(rotation, dtype=np.float64))
        given, frame = asked or (plain.command, b"")
        mark = fingerprint(given, frame, plain.bandwidth, self.rig)
        learnt, wrong = load_learnt(plain, mark, place, self._place)
        self.notes += wrong
        found = check_shaped(self.rig, plain, *place)
        usable = np.array(found.reached & found.rated)
        followed, share = self._bearable(plain, learnt, place, usable)
        if share < 1.0:
            self.notes.append(
                f"{plain.name}: {100.0 * share:.0f} % of what was learnt are used: with all of it "
                "cables, sensor or motors would pass their limits"
            )
            learnt = replace(learnt, correction=share * learnt.correction)
        # A check shapes programmes, too, that never run: the last few are enough.
        self._ready = [*self._ready[-7:], _Lesson(followed, plain, learnt, place, usable)]
        return followed

    def _bearable(
        self, plain: ShapedProgram, learnt: Learnt, place: Place, usable: BoolArray
    ) -> tuple[ShapedProgram, float]:
        """Aim by the largest of SHARES with which no limit is passed that is not passed without."""
        if not learnt.correction.any():
            return plain, 1.0
        rig, limit = self.rig, CURRENT_SHARE * self.rig.control.current_limit
        limit = max(limit, float(np.abs(motor_current(rig, plain.smoothed, *place)).max()))
        for share in SHARES[:-1]:
            part = replace(learnt, correction=share * learnt.correction)
            followed = apply_learnt(plain, part, rig, self.held_s)
            # What would be felt if all that was learnt of were gone.
            aim = replace(plain.smoothed, wrench=plain.smoothed.wrench + part.correction)
            found = check_program(rig, aim, *place)
            control = check_program(rig, followed.control(rig.gains), *place)
            bears = (found.reached & found.rated & control.reached)[usable].all()
            if bears and np.abs(motor_current(rig, aim, *place)).max() <= limit:
                return followed, share
        return plain, 0.0

    def begin(self, program: ShapedProgram) -> None:
        """Begin to keep a run.

        Args:
            program: that `apply` gave; another one teaches nothing.
        """
        found = [lesson for lesson in self._ready if lesson.followed is program]
        # The newest: what nothing is added to is the same programme run after run.
        self._now = found[-1] if found else None
        self._times, self._wrenches, self._ages, self._moved = [], [], [], False

    def note_pose(self, position: FloatArray, rotation: FloatArray) -> None:
        """Look whether the platform stands during the run.

        Args:
            position: (3,) platform's origin in the base frame [m].
            rotation: (3, 3) from platform to base axes.
        """
        if self._now is not None and not is_same_place(
            self._now.place, (position, rotation), STANDS
        ):
            self._moved = True

    def note(self, time_s: float, wrench: FloatArray, age_s: float = 0.0) -> None:
        """Keep a sample.

        Args:
            time_s: since the smoothed command began [s].
            wrench: (6,) measured, about the platform's origin, platform axes [N, N m].
            age_s: of the sample by the clock of time_s [s].
        """
        late = not self._times or time_s > self._times[-1]
        if self._now is not None and late and len(self._times) < MOST_SAMPLES:
            self._times.append(time_s)
            self._wrenches.append(np.array(wrench, dtype=np.float64))
            self._ages.append(age_s)

    def finish(self) -> str:
        """Learn from a run that was completed; what came of it, in words."""
        lesson, self._now = self._now, None
        if lesson is None or not self._times:
            return "nothing was learnt: no wrench was measured"
        if self._moved:
            return "nothing was learnt: the platform moved during the run"
        if not lesson.usable.any():
            return "nothing was learnt: the cables can give none of this programme here"
        age_s = float(np.median(self._ages))
        if not SAME_CLOCK_S[0] <= age_s <= SAME_CLOCK_S[1]:
            return f"nothing was learnt: the bridge's clock is another one, by {age_s:.3f} s"
        turned = np.array(self._wrenches).reshape(-1, 2, 3) @ lesson.place[1].T
        try:
            known, forgotten = learn(
                lesson.learnt,
                lesson.plain,
                np.array(self._times),
                turned.reshape(-1, 6),
                lesson.usable,
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

    def forget(
        self,
        plain: ShapedProgram,
        position: FloatArray,
        rotation: FloatArray,
        asked: tuple[LoadProgram, bytes] | None = None,
    ) -> None:
        """Forget what was learnt of a programme at a pose.

        Args:
            plain: as it is followed without learning.
            position: (3,) platform's origin in the base frame [m].
            rotation: (3, 3) from platform to base axes.
            asked: as `apply`.
        """
        given, frame = asked or (plain.command, b"")
        mark = fingerprint(given, frame, plain.bandwidth, self.rig)
        known, _ = load_learnt(plain, mark, (position, rotation), self._place)
        save_learnt(nothing_learnt(plain, mark, known.position, known.rotation), self._place)
