# SPDX-License-Identifier: Apache-2.0
"""The signals that ask a process to end, from its first line on: none ends it half made.

Until a process can end in order it holds them back: they wait, through exec as well, and are
handled as soon as it is ready for them.
"""

from __future__ import annotations

import shutil
import signal
import subprocess
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import FrameType

END_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
"""Ctrl-C, a service manager's request, a terminal that was closed, Ctrl-\\."""


def hold() -> None:
    """Let the signals wait."""
    signal.pthread_sigmask(signal.SIG_BLOCK, END_SIGNALS)


@cache
def holding_words() -> list[str]:
    """Words before a command that let the signals to end wait until the command handles them.

    A node that is interrupted while Python still imports would end with a traceback. GNU's env
    can hold signals back; where there is another one, or none, nothing is put before a command.
    """
    held = [f"--block-signal={signal.Signals(each).name[3:]}" for each in END_SIGNALS]
    words = ["env", *held]
    if shutil.which("env") is None:
        return []
    tried = subprocess.run([*words, "true"], capture_output=True, check=False)
    return words if tried.returncode == 0 else []


def held_by(pid: int) -> bool:
    """Whether another process holds them back: it still starts, and has opened nothing.

    Args:
        pid: of a process that began by holding them.
    """
    try:
        status = Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
    except OSError:
        return False
    fields = dict(row.split(":", 1) for row in status.splitlines() if ":" in row)
    mask = int(fields.get("SigBlk", "0"), 16)
    return all(mask >> (number - 1) & 1 for number in END_SIGNALS)


def handle(hear: Callable[[int, FrameType | None], object]) -> None:
    """Handle them from now on, those that have waited at once; main thread only.

    A hang-up that the parent lets its children ignore, as `nohup` does, stays ignored.

    Args:
        hear: gets the signal's number and the frame that it interrupts.
    """
    for number in END_SIGNALS:
        if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, hear)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, END_SIGNALS)


def ignore() -> None:
    """Ignore them: the process has ended in order, and only the interpreter is left."""
    for number in END_SIGNALS:
        signal.signal(number, signal.SIG_IGN)
