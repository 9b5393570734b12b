# SPDX-License-Identifier: Apache-2.0
"""Load programmes that an operator uploads; each is checked before it is stored."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from cabols_control.errors import CabolsError
from cabols_control.load_programs.programs import BUILT_IN, LoadProgram, parse_csv

UPLOAD_BYTES = 2_000_000
ROWS = 50_000
DURATION_S = 3600.0
KEPT = 200
"""Most files in the folder; beyond it an upload is refused until some are deleted by hand."""


class UploadError(CabolsError):
    """An upload that is refused; the message says what was expected and what came."""


@dataclass(frozen=True, eq=False)
class Upload:
    """A programme that was stored.

    Attributes:
        path: of the CSV file.
        program: what is in it.
    """

    path: Path
    program: LoadProgram


def safe_stem(name: str) -> str:
    """Return a file's stem from a name that a browser sent: letters, digits, - and _ only.

    Raises:
        UploadError: if it does not end in .csv, or nothing is left.
    """
    last = re.split(r"[/\\]", name)[-1]
    stem, dot, suffix = last.rpartition(".")
    if not dot or suffix.lower() != "csv":
        raise UploadError(f"expected a .csv file, got {last[:80]!r}")
    cleaned = re.sub(r"[^A-Za-z0-9_-]+", "_", stem).strip("_")[:60]
    if not cleaned:
        raise UploadError(f"expected a name with letters or digits, got {last[:80]!r}")
    return cleaned


def check_upload(name: str, content: bytes) -> tuple[str, LoadProgram]:
    """Read an uploaded programme.

    Args:
        name: of the file as the browser gives it.
        content: its bytes.

    Returns:
        Its safe stem and the programme.

    Raises:
        UploadError: for a name, size, encoding or length that is not allowed.
        ConfigError: naming the line that cannot be used.
    """
    stem = safe_stem(name)
    if len(content) > UPLOAD_BYTES:
        raise UploadError(f"expected at most {UPLOAD_BYTES} bytes, got {len(content)}")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise UploadError(f"{stem}.csv: expected UTF-8 text ({error.reason})") from error
    lines = text.count("\n")
    if lines > ROWS:
        raise UploadError(f"{stem}.csv: expected at most {ROWS} lines, got {lines}")
    program = parse_csv(text, stem, f"{stem}.csv")
    if not program.duration <= DURATION_S:
        raise UploadError(
            f"{stem}.csv: expected at most {DURATION_S:g} s, got {program.duration:g} s"
        )
    return stem, program


def keep_upload(folder: Path, name: str, content: bytes) -> Upload:
    """Check an uploaded programme and write it; one of the same name is replaced.

    Args:
        folder: of the uploaded programmes.
        name: of the file as the browser gives it.
        content: its bytes.

    Raises:
        UploadError: as check_upload, or if the folder is full or cannot be written.
        ConfigError: naming the line that cannot be used.
    """
    stem, program = check_upload(name, content)
    path = folder / f"{stem}.csv"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not path.exists() and len(list(folder.glob("*.csv"))) >= KEPT:
            raise UploadError(f"{folder}: expected fewer than {KEPT} files; delete some")
        partial = path.with_suffix(".partial")
        # Without the byte order mark that check_upload accepts.
        partial.write_text(content.decode("utf-8-sig"), encoding="utf-8", newline="")
        partial.replace(path)
    except OSError as error:
        raise UploadError(f"{path}: cannot be written ({error})") from error
    return Upload(path.resolve(), program)


def program_choices(folder: Path) -> dict[str, str]:
    """Programmes that can be chosen: what run_program takes, and how it is shown."""
    found = {name: f"{name} (built in)" for name in sorted(BUILT_IN)}
    for path in sorted(folder.glob("*.csv")):
        found[str(path.resolve())] = f"{path.stem} (uploaded)"
    return found
