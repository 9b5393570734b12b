# SPDX-License-Identifier: Apache-2.0
"""Files whose tests may take longest begin first, so that no process waits for one at the end.

Time-outs of graphs order them; what ends a graph that hangs is GRAPH_S for all.
"""

from __future__ import annotations

import pytest

GRAPH_S = 900.0
"""Least time-out of a test that starts nodes [s]: several times what a busy machine takes."""


def limit_s(item):
    """Time-out of one test: its mark's, or that of the settings."""
    mark = item.get_closest_marker("timeout")
    return float(mark.args[0]) if mark and mark.args else float(item.config.getini("timeout"))


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items):
    """Sort the files by their longest time-out; within a file, and among equals, nothing moves."""
    longest = {}
    for item in items:
        longest[item.path] = max(longest.get(item.path, 0.0), limit_s(item))
    items.sort(key=lambda item: -longest[item.path])
    for item in items:
        starts_nodes = item.get_closest_marker("ros") or item.get_closest_marker("realtime")
        if starts_nodes and limit_s(item) < GRAPH_S:
            item.add_marker(pytest.mark.timeout(GRAPH_S), append=False)
