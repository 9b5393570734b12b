# SPDX-License-Identifier: Apache-2.0
"""Files of a bag: their order, and what kind each is."""

from __future__ import annotations

import contextlib
import re
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import zstandard

from cabols_control.bags.errors import BagError
from cabols_control.bags.storage.salvage import Salvage
from cabols_control.bags.storage.sqlite_file import SqliteFile

MCAP, SQLITE, COMPRESSED = ".mcap", ".db3", ".zstd"


def files_of(folder: Path) -> list[Path]:
    """Files of a bag's folder in the order of recording: `b_2.mcap` before `b_10.mcap`."""
    kinds = (MCAP, SQLITE, MCAP + COMPRESSED, SQLITE + COMPRESSED)
    return sorted((path for path in folder.iterdir() if path.name.endswith(kinds)), key=_natural)


def _natural(path: Path) -> list[tuple[int, str]]:
    """Key by which numbers in a name count as numbers."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]


def listed(folder: Path, information: dict[str, Any]) -> list[Path]:
    """Files that metadata.yaml lists; those that rosbag2 compressed, under either name.

    Args:
        folder: of the bag.
        information: content of metadata.yaml.
    """
    found = []
    for name in information["relative_file_paths"]:
        path = folder / Path(str(name)).name
        packed = path.with_name(path.name + COMPRESSED)
        found.append(packed if packed.is_file() and not path.exists() else path)
    return found


@contextlib.contextmanager
def opened(path: Path, strict: bool = True) -> Iterator[Salvage | SqliteFile]:
    """Open one pass through a file: .mcap or .db3, also compressed as a whole by rosbag2.

    Args:
        path: of the file.
        strict: whether damage is an error; a .db3 must always be whole.

    Raises:
        BagError: if it is compressed, and damaged.
    """
    if path.suffix != COMPRESSED:
        yield SqliteFile(path) if path.suffix == SQLITE else Salvage(path, strict)
        return
    with tempfile.TemporaryDirectory(prefix="cabols_bag_") as folder:
        plain = Path(folder) / path.stem
        unpack(path, plain)
        yield SqliteFile(plain) if plain.suffix == SQLITE else Salvage(plain, strict)


def unpack(path: Path, plain: Path) -> None:
    """Decompress a file that rosbag2 compressed as a whole.

    Args:
        path: of the compressed file.
        plain: of the file to be written.

    Raises:
        BagError: if it is no zstd file, or damaged.
    """
    try:
        with path.open("rb") as packed, plain.open("wb") as target:
            _decompress(packed, target)
    except (OSError, zstandard.ZstdError) as error:
        raise BagError(
            f"{path}: expected a bag's file compressed by zstd, got one with {error}; "
            "record it anew, or recover the other files"
        ) from error


def _decompress(packed: IO[bytes], target: IO[bytes]) -> None:
    with zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True) as stream:
        shutil.copyfileobj(stream, target, 1 << 20)
