# SPDX-License-Identifier: Apache-2.0
"""Whether the process that launched this one still lives; ROS-free."""

from __future__ import annotations

import os
from contextlib import suppress

from cabols_control.bringup.specs import LAUNCHER


class LauncherWatch:
    """Follows the launcher that is named in the environment, if one is.

    Where the launcher is the parent, its death is seen by the parent that a child then gets;
    otherwise it has died before this process looked, or there is a program between the two, and
    its process id is watched.
    """

    def __init__(self) -> None:
        """Read the environment."""
        named = os.environ.get(LAUNCHER, "")
        self._launcher = int(named) if named.isdecimal() else 0
        self._is_parent = self._launcher == os.getppid()

    @property
    def is_dead(self) -> bool:
        """Whether there was a launcher, and it has ended."""
        if not self._launcher:
            return False
        if self._is_parent:
            return os.getppid() != self._launcher
        with suppress(PermissionError):
            try:
                os.kill(self._launcher, 0)
            except ProcessLookupError:
                return True
        return False
