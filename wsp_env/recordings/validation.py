"""Validation as in the seed paper's sections 4 and 5: the law against recordings it was not tuned on, and in the vehicle."""

import dataclasses
from typing import Any

import numpy as np

from wsp_env.parameters import velim
from wsp_env.recordings import simulate as simulation
from wsp_env.recordings.campaign import Campaign
from wsp_env.recordings.derive import Derived, Smoothing, braking, derive, rolling_radii
from wsp_env.recordings.recording import Recording
from wsp_env.recordings.simulate import Simulated, Slide
from wsp_env.recordings.tuning import UNDETERMINED, Tuning, tune, tune_classic

#: What windows of a second are simulated with, and what that is.
RIVALS = {
    "tuned": "tuned law",
    "classic": "no recovery",  # tau = 0, with the tuned law's mu_cd
    "classic_refitted": "no recovery, refitted",  # tau = 0, with the mu_cd that fits best without recovery
    "no_slip": "no slip",  # wheels that roll however hard they are braked
}


#: Two stops under a controller with thresholds part by tiny causes, so that nothing else can be compared.
CLOSED_LOOP_BY = "mean and deviation of the slide, eqs. (20) and (21), only; never sample by sample"


@dataclasses.dataclass(frozen=True)
class ClosedLoop:
    """A recorded stop beside one that another controller braked: eqs. (20) and (21) per axle [m/s], and nothing else."""

    recorded_mean_mps: tuple[float, ...]
    recorded_deviation_mps: tuple[float, ...]
    simulated_mean_mps: tuple[float, ...]
    simulated_deviation_mps: tuple[float, ...]

    @classmethod
    def of(cls, recorded_mps: np.ndarray, simulated_mps: np.ndarray) -> "ClosedLoop":
        """Take the statistics of the slip speeds (T, axles), each over its own stop."""
        means = (tuple(map(float, slip.mean(axis=0))) for slip in (recorded_mps, simulated_mps))
        deviations = (tuple(map(float, slip.std(axis=0))) for slip in (recorded_mps, simulated_mps))
        (recorded, simulated), (recorded_deviation, simulated_deviation) = means, deviations
        return cls(recorded, recorded_deviation, simulated, simulated_deviation)

    def figures(self) -> dict[str, list[float]]:
        """Return the statistics as plain data."""
        return {name: list(values) for name, values in dataclasses.asdict(self).items()}


@dataclasses.dataclass(frozen=True)
class ValidatedStop:
    """One run: what was derived from it, and how it was simulated."""

    run: Recording
    derived: Derived
    window_rms_mps: dict[str, float]  # rival -> RMS error of r w over windows of 1 s [m/s]
    slide: Slide
    simulated: Simulated  # the whole stop, from the start of braking until it is slow
    start: int  # its first sample


@dataclasses.dataclass(frozen=True)
class Criterion:
    """One of the paper's figures: what was reached, and its worst."""

    name: str
    value: float
    limit: float
    unit: str

    @property
    def met(self) -> bool:
        """Whether this campaign does at least as well as the paper."""
        return self.value <= self.limit


@dataclasses.dataclass(frozen=True)
class Validation:
    """A campaign tuned, scored and simulated."""

    campaign: Campaign
    tuning: Tuning
    stops: dict[str, ValidatedStop]

    @property
    def criteria(self) -> list[Criterion]:
        """The paper's own figures, over the sliding runs of the validate group (of both where none is named)."""
        names = [name for name in self.campaign.validate or self.campaign.tune if self.tuning.runs[name].slides]
        if not names:
            return []
        errors = [error for name in names for error in self.tuning.runs[name].error if error is not None]
        slides = [self.stops[name].slide for name in names]
        means = [(a, b) for s in slides for a, b in zip(s.recorded_mean_mps, s.simulated_mean_mps, strict=True)]
        deviations = [(a, b) for s in slides for a, b in zip(s.recorded_deviation_mps, s.simulated_deviation_mps, strict=True)]
        return [
            Criterion("relative adhesion error e_j, Table 4", max(errors), max(velim.ADHESION_ERRORS.values()), ""),
            Criterion(
                "speed error E, eq. (19), Table 7",
                max(s.speed_error_mps for s in slides),
                max(velim.SPEED_ERRORS_MPS.values()),
                "m/s",
            ),
            Criterion("mean slide apart, Table 7", _apart(means), _apart(list(velim.MEAN_SLIDES_MPS.values())), "m/s"),
            Criterion(
                "deviation of slide apart, Table 7",
                _apart(deviations),
                _apart(list(velim.SLIDE_DEVIATIONS_MPS.values())),
                "m/s",
            ),
        ]

    @property
    def scored(self) -> str:
        """Which runs the paper's figures are taken over."""
        return "only scored" if self.campaign.validate else "tuned on themselves"

    @property
    def verdict(self) -> str:
        """One plain sentence."""
        if not self.tuning.determined:
            return f"Nothing is validated: tau is open, {UNDETERMINED}."
        criteria = self.criteria
        if not criteria:
            return "No run to validate slides: these recordings say nothing on the law."
        missed = [c for c in criteria if not c.met]
        if not missed:
            tuned = ", ".join(self.campaign.tune)
            met = f"The law tuned on {tuned} meets all the seed paper's own figures on the runs that were {self.scored}."
            return met if self.campaign.validate else f"{met} Runs that were only scored are missing: this validates nothing."
        parts = ", ".join(f"{c.name} ({c.value:.3g} {c.unit} against {c.limit:.3g})".replace(" )", ")") for c in missed)
        return f"The tuned law does worse than the seed paper's own figures in: {parts}."

    def to_json(self) -> dict[str, Any]:
        """Return the validation as plain data."""
        found = self.tuning.to_json()
        for name, figures in found["runs"].items():
            stop = self.stops[name]
            figures |= {"window_rms_mps": stop.window_rms_mps, **dataclasses.asdict(stop.slide)}
            figures["warnings"] = list(stop.run.warnings)
        criteria = [dataclasses.asdict(c) | {"met": c.met} for c in self.criteria]
        return found | {"verdict": self.verdict, "criteria": criteria, "criteria_over": f"runs {self.scored}"}


def validate(campaign: Campaign, smoothing: Smoothing = Smoothing(), tune_friction: bool = True) -> Validation:
    """Tune on the tune group, score both groups, simulate every stop with its recorded brake torque.

    Raises
    ------
    CampaignError
        when no run to tune on slides, or the vehicle cannot be simulated

    """
    tuning = tune(campaign, smoothing, tune_friction)
    radii = rolling_radii(campaign, smoothing)
    stops = {}
    for name in tuning.runs:
        run = campaign.runs[name]
        derived = derive(campaign, run, radii, smoothing)
        stops[name] = _simulated(campaign, run, derived, radii, smoothing, tuning)
    return Validation(campaign, tuning, stops)


def _simulated(
    campaign: Campaign, run: Recording, derived: Derived, radii: np.ndarray, smoothing: Smoothing, tuning: Tuning
) -> ValidatedStop:
    score = tuning.runs[run.name]
    starts, length = simulation.windows(derived, campaign.sample_time_s, smoothing)
    classic = tune_classic(campaign, run.name, derived) if score.slides else score.mu_cd
    laws = {"tuned": (score.mu_cd, tuning.tau_m_per_J), "classic": (score.mu_cd, 0.0), "classic_refitted": (classic, 0.0)}
    errors = {}
    if len(starts):
        pieces = {
            rival: simulation.simulate(campaign, run, derived, radii, starts, length, *law) for rival, law in laws.items()
        }
        pieces["no_slip"] = simulation.without_slip(campaign, run, derived, radii, starts, length)
        errors = {rival: simulation.window_error(derived, piece, starts) for rival, piece in pieces.items()}
    start, end = braking(run, campaign.sample_time_s, smoothing)
    fast = np.flatnonzero(derived.speed_mps > smoothing.least_speed_mps)
    end = min(end, int(fast[-1]) + 1) if fast.size else start
    whole = simulation.simulate(campaign, run, derived, radii, np.array([start]), max(end - start, 2), *laws["tuned"])
    return ValidatedStop(run, derived, errors, simulation.slide(derived, whole, start), whole, start)


def _apart(pairs: list[tuple[float, float]]) -> float:
    return max(abs(a - b) for a, b in pairs)
