# SPDX-License-Identifier: Apache-2.0
"""Quality of service of every cabols topic, and why."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from cabols_control.topics import LIVE, Quality, topic_row

LOCKSTEP_DEPTH = 1000


def topic_qos(topic: str, lockstep: bool = False, depth: int | None = None) -> QoSProfile:
    """Return the quality of a topic, as its row in cabols_control.topics says.

    Args:
        topic: its name, relative to the namespace.
        lockstep: whether the graph's clock waits for answers.
        depth: of the queue, for a reader that keeps more, or less, than the topic's own.

    Raises:
        KeyError: if the graph has no such topic.
    """
    quality = Quality.LIVE if topic.startswith(LIVE) else topic_row(topic).quality
    profile = quality_qos(quality, lockstep)
    if depth is not None:
        profile.depth = depth
    return profile


def quality_qos(quality: Quality, lockstep: bool = False) -> QoSProfile:
    """Return the quality of service that a row's quality stands for.

    Args:
        quality: of the topic's table.
        lockstep: whether the clock waits for each message.
    """
    if quality == Quality.CONTROL:
        profile = control_qos(lockstep)
    elif quality == Quality.LIVE:
        profile = control_qos(lockstep=False)
    elif quality == Quality.REPORT:
        profile = status_qos()
    else:
        profile = latched_qos(lockstep and quality == Quality.MODE)
    return profile


def control_qos(lockstep: bool) -> QoSProfile:
    """Return the quality of samples and commands at the control rate, where only the newest counts.

    In lockstep nothing may be lost, as the clock waits for each answer: reliable and deep.
    """
    if lockstep:
        return QoSProfile(
            history=HistoryPolicy.KEEP_LAST,
            depth=LOCKSTEP_DEPTH,
            reliability=ReliabilityPolicy.RELIABLE,
        )
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=1, reliability=ReliabilityPolicy.BEST_EFFORT
    )


def latched_qos(lockstep: bool) -> QoSProfile:
    """Return the quality of a state that a late reader needs at once, such as the mode.

    In lockstep deep, as the clock waits for each message.
    """
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=LOCKSTEP_DEPTH if lockstep else 1,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


def status_qos() -> QoSProfile:
    """Return the quality of low-rate reports, of which none should be lost."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=100, reliability=ReliabilityPolicy.RELIABLE
    )
