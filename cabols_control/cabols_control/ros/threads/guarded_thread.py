# SPDX-License-Identifier: Apache-2.0
"""A thread of a node that ends with the context, and that shuts it down if it fails."""

from __future__ import annotations

import threading

from rclpy.context import Context


class GuardedThread:
    """Base of threads beside the executor: start, stop, and the failure that ended them.

    Attributes:
        failure: the error that ended the thread; None without one.
    """

    def __init__(self, context: Context, name: str) -> None:
        """Prepare; start() begins. An exception of `body` shuts the context down."""
        self._context = context
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._guard, name=name, daemon=True)
        self.failure: BaseException | None = None

    def body(self) -> None:
        """Work until `running` is False."""
        raise NotImplementedError

    @property
    def running(self) -> bool:
        """Whether the thread should continue."""
        return not self._stop.is_set() and self._context.ok()

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread; returns within a second."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(timeout=1.0)

    def _guard(self) -> None:
        try:
            self.body()
        except BaseException as error:
            # Publishing into a context that a signal has just shut down is no failure.
            if self._context.ok():
                self.failure = error
                self._context.try_shutdown()
