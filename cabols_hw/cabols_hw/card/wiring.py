"""Wiring: the card's terminal of each device. Hardware channels count from 0."""

from __future__ import annotations

from dataclasses import field

from pydantic.dataclasses import dataclass

from cabols_control.configuration import STRICT
from cabols_control.errors import ConfigError

ANALOG_CHANNELS = 8
ENCODER_CHANNELS = 8
DIGITAL_LINES = 32
"""What a Q8 has."""


def _first(count: int) -> list[int]:
    return list(range(count))


@dataclass(frozen=True, config=STRICT)
class Wiring:
    """Channels of the card, from 0 as on its terminal board; the first limb is limb 1 to people.

    Attributes:
        gauges: analog inputs of the force/torque sensor's six gauges, in the calibration's order.
        encoders: encoder inputs, one for each limb.
        switches: digital lines of the limit switches, one for each limb.
        motors: analog outputs to the amplifiers, one for each limb.
        enables: digital lines that enable the amplifiers. Low enables: the card's lines are pulled
            high when it has power but no program, and when its watchdog expires, so that high must
            mean off at the amplifier.
        quadrature: counts of an encoder's line: 1, 2 or 4; 0 for count and direction.
        options: card specific options of the driver; empty for none.
    """

    gauges: list[int] = field(default_factory=lambda: _first(6))
    encoders: list[int] = field(default_factory=lambda: _first(8))
    switches: list[int] = field(default_factory=lambda: _first(8))
    motors: list[int] = field(default_factory=lambda: _first(8))
    enables: list[int] = field(default_factory=lambda: [8])
    quadrature: int = 4
    options: str = ""

    def __post_init__(self) -> None:
        """Check that channels exist, are used once, and agree in number."""
        for name, channels, available in (
            ("gauges", self.gauges, ANALOG_CHANNELS),
            ("encoders", self.encoders, ENCODER_CHANNELS),
            ("switches", self.switches, DIGITAL_LINES),
            ("motors", self.motors, ANALOG_CHANNELS),
            ("enables", self.enables, DIGITAL_LINES),
        ):
            if not all(0 <= channel < available for channel in channels):
                raise ConfigError(f"{name}: expected channels 0 to {available - 1}, got {channels}")
            if len(set(channels)) != len(channels):
                raise ConfigError(f"{name}: expected each channel once, got {channels}")
        if len(self.gauges) != 6:
            raise ConfigError(f"gauges: expected 6 channels, got {len(self.gauges)}")
        for name, channels in (("encoders", self.encoders), ("switches", self.switches)):
            if len(channels) != self.limbs:
                raise ConfigError(
                    f"{name}: expected {self.limbs} channels as motors has, got {len(channels)}"
                )
        if not self.enables:
            raise ConfigError("enables: expected at least one line, got none")
        both = sorted(set(self.enables) & set(self.switches))
        if both:
            raise ConfigError(f"enables: lines {both} are switches already; choose others")
        if self.quadrature not in (0, 1, 2, 4):
            raise ConfigError(f"quadrature: expected 0, 1, 2 or 4, got {self.quadrature}")

    @property
    def limbs(self) -> int:
        """Number of limbs that are wired."""
        return len(self.motors)
