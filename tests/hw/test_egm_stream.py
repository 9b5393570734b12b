# SPDX-License-Identifier: Apache-2.0
"""The position stream's numbers, clock and senders, when they are not what they should be."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cabols_hw.abb.egm.reader import EgmReader, PacketCounter, SenderGuard, StreamQuality
from cabols_hw.abb.egm.sample import EgmSample, read_packet
from cabols_hw.abb.egm.stream_quality import CountedStream, Refusal
from egm_packets import PERIOD_S, numbered, packet, udp

LATE_S = 0.03


class Played:
    """What a counter and its judge make of (number, sent, received)."""

    def __init__(self, packets):
        self.counter = PacketCounter(LATE_S)
        quality = StreamQuality(self.counter)
        self.accepted, said = [], []
        for row in packets:
            self.accepted.append(self.counter.take(*row))
            said.append(quality.look())
        self.said = said

    @property
    def blind_s(self):
        edges = np.flatnonzero(np.r_[True, self.accepted, True])
        return np.diff(edges).max() * PERIOD_S


def stream(count, first=0, sent=9000.0, received=100.0, rate=1.0, seed=1):
    """Packets of a healthy stream; rate: of the controller's clock in this computer's."""
    jitter = np.abs(np.random.default_rng(seed).normal(0.0, 0.0005, count))
    return [
        ((first + k) % 2**32, sent + k * PERIOD_S * rate, received + k * PERIOD_S + jitter[k])
        for k in range(count)
    ]


@pytest.mark.parametrize("step_s", [3600.0, -3600.0, 1.0, -1.0, 0.05, -0.05, 0.012, -0.012])
def test_step_of_the_clock_makes_no_packet_late(step_s):
    packets = [(k, s + step_s * (k > 500), r) for k, s, r in stream(1500)]
    found = Played(packets)
    assert all(found.accepted)
    assert found.counter.late == 0
    assert found.counter.clock_steps == (step_s < 0 or step_s > 0.5)


@pytest.mark.parametrize("step_s", [3600.0, -3600.0])
def test_delay_is_seen_after_a_step_of_the_clock(step_s):
    packets = [(k, s + step_s * (k > 500), r + 0.05 * (k > 1000)) for k, s, r in stream(1500)]
    found = Played(packets)
    assert found.counter.late >= 400
    assert found.said[-1]


def test_delay_that_comes_with_a_step_is_a_delay():
    packets = [(k, s - 3600.0 * (k > 500), r + 0.05 * (k > 500)) for k, s, r in stream(700)]
    assert Played(packets).counter.late >= 190


@pytest.mark.parametrize("rate", [1.001, 0.999, 1.0003])
def test_clock_that_drifts_makes_no_packet_late(rate):
    assert Played(stream(100_000, rate=rate)).counter.late == 0


def test_clock_of_32_bit_milliseconds_wraps():
    wrap = 2**32 * 1e-3
    packets = [(k, (wrap - 1.0 + k * PERIOD_S) % wrap, r) for k, _, r in stream(1000)]
    found = Played(packets)
    assert (found.counter.late, found.counter.clock_steps) == (0, 0)


@settings(max_examples=200)
@given(
    first=st.integers(12, 2000),
    begins=st.integers(0, 5),
    sent=st.sampled_from([5.0, 0.0, 9100.0, 20000.0]),
    pause=st.floats(0.004, 2.0),
)
def test_session_that_begins_anew_is_taken_within_50_ms(first, begins, sent, pause):
    before = stream(first, sent=9000.0)
    after = stream(400, first=begins, sent=sent, received=100.0 + first * PERIOD_S + pause)
    found = Played([*before, *after])
    assert found.blind_s <= 0.05
    assert found.said[-1] == ""


@settings(max_examples=200)
@given(
    numbers=st.lists(st.integers(0, 2**32 - 1), min_size=1, max_size=2),
    at=st.integers(60, 300),
    first=st.integers(0, 2**32 - 1),
)
def test_single_odd_numbers_change_nothing(numbers, at, first):
    packets = stream(600, first=first)
    odd = [(number, *packets[at][1:]) for number in numbers]
    found = Played([*packets[:at], *odd, *packets[at:]])
    assert sum(found.accepted) >= 590
    assert found.counter.lost <= 2 * 250
    assert found.said[-1] == ""


def test_long_silence_is_counted_as_lost():
    packets = stream(3000)
    found = Played([*packets[:500], *packets[1500:]])
    assert (found.counter.lost, found.counter.restarts) == (1000, 0)
    assert found.blind_s <= 0.02


def test_old_packets_in_a_burst_are_no_new_session():
    packets = stream(1000)
    late = [(k, s, packets[-1][2] + 1e-5 * k) for k, s, _ in packets[600:700]]
    found = Played([*packets, *late])
    assert not any(found.accepted[1000:])
    assert found.counter.restarts == 0


# Senders ------------------------------------------------------------------------------------


ROBOT, AGAIN, OTHER = ("10.0.0.1", 6510), ("10.0.0.1", 6599), ("10.0.0.2", 6510)


def test_first_sender_stays_the_robot_and_its_new_connection_is_taken():
    guard = SenderGuard()
    assert guard.admits(ROBOT, 0.0) is None
    guard.hear(ROBOT, 0.0)
    assert guard.admits(OTHER, 0.01) is Refusal.SECOND_SENDER
    assert guard.admits(AGAIN, 0.05) is None
    assert guard.hear(AGAIN, 0.05)


@pytest.mark.parametrize("stranger", [AGAIN, OTHER])
def test_stranger_heard_beside_the_robot_never_takes_its_place(stranger):
    guard = SenderGuard()
    guard.hear(ROBOT, 0.0)
    assert guard.admits(stranger, 0.004) is Refusal.SECOND_SENDER
    assert guard.admits(stranger, 100.0) is Refusal.SECOND_SENDER


def test_address_that_is_set_is_the_only_one():
    guard = SenderGuard("10.0.0.2")
    assert guard.admits(ROBOT, 0.0) is Refusal.ADDRESS
    assert guard.admits(OTHER, 0.0) is None


def test_session_from_another_port_goes_on_at_once():
    reader = EgmReader(0, max_age_s=60.0)
    with udp() as one, udp() as other:
        for k in range(100):
            one.sendto(numbered(k), ("127.0.0.1", reader.port))
        assert reader.take(1.0) is not None
        time.sleep(0.03)
        other.sendto(numbered(0), ("127.0.0.1", reader.port))
        sample = reader.take(1.0)
    reader.close()
    assert sample is not None
    assert sample.sequence == 0
    assert reader.counter.restarts == 1
    assert reader.foreign == 0


# Age ----------------------------------------------------------------------------------------


def test_backlog_is_not_returned_as_the_present():
    reader = EgmReader(0, max_age_s=0.05)
    with udp() as sender:
        for k in range(50):
            sender.sendto(numbered(k), ("127.0.0.1", reader.port))
        time.sleep(0.1)
        assert reader.take(0.0) is None
        assert reader.counter.refused[Refusal.OLD] == 1
        sender.sendto(numbered(50), ("127.0.0.1", reader.port))
        assert reader.take(1.0).sequence == 50
    reader.close()
    assert reader.counter.lost == 0


def test_sample_knows_when_it_arrived():
    reader = EgmReader(0, max_age_s=10.0)
    with udp() as sender:
        sender.sendto(numbered(1), ("127.0.0.1", reader.port))
        sent_s = time.monotonic()
        time.sleep(0.1)
        sample = reader.take(1.0)
    reader.close()
    assert sample.received_s == pytest.approx(sent_s, abs=0.02)


# Content ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("raw", "refusal", "word"),
    [
        (b"", Refusal.NOT_EGM, "0 bytes"),
        (b"\xff\xff", Refusal.NOT_EGM, "2 bytes"),
        (packet(1, cartesian=False), Refusal.NO_POSE, "6 joints"),
        (packet(1, joints=(0.0,) * 7), Refusal.JOINTS, "7 joints"),
        (packet(1, joints=(0.0,) * 4), Refusal.JOINTS, "4 joints"),
        (packet(1, joints=(float("nan"),) * 6), Refusal.NOT_FINITE, ""),
        (packet(1, position=(float("inf"), 0.0, 0.0)), Refusal.NOT_FINITE, ""),
    ],
)
def test_packet_that_cannot_be_used_says_what_was_seen(raw, refusal, word):
    reason, seen = read_packet(raw, 0.0)
    assert reason is refusal
    assert word in seen
    counter = CountedStream()
    quality = StreamQuality(counter)
    for _ in range(60):
        counter.refuse(reason, seen)
    assert word in quality.look()
    assert quality.trouble == ""


def test_motors_and_program_are_read():
    on, off = read_packet(packet(1), 0.0), read_packet(packet(1, motors=False, rapid=False), 0.0)
    assert isinstance(on, EgmSample)
    assert (on.motors_on, on.rapid_running) == (True, True)
    assert (off.motors_on, off.rapid_running) == (False, False)
