# SPDX-License-Identifier: Apache-2.0
"""The fuzzer finds bugs that are planted, goes on where it was, and finds none today."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

FUZZ = Path(__file__).resolve().parents[1] / "fuzz"
FOUND = {
    "last_key_wins": "yaml: took a key twice",
    "pythons_numbers": "no decimal number",
    "forgotten_bound": "beyond any robot",
    "missing_exception": "OverflowError",
    "circle": "hang",
    "kept_texts": "memory",
    "kept_zeros": "SerdeError",
}


def called(*arguments, folder):
    """Standard output and exit code of a call."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, *map(str, arguments)],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=110,
        check=False,
    )
    return done.stdout, done.returncode, done.stderr


@pytest.mark.parametrize("name", FOUND)
def test_a_planted_bug_is_found(name, tmp_path):
    output, code, errors = called(FUZZ / "planted.py", name, tmp_path / "state", folder=tmp_path)
    assert code == 0, errors
    kinds = json.loads(output.splitlines()[-1])
    assert any(FOUND[name] in kind for kind in kinds), kinds
    if FOUND[name] != "memory":
        assert list((tmp_path / "state" / "findings").glob("*.input"))


def test_nothing_is_wrong_and_a_second_call_goes_on(tmp_path):
    targets = ["--targets", "poses_csv", "cdr_live", "rws_socket"]
    counts = []
    for minutes in ("0.04", "0.08"):
        output, code, errors = called(
            FUZZ / "fuzz.py", "--minutes", minutes, *targets, folder=tmp_path
        )
        assert code == 0, output + errors
        assert "0 wrong" in output
        folder = tmp_path / "build" / "fuzz" / "seed_1"
        states = [json.loads(path.read_text()) for path in sorted(folder.glob("*/state.json"))]
        assert len(states) == 3
        assert all(state["findings"] == {} for state in states)
        counts.append([state["done"] for state in states])
    assert all(later >= before > 0 for before, later in zip(*counts, strict=True))
    assert counts[1] != counts[0] or all(count >= 1000 for count in counts[0])
