"""Axles without a usable sensor: their mass and brake stay, what they would have said is filled in.

The wheel turns as the others do on average; the torque is its own where that is recorded, else the others' mean. What is
filled in is marked and never compared with the law; in the vehicle's balance it is the believed force of that brake.
"""

import dataclasses

import numpy as np

from wsp_env.parameters.campaign_vehicle import CampaignVehicle
from wsp_env.recordings.errors import CampaignError
from wsp_env.recordings.recording import Recording

_HELD_S = 1.0  # one value, not 0, for longer than this while the vehicle changes its speed: stuck
_MOST = 0.5  # of the time that the vehicle moves
_MOVING_MPS = 5.0


def dead_wheels(run: Recording) -> list[int]:
    """Return the axles (from 0) whose wheel speed never changes, or is stuck most of the time that the vehicle moves."""
    return [k for k, wheel in enumerate(run.wheel_speed_radps.T) if is_dead(wheel, run)]


def is_dead(wheel: np.ndarray, run: Recording) -> bool:
    """Whether a wheel's speed (T,) says nothing; one that stands still from braking on is locked, not dead."""
    if np.ptp(wheel) == 0.0:
        return True
    moving = np.abs(run.vehicle_speed_mps) > _MOVING_MPS
    step = float(run.time_s[-1] - run.time_s[0]) / (len(run.time_s) - 1)
    edges = np.flatnonzero(np.diff(np.concatenate([[True], np.diff(wheel) != 0.0, [True]])))
    held = np.zeros(len(wheel), dtype=bool)
    for start, end in zip(edges[::2], edges[1::2], strict=False):
        if (end - start) * step > _HELD_S and wheel[start] != 0.0:
            held[start : end + 1] = True
    return bool(moving.any() and held[moving].mean() > _MOST)


def filled(run: Recording, missing: tuple[int, ...], vehicle: CampaignVehicle, where: str) -> tuple[Recording, list[str]]:
    """Return the run with missing and dead axles filled in and marked, and what is to be said of them.

    Parameters
    ----------
    missing : axles from 1, as campaign.toml says; their columns hold nan where the file has none

    Raises
    ------
    CampaignError
        where no wheel is left

    """
    gone = [k - 1 for k in missing]
    dead = [k for k in dead_wheels(run) if k not in gone]
    kept = [k for k in range(vehicle.axles) if k not in gone and k not in dead]
    if not kept:
        value = run.wheel_speed_radps[0, dead[0]] if dead else np.nan
        raise CampaignError(
            f"{where}: axle{(dead or gone)[0] + 1}_wheel_speed is {value:g} throughout: a dead channel; map another column "
            "to it"
        )
    wheel, torque = run.wheel_speed_radps.copy(), run.brake_torque_nm.copy()
    for k in (*gone, *dead):
        wheel[:, k] = wheel[:, kept].mean(axis=1)
    own = run.cylinder_pressure_bar is not None or vehicle.torque_is_measured
    for k in range(vehicle.axles):
        if not np.isfinite(torque[:, k]).all() or (k in gone and not own):
            torque[:, k] = torque[:, kept].mean(axis=1)
    notes = [
        f"{where}: axle{k + 1}_wheel_speed is {run.wheel_speed_radps[0, k]:g} "
        f"{'throughout' if np.ptp(run.wheel_speed_radps[:, k]) == 0.0 else 'most of the time'}: a dead channel; axle {k + 1} "
        f"is left out, its force taken as its torque over the radius. Map another column, or say missing_axles = [{k + 1}]"
        for k in dead
    ]
    braked, silent = _torques(dataclasses.replace(run, wheel_speed_radps=wheel, brake_torque_nm=torque), kept, vehicle)
    notes += [
        f"{where}: the brake torque of axle {k + 1} never changes, yet the vehicle slows as if that brake worked: a dead "
        "channel; not compared with the law, taken as the others' mean in the vehicle's balance"
        for k in silent
    ]
    suspect = np.zeros(wheel.shape, dtype=bool) if run.suspect is None else run.suspect.copy()
    suspect[:, [*gone, *dead, *silent]] = True
    channels = [f"axle{k + 1}_wheel_speed" for k in dead] + [f"axle{k + 1}_brake_torque" for k in silent]
    return (
        dataclasses.replace(
            run,
            wheel_speed_radps=wheel,
            brake_torque_nm=braked,
            suspect=suspect,
            missing_axles=tuple(sorted(k + 1 for k in {*gone, *dead, *silent})),
            dead_channels=tuple(channels),
        ),
        notes,
    )


def _torques(run: Recording, kept: list[int], vehicle: CampaignVehicle) -> tuple[np.ndarray, list[int]]:
    """Return the torques (T, A) with those that never change exchanged where the loss of momentum asks for it, and which."""
    torque = run.brake_torque_nm
    constant = [k for k in range(vehicle.axles) if np.ptp(torque[:, k]) == 0.0]
    alive = [k for k in kept if k not in constant]
    if not constant or not alive:
        return torque, []
    instead = torque.copy()
    instead[:, constant] = torque[:, alive].mean(axis=1)[:, None]
    wheel, duration = run.wheel_speed_radps, float(run.time_s[-1] - run.time_s[0])
    lost = run.mass_kg * (run.vehicle_speed_mps[0] - run.vehicle_speed_mps[-1] - vehicle.gravity_mps2 * run.gradient * duration)
    asked = vehicle.wheel_radius_m * lost - vehicle.wheelset_inertia_kgm2 * float((wheel[-1] - wheel[0]).sum())
    off = [abs(asked - duration * float(values.mean(axis=0).sum())) for values in (torque, instead)]
    return (instead, constant) if off[1] < off[0] else (torque, [])
