# SPDX-License-Identifier: Apache-2.0
"""Files whose tests take longest begin first, so that no process waits for one at the end.

What they took once (file_seconds.py) orders them; a file that is not known, and has a time-out of
its own, begins before all. What ends a graph that hangs is GRAPH_S for all.
"""

from __future__ import annotations

import pytest

from file_seconds import TESTS, kind, known_seconds, starts_nodes

GRAPH_S = 600.0
"""Least time-out of a test that starts nodes [s]: several times what a busy machine takes."""


def limit_s(item):
    """Time-out of one test: its mark's, or that of the settings."""
    mark = item.get_closest_marker("timeout")
    return float(mark.args[0]) if mark and mark.args else float(item.config.getini("timeout"))


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items):
    """Sort the files by what they take; within a file, and among equals, nothing moves."""
    known, longest = known_seconds(), {}
    for item in items:
        marks = {mark.name for mark in item.iter_markers()}
        limit = limit_s(item)
        may_be_long = limit if limit > float(item.config.getini("timeout")) else 0.0
        path = item.path.relative_to(TESTS) if item.path.is_relative_to(TESTS) else item.path
        took = known.get(kind(marks), {}).get(str(path), may_be_long)
        longest[item.path] = max(longest.get(item.path, 0.0), took)
        if starts_nodes(marks) and limit < GRAPH_S:
            item.add_marker(pytest.mark.timeout(GRAPH_S), append=False)
    items.sort(key=lambda item: -longest[item.path])
