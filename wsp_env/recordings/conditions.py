"""Recorded stops as conditions that an environment or a controller can brake under again."""

import dataclasses
from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter1d

from wsp_env.parameters.campaign_vehicle import plant_vehicle
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.port import TRACK_STEP_M
from wsp_env.recordings.campaign import Campaign
from wsp_env.recordings.derive import Derived, Smoothing, braking, derive, rolling_radii
from wsp_env.recordings.recording import Recording
from wsp_env.recordings.tuning import Tuning, tune

_HELD_S = 0.5  # window [s] over whose means the largest torque is sought, against noise: assumption
_HELD_QUANTILE = 0.99  # of them, against spikes
_HELD_SHARE = 0.95  # means above this share of it are of the full brake
_FILLED = 0.9  # share of the held torque at which an axle counts as filled

#: mu_cd along the track is estimated in stretches of this length [m]...
STRETCH_M = 20.0

#: ... each as if it held this many samples without deviation, so that few samples say little (assumption).
PRIOR_SAMPLES = 50.0

_STEP = 0.02  # relative step of mu_cd for the derivative of f


def conditions(
    campaign: Campaign,
    tuning: Tuning | None = None,
    along_track: bool = False,
    smoothing: Smoothing = Smoothing(),
    base: Vehicle | None = None,
) -> dict[str, Any]:
    """Return the campaign's stops as `gym.make("wsp_env/Coach-v1", conditions=...)` takes them; plain data, fit for JSON.

    The vehicle is the campaign's own, whatever id brakes: its axles, masses, wheels, contact and resistances, and a brake whose
    full torque is the largest recorded and builds up as fast as there. Its payload is what the stops' masses differ by. A stop
    gets the speed at which its braking began, its demand (its own largest torque over the full one), mass and gradient, the
    tuned tau and its own mu_cd.

    Parameters
    ----------
    tuning : of `tune`; without one it is done here
    along_track : mu_cd along the track as estimated from the recording, instead of one value per stop
    base : gives what a campaign does not tell, see `plant_vehicle`

    Raises
    ------
    CampaignError
        when no run to tune on slides
    ParameterError
        when `base` has another number of axles than the campaign

    """
    known = plant_vehicle(campaign.vehicle, campaign.contact, campaign.name, base)
    tuning = tuning or tune(campaign, smoothing)
    radii = rolling_radii(campaign, smoothing)
    runs = {run: campaign.runs[run] for run in tuning.runs}
    torques = {run: _held(campaign, recording) for run, recording in runs.items()}
    full = max(torques.values())
    masses = [recording.mass_kg for recording in runs.values()]
    lightest, spread = min(masses), max(masses) - min(masses)
    lag = known.brake.fill_time_constant_s
    # A ramp is late by half its length, the brake that follows it by its lag on top.
    lates = {name: _build_up(campaign, run, torques[name], smoothing) - lag for name, run in runs.items()}
    rises = [2.0 * late / (torques[name] / full) for name, late in lates.items()]
    brake = dataclasses.replace(
        known.brake,
        torque_per_bar_nm=full / known.brake.full_pressure_bar,
        demand_rise_s=max(float(np.median(rises)), 0.1),
    )
    vehicle = dataclasses.replace(known, mass_kg=lightest, payload_kg=spread, brake=brake)
    stops = []
    for run, recording in runs.items():
        derived = derive(campaign, recording, radii, smoothing)
        start, _ = braking(recording, campaign.sample_time_s, smoothing)
        stop: dict[str, Any] = {
            "name": run,
            "mu_cd": tuning.runs[run].mu_cd,
            "tau": tuning.tau_m_per_J,
            "initial_speed": float(derived.speed_mps[start]),
            "demand": min(torques[run] / full, 1.0),
            "load": (recording.mass_kg - lightest) / spread if spread > 0.0 else 0.0,
            "gradient": recording.gradient,
            "sensor_noise": _noise(recording),
            "track": _profile(campaign, derived, start, tuning, run) if along_track else "constant",
        }
        stops.append(stop)
    return {"vehicle": dataclasses.asdict(vehicle), "stops": stops}


def _held(campaign: Campaign, run: Recording) -> float:
    """Brake torque [Nm] that the run holds where it brakes fully: the median, so that noise does not count as torque."""
    means = uniform_filter1d(run.brake_torque_nm, max(round(_HELD_S / campaign.sample_time_s), 1), axis=0)
    return float(np.median(run.brake_torque_nm[means >= _HELD_SHARE * np.quantile(means, _HELD_QUANTILE)]))


def _build_up(campaign: Campaign, run: Recording, torque_nm: float, smoothing: Smoothing) -> float:
    """Time [s] by which the brake is late: what the axle that fills first lacks of the held torque until it reaches it."""
    start, _ = braking(run, campaign.sample_time_s, smoothing)
    share = run.brake_torque_nm[start:] / torque_nm
    first = share[:, np.argmin(np.where((share > _FILLED).any(axis=0), np.argmax(share > _FILLED, axis=0), len(share)))]
    filled = int(np.argmax(first >= min(1.0, first.max())))
    return float(np.sum(1.0 - first[:filled])) * campaign.sample_time_s


def _noise(recording: Recording) -> float:
    """Return the standard deviation [rad/s] of the wheel speeds' white noise, from their second differences, robustly."""
    second = np.diff(recording.wheel_speed_radps, 2, axis=0)
    return float(np.median(np.abs(second)) / (0.6745 * np.sqrt(6.0)))


def _profile(campaign: Campaign, derived: Derived, start: int, tuning: Tuning, run: str) -> list[float]:
    """Return mu_cd relative to the run's own at nodes `TRACK_STEP_M` apart, from where braking began, by least squares."""
    mu_cd = tuning.runs[run].mu_cd
    missed = derived.adhesion - tuning.adhesion(campaign, derived, mu_cd)
    slope = (tuning.adhesion(campaign, derived, mu_cd * (1.0 + _STEP)) - tuning.adhesion(campaign, derived, mu_cd)) / _STEP
    travelled = np.cumsum(derived.speed_mps) * campaign.sample_time_s
    behind = np.array(campaign.vehicle.axle_positions_m or (0.0,) * campaign.vehicle.axles)
    place = (travelled - travelled[start])[:, None] - behind
    stretch = np.maximum(place // STRETCH_M, 0).astype(int)
    used, count = derived.usable, int(stretch.max()) + 1
    top = np.bincount(stretch[used], (missed * slope)[used], count)
    bottom = np.bincount(stretch[used], (slope**2)[used], count)
    prior = PRIOR_SAMPLES * float(np.mean(slope[used] ** 2)) if used.any() else 1.0
    relative = np.clip(1.0 + top / (bottom + prior), 0.5, 2.0)
    nodes = np.arange(int(travelled[-1] - travelled[start]) // int(TRACK_STEP_M) + 2) * TRACK_STEP_M
    middles = (np.arange(count) + 0.5) * STRETCH_M
    return [round(float(value), 4) for value in np.interp(nodes, middles, relative)]
