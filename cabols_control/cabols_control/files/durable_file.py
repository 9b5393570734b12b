# SPDX-License-Identifier: Apache-2.0
"""Small files that survive a cut of the power: complete, or as they were before."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path


def write_durably(path: Path, text: str) -> None:
    """Write a file atomically.

    Args:
        path: of the file, in a folder that exists.
        text: of the file, in UTF-8.

    Raises:
        OSError: if it cannot be written; a file that was there before is as it was.
    """
    draft = path.with_name(path.name + ".new")
    with draft.open("w", encoding="utf-8") as stream:
        stream.write(text)
        stream.flush()
        os.fsync(stream.fileno())
    draft.replace(path)
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Put a folder's entries on the disk, where the file system supports it."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
