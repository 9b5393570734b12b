# SPDX-License-Identifier: Apache-2.0
"""One blocking call in a thread of its own, watched from the executor."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any


class Worker:
    """Runs a function once.

    Attributes:
        result: what it returned; None while it runs or after a failure.
        failure: what it raised.
    """

    def __init__(self, function: Callable[[], Any]) -> None:
        """Start at once."""
        self._function = function
        self.result: Any = None
        self.failure: Exception | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def busy(self) -> bool:
        """Whether it still runs."""
        return self._thread.is_alive()

    def join(self, timeout_s: float) -> None:
        """Wait for its end."""
        self._thread.join(timeout_s)

    def _run(self) -> None:
        try:
            self.result = self._function()
        except Exception as error:
            self.failure = error
