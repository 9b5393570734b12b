# SPDX-License-Identifier: Apache-2.0
"""The Quanser Q8 card: Daq over `quanser.hardware.HIL`, Quanser's Python API.

That API is not on any package index and loads the vendor's library when it is imported, so it is
imported when a card is opened. tests/hw/test_quanser.py pins the calls and their types.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from cabols_control.checks import FloatArray
from cabols_control.errors import CabolsError
from cabols_hw.card.config import ENCODER_MODULUS, CardConfig
from cabols_hw.card.daq import CardSample
from cabols_hw.card.lateness import Lateness

INFINITE = 0xFFFFFFFF
"""Number of samples of a task that runs until it is stopped: -1 as the API's unsigned number."""
BUFFER_SAMPLES = 1000
BUFFER_OVERFLOW = -111
"""QERR_BUFFER_OVERFLOW, negative as the API returns errors."""
ENABLED, DISABLED = 0, 1
"""Levels of the amplifiers' enable lines."""


class CardError(CabolsError):
    """The card, or its driver, is missing or has failed."""


class CardOverflowError(CardError):
    """The card's buffer ran over: samples were not read for BUFFER_SAMPLES periods."""


def open_q8(board: str, config: CardConfig) -> QuanserQ8:
    """Open a Q8 card; it samples and drives nothing before start().

    Args:
        board: number of the card in this machine, "0" for the first.
        config: wiring and period.

    Raises:
        CardError: if more than one card is wired, Quanser's API is missing, or the card is not
            there or refuses its set-up.
    """
    if config.wiring.cards > 1:
        raise CardError(
            f"Q8: expected the wiring of one card, got {config.wiring.cards}; this back end starts "
            "every card on its own clock; they drift apart, and the samples of one cycle would not "
            "be of one instant (docs/your_rig.md); the simulated rig has two cards"
        )
    try:
        import quanser.hardware as api
    except (ImportError, OSError) as error:
        # OSError: the module is installed, the vendor's shared library is not.
        raise CardError(
            "quanser.hardware: expected Quanser's Python API (part of the Quanser SDK, from its "
            f"vendor), got {error}; without a card run the simulated bench: "
            "ros2 launch cabols_sim bench.launch.py"
        ) from error
    return QuanserQ8(api, board, config)


class QuanserQ8:
    """Daq back end on the hardware.

    The amplifiers are enabled by the first write, and disabled by enable(False), by close(), by
    clear_watchdog() and by the card's watchdog. Before the first write the outputs are zero and
    read() keeps the watchdog; from then on only write() reloads it. A reader that has fallen behind
    skips to the newest sample and counts what it skipped as late: a late sample is useless to
    control. Falling behind by the whole buffer, a second, is an error: such a computer cannot run
    the rig, and the card has zeroed the outputs long before.
    """

    def __init__(
        self,
        api: Any,
        board: str,
        config: CardConfig,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """Open and set up the card.

        Args:
            api: the module quanser.hardware.
            board: number of the card.
            config: wiring and period.
            clock_ns: the computer's clock, to see how late samples are read [ns].

        Raises:
            CardError: if the card is not there or refuses; it is closed again then.
        """
        wiring = config.wiring
        self._api = api
        self._board = board
        self._clock_ns = clock_ns
        self._lock = threading.Lock()
        self._limit = config.output_limit
        self._period_ns = round(1e9 * config.period)
        self._frequency = 1.0 / config.period
        self._gauges = np.array(wiring.channels("gauges"), dtype=np.uint32)
        self._encoders = np.array(wiring.channels("encoders"), dtype=np.uint32)
        self._switches = np.array(wiring.channels("switches"), dtype=np.uint32)
        self._motors = np.array(wiring.channels("motors"), dtype=np.uint32)
        self._enables = np.array(wiring.channels("enables"), dtype=np.uint32)
        n = wiring.limbs
        self._analog = np.zeros((BUFFER_SAMPLES, 6))
        self._counts = np.zeros((BUFFER_SAMPLES, n), dtype=np.int32)
        self._levels = np.zeros((BUFFER_SAMPLES, n), dtype=np.int8)
        self._volts = np.zeros(n)
        self._zero = np.zeros(n)
        self._enable = np.full(self._enables.size, ENABLED, dtype=np.int8)
        self._disable = np.full(self._enables.size, DISABLED, dtype=np.int8)
        self._lateness = Lateness(self._period_ns)
        self._task: Any = None
        self._index = 0
        self._epoch_ns = 0
        self._watchdog_s = 0.0
        self._armed = False
        self._enabled = True
        self._expired = False
        self._closed = False
        self._late = 0
        self._card = api.HIL()
        try:
            with self._calls("opening"):
                self._set_up(wiring.quadrature, wiring.options)
        except BaseException:
            self.close()
            raise

    def _set_up(self, quadrature: int, options: str) -> None:
        card, n = self._card, self._motors.size
        card.open("q8", self._board)
        if card.watchdog_is_expired():
            # A program that died left it expired: the card refuses other calls until it is cleared.
            card.watchdog_clear()
        if options:
            card.set_card_specific_options(options, self._api.MAX_STRING_LENGTH)
        modes = np.full(n, quadrature, dtype=np.int32)
        card.set_encoder_quadrature_mode(self._encoders, n, modes)
        card.set_encoder_counts(self._encoders, n, np.zeros(n, dtype=np.int32))
        # The enable lines may be low from here until start() writes them: the outputs are zero
        # then, from power-up, from close() or from the watchdog.
        card.set_digital_directions(self._switches, n, self._enables, self._enables.size)
        card.watchdog_set_analog_expiration_state(self._motors, n, self._zero)
        # A Q8 zeroes its outputs on expiry only if its lines go tristate: pulled high, which is
        # off. Both states must be set before the watchdog is started.
        states = np.full(self._enables.size, self._api.DigitalState.TRISTATE, dtype=np.int32)
        card.watchdog_set_digital_expiration_state(self._enables, self._enables.size, states)

    @contextlib.contextmanager
    def _calls(self, doing: str) -> Iterator[None]:
        """Convert the API's errors to CardError."""
        try:
            yield
        except self._api.HILError as error:
            kind = CardOverflowError if _code(error) == BUFFER_OVERFLOW else CardError
            raise kind(
                f"Q8 board {self._board}, {doing}: {error.get_error_message()}; the card is left "
                "with zero outputs"
            ) from error

    def start(self, watchdog_s: float) -> None:
        """Start the watchdog, zero the outputs, begin sampling; see Daq.start.

        Raises:
            CardError: if the card refuses.
        """
        n = self._motors.size
        self._watchdog_s = watchdog_s
        with self._lock, self._calls("starting"):
            self._card.watchdog_start(watchdog_s)
            self._make_safe()
            self._task = self._card.task_create_reader(
                BUFFER_SAMPLES, self._gauges, 6, self._encoders, n, self._switches, n, None, 0
            )
            clock = self._api.Clock.HARDWARE_CLOCK_0
            self._card.task_start(self._task, clock, self._frequency, INFINITE)
            self._epoch_ns = time.time_ns()

    def _make_safe(self) -> None:
        """Zero the outputs, then disable the amplifiers."""
        self._card.write_analog(self._motors, self._motors.size, self._zero)
        self._card.write_digital(self._enables, self._enables.size, self._disable)

    def read(self) -> CardSample:
        """Wait for the next sample; skip to the newest if there are more.

        Raises:
            CardOverflowError: if samples were not read for a whole buffer.
            CardError: if the card fails or sampling has been stopped.
        """
        self._task_read(1)
        last = 0
        behind_ns = self._lateness.behind_ns(self._index, self._clock_ns())
        self._late += behind_ns > self._period_ns // 2
        # Rounded up from nine tenths: the lateness is estimated a little low.
        skipped = min((behind_ns + self._period_ns // 10) // self._period_ns, BUFFER_SAMPLES)
        if skipped > 0:
            # They are in the buffer: sampling did not wait.
            self._task_read(skipped)
            self._late += skipped
            last = skipped - 1
        self._look_after_watchdog()
        half = ENCODER_MODULUS // 2
        counts = self._counts[last].astype(np.int64)
        return CardSample(
            self._epoch_ns + self._index * self._period_ns + self._lateness.drifted_ns,
            (counts + half) % ENCODER_MODULUS - half,
            self._analog[last].copy(),
            self._levels[last] != 0,
        )

    def _task_read(self, samples: int) -> None:
        buffers = (self._analog, self._counts, self._levels)
        with self._calls("reading"):
            got = self._card.task_read(self._task, samples, *buffers, None)
        if got != samples:
            raise CardError(
                f"Q8 board {self._board}: expected {samples} samples, got {got}; "
                "sampling has been stopped"
            )
        self._index += samples

    def _look_after_watchdog(self) -> None:
        with self._lock, self._calls("watchdog"):
            if self._closed:
                return
            if self._armed:
                self._expired = self._expired or bool(self._card.watchdog_is_expired())
            elif not self._expired and not self._card.watchdog_reload():
                # Nothing was on: no error to report.
                self._restart_watchdog()

    def write(self, volts: FloatArray) -> None:
        """Set all outputs, reload the watchdog; ignored after an expiry, and after close().

        Volts that are not finite become zero.

        Raises:
            CardError: if the card fails.
        """
        with self._lock:
            if self._closed or self._expired:
                return
            self._volts[:] = volts
            self._volts[~np.isfinite(self._volts)] = 0.0
            np.clip(self._volts, -self._limit, self._limit, out=self._volts)
            with self._calls("writing"):
                self._expired = not self._write_and_reload()

    def _write_and_reload(self) -> bool:
        """Return False if the watchdog has expired."""
        card = self._card
        try:
            card.write_analog(self._motors, self._motors.size, self._volts)
            if not card.watchdog_reload():
                return False
            if not self._armed:
                self._armed = True
                self._write_enables()
        except self._api.HILError:
            if card.watchdog_is_expired():
                return False
            raise
        return True

    def _write_enables(self) -> None:
        levels = self._enable if self._enabled else self._disable
        self._card.write_digital(self._enables, self._enables.size, levels)

    def enable(self, on: bool) -> None:
        """Switch the amplifiers on or off; on takes effect with the first write at the latest.

        Raises:
            CardError: if the card fails.
        """
        with self._lock, self._calls("switching the amplifiers"):
            self._enabled = on
            if self._armed and not self._closed and not self._expired:
                self._write_enables()

    @property
    def watchdog_expired(self) -> bool:
        """Whether the card has zeroed its outputs by itself."""
        return self._expired

    @property
    def late(self) -> int:
        """Samples read more than half a period late, or skipped."""
        return self._late

    def clear_watchdog(self) -> None:
        """Allow writing again; the amplifiers stay disabled until the next write.

        Raises:
            CardError: if the card fails.
        """
        with self._lock, self._calls("clearing the watchdog"):
            if not self._closed and self._expired:
                self._restart_watchdog()

    def _restart_watchdog(self) -> None:
        # Clearing restores what was before the expiry: the lines' directions, perhaps their levels.
        self._card.watchdog_clear()
        self._card.watchdog_start(self._watchdog_s)
        self._make_safe()
        self._armed = False
        self._expired = False

    def close(self) -> None:
        """Zero the outputs, disable the amplifiers, stop, release; never raises, may be repeated.

        If a step fails, the next ones are done nevertheless. After an expiry the watchdog is not
        cleared, as that would only re-enable the outputs.
        """
        with self._lock:
            if self._closed:
                return
            self._closed = True
            card, n = self._card, self._motors.size
            self._try(lambda: card.write_analog(self._motors, n, self._zero))
            self._try(lambda: card.write_digital(self._enables, self._enables.size, self._disable))
            if self._task is not None:
                self._try(lambda: card.task_stop(self._task))
                self._try(lambda: card.task_delete(self._task))
            self._try(card.watchdog_stop)
            self._try(card.close)

    def _try(self, call: Callable[[], object]) -> None:
        with contextlib.suppress(self._api.HILError):
            call()


def _code(error: Exception) -> int:
    return int(getattr(error, "error_code", 0))
