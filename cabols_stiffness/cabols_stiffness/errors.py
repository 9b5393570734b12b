# SPDX-License-Identifier: Apache-2.0
"""Errors of a campaign."""

from __future__ import annotations

from cabols_control.errors import CabolsError


class CampaignError(CabolsError):
    """A campaign, or its data, cannot be used; the message says what was expected and what came."""


class TableError(CabolsError):
    """A table that cannot be used: the message says what was expected and what came."""
