"""What can be wrong with a bag."""

from __future__ import annotations

from cabols_control.errors import CabolsError, UsageError


class BagError(CabolsError):
    """A bag cannot be written or read; the message says what was expected, came and helps."""


class MissingBagError(BagError, UsageError):
    """A bag, or an output folder for one, was named that cannot be used; exit code 2."""
