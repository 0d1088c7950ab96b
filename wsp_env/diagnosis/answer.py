"""The answer of a diagnosis as typed records; `diagnosis.json` holds the same fields."""

import dataclasses
from typing import Any, Literal

from wsp_env.recordings.suspect import SuspectChannel

#: The possible verdicts.
Verdict = Literal["adequate", "named", "ambiguous", "discovered", "unknown", "insufficient", "data"]


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A fitted parameter."""

    value: float
    unit: str
    interval90: tuple[float, float]


@dataclasses.dataclass(frozen=True)
class Curve:
    """Effect of a mechanism over the quantity that it depends on, at P points; each tuple (P,)."""

    equation: str  # balance with the largest effect
    over: str  # quantity on the x axis, with its unit
    change: str  # quantity on the y axis, with its unit
    x: tuple[float, ...]
    observed: tuple[float, ...]
    deviation: tuple[float, ...]  # standard errors of the observed values
    fitted: tuple[float, ...]
    low: tuple[float, ...]  # bounds of the 90 % interval of the fitted values
    high: tuple[float, ...]


@dataclasses.dataclass(frozen=True)
class RunFigures:
    """The seed paper's figures of one run, before and after adding the mechanisms found; tuples hold one value per axle."""

    run: str
    group: str
    adhesion_error_before: tuple[float | None, ...]  # e, mean error over mean adhesion [-]; None: the axle does not slide
    adhesion_error_after: tuple[float | None, ...]
    speed_error_before_mps: float  # E, eq. (19), from the vehicle's momentum with the measured torque
    speed_error_after_mps: float
    slide_mean_recorded_mps: tuple[float, ...]  # eq. (21)
    slide_mean_before_mps: tuple[float, ...]
    slide_mean_after_mps: tuple[float, ...]
    slide_deviation_recorded_mps: tuple[float, ...]  # eq. (21)
    slide_deviation_before_mps: tuple[float, ...]
    slide_deviation_after_mps: tuple[float, ...]


@dataclasses.dataclass(frozen=True)
class RunTrace:
    """Time series of one run, before and after: one axle and the vehicle, at most 200 points each."""

    run: str
    group: str  # "validate" if there is a held-out run
    axle: int  # from 1
    time_s: tuple[float, ...]
    adhesion_measured: tuple[float, ...]  # [-]
    adhesion_before: tuple[float, ...]  # measured adhesion minus the residual of the baseline [-]
    adhesion_after: tuple[float, ...]
    speed_time_s: tuple[float, ...]
    speed_residual_before_mps: tuple[float, ...]  # recorded minus predicted
    speed_residual_after_mps: tuple[float, ...]
    shows: Literal["adhesion", "speed"] = "adhesion"  # series that shows the finding better
    chosen: str = ""  # reason for the choice of this axle, in words


@dataclasses.dataclass(frozen=True)
class Worth:
    """Change of the recorded stops by all findings together, against the simulation tuned without them."""

    distance_share: float  # share of all stops' braking distance [-]; positive: real stops are longer than simulated ones
    interval90: tuple[float, float] | None  # of `distance_share`
    slip_mps: float  # change of an axle's slip
    stop_m: float | None = None  # distance run while braking in the recordings, mean of the stops
    stops_m: dict[str, float] = dataclasses.field(default_factory=dict)  # change of each recorded stop's distance [m]


@dataclasses.dataclass(frozen=True)
class Source:
    """An input file of a diagnosis."""

    file: str  # file name as in campaign.toml
    sha256: str


@dataclasses.dataclass(frozen=True)
class Named:
    """An accepted mechanism."""

    name: str
    confidence: float
    alternatives: tuple[str, ...]  # own name, then the names that these data cannot distinguish from it
    parameters: dict[str, Estimate]
    multiple: float  # size over the smallest effect of interest
    gain: float  # reduction of chi-square
    null_gain: float  # reduction by noise alone: of stops one for each size, of creep curves the largest in null recordings
    held_out_gain: float
    curve: Curve | None = None  # None for creep curves, which are drawn themselves


@dataclasses.dataclass(frozen=True)
class Discovered:
    """A term without a name in the library, accepted on runs to which it was not fitted."""

    slot: str  # brake torque, friction, recovery, vehicle force or sensor
    slots_not_separable: tuple[str, ...]  # other slots in which a term or a name explains as much
    alternatives: tuple[str, ...]  # terms and names that explain as much, best first
    axles: tuple[int, ...]  # from 1; all axles if it acts on every wheel; none for the vehicle and its sensor
    equation: str  # in words and units
    features: tuple[str, ...]  # quantities on which it depends
    parameters: dict[str, Estimate]
    looks_like: tuple[str, ...]  # known physics of the same form
    removed_validate: float | None  # share of the removable held-out residual that it removes
    multiple: float  # size over the smallest effect of interest
    gain: float  # reduction of chi-square
    held_out_gain: float


@dataclasses.dataclass(frozen=True)
class Location:
    """Place of a mismatch: balance, axles, runs and range of a quantity."""

    equation: str  # vehicle, adhesion, kinematics or actuator
    axles: tuple[int, ...]  # from 1; none for the vehicle
    runs: tuple[str, ...]
    where: str
    share: float  # of the whole removable residual


@dataclasses.dataclass(frozen=True)
class Evidence:
    """Evidence for one candidate of the search."""

    name: str
    gain: float  # reduction of chi-square
    null: tuple[float, ...]  # the same in null recordings, for creep curves; empty for stops
    surprise: float  # log10 of the likelihood ratio; for creep curves -log10 of the probability in a null recording
    held_out: float
    multiple: float  # size over the smallest effect of interest; 0 if not computed


@dataclasses.dataclass(frozen=True)
class FitQuality:
    """Mean squares of the residuals relative to those that noise and normal variation leave; the noise floor is 1."""

    noise_floor: float
    baseline: dict[str, float]
    extended: dict[str, float]
    removed_validate: float | None


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """The answer of a diagnosis of stops."""

    campaign: str
    verdict: Verdict
    sentence: str
    mechanisms: tuple[Named, ...]
    location: tuple[Location, ...]
    fit: FitQuality
    detectable: dict[str, dict[str, float]]
    next_test: str
    evidence: tuple[Evidence, ...]
    model: dict[str, Any]  # content of model.json
    residuals: dict[str, Any]  # for the report: mean squares by balance, run and axle, before and after
    runs: tuple[RunFigures, ...]
    notes: tuple[str, ...]
    course: RunTrace | None = None  # None if no axle has blocks to show
    discovered: tuple[Discovered, ...] = ()
    suspect_channels: tuple[SuspectChannel, ...] = ()
    worth: Worth | None = None  # None if nothing was found, or if the size in a stop is unknown
    sources: tuple[Source, ...] = ()
    made: str = ""  # date, as 2026-01-31
    version: str = ""  # of this package

    def to_json(self) -> dict[str, Any]:
        """Return the answer as plain data."""
        plain: dict[str, Any] = dataclasses.asdict(self)
        return plain
