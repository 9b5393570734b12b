# SPDX-License-Identifier: Apache-2.0
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


MAX_CARDS = 2


@dataclass(frozen=True, config=STRICT)
class Terminal:
    """One channel of one card; a bare number in the file is a channel of card 0.

    Attributes:
        card: index of the card, from 0.
        channel: of that card, from 0.
    """

    card: int
    channel: int


Terminals = list[int | Terminal]


def _first(count: int) -> Terminals:
    return list(range(count))


@dataclass(frozen=True, config=STRICT)
class Wiring:
    """Channels of the card, or of two cards on one hardware clock.

    They count from 0, as on the terminal board; the first limb is limb 1 to people.

    Attributes:
        gauges: analog inputs of the force/torque sensor's six gauges, in the calibration's order;
            all on one card, which samples them at one instant.
        encoders: encoder inputs, one for each limb.
        switches: digital lines of the limit switches, one for each limb.
        motors: analog outputs to the amplifiers, one for each limb.
        enables: digital lines that enable the amplifiers. Low enables: the card's lines are pulled
            high when it has power but no program, and when its watchdog expires, so that high must
            mean off at the amplifier.
        quadrature: counts of an encoder's line: 1, 2 or 4; 0 for count and direction.
        options: card specific options of the driver; empty for none.
    """

    gauges: Terminals = field(default_factory=lambda: _first(6))
    encoders: Terminals = field(default_factory=lambda: _first(8))
    switches: Terminals = field(default_factory=lambda: _first(8))
    motors: Terminals = field(default_factory=lambda: _first(8))
    enables: Terminals = field(default_factory=lambda: [8])
    quadrature: int = 4
    options: str = ""

    def __post_init__(self) -> None:
        """Check that channels exist, are used once, and agree in number."""
        for name, available in (
            ("gauges", ANALOG_CHANNELS),
            ("encoders", ENCODER_CHANNELS),
            ("switches", DIGITAL_LINES),
            ("motors", ANALOG_CHANNELS),
            ("enables", DIGITAL_LINES),
        ):
            given, terminals = getattr(self, name), self.terminals(name)
            if not all(0 <= terminal.channel < available for terminal in terminals):
                raise ConfigError(
                    f"{name}: expected channels 0 to {available - 1}, got {_shown(given)}"
                    + _second_card(name, len(given), available)
                )
            if not all(0 <= terminal.card < MAX_CARDS for terminal in terminals):
                raise ConfigError(
                    f"{name}: expected cards 0 to {MAX_CARDS - 1}, got {_shown(given)}"
                )
            if len(set(terminals)) != len(terminals):
                raise ConfigError(f"{name}: expected each channel once, got {_shown(given)}")
        self._check_numbers()

    def _check_numbers(self) -> None:
        if len(self.gauges) != 6:
            raise ConfigError(f"gauges: expected 6 channels, got {len(self.gauges)}")
        if len({terminal.card for terminal in self.terminals("gauges")}) != 1:
            raise ConfigError("gauges: expected all on one card, got two; they need one instant")
        for name, channels in (("encoders", self.encoders), ("switches", self.switches)):
            if len(channels) != self.limbs:
                raise ConfigError(
                    f"{name}: expected {self.limbs} channels as motors has, got {len(channels)}"
                )
        if not self.enables:
            raise ConfigError("enables: expected at least one line, got none")
        unused = sorted(set(range(self.cards)) - {t.card for t in self.terminals("enables")})
        if unused:
            raise ConfigError(
                f"enables: expected a line of every card, got none of card {unused[0]}; its "
                "watchdog could not switch its amplifiers off"
            )
        both = set(self.terminals("enables")) & set(self.terminals("switches"))
        if both:
            lines = sorted(terminal.channel for terminal in both)
            raise ConfigError(f"enables: lines {lines} are switches already; choose others")
        if self.quadrature not in (0, 1, 2, 4):
            raise ConfigError(f"quadrature: expected 0, 1, 2 or 4, got {self.quadrature}")

    def terminals(self, name: str) -> tuple[Terminal, ...]:
        """Card and channel of each entry of one of the lists, by the list's name."""
        entries: Terminals = getattr(self, name)
        return tuple(
            entry if isinstance(entry, Terminal) else Terminal(0, entry) for entry in entries
        )

    def channels(self, name: str) -> list[int]:
        """Channels of one of the lists, by its name; on one card they name a terminal."""
        return [terminal.channel for terminal in self.terminals(name)]

    @property
    def limbs(self) -> int:
        """Number of limbs that are wired."""
        return len(self.motors)

    @property
    def cards(self) -> int:
        """Number of cards that are wired."""
        names = ("gauges", "encoders", "switches", "motors", "enables")
        return 1 + max(terminal.card for name in names for terminal in self.terminals(name))

    def require_limbs(self, cables: int) -> None:
        """Refuse a wiring of another number of limbs than a rig has cables.

        Raises:
            ConfigError: if the numbers differ.
        """
        if self.limbs != cables:
            raise ConfigError(
                f"wiring.motors: expected {cables} channels as the geometry has cables, "
                f"got {self.limbs}" + _second_card("motors", cables, ANALOG_CHANNELS)
            )


def _second_card(name: str, wanted: int, available: int) -> str:
    """Return the advice for a card with too few channels."""
    if wanted <= available:
        return ""
    return (
        f"; one Q8 has {available}, {wanted} {name} need a second one: "
        f"{{card: 1, channel: 0}} and so on"
    )


def _shown(entries: Terminals) -> str:
    return str(
        [entry if isinstance(entry, int) else (entry.card, entry.channel) for entry in entries]
    )
