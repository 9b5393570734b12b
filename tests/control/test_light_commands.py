# SPDX-License-Identifier: Apache-2.0
"""`--help` needs neither compilers, figures nor optimisers: what commands import at once."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import fields

import pytest

from cabols_control.calibration.command import NOISE
from cabols_control.calibration.model import Noise
from cabols_control.workspace.design import GIVEN, PATTERNS
from cabols_control.workspace.tool import files
from cabols_control.workspace.tool.command import POSES
from cabols_control.workspace.tool.exchange_command import WRITERS
from cabols_control.workspace.tool.options import DESIGN_PATTERNS, EXCHANGED

HEAVY = ("numba", "scipy", "matplotlib", "pydantic", "numpy")


@pytest.mark.parametrize(
    "module",
    ["cabols_control.workspace.tool.command", "cabols_control.calibration.command"],
)
def test_help_imports_nothing_heavy(module):
    code = (
        f"import sys; sys.argv = ['x', '--help']; import {module} as m\n"
        "try:\n    m.main()\nexcept SystemExit:\n    pass\n"
        f"print('LOADED', sorted(set({HEAVY!r}) & set(sys.modules)), file=sys.stderr)"
    )
    words = [sys.executable, "-c", code]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert "usage" in done.stdout.lower()
    assert "LOADED []" in done.stderr


def test_light_words_are_those_of_the_heavy_modules():
    assert (*PATTERNS, GIVEN) == DESIGN_PATTERNS
    assert tuple(sorted(WRITERS)) == EXCHANGED
    assert ", ".join(files.POSE_COLUMNS) == POSES
    assert tuple(each.name for each in fields(Noise)) == NOISE
