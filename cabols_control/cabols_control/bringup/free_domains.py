# SPDX-License-Identifier: Apache-2.0
"""DDS domains of this computer that no other run of this user has claimed."""

from __future__ import annotations

import fcntl
import os
import random
import tempfile
from collections import deque
from pathlib import Path
from typing import IO

SAFE_DOMAINS = range(1, 102)
"""Domain ids whose ports do not reach into Linux' ephemeral range."""
KEPT = 20
"""Newest claims that a process keeps: what ended in one of them may still be heard for a while."""
FOLDER = Path(tempfile.gettempdir()) / f"cabols_domains_{os.getuid()}"
_claims: deque[IO[str]] = deque(maxlen=KEPT)
"""Files that are locked as long as they are open: until this process ends, however it does."""


def claim_domain() -> int:
    """Return a domain that no living process has claimed; any one where all are, or none can be."""
    domains = random.SystemRandom().sample(SAFE_DOMAINS, len(SAFE_DOMAINS))
    for domain in domains:
        if (claim := _lock(domain)) is not None:
            _claims.append(claim)
            return domain
    return domains[0]


def _lock(domain: int) -> IO[str] | None:
    try:
        FOLDER.mkdir(exist_ok=True)
        file = (FOLDER / f"{domain}.lock").open("w")
    except OSError:
        return None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        file.close()
        return None
    return file
