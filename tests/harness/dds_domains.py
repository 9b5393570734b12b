# SPDX-License-Identifier: Apache-2.0
"""DDS domains for tests: a block of its own for each process of tests on this machine."""

from __future__ import annotations

import fcntl
import functools
import itertools
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

DOMAINS = range(1, 101)
"""Above 101 DDS ports reach into those that Linux gives to clients."""
BLOCK = 20
FOLDER = Path(tempfile.gettempdir()) / f"cabols_dds_domains_{os.getuid()}"
_CLAIMED: list[IO[str]] = []
"""Locked as long as this process lives."""


def claim_block() -> range:
    """A block that no living process of tests has claimed; the last one if all are taken."""
    FOLDER.mkdir(exist_ok=True)
    blocks = [range(first, first + BLOCK) for first in range(DOMAINS.start, DOMAINS.stop, BLOCK)]
    for block in blocks:
        file = (FOLDER / f"{block.start}.lock").open("w")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.close()
            continue
        _CLAIMED.append(file)
        return block
    return blocks[-1]


@functools.cache
def _domains() -> Iterator[int]:
    return itertools.cycle(claim_block())


def next_domain() -> int:
    """A domain that no other test of this process used of late, and no other process uses."""
    return next(_domains())
