"""Zero errors of brake channels: what they read before the brakes are applied for the first time.

A released cylinder has no pressure. What its sensor reads then is its error, the same in all runs of a campaign, and is
subtracted; so is that of a torque that was computed from the pressure. A measured torque may be that of a brake that drags:
what axles read differently there only tells how large such errors are.
"""

import dataclasses

import numpy as np

from wsp_env.plant.card import APPLIED_SHARE
from wsp_env.recordings import Campaign

#: Largest zero error of a sensor over its largest reading (assumption: five times that of class 0.5).
_MOST = 0.025
#: Time before a brake counts as applied that is not used, because it fills [s]; shortest time that is, all runs together [s].
_FILLS_S, _LEAST_S = 0.5, 1.0
#: Fewest axles that tell what is usual: of three, one may drag.
_FEWEST = 3
_MEDIAN = 0.6745  # median of |x|, x normal with deviation 1


def zero_readings(channels: list[np.ndarray], step_s: float) -> np.ndarray:
    """Return what brake channels (T, A) of several runs read before the first application (A,); 0 if it is not known."""
    largest = max(float(np.abs(one).max()) for one in channels)
    released = []
    for one in channels:
        applied = np.logical_or.accumulate(np.abs(one) > APPLIED_SHARE * largest, axis=0)
        counts = np.maximum((~applied).sum(axis=0) - round(_FILLS_S / step_s), 0)
        released.append(np.arange(len(one))[:, None] < counts)
    counts = sum(one.sum(axis=0) for one in released)
    sums = sum((one * mask).sum(axis=0) for one, mask in zip(channels, released, strict=True))
    means = sums / np.maximum(counts, 1)
    result: np.ndarray = np.where((counts * step_s >= _LEAST_S) & (np.abs(means) < _MOST * largest), means, 0.0)
    return result


def zeroed(campaign: Campaign) -> Campaign:
    """Return a campaign whose pressures, or the torques computed from them, read zero before the brakes are applied."""
    runs, name = campaign.runs.values(), "cylinder_pressure_bar" if campaign.vehicle.torque_is_measured else "brake_torque_nm"
    having = [run for run in runs if getattr(run, name) is not None]
    if not having:
        return campaign
    zeros = zero_readings([getattr(run, name) for run in having], campaign.sample_time_s)
    corrected = {run.name: dataclasses.replace(run, **{name: getattr(run, name) - zeros}) for run in having}
    return dataclasses.replace(campaign, runs={**campaign.runs, **corrected})


def usual_zero(campaign: Campaign) -> float:
    """Return the standard deviation of the axles' zero errors over the largest measured torque [-]; 0 if it is not known.

    It is estimated from the median axle, so that one that drags does not count.
    """
    torques = [run.brake_torque_nm for run in campaign.runs.values()]
    zeros = np.sort(np.abs(zero_readings(torques, campaign.sample_time_s)))
    if not campaign.vehicle.torque_is_measured or len(zeros) < _FEWEST:
        return 0.0
    return float(zeros[(len(zeros) - 1) // 2]) / _MEDIAN / max(float(np.abs(one).max()) for one in torques)
