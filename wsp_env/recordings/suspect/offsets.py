"""Torques that are recorded before the brakes apply, though nothing brakes."""

import numpy as np

from wsp_env.recordings.suspect.channel import SuspectChannel, where
from wsp_env.recordings.suspect.search import Search, agreed, with_column
from wsp_env.recordings.suspect.traces import Traces

_APPLIED = 0.1  # of a run's largest change of torque: the brakes are applied from here on
_BEFORE_S = 0.3  # that stay away from it
_LEAST_S = 0.5  # of coasting
_MATTERS = 0.005  # of the wheelset's load times radius: a thirtieth of a good rail's adhesion: assumption
_SURE = 6.0  # deviations of its own mean


def find(search: Search) -> None:
    """Find and mend offsets."""
    seen: dict[int, dict[str, float]] = {}
    for name, one in search.traces().items():
        for axle, offset in _of_run(search, name, one).items():
            seen.setdefault(axle, {})[name] = offset
    for axle, values in sorted(seen.items()):
        channel, size = f"axle{axle + 1}_brake_torque", agreed(values)
        search.report(
            SuspectChannel(
                channel,
                f"an offset of {size / 1e3:.2g} kN m{where(values, search.runs)}: recorded while nothing brakes",
                f"take the mean while coasting away from {channel}, or have its sensor's zero checked",
                "offset", axle + 1, size, tuple(values),
            )
        )  # fmt: skip
        for name, offset in values.items():
            torque = search.runs[name].brake_torque_nm
            search.mend(name, brake_torque_nm=with_column(torque, axle, torque[:, axle] - offset))


def coasting(one: Traces, axles: list[int]) -> np.ndarray:
    """Return the samples (n,) at the recording's start before the brakes apply."""
    inside = np.flatnonzero(one.good)
    torque = one.torque[inside][:, axles]
    change = np.median(np.abs(torque - torque[:10].mean(axis=0)), axis=1)
    applied = np.flatnonzero(change > _APPLIED * max(float(change.max()), 1e-9))
    end = int(applied[0]) if applied.size else 0
    index = inside[: max(end - round(_BEFORE_S / one.step), 0)]
    return index if len(index) * one.step >= _LEAST_S else index[:0]


def _of_run(search: Search, name: str, one: Traces) -> dict[int, float]:
    """Offsets [N m] by axle (from 0) that the vehicle's coasting does not confirm."""
    vehicle, here = search.campaign.vehicle, search.sound(name)
    index = coasting(one, here)
    if not len(index):
        return {}
    means = one.torque[index].mean(axis=0)
    noise = np.abs(np.diff(search.runs[name].brake_torque_nm[index], axis=0)).mean(axis=0) / np.sqrt(len(index))
    least = _MATTERS * one.mass * vehicle.gravity_mps2 * vehicle.wheel_radius_m / one.axles
    off = [k for k in here if abs(means[k]) > max(least, _SURE * noise[k])]
    if not off:
        return {}
    # The wheels' speed, less noisy than the vehicle's: they roll.
    turning = np.median(one.wheel[index][:, here], axis=1)
    slope = float(np.polyfit(one.time[index] - one.time[index[0]], turning, 1)[0])
    a, b, c = vehicle.resistance_n
    speed = float(one.speed[index].mean())
    resisting = one.mass * vehicle.gravity_mps2 * one.gradient + a + b * speed + c * speed**2
    braked = -vehicle.wheel_radius_m * (one.mass * vehicle.wheel_radius_m * slope + resisting)  # [N m] of all wheels
    recorded = float(means[off].sum())
    if recorded > 0.0 and abs(braked - recorded) < abs(braked):
        return {}  # nearer to braking by as much than to coasting freely
    return {k: float(means[k]) for k in off}
