# SPDX-License-Identifier: Apache-2.0
"""Whether the cables can give every wrench of a load programme at one pose."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_control.kinematics import structure_matrix
from cabols_control.load_programs.preview import LONGEST_S, ShapedProgram, designed_response
from cabols_control.load_programs.programs import LoadProgram
from cabols_control.load_programs.stopping import gained_until_stopped, saturating_current
from cabols_control.rig import Rig
from cabols_control.tension import DEFAULT_WEIGHTS, FEASIBLE, TensionResolver

PREVIEW_POINTS = 240
GAIN_SHARE = 1.5
"""By which what is gained until a motor stands is taken larger: fast wrenches overshoot."""
CURRENT_SHARE = 1.0
"""Share of the current limit that a programme may take for a while."""
MOVING_SHARE = 0.97
"""Share of the envelope's limits that may be reached before the motors can be stopped: there is
noise."""


@dataclass(frozen=True, eq=False)
class ProgramCheck:
    """A programme compared with the cables' and the sensor's limits at one pose.

    Attributes:
        program: what was checked.
        tension: (k, n) least-norm tensions at the programme's points; of the nearest feasible
            wrench where the requested one is not [N].
        reached: (k,) bool, the cables give the wrench within their limits.
        rated: (k,) bool, it is within the sensor's range and the safety envelope.
        missed: (k,) distance to the nearest feasible wrench, torque counted as force at the
            platform's radius [N].
    """

    program: LoadProgram
    tension: FloatArray
    reached: BoolArray
    rated: BoolArray
    missed: FloatArray

    @property
    def feasible(self) -> bool:
        """Whether the whole programme can be applied here."""
        return bool(self.reached.all() and self.rated.all())

    @property
    def worst(self) -> int | None:
        """Index of the point farthest from the feasible wrenches; None if all are feasible."""
        if self.feasible:
            return None
        if not self.reached.all():
            return int(np.argmax(self.missed))
        return int(np.argmin(self.rated))

    def sentence(self) -> str:
        """Return the finding in words, for an operator."""
        name, duration = self.program.name, self.program.duration
        if self.worst is None:
            return (
                f"{name}: {duration:g} s, feasible at this pose, tensions "
                f"{self.tension.min():.0f} to {self.tension.max():.0f} N"
            )
        time_s = self.program.time[self.worst]
        if not self.reached.all():
            return (
                f"{name}: not feasible at this pose; {int((~self.reached).sum())} of "
                f"{self.reached.size} points, at {time_s:g} s the cables miss the wrench by "
                f"{self.missed[self.worst]:.0f} N"
            )
        asked = np.array2string(self.program.wrench[self.worst], precision=1)
        return (
            f"{name}: beyond the sensor's range or the safety envelope at {time_s:g} s, or too "
            f"fast for the motors to follow or to be stopped before: {asked} N, N m"
        )

    def preview(self) -> IntArray:
        """Indices of at most about PREVIEW_POINTS points, the worst among them."""
        step = max(1, -(-self.program.time.size // PREVIEW_POINTS))
        chosen = {*range(0, self.program.time.size, step), self.program.time.size - 1}
        if self.worst is not None:
            chosen.add(self.worst)
        return np.array(sorted(chosen), dtype=np.int64)


def check_program(
    rig: Rig, program: LoadProgram, position: FloatArray, rotation: FloatArray
) -> ProgramCheck:
    """Compare a programme with the limits at which the bridge would end it, at one pose.

    They are those of control, the sensor's range and the safety envelope, with a margin for
    overshoot and noise (Rig.plannable).

    The wrenches that tensions within limits give form a convex set: between two points that are
    feasible, the straight line is feasible too, so the points decide about the whole programme.

    Args:
        rig: geometry, limits.
        program: to check.
        position: (3,) platform's origin in the base frame [m].
        rotation: (3, 3) from platform to base axes.

    Returns:
        The check, point by point.

    Raises:
        ShapeError: if the pose has another shape or is not finite.
    """
    matrix = structure_matrix(rig.geometry, position, rotation)
    limits = rig.plannable
    resolver = TensionResolver(matrix, rig.control.tension_min, limits.tension_max)
    wanted = program.wrench + rig.borne(rotation)
    tension, status = resolver.solve_batch(wanted)
    residual = tension @ matrix.T - wanted
    # The sensor turns with the platform: its ranges are along the platform's axes.
    local = np.hstack([program.wrench[:, :3] @ rotation, program.wrench[:, 3:] @ rotation])
    return ProgramCheck(
        program=program,
        tension=tension,
        reached=status == FEASIBLE,
        rated=np.array((np.abs(local) <= limits.wrench_max).all(axis=1)),
        missed=np.linalg.norm(residual * np.asarray(DEFAULT_WEIGHTS), axis=1),
    )


def check_shaped(
    rig: Rig, shaped: ShapedProgram, position: FloatArray, rotation: FloatArray
) -> ProgramCheck:
    """Check what the platform will feel, and what the cables are asked for on the way.

    The bridge's limits hold for what will be reached before the motors can be stopped, and for how
    long a motor may be at its current limit: so must what the platform will feel.

    Args:
        rig: geometry, limits, gains.
        shaped: programme as it is followed.
        position: (3,) platform's origin in the base frame [m].
        rotation: (3, 3) from platform to base axes.

    Returns:
        Check of the smoothed programme; `reached` is False also where the cables cannot give the
        control signal that a preview takes, `rated` where the motors cannot follow or be stopped.

    Raises:
        ShapeError: if the pose has another shape or is not finite.
    """
    found = check_program(rig, shaped.smoothed, position, rotation)
    pose = position, rotation
    if shaped.reference is shaped.smoothed:
        if not (found.feasible and found.program.duration <= LONGEST_S):
            return found
        felt = designed_response(shaped.smoothed, rig.control)
        on_the_way = check_program(rig, felt, *pose)
        within = on_the_way.reached & on_the_way.rated & _can_be_stopped(rig, on_the_way, *pose)
        # The points of the programme stand for the time up to the next one.
        late = np.searchsorted(found.program.time, felt.time[~within], side="right") - 1
        rated = found.rated.copy()
        rated[np.clip(late, 0, rated.size - 1)] = False
        return replace(found, rated=rated)
    asked = check_program(rig, shaped.control(rig.gains), position, rotation)
    return replace(
        found,
        reached=found.reached & asked.reached,
        rated=found.rated & _can_be_stopped(rig, found, *pose),
        missed=np.maximum(found.missed, asked.missed),
    )


def _can_be_stopped(
    rig: Rig, found: ProgramCheck, position: FloatArray, rotation: FloatArray
) -> BoolArray:
    """(k,) bool, whether the motors follow, and can be stopped before the envelope's limits.

    Args:
        rig: geometry, limbs, envelope.
        found: of a programme with a point per millisecond.
        position: (3,) platform's origin in the base frame [m].
        rotation: (3, 3) from platform to base axes.
    """
    current = saturating_current(rig, found.tension)
    within = np.asarray(current <= CURRENT_SHARE * rig.control.current_limit)
    if rig.envelope is None:
        return within
    gained = GAIN_SHARE * gained_until_stopped(rig, found.tension)
    added = gained @ structure_matrix(rig.geometry, position, rotation).T
    wrench = found.program.wrench + added
    local = np.hstack([wrench[:, :3] @ rotation, wrench[:, 3:] @ rotation])
    tension = (found.tension + gained).max(axis=1)
    within &= tension <= MOVING_SHARE * rig.envelope.tension_max
    within &= (np.abs(local) <= MOVING_SHARE * rig.envelope.wrench_max).all(axis=1)
    return within
