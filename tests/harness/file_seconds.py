# SPDX-License-Identifier: Apache-2.0
"""What each file of tests took once: file_seconds.json, by which longest_first.py orders them.

A file's tests that start nodes count apart from its others, as they run in another part.
`CABOLS_TEST_SECONDS=1 make test` renews the numbers.
"""

from __future__ import annotations

import json
import os
from collections import Counter
from pathlib import Path

FILE = Path(__file__).with_suffix(".json")
TESTS = FILE.parents[1]
RENEW = "CABOLS_TEST_SECONDS"
LEAST_S = 2.0
"""Files that take less are not worth a line [s]."""


def starts_nodes(marks):
    """Whether a test with these marks belongs to the graphs."""
    return "ros" in marks or "realtime" in marks


def kind(marks):
    """Which of a file's two times a test adds to."""
    return "graphs" if starts_nodes(marks) else "pure"


def known_seconds():
    """What files took, by kind and by path below tests [s]."""
    return json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}


def pytest_sessionfinish(session):
    """Note what the files took, if asked to; files that were not run keep their numbers."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if not os.environ.get(RENEW) or "PYTEST_XDIST_WORKER" in os.environ or reporter is None:
        return
    took = {"graphs": Counter(), "pure": Counter()}
    for report in (each for reports in reporter.stats.values() for each in reports):
        if hasattr(report, "duration"):
            path = report.nodeid.partition("::")[0].removeprefix(f"{TESTS.name}/")
            took[kind(report.keywords)][path] += report.duration
    known = known_seconds()
    for name, files in took.items():
        kept = sorted({**known.get(name, {}), **files}.items())
        known[name] = {path: round(seconds) for path, seconds in kept if seconds >= LEAST_S}
    FILE.write_text(json.dumps(known, indent=1) + "\n", encoding="utf-8")
