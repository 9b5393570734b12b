# SPDX-License-Identifier: Apache-2.0
"""Finished reports of stiffness campaigns."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

REPORT = "report.html"
SHOWN_SUFFIXES = (".html", ".png", ".svg", ".yaml", ".csv", ".json")


@dataclass(frozen=True)
class Report:
    """One finished report.

    Attributes:
        name: of the campaign's folder, relative to the root.
        changed_s: when it was written, seconds since 1970.
    """

    name: str
    changed_s: float


def finished(root: Path, most: int = 50) -> list[Report]:
    """Reports in the folders of a root, newest first.

    Args:
        root: folder of campaigns.
        most: number of reports that are returned.
    """
    found = [_report(path) for path in root.glob(f"*/{REPORT}")]
    return sorted(filter(None, found), key=lambda report: -report.changed_s)[:most]


def _report(path: Path) -> Report | None:
    try:
        return Report(path.parent.name, path.stat().st_mtime)
    except OSError:
        return None  # removed meanwhile


def report_file(root: Path, name: str) -> Path | None:
    """Path of a file of a report; None if there is none, or it is not inside the root.

    Args:
        root: folder of campaigns.
        name: as in the address, `<campaign>/<file>`.
    """
    inside = root.resolve()
    try:
        path = (inside / name).resolve()
        if not path.is_relative_to(inside) or path.suffix not in SHOWN_SUFFIXES:
            return None
        return path if path.is_file() else None
    except (OSError, ValueError):
        return None  # a name that no file system takes: too long, with a zero byte, a loop of links
