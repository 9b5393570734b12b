# SPDX-License-Identifier: Apache-2.0
"""Text files that somebody names: none that never ends, waits for a writer, or fills the memory."""

from __future__ import annotations

import errno
import stat
from pathlib import Path

MOST_BYTES = 64 * 2**20
"""No file that a person writes is larger; a day's programme at 100 Hz is half of it."""


def read_given(path: str | Path, encoding: str = "utf-8", most_bytes: int = MOST_BYTES) -> str:
    """Read a text file of somebody's choice, from a goal, a parameter or a command line.

    Args:
        path: of the file.
        encoding: of its text.
        most_bytes: largest one that is read.

    Raises:
        OSError: if it is no regular file (a device or a pipe may never end), is larger, or cannot
            be read.
        UnicodeDecodeError: if it is no such text.
    """
    source = Path(path)
    found = source.stat()
    if stat.S_ISDIR(found.st_mode):
        raise OSError(errno.EISDIR, "Is a directory", str(source))
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, "expected a regular file, got a device or a pipe", str(source))
    with source.open("rb") as stream:
        content = stream.read(most_bytes + 1)
    if len(content) > most_bytes:
        raise OSError(
            errno.EFBIG, f"expected at most {most_bytes // 2**20} MiB, got more", str(source)
        )
    return content.decode(encoding).replace("\r\n", "\n").replace("\r", "\n")
