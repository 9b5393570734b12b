# SPDX-License-Identifier: Apache-2.0
"""A word to who waits for a node that compiles, as it does where it has never run before."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from rclpy.logging import get_logger

from cabols_control.topics import NAMESPACE

QUIET_S = 5.0
"""Time that a start may take without a word [s]; with compiled loops it takes one to three."""
SAID = (
    "still starting: where it has not run before, a node compiles its inner loops first, which "
    "takes a minute or two; later starts take seconds"
)


@contextmanager
def told_if_slow(quiet_s: float = QUIET_S) -> Iterator[None]:
    """Log what a start probably waits for, once, if what is done inside takes longer than a while.

    Args:
        quiet_s: how long nothing is said [s].
    """
    word = threading.Timer(quiet_s, lambda: get_logger(NAMESPACE.strip("/")).info(SAID))
    word.daemon = True
    word.start()
    try:
        yield
    finally:
        word.cancel()
        word.join()
