"""Wiring and scaling between the card's volts and counts and the rig's units."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from pydantic.dataclasses import dataclass

from cabols_control.checks import FloatArray, finite_array, in_range
from cabols_control.configuration import STRICT
from cabols_control.errors import ConfigError

ENCODER_MODULUS = 1 << 24
"""The Q8's counters have 24 bits."""


@dataclass(frozen=True, config=STRICT)
class CardConfig:
    """How the card is wired.

    Attributes:
        counts_per_metre: encoder counts per metre of wound cable, signed.
        amperes_per_volt: amplifier gain, signed.
        output_limit: largest output [V].
        switch_active_low: True if a closed limit switch pulls its line low.
        ft_calibration: (6, 6) wrench [N, N m] per gauge volt, sensor axes.
        tare_samples: samples averaged for the sensor's bias after start, cables slack.
        watchdog: age of the newest motor current that zeroes the outputs [s].
        period: sampling period [s].
    """

    counts_per_metre: float
    amperes_per_volt: float
    ft_calibration: list[list[float]]
    output_limit: float = 10.0
    switch_active_low: bool = True
    tare_samples: int = 200
    watchdog: float = 0.010
    period: float = 0.001

    def __post_init__(self) -> None:
        """Check ranges and that the calibration can be inverted."""
        in_range("abs(counts_per_metre)", abs(self.counts_per_metre), 1.0, 1e9)
        in_range("abs(amperes_per_volt)", abs(self.amperes_per_volt), 1e-6, 1e3)
        in_range("output_limit", self.output_limit, 0.1, 10.0)
        in_range("tare_samples", self.tare_samples, 1, 100_000)
        in_range("period", self.period, 1e-4, 0.1)
        in_range("watchdog", self.watchdog, 2.0 * self.period, 0.1)
        matrix = finite_array("ft_calibration", self.ft_calibration, (6, 6))
        if not np.linalg.cond(matrix) < 1e6:
            raise ConfigError("ft_calibration: expected an invertible matrix, got a singular one")

    @cached_property
    def ft_matrix(self) -> FloatArray:
        """(6, 6) wrench per gauge volt, as an array."""
        return np.array(self.ft_calibration, dtype=np.float64)
