# SPDX-License-Identifier: Apache-2.0
"""Answers are of samples that were sent, each later than the one before."""

from __future__ import annotations

import time

from cabols_hw.ros.answer_count import AnswerCount


def counted(sent):
    count = AnswerCount()
    for _ in range(sent):
        count.sent += 1
        count.sending()
    return count


def test_answers_are_of_samples_that_were_sent():
    count = counted(5)
    assert count.complaint(6).endswith("state 0 to 5, got 6")
    assert count.complaint(3) == ""
    assert count.take(3) == 0, "nothing is known of what was before the first"
    assert count.complaint(2).endswith("state 3 to 5, got 2")
    assert count.take(5) == 1, "sample 4 has no answer"
    assert count.take(5) == 0, "another controller's limbs"


def test_round_trip_is_since_the_sample_was_sent():
    count = counted(2000)
    now_ns = time.monotonic_ns()
    assert 0.0 <= count.round_trip_s(2000, now_ns) < 10.0
    assert count.round_trip_s(2000, now_ns + 1_000_000) > 1e-3
