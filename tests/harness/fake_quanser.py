# SPDX-License-Identifier: Apache-2.0
"""A stand-in for Quanser's `quanser.hardware`, with a Q8 behind it and a clock of its own.

It behaves as the vendor's documentation says: the watchdog sets the outputs to their expiration
states and then refuses all output until it is cleared; clearing restores what was before (here:
everything, the worst case); a reader task blocks until its sample instant and fails when its buffer
has run over. It is stricter than the real one where that one reads memory blindly: arrays must
have the type that the C function behind the call wants.
"""

from __future__ import annotations

import sys
import types

import numpy as np

MAX_STRING_LENGTH = 260
WATCHDOG_EXPIRED, BUFFER_OVERFLOW, BOARD_NOT_FOUND, INVALID = -1000, -111, -108, -113


class Clock:
    HARDWARE_CLOCK_0 = 0


class DigitalState:
    LOW, HIGH, TRISTATE, NO_CHANGE = range(4)


class HILError(Exception):
    def __init__(self, error_code):
        super().__init__(error_code)
        self.error_code = error_code

    def get_error_message(self):
        return f"fake error {self.error_code}"


class Board:
    """The card itself, and the time.

    Attributes:
        now_ns: of the clock that both the card and the test read.
        drift: of the computer's clock against it [s/s].
        gauges, counts, lines: what the inputs see; counts may be any whole numbers.
        volts: (8,) of the outputs.
        levels: (32,) of the digital lines that are outputs; others are pulled high.
        calls: (name, arguments) of every call, arrays as lists.
        fail: name of the call that is to fail next.
    """

    def __init__(self):
        self.now_ns = 5_000_000_000
        self.drift = 0.0
        self.gauges, self.counts = np.zeros(8), np.zeros(8, dtype=np.int64)
        self.lines = np.ones(32, dtype=bool)
        self.volts = np.zeros(8)
        self.outputs: set[int] = set()
        self.levels = np.ones(32, dtype=int)
        self.calls: list[tuple] = []
        self.fail = ""
        self.present = True
        self.opened = self.expired = False
        self.timeout_ns = self.reloaded_ns = None
        self.kept = None
        self.expiry_volts: dict[int, float] = {}
        self.expiry_levels: dict[int, int] = {}
        self.task = None

    def clock_ns(self):
        return self.now_ns + int(self.drift * self.now_ns)

    @property
    def enabled(self):
        """Lines that enable an amplifier: outputs at low."""
        self.elapse(0)
        return sorted(line for line in self.outputs if self.levels[line] == 0)

    def elapse(self, duration_ns):
        self.now_ns += duration_ns
        running = self.timeout_ns is not None and not self.expired
        if running and self.now_ns - self.reloaded_ns > self.timeout_ns:
            self.expired = True
            self.kept = (self.volts.copy(), set(self.outputs), self.levels.copy())
            # A Q8 does both or neither.
            if self.expiry_volts and DigitalState.TRISTATE in self.expiry_levels.values():
                self.volts[list(self.expiry_volts)] = 0.0
                self.outputs = set()

    def names(self):
        return [name for name, *_ in self.calls]


def _typed(array, dtype, count):
    assert isinstance(array, np.ndarray), array
    assert array.dtype == dtype, f"expected {dtype}, got {array.dtype}"
    assert array.flags.c_contiguous
    assert array.size >= count
    return array


def make_api(board):
    """The module quanser.hardware on one board."""

    class HIL:
        def _call(self, name, *arguments, blocked=True):
            plain = [a.tolist() if isinstance(a, np.ndarray) else a for a in arguments]
            board.calls.append((name, *plain))
            board.elapse(0)
            if board.fail == name:
                board.fail = ""
                raise HILError(-1)
            if not board.opened and name != "open":
                raise HILError(INVALID)
            if blocked and board.expired:
                raise HILError(WATCHDOG_EXPIRED)

        def open(self, card_type, identifier):
            self._call("open", card_type, identifier, blocked=False)
            if not (board.present and card_type == "q8"):
                raise HILError(BOARD_NOT_FOUND)
            board.opened = True

        def close(self):
            self._call("close", blocked=False)
            board.opened = False

        def set_card_specific_options(self, options, size):
            self._call("set_card_specific_options", options, size)

        def set_encoder_quadrature_mode(self, channels, n, modes):
            _typed(channels, np.uint32, n), _typed(modes, np.int32, n)
            self._call("set_encoder_quadrature_mode", channels, n, modes)

        def set_encoder_counts(self, channels, n, counts):
            _typed(channels, np.uint32, n), _typed(counts, np.int32, n)
            self._call("set_encoder_counts", channels, n, counts)
            board.counts[channels[:n]] = counts[:n]

        def set_digital_directions(self, inputs, n_in, outputs, n_out):
            _typed(inputs, np.uint32, n_in), _typed(outputs, np.uint32, n_out)
            self._call("set_digital_directions", inputs, n_in, outputs, n_out)
            board.outputs = set(outputs[:n_out].tolist())
            # Worst case: what the output register holds after power-up.
            board.levels[outputs[:n_out]] = 0

        def watchdog_set_analog_expiration_state(self, channels, n, volts):
            _typed(channels, np.uint32, n), _typed(volts, np.float64, n)
            assert not volts.any(), "a Q8 can only go to 0 V"
            assert board.timeout_ns is None, "before watchdog_start"
            self._call("watchdog_set_analog_expiration_state", channels, n, volts)
            board.expiry_volts = dict(zip(channels.tolist(), volts.tolist(), strict=False))

        def watchdog_set_digital_expiration_state(self, channels, n, states):
            _typed(channels, np.uint32, n), _typed(states, np.int32, n)
            assert board.timeout_ns is None, "before watchdog_start"
            self._call("watchdog_set_digital_expiration_state", channels, n, states)
            board.expiry_levels = dict(zip(channels.tolist(), states.tolist(), strict=False))

        def watchdog_start(self, timeout):
            self._call("watchdog_start", timeout)
            board.timeout_ns, board.reloaded_ns = round(1e9 * timeout), board.now_ns

        def watchdog_stop(self):
            self._call("watchdog_stop", blocked=False)
            board.timeout_ns = None

        def watchdog_reload(self):
            self._call("watchdog_reload", blocked=False)
            board.reloaded_ns = board.now_ns
            return not board.expired

        def watchdog_is_expired(self):
            self._call("watchdog_is_expired", blocked=False)
            return board.expired

        def watchdog_clear(self):
            self._call("watchdog_clear", blocked=False)
            if board.expired and board.kept is not None:
                board.volts, board.outputs, board.levels = board.kept
            board.expired, board.timeout_ns = False, None

        def write_analog(self, channels, n, volts):
            _typed(channels, np.uint32, n), _typed(volts, np.float64, n)
            self._call("write_analog", channels, n, volts)
            step = 20.0 / 2**12
            codes = np.clip(np.round(volts[:n] / step), -(2**11), 2**11 - 1)
            board.volts[channels[:n]] = step * codes

        def write_digital(self, lines, n, levels):
            _typed(lines, np.uint32, n), _typed(levels, np.int8, n)
            self._call("write_digital", lines, n, levels)
            board.levels[lines[:n]] = levels[:n]

        def task_create_reader(
            self, samples, analog, n_analog, encoder, n_encoder, digital, n_digital, other, n_other
        ):
            for channels, n in ((analog, n_analog), (encoder, n_encoder), (digital, n_digital)):
                _typed(channels, np.uint32, n)
            assert (other, n_other) == (None, 0)
            arguments = (samples, analog, n_analog, encoder, n_encoder, digital, n_digital)
            self._call("task_create_reader", *arguments, other, n_other)
            board.task = types.SimpleNamespace(
                size=samples, channels=(analog, encoder, digital), start_ns=None, index=0
            )
            return board.task

        def task_start(self, task, clock, frequency, samples):
            assert task is board.task
            assert 0 <= samples < 2**32, "an unsigned number"
            self._call("task_start", clock, frequency, samples)
            task.start_ns, task.period_ns = board.now_ns, round(1e9 / frequency)

        def task_read(self, task, samples, analog, encoder, digital, other):
            assert task is board.task
            assert other is None
            of_analog, of_encoder, of_digital = task.channels
            _typed(analog, np.float64, samples * of_analog.size)
            _typed(encoder, np.int32, samples * of_encoder.size)
            _typed(digital, np.int8, samples * of_digital.size)
            self._call("task_read", samples, blocked=False)
            if task.start_ns is None:
                return 0
            waiting = (board.now_ns - task.start_ns) // task.period_ns - task.index
            if waiting > task.size:
                raise HILError(BUFFER_OVERFLOW)
            task.index += samples
            board.elapse(max(0, task.start_ns + task.index * task.period_ns - board.now_ns))
            step = 20.0 / 2**14
            codes = np.clip(np.round(board.gauges[of_analog] / step), -(2**13), 2**13 - 1)
            wrapped = (board.counts[of_encoder] + 2**23) % 2**24 - 2**23
            for k in range(samples):
                # Older samples of a burst are marked: nobody may take one for the newest.
                old = samples - 1 - k
                analog.reshape(-1)[k * 6 : k * 6 + 6] = step * codes - old
                encoder.reshape(-1)[k * wrapped.size : (k + 1) * wrapped.size] = wrapped - old
                levels = board.lines[of_digital]
                digital.reshape(-1)[k * levels.size : (k + 1) * levels.size] = levels
            return samples

        def task_stop(self, task):
            self._call("task_stop", blocked=False)
            task.start_ns = None

        def task_delete(self, task):
            self._call("task_delete", blocked=False)

    api = types.ModuleType("quanser.hardware")
    for item in (HIL, HILError, Clock, DigitalState):
        setattr(api, item.__name__, item)
    api.MAX_STRING_LENGTH = MAX_STRING_LENGTH
    return api


def install(monkeypatch, board):
    """Let `import quanser.hardware` find the fake."""
    api = make_api(board)
    package = types.ModuleType("quanser")
    package.hardware = api
    monkeypatch.setitem(sys.modules, "quanser", package)
    monkeypatch.setitem(sys.modules, "quanser.hardware", api)
    return api
