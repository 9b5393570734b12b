# SPDX-License-Identifier: Apache-2.0
"""The robot's position stream: other senders, clocks that step, packets that cannot be used.

Sources: ros-industrial/abb_libegm#30, #41, #57, #105, #107, #119; abb_ros2#2.
"""

from __future__ import annotations

import random

import numpy as np
import pytest

from cabols_hw.abb.egm.reader import EgmReader, PacketCounter, StreamQuality
from egm_packets import PERIOD_S, numbered, udp


@pytest.fixture
def senders():
    found = [udp(), udp()]
    yield found
    for sender in found:
        sender.close()


@pytest.fixture
def reader():
    reader = EgmReader(0)
    yield reader
    reader.close()


@pytest.fixture(scope="module")
def two_senders():
    """Two units send to one port with the same numbers: whose poses were taken, what was said."""
    reader, senders = EgmReader(0), [udp(), udp()]
    quality, order = StreamQuality(reader.counter), random.Random(1)
    taken, said = [], set()
    for k in range(400):
        both = [
            (senders[0], numbered(1000 + k, position=(1000.0, 0.0, 1000.0))),
            (senders[1], numbered(1000 + k, position=(-1500.0, 200.0, 700.0))),
        ]
        # The first packet of all is the robot's.
        if k:
            order.shuffle(both)
        for sender, data in both:
            sender.sendto(data, ("127.0.0.1", reader.port))
            sample = reader.take(0.01)
            if sample is not None:
                taken.append("robot" if sample.position[0] > 0.0 else "stranger")
        said.add(quality.look())
    for each in (reader, *senders):
        each.close()
    return taken, said


def test_first_sender_stays_the_robot(two_senders):
    assert set(two_senders[0]) == {"robot"}


def test_second_sender_is_reported(two_senders):
    assert two_senders[1] - {""}


class Stream:
    """A counter and its judge, fed with (number, sent, received) of packets."""

    def __init__(self, packets):
        counter = PacketCounter(0.03)
        quality = StreamQuality(counter)
        rows = [
            (counter.take(number, sent, received), bool(quality.look()))
            for number, sent, received in packets
        ]
        accepted, self.trouble = np.array(rows).T
        edges = np.flatnonzero(np.r_[True, accepted, True])
        self.blind_s = np.diff(edges).max() * PERIOD_S
        self.counter = counter


def session_anew(after, rng):
    """Numbers and times start again from 0 and 5 s."""
    jitter = np.abs(rng.normal(0.0, 0.0005, after + 600))
    first = [(k, k * PERIOD_S, 100.0 + k * PERIOD_S + jitter[k]) for k in range(after)]
    second = [
        (k, 5.0 + k * PERIOD_S, 100.0 + (after + k) * PERIOD_S + jitter[after + k])
        for k in range(600)
    ]
    return first + second


@pytest.mark.parametrize("after", [200, 240])
def test_session_that_starts_anew_is_taken_at_once(after):
    found = Stream(session_anew(after, np.random.default_rng(1)))
    assert found.blind_s <= 0.05


def test_session_that_starts_anew_after_long_is_taken():
    found = Stream(session_anew(1000, np.random.default_rng(1)))
    assert found.blind_s <= 0.05
    assert found.counter.restarts == 1


@pytest.mark.parametrize("back_s", [1.0, 3600.0])
def test_clock_that_is_set_back_is_learnt_anew(back_s):
    jitter = np.abs(np.random.default_rng(1).normal(0.0, 0.0005, 5000))
    packets = [
        (
            k,
            9000.0 + k * PERIOD_S - (back_s if k > 1000 else 0.0),
            100.0 + k * PERIOD_S + jitter[k],
        )
        for k in range(5000)
    ]
    found = Stream(packets)
    assert not found.trouble[-1000:].any()


@pytest.mark.parametrize(
    ("address", "changes"),
    [("", {"cartesian": False}), ("", {"joints": (0.0,) * 7}), ("192.168.125.1", {})],
    ids=["no Cartesian pose", "seven joints", "another address"],
)
def test_packets_that_are_refused_are_said(senders, address, changes):
    reader, said, taken = EgmReader(0, robot_address=address), set(), 0
    quality = StreamQuality(reader.counter)
    for k in range(300):
        senders[0].sendto(numbered(k, **changes), ("127.0.0.1", reader.port))
        taken += reader.take(0.01) is not None
        said.add(quality.look())
    reader.close()
    assert taken == 0
    assert said - {""}


def test_one_forged_number_is_refused(reader, senders):
    quality, said = StreamQuality(reader.counter), set()

    def send(k, number=None):
        senders[0].sendto(numbered(k, number), ("127.0.0.1", reader.port))
        reader.take(0.1)

    for k in range(1000, 1060):
        send(k)
    quality.look()
    send(1060, 2**32 - 1)
    for k in range(1061, 1120):
        send(k)
        said.add(quality.look())
    assert reader.counter.lost < 10
    assert said == {""}


def test_numbers_wrap_and_duplicates_are_dropped():
    """Right today, to be kept."""
    counter, first = PacketCounter(0.03), 2**32 - 3
    accepted = [
        counter.take((first + k // 2) % 2**32, (k // 2) * PERIOD_S, 100.0 + (k // 2) * PERIOD_S)
        for k in range(40)
    ]
    assert accepted == [True, False] * 20
    assert counter.lost == 0
    assert counter.duplicates == 20
