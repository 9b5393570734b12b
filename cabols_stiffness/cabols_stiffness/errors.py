"""What can go wrong with a campaign."""

from __future__ import annotations

from cabols_control.errors import CabolsError


class CampaignError(CabolsError):
    """A campaign, or its data, cannot be used; says what was expected, what came, what helps."""
