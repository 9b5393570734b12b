# SPDX-License-Identifier: Apache-2.0
"""When the recorder joins a topic of the control loop."""

from cabols_control.bags.join_policy import PATIENCE_S, SETTLE_S, JoinPolicy


def first(looks):
    """Return the time of the first look, of (time, published, read), after which to join."""
    policy = JoinPolicy()
    return next((now for now, *seen in looks if policy.over(now, *seen)), None)


def every_10_ms(until_s, published_s, read_s):
    return [
        (0.01 * k, 0.01 * k >= published_s, 0.01 * k >= read_s) for k in range(int(100 * until_s))
    ]


def test_a_topic_that_is_served_is_joined_once_its_publisher_has_met_the_reader():
    assert abs(first(every_10_ms(5.0, 1.0, 0.0)) - (1.0 + SETTLE_S)) < 0.02
    assert abs(first(every_10_ms(5.0, 1.0, 1.2)) - (1.2 + SETTLE_S)) < 0.02


def test_nobody_is_waited_for_for_ever():
    assert abs(first(every_10_ms(5.0, 1.0, 99.0)) - (1.0 + PATIENCE_S)) < 0.02


def test_without_a_publisher_there_is_nothing_to_miss():
    assert first(every_10_ms(60.0, 99.0, 0.0)) is None


def test_a_publisher_that_goes_and_comes_back_begins_anew():
    looks = [(0.0, True, True), (0.2, False, True), (0.4, True, True), (0.6, True, True)]
    assert first(looks) is None
    assert first([*looks, (0.41 + SETTLE_S, True, True)]) == 0.41 + SETTLE_S
