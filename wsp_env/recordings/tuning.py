"""Tuning of the recovery rate tau on recorded stops, and scoring of the law (the seed paper's section 4).

What is compared. Eq. (12) compares lambda, for which eq. (3) is divided by f_r - f_d; here f itself is compared, as
Table 4's errors are.

What is fitted. One tau over the runs of the tune group and, unless the believed one is to be kept, one mu_cd per run,
a property of that run's rail. The runs to validate never touch tau: with tau frozen, each gets its own rail's mu_cd
from its own samples (one number), then its errors. A run without sliding says nothing on either: its mu_cd
stays the believed one and its errors are None.
"""

import dataclasses
import warnings
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from wsp_env.contact.degraded import degraded_adhesion
from wsp_env.recordings import bootstrap
from wsp_env.recordings.campaign import Campaign
from wsp_env.recordings.derive import Derived, Smoothing, derive, rolling_radii
from wsp_env.recordings.errors import CampaignError, CampaignWarning

#: Sliding for less than this [s], summed over the axles, says nothing on a run's friction.
LEAST_SLIDING_S = 2.0

#: Residuals in different stretches of track of this length [m] count as independent: twice and more what mu_cd varies over.
STRETCH_M = 40.0

#: A relative error beyond this [-] is a channel's rather than the law's: ten times the worst of the paper's Table 4.
_ABSURD_ERROR = 0.5

#: The gain between cylinder pressure and torque is known within this share [-]: assumption, disc brakes of one make.
GAIN_SPREAD = 0.01

#: Said of a tau that any value would do for.
UNDETERMINED = "the runs to tune on do not determine it, name runs in which wheels slide more"

_TAU_BOUNDS = (1e-7, 1e-1)  # [m/J]
_TAU_START = 1e-4  # [m/J]
_LEAST_FRICTION = 1e-3  # [-]


@dataclasses.dataclass(frozen=True)
class RunScore:
    """How the tuned law fits one run."""

    group: str  # "tune" or "validate"
    mu_cd: float  # [-]
    mu_cd_tuned: bool  # or the believed one
    error: tuple[float | None, ...]  # e_j = ||f_sp - f|| / ||f_sp|| [-] per axle; None where an axle never slides
    missing_axles: tuple[int, ...] = ()  # from 1: without a usable sensor

    @property
    def slides(self) -> bool:
        """Whether any axle slides, so that mu_cd could be fitted."""
        return any(error is not None for error in self.error)


@dataclasses.dataclass(frozen=True)
class Tuning:
    """The tuned law: tau and its 95 % interval [m/J], and every run's score."""

    tau_m_per_J: float  # noqa: N815 (the unit's symbol)
    interval95: tuple[float, float]  # 0 and inf where the runs leave it open
    runs: dict[str, RunScore]

    @property
    def determined(self) -> bool:
        """Whether the runs tuned on tell tau from none and from any."""
        low, high = _TAU_BOUNDS
        return low < self.interval95[0] and self.interval95[1] < high

    @property
    def absurd(self) -> list[str]:
        """Say which axles the law misses by so much that a channel is to be doubted first."""
        return [
            f"run {name}, axle {k}: the tuned law misses the measured adhesion by {100.0 * error:.0f} %; look at the units and "
            "wires of that axle's wheel speed and torque before anything else"
            for name, score in self.runs.items()
            for k, error in enumerate(score.error, 1)
            if error is not None and error > _ABSURD_ERROR
        ]

    @property
    def sentence(self) -> str:
        """What tau is, for people."""
        low, high = self.interval95
        said = f"tau = {self.tau_m_per_J:.3e} m/J, 95 % interval {low:.3e} to {high:.3e} m/J"
        return said if self.determined else f"{said}: {UNDETERMINED}"

    def to_json(self) -> dict[str, Any]:
        """Return plain data: errors per axle, null where an axle never slides; null for an end of the interval that is open."""
        runs = {
            name: {"group": score.group, "mu_cd": score.mu_cd, "mu_cd_tuned": score.mu_cd_tuned, "error": list(score.error)}
            for name, score in self.runs.items()
        }
        return {
            "tau_m_per_J": self.tau_m_per_J,
            "interval95": [end if np.isfinite(end) else None for end in self.interval95],
            "determined": self.determined,
            "runs": runs,
        }

    def adhesion(self, campaign: Campaign, derived: Derived, mu_cd: float) -> np.ndarray:
        """Adhesion coefficient f [-] (T, axles) of the tuned law at the measured slip and speed, eq. (10)."""
        return _model(campaign, derived, self.tau_m_per_J, mu_cd)


def tune(campaign: Campaign, smoothing: Smoothing = Smoothing(), tune_friction: bool = True) -> Tuning:
    """Tune tau (and mu_cd per run) on the tune group, score both groups.

    Parameters
    ----------
    tune_friction : fit mu_cd of every sliding run; False keeps the believed ones

    Raises
    ------
    CampaignError
        when no run to tune on slides, or a recording is too short

    """
    radii = rolling_radii(campaign, smoothing)
    chosen = (*campaign.tune, *campaign.validate)
    derived = {name: derive(campaign, campaign.runs[name], radii, smoothing) for name in chosen}
    slides = {name: bool(d.usable.sum() * campaign.sample_time_s >= LEAST_SLIDING_S) for name, d in derived.items()}
    tuned_on = [name for name in campaign.tune if slides[name]]
    if not tuned_on:
        raise CampaignError(
            f"campaign {campaign.name}: no run to tune on ({', '.join(campaign.tune)}) slides for {LEAST_SLIDING_S:g} s "
            f"with a creepage above {smoothing.least_creepage:g}: tau cannot be seen; name runs with sliding in "
            "[campaign] tune"
        )
    problem = _Problem(campaign, {name: derived[name] for name in tuned_on}, tune_friction)
    tau, interval, frictions = problem.solve()
    runs = {}
    for name in chosen:
        believed = campaign.runs[name].kinetic_friction_d
        if tune_friction and slides[name] and name not in frictions:
            frictions |= _Problem(campaign, {name: derived[name]}, True, tau).solve()[2]
        mu_cd = frictions.get(name, believed) if tune_friction else believed
        error = _errors(campaign, derived[name], tau, mu_cd) if slides[name] else (None,) * campaign.vehicle.axles
        group, absent = "tune" if name in campaign.tune else "validate", campaign.runs[name].missing_axles
        runs[name] = RunScore(group, mu_cd, tune_friction and slides[name], error, absent)
    tuning = Tuning(tau, interval, runs)
    if not tuning.determined:
        warnings.warn(f"campaign {campaign.name}: {tuning.sentence}", CampaignWarning, stacklevel=2)
    return tuning


def tune_classic(campaign: Campaign, name: str, derived: Derived) -> float:
    """Return the mu_cd [-] with which the classic law (no recovery, tau = 0) fits a sliding run best."""
    return _Problem(campaign, {name: derived}, True, 0.0).solve()[2][name]


class _Problem:
    """Least squares of f over some runs; the parameters are the logarithms of tau (unless given) and of mu_cd."""

    def __init__(self, campaign: Campaign, derived: dict[str, Derived], friction: bool, tau: float | None = None):
        self.campaign, self.derived, self.friction, self.tau = campaign, derived, friction, tau
        self.believed = np.log([campaign.runs[name].kinetic_friction_d for name in derived])

    def unpack(self, parameters: np.ndarray) -> tuple[float, np.ndarray]:
        """Return tau [m/J] and mu_cd [-] of each run (runs,)."""
        tau = float(np.exp(parameters[0])) if self.tau is None else self.tau
        return tau, np.exp(parameters[-len(self.believed) :] if self.friction else self.believed)

    def residuals(self, parameters: np.ndarray) -> np.ndarray:
        """f_sp - f of all usable samples, run after run."""
        tau, frictions = self.unpack(parameters)
        pairs = zip(self.derived.values(), frictions, strict=True)
        return np.concatenate([(d.adhesion - _model(self.campaign, d, tau, mu))[d.usable] for d, mu in pairs])

    def solve(self) -> tuple[float, tuple[float, float], dict[str, float]]:
        """Return tau, its interval, and mu_cd by run."""
        highest = np.log(self.campaign.contact.kinetic_friction_r)
        start, low, high = [], [], []
        if self.tau is None:
            start, low, high = [np.log(_TAU_START)], [np.log(_TAU_BOUNDS[0])], [np.log(_TAU_BOUNDS[1])]
        if self.friction:
            start += list(self.believed)
            low += [np.log(_LEAST_FRICTION)] * len(self.believed)
            high += [highest] * len(self.believed)
        fit = least_squares(self.residuals, start, bounds=(low, high), x_scale="jac")
        tau, frictions = self.unpack(fit.x)
        interval = (tau, tau) if self.tau is not None else self.interval(fit.x, fit.fun, fit.jac)
        return tau, interval, dict(zip(self.derived, map(float, frictions), strict=True))

    def interval(self, solution: np.ndarray, residuals: np.ndarray, jacobian: np.ndarray) -> tuple[float, float]:
        """95 % interval of tau [m/J]: block bootstrap over stretches of track, and over the brakes' gains unless measured."""
        places = np.concatenate([_place(self.campaign, name, d)[d.usable] for name, d in self.derived.items()])
        axles = np.concatenate([np.nonzero(d.usable)[1] for d in self.derived.values()])
        shares = np.concatenate([d.torque_share[d.usable] for d in self.derived.values()])
        blocks = bootstrap.Blocks.of(jacobian, residuals, places // STRETCH_M, axles, shares)
        low, high = bootstrap.interval95(blocks, 0.0 if self.campaign.vehicle.torque_is_measured else GAIN_SPREAD)
        ends = solution[0] + np.array([low, high])  # of the logarithm
        least, most = np.log(_TAU_BOUNDS)
        return (
            0.0 if ends[0] <= least else float(np.exp(ends[0])),
            np.inf if ends[1] >= most else float(np.exp(ends[1])),
        )


def _place(campaign: Campaign, name: str, derived: Derived) -> np.ndarray:
    """Place [m] of each axle along the track (T, axles)."""
    travelled = np.cumsum(derived.speed_mps) * campaign.sample_time_s
    behind = np.array(campaign.vehicle.axle_positions_m or (0.0,) * campaign.vehicle.axles)
    place: np.ndarray = campaign.runs[name].start_position_m + travelled[:, None] - behind
    return place


def _model(campaign: Campaign, derived: Derived, tau: float, mu_cd: float) -> np.ndarray:
    """Adhesion coefficient f [-] (T, axles) of the law at the measured slip and speed, eq. (10)."""
    speed = derived.speed_mps[:, None]
    return degraded_adhesion(derived.slip_speed_mps, speed, derived.normal_load_n, mu_cd, tau, campaign.contact.law)


def _errors(campaign: Campaign, derived: Derived, tau: float, mu_cd: float) -> tuple[float | None, ...]:
    """Relative errors e_j [-] over an axle's usable samples; None for an axle without any."""
    measured = np.where(derived.usable, derived.adhesion, 0.0)
    missed = np.where(derived.usable, derived.adhesion - _model(campaign, derived, tau, mu_cd), 0.0)
    norms = np.linalg.norm(measured, axis=0)
    errors = np.linalg.norm(missed, axis=0) / np.maximum(norms, np.finfo(float).tiny)
    return tuple(float(error) if norm > 0.0 else None for error, norm in zip(errors, norms, strict=True))


def warn_of_errors(tuning: Tuning) -> None:
    """Give one `CampaignWarning` for every axle that the tuned law misses absurdly."""
    for one in tuning.absurd:
        warnings.warn(one, CampaignWarning, stacklevel=2)
