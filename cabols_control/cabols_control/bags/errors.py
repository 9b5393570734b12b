# SPDX-License-Identifier: Apache-2.0
"""Errors of bags."""

from __future__ import annotations

from cabols_control.errors import CabolsError, UsageError


class BagError(CabolsError):
    """A bag cannot be written or read; the message says what was expected and what came."""


class MissingBagError(BagError, UsageError):
    """The named bag, or output folder of a bag, cannot be used; exit code 2."""


class BagWarning(UserWarning):
    """Something in a bag was left out, or is not as its totals say; what was read is right."""
