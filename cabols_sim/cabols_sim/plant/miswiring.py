# SPDX-License-Identifier: Apache-2.0
"""A rig wired otherwise than its configuration says: exchanged, reversed and dead channels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from cabols_control.checks import BoolArray, FloatArray, IntArray
from cabols_control.errors import CabolsError

COUNTER = 1 << 24
"""The card's encoder counters have 24 bits."""
KINDS = (
    "motors_exchanged",
    "encoders_exchanged",
    "switches_exchanged",
    "channels_exchanged",
    "motor_reversed",
    "encoder_reversed",
    "both_reversed",
    "motor_dead",
    "encoder_dead",
    "gauges_exchanged",
    "gauges_reversed",
)
"""Kinds of faults that Miswiring.of makes, for a campaign of faults."""


@dataclass(frozen=True, eq=False)
class Miswiring:
    """Where each channel of the card really ends.

    Attributes:
        motors: limb whose motor gets the current meant for a limb, by limb.
        encoders: limb whose encoder is read for a limb, by limb.
        switches: limb whose switch is read for a limb, by limb.
        motor_signs: factor of a limb's current: -1 reversed, 0 dead; by limb.
        encoder_signs: likewise of a limb's counts.
        gauges: (6, 6) from the sensor's volts to those that are read; None: as they are.
    """

    motors: Mapping[int, int] = field(default_factory=dict)
    encoders: Mapping[int, int] = field(default_factory=dict)
    switches: Mapping[int, int] = field(default_factory=dict)
    motor_signs: Mapping[int, int] = field(default_factory=dict)
    encoder_signs: Mapping[int, int] = field(default_factory=dict)
    gauges: FloatArray | None = None

    @classmethod
    def of(cls, kind: str, limb: int, other: int) -> Miswiring:
        """Make one of KINDS.

        Args:
            kind: of the fault.
            limb: that has it, from 0.
            other: limb that it is exchanged with, where it is exchanged.

        Raises:
            CabolsError: for another kind.
        """
        swap = {limb: other, other: limb}
        exchanged = np.eye(6)[[3, 4, 5, 0, 1, 2]]
        made = {
            "motors_exchanged": {"motors": swap},
            "encoders_exchanged": {"encoders": swap},
            "switches_exchanged": {"switches": swap},
            "channels_exchanged": {"motors": swap, "encoders": swap, "switches": swap},
            "motor_reversed": {"motor_signs": {limb: -1}},
            "encoder_reversed": {"encoder_signs": {limb: -1}},
            "both_reversed": {"motor_signs": {limb: -1}, "encoder_signs": {limb: -1}},
            "motor_dead": {"motor_signs": {limb: 0}},
            "encoder_dead": {"encoder_signs": {limb: 0}},
            "gauges_exchanged": {"gauges": exchanged},
            "gauges_reversed": {"gauges": -np.eye(6)},
        }.get(kind)
        if made is None:
            raise CabolsError(f"kind: expected one of {', '.join(KINDS)}, got {kind!r}")
        return cls(**made)  # type: ignore[arg-type]

    def volts(self, meant: FloatArray) -> FloatArray:
        """(n,) volts that the amplifiers get of those that are meant for them.

        Args:
            meant: (n,) [V].
        """
        signed = np.array(meant, dtype=np.float64)
        for limb, sign in self.motor_signs.items():
            signed[limb] *= sign
        found = signed.copy()
        for limb, other in self.motors.items():
            found[other] = signed[limb]
        return found

    def senses(
        self, counts: IntArray, volts: FloatArray, lines: BoolArray
    ) -> tuple[IntArray, FloatArray, BoolArray]:
        """What the card reads of counts (n,), gauges (6,) [V] and switches' lines (n,).

        Args:
            counts: (n,) raw.
            volts: (6,) of the gauges [V].
            lines: (n,) of the switches.
        """
        read_counts, read_lines = counts.copy(), lines.copy()
        for limb, other in self.encoders.items():
            read_counts[limb] = counts[other]
        for limb, other in self.switches.items():
            read_lines[limb] = lines[other]
        for limb, sign in self.encoder_signs.items():
            read_counts[limb] = sign * read_counts[limb] % COUNTER
        return read_counts, volts if self.gauges is None else self.gauges @ volts, read_lines
