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
    """Reports in the folders of a root, newest first."""
    found = []
    for path in root.glob(f"*/{REPORT}"):
        try:
            found.append(Report(path.parent.name, path.stat().st_mtime))
        except OSError:
            continue  # removed meanwhile
    return sorted(found, key=lambda report: -report.changed_s)[:most]


def report_file(root: Path, name: str) -> Path | None:
    """Path of a file of a report; None if there is none, or it is not inside the root.

    Args:
        root: folder of campaigns.
        name: as in the address, `<campaign>/<file>`.
    """
    inside = root.resolve()
    path = (inside / name).resolve()
    if not path.is_relative_to(inside) or path.suffix not in SHOWN_SUFFIXES:
        return None
    return path if path.is_file() else None
