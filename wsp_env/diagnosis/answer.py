"""What a diagnosis answers: typed, and as the JSON of diagnosis.json."""

import dataclasses
from typing import Any, Literal

from wsp_env.recordings.suspect import SuspectChannel

#: What a diagnosis may say.
Verdict = Literal["adequate", "named", "ambiguous", "discovered", "unknown", "insufficient", "data"]


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A fitted parameter."""

    value: float
    unit: str
    interval90: tuple[float, float]


@dataclasses.dataclass(frozen=True)
class Curve:
    """What a mechanism changes, over what it depends on; points (P,)."""

    equation: str  # the balance that shows it best
    over: str  # with its unit
    change: str  # with its unit
    x: tuple[float, ...]
    observed: tuple[float, ...]
    deviation: tuple[float, ...]  # of the observed
    fitted: tuple[float, ...]
    low: tuple[float, ...]  # of the fitted, 90 %
    high: tuple[float, ...]


@dataclasses.dataclass(frozen=True)
class RunFigures:
    """The paper's figures of one run, simulated before and after the mechanisms found; by axle where tuples."""

    run: str
    group: str
    adhesion_error_before: tuple[float | None, ...]  # e, mean error over mean adhesion [-]; None: does not slide
    adhesion_error_after: tuple[float | None, ...]
    speed_error_before_mps: float  # E, eq. (19), of the vehicle's momentum with the measured torque
    speed_error_after_mps: float
    slide_mean_recorded_mps: tuple[float, ...]  # eq. (21)
    slide_mean_before_mps: tuple[float, ...]
    slide_mean_after_mps: tuple[float, ...]
    slide_deviation_recorded_mps: tuple[float, ...]  # eq. (21)
    slide_deviation_before_mps: tuple[float, ...]
    slide_deviation_after_mps: tuple[float, ...]


@dataclasses.dataclass(frozen=True)
class RunTrace:
    """One run before and after: an axle and the vehicle; at most 200 points each."""

    run: str
    group: str  # "validate" where there is a held-out run
    axle: int  # from 1
    time_s: tuple[float, ...]
    adhesion_measured: tuple[float, ...]  # [-]
    adhesion_before: tuple[float, ...]  # measured less what the baseline leaves [-]
    adhesion_after: tuple[float, ...]
    speed_time_s: tuple[float, ...]
    speed_residual_before_mps: tuple[float, ...]  # recorded minus predicted
    speed_residual_after_mps: tuple[float, ...]
    shows: Literal["adhesion", "speed"] = "adhesion"  # which of both is about what was found
    chosen: str = ""  # why this axle, in words


@dataclasses.dataclass(frozen=True)
class Worth:
    """What all that was found changes in the recorded stops, against the simulation tuned without it."""

    distance_share: float  # of the stopping distance [-]; above 0: real stops are longer than simulated ones
    interval90: tuple[float, float] | None  # of the same
    slip_mps: float  # of an axle's slip
    stop_m: float | None = None  # distance braked in the recordings, mean of the stops


@dataclasses.dataclass(frozen=True)
class Source:
    """A file that a diagnosis was made from."""

    file: str  # its name, as campaign.toml has it
    sha256: str


@dataclasses.dataclass(frozen=True)
class Named:
    """An accepted mechanism."""

    name: str
    confidence: float
    alternatives: tuple[str, ...]  # what these data cannot tell from it, its own name included
    parameters: dict[str, Estimate]
    multiple: float  # size over the smallest effect of interest
    gain: float  # reduction of chi-square
    null_gain: float  # what noise alone gives: of stops one for each size, of creep curves the largest in null recordings
    held_out_gain: float
    curve: Curve | None = None  # none for creep curves, which are drawn themselves


@dataclasses.dataclass(frozen=True)
class Discovered:
    """A term that has no name in the library, accepted on runs that it was not fitted to."""

    slot: str  # brake torque, friction, recovery, vehicle force or sensor
    slots_not_separable: tuple[str, ...]  # other slots in which a term or a name explains as much
    alternatives: tuple[str, ...]  # what explains as much, best first
    axles: tuple[int, ...]  # from 1, all of them where it acts on every wheel; none for the vehicle and its sensor
    equation: str  # in words and units
    features: tuple[str, ...]  # what it depends on
    parameters: dict[str, Estimate]
    looks_like: tuple[str, ...]  # known physics of that form
    removed_validate: float | None  # share of what can be removed of the held-out residual that it removes
    multiple: float  # size over the smallest effect of interest
    gain: float  # reduction of chi-square
    held_out_gain: float


@dataclasses.dataclass(frozen=True)
class Location:
    """Where a mismatch is."""

    equation: str  # vehicle, adhesion, kinematics or actuator
    axles: tuple[int, ...]  # from 1; none for the vehicle
    runs: tuple[str, ...]
    where: str
    share: float  # of all of the removable residual


@dataclasses.dataclass(frozen=True)
class Evidence:
    """One candidate of the search."""

    name: str
    gain: float  # reduction of chi-square
    null: tuple[float, ...]  # the same in null recordings of creep curves; none of stops
    surprise: float  # log10 of the likelihood ratio; of creep curves minus log10 of the probability in a null recording
    held_out: float
    multiple: float  # size over the smallest effect of interest; 0 where not computed


@dataclasses.dataclass(frozen=True)
class FitQuality:
    """Mean squares of the residuals, relative to what noise and variation leave: the noise floor is 1."""

    noise_floor: float
    baseline: dict[str, float]
    extended: dict[str, float]
    removed_validate: float | None


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """The answer."""

    campaign: str
    verdict: Verdict
    sentence: str
    mechanisms: tuple[Named, ...]
    location: tuple[Location, ...]
    fit: FitQuality
    detectable: dict[str, dict[str, float]]
    next_test: str
    evidence: tuple[Evidence, ...]
    model: dict[str, Any]  # what model.json holds
    residuals: dict[str, Any]  # for the report: mean squares by balance, run, axle, before and after
    runs: tuple[RunFigures, ...]
    notes: tuple[str, ...]
    course: RunTrace | None = None  # none where no axle has blocks to show
    discovered: tuple[Discovered, ...] = ()
    suspect_channels: tuple[SuspectChannel, ...] = ()
    worth: Worth | None = None  # none where nothing was found, or its size in a stop is not known
    sources: tuple[Source, ...] = ()
    made: str = ""  # day, as 2026-01-31
    version: str = ""  # of this package

    def to_json(self) -> dict[str, Any]:
        """Return plain data."""
        plain: dict[str, Any] = dataclasses.asdict(self)
        return plain
