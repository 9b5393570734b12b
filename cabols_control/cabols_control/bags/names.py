# SPDX-License-Identifier: Apache-2.0
"""Names in a bag: topics absolute on disk, relative for people; types with their middle part."""

from __future__ import annotations

from cabols_control.topics import NAMESPACE


def absolute(topic: str) -> str:
    """Full name of a topic: `limb_state` is `/cabols/limb_state`, `/tf` stays."""
    return topic if topic.startswith("/") else f"{NAMESPACE}/{topic}"


def relative(topic: str) -> str:
    """Name below the namespace: `/cabols/limb_state` is `limb_state`, `/tf` stays."""
    return topic.removeprefix(NAMESPACE + "/")


def type_of(name: str) -> str:
    """Name of a type as ROS 2 has it; old writers leave `/msg/` out."""
    package, slash, rest = name.partition("/")
    return f"{package}/msg/{rest}" if slash and package and rest and "/" not in rest else name
