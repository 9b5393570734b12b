# SPDX-License-Identifier: Apache-2.0
"""Hooks of pytest for tools/run_tests.py: numbers of outcomes, files that are left out."""

from __future__ import annotations

import json
import os
from pathlib import Path

NAMES = {"error": "errors"}
COUNTED = ("failed", "passed", "skipped", "deselected", "xfailed", "xpassed", "warnings", "error")


FIRST_WORKER = "gw0"
MARKS = "CABOLS_TEST_MARKS"
"""Environment variable: a test file that has none of these words is not even imported."""


def pytest_ignore_collect(collection_path):
    """Leave out a test file whose tests have none of the marks that are asked for."""
    words = os.environ.get(MARKS, "").split()
    if not words or not collection_path.name.startswith("test_"):
        return None
    text = collection_path.read_text(encoding="utf-8")
    return None if any(word in text for word in words) else True


def pytest_deselected(items):
    """Count them in a worker: the process that adds up the workers' outcomes does not."""
    file = os.environ.get("CABOLS_TEST_COUNTS")
    if file and os.environ.get("PYTEST_XDIST_WORKER") == FIRST_WORKER:
        with Path(f"{file}.deselected").open("a", encoding="utf-8") as found:
            found.write(f"{len(items)}\n")


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
