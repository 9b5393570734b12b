# SPDX-License-Identifier: Apache-2.0
"""Files in the forms that others write: every row of the corpus's table is right."""

from __future__ import annotations

import pytest
from corpus.check import main, rows, wrong_of


@pytest.mark.parametrize(
    ("kind", "row"), rows(), ids=[f"{kind}-{row['file']}" for kind, row in rows()]
)
def test_row(kind, row):
    assert wrong_of(kind, row) == []


def test_command_prints_the_table(capsys):
    assert main() == 0
    printed = capsys.readouterr().out
    assert f"{len(rows())} of {len(rows())} right" in printed
