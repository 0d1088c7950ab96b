"""The test programme: cases and requirements read from a table, and the stops drawn for them."""

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
from scipy.optimize import brentq

from wsp_env.evaluation.bound import SlideLimit, best_adhesion
from wsp_env.evaluation.faults import Faults
from wsp_env.evaluation.figures import FIGURES
from wsp_env.parameters.document import DocumentError, read_toml
from wsp_env.parameters.quantity import ParameterError, number, shown
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.mechanisms import make
from wsp_env.plant.port import TRACK_STEP_M, Stop
from wsp_env.scenario import Scenario, draw

Record = TypeVar("Record")

#: The adhesion laws that every contaminated case is run under.
LAWS = ("classic", "recovering")

#: The programme that comes with the project.
STANDARD = Path(__file__).with_name("programme.toml")

#: The described track [m]; beyond it the rail is as at its end.
TRACK_LENGTH_M = 8000.0

_NODES = int(TRACK_LENGTH_M / TRACK_STEP_M) + 1


@dataclasses.dataclass(frozen=True)
class Case:
    """One case of the programme."""

    name: str
    about: str
    initial_speed_kmh: float
    initial_adhesion: tuple[float, float] | None = None  # [-], see `friction_for`; None is clean rail
    load: float = 0.0  # share of the payload [-]
    demand: float = 1.0  # share of full pressure [-]
    gradient: float = 0.0  # rise over distance [-]
    track: str = "constant"  # of wsp_env.scenario.TRACKS
    contaminated_m: tuple[tuple[float, float], ...] = ((0.0, np.inf),)  # stretches of a constant track [m]
    worn_radius_m: float = 0.0  # one drawn axle has so much less [m]
    sensor_fails_s: float = np.inf  # the sensor of one drawn axle reads zero from then on [s]
    valve_vents_s: float = np.inf  # the dump valve of one drawn axle is stuck open to the air from then on [s]
    valve_applies_s: float = np.inf  # that of one drawn axle vents no more from then on [s]
    power_lost_s: float = np.inf  # all valves are without current from then on [s]
    reservoir_l: float = 0.0  # reservoirs of an axle whose supply is shut off [l]; 0: the vehicle's own
    mechanisms: Mapping[str, Mapping[str, float]] = dataclasses.field(default_factory=dict)  # physics of this case

    def __post_init__(self) -> None:
        """Turn lists from a table into tuples; refuse what cannot be."""
        if self.initial_adhesion is not None:
            pair = tuple(self.initial_adhesion)
            if len(pair) != 2 or not 0.0 < number(pair[0]) <= number(pair[1]) < 0.3:
                raise ParameterError(
                    f"case {self.name}: initial_adhesion = {shown(pair)} must be (lowest, highest) within (0, 0.3)"
                )
            object.__setattr__(self, "initial_adhesion", pair)
        stretches = tuple(tuple(stretch) for stretch in self.contaminated_m)
        if not all(len(one) == 2 and all(number(end) >= 0.0 or end == np.inf for end in one) for one in stretches):
            raise ParameterError(f"case {self.name}: contaminated_m = {shown(stretches)} must be pairs (from, to) [m]")
        object.__setattr__(self, "contaminated_m", stretches)
        if not isinstance(self.mechanisms, Mapping):
            raise ParameterError(f"case {self.name}: mechanisms = {shown(self.mechanisms)} must be a table of tables")
        if not number(self.reservoir_l) >= 0.0:
            raise ParameterError(f"case {self.name}: reservoir_l = {shown(self.reservoir_l)} must be at least 0")
        make(self.mechanisms)  # refuses what is none
        if not self.initial_speed_kmh > 0.0:
            raise ParameterError(f"case {self.name}: initial_speed_kmh = {self.initial_speed_kmh} must be above zero")

    @property
    def laws(self) -> tuple[str, ...]:
        """The laws it is run under: both, but one on clean rail, where they are the same."""
        return LAWS if self.initial_adhesion else LAWS[:1]

    def equipped(self, vehicle: Vehicle) -> Vehicle:
        """Return the vehicle as it brakes in this case: with reservoirs that nothing refills, if the case has them."""
        if not self.reservoir_l:
            return vehicle
        brake = dataclasses.replace(vehicle.brake, reservoir_volume_l=self.reservoir_l, reservoir_supply_nlps=0.0)
        return dataclasses.replace(vehicle, brake=brake)


@dataclasses.dataclass(frozen=True)
class Requirement:
    """A figure that must not exceed a number in any stop, nor another one as a mean over the stops."""

    name: str
    figure: str
    at_most: float
    source: str  # clause, or "assumption"
    cases: tuple[str, ...] = ()  # empty: all
    laws: tuple[str, ...] = ()  # empty: both
    per_axle: bool = False  # the numbers are for one axle
    mean_at_most: float = np.inf  # for the mean over the stops of all these cases


@dataclasses.dataclass(frozen=True)
class Programme:
    """Cases, requirements and what is common to them."""

    name: str
    limit: SlideLimit
    scenario: Scenario
    cases: tuple[Case, ...]
    requirements: tuple[Requirement, ...]

    def required_of(self, vehicle: Vehicle) -> tuple[Requirement, ...]:
        """Return the requirements with their numbers for a whole vehicle."""
        return tuple(
            dataclasses.replace(
                one, at_most=one.at_most * vehicle.axles, mean_at_most=one.mean_at_most * vehicle.axles, per_axle=False
            )
            if one.per_axle
            else one
            for one in self.requirements
        )


@dataclasses.dataclass(frozen=True)
class Draws:
    """How many stops of each case are drawn under each law, and from which random numbers."""

    number: int = 5
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        if self.number < 1 or self.seed < 0:
            raise ParameterError(f"draws = {self.number}, seed = {self.seed}: at least 1 and 0")


@dataclasses.dataclass(frozen=True)
class CaseStops:
    """The N stops of a case; one per law and draw."""

    laws: tuple[str, ...]  # (N,)
    draws: tuple[int, ...]  # (N,)
    stops: tuple[Stop, ...]  # (N,)
    faults: Faults


def read_programme(path: Path = STANDARD) -> Programme:
    """Read and check a programme; `ParameterError` says what is wrong with it."""
    try:
        table = read_toml(Path(path))
    except DocumentError as error:
        raise ParameterError(f"the programme {path} {error}") from None
    try:
        head = dict(table.get("programme", {}))
        given = {"slide_limit": SlideLimit.creepage, "slide_limit_above_mps": SlideLimit.above_mps}
        limits = {key: head.pop(key, value) for key, value in given.items()}
        if wrong := [key for key, value in limits.items() if not number(value) > 0.0]:
            raise ParameterError(f"{wrong[0]} = {shown(limits[wrong[0]])} must be a number above zero")
        limit = SlideLimit(*limits.values())
        programme = Programme(
            name=head.pop("name", Path(path).stem),
            limit=limit,
            scenario=_record(Scenario, table.get("scenario", {})),
            cases=tuple(_record(Case, case) for case in table.get("case", [])),
            requirements=tuple(_record(Requirement, requirement) for requirement in table.get("requirement", [])),
        )
    except ParameterError as error:
        raise ParameterError(f"the programme {path}: {error}") from None
    except (TypeError, ValueError) as error:  # a key that is not known, or one that is missing, or no table
        raise ParameterError(f"the programme {path}: {str(error).replace('__init__() ', '')}") from None
    _check(Path(path), programme, sorted(head))
    return programme


def _record(kind: Callable[..., Record], values: object) -> Record:
    """Return a record of a table's values; numbers and texts must be such."""
    if not isinstance(values, dict):
        raise ParameterError(f"{shown(values)} must be a table")
    kinds = {field.name: field.type for field in dataclasses.fields(kind)}  # type: ignore[arg-type]  # the callers'
    for key, value in values.items():
        wanted = kinds.get(key)
        if wanted is float and not math.isfinite(number(value)) and value != math.inf:
            raise ParameterError(f"{key} = {shown(value)} must be a number")
        if wanted is str and not isinstance(value, str):
            raise ParameterError(f"{key} = {shown(value)} must be a text")
        if wanted == tuple[str, ...] and not (isinstance(value, list) and all(isinstance(one, str) for one in value)):
            raise ParameterError(f"{key} = {shown(value)} must be a list of texts")
    return kind(**{key: tuple(value) if isinstance(value, list) else value for key, value in values.items()})


def _check(path: Path, programme: Programme, unknown: Sequence[str]) -> None:
    names = [case.name for case in programme.cases]
    if unknown:
        raise ParameterError(f"the programme {path}: unknown key {', '.join(unknown)} in [programme]")
    if not names or len(set(names)) < len(names):
        raise ParameterError(f"the programme {path} needs at least one [[case]], each with its own name")
    for requirement in programme.requirements:
        if requirement.figure not in FIGURES:
            raise ParameterError(
                f"the programme {path}: requirement {requirement.name!r} names the figure {shown(requirement.figure)}; "
                f"valid: {', '.join(FIGURES)}"
            )
        if wrong := (set(requirement.cases) - set(names)) | (set(requirement.laws) - set(LAWS)):
            raise ParameterError(f"the programme {path}: requirement {requirement.name!r} names {', '.join(sorted(wrong))}")


def select_cases(programme: Programme, vehicle: Vehicle, names: Sequence[str] = ()) -> tuple[Case, ...]:
    """Return the cases of those names (none: all) that the vehicle is fast enough for; `ParameterError` if none is."""
    known = {case.name: case for case in programme.cases}
    if wrong := [name for name in names if name not in known]:
        raise ParameterError(f"unknown case {', '.join(wrong)}; valid: {', '.join(known)}")
    chosen = tuple(case for case in programme.cases if not names or case.name in names)
    possible = tuple(case for case in chosen if case.initial_speed_kmh / 3.6 <= vehicle.max_speed_mps)
    if not possible:
        raise ParameterError(f"no case within the {vehicle.name}'s {3.6 * vehicle.max_speed_mps:.0f} km/h")
    return possible


def draw_stops(case: Case, programme: Programme, vehicle: Vehicle, draws: Draws) -> CaseStops:
    """Draw the stops of a case: the same under every law, and from the same numbers in every case."""
    rows, stops, axles = [], [], []
    for drawn in range(draws.number):
        rng = np.random.default_rng([draws.seed, drawn])
        share, axle = rng.uniform(), int(rng.integers(vehicle.axles))
        for law in case.laws:
            rows.append((law, drawn))
            stops.append(_stop(case, programme, vehicle, law, share, axle, np.random.default_rng([draws.seed, drawn, 1])))
            axles.append(axle)
    laws, numbers = zip(*rows, strict=True)
    return CaseStops(laws, numbers, tuple(stops), _faults(case, np.array(axles), vehicle.axles))


def _faults(case: Case, axle: np.ndarray, axles: int) -> Faults:
    """Return what fails in the stops of a case, on the axle (N,) that was drawn for each."""

    def of_one(time: float) -> np.ndarray:
        return np.where(np.arange(axles) == axle[:, None], time, np.inf)

    power = np.full(len(axle), case.power_lost_s)
    return Faults(of_one(case.sensor_fails_s), of_one(case.valve_vents_s), of_one(case.valve_applies_s), power)


def _stop(
    case: Case, programme: Programme, vehicle: Vehicle, law: str, share: float, axle: int, rng: np.random.Generator
) -> Stop:
    speed = case.initial_speed_kmh / 3.6
    mass = vehicle.mass_kg + case.load * vehicle.payload_kg
    low, high = case.initial_adhesion or (0.05, 0.05)  # of no consequence on clean rail
    pins: dict[str, float | str] = {
        "mu_cd": friction_for(low + share * (high - low), speed, mass, vehicle),
        "initial_speed": speed,
        "load": case.load,
        "demand": case.demand,
        "gradient": case.gradient,
        "track": case.track,
    }
    stop = draw(programme.scenario, vehicle, rng, _NODES, pins, classic=law == "classic")
    coverage = stop.coverage
    if case.initial_adhesion is None:
        coverage = np.zeros(_NODES)
    elif case.track == "constant":
        places = TRACK_STEP_M * np.arange(_NODES)
        inside = [(places >= start) & (places < end) for start, end in case.contaminated_m]
        coverage = np.any(inside, axis=0).astype(np.float64)
    radius = stop.radius.copy()
    radius[axle] -= case.worn_radius_m
    return dataclasses.replace(stop, coverage=coverage, radius=radius)


@functools.lru_cache(maxsize=4096)
def friction_for(initial_adhesion: float, speed: float, mass: float, vehicle: Vehicle) -> float:
    """Return mu_cd [-] whose rail has this initial adhesion: the peak of f_d over the slip, at the initial speed [m/s].

    `ParameterError` when no friction up to that of the clean rail gives it.
    """
    load = mass * vehicle.gravity_mps2 / (2 * vehicle.axles)
    law = vehicle.contact.law

    def missing(mu_cd: float) -> float:
        return float(best_adhesion(speed, speed, load, mu_cd, 0.0, law)[0]) - initial_adhesion

    if missing(1e-4) > 0.0 or missing(law.mu_cr) < 0.0:
        raise ParameterError(f"no kinetic friction gives an initial adhesion of {initial_adhesion:g} at {speed:.1f} m/s")
    return float(brentq(missing, 1e-4, law.mu_cr, xtol=1e-7))
