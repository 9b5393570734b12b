# SPDX-License-Identifier: Apache-2.0
"""Which other programs keep this computer busy, from /proc: what to close."""

from __future__ import annotations

import os
import time
from contextlib import suppress
from pathlib import Path

PROC = Path("/proc")
OVER_S = 0.5
WORTH_PERCENT = 5.0


def processor_seconds(proc: Path = PROC) -> dict[int, tuple[str, float]]:
    """Return name and processor time [s] of every process but this one, by process id."""
    tick = os.sysconf("SC_CLK_TCK")
    found = {}
    for folder in proc.iterdir():
        if not folder.name.isdigit() or int(folder.name) == os.getpid():
            continue
        with suppress(OSError, ValueError, IndexError):
            text = (folder / "stat").read_text(encoding="utf-8", errors="replace")
            # The name stands in brackets and may hold brackets and blanks itself.
            name = text[text.index("(") + 1 : text.rindex(")")]
            rest = text[text.rindex(")") + 2 :].split()
            user, system = rest[11:13]
            found[int(folder.name)] = (name, (int(user) + int(system)) / tick)
    return found


def busiest(count: int = 3, over_s: float = OVER_S) -> list[tuple[str, float]]:
    """Return names and loads [percent of a core] of the busiest other programs, largest first.

    Args:
        count: of programs that are returned.
        over_s: time over which loads are measured [s].
    """
    before = processor_seconds()
    time.sleep(over_s)
    loads: dict[str, float] = {}
    for number, (name, used_s) in processor_seconds().items():
        spent = used_s - before.get(number, (name, used_s))[1]
        loads[name] = loads.get(name, 0.0) + 100.0 * spent / over_s
    found = sorted(loads.items(), key=lambda item: item[1], reverse=True)
    return [(name, load) for name, load in found[:count] if load >= WORTH_PERCENT]
