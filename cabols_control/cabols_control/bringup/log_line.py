# SPDX-License-Identifier: Apache-2.0
"""A line of a node's output with its severity, so that no other code reads texts."""

from __future__ import annotations

import re
from typing import NamedTuple

DEBUG, INFO, WARN, ERROR, FATAL = 10, 20, 30, 40, 50
"""Severities by the numbers of rcl_interfaces/Log."""
PLAIN = 0
"""No logger wrote the line: a traceback, or what a process says as it ends."""
SEVERITIES = {"DEBUG": DEBUG, "INFO": INFO, "WARN": WARN, "ERROR": ERROR, "FATAL": FATAL}
FORMAT = re.compile(r"\[(DEBUG|INFO|WARN|ERROR|FATAL)\] \[[\d.]+\] \[[\w.]+\]: (.*)", re.DOTALL)
"""rclpy's own: severity, time, logger."""
READY = re.compile(r"ready \{.*\}")
"""What a simulated device tells the program that started it."""


class LogLine(NamedTuple):
    """One line.

    Attributes:
        severity: of its logger; PLAIN if it came from none.
        words: its text, for people.
    """

    severity: int
    words: str

    @property
    def loud(self) -> bool:
        """Whether something is not well."""
        return self.severity == PLAIN or self.severity >= WARN


def read_line(output: str) -> LogLine:
    """Read one line of a node's output."""
    output = output.strip()
    found = FORMAT.fullmatch(output)
    if found is None:
        return LogLine(INFO if READY.fullmatch(output) else PLAIN, output)
    return LogLine(SEVERITIES[found[1]], found[2])
