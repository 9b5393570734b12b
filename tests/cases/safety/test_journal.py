# SPDX-License-Identifier: Apache-2.0
"""A campaign's samples.csv that is damaged: the line is named, a load is counted once."""

from __future__ import annotations

import pytest

from cabols_control.errors import CabolsError
from cabols_stiffness.campaign.journal import Journal
from cabols_stiffness.measurements.measured_load import columns
from cases import outcome


@pytest.fixture
def reopened(tmp_path):
    """Opens a campaign again whose samples.csv holds some rows; how many loads, or the error."""
    folder = tmp_path / "campaign"
    first = Journal(folder)
    cells = len(columns(first.plan.limbs))
    first.close()
    header = (folder / "samples.csv").read_bytes()
    row = b",".join([b"0"] * cells) + b"\n"

    def count():
        journal = Journal(folder)
        journal.close()
        return len(journal.loads)

    def reopen(*more):
        (folder / "samples.csv").write_bytes(header + row + b"".join(more))
        return outcome(count)

    reopen.row = row
    return reopen


def test_one_line_is_one_load(reopened):
    assert reopened() == 1


def test_byte_that_is_no_text_is_named(reopened):
    error = reopened(b"\xff\xfe\n")
    assert isinstance(error, CabolsError)
    assert "samples.csv" in str(error)


def test_same_line_twice_is_one_load(reopened):
    found = reopened(reopened.row)
    assert found == 1 or isinstance(found, CabolsError)


def test_same_load_with_other_values_is_named(reopened):
    other = reopened.row[:-2] + b"7\n"
    error = reopened(other)
    assert isinstance(error, CabolsError)
    assert "line 3" in str(error)
    assert "line 2" in str(error)


@pytest.mark.parametrize("bad", [b"0,\xe4,0\n", b"0,\x00,0\n", b"\x80"])
def test_damaged_line_is_named_wherever_it_is_damaged(reopened, bad):
    error = reopened(bad + b"\n")
    assert isinstance(error, CabolsError)
    assert "line 3" in str(error)
