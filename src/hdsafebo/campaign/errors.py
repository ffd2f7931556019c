"""Errors of campaigns."""

from __future__ import annotations

from hdsafebo.errors import HdSafeBOError


class CampaignError(HdSafeBOError):
    """The processes or the cluster that compute a campaign failed, or the campaign was stopped."""
