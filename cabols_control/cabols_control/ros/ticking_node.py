# SPDX-License-Identifier: Apache-2.0
"""A node whose work is done at a fixed rate, in a thread of its own."""

from __future__ import annotations

from cabols_control.ros.node import ControlNode
from cabols_control.ros.threads.ticker import Ticker


class TickingNode(ControlNode):
    """Calls tick() once a period from begin() to end()."""

    def __init__(self, name: str, period_s: float) -> None:
        """Make the node.

        Args:
            name: of the node.
            period_s: between two calls [s].
        """
        super().__init__(name)
        self._ticker = Ticker(self.context, period_s, self.tick)

    def tick(self) -> None:
        """Do what is due."""
        raise NotImplementedError

    def begin(self) -> None:
        """Start the thread."""
        super().begin()
        self._ticker.start()

    def end(self) -> None:
        """Stop it."""
        self._ticker.stop()

    @property
    def failure(self) -> BaseException | None:
        """Return the error that ended the thread."""
        return self._ticker.failure
