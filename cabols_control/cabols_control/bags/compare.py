# SPDX-License-Identifier: Apache-2.0
"""Comparing bags: two lockstep runs must record the same bytes."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

from cabols_control.bags.reader import iterate
from cabols_control.stamps import first_stamp


def payload_digest(folder: str | Path) -> dict[str, str]:
    """Digest the messages of each topic; times of recording do not count.

    Messages count in the order of their stamps (and of their bytes where stamps are equal): several
    nodes may write to one topic (loop_status), and which of them arrives first is chance.

    Args:
        folder: of the bag.

    Returns:
        By topic relative to /cabols, SHA-256 (hex) of all serialised messages.

    Raises:
        BagError: if the bag cannot be read or is empty.
    """
    payloads: dict[str, list[bytes]] = {}
    for topic, _, data in iterate(folder):
        payloads.setdefault(topic, []).append(data)
    digests = {}
    for topic, messages in sorted(payloads.items()):
        digest = sha256()
        for data in sorted(messages, key=lambda data: (first_stamp(data), data)):
            digest.update(data)
        digests[topic] = digest.hexdigest()
    return digests
