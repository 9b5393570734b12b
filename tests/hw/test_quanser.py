# SPDX-License-Identifier: Apache-2.0
"""The Q8 back end, call by call, on a fake of the vendor's API."""

from __future__ import annotations

import sys
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

import fake_quanser
from cabols_control.errors import CabolsError
from cabols_hw.card.lateness import Lateness
from cabols_hw.card.quanser import BUFFER_SAMPLES, CardError, CardOverflowError, QuanserQ8, open_q8
from cabols_hw.card.wiring import Wiring
from fake_quanser import MAX_STRING_LENGTH, Board, DigitalState

MS = 1_000_000
EIGHT = list(range(8))


@pytest.fixture
def board():
    return Board()


@pytest.fixture
def open_card(board, card):
    api = fake_quanser.make_api(board)

    def open_it(config=card):
        return QuanserQ8(api, "0", config, board.clock_ns)

    return open_it


@pytest.fixture
def running(open_card, board):
    daq = open_card()
    daq.start(0.010)
    daq.read()
    board.calls.clear()
    return daq


def test_missing_driver_says_what_to_do(card, monkeypatch):
    monkeypatch.setitem(sys.modules, "quanser", None)
    monkeypatch.setitem(sys.modules, "quanser.hardware", None)
    with pytest.raises(CardError, match="simulated bench"):
        open_q8("0", card)


def test_driver_without_its_library_says_what_to_do(card, monkeypatch):
    class Broken:
        def find_spec(self, name, path=None, target=None):
            if name == "quanser":
                raise OSError("libhil.so: cannot open shared object file")

    monkeypatch.setattr(sys, "meta_path", [Broken(), *sys.meta_path])
    with pytest.raises(CardError, match=r"libhil\.so.*simulated bench"):
        open_q8("0", card)


def test_open_q8_opens_the_board_by_its_number(board, card, monkeypatch):
    fake_quanser.install(monkeypatch, board)
    daq = open_q8("3", card)
    assert board.calls[0] == ("open", "q8", "3")
    daq.close()


def test_calls_from_open_to_the_first_sample(open_card, board):
    daq = open_card()
    opening = [
        ("open", "q8", "0"),
        ("watchdog_is_expired",),
        ("set_encoder_quadrature_mode", EIGHT, 8, [4] * 8),
        ("set_encoder_counts", EIGHT, 8, [0] * 8),
        ("set_digital_directions", EIGHT, 8, [8], 1),
        ("watchdog_set_analog_expiration_state", EIGHT, 8, [0.0] * 8),
        ("watchdog_set_digital_expiration_state", [8], 1, [DigitalState.TRISTATE]),
    ]
    assert board.calls == opening
    daq.start(0.010)
    starting = [
        ("watchdog_start", 0.010),
        ("write_analog", EIGHT, 8, [0.0] * 8),
        ("write_digital", [8], 1, [1]),
        ("task_create_reader", BUFFER_SAMPLES, EIGHT[:6], 6, EIGHT, 8, EIGHT, 8, None, 0),
        ("task_start", 0, 1000.0, 2**32 - 1),
    ]
    assert board.calls == opening + starting
    daq.read()
    assert board.calls == [*opening, *starting, ("task_read", 1), ("watchdog_reload",)]


def test_calls_of_a_cycle(running, board):
    running.write(np.full(8, 1.0))
    assert board.calls == [
        ("write_analog", EIGHT, 8, [1.0] * 8),
        ("watchdog_reload",),
        ("write_digital", [8], 1, [0]),
    ]
    board.calls.clear()
    running.read()
    running.write(np.full(8, -1.0))
    assert board.calls == [
        ("task_read", 1),
        ("watchdog_is_expired",),
        ("write_analog", EIGHT, 8, [-1.0] * 8),
        ("watchdog_reload",),
    ]


def test_calls_of_close(running, board):
    running.write(np.full(8, 1.0))
    board.calls.clear()
    running.close()
    assert board.calls == [
        ("write_analog", EIGHT, 8, [0.0] * 8),
        ("write_digital", [8], 1, [1]),
        ("task_stop",),
        ("task_delete",),
        ("watchdog_stop",),
        ("close",),
    ]
    running.close()
    assert len(board.calls) == 6, "the second close() does nothing"


def test_calls_of_expiry_and_clear(running, board):
    running.write(np.full(8, 1.0))
    board.elapse(11 * MS)
    assert board.enabled == []
    running.read()
    assert running.watchdog_expired
    board.calls.clear()
    running.clear_watchdog()
    assert board.calls == [
        ("watchdog_clear",),
        ("watchdog_start", 0.010),
        ("write_analog", EIGHT, 8, [0.0] * 8),
        ("write_digital", [8], 1, [1]),
    ]
    assert not running.watchdog_expired
    assert board.enabled == []


def test_amplifiers_are_enabled_by_the_first_write_only(open_card, board):
    daq = open_card()
    daq.start(0.010)
    assert board.enabled == []
    for _ in range(30):
        daq.read()
    assert board.enabled == []
    assert not daq.watchdog_expired, "nothing written: nothing to watch"
    daq.write(np.zeros(8))
    assert board.enabled == [8]


def test_outputs_are_set_before_the_amplifiers_are_enabled(running, board):
    running.write(np.full(8, 0.5))
    names = board.names()
    assert names.index("write_analog") < names.index("write_digital")


def test_wiring_and_options_reach_the_card(open_card, board, card):
    wiring = Wiring(
        gauges=[2, 3, 4, 5, 6, 7],
        encoders=[1, 0],
        switches=[16, 17],
        motors=[6, 7],
        enables=[30, 31],
        quadrature=2,
        options="deadband=1;",
    )
    daq = open_card(replace(card, wiring=wiring))
    assert ("set_card_specific_options", "deadband=1;", MAX_STRING_LENGTH) in board.calls
    assert ("set_encoder_quadrature_mode", [1, 0], 2, [2, 2]) in board.calls
    board.gauges[:] = np.arange(8)
    board.counts[:2] = [10, 20]
    board.lines[16] = False
    daq.start(0.010)
    sample = daq.read()
    np.testing.assert_allclose(sample.analog, np.arange(2, 8), atol=1e-3)
    np.testing.assert_array_equal(sample.encoders, [20, 10])
    np.testing.assert_array_equal(sample.digital, [False, True])
    daq.write(np.array([1.0, 2.0]))
    np.testing.assert_allclose(board.volts[6:], [1.0, 2.0], atol=5e-3)
    assert board.enabled == [30, 31]


SET_UP = (
    "open",
    "watchdog_is_expired",
    "set_encoder_quadrature_mode",
    "set_encoder_counts",
    "set_digital_directions",
    "watchdog_set_analog_expiration_state",
    "watchdog_set_digital_expiration_state",
)


@pytest.mark.parametrize("call", SET_UP)
def test_failure_half_way_through_opening_leaves_the_card_safe(open_card, board, call):
    board.fail = call
    with pytest.raises(CardError, match=r"opening.*fake error"):
        open_card()
    assert board.calls[-1] == ("close",)
    assert not board.opened
    np.testing.assert_array_equal(board.volts, 0.0)
    assert board.enabled == []


@pytest.mark.parametrize(
    "call",
    ["watchdog_start", "write_analog", "write_digital", "task_create_reader", "task_start"],
)
def test_failure_half_way_through_starting_leaves_the_card_safe(open_card, board, call):
    daq = open_card()
    board.fail = call
    with pytest.raises(CardError, match="starting"):
        daq.start(0.010)
    daq.close()
    assert board.calls[-1] == ("close",)
    assert board.enabled == []


@pytest.mark.parametrize(
    "call", ["write_analog", "write_digital", "task_stop", "task_delete", "watchdog_stop"]
)
def test_close_goes_on_when_a_step_fails(running, board, call):
    running.write(np.full(8, 1.0))
    board.calls.clear()
    board.fail = call
    running.close()
    assert board.names()[-2:] == ["watchdog_stop", "close"]
    assert len(board.calls) == 6


def test_failing_write_is_an_error(running, board):
    board.fail = "write_analog"
    with pytest.raises(CardError, match="writing"):
        running.write(np.zeros(8))


def test_absent_board(open_card, board):
    board.present = False
    with pytest.raises(CardError, match="board 0"):
        open_card()


def test_watchdog_left_expired_by_a_dead_program_is_cleared(open_card, board):
    board.opened = board.expired = True
    daq = open_card()
    assert board.names()[:3] == ["open", "watchdog_is_expired", "watchdog_clear"]
    daq.start(0.010)
    daq.write(np.full(8, 1.0))
    assert board.enabled == [8]


def test_close_after_an_expiry_does_not_give_the_outputs_back(running, board):
    running.write(np.full(8, 1.0))
    board.elapse(11 * MS)
    running.close()
    assert "watchdog_clear" not in board.names()
    np.testing.assert_array_equal(board.volts, 0.0)
    assert board.enabled == []


def test_expiry_between_two_calls_of_write_is_no_error(running, board):
    running.write(np.full(8, 1.0))
    board.elapse(11 * MS)
    running.write(np.full(8, 1.0))
    assert running.watchdog_expired
    np.testing.assert_array_equal(board.volts, 0.0)


def test_reading_on_does_not_reload_the_watchdog(running, board):
    """The reader must not keep alive what the writer has let die."""
    running.write(np.full(8, 1.0))
    for _ in range(12):
        running.read()
    assert running.watchdog_expired
    np.testing.assert_array_equal(board.volts, 0.0)


def test_buffer_that_ran_over_is_an_error(running, board):
    board.elapse((BUFFER_SAMPLES + 5) * MS)
    with pytest.raises(CardOverflowError, match="fake error -111"):
        running.read()


def test_stopped_sampling_is_an_error(running, board):
    board.task.start_ns = None
    with pytest.raises(CardError, match="expected 1 samples, got 0"):
        running.read()


def test_stamps_count_samples_from_the_start(open_card, board):
    before = time.time_ns()
    daq = open_card()
    daq.start(0.010)
    after = time.time_ns()
    stamps = [daq.read().time_ns for _ in range(5)]
    board.elapse(20 * MS)
    stamps.append(daq.read().time_ns)
    np.testing.assert_array_equal(np.diff(stamps), [MS, MS, MS, MS, 20 * MS])
    assert before <= stamps[0] - MS <= after


def test_reader_that_fell_behind_gets_the_newest_sample(running, board):
    board.counts[:] = 1234
    board.elapse(20 * MS)
    sample = running.read()
    # The fake marks older samples of a burst by lower counts.
    np.testing.assert_array_equal(sample.encoders, 1234)


def test_errors_are_those_of_the_project():
    assert issubclass(CardOverflowError, CardError)
    assert issubclass(CardError, CabolsError)


@pytest.mark.parametrize("drift", [-1e-4, 0.0, 1e-4])
def test_drifting_clocks_are_not_lateness(drift):
    """100 ppm are a period in ten seconds: taken for lateness, they would skip samples forever."""
    lateness = Lateness(MS)
    behind = [lateness.behind_ns(k, int(k * MS * (1.0 + drift))) for k in range(30_000)]
    assert max(behind) < 1000
    assert lateness.behind_ns(30_000, int(30_000 * MS * (1.0 + drift)) + 7 * MS) > 6.9 * MS


@pytest.mark.parametrize("drift", [-8e-5, 0.0, 5e-5, 1.5e-4])
def test_stamps_follow_the_computers_clock(drift):
    """Five minutes, read late by chance, with stalls: the robot's poses are on that clock."""
    rng = np.random.default_rng(2)
    lateness, n = Lateness(MS), 300_000
    truth = np.arange(n) * MS * (1.0 + drift)
    late = rng.exponential(40_000.0, n)
    late[rng.integers(0, n, 60)] += rng.uniform(1.0, 20.0, 60) * MS
    late[:20] += 5.0 * MS
    drifted = np.empty(n)
    for k, now in enumerate((truth + late).astype(np.int64).tolist()):
        lateness.behind_ns(k, now)
        drifted[k] = lateness.drifted_ns
    stamps = np.arange(n) * MS + drifted
    assert np.abs(stamps - truth)[2000:].max() < 0.2 * MS
    periods = np.diff(stamps)
    assert np.abs(periods - MS).max() <= 2.1e-4 * MS
    assert abs(periods[2000:].mean() - MS * (1.0 + drift)) < 2.0


def test_samples_are_stamped_by_the_computers_clock(open_card, board):
    """The card's crystal is slow by 100 parts in a million: its stamps are not."""
    board.drift = 1e-4
    daq = open_card()
    daq.start(0.010)
    first = daq.read().time_ns
    for _ in range(20_000):
        newest = daq.read().time_ns
    assert newest - first == pytest.approx(20_000 * MS * (1.0 + 1e-4), abs=0.2 * MS)


def test_reader_and_writer_threads(running, board):
    """Writing goes on while another thread reads; none of the calls that output overlap."""
    inside = threading.Lock()
    overlaps = []
    card = running._card
    for name in ("write_analog", "write_digital", "watchdog_reload", "watchdog_is_expired"):
        real = getattr(card, name)

        def guarded(*arguments, real=real, name=name):
            if not inside.acquire(blocking=False):
                overlaps.append(name)
                return real(*arguments)
            try:
                return real(*arguments)
            finally:
                inside.release()

        setattr(card, name, guarded)
    failures = []

    def write():
        try:
            for _ in range(300):
                running.write(np.ones(8))
        except Exception as error:
            failures.append(error)

    writer = threading.Thread(target=write)
    writer.start()
    for _ in range(300):
        running.read()
    writer.join(timeout=10.0)
    assert not writer.is_alive()
    assert failures == []
    assert overlaps == []
