"""The answer of a diagnosis of creep curves as typed records; `diagnosis.json` holds the same fields."""

import dataclasses
from typing import Any

from wsp_env.diagnosis.answer import Estimate, Evidence, FitQuality, Location, Verdict


@dataclasses.dataclass(frozen=True)
class NamedOnCurve:
    """An accepted mechanism."""

    name: str
    confidence: float
    alternatives: tuple[str, ...]  # own name, then the names that these points cannot distinguish from it
    parameters: dict[str, Estimate]
    multiple: float  # size over the smallest effect of interest
    gain: float  # reduction of chi-square (squares over the scatter's variance), with the other mechanisms present
    null_gain: float  # largest reduction of the same name in null recordings
    held_out_gain: float


@dataclasses.dataclass(frozen=True)
class Inseparable:
    """Parameters that compensate each other on these points."""

    parameters: tuple[str, ...]  # mechanism.parameter, or kinetic_friction
    range: tuple[float, float]  # range of the first parameter in which other values of the others fit as well (90 %)
    others: dict[str, tuple[float, float]]  # values of the others at the ends of that range
    words: str


@dataclasses.dataclass(frozen=True)
class ShownCurve:
    """One measured curve, its baseline and the fitted model with its 90 % interval; lists over points or grid."""

    name: str
    speed_mps: float
    creepage: list[float]  # of the measured points [-]
    adhesion: list[float]
    grid: list[float]  # creepages of the lines [-]
    baseline: list[float]
    fitted: list[float]
    low: list[float]
    high: list[float]


@dataclasses.dataclass(frozen=True)
class CrossValidation:
    """Root mean square errors [-] of the adhesion coefficient; each block of creepages is held out once."""

    blocks: int
    scatter: float  # of the points about a smooth curve of their own: the lower bound for any model
    fitted: dict[str, float]  # errors of baseline and extended model, fitted to all points
    held_out: dict[str, float]
    creepage: list[tuple[float, float]]  # lowest and highest of each block
    held_out_by_block: dict[str, list[float]]


@dataclasses.dataclass(frozen=True)
class Closure:
    """A smooth function of creepage that explains what no mechanism of the library explains."""

    depends_on: str
    gain: float  # reduction of chi-square
    held_out_gain: float


@dataclasses.dataclass(frozen=True)
class CreepDiagnosis:
    """The answer for creep curves: the fields of the answer for stops, and further ones."""

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
    confounding: dict[str, dict[str, float]]  # cosines between the changes by different mechanisms
    model: dict[str, Any]  # content of model.json
    notes: tuple[str, ...]
    cross_validation: CrossValidation
    law: dict[str, Estimate]  # properties of the fitted law: frictions, decrease rate, initial slope
    correlations: dict[str, dict[str, float]]  # rank correlations of the estimates over null recordings
    inseparable: tuple[Inseparable, ...]
    curves: tuple[ShownCurve, ...]

    def to_json(self) -> dict[str, Any]:
        """Return the answer as plain data."""
        plain: dict[str, Any] = dataclasses.asdict(self)
        return plain
