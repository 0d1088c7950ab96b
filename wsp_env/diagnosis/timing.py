"""Estimates and corrects differences between the axles' sampling instants, which are within one sample.

Loggers read their channels one after the other. Wheel speeds and torques of different axles therefore belong to instants that
differ by up to a sample. At 25 samples a second, the difference is a hundred standard deviations, and what a linear nuisance
leaves of it looks like a memory of the contaminant layer. The differences are estimated with all nuisances, and the axles'
channels are moved to their common mean. A common shift of all axles is not corrected: the vehicle's speed determines it badly
(an error of its scale looks the same), and a lag of all wheel speeds is a finding.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from wsp_env.diagnosis.covariance import Evidence, Sizes
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.variation import TORQUE_TIME, WHEEL_TIME, contrasts, nuisances
from wsp_env.recordings import Campaign

#: Share of a sample below which a shift of the channels has no visible effect.
_LEAST = 0.1


class Times(NamedTuple):
    """Lead of the recorded channels over the axles' mean [s], (A,) each: recorded(t) = true(t + lead)."""

    wheel: np.ndarray
    torque: np.ndarray
    matters: bool  # whether a correction has a visible effect
    sizes: Sizes | None = None  # of the nuisances, with which it was estimated


def times(replica: Replica) -> Times:
    """Estimate the lead of each axle's wheel speed and torque over the axles' mean, limited to one sample."""
    whitening = replica.whitening(replica.about)
    base = replica.raw(replica.baseline)
    groups = nuisances(replica, replica.baseline, base, whitening)
    evidence = Evidence(replica, whitening, groups, base)
    sizes = evidence.solve()
    amplitude = evidence.amplitudes(sizes)
    sample = replica.sample_s
    found = []
    for name in (WHEEL_TIME, TORQUE_TIME):
        at = evidence.names.index(name)
        early = groups[at].expected * contrasts(replica.axles) @ amplitude[evidence.group == at]
        found.append(np.clip(early, -sample, sample))
    return Times(found[0], found[1], bool(np.abs(found).max() > _LEAST * sample), sizes)


def aligned(campaign: Campaign, found: Times) -> Campaign:
    """Return the campaign with its wheel speeds and torques moved to common instants of the axles."""
    runs = {
        name: dataclasses.replace(
            run,
            wheel_speed_radps=_shifted(run.time_s, run.wheel_speed_radps, found.wheel),
            brake_torque_nm=_shifted(run.time_s, run.brake_torque_nm, found.torque),
        )
        for name, run in campaign.runs.items()
    }
    return dataclasses.replace(campaign, runs=runs)


def _shifted(time: np.ndarray, channels: np.ndarray, early: np.ndarray) -> np.ndarray:
    at = [np.clip(time - late, time[0], time[-1]) for late in early]
    return np.column_stack([CubicSpline(time, column)(instants) for column, instants in zip(channels.T, at, strict=True)])
