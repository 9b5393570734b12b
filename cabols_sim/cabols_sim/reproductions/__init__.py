# SPDX-License-Identifier: Apache-2.0
"""The source's results, recomputed: tables 3.1, 3.2, 4.2, figures 3.6, 3.8, equation (3.22)."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from cabols_control.run_report.section import ReportSection
from cabols_sim.reproductions.gain_tables import reproduce_gains
from cabols_sim.reproductions.identification import reproduce_identification
from cabols_sim.reproductions.linearity import reproduce_linearity
from cabols_sim.reproductions.stiffness import reproduce_stiffness
from cabols_sim.reproductions.tension_step import reproduce_tension_step

__all__ = [
    "REPRODUCTIONS",
    "ReportSection",
    "reproduce_gains",
    "reproduce_identification",
    "reproduce_linearity",
    "reproduce_stiffness",
    "reproduce_tension_step",
    "run_all",
]

REPRODUCTIONS: tuple[Callable[[], ReportSection], ...] = (
    reproduce_gains,
    reproduce_identification,
    reproduce_stiffness,
    reproduce_tension_step,
    reproduce_linearity,
)
JSON_NAME = "reproductions.json"


def run_all(folder: str | Path) -> dict[str, ReportSection]:
    """Compute all reproductions; write a PNG for each and reproductions.json.

    Args:
        folder: made if it is missing.

    Returns:
        The reproductions by key, in the source's order.
    """
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    found = {}
    for reproduce in REPRODUCTIONS:
        result = reproduce()
        (target / f"{result.key}.png").write_bytes(result.png())
        found[result.key] = result
    content = {
        key: {"title": result.title, "text": result.text, "numbers": plain(result.numbers)}
        for key, result in found.items()
    }
    text = json.dumps(content, indent=2, allow_nan=False)
    (target / JSON_NAME).write_text(text + "\n", encoding="utf-8")
    return found


def plain(value: Any) -> Any:
    """Return numbers for JSON: without NaN and numpy types."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "item"):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
