# SPDX-License-Identifier: Apache-2.0
"""Names that one process of a host can have at a time, until it ends, however it ends."""

from __future__ import annotations

import errno
import socket
from hashlib import sha256


class HostClaim:
    """Holds names in Linux's abstract socket space, of which the kernel keeps account.

    Nothing is left on disk, and what a killed process held is free at once. Network namespaces have
    names of their own, as hosts have.
    """

    def __init__(self) -> None:
        """Hold none yet."""
        self._held: list[socket.socket] = []

    def take(self, name: str) -> bool:
        """Take a name, of any length; False if a process of this host has it, this one included."""
        claim = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            claim.bind(f"\0cabols_{sha256(name.encode()).hexdigest()[:32]}")
        except OSError as error:
            claim.close()
            # A system without such names hinders nobody.
            return error.errno != errno.EADDRINUSE
        self._held.append(claim)
        return True

    def release(self) -> None:
        """Give all names back."""
        while self._held:
            self._held.pop().close()
