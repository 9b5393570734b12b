# SPDX-License-Identifier: Apache-2.0
"""What the tests under tests/cases share: expected failures by issue, and outcomes as values."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest


def fails_today(issue: int, reason: str) -> pytest.MarkDecorator:
    """Mark a test whose right behaviour a later issue brings.

    Strict: the issue that makes it right must take the mark away. Only a failed assertion counts
    as the failure that is expected; an import or a name that has moved does not.
    """
    return pytest.mark.xfail(strict=True, raises=AssertionError, reason=f"issue {issue}: {reason}")


def outcome(call: Callable[[], Any]) -> Any:
    """What a call gives: its value, or the exception that it raises, to be asserted on."""
    try:
        return call()
    except Exception as error:
        return error
