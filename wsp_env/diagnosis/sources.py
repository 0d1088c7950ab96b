"""Origin of a diagnosis: input files with hashes, date and version; and the length of the recorded stops."""

import dataclasses
from datetime import date
from pathlib import Path

import numpy as np

import wsp_env
from wsp_env.diagnosis.answer import Diagnosis, Source
from wsp_env.recordings import Campaign
from wsp_env.recordings.derive import braking
from wsp_env.recordings.origin import hashes


def sources(folder: Path) -> tuple[Source, ...]:
    """Return campaign.toml and the files of its runs, each with its SHA-256."""
    return tuple(Source(name, digest) for name, digest in hashes(folder))


def signed(found: Diagnosis, folder: Path, campaign: Campaign | None = None) -> Diagnosis:
    """Return a diagnosis with sources, today's date and the package version; with a campaign, also its worth in metres."""
    if campaign is not None and found.worth is not None:
        found = dataclasses.replace(found, worth=dataclasses.replace(found.worth, stop_m=braked_m(campaign)))
    return dataclasses.replace(found, sources=sources(folder), made=date.today().isoformat(), version=wsp_env.__version__)


def braked_m(campaign: Campaign) -> float | None:
    """Return the recorded distance while braking [m], mean of the stops; None if no stop brakes."""
    ways = []
    for run in campaign.runs.values():
        start, end = braking(run, campaign.sample_time_s)
        way = float(np.trapezoid(run.vehicle_speed_mps[start:end], run.time_s[start:end])) if end > start + 1 else np.nan
        if np.isfinite(way):
            ways.append(way)
    return float(np.mean(ways)) if ways else None
