"""Quality of service of every cabols topic, and why."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

LOCKSTEP_DEPTH = 1000


def control_qos(lockstep: bool) -> QoSProfile:
    """Samples and commands at the control rate: a late one is useless, only the newest counts.

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
    """State that a late joiner must know at once: the mode."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=LOCKSTEP_DEPTH if lockstep else 1,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


def status_qos() -> QoSProfile:
    """Low-rate reports, where none should be lost."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=100, reliability=ReliabilityPolicy.RELIABLE
    )
