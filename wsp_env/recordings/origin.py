"""What a page about a campaign was made from: the vehicle as believed, and its files with their hashes."""

import hashlib
import tomllib
from pathlib import Path

from wsp_env.parameters.campaign_vehicle import CampaignVehicle
from wsp_env.recordings.campaign import Campaign
from wsp_env.report import Origin


def hashes(folder: Path, of: str = "runs") -> tuple[tuple[str, str], ...]:
    """Return campaign.toml and the files of its runs, or "curves", of a folder that was read, each with its SHA-256."""
    text = (folder / "campaign.toml").read_bytes()
    runs = tomllib.loads(text.decode("utf-8"))[of].values()
    files = dict.fromkeys(["campaign.toml", *(str(run["file"]) for run in runs)])
    return tuple((name, hashlib.sha256((folder / name).read_bytes()).hexdigest()) for name in files)


def vehicle_said(vehicle: CampaignVehicle) -> str:
    """Say in a line what a campaign believes of its vehicle."""
    wheels = f"wheel radius {vehicle.wheel_radius_m:g} m, wheelset inertia {vehicle.wheelset_inertia_kgm2:g} kg m2"
    return f"{vehicle.axles} axles, {vehicle.mass_kg:.6g} kg, {wheels}; brake torque {vehicle.brake_torque_source}"


def origin(command: str, campaign: Campaign, folder: Path) -> Origin:
    """Return what a page about a campaign in a folder says of itself."""
    return Origin(command, vehicle_said(campaign.vehicle), hashes(folder))
