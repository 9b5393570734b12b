# SPDX-License-Identifier: Apache-2.0
"""The one test of a package's own test/ folder: what `colcon test` runs of this repository.

It runs the package's tests in a pytest of their own, from the repository's tests/ folder.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
FOLDERS = {
    "cabols_control": ("control", "cases/cables"),
    "cabols_hw": ("hw", "cases/devices"),
    "cabols_stiffness": ("stiffness", "cases/stiffness"),
    "cabols_sim": ("sim", "system", "cases/safety"),
}
"""Folders under tests/ by package; what concerns all packages is the topmost one's."""


@pytest.mark.timeout(3600)
def test_package(request):
    package = request.node.path.parents[1].name
    folders = [str(TESTS / folder) for folder in FOLDERS[package]]
    root = ["--rootdir", str(TESTS.parent), "-c", str(TESTS.parent / "pyproject.toml")]
    command = [sys.executable, str(TESTS.parent / "tools" / "run_tests.py"), *root, *folders]
    # What colcon asks of pytest is meant for this run, not for the one inside.
    environment = {name: text for name, text in os.environ.items() if name != "PYTEST_ADDOPTS"}
    done = subprocess.run(
        command,
        cwd=TESTS.parent,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        check=False,
    )
    sys.stdout.write(done.stdout.decode(errors="replace"))
    assert done.returncode == 0
