"""Do the channels of one stop belong together? Speeds in another unit, swapped axles, dead sensors."""

import dataclasses

import numpy as np
from scipy.optimize import linear_sum_assignment

from wsp_env.recordings.recording import Recording
from wsp_env.recordings.table import CampaignError
from wsp_env.recordings.vehicle import CampaignVehicle

_STEP_S = 0.01  # of the samples that are looked at
_LEAST_SPEED_MPS = 5.0  # ratios of speeds are taken above it
_FACTOR_TOLERANCE = 0.1  # a ratio this near to a unit's factor is taken for that unit
_BALANCE = (
    0.5,
    2.0,
)  # outside, the brakes do not explain the deceleration: assumption, other brakes rarely do as much as all discs
_CORRELATION = 0.3  # torque and wheel acceleration of one axle that a WSP works on are tied closer than this

#: Ratio of a speed channel to what it should be -> what it was recorded in.
_UNITS = {3.6: "km/h", 2.2369: "mph", 60.0 / (2.0 * np.pi): "rpm", 1.0 / (2.0 * np.pi): "turn/s", 180.0 / np.pi: "deg/s"}


def check(run: Recording, vehicle: CampaignVehicle, where: str) -> list[str]:
    """Return what looks wrong, sentence by sentence.

    Raises
    ------
    CampaignError
        for a dead speed channel, or one in another unit

    """
    _dead(run, where)
    coarse = _thinned(run)
    notes = _radius(coarse, vehicle, where) + _balance(run, vehicle, where) + _swapped(coarse, vehicle, where)
    constant = [f"axle {k + 1}" for k in np.flatnonzero(np.ptp(run.brake_torque_nm, axis=0) == 0.0)]
    if constant:
        notes.append(f"{where}: the brake torque of {', '.join(constant)} never changes: brake isolated, or a dead channel")
    return notes


def _thinned(run: Recording) -> Recording:
    """Return one sample in every hundredth of a second: enough here, and a long recording fits the memory."""
    stride = max(round(_STEP_S / float(np.median(np.diff(run.time_s[:10_000])))), 1)
    return dataclasses.replace(
        run,
        time_s=run.time_s[::stride],
        vehicle_speed_mps=run.vehicle_speed_mps[::stride],
        wheel_speed_radps=run.wheel_speed_radps[::stride],
        brake_torque_nm=run.brake_torque_nm[::stride],
    )


def _dead(run: Recording, where: str) -> None:
    channels = {"vehicle_speed": run.vehicle_speed_mps}
    channels |= {f"axle{k + 1}_wheel_speed": run.wheel_speed_radps[:, k] for k in range(run.wheel_speed_radps.shape[1])}
    for name, values in channels.items():
        if np.ptp(values) == 0.0:
            raise CampaignError(f"{where}: {name} is {values[0]:g} throughout: a dead channel; map another column to it")
    if run.vehicle_speed_mps.mean() < 0.0:
        raise CampaignError(f"{where}: vehicle_speed is negative; give it scale = -1 in [channels]")
    if (run.wheel_speed_radps.mean(axis=0) < 0.0).any():
        raise CampaignError(f"{where}: a wheel speed is negative; give it scale = -1 in [channels]")


def _radius(run: Recording, vehicle: CampaignVehicle, where: str) -> list[str]:
    """Compare the wheels with the vehicle where they slide least."""
    fast = run.vehicle_speed_mps > _LEAST_SPEED_MPS
    if not fast.any():
        return [f"{where}: the vehicle is never faster than {_LEAST_SPEED_MPS:g} m/s: nothing to compare with the law"]
    ratios = vehicle.wheel_radius_m * run.wheel_speed_radps[fast] / run.vehicle_speed_mps[fast, None]
    rolling = np.quantile(ratios, 0.95, axis=0)
    notes = []
    for axle, ratio in enumerate(rolling, start=1):
        for factor, unit in _UNITS.items():
            if abs(ratio / factor - 1.0) < _FACTOR_TOLERANCE:
                raise CampaignError(
                    f"{where}: axle{axle}_wheel_speed is {ratio:.2f} times what the vehicle's speed asks for: recorded in "
                    f'{unit}? Give its unit = "{unit}" in [channels]'
                )
            if unit in ("km/h", "mph") and abs(ratio * factor - 1.0) < _FACTOR_TOLERANCE:
                raise CampaignError(
                    f"{where}: vehicle_speed is {1.0 / ratio:.2f} times the wheels': recorded in {unit}? "
                    f'Give it unit = "{unit}" in [channels]'
                )
        if abs(ratio - 1.0) > _FACTOR_TOLERANCE:
            notes.append(
                f"{where}: at its fastest, axle {axle} turns {ratio:.2f} times as fast as the vehicle goes: it slides "
                "throughout, or a speed or wheel_radius_m is wrong"
            )
    return notes


def _balance(run: Recording, vehicle: CampaignVehicle, where: str) -> list[str]:
    """Compare the vehicle's loss of momentum with what the brakes and the wheels' inertia explain."""
    step = float((run.time_s[-1] - run.time_s[0]) / (len(run.time_s) - 1))
    gravity = run.mass_kg * vehicle.gravity_mps2 * run.gradient * step * len(run.time_s)
    lost = run.mass_kg * (run.vehicle_speed_mps[0] - run.vehicle_speed_mps[-1]) - gravity
    spun = vehicle.wheelset_inertia_kgm2 * (run.wheel_speed_radps[-1] - run.wheel_speed_radps[0]).sum()
    braked = float((run.brake_torque_nm.sum() * step + spun) / vehicle.wheel_radius_m)
    if abs(lost) < 0.05 * run.mass_kg * float(run.vehicle_speed_mps.max()):
        return []
    ratio = lost / braked if braked else np.inf
    if abs(ratio / 3.6 - 1.0) < _FACTOR_TOLERANCE:
        raise CampaignError(
            f"{where}: the vehicle slows {ratio:.2f} times as much as its brakes explain: all speeds in km/h? "
            'Give their unit = "km/h" in [channels]'
        )
    if ratio < 0.0:
        return [f"{where}: the brake torques drive the vehicle; if they are counted negative in braking, give them scale = -1"]
    if not _BALANCE[0] < ratio < _BALANCE[1]:
        return [f"{where}: the vehicle slows {ratio:.2g} times as much as its brakes explain; check mass_kg and the torques"]
    return []


def _swapped(run: Recording, vehicle: CampaignVehicle, where: str) -> list[str]:
    """Tie each torque to a wheel: J dw/dt = 2 r T_c - C, so that fast changes of C show in dw/dt of the same axle."""
    axles = vehicle.axles
    if axles < 2 or len(run.time_s) < 100:
        return []
    step = float(np.median(np.diff(run.time_s)))
    width = max(round(0.1 / step), 1)  # differences over 0.1 s: long against noise, short against the stop
    torque = run.brake_torque_nm[width:] - run.brake_torque_nm[:-width]
    smooth = run.wheel_speed_radps[width:] - run.wheel_speed_radps[:-width]
    change = smooth[width:] - smooth[:-width]
    torque = torque[width // 2 : width // 2 + len(change)]
    if (np.ptp(torque, axis=0) == 0.0).any() or (np.ptp(change, axis=0) == 0.0).any():
        return []
    tied = -np.corrcoef(torque, change, rowvar=False)[:axles, axles:]
    _, best = linear_sum_assignment(-tied)
    wrong = [
        k for k in range(axles) if best[k] != k and tied[k, best[k]] > _CORRELATION and tied[k, best[k]] > 2.0 * tied[k, k]
    ]
    if not wrong:
        return []
    pairs = ", ".join(f"the torque of axle {k + 1} with the wheel of axle {best[k] + 1}" for k in wrong)
    return [f"{where}: changes of torque go with those of another axle's wheel ({pairs}): channels swapped?"]
