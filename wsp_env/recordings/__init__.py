"""Campaigns of recorded stops: read, check, derive quantities, tune, validate."""

from wsp_env.parameters.campaign_vehicle import CampaignVehicle
from wsp_env.recordings.campaign import Campaign, concealed_campaign, demo_campaign, read_campaign
from wsp_env.recordings.conditions import conditions
from wsp_env.recordings.derive import Derived, Smoothing, derive, limits, rolling_radii, transition
from wsp_env.recordings.errors import CampaignError, CampaignWarning
from wsp_env.recordings.recording import Recording
from wsp_env.recordings.tuning import RunScore, Tuning, tune

__all__ = [
    "Campaign",
    "CampaignError",
    "CampaignVehicle",
    "CampaignWarning",
    "Derived",
    "Recording",
    "RunScore",
    "Smoothing",
    "Tuning",
    "concealed_campaign",
    "conditions",
    "demo_campaign",
    "derive",
    "limits",
    "read_campaign",
    "rolling_radii",
    "transition",
    "tune",
]
