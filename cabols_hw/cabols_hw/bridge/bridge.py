# SPDX-License-Identifier: Apache-2.0
"""The bridge's processing of samples and commands; pure, without card, clock or ROS."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np

from cabols_control.cable_kernels import cable_lengths_into, structure_matrix_into
from cabols_control.checks import BoolArray, FloatArray
from cabols_control.poses.track import hear_pose, pose_track
from cabols_control.rig import Rig
from cabols_control.supervision.modes import OperatingMode
from cabols_hw.bridge.placing import place_cables_into
from cabols_hw.bridge.scaling import (
    SENSOR_READING,
    limb_reading_work,
    limbs_into,
    loaded_wrench_into,
    volts_into,
)
from cabols_hw.bridge.tare import SensorTare
from cabols_hw.card.config import CardConfig
from cabols_hw.card.daq import CardSample
from cabols_hw.force_torque.ati import AXES
from cabols_hw.force_torque.sensor_bias import SensorBias
from cabols_hw.force_torque.tool_weight import tool_weight_into

WAITING_POSES = 16
"""Most poses that wait for a sample; the oldest are dropped."""


class Bridge:
    """Turns samples into limb states and wrenches, and currents into volts.

    Attributes:
        wound_length: (n,) [m] since start.
        elongation: (n,) [m] above the pre-tightened zero, NaN before.
        tension: (n,) estimate [N] (3.9), NaN before zeroing.
        switch_closed: (n,) bool.
        zeroed: (n,) bool.
        zeroing: (1,) number of the pre-tightening that the zeros are of; 0: of none.
        followed_mode: (1,) number of the mode in which the newest sample was taken.
        wrench: (6,) on the platform, at its origin, platform axes, without weight and inertia of
            the tool in the platform's present orientation and motion [N, N m].
        load: (6,) whole load of the sensor, at its origin, sensor axes [N, N m].
        tared: whether the sensor's bias is known.
        sensor_tare: which bias is in force, and why none is.
        saturated_gauge: whether the newest sample had a gauge at its end.
        saturated_volts: largest valid voltage of a gauge; beyond it the wrench is invalid [V].
        saturation: saturated gauge or axis of load of the newest sample, in words; empty for none.
        gauges: (6,) newest gauge voltages [V].
        rotation: (3, 3) platform to base, extrapolated to the newest sample.
        structure: (6, n) structure matrix, likewise.
        cable_speed: (n,) at which the platform's motion lengthens the cables [m/s].
        cable_acceleration: (n,) likewise [m/s^2].
    """

    def __init__(self, rig: Rig, card: CardConfig, closings: int = 1) -> None:
        """Start unzeroed and untared at the reference pose.

        Args:
            rig: whose samples come.
            card: that gives them.
            closings: of a switch before one sets its limb's zero; see scaling.CLOSINGS.
        """
        n = rig.geometry.cables
        self._rig = rig
        self._card = card
        self._cables = rig.geometry.records()
        self._work = limb_reading_work(n)
        self._work["counts_per_metre"] = card.counts_per_metre
        self._work["wanted_closings"] = closings
        self._work["switch_tension"] = rig.limbs.switch_tension
        limbs, springs = self._work["limbs"][0], rig.springs
        limbs["stiffness"] = springs.nominal
        limbs["switch_elongation"] = rig.limbs.switch_tension / springs.nominal
        limbs["compliance"], limbs["compliance_per_metre"] = springs.fixed, springs.per_metre
        self._started = False
        self._mode = OperatingMode.STOPPED
        self._zeroing = 0
        self._length = np.zeros(n)
        self._sensor = np.zeros(1, SENSOR_READING)
        self._sensor["matrix"], self._sensor["transform"] = card.ft_matrix, card.sensor_transform
        self._sensor["limits"] = card.sensor_limits
        self._sensor["volts_limit"] = card.saturated_volts
        self.saturated_volts = card.saturated_volts
        self._to_sensor = np.ascontiguousarray(np.linalg.inv(card.sensor_transform))
        self._centre_of_mass = np.array(card.tool_centre_of_mass)
        self._weight = np.zeros(6)
        self._limits = card.sensor_limits
        self._gauge = self._axis = -1
        self._volts = np.zeros(n)
        self._before = np.zeros(n)
        self._newest_ns = 0
        self._growth = self._growth_in(card.period)
        self.wound_length = np.zeros(n)
        self.elongation = np.full(n, np.nan)
        self.tension = np.full(n, np.nan)
        self.switch_closed: BoolArray = np.zeros(n, dtype=np.bool_)
        self.zeroed: BoolArray = np.zeros(n, dtype=np.bool_)
        self.zeroing = np.zeros(1, dtype=np.uint32)
        self.followed_mode = np.zeros(1, dtype=np.uint8)
        self.wrench = np.zeros(6)
        self.load = np.zeros(6)
        self.tared = False
        self.sensor_tare = SensorTare(
            card.sensor_serial,
            card.ft_matrix,
            card.sensor_limits,
            card.tare_samples,
        )
        self.gauges = np.zeros(6)
        self.rotation = np.eye(3)
        self.structure = np.zeros((6, n))
        self.cable_speed, self.cable_acceleration = np.zeros(n), np.zeros(n)
        # Poses come in another thread than samples: they wait here for the next sample.
        self._poses: deque[tuple[float, FloatArray, FloatArray]] = deque(maxlen=WAITING_POSES)
        self._carried = np.zeros(6)
        self._tool = (card.tool_mass, self._centre_of_mass, self._carried)
        self.set_pose(rig.geometry.reference_position, rig.geometry.reference_rotation)

    def set_pose(self, position: FloatArray, rotation: FloatArray) -> None:
        """Put the platform at a pose, (3,) [m] and (3, 3), base frame, at rest as far as is known.

        Args:
            position: (3,) of the platform's origin, base frame [m].
            rotation: (3, 3) from platform to base axes.
        """
        control = self._rig.control
        # Copies, because read-only arrays would need other compiled code. New arrays, because a
        # sample in progress must use the old ones or the new ones, not a mixture.
        position, rotation = np.array(position), np.array(rotation, order="C")
        cable_lengths_into(self._cables, position, rotation, self._length)
        structure, weight = np.zeros_like(self.structure), np.zeros(6)
        structure_matrix_into(self._cables, position, rotation, structure)
        self.structure = structure
        self.rotation = rotation
        tool_weight_into(*self._tool[:2], rotation, weight)
        self._weight = weight
        self._carried[:] = weight
        self.cable_speed[:] = self.cable_acceleration[:] = 0.0
        self._poses.clear()
        self._track = pose_track(position, rotation, control.pose_lag, control.pose_horizon)

    def hear_pose(self, stamp_s: float, position: FloatArray, rotation: FloatArray) -> None:
        """Take a pose of a moment; the next samples use it, extrapolated over its age.

        Args:
            stamp_s: of the pose, on the samples' clock [s].
            position: (3,) of the platform's origin, base frame [m].
            rotation: (3, 3) from platform to base axes.
        """
        self._poses.append((stamp_s, np.array(position), np.array(rotation, order="C")))

    def _place(self, now_s: float) -> None:
        """Move the platform to where it is at a sample."""
        while self._poses:
            hear_pose(self._track, *self._poses.popleft())
        cables = (
            self._cables,
            self._length,
            self.structure,
            self.cable_speed,
            self.cable_acceleration,
        )
        place_cables_into(self._track, now_s, cables, self._tool, self.rotation, self._weight)

    @property
    def _bias(self) -> FloatArray:
        """(6,) volts at the tare [V]; a view."""
        bias: FloatArray = self._sensor["bias"][0]
        return bias

    @property
    def _tare_weight(self) -> FloatArray:
        """(6,) tool's weight at the tare, sensor frame [N, N m]; a view."""
        weight: FloatArray = self._sensor["tare_weight"][0]
        return weight

    @property
    def saturated_gauge(self) -> bool:
        """Whether the newest sample had a gauge at its converter's end, or not a number."""
        return self._gauge >= 0

    @property
    def saturation(self) -> str:
        """Saturated gauge or axis of load of the newest sample, in words; empty for none."""
        if self._gauge >= 0:
            return f"gauge {self._gauge} is saturated or not a number"
        if self._axis < 0:
            return ""
        limit, unit = self._limits[self._axis], "N" if self._axis < 3 else "N m"
        return (
            f"{AXES[self._axis]} is {self.load[self._axis]:.4g} {unit}, beyond the sensor's "
            f"{limit:g} {unit}"
        )

    @property
    def count_length(self) -> float:
        """Length of one count of an encoder, at the cable [m]."""
        return 1.0 / self._card.counts_per_metre

    @property
    def limbs(self) -> Any:
        """(n,) records of LIMB_READING: what is remembered of each limb; a view."""
        return self._work["limbs"][0]

    @property
    def current(self) -> FloatArray:
        """(n,) currents that the newest volts() stand for [A]."""
        return self._volts * self._card.amperes_per_volt

    def tare(self) -> str:
        """Average the next samples as the sensor's bias; the tool's weight stays known.

        The bias before stays in force until the new one is accepted: see SensorTare.

        Returns:
            Why it is refused at once; empty if it is not.
        """
        return self.sensor_tare.begin(self._work["limbs"][0], self.switch_closed)

    def adopt_bias(self, bias: SensorBias) -> None:
        """Use a bias that was measured before the start.

        Args:
            bias: of this sensor.
        """
        self.sensor_tare.adopt(bias)
        self._use_bias()

    def _use_bias(self) -> None:
        """Put the bias in force, or none, where samples are converted."""
        bias = self.sensor_tare.bias
        self.tared = bias is not None
        self._bias[:] = 0.0 if bias is None else bias.volts
        self._tare_weight[:] = 0.0 if bias is None else bias.tare_weight

    def tare_load(self) -> FloatArray:
        """(6,) weight of the tool at the tare in force, platform axes; NaN without one [N, N m]."""
        if not self.tared:
            return np.full(6, np.nan)
        return np.asarray(self._sensor["transform"][0] @ self._tare_weight)

    def take(self, sample: CardSample, mode: OperatingMode, zeroing: int = 0) -> None:
        """Update all attributes from one sample.

        In PRETIGHTENING the sample at which a limb's switch closes (from open), the first time or
        a later one (`closings`), sets its zero: there the tension is the switch's 4.7 N, so that
        elongation counts from the unloaded spring.
        When the mode becomes PRETIGHTENING, or its number changes, all zeros are dropped.

        Args:
            sample: just read.
            mode: operating mode.
            zeroing: number of the newest pre-tightening, from Mode.
        """
        card = self._card
        if mode != self._mode or zeroing != self._zeroing:
            self._follow(mode, zeroing)
        if not self._started:
            self._work["limbs"]["previous_raw"] = sample.encoders
            self._newest_ns = sample.time_ns
            self._started = True
        else:
            self._growth = self._growth_in(1e-9 * (sample.time_ns - self._newest_ns))
            self._newest_ns = sample.time_ns
        self._place(1e-9 * sample.time_ns)
        self.gauges[:] = sample.analog
        np.multiply(self._volts, card.amperes_per_volt, out=self._before)
        np.not_equal(sample.digital, card.switch_active_low, out=self.switch_closed)
        limbs_into(
            sample.encoders,
            self.switch_closed,
            self._length,
            self._work,
            self.zeroed,
            self.wound_length,
            self.elongation,
            self.tension,
        )
        weight = self._weight
        if self.sensor_tare.measuring or self.sensor_tare.provisional:
            self._tare_sample(sample, weight)
        self._gauge, self._axis = loaded_wrench_into(
            self._sensor, sample.analog, self._carried, self.load, self.wrench
        )

    def _follow(self, mode: OperatingMode, zeroing: int) -> None:
        """Follow another mode; a new pre-tightening drops the zeros of the one before."""
        if mode == OperatingMode.PRETIGHTENING:
            self._work["limbs"]["zero"] = np.nan
            self._work["limbs"]["closings"] = 0
            self.zeroed[:] = False
            self.zeroing[0] = zeroing
        self._mode, self._zeroing = mode, zeroing
        self._work["sets_zeros"] = mode == OperatingMode.PRETIGHTENING
        self.followed_mode[0] = mode

    def _growth_in(self, duration_s: float) -> float:
        rate = self._card.current_rate_limit
        return rate * duration_s if rate > 0.0 else np.inf

    def _tare_sample(self, sample: CardSample, weight: FloatArray) -> None:
        """Let a tare go on, with a sample whose gauges are all within their range."""
        tare, limbs = self.sensor_tare, self._work["limbs"][0]
        if not tare.measuring:
            if self.zeroed.all() and tare.settle(limbs):
                self._use_bias()
            return
        if not np.abs(sample.analog).max() <= self.saturated_volts:
            return
        weight_on_sensor = self._to_sensor @ weight
        args = (sample.time_ns, sample.analog, weight_on_sensor, self.wound_length)
        if tare.sample(*args, limbs, self.switch_closed):
            self._use_bias()

    def bind(self, arrays: Mapping[str, Any]) -> None:
        """Write results directly into other arrays, e.g. those of a message.

        Args:
            arrays: by attribute name, of the attribute's shape and type.
        """
        for name, array in arrays.items():
            array[:] = getattr(self, name)
            setattr(self, name, array)

    def volts(self, current: FloatArray) -> FloatArray:
        """Return amplifier inputs [V] for (n,) currents [A], within the rig's limits.

        From sample to sample a current grows no faster than the card's current_rate_limit, however
        often this is called between two; it falls at once. NaN becomes zero. Every call returns
        the same array.
        """
        volts_into(
            current,
            self._rig.control.current_limit,
            self._before,
            self._growth,
            self._card.amperes_per_volt,
            self._card.output_limit,
            self._volts,
        )
        return self._volts
