# SPDX-License-Identifier: Apache-2.0
"""Compiled code kept on disk by several processes, for records of several layouts."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LIMB = """
    for i in range(record.values.size):
        found += record.values[i]
        if found > {large}:
            found = np.sqrt(found) * np.arctan(found) + {large}
"""
MODULE = """
import sys

import numpy as np

{source}


@njit(cache=True)
def total(record):
    found = 0.0
{limbs}
    return found


@njit(cache=True)
def of_all(records):
    found = 0.0
    for k in range(records.size):
        found += total(records[k])
    return found / {count} + (total(records[0]) if records.size > 3 else 0.0)


def of(n):
    return of_all(np.ones(1, np.dtype([("values", "f8", (n,))])).astype([("values", "f8", (n,))]))


print([round(of(int(n))) for n in sys.argv[1:]])
"""


def totals(folder, source, numbers):
    """What a process finds for records of so many values, which are all one."""
    # More than the compiler puts into the caller: each call finds it by its name.
    limbs = [LIMB.format(large=1e9 + k) for k in range(12)]
    text = MODULE.format(source=source, limbs="".join(limbs), count=len(limbs))
    (folder / "sized.py").write_text(text)
    command = [sys.executable, "-c", "import sys, sized", *map(str, numbers)]
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "kept")}
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


@pytest.mark.parametrize("numbers", [(8, 10), (10, 8)])
def test_records_of_two_sizes_keep_their_own_functions(tmp_path, numbers):
    source = "from cabols_control.compiling import njit"
    for n in (8, 10):
        assert totals(tmp_path, source, [n]) == f"[{n}]"
    assert totals(tmp_path, source, numbers) == str(list(numbers))


def test_numba_alone_takes_one_for_the_other(tmp_path):
    """Where this fails, numba names records by their layout itself: compiling.py may go."""
    for n in (8, 10):
        assert totals(tmp_path, "from numba import njit", [n]) == f"[{n}]"
    assert totals(tmp_path, "from numba import njit", [8, 10]) == "[8, 8]"


def test_all_compiled_code_is_named_so():
    pattern = re.compile(r"^\s*(from numba import .*\bn?jit\b|import numba\b)", re.MULTILINE)
    assert pattern.search("from numba import njit, types")
    found = [
        str(path.relative_to(ROOT))
        for path in ROOT.glob("cabols_*/cabols_*/**/*.py")
        if pattern.search(path.read_text(encoding="utf-8"))
    ]
    assert found == ["cabols_control/cabols_control/compiling.py"]
