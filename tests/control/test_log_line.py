# SPDX-License-Identifier: Apache-2.0
"""How loud a line of a node's output is: by its logger's severity, never by its words."""

import pytest

from cabols_control.bringup.log_line import ERROR, INFO, PLAIN, WARN, read_line

CRASH = "Traceback (most recent call last):"


@pytest.mark.parametrize(
    ("severity", "name", "words", "loud"),
    [
        ("INFO", INFO, "mode LOADING: requested", False),
        ("INFO", INFO, "no ERROR was lost", False),
        ("WARN", WARN, "fine", True),
        ("ERROR", ERROR, "cable: [limb 3]: slack", True),
    ],
)
def test_severity_comes_from_the_logger(severity, name, words, loud):
    read = read_line(f"[{severity}] [1700000000.123456789] [cabols.plant]: {words}\n")
    assert (read.severity, read.words, read.loud) == (name, words, loud)


@pytest.mark.parametrize("output", [CRASH, "error: no such file", "[INFO] of nobody"])
def test_what_no_logger_wrote_is_loud(output):
    assert read_line(output) == (PLAIN, output)
    assert read_line(output).loud


def test_a_devices_word_to_the_program_that_started_it_is_not():
    assert read_line('ready {"link": 13350}') == (INFO, 'ready {"link": 13350}')
