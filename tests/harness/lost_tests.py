# SPDX-License-Identifier: Apache-2.0
"""Tests that run into their time-outs tell what their nodes printed last; after two, a part ends.

A graph that hangs costs GRAPH_S of longest_first.py: a part in which all do would take hours, and
tell nothing.
"""

from __future__ import annotations

from collections import deque

import pytest

from cabols_control.bringup import processes

MOST_LOST = 2
"""Tests that one process of tests may lose to time-outs."""
TIME_OUT = "from pytest-timeout"
LINES = deque(maxlen=40)
"""What the nodes of the present test printed last."""
_PUMP = processes._pump
_lost = []


async def _keep_lines(name, process, on_line, log_folder):
    def tell(node, line):
        LINES.append(f"{node}: {line}")
        on_line(node, line)

    await _PUMP(name, process, tell, log_folder)


processes._pump = _keep_lines


def pytest_runtest_setup(item):
    """Forget the lines of the test before."""
    LINES.clear()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """Add the lines to what is said of a test that is lost, and count it."""
    report = yield
    if report.failed and TIME_OUT in str(report.longrepr):
        report.sections.append(("what the nodes printed last", "\n".join(LINES)))
        _lost.append(item.nodeid)
        if len(_lost) >= MOST_LOST:
            item.session.shouldstop = f"lost to time-outs: {', '.join(_lost)}"
    return report
