"""What the bridge does with each sample and each command; pure, without card, clock or ROS."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cabols_control.checks import BoolArray, FloatArray
from cabols_control.kinematics import cable_lengths_into
from cabols_control.modes import OperatingMode
from cabols_control.rig import Rig
from cabols_hw.card_config import CardConfig
from cabols_hw.daq import CardSample
from cabols_hw.scaling import limbs_into, volts_into, wrench_into

SATURATED_VOLTS = 9.98
"""A gauge beyond this stands at the converter's end: the wrench cannot be trusted."""


class Bridge:
    """Samples to limb states and wrenches, currents to volts.

    Attributes:
        wound_length: (n,) [m] since start.
        elongation: (n,) [m] above the pre-tightened zero, NaN before.
        tension: (n,) estimate [N] (3.9), NaN before zeroing.
        switch_closed: (n,) bool.
        zeroed: (n,) bool.
        wrench: (6,) on the platform, at its origin, platform axes [N, N m].
        tared: whether the sensor's bias is known.
        saturated_gauge: whether the newest sample had a gauge at its end.
    """

    def __init__(self, rig: Rig, card: CardConfig) -> None:
        """Start unzeroed and untared at the reference pose."""
        n = rig.geometry.cables
        self._rig = rig
        self._card = card
        self._stiffness = rig.limbs.stiffness
        self._switch_elongation = rig.limbs.switch_tension / rig.limbs.stiffness
        self._raw = np.zeros(n, dtype=np.int64)
        self._counts = np.zeros(n, dtype=np.int64)
        self._started = False
        self._mode = OperatingMode.STOPPED
        self._length = np.zeros(n)
        self._zero = np.full(n, np.nan)
        self._was_closed: BoolArray = np.ones(n, dtype=np.bool_)
        self._bias = np.zeros(6)
        self._bias_sum = np.zeros(6)
        self._bias_count = 0
        self._volts = np.zeros(n)
        self.wound_length = np.zeros(n)
        self.elongation = np.full(n, np.nan)
        self.tension = np.full(n, np.nan)
        self.switch_closed: BoolArray = np.zeros(n, dtype=np.bool_)
        self.zeroed: BoolArray = np.zeros(n, dtype=np.bool_)
        self.wrench = np.zeros(6)
        self.tared = False
        self.saturated_gauge = False
        self.set_pose(rig.geometry.reference_position, rig.geometry.reference_rotation)

    def set_pose(self, position: FloatArray, rotation: FloatArray) -> None:
        """Take the platform's pose, (3,) [m] and (3, 3), base frame."""
        geometry = self._rig.geometry
        cable_lengths_into(
            geometry.base_points, geometry.platform_points, position, rotation, self._length
        )

    @property
    def current(self) -> FloatArray:
        """(n,) currents that the newest volts() stand for [A]."""
        return self._volts * self._card.amperes_per_volt

    def tare(self) -> None:
        """Average the next samples as the sensor's bias."""
        self._bias_sum[:] = 0.0
        self._bias_count = 0
        self.tared = False

    def take(self, sample: CardSample, mode: OperatingMode) -> None:
        """Update all attributes from one sample.

        In PRETIGHTENING the sample at which a limb's switch closes (from open) sets its zero: there
        the tension is the switch's 4.7 N, so that elongation counts from the unloaded spring.
        Whenever the mode becomes PRETIGHTENING all zeros are forgotten, to be set anew.
        """
        card = self._card
        if mode == OperatingMode.PRETIGHTENING and self._mode != mode:
            self._zero[:] = np.nan
            self.zeroed[:] = False
        self._mode = mode
        if not self._started:
            self._raw[:] = sample.encoders
            self._started = True
        np.not_equal(sample.digital, card.switch_active_low, out=self.switch_closed)
        limbs_into(
            sample.encoders,
            self._raw,
            self._counts,
            card.counts_per_metre,
            self._length,
            self.switch_closed,
            self._was_closed,
            mode == OperatingMode.PRETIGHTENING,
            self._switch_elongation,
            self._stiffness,
            self._zero,
            self.zeroed,
            self.wound_length,
            self.elongation,
            self.tension,
        )
        if not self.tared:
            self._average_bias(sample.analog)
        self.saturated_gauge = wrench_into(
            card.ft_matrix, sample.analog, self._bias, SATURATED_VOLTS, self.wrench
        )

    def _average_bias(self, volts: FloatArray) -> None:
        if not np.abs(volts).max() <= SATURATED_VOLTS:
            return
        self._bias_sum += volts
        self._bias_count += 1
        np.divide(self._bias_sum, self._bias_count, out=self._bias)
        self.tared = self._bias_count >= self._card.tare_samples

    def bind(self, arrays: Mapping[str, Any]) -> None:
        """Let results be written straight into other arrays, e.g. those of a message.

        Args:
            arrays: by attribute name, of the attribute's shape and type.
        """
        for name, array in arrays.items():
            array[:] = getattr(self, name)
            setattr(self, name, array)

    def volts(self, current: FloatArray) -> FloatArray:
        """Amplifier inputs for (n,) currents [A], limited to what the rig's configuration allows.

        NaN becomes zero. The same array at every call.
        """
        limit = self._rig.control.current_limit
        volts_into(
            current, limit, self._card.amperes_per_volt, self._card.output_limit, self._volts
        )
        return self._volts
