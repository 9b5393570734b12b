# SPDX-License-Identifier: Apache-2.0
"""Files that a goal names and that never end, wait for a writer, or are no files at all."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from cabols_control.configuration import read_yaml
from cabols_control.errors import CabolsError
from cabols_control.files.given_file import read_given
from cabols_control.load_programs.programs import load_program
from cabols_hw.abb.path import read_path
from cabols_stiffness.campaign.plan import plan_text

READERS = {
    "yaml": read_yaml,
    "programme": lambda path: load_program(str(path)),
    "path": read_path,
    "campaign": plan_text,
}


@pytest.fixture(params=["endless", "waiting", "folder", "missing", "long name"])
def odd(request, tmp_path):
    """Path of what is no text file, with a programme's ending."""
    path = tmp_path / "it.csv"
    if request.param == "endless":
        path.symlink_to("/dev/zero")
    elif request.param == "waiting":
        os.mkfifo(path)
    elif request.param == "folder":
        path.mkdir()
    elif request.param == "long name":
        return tmp_path / ("x" * 100_000 + ".csv")
    return path


@pytest.mark.parametrize("kind", READERS)
def test_what_is_no_file_is_refused_at_once(odd, kind):
    with pytest.raises(CabolsError):
        READERS[kind](Path(odd))


def test_file_that_would_fill_the_memory_is_refused(tmp_path):
    path = tmp_path / "large"
    path.write_bytes(b"x" * 3_000_000)
    assert len(read_given(path)) == 3_000_000
    with pytest.raises(OSError, match="at most 2 MiB"):
        read_given(path, most_bytes=2 * 2**20)


def test_lines_of_other_systems_are_read_as_before(tmp_path):
    path = tmp_path / "text"
    path.write_bytes("\ufeffa\r\nb\rc\n".encode())
    assert read_given(path, "utf-8-sig") == path.read_text("utf-8-sig") == "a\nb\nc\n"
