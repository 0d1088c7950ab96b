"""What is drawn when a stop begins: the only place with distributions.

Every quantity is drawn at every reset, in a fixed order, whether it is pinned or not: pinning one leaves the others' draws as
they were.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wsp_env.parameters.quantity import ParameterError, shown
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant import mechanisms
from wsp_env.plant.port import LIMITS, TRACK_STEP_M, Stop

#: Kinds of track: the same mu_cd everywhere; small variation along it; contaminated patches on a clean rail.
TRACKS = ("constant", "varying", "patches")

Range = tuple[float, float]

#: Patches shorter than a contact's way through them say nothing, and would be drawn by the million (assumption).
_LIMITS = LIMITS | {"load": (0.0, 1.0, "of the payload"), "patch_length": (0.1, 1e6, "m")}


@dataclasses.dataclass(frozen=True)
class Scenario:
    """Distributions of the conditions of a stop; a range with equal ends is a constant.

    The defaults are assumptions for training, around the seed paper's tests (mu_cd 0.06 of Table 2, tau 1.9e-4 m/J, 40 to 42
    m/s of Table 3) and down to the extremely low adhesion that EN 15595 tests (initial adhesion 0.05: mu_cd of about 0.024).
    """

    mu_cd: Range = (0.02, 0.09)  # kinetic friction of the contaminated rail [-], uniform
    tau: Range = (0.8e-4, 4.0e-4)  # recovery rate [m/J], log-uniform
    initial_speed: Range = (22.0, 44.5)  # [m/s], uniform: 80 to 160 km/h
    load: Range = (0.0, 1.0)  # share of the payload on board [-], uniform
    demand: Range = (0.5, 1.0)  # share of full brake pressure [-], uniform
    gradient: Range = (0.0, 0.0)  # rise over distance [-], uniform
    sensor_noise: Range = (0.0, 0.1)  # standard deviation of measured wheel speed [rad/s], uniform
    tracks: tuple[str, ...] = TRACKS  # kinds of track, each as likely
    variation: float = 0.02  # relative standard deviation of mu_cd on a "varying" track [-]
    variation_length: Range = (5.0, 20.0)  # its correlation length [m], uniform
    patch_length: Range = (20.0, 200.0)  # length of each contaminated and each clean stretch of "patches" [m], uniform

    def __post_init__(self) -> None:
        """Refuse ranges that are no ranges and unknown kinds of track."""
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if field.name == "tracks":
                if not isinstance(value, tuple | list) or not value or not set(map(str, value)) <= set(TRACKS):
                    raise ParameterError(f"scenario: tracks = {shown(value)} must be a list of some of {', '.join(TRACKS)}")
                object.__setattr__(self, "tracks", tuple(value))
            elif field.name == "variation":
                if not isinstance(value, int | float) or not 0.0 <= value < 0.3:
                    raise ParameterError(f"scenario: variation = {shown(value)} is impossible: it must lie in [0, 0.3)")
            else:
                self._check_range(field.name, value)

    def _check_range(self, name: str, value: Any) -> None:
        try:
            low, high = (float(end) for end in value)
        except (TypeError, ValueError, OverflowError):
            raise ParameterError(f"scenario: {name} = {shown(value)} must be a pair, the lowest first") from None
        positive = name in ("mu_cd", "initial_speed", "patch_length", "variation_length")
        if not (math.isfinite(low) and math.isfinite(high) and low <= high) or (positive and low <= 0.0):
            raise ParameterError(
                f"scenario: {name} = {shown(value)} is impossible: lowest first, finite, above zero where it must"
            )
        lowest, highest, unit = _LIMITS.get(name, (0.0, math.inf, "m"))
        if low < lowest or high > highest:
            limits = f"[{lowest:g}, {highest:g}] {unit}".removesuffix(" -")
            raise ParameterError(f"scenario: {name} = {shown(value)} is impossible: it must lie in {limits}")
        object.__setattr__(self, name, (low, high))


#: What `reset(options=...)` can pin, with what each means.
PINS = {
    "mu_cd": "kinetic friction of the contaminated rail [-]",
    "tau": "recovery rate [m/J]",
    "initial_speed": "[m/s]",
    "load": "share of the payload on board, 0 to 1 [-]",
    "demand": "share of full brake pressure, 0 to 1 [-]",
    "gradient": "rise over distance, positive uphill [-]",
    "sensor_noise": "standard deviation of the measured wheel speeds [rad/s]",
    "track": f"one of {', '.join(TRACKS)}, or relative mu_cd along it, a list of nodes {TRACK_STEP_M:g} m apart",
}


def draw(
    scenario: Scenario,
    vehicle: Vehicle,
    rng: np.random.Generator,
    nodes: int,
    pins: Mapping[str, Any] | None = None,
    classic: bool = False,
) -> Stop:
    """Draw the conditions of one stop.

    Parameters
    ----------
    scenario, vehicle : what to draw from, and for which vehicle
    rng : the generator that Gymnasium seeds
    nodes : number of track nodes, `TRACK_STEP_M` apart
    pins : quantities with a given value, by the names of `PINS`; `ParameterError` for another name
    classic : no recovery (lambda = 0), whatever tau was drawn or pinned

    """
    pins = dict(pins or {})
    unknown = sorted(set(pins) - set(PINS))
    if unknown:
        raise ParameterError(f"unknown reset option {', '.join(map(str, unknown))}; valid: {', '.join(PINS)}")
    values: dict[str, Any] = {
        "mu_cd": rng.uniform(*scenario.mu_cd),
        "tau": _log_uniform(rng, scenario.tau),
        "initial_speed": rng.uniform(*scenario.initial_speed),
        "load": rng.uniform(*scenario.load),
        "demand": rng.uniform(*scenario.demand),
        "gradient": rng.uniform(*scenario.gradient),
        "sensor_noise": rng.uniform(*scenario.sensor_noise),
        "track": scenario.tracks[int(rng.integers(len(scenario.tracks)))],
    }
    key = int(rng.integers(2**63))
    track_rng = np.random.default_rng(key)  # its number of draws depends on the kind of track
    for name, value in pins.items():
        values[name] = value if name == "track" else _number(name, value)
    if not 0.0 <= values["load"] <= 1.0:
        raise ParameterError(f"load = {values['load']:g} is impossible: it must lie in [0, 1]")
    profile, coverage = _track(values["track"], scenario, track_rng, nodes)
    return Stop(
        mu_cd=values["mu_cd"],
        tau=0.0 if classic else values["tau"],
        initial_speed=values["initial_speed"],
        mass=vehicle.mass_kg + values["load"] * vehicle.payload_kg,
        demand=values["demand"],
        gradient=values["gradient"],
        noise=values["sensor_noise"],
        key=key,
        radius=np.full(vehicle.axles, vehicle.wheel_radius_m),
        profile=profile,
        coverage=coverage,
    )


#: Mechanisms of a batch: {name: {parameter: value, or range (lowest, highest) to draw from}}.
Mechanisms = Mapping[str, Mapping[str, float | Sequence[float]]]


def check_mechanisms(choice: Mechanisms) -> bool:
    """Return whether any parameter is a range; `ParameterError` for what cannot be, at either end."""
    for end in (0, 1):
        mechanisms.make(ends_of(choice, end))
    return any(_is_range(value) for parameters in choice.values() for value in parameters.values())


def ends_of(choice: Mechanisms, end: int) -> dict[str, Any]:
    """Return the mechanisms with the lowest (0) or the highest (1) value of every range."""
    return {
        name: {key: _end(name, key, value, end) for key, value in parameters.items()}
        if isinstance(parameters, Mapping)
        else parameters
        for name, parameters in choice.items()
    }


def draw_mechanisms(choice: Mechanisms, rng: np.random.Generator) -> dict[str, dict[str, float]]:
    """Draw the parameters given as ranges, uniform, whole numbers among the whole ones; the others stay as they are."""
    drawn: dict[str, dict[str, float]] = {}
    for name, parameters in choice.items():
        whole = {parameter.name: parameter.whole for parameter in mechanisms.ALL[name].parameters}
        drawn[name] = {}
        for key, value in parameters.items():
            if not _is_range(value):
                drawn[name][key] = value  # type: ignore[assignment]  # a number
                continue
            low, high = (_end(name, key, value, end) for end in (0, 1))
            drawn[name][key] = float(rng.integers(low, high + 1.0)) if whole[key] else rng.uniform(low, high)
    return drawn


def _is_range(value: Any) -> bool:
    return isinstance(value, Sequence | np.ndarray) and not isinstance(value, str)


def _end(name: str, key: str, value: Any, end: int) -> Any:
    if not _is_range(value):
        return value
    if len(value) != 2 or not all(isinstance(one, int | float | np.number) for one in value) or value[0] > value[1]:
        raise ParameterError(f"mechanism {name}: {key} = {shown(value)} must be a number or a pair, the lowest first")
    return value[end]


def _number(name: str, value: Any) -> float:
    try:
        found = float(value)
    except (TypeError, ValueError, OverflowError):
        found = math.nan
    if not math.isfinite(found):
        raise ParameterError(f"reset option {name} = {shown(value)} must be a finite number: {PINS[name]}")
    return found


def _log_uniform(rng: np.random.Generator, bounds: Range) -> float:
    low, high = bounds
    share = rng.uniform()
    if low <= 0.0:
        return low + share * (high - low)
    return low * (high / low) ** share


def _track(kind: Any, scenario: Scenario, rng: np.random.Generator, nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Return relative mu_cd and coverage by the contaminant layer at the nodes, both (nodes,)."""
    profile: np.ndarray = np.ones(nodes)
    coverage: np.ndarray = np.ones(nodes)
    if isinstance(kind, Sequence | np.ndarray) and not isinstance(kind, str):
        given = np.array([_number("track", value) for value in kind])
        if given.size == 0:
            raise ParameterError("track is an empty list: give mu_cd along the track relative to mu_cd, node by node")
        return given[np.minimum(np.arange(nodes), len(given) - 1)], coverage  # beyond the last node as there
    if kind == "varying":
        # First-order autoregression, stationary, its correlation falling to 1/e within the drawn length.
        keep = math.exp(-TRACK_STEP_M / rng.uniform(*scenario.variation_length))
        shocks = rng.standard_normal(nodes)
        shocks[1:] *= math.sqrt(1.0 - keep * keep)
        for i in range(1, nodes):
            shocks[i] += keep * shocks[i - 1]
        profile = np.maximum(1.0 + scenario.variation * shocks, 0.1)
    elif kind == "patches":
        ends = np.cumsum(rng.uniform(*scenario.patch_length, size=2 + int(nodes * TRACK_STEP_M / scenario.patch_length[0])))
        coverage = 1.0 - np.searchsorted(ends, TRACK_STEP_M * np.arange(nodes), side="right") % 2.0
    elif kind != "constant":
        raise ParameterError(f"unknown track {shown(kind)}; valid: {', '.join(TRACKS)}")
    return profile, coverage
