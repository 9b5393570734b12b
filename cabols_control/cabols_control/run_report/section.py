# SPDX-License-Identifier: Apache-2.0
"""A section of a report beside the recorded run: text, numbers, a table, a picture."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Any

from matplotlib.figure import Figure

from cabols_control.checks import FloatArray
from cabols_control.run_report.pictures.run_figures import DPI


@dataclass(frozen=True, eq=False)
class ReportSection:
    """A computed result with its picture and its table, for a report.

    Attributes:
        key: short name, stem of its files.
        title: what it is, with the source's number.
        text: method and result, one paragraph.
        numbers: results; every key ends in its unit.
        header: of the table.
        rows: of the table.
        figure: drawn.
        data: arrays behind the figure, SI units.
    """

    key: str
    title: str
    text: str
    numbers: dict[str, Any]
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    figure: Figure
    data: dict[str, FloatArray]

    def png(self) -> bytes:
        """Return the figure as a PNG picture."""
        stream = io.BytesIO()
        self.figure.savefig(stream, format="png", dpi=DPI)
        return stream.getvalue()
