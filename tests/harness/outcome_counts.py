# SPDX-License-Identifier: Apache-2.0
"""Hook of pytest: leaves the numbers of outcomes for tools/run_tests.py, which adds up two runs."""

from __future__ import annotations

import json
import os
from pathlib import Path

NAMES = {"error": "errors"}
COUNTED = ("failed", "passed", "skipped", "deselected", "xfailed", "xpassed", "warnings", "error")


def pytest_terminal_summary(terminalreporter):
    """Write them, if asked to."""
    file = os.environ.get("CABOLS_TEST_COUNTS")
    if not file:
        return
    counts = {
        NAMES.get(name, name): len(reports)
        for name, reports in terminalreporter.stats.items()
        if name in COUNTED
    }
    Path(file).write_text(json.dumps(counts), encoding="utf-8")
