"""Estimation of the rail from sliding wheels: friction of the contaminant, and recovery rate by sliding.

For each recovery rate tau that is tried, slip and adhesion of a sliding wheel give mu_cd of the rail: with lambda = 1 -
exp(-tau f N e) known, f = (1 - lambda) f_d + lambda f_r gives f_d, and f_d gives mu_cd (eqs. 1 to 7 of the seed paper). Only
with the true tau is mu_cd the same at all slips. For each tau, mean and scatter of log mu_cd over all wheelsets are stored,
with slow fading.
"""

import math
from typing import NamedTuple

import numpy as np

from wsp_env.compiled import inlined
from wsp_env.contact import degraded
from wsp_env.contact.degraded import DegradedLaw
from wsp_env.contact.polach import falling_friction, saturation
from wsp_env.parameters.vehicle import Vehicle

#: Recovery rates that are tried [m/J]; 0 is the classic law.
RECOVERY_M_PER_J = (0.0, 1e-4, 2e-4, 3.5e-4)

#: Creepage [-] from which on a wheel is used; below, the stiffness of the contact determines most of the adhesion (assumption).
SLIDING_CREEPAGE = 0.015

#: Time constant of the fading, in seconds of sliding [s].
MEMORY_S = 8.0

#: Prior: mu_cd [-] and standard deviation of its logarithm, with the weight of this time of sliding [s] (assumptions).
START_FRICTION = 0.035
START_DEVIATION = 0.4
START_S = 0.1

#: Bounds of mu_cd [-].
_RANGE = (0.004, 0.3)


class RailEstimate(NamedTuple):
    """Estimates of the rails of N vehicles for K recovery rates, changed in place: read them, do not keep references."""

    seen: np.ndarray  # (N,) time for which wheels have slid, fading [s]
    friction: np.ndarray  # (N, K) mu_cd, exp of the mean of its logarithm [-]
    deviation: np.ndarray  # (N, K) standard deviation of log mu_cd [-]
    mean: np.ndarray  # (N, K) mean of log mu_cd [-]
    square: np.ndarray  # (N, K) mean of its square [-]
    sums: np.ndarray  # (2, K) scratch: sums of log mu_cd and of its square over the axles of a vehicle


class RailEstimateConstants(NamedTuple):
    """Constants common to all vehicles."""

    interval: float  # between measurements [s]
    load: float  # on one wheel with half the payload [N]
    law: DegradedLaw


def constants(vehicle: Vehicle, interval: float) -> RailEstimateConstants:
    """Return the constants for a measurement interval [s]."""
    mass = vehicle.mass_kg + 0.5 * vehicle.payload_kg
    return RailEstimateConstants(
        interval, mass * vehicle.gravity_mps2 / (2.0 * vehicle.axles), degraded.LAW.make(vehicle.contact)
    )


def allocate(n: int) -> RailEstimate:
    """Allocate the estimates of n rails; `begin` sets their values."""
    rates = len(RECOVERY_M_PER_J)
    shapes = {"seen": (n,), "sums": (2, rates)}
    return RailEstimate(*(np.zeros(shapes.get(name, (n, rates))) for name in RailEstimate._fields))


@inlined
def begin(i: int, r: RailEstimate) -> None:
    """Begin a new stop of vehicle i with the prior of its rail."""
    r.seen[i] = START_S
    for j in range(len(RECOVERY_M_PER_J)):
        r.mean[i, j] = math.log(START_FRICTION)
        r.square[i, j] = math.log(START_FRICTION) ** 2 + START_DEVIATION**2
        _conclude(i, j, r)


@inlined
def update(i: int, slip: np.ndarray, adhesion: np.ndarray, speed: float, r: RailEstimate, c: RailEstimateConstants) -> bool:
    """Update the rail of vehicle i by slips (N, A) [m/s] and adhesions (N, A), smoothed alike, at its running speed [m/s].

    Return whether any wheel slides, so that the estimate changed.
    """
    share = 0.0
    if speed > 3.0:
        for k in range(slip.shape[1]):
            creepage = slip[i, k] / speed
            if creepage > SLIDING_CREEPAGE and adhesion[i, k] > 0.0:
                if share == 0.0:
                    for j in range(len(RECOVERY_M_PER_J)):
                        r.sums[0, j] = r.sums[1, j] = 0.0
                share += c.interval
                _add(i, slip[i, k], adhesion[i, k], creepage, r, c)
    if share == 0.0:
        return False
    before = math.exp(-share / MEMORY_S) * r.seen[i]
    after = before + share
    for j in range(len(RECOVERY_M_PER_J)):
        r.mean[i, j] = (before * r.mean[i, j] + r.sums[0, j]) / after
        r.square[i, j] = (before * r.square[i, j] + r.sums[1, j]) / after
        _conclude(i, j, r)
    r.seen[i] = after
    return True


@inlined
def _conclude(i: int, j: int, r: RailEstimate) -> None:
    r.friction[i, j] = math.exp(r.mean[i, j])
    r.deviation[i, j] = math.sqrt(max(r.square[i, j] - r.mean[i, j] * r.mean[i, j], 0.0))


@inlined
def _add(i: int, slip: float, adhesion: float, creepage: float, r: RailEstimate, c: RailEstimateConstants) -> None:
    """Add log mu_cd and its square, from one wheel's slip and adhesion, for each tau, weighted with the interval."""
    law, load = c.law, c.load
    recovered = falling_friction(slip, law.mu_cr, law.ratio_r, law.gamma_r)
    recovered *= saturation(law.stiffness * creepage / (recovered * load), law.k_ar, law.k_sr)
    falling = falling_friction(slip, 1.0, law.ratio_d, law.gamma_d)
    work = adhesion * load * creepage
    gradient = law.stiffness * creepage / (falling * load)
    for j in range(len(RECOVERY_M_PER_J)):
        kept = math.exp(-RECOVERY_M_PER_J[j] * work)  # 1 - lambda
        degraded = (adhesion - (1.0 - kept) * recovered) / kept
        share = saturation(gradient / r.friction[i, j], law.k_ad, law.k_sd)
        implied = degraded / max(falling * share, 0.1)
        logarithm = math.log(min(max(implied, _RANGE[0]), _RANGE[1]))
        r.sums[0, j] += c.interval * logarithm
        r.sums[1, j] += c.interval * logarithm * logarithm
