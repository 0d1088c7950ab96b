"""Speeds in another unit: ratios of the wheels' speeds to the vehicle's where they slide least."""

import numpy as np

from wsp_env.recordings.suspect.channel import SuspectChannel, where
from wsp_env.recordings.suspect.search import Search, named, with_column
from wsp_env.recordings.suspect.traces import LEAST_SPEED_MPS

_TOLERANCE = 0.05  # radii differ within 2 %, wheels that never stop sliding by some more
_UNTOLD = 0.2  # log of a factor that sliding wheels may have as well: assumption
_ALIKE = 0.03  # ratios of wheels that share a fault: radii within 2 %

#: Recorded over true -> unit, of wheels and of the vehicle.
_TURNS = {60.0 / (2.0 * np.pi): "rpm", 1.0 / (2.0 * np.pi): "turn/s", 180.0 / np.pi: "deg/s"}
_MPH = 3600.0 / 1609.344
_VEHICLE = {3.6: "km/h", _MPH: "mph", 3600.0 / 1852.0: "knot", 3.280839895: "ft/s", 1e3: "mm/s"}


def find(search: Search) -> None:
    """Find and mend speeds in another unit."""
    radius = search.campaign.vehicle.wheel_radius_m
    wheels = _TURNS | {radius: "m/s", 3.6 * radius: "km/h", radius * _MPH: "mph"}
    wheels = {factor: unit for factor, unit in wheels.items() if abs(np.log(factor)) > _UNTOLD}  # rad/s of that radius as well
    seen: dict[tuple[int, float, str], list[str]] = {}
    for name in search.runs:
        for axle, factor, unit in _of_run(search, name, wheels):
            seen.setdefault((axle, factor, unit), []).append(name)
    for (axle, factor, unit), names in seen.items():
        channel = f"axle{axle}_wheel_speed" if axle else "vehicle_speed"
        search.report(
            SuspectChannel(
                channel,
                f"{factor:.4g} times what the other speeds ask for{where(names, search.runs)}: recorded in {unit}",
                f'give {channel} unit = "{unit}" in [channels]',
                "unit", axle, factor, tuple(names),
            )
        )  # fmt: skip
        for name in names:
            _mend(search, name, axle, factor)


def _of_run(search: Search, name: str, wheels: dict[float, str]) -> list[tuple[int, float, str]]:
    run = search.runs[name]
    fast = np.abs(run.vehicle_speed_mps) > LEAST_SPEED_MPS
    here = search.sound(name)
    if fast.sum() < 2 or not here:
        return []
    circumference = search.campaign.vehicle.wheel_radius_m * run.wheel_speed_radps[fast]
    ratios = np.quantile(circumference / run.vehicle_speed_mps[fast, None], 0.9, axis=0)
    usual = float(np.median(ratios[here]))
    found = []
    if len(here) > 1 or len(search.runs) == 1:
        factor, unit = named("", _VEHICLE, 1.0 / usual, _TOLERANCE)
        turned, turns = named("", wheels, usual, _TOLERANCE)
        if unit and (not turns or _vehicle_is_off(search, name, factor)):
            return [(0, factor, unit)]
        if turns:
            found = [(k + 1, turned, turns) for k in here if abs(np.log(ratios[k] / usual)) < _ALIKE]
            usual = 1.0
    for k in here:
        factor, unit = named("", wheels, float(ratios[k]), _TOLERANCE)
        if unit and abs(np.log(ratios[k] / usual)) > _TOLERANCE and not any(k + 1 == axle for axle, *_ in found):
            found.append((k + 1, factor, unit))
    return found


def _vehicle_is_off(search: Search, name: str, factor: float) -> bool:
    """Whether the vehicle's loss of momentum is nearer to the brakes' with its speed in another unit."""
    ratio = search.explained(name)
    return not ratio > 0.0 or abs(np.log(ratio / factor)) < abs(np.log(ratio))


def _mend(search: Search, name: str, axle: int, factor: float) -> None:
    run = search.runs[name]
    if not axle:
        search.mend(name, vehicle_speed_mps=run.vehicle_speed_mps / factor)
        return
    wheel = run.wheel_speed_radps
    search.mend(name, wheel_speed_radps=with_column(wheel, axle - 1, wheel[:, axle - 1] / factor))
