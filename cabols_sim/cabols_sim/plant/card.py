# SPDX-License-Identifier: Apache-2.0
"""A simulated Q8 card around the plant, with the interface of the hardware's back end."""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import Any

import numpy as np

from cabols_control.checks import FloatArray
from cabols_hw.card.config import CardConfig
from cabols_hw.card.daq import CardSample
from cabols_sim.plant.plant import Plant

BUFFER_SAMPLES = 16
"""Most samples that wait for their reader; a later reader loses the oldest ones."""


class SimulatedQ8:
    """Daq back end on the plant, with the wall clock (`real_time`) or its own (`lockstep`).

    Attributes:
        plant: the rig behind the card.
    """

    def __init__(
        self, plant: Plant, config: CardConfig, limbs: int, lockstep: bool, speed: float = 1.0
    ) -> None:
        """Stand still until start().

        Args:
            plant: the rig behind the card.
            config: wiring; two cards share the clock and are written together, so that they also
                expire together.
            limbs: number of outputs.
            lockstep: step from read to read instead of by the wall clock.
            speed: how fast the plant's time passes, in real time's; below 1 is slow motion.

        Raises:
            ConfigError: if the wiring is of another number of limbs.
        """
        config.wiring.require_limbs(limbs)
        self._speed = speed
        self.plant = plant
        self._config = config
        self._lockstep = lockstep
        self._volts = np.zeros(limbs)
        self._lock = threading.Lock()
        self._period_ns = round(1e9 * config.period)
        self._tick = 0
        self._sampled = 0
        self._samples: deque[tuple[int, Any]] = deque(maxlen=BUFFER_SAMPLES)
        self._origin_ns = 0
        self._epoch_ns = 0
        self._plant_ns = 0
        self._written_ns = 0
        self._watchdog_ns = 0
        self._armed = False
        self._expired = False
        self._closed = False
        self._late = 0

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy keeps: all but the lock."""
        return {name: value for name, value in vars(self).items() if name != "_lock"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Become a copy, with a lock of its own.

        Args:
            state: of __getstate__.
        """
        vars(self).update(state)
        self._lock = threading.Lock()

    def start(self, watchdog_s: float) -> None:
        """Begin sampling now; see Daq.start."""
        self._watchdog_ns = round(1e9 * watchdog_s)
        if not self._lockstep:
            self._origin_ns = time.monotonic_ns()
            self._epoch_ns = time.time_ns()

    def read(self) -> CardSample:
        """Wait for the next instant (in lockstep: step to it) and sample."""
        self._tick += 1
        if not self._lockstep:
            self._wait_for_tick()
        with self._lock:
            self._advance_to(self._tick * self._period_ns)
            while self._samples[0][0] < self._tick:
                self._samples.popleft()
            tick, senses = self._samples.popleft()
            self._late += tick - self._tick
            self._tick = tick
            return CardSample(self._epoch_ns + tick * self._period_ns, *senses)

    def _wait_for_tick(self) -> None:
        due_ns = self._tick * self._period_ns
        remaining = due_ns - self._elapsed_ns()
        if remaining > 0:
            time.sleep(1e-9 * remaining / self._speed)
        behind = self._elapsed_ns() - due_ns
        self._late += behind > self._period_ns // 2
        if behind > self._period_ns:
            # The card's buffer would have overflowed: these instants are lost.
            skipped = behind // self._period_ns
            self._tick += skipped
            self._late += skipped

    def _elapsed_ns(self) -> int:
        """The plant's time since start, by the wall clock; zero before."""
        if not self._origin_ns:
            return 0
        return int((time.monotonic_ns() - self._origin_ns) * self._speed)

    def write(self, volts: FloatArray) -> None:
        """Set all outputs and reload the watchdog; ignored after an expiry, until it is cleared.

        Ignored after close(), too. Volts that are not finite become zero.
        """
        with self._lock:
            if not self._lockstep:
                self._advance_to(self._elapsed_ns())
            if self._expired or self._closed:
                return
            limit = self._config.output_limit
            self._volts[:] = volts
            self._volts[~np.isfinite(self._volts)] = 0.0
            np.clip(self._volts, -limit, limit, out=self._volts)
            self._written_ns = self._plant_ns
            self._armed = True
            self.plant.drive(self._volts)

    def enable(self, on: bool) -> None:
        """Switch the amplifiers on or off."""
        with self._lock:
            if not self._lockstep:
                self._advance_to(self._elapsed_ns())
            self.plant.enabled = on

    def _advance_to(self, plant_ns: int) -> None:
        """Advance the plant's time; the card samples at its own instants in any case."""
        newest = plant_ns // self._period_ns
        for tick in range(max(self._sampled + 1, newest - BUFFER_SAMPLES + 1), newest + 1):
            self._run_to(tick * self._period_ns)
            self._samples.append((tick, self.plant.sense()))
            self._sampled = tick
        self._run_to(plant_ns)

    def _run_to(self, plant_ns: int) -> None:
        """Advance the plant's time, and the card's own watchdog with it."""
        if self._armed and not self._expired:
            expiry_ns = self._written_ns + self._watchdog_ns
            if plant_ns > expiry_ns:
                self._pass_time(expiry_ns)
                self._expired = True
                self._volts[:] = 0.0
                self.plant.drive(self._volts)
        self._pass_time(plant_ns)

    def _pass_time(self, plant_ns: int) -> None:
        if plant_ns > self._plant_ns:
            self.plant.advance(1e-9 * (plant_ns - self._plant_ns))
            self._plant_ns = plant_ns

    @property
    def watchdog_expired(self) -> bool:
        """Whether the card has zeroed its outputs by itself."""
        return self._expired

    @property
    def late(self) -> int:
        """Samples read more than half a period late, or skipped."""
        return self._late

    def clear_watchdog(self) -> None:
        """Allow writing again."""
        with self._lock:
            self._expired = False
            self._armed = False

    def close(self) -> None:
        """Zero the outputs."""
        with self._lock:
            self._closed = True
            self._volts[:] = 0.0
            self.plant.drive(self._volts)
