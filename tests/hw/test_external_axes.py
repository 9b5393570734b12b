# SPDX-License-Identifier: Apache-2.0
"""External axes beside six joints: carried while they stand, refused by name once one moves."""

from __future__ import annotations

import pytest
from abb_robot_client._egm_protobuf import egm_pb2

from cabols_hw.abb.egm.reader import EgmReader
from cabols_hw.abb.egm.stream_quality import Refusal
from egm_packets import numbered, udp


def with_axes(k, *axes):
    """Packet k with external axes [deg or mm]."""
    message = egm_pb2.EgmRobot()
    message.ParseFromString(numbered(k))
    message.feedBack.externalJoints.joints.extend(axes)
    return message.SerializeToString()


@pytest.fixture
def stream():
    # How long a busy machine keeps a packet waiting is no finding here.
    reader, sender = EgmReader(0, max_age_s=60.0), udp()

    def send(raw):
        sender.sendto(raw, ("127.0.0.1", reader.port))
        return reader.take(0.3)

    yield reader, send
    reader.close()
    sender.close()


@pytest.mark.parametrize("axes", [(), (1250.0,), (0.0, -90.0), (10.0,) * 6])
def test_axes_that_stand_are_carried(stream, axes):
    reader, send = stream
    for k in range(5):
        sample = send(with_axes(k, *(axis + 0.01 * (k % 2) for axis in axes)))
        assert len(sample.external) == len(axes)
        assert sample.joints.shape == (6,)
    assert reader.counter.refused[Refusal.EXTERNAL_AXIS] == 0


@pytest.mark.parametrize(
    ("later", "seen"),
    [
        ((1250.2, 3.0), "axis 1 went from 1250 to 1250"),
        ((1250.0, 8.0), "axis 2 went from 3 to 8"),
        ((1250.0,), "1 external axes, 2 before"),
        ((), "0 external axes, 2 before"),
        ((1250.0, float("nan")), "axis 2 went from 3 to nan"),
    ],
)
def test_an_axis_that_moves_is_refused_and_named(stream, later, seen):
    reader, send = stream
    assert send(with_axes(0, 1250.0, 3.0)) is not None
    assert send(with_axes(1, *later)) is None
    assert reader.counter.refused[Refusal.EXTERNAL_AXIS] == 1
    assert seen in reader.counter.seen[Refusal.EXTERNAL_AXIS]
    # Back where it was, all is as before.
    assert send(with_axes(2, 1250.0, 3.0)) is not None
