"""What can be wrong with a bag."""

from __future__ import annotations

from cabols_control.errors import CabolsError


class BagError(CabolsError):
    """A bag cannot be written or read; the message says what was expected, came and helps."""
