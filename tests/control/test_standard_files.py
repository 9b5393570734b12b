# SPDX-License-Identifier: Apache-2.0
"""A node whose starter closed standard input, output or error writes its log into no other file."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

SCRIPT = """
import os, sys
from cabols_control.node_command import open_standard_files
if sys.argv[1] == "open":
    open_standard_files()
with open(sys.argv[2], "w") as stream:
    os.write(2, b"a log line")
    stream.write("content")
"""


def run(mode, path, closed):
    def close():
        for number in closed:
            os.close(number)

    command = [sys.executable, "-c", SCRIPT, mode, str(path)]
    streams = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
    return subprocess.run(command, check=False, preexec_fn=close, timeout=120, **streams).returncode


@pytest.mark.parametrize("closed", [(0, 1, 2), (2,), (1, 2), (0,), ()])
def test_log_lines_go_into_no_other_file(closed, tmp_path):
    path = tmp_path / "file"
    assert run("open", path, closed) == 0
    assert path.read_text() == "content"


def test_they_would_otherwise(tmp_path):
    path = tmp_path / "file"
    assert run("leave", path, (2,)) == 0
    assert path.read_text() != "content"
