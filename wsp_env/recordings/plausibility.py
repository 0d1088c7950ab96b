"""Do the channels of one stop belong together? Speeds in another unit, swapped axles, dead sensors."""

import dataclasses

import numpy as np
from scipy.optimize import linear_sum_assignment

from wsp_env.parameters.campaign_vehicle import CampaignVehicle
from wsp_env.recordings.errors import CampaignError, ContradictionError
from wsp_env.recordings.recording import Recording

_STEP_S = 0.01  # of the samples that are looked at
_LEAST_SPEED_MPS = 5.0  # ratios of speeds are taken above it
_FACTOR_TOLERANCE = 0.1  # a ratio this near to a unit's factor is taken for that unit
_BALANCE = (
    0.5,
    2.0,
)  # outside, the brakes do not explain the deceleration: assumption, other brakes rarely do as much as all discs
_KILO = 1000.0  # torques in kN m, masses in tonnes
_LEAST_AXLE_LOAD_KG = 1000.0  # of a railway vehicle: assumption
_ALIKE = 0.05  # log of the ratio between wheels that share a fault: radii differ within 2 %, and wheels slide
_TWICE = 0.05  # to two: a diameter taken for a radius
_LEAST_LOST = 0.05  # of the speed; a smaller loss says little
_CHANGE_S = 0.05  # [s] over which changes are taken
_SMOOTHER = 0.8  # share of the roughness that exchanging some axles must leave at most: simulated stops with channels as
# they should be, with and without unmodelled physics, leave 0.95 or more (1704 stops); of swapped pairs it sees four in ten

#: Ratio of a speed channel to what it should be -> what it was recorded in.
_UNITS = {3.6: "km/h", 2.2369: "mph", 60.0 / (2.0 * np.pi): "rpm", 1.0 / (2.0 * np.pi): "turn/s", 180.0 / np.pi: "deg/s"}


def check(run: Recording, vehicle: CampaignVehicle, where: str) -> list[str]:
    """Return what looks wrong, sentence by sentence.

    Raises
    ------
    CampaignError
        for a dead vehicle speed, or a wrong entry of campaign.toml; a `ContradictionError` for a channel in another unit or of
        the wrong sign

    """
    _dead(run, where)
    moving = run.under_way(vehicle.wheel_radius_m)
    coarse = _thinned(moving)
    notes = _radius(coarse, vehicle, where) + _balance(moving, vehicle, where) + _swapped(coarse, vehicle, where)
    if constant := [f"axle {k + 1}" for k in np.flatnonzero(constant_torques(run))]:
        notes.append(
            f"{where}: the brake torque of {', '.join(constant)} never changes: brake isolated, or a dead channel; "
            "not compared with the law"
        )
    return notes


def constant_torques(run: Recording) -> np.ndarray:
    """Return which axles (axles,) bool have a brake torque that never changes: nothing to compare with the law."""
    constant: np.ndarray = np.ptp(run.brake_torque_nm, axis=0) == 0.0
    return constant


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
    if np.ptp(run.vehicle_speed_mps) == 0.0:
        raise CampaignError(
            f"{where}: vehicle_speed is {run.vehicle_speed_mps[0]:g} throughout: a dead channel; map another column to it"
        )
    if run.vehicle_speed_mps.mean() < 0.0:
        raise ContradictionError(where, "vehicle_speed", "is negative", "give vehicle_speed scale = -1 in [channels]", -1.0)
    if (negative := np.flatnonzero(run.wheel_speed_radps.mean(axis=0) < 0.0)).size:
        channel = (
            "axle*_wheel_speed" if len(negative) == run.wheel_speed_radps.shape[1] else f"axle{negative[0] + 1}_wheel_speed"
        )
        raise ContradictionError(where, channel, "is negative", f"give {channel} scale = -1 in [channels]", -1.0)


def _radius(run: Recording, vehicle: CampaignVehicle, where: str) -> list[str]:
    """Compare the wheels with the vehicle where they slide least."""
    fast = run.vehicle_speed_mps > _LEAST_SPEED_MPS
    if not fast.any():
        return [f"{where}: the vehicle is never faster than {_LEAST_SPEED_MPS:g} m/s: nothing to compare with the law"]
    ratios = vehicle.wheel_radius_m * run.wheel_speed_radps[fast] / run.vehicle_speed_mps[fast, None]
    rolling = np.quantile(ratios, 0.95, axis=0)
    if np.ptp(np.log(np.maximum(rolling, 1e-9))) < _ALIKE:
        _vehicle_entries(run, vehicle, float(np.median(rolling)), where)
    notes = []
    for axle, ratio in enumerate(rolling, start=1):
        if axle in run.missing_axles:
            continue  # its channel stands in
        for factor, unit in _UNITS.items():
            if abs(ratio / factor - 1.0) < _FACTOR_TOLERANCE:
                raise ContradictionError(
                    where,
                    f"axle{axle}_wheel_speed",
                    f"is {ratio:.2f} times what the vehicle's speed asks for: recorded in {unit}?",
                    f'give axle{axle}_wheel_speed unit = "{unit}" in [channels]',
                    float(ratio),
                )
            if unit in ("km/h", "mph") and abs(ratio * factor - 1.0) < _FACTOR_TOLERANCE:
                raise ContradictionError(
                    where,
                    "vehicle_speed",
                    f"is {1.0 / ratio:.2f} times the wheels': recorded in {unit}?",
                    f'give vehicle_speed unit = "{unit}" in [channels]; if only this run differs, convert its file',
                    float(1.0 / ratio),
                )
        if abs(ratio - 1.0) > _FACTOR_TOLERANCE:
            notes.append(
                f"{where}: at its fastest, axle {axle} turns {ratio:.2f} times as fast as the vehicle goes: it slides "
                "throughout, or a speed or wheel_radius_m is wrong"
            )
    return notes


def _vehicle_entries(run: Recording, vehicle: CampaignVehicle, ratio: float, where: str) -> None:
    """Raise where all wheels turn so many times as fast as the vehicle goes, and its momentum says what else is wrong."""
    momentum = _explained(run, vehicle, 1.0, 1.0)

    def nearer(factor: float) -> bool:
        return momentum > 0.0 and bool(abs(np.log(momentum * factor)) < abs(np.log(momentum)))

    if abs(ratio / 2.0 - 1.0) < _TWICE and nearer(0.5):
        raise CampaignError(
            f"{where}: all wheels turn {ratio:.2f} times as fast as the vehicle goes: wheel_radius_m = "
            f"{vehicle.wheel_radius_m:g} looks like the diameter; give wheel_radius_m = {vehicle.wheel_radius_m / 2.0:g}"
        )
    for factor, unit in _UNITS.items():
        if unit in ("km/h", "mph") and abs(ratio / factor - 1.0) < _FACTOR_TOLERANCE and nearer(ratio):
            raise ContradictionError(
                where,
                "vehicle_speed",
                f"is {1.0 / ratio:.3f} times what all wheels say: recorded in m/s and taken for {unit}?",
                "correct the unit of vehicle_speed in [channels]; if other runs are in this unit, convert their files",
                1.0 / ratio,
            )


def _balance(run: Recording, vehicle: CampaignVehicle, where: str) -> list[str]:
    """Compare the vehicle's loss of momentum with what the brakes and the wheels' inertia explain."""
    ratio = _explained(run, vehicle, 1.0, 1.0)
    if _BALANCE[0] < ratio < _BALANCE[1] or np.isnan(ratio):
        return []
    if abs(_explained(run, vehicle, 1.0 / 3.6, 1.0) - 1.0) < _FACTOR_TOLERANCE:
        raise CampaignError(
            f"{where}: the vehicle slows {ratio:.2f} times as much as its brakes explain, and once if all speeds are in km/h; "
            'give their unit = "km/h" in [channels]'
        )
    if run.mass_kg < _LEAST_AXLE_LOAD_KG * vehicle.axles and _BALANCE[0] < _KILO * ratio < _BALANCE[1]:
        raise CampaignError(
            f"{where}: the brakes explain the deceleration of 1000 times the mass: mass_kg = {run.mass_kg:g} on "
            f"{vehicle.axles} axles looks like tonnes; give it in kg"
        )
    if _BALANCE[0] < _explained(run, vehicle, 1.0, _KILO) < _BALANCE[1]:
        raise ContradictionError(
            where,
            "axle*_brake_torque",
            "explains the deceleration if it is in kN m",
            'give axle*_brake_torque unit = "kN*m" in [channels]',
            1.0 / _KILO,
        )
    if abs(_explained(run, vehicle, 1.0, -1.0) - 1.0) < _FACTOR_TOLERANCE:
        raise ContradictionError(
            where,
            "axle*_brake_torque",
            "drives the vehicle: it is counted negative in braking",
            "give axle*_brake_torque scale = -1 in [channels]",
            -1.0,
        )
    explained = f"{ratio:.2g} times as much as its brakes explain" if ratio > 0.0 else "and its brakes do not explain it"
    return [f"{where}: the vehicle slows {explained}; check mass_kg and the torques"]


def _explained(run: Recording, vehicle: CampaignVehicle, speeds: float, torques: float) -> float:
    """Return lost over explained momentum, were speeds and torques multiplied by these; nan where hardly any is lost."""
    duration = float(run.time_s[-1] - run.time_s[0])
    lost = run.mass_kg * speeds * (run.vehicle_speed_mps[0] - run.vehicle_speed_mps[-1])
    if abs(lost) < _LEAST_LOST * run.mass_kg * speeds * float(run.vehicle_speed_mps.max()):
        return np.nan
    lost -= run.mass_kg * vehicle.gravity_mps2 * run.gradient * duration
    spun = vehicle.wheelset_inertia_kgm2 * speeds * (run.wheel_speed_radps[-1] - run.wheel_speed_radps[0]).sum()
    braked = torques * run.brake_torque_nm.mean(axis=0).sum() * duration
    return float(lost * vehicle.wheel_radius_m / (braked + spun)) if braked + spun else np.inf


def _swapped(run: Recording, vehicle: CampaignVehicle, where: str) -> list[str]:
    """Tie each torque to a wheel: C + J dw/dt = 2 r T_c changes smoothly only if both belong to one axle."""
    step = float(run.time_s[-1] - run.time_s[0]) / (len(run.time_s) - 1)
    width = max(round(_CHANGE_S / step), 1)
    if vehicle.axles < 2 or len(run.time_s) < 8 * width or run.missing_axles or constant_torques(run).any():
        return []
    turning = (run.wheel_speed_radps[2 * width :] - run.wheel_speed_radps[: -2 * width]) / (2 * width * step)
    force = run.brake_torque_nm[width:-width, :, None] + vehicle.wheelset_inertia_kgm2 * turning[:, None, :]
    roughness = np.mean((force[2 * width :] - force[: -2 * width]) ** 2, axis=0)  # (axles of torque, axles of wheel)
    _, wheel = linear_sum_assignment(roughness)
    wrong = [
        k
        for cycle in _cycles(wheel)
        if roughness[cycle, wheel[cycle]].sum() < _SMOOTHER * roughness[cycle, cycle].sum()
        for k in cycle
    ]
    if not wrong:
        return []
    pairs = ", ".join(f"the torque of axle {k + 1} with the wheel of axle {wheel[k] + 1}" for k in wrong)
    return [f"{where}: changes of torque go with those of another axle's wheel ({pairs}): channels swapped?"]


def _cycles(permutation: np.ndarray) -> list[list[int]]:
    """Return the axles that a permutation exchanges among themselves, group by group: evidence counts for all of a group."""
    left, cycles = set(range(len(permutation))), []
    while left:
        cycle, k = [], min(left)
        while k in left:
            left.remove(k)
            cycle.append(k)
            k = int(permutation[k])
        if len(cycle) > 1:
            cycles.append(cycle)
    return cycles
