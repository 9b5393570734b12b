# SPDX-License-Identifier: Apache-2.0
"""Interface of the data acquisition card, for hardware and simulated back ends."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from cabols_control.checks import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class CardSample:
    """One simultaneous sample of all inputs.

    Attributes:
        time_ns: when it was taken, on the card's clock [ns].
        encoders: (n,) raw counts, signed 24 bit, wrapping.
        analog: (6,) force/torque gauges [V].
        digital: (n,) line levels, True is high.
    """

    time_ns: int
    encoders: IntArray
    analog: FloatArray
    digital: BoolArray


class Daq(Protocol):
    """A card with n encoders, n analog outputs, 6 analog inputs, n digital inputs, a watchdog.

    `read` is called by one thread and paces it; `write` may be called by another. The watchdog is
    active from the first write on. tests/hw/test_daq_contract.py says what every back end does.
    """

    def start(self, watchdog_s: float) -> None:
        """Start sampling; the card zeroes its outputs when nothing is written for watchdog_s."""

    def read(self) -> CardSample:
        """Wait for the next sample instant and return the inputs; if behind, the newest."""

    def write(self, volts: FloatArray) -> None:
        """Set all outputs [V] and reload the watchdog.

        Values that are not finite become zero. Ignored after an expiry until it is cleared, and
        always after close().
        """

    def enable(self, on: bool) -> None:
        """Switch the amplifiers on or off; they are on by default."""

    @property
    def watchdog_expired(self) -> bool:
        """Whether the card itself has zeroed its outputs; latched until cleared."""

    @property
    def late(self) -> int:
        """Samples that were read more than half a period after their instant, or skipped."""

    def clear_watchdog(self) -> None:
        """Allow writing again after an expiry, from zero outputs."""

    def close(self) -> None:
        """Zero the outputs and release the card; may be repeated."""
