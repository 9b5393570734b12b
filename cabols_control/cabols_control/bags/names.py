"""Names of topics in a bag: absolute on disk, relative to the namespace for people."""

from __future__ import annotations

from cabols_control.topics import NAMESPACE


def absolute(topic: str) -> str:
    """Full name of a topic: `limb_state` is `/cabols/limb_state`, `/tf` stays."""
    return topic if topic.startswith("/") else f"{NAMESPACE}/{topic}"


def relative(topic: str) -> str:
    """Name below the namespace: `/cabols/limb_state` is `limb_state`, `/tf` stays."""
    return topic.removeprefix(NAMESPACE + "/")
