# SPDX-License-Identifier: Apache-2.0
"""Wiring and scaling between the card's volts and counts and the rig's units."""

from __future__ import annotations

from dataclasses import field
from functools import cached_property
from hashlib import sha256
from pathlib import Path

import numpy as np
from pydantic.dataclasses import dataclass

from cabols_control.checks import FloatArray, finite_array, in_range, rotation_matrix
from cabols_control.configuration import STRICT, beside, load_config
from cabols_control.errors import ConfigError
from cabols_control.frames import FRAMES, load_frames
from cabols_control.rig_folder import RigFolder, find_rig, rig_file
from cabols_hw.card.wiring import Wiring
from cabols_hw.force_torque.ati import (
    CONVERTER_VOLTS,
    DELTA_LIMITS,
    SATURATED_SHARE,
    read_calibration,
    wrench_transform,
)

ENCODER_MODULUS = 1 << 24
"""The Q8's counters have 24 bits."""


@dataclass(frozen=True, config=STRICT)
class CardConfig:
    """How the card is wired, and what the force/torque sensor on it measures.

    Attributes:
        counts_per_metre: encoder counts per metre of wound cable, signed.
        amperes_per_volt: amplifier gain, signed.
        ft_calibration: (6, 6) wrench [N, N m] per gauge volt, sensor axes; or
        ft_calibration_file: the sensor's .cal file, relative to this file; exactly one of the two.
        ft_calibration_part: part number of the calibration, where that file has several.
        sensor_serial: serial number of a sensor without a .cal file; empty: made of its matrix.
        output_limit: largest output [V].
        current_rate_limit: how fast a current may grow [A/s]; 0 for no limit. Never delays one
            that falls.
        switch_active_low: True if a closed limit switch pulls its line low. A file without it
            means True, as ever; a new rig's file says false, where a broken wire pays out.
        tare_samples: samples averaged for the sensor's bias after start, cables slack.
        watchdog: age of the newest motor current that zeroes the outputs [s].
        period: sampling period [s].
        sensor_position: (3,) sensor's origin, from the platform's, platform axes [m].
        sensor_rotation: (3, 3) from sensor to platform axes.
        tool_mass: of all that hangs on the sensor: platform and tool [kg].
        tool_centre_of_mass: (3,) its centre of mass, from the platform's origin, platform axes [m].
        wrench_limit: (6,) range of the sensor, sensor axes [N, N m]; None for the file's, or an
            ATI Delta's.
        wiring: channels.
    """

    counts_per_metre: float
    amperes_per_volt: float
    ft_calibration: list[list[float]] | None = None
    ft_calibration_file: str | None = None
    output_limit: float = 10.0
    current_rate_limit: float = 600.0
    switch_active_low: bool = True
    tare_samples: int = 200
    watchdog: float = 0.010
    period: float = 0.001
    sensor_position: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    sensor_rotation: list[list[float]] = field(default_factory=lambda: np.eye(3).tolist())
    tool_mass: float = 0.0
    tool_centre_of_mass: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    wrench_limit: list[float] | None = None
    wiring: Wiring = field(default_factory=Wiring)
    sensor_serial: str = ""
    ft_calibration_part: str | None = None

    def __post_init__(self) -> None:
        """Check ranges and that the calibration can be inverted."""
        in_range("abs(counts_per_metre)", abs(self.counts_per_metre), 1.0, 1e9)
        in_range("abs(amperes_per_volt)", abs(self.amperes_per_volt), 1e-6, 1e3)
        in_range("output_limit", self.output_limit, 0.1, 10.0)
        in_range("current_rate_limit", self.current_rate_limit, 0.0, 1e6)
        in_range("tare_samples", self.tare_samples, 1, 100_000)
        in_range("period", self.period, 1e-4, 0.1)
        in_range("watchdog", self.watchdog, 2.0 * self.period, 0.1)
        in_range("tool_mass", self.tool_mass, 0.0, 1000.0)
        finite_array("sensor_position", self.sensor_position, (3,))
        finite_array("tool_centre_of_mass", self.tool_centre_of_mass, (3,))
        rotation_matrix("sensor_rotation", self.sensor_rotation)
        if (self.ft_calibration is None) == (self.ft_calibration_file is None):
            raise ConfigError(
                "ft_calibration, ft_calibration_file: expected exactly one of the two, got "
                + ("none" if self.ft_calibration is None else "both")
            )
        if not self.sensor_serial and self.ft_calibration is not None:
            digest = sha256(np.array(self.ft_calibration, dtype=np.float64).tobytes())
            object.__setattr__(self, "sensor_serial", f"matrix-{digest.hexdigest()[:12]}")
        # Read now, while the folder of a relative path is known; kept.
        matrix, limits = self.ft_matrix, self.sensor_limits
        if not np.linalg.cond(matrix) < 1e6:
            raise ConfigError("ft_calibration: expected an invertible matrix, got a singular one")
        for limit in limits:
            in_range("wrench_limit", limit, 1e-6, 1e6)

    @cached_property
    def _calibration(self) -> tuple[FloatArray, FloatArray, float]:
        limits, volts = np.array(DELTA_LIMITS), SATURATED_SHARE * CONVERTER_VOLTS
        if self.ft_calibration_file is not None:
            path = beside(self.ft_calibration_file)
            object.__setattr__(self, "ft_calibration_file", str(path))
            calibration = read_calibration(path, self.ft_calibration_part)
            matrix, limits = calibration.matrix, calibration.limits
            object.__setattr__(self, "sensor_serial", self.sensor_serial or calibration.serial)
            volts = calibration.saturated_volts
        else:
            matrix = finite_array("ft_calibration", self.ft_calibration or [], (6, 6))
        if self.wrench_limit is not None:
            limits = finite_array("wrench_limit", self.wrench_limit, (6,))
        return matrix, limits, volts

    @cached_property
    def ft_matrix(self) -> FloatArray:
        """(6, 6) wrench per gauge volt, sensor axes, at the sensor's origin [N/V, N m/V]."""
        matrix, _, _ = self._calibration
        return matrix

    @cached_property
    def sensor_limits(self) -> FloatArray:
        """(6,) range of the sensor, sensor axes [N, N m]."""
        _, limits, _ = self._calibration
        return limits

    @cached_property
    def saturated_volts(self) -> float:
        """Largest valid voltage of a gauge; beyond it, it is saturated [V]."""
        _, _, volts = self._calibration
        return volts

    @cached_property
    def sensor_transform(self) -> FloatArray:
        """(6, 6) from a wrench at the sensor's origin to the same one at the platform's."""
        return wrench_transform(self.sensor_position, self.sensor_rotation)

    @cached_property
    def platform_matrix(self) -> FloatArray:
        """(6, 6) wrench per gauge volt, platform axes, at the platform's origin [N/V, N m/V]."""
        return np.ascontiguousarray(self.sensor_transform @ self.ft_matrix)


def load_card(rig: str | Path | RigFolder = "", path: str | Path | None = None) -> CardConfig:
    """Read a rig's card.

    Args:
        rig: name or folder, see find_rig; empty: the reference bench.
        path: YAML in place of the folder's card.yaml; None or empty: the folder's.

    Raises:
        ConfigError: naming the file, the key, what was expected and what came.
    """
    folder = find_rig(rig)
    shared = load_frames(folder).for_card()
    return load_config(CardConfig, rig_file("card.yaml", path, folder), shared, FRAMES)
