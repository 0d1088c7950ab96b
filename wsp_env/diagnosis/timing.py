"""When the axles' channels were read: within a sample of each other, and the recordings say when.

Loggers read their channels one after the other, so the wheel speeds and torques of different axles belong to instants that
differ by up to a sample. At 25 samples a second that is seen at a hundred deviations: what a nuisance that is linear in it
leaves looks like a contaminant layer with a memory. It is estimated beside everything that varies, and the axles' channels
are moved to their common mean. What all axles share stays: the vehicle's speed says it too badly (an error of its scale
looks the same), and a wheel speed that is late on all axles is a finding.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from wsp_env.diagnosis.covariance import Evidence
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.variation import TORQUE_TIME, WHEEL_TIME, contrasts, nuisances
from wsp_env.recordings import Campaign

#: Share of a sample below which moving the channels changes nothing that is seen.
_LEAST = 0.1
#: Iterations for the sizes of the nuisances: their order of magnitude is enough.
_ITERATIONS = 4


class Times(NamedTuple):
    """How much earlier the channels were read than the axles' mean [s]; (A,) each."""

    wheel: np.ndarray
    torque: np.ndarray
    matters: bool  # whether moving the channels is worth it


def times(replica: Replica) -> Times:
    """Estimate when each axle's wheel speed and torque were read, at most a sample from the axles' mean."""
    whitening = replica.whitening(replica.about)
    base = replica.raw(replica.baseline)
    groups = nuisances(replica, replica.baseline, base, whitening)
    evidence = Evidence(replica, whitening, groups, base, np.zeros((len(base), 0)))
    amplitude = evidence.amplitudes(evidence.solve(_ITERATIONS))
    sample = replica.sample_s
    found = []
    for name in (WHEEL_TIME, TORQUE_TIME):
        at = evidence.names.index(name)
        early = groups[at].expected * contrasts(replica.axles) @ amplitude[evidence.group == at]
        found.append(np.clip(early, -sample, sample))
    return Times(found[0], found[1], bool(np.abs(found).max() > _LEAST * sample))


def aligned(campaign: Campaign, found: Times) -> Campaign:
    """Return the campaign with its wheel speeds and torques moved to instants that the axles share."""
    runs = {
        name: dataclasses.replace(
            run,
            wheel_speed_radps=_moved(run.time_s, run.wheel_speed_radps, found.wheel),
            brake_torque_nm=_moved(run.time_s, run.brake_torque_nm, found.torque),
        )
        for name, run in campaign.runs.items()
    }
    return dataclasses.replace(campaign, runs=runs)


def _moved(time: np.ndarray, channels: np.ndarray, early: np.ndarray) -> np.ndarray:
    at = [np.clip(time - late, time[0], time[-1]) for late in early]
    return np.column_stack([CubicSpline(time, column)(instants) for column, instants in zip(channels.T, at, strict=True)])
