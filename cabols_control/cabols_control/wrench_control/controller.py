# SPDX-License-Identifier: Apache-2.0
"""The wrench controller's processing of a sample: setpoints, law, limits, staleness; pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cabols_control.cable_kernels import structure_matrix_into
from cabols_control.checks import FloatArray
from cabols_control.compiling import njit
from cabols_control.poses.track import (
    hear_pose,
    place_platform,
    pose_ahead_into,
    pose_track,
)
from cabols_control.rig import ControlConfig, Rig
from cabols_control.supervision.clock import clock_fault
from cabols_control.supervision.faults import Fault, FaultName
from cabols_control.supervision.modes import OperatingMode
from cabols_control.tension import DEFAULT_WEIGHTS, prepare_pose, set_method, work_size
from cabols_control.tension.kernels.work_array import SHARE
from cabols_control.wrench_control.frames import place_frame, wrench_to_base
from cabols_control.wrench_control.law import WrenchLaw
from cabols_control.wrench_control.tension_setpoint import DesiredTension, TensionReference

LONGEST_STEP_S = 0.010
REASONABLE = 10.0
"""Desired wrench in rated ones beyond which it is a mistake, not a load."""
MAX_BAD_SAMPLES = 5
"""Most unusable wrench samples in a row before the load is given up."""


@dataclass(frozen=True, eq=False)
class DesiredWrench:
    """Newest desired wrench: (6,) [N, N m] and stamp.

    Attributes:
        stamp_s: of the sample at which it came [s].
        wrench: (6,) on the platform.
        frame: (1,) record of WRENCH_FRAME that it is in, moved with the platform at each sample;
            None: on the platform at its origin, base axes.
    """

    stamp_s: float
    wrench: FloatArray
    frame: Any = None


@njit(cache=True)
def _take_into(wrench: FloatArray, most: FloatArray, desired: FloatArray) -> bool:
    """Copy a wrench (6,) to desired (6,) unless a component is larger than most (6,), or NaN."""
    for k in range(6):
        if not abs(wrench[k]) <= most[k]:
            return False
    for k in range(6):
        desired[k] = wrench[k]
    return True


@njit(cache=True)
def _turn_into(rotation: FloatArray, wrench: FloatArray, turned: FloatArray) -> None:
    """Rotate force and torque (6,) by rotation (3, 3)."""
    for axis in range(3):
        turned[axis] = turned[3 + axis] = 0.0
        for k in range(3):
            turned[axis] += rotation[axis, k] * wrench[k]
            turned[3 + axis] += rotation[axis, k] * wrench[3 + k]


class WrenchController:
    """Pure core of the wrench_controller node.

    Attributes:
        tension: (n,) newest output [N].
        desired: (6,) desired wrench in force [N, N m].
        active: whether a load is commanded.
        feasible: whether the newest control was feasible.
        infeasible_cycles: how many were not.
        fault: why no load is commanded in LOADING; None without one.
        notice: what does not stop the load but should be known; None otherwise.
    """

    def __init__(self, rig: Rig) -> None:
        """Start inactive at the reference pose."""
        self._rig = rig
        n = rig.geometry.cables
        control = rig.control
        self._law = WrenchLaw(rig.gains.proportional, rig.gains.integral, n)
        self._limits = (np.full(n, control.tension_min), np.full(n, control.tension_max))
        self._weights = np.array(DEFAULT_WEIGHTS)
        self._work = np.zeros(work_size(n))
        set_method(self._work, n, control.tension_method, control.tension_exponent, share=0.0)
        self._cables = rig.geometry.records()
        self._matrix = np.zeros((6, n))
        # Own copies of the pose: read-only arrays would need other compiled code.
        self._position, self._rotation = np.zeros(3), np.eye(3)
        self._moved, self._reference = np.zeros(6), np.zeros(6)
        self._ahead_s = _delay_of(control)
        self._ahead = np.zeros(3), np.eye(3)
        self._reasonable = REASONABLE * rig.control.rated
        self._usable = np.zeros(6)
        self._unload_step = np.repeat(control.unload_rates, 3)
        self._desired_timeout = control.desired_timeout
        self._tensions = TensionReference(rig)
        self._last_stamp = -np.inf
        self._bad_samples = 0
        self.tension = np.zeros(n)
        self.desired = np.zeros(6)
        self.active = False
        self.feasible = True
        self.infeasible_cycles = 0
        self.fault: Fault | None = None
        self.notice: Fault | None = None
        geometry = rig.geometry
        self.set_pose(geometry.reference_position, geometry.reference_rotation)

    @property
    def control(self) -> FloatArray:
        """(6,) newest u of (3.17) [N, N m]; a view."""
        return self._law.control

    @property
    def residual(self) -> FloatArray:
        """(6,) wrench of tension minus control [N, N m]; a view."""
        return self._law.residual

    @property
    def pose(self) -> tuple[FloatArray, FloatArray]:
        """Platform's position (3,) [m] and rotation (3, 3) at the newest sample; views."""
        return self._position, self._rotation

    @property
    def acceleration(self) -> FloatArray:
        """(3,) of the platform's origin at the newest sample, base axes [m/s^2]; a view."""
        found: FloatArray = self._track[0]["acceleration"][:3]
        return found

    def set_pose(self, position: FloatArray, rotation: FloatArray) -> None:
        """Take the platform's pose, (3,) [m] and (3, 3), base frame; costs one decomposition.

        Args:
            position: (3,) of the platform's origin, base frame [m].
            rotation: (3, 3) from platform to base axes.
        """
        control = self._rig.control
        self._track = pose_track(position, rotation, control.pose_lag, control.pose_horizon)
        self._use_pose()

    def hear_pose(self, stamp_s: float, position: FloatArray, rotation: FloatArray) -> None:
        """Take a pose of a moment; the next samples use it, extrapolated over its age.

        Args:
            stamp_s: of the pose, on the samples' clock [s].
            position: (3,) of the platform's origin, base frame [m].
            rotation: (3, 3) from platform to base axes.
        """
        hear_pose(self._track, stamp_s, position, rotation)

    def place(self, now_s: float) -> None:
        """Move the platform to where it is at a sample; costs a decomposition where it moves.

        Args:
            now_s: of the sample [s].
        """
        if place_platform(self._track, now_s):
            self._use_pose()

    def _use_pose(self) -> None:
        track = self._track[0]
        self._position[:], self._rotation[:] = track["place"], track["turn"]
        structure_matrix_into(self._cables, self._position, self._rotation, self._matrix)
        prepare_pose(self._matrix, *self._limits, self._weights, self._work)

    def trip(self, fault: Fault) -> None:
        """Give the load up for a fault from outside; the first fault stays until LOADING ends."""
        self.fault = self.fault or fault

    def to_base_axes(self, wrench: FloatArray) -> FloatArray:
        """Turn a wrench at the platform's origin from platform to base axes; (6,) to (6,)."""
        turned = np.empty(6)
        _turn_into(self._rotation, wrench, turned)
        return turned

    def step(
        self,
        stamp_s: float,
        measured: FloatArray,
        mode: OperatingMode,
        setpoint: DesiredWrench | None,
        tensions: DesiredTension | None = None,
    ) -> FloatArray:
        """Answer one wrench sample.

        Args:
            stamp_s: when it was measured [s].
            measured: (6,) on the platform, at its origin, base axes [N, N m].
            mode: operating mode.
            setpoint: newest desired wrench; None before the first: zero.
            tensions: newest desired tensions; while they are fresh they go before the wrench.

        Returns:
            (n,) tension within the limits [N]; meaningful only where `active`. The same array
            at every call.
        """
        dt_s = stamp_s - self._last_stamp
        if back := clock_fault("wrench", dt_s):
            self.trip(back)
        elif not dt_s > 0.0:
            return self.tension
        self._last_stamp = stamp_s
        usable = _take_into(measured, self._reasonable, self._usable)
        self._bad_samples = 0 if usable else self._bad_samples + 1
        if mode != OperatingMode.LOADING:
            self._rest()
            return self.tension
        if self._bad_samples > MAX_BAD_SAMPLES and self.fault is None:
            reason = (
                f"wrench: {self._bad_samples} samples in a row are not finite, or beyond "
                f"{REASONABLE:g} times the rated wrench"
            )
            self.fault = Fault(FaultName.NOT_FINITE, reason)
        if self.fault is not None:
            self.active = False
            return self.tension
        if not usable:
            return self.tension
        if self._command_tensions(stamp_s, min(dt_s, LONGEST_STEP_S), tensions):
            return self.tension
        self._follow(stamp_s, min(dt_s, LONGEST_STEP_S), setpoint)
        if not self.active or dt_s > LONGEST_STEP_S:
            start = measured if not self.active else self._law.control.copy()
            self._law.reset(start, self.desired, measured)
            if not self.active:
                self._work[SHARE] = 0.0
            self.active = True
        self._fade(min(dt_s, LONGEST_STEP_S))
        status = self._law.step(self._reference, measured, min(dt_s, LONGEST_STEP_S), self._work)
        self.feasible = status == 0
        self.infeasible_cycles += status == 1
        self.tension[:] = self._law.tension
        return self.tension

    def _fade(self, dt_s: float) -> None:
        """Go from the minimum norm, which is near the pre-tension, to the method's tensions.

        At once would be a step of tens of newtons in every cable.
        """
        share = self._work[SHARE] + dt_s / self._rig.control.tension_fade
        self._work[SHARE] = min(share, 1.0)

    def _command_tensions(
        self, stamp_s: float, dt_s: float, setpoint: DesiredTension | None
    ) -> bool:
        """Command tensions instead of a wrench, if there are tension setpoints (section 4.3)."""
        reference = self._tensions
        led = reference.active
        present = self.tension if self.active and not led else None
        if not reference.step(stamp_s, dt_s, setpoint, present):
            # The wrench law continues from the sensor's wrench, as at the start of a load.
            self.active = self.active and not led
            return False
        self.tension[:] = reference.tension
        np.matmul(self._matrix, reference.tension, out=self.control)
        self.desired[:] = self.control
        self.residual[:] = 0.0
        self.active, self.feasible = True, not reference.limited
        self.infeasible_cycles += reference.limited
        self.notice = None
        if reference.stale:
            reason = f"desired_tension is older than {self._desired_timeout:g} s: unloading"
            self.notice = Fault(FaultName.DESIRED_AGE, reason)
        return True

    def _rest(self) -> None:
        self._tensions.reset()
        self.active = False
        self.fault = self.notice = None
        self.desired[:] = 0.0
        self.control[:] = 0.0
        self.residual[:] = 0.0
        self.tension[:] = 0.0
        self.feasible = True

    def _follow(self, stamp_s: float, dt_s: float, setpoint: DesiredWrench | None) -> None:
        """Set the desired wrench in force; a stale one is ramped to zero at the unload rate."""
        if setpoint is not None and abs(stamp_s - setpoint.stamp_s) <= self._desired_timeout:
            taken = self._take(setpoint)
        else:
            self._let_go(dt_s, setpoint)
            taken = False
        self._reference[:] = self.desired
        # Only a wrench that is in force is led: a stale or refused one commands nothing.
        if taken and setpoint is not None and setpoint.frame is not None:
            self._lead(setpoint)

    def _take(self, setpoint: DesiredWrench) -> bool:
        """Set the desired wrench in force; False if it is refused."""
        self.notice = None
        if not _take_into(self._in_base(setpoint), self._reasonable, self.desired):
            self.notice = Fault(
                FaultName.DESIRED,
                f"desired_wrench: expected at most {REASONABLE:g} times the rated wrench, got "
                f"{np.asarray(setpoint.wrench).tolist()}; the one before stays in force",
            )
        return self.notice is None

    def _let_go(self, dt_s: float, setpoint: DesiredWrench | None) -> None:
        """Ramp the desired wrench to zero, as there is no fresh one."""
        if setpoint is not None and self.desired.any():
            self.notice = Fault(
                FaultName.DESIRED_AGE,
                f"desired_wrench is older than {self._desired_timeout:g} s: unloading to zero",
            )
        step = self._unload_step * dt_s
        self.desired -= np.clip(self.desired, -step, step)

    def _in_base(self, setpoint: DesiredWrench) -> FloatArray:
        """(6,) desired wrench about the platform's origin, base axes, at the present pose."""
        if setpoint.frame is None:
            return setpoint.wrench
        place_frame(setpoint.frame, self._position, self._rotation)
        wrench_to_base(setpoint.frame, setpoint.wrench, self._moved)
        return self._moved

    def _lead(self, setpoint: DesiredWrench) -> None:
        """Let the reference be of the frame where it will be once the wrench is felt.

        A wrench that turns with the platform would else be felt where the platform was.
        """
        pose_ahead_into(self._track, self._ahead_s, *self._ahead)
        place_frame(setpoint.frame, *self._ahead)
        wrench_to_base(setpoint.frame, setpoint.wrench, self._reference)
        place_frame(setpoint.frame, self._position, self._rotation)


def _delay_of(control: ControlConfig) -> float:
    """Delay of the wrench loop's designed response at low frequencies [s]."""
    poles = float(np.sum(1.0 / np.abs(control.poles)))
    return poles - 1.0 / abs(control.zero) + control.preview_delay
