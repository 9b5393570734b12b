# SPDX-License-Identifier: Apache-2.0
"""Folders that commands fill: what a command did not write, no command deletes or overwrites.

A folder that a command makes carries the file `.cabols_output`: which command, whether its run came
to its end, and every file that it left. A later run of a command

- replaces what a finished run left, file by file from that list;
- moves what an unfinished run left (a crash, Ctrl-C) to a folder beside it, and says so;
- refuses a folder that holds anything else.
"""

from __future__ import annotations

import fcntl
import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import IO

from cabols_control.errors import UsageError

MARKER = ".cabols_output"
VERSION = 1
SHOWN = 3
"""Most foreign files that a refusal names."""


class OccupiedFolderError(UsageError):
    """An output folder holds what no command wrote, or is in use."""


@dataclass
class Contents:
    """What the marker says.

    Attributes:
        command: that filled the folder.
        began: local time of the start, as text for people.
        finished: whether the run came to its end.
        listed: whether `files` is all that runs left, and nothing else; False while a run goes on,
            and from a crash on.
        files: left by runs, relative to the folder.
        version: of this format.
    """

    command: str
    began: str
    finished: bool = False
    listed: bool = False
    files: list[str] = field(default_factory=list)
    version: int = VERSION


class OutputFolder:
    """A folder that this process may fill.

    Attributes:
        path: of the folder.
        said: what was moved aside, as a sentence; empty if nothing was.
    """

    def __init__(
        self,
        path: Path,
        contents: Contents,
        foreign: set[str] | None,
        lock: IO[str] | None,
        said: str,
    ) -> None:
        """Use `claim` instead; foreign: files of others, None if that is not known."""
        self.path = path
        self.said = said
        self._contents = contents
        self._foreign = foreign
        self._lock = lock

    def finish(self) -> None:
        """Note that the run came to its end."""
        self._contents.finished = True
        self._list()

    def release(self) -> None:
        """List the files, and release the folder."""
        self._list()
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def _list(self) -> None:
        if not self.path.is_dir():
            return
        self._contents.files = sorted(set(_files(self.path)) - (self._foreign or set()))
        self._contents.listed = self._foreign is not None
        _write(self.path, self._contents)


def claim(path: str | Path, command: str, keep: bool = False, shared: bool = False) -> OutputFolder:
    """Make an output folder, or take one over that an earlier run made.

    Args:
        path: of the folder.
        command: name of the command, for the marker.
        keep: continue with the files of earlier runs instead of replacing them.
        shared: do not ask for the folder alone: for a command that runs beside, or inside, the one
            that made it.

    Returns:
        The folder; call `finish` at the end of a run that came to its end, `release` in any case.

    Raises:
        OccupiedFolderError: if there is anything that no command wrote, or another run uses it.
        UsageError: if the folder cannot be made.
    """
    # The folder that a link names is the one that would be moved or emptied.
    folder = Path(os.path.realpath(path))
    try:
        if not folder.is_dir() and (folder.exists() or folder.is_symlink()):
            raise OccupiedFolderError(
                f"{path}: expected an output folder, got a file; name another folder"
            )
        return _claim(Path(path), folder, command, keep, shared)
    except OSError as error:
        raise UsageError(
            f"{path}: expected to make the output folder, got {error.strerror or error}; "
            "name another folder"
        ) from error


@contextmanager
def output_folder(
    path: str | Path,
    command: str,
    keep: bool = False,
    shared: bool = False,
    say: Callable[[str], object] | None = None,
) -> Iterator[OutputFolder]:
    """Claim a folder and release it; see `claim`. `say` gets a line for what was moved aside.

    Args:
        path: of the folder; made where it is missing.
        command: that writes into it, for its marker.
        keep: whether what an earlier run of a command left there stays.
        shared: whether other commands may write into it, too.
        say: gets a line for what was moved aside.
    """
    folder = claim(path, command, keep, shared)
    if folder.said:
        (say or _print)(folder.said)
    try:
        yield folder
    finally:
        folder.release()


def _print(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _claim(shown: Path, folder: Path, command: str, keep: bool, shared: bool) -> OutputFolder:
    now = datetime.now(timezone.utc).astimezone()
    contents = Contents(command, f"{now:%Y-%m-%d %H:%M:%S}")
    before, said = _read(folder), ""
    there = set(_files(folder)) if folder.is_dir() else set()
    if before is None and there:
        raise _occupied(shown, sorted(there))
    foreign: set[str] | None = set()
    if before is not None and keep:
        foreign = there - set(before.files) if before.listed else None
        contents = before if shared else replace(contents, files=before.files)
    elif before is not None:
        with _locked(shown, folder):
            said = _clear(shown, folder, before, now)
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / MARKER).exists():
        _write(folder, contents)
    lock = None if shared else _lock(shown, folder)
    if not (shared and keep):
        _write(folder, contents)
    return OutputFolder(shown, contents, foreign, lock, said)


def _clear(shown: Path, folder: Path, before: Contents, now: datetime) -> str:
    """Empty a folder of a finished run; move that of an unfinished one aside, and say so."""
    if not (before.finished and before.listed):
        aside = _beside(folder, f"{folder.name}_unfinished_{now:%Y-%m-%d_%H-%M-%S}")
        folder.rename(aside)
        return (
            f"{shown}: the run of `{before.command}` of {before.began} may have been cut "
            f"short; what is left of it is kept in {shown.parent / aside.name}"
        )
    foreign = sorted(set(_files(folder)) - set(before.files))
    if foreign:
        raise _occupied(shown, foreign)
    for name in before.files:
        (folder / name).unlink(missing_ok=True)
    parents = {parent for name in before.files for parent in Path(name).parents}
    for place in sorted(parents - {Path()}, key=lambda p: len(p.parts), reverse=True):
        with suppress(OSError):  # not empty, or gone
            (folder / place).rmdir()
    return ""


def _beside(folder: Path, name: str) -> Path:
    """Return a path that is not there yet."""
    found, number = folder.with_name(name), 1
    while found.exists():
        number += 1
        found = folder.with_name(f"{name}_{number}")
    return found


def _occupied(shown: Path, foreign: list[str]) -> OccupiedFolderError:
    names = ", ".join(foreign[:SHOWN]) + (", ..." if len(foreign) > SHOWN else "")
    return OccupiedFolderError(
        f"{shown}: expected a new or empty folder, or one that a cabols command made, got one with "
        f"{names}; nothing was touched: name another --output, or move these files"
    )


def _files(folder: Path) -> Iterator[str]:
    """Yield every file of a folder but the marker, relative to it; links are not followed."""
    for place, folders, names in os.walk(folder):
        links = [name for name in folders if (Path(place) / name).is_symlink()]
        for name in (*names, *links):
            relative = str((Path(place) / name).relative_to(folder))
            if relative != MARKER:
                yield relative


def _read(folder: Path) -> Contents | None:
    """What the marker says; None without one, or with one that cannot be understood."""
    try:
        content = json.loads((folder / MARKER).read_text(encoding="utf-8"))
        found = Contents(**content)
    except (OSError, ValueError, TypeError):
        return None
    if not isinstance(found.files, list) or found.version != VERSION:
        return None
    return found


def _write(folder: Path, contents: Contents) -> None:
    # In place, not by renaming: a lock on the file must stay one on the file that others see.
    text = json.dumps(asdict(contents), indent=1) + "\n"
    with (folder / MARKER).open("a+", encoding="utf-8") as file:
        file.truncate(0)
        file.write(text)


@contextmanager
def _locked(shown: Path, folder: Path) -> Iterator[None]:
    lock = _lock(shown, folder)
    try:
        yield
    finally:
        lock.close()


def _lock(shown: Path, folder: Path) -> IO[str]:
    file = (folder / MARKER).open("r", encoding="utf-8")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        raise OccupiedFolderError(
            f"{shown}: expected a folder that no other command is filling, got one in use; "
            "wait for the other command, or name another --output"
        ) from None
    except OSError:
        # Not every file system has locks.
        pass
    return file
