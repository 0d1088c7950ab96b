"""What a diagnosis of creep curves answers: typed, and as the JSON of diagnosis.json."""

import dataclasses
from typing import Any

from wsp_env.diagnosis.answer import Estimate, Evidence, FitQuality, Location, Verdict


@dataclasses.dataclass(frozen=True)
class NamedOnCurve:
    """An accepted mechanism."""

    name: str
    confidence: float
    alternatives: tuple[str, ...]  # what these points cannot tell from it, its own name included
    parameters: dict[str, Estimate]
    multiple: float  # size over the smallest effect of interest
    gain: float  # reduction of chi-square (squares over the scatter's variance), the other mechanisms present
    null_gain: float  # largest one of the same name in null recordings
    held_out_gain: float


@dataclasses.dataclass(frozen=True)
class Inseparable:
    """Parameters that make up for each other over these points."""

    parameters: tuple[str, ...]  # mechanism.parameter, or kinetic_friction
    range: tuple[float, float]  # of the first, in which some values of the others fit as well (90 %)
    others: dict[str, tuple[float, float]]  # of the others, at the ends of that range
    words: str


@dataclasses.dataclass(frozen=True)
class ShownCurve:
    """One measured curve, its baseline and the fitted model with its 90 % interval."""

    name: str
    speed_mps: float
    creepage: list[float]  # of the points [-]
    adhesion: list[float]
    grid: list[float]  # creepages [-] of the lines
    baseline: list[float]
    fitted: list[float]
    low: list[float]
    high: list[float]


@dataclasses.dataclass(frozen=True)
class CrossValidation:
    """Root mean square errors [-] of the adhesion coefficient; each block of creepages held out once."""

    blocks: int
    scatter: float  # of the points about a smooth curve of their own: what no model can go below
    fitted: dict[str, float]  # fitted to all points: baseline and extended
    held_out: dict[str, float]
    creepage: list[tuple[float, float]]  # of each block
    held_out_by_block: dict[str, list[float]]


@dataclasses.dataclass(frozen=True)
class Closure:
    """A smooth function of creepage that explains what no mechanism does."""

    depends_on: str
    gain: float  # reduction of chi-square
    held_out_gain: float


@dataclasses.dataclass(frozen=True)
class CreepDiagnosis:
    """The answer on creep curves: the keys of that on stops, and what creep curves show besides."""

    campaign: str
    verdict: Verdict
    sentence: str
    mechanisms: tuple[NamedOnCurve, ...]
    location: tuple[Location, ...]
    fit: FitQuality  # tune: fitted to all points; validate: each block of creepages held out once
    detectable: dict[str, dict[str, float]]
    next_test: str
    closure: Closure | None
    evidence: tuple[Evidence, ...]
    confounding: dict[str, dict[str, float]]  # cosines between what mechanisms change
    model: dict[str, Any]  # what model.json holds
    notes: tuple[str, ...]
    cross_validation: CrossValidation
    law: dict[str, Estimate]  # what the fitted law means: frictions, decrease rate, initial slope
    correlations: dict[str, dict[str, float]]  # of the estimates over null recordings (ranks)
    inseparable: tuple[Inseparable, ...]
    curves: tuple[ShownCurve, ...]

    def to_json(self) -> dict[str, Any]:
        """Return plain data."""
        plain: dict[str, Any] = dataclasses.asdict(self)
        return plain
