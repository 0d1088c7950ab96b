"""Campaigns of recorded stops: read, check, derive quantities, tune, validate."""

from wsp_env.recordings.campaign import Campaign, CampaignVehicle, Recording, demo_campaign, read_campaign
from wsp_env.recordings.derive import Derived, Smoothing, derive, limits, rolling_radii, transition
from wsp_env.recordings.table import CampaignError
from wsp_env.recordings.tuning import RunScore, Tuning, tune

__all__ = [
    "Campaign",
    "CampaignError",
    "CampaignVehicle",
    "Derived",
    "Recording",
    "RunScore",
    "Smoothing",
    "Tuning",
    "demo_campaign",
    "derive",
    "limits",
    "read_campaign",
    "rolling_radii",
    "transition",
    "tune",
]
