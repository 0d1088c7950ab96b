"""What an environment is made of besides the vehicle: the options of `gym.make`, checked."""

import dataclasses
import functools
import math
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wsp_env.envs.model import TunedModel, read_model
from wsp_env.parameters.quantity import ParameterError, number, replace, shown
from wsp_env.parameters.vehicle import Vehicle, train
from wsp_env.parameters.vehicle_file import find_vehicle
from wsp_env.plant.port import TRACK_STEP_M
from wsp_env.scenario import PINS, Mechanisms, Scenario, check_mechanisms


@dataclasses.dataclass(frozen=True)
class RewardWeights:
    """Weights of the reward's terms.

    Each term but `rest_of_stop` is minus its weight times the quantity; their sum is the reward.

    The rest of a stop, at the deceleration a of the demanded brake on dry rail, costs F(v) = stopping_distance v^2 / 2a + time
    v / a. `rest_of_stop` pays F(v) - F(v') for each step (a potential: Ng, Harada, Russell 1999, without the discount). So
    what the brake does is rewarded at once, whatever the discount: for a deceleration a' the reward is (stopping_distance v +
    time) (a' / a - 1) a second. Over a stop it sums to what the stop costs beyond the dry one.
    """

    stopping_distance: float = 0.01  # per metre travelled [1/m]
    time: float = 0.02  # per second [1/s]; as 2 m, else nothing is gained from coming to a stand (assumption)
    rest_of_stop: float = 1.0  # share of the potential that is paid [-]; 0: metres and seconds are charged as they pass
    slip: float = 0.03  # per metre slid, mean of the axles [1/m]; as three travelled, see `docs/environments.md` (assumption)
    large_slip: float = 0.01  # the same beyond the slide limit, once more [1/m] (assumption)
    locked_wheels: float = (
        0.01  # per metre travelled with all wheelsets locked, in proportion when fewer are [1/m] (assumption)
    )
    air: float = 0.0001  # per normal litre let into the cylinders [1/Nl]; as a centimetre (assumption)

    def __post_init__(self) -> None:
        """Refuse weights that are not finite numbers of at least zero."""
        for name, value in dataclasses.asdict(self).items():
            if not number(value) >= 0.0:
                raise ParameterError(
                    f"reward weight {name} = {shown(value)} is impossible: it must be a finite number, 0 or more"
                )


@dataclasses.dataclass(frozen=True)
class Task:
    """The options of the environments, all with defaults; plain values, so that an `EnvSpec` survives `to_json`.

    Parameters
    ----------
    action : "valve": MultiDiscrete of 0 vent, 1 hold, 2 apply per axle; "pressure": Box(-1, 1) per axle, -1 no pressure and
        +1 the demanded one
    adhesion : "recovering" (the seed paper's law) or "classic" (lambda = 0)
    control_interval_s, substep_s : time between actions and longest substep of the integration [s]
    plant : one of `wsp_env.plant.PLANTS`, or the import path "package.module:Class" of another, see `wsp_env.plant.port`
    track_geometry : for a plant whose wheels run on rails in space: a file with curves, irregularities and rails, or the same
        as a dictionary, see `wsp_env.parameters.track_geometry`; "": straight and smooth
    model : path of a JSON file with a tuned law, mechanisms and vehicle, see `wsp_env.envs.model`; options below go before it
    mechanisms : physics beyond the paper's model, {name: {parameter: value, or (lowest, highest) to draw from at each reset}}
    scenario : ranges that replace those of `Scenario`, {quantity: (lowest, highest)}
    reward : weights that replace those of `RewardWeights`, {term: weight}
    vehicle : what brakes in place of the id's vehicle, a name or a vehicle file; or values that replace the vehicle's, {field:
        value} of `Vehicle`. A named vehicle takes of `model` and `conditions` the contact alone
    coaches : a train of so many of what all else makes the vehicle, see `wsp_env.parameters.vehicle.train`
    conditions : replayed stops, {"vehicle": {field: value}, "stops": [{"name": name, quantity: value}, ...]}, as
        `wsp_env.recordings.conditions` makes them; each reset draws one of the stops, `reset(options={"condition": name})`
        chooses; quantities are those of `wsp_env.scenario.PINS`, what a stop leaves out is drawn
    pressure_sensors : the vehicle measures its cylinder pressures
    slide_limit : creepage [-] beyond which a slide is too large (assumption: no standard number is public)
    slide_limit_speed_mps : running speed [m/s] below which larger creepage is of no concern (assumption)
    time_limit_s, track_limit_m : a stop is truncated there [s], [m]

    """

    action: str = "valve"
    adhesion: str = "recovering"
    control_interval_s: float = 0.02
    substep_s: float = 0.01
    plant: str = "longitudinal"
    track_geometry: str | Mapping[str, Any] = ""
    model: str = ""
    mechanisms: Mechanisms = dataclasses.field(default_factory=dict)
    scenario: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    reward: Mapping[str, float] = dataclasses.field(default_factory=dict)
    vehicle: str | Mapping[str, Any] = dataclasses.field(default_factory=dict)
    coaches: int = 1
    conditions: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    pressure_sensors: bool = False
    slide_limit: float = 0.3
    slide_limit_speed_mps: float = 8.0
    time_limit_s: float = 180.0
    track_limit_m: float = 4000.0

    def __post_init__(self) -> None:
        """Refuse what cannot be, with the valid choices."""
        for name, choices in (("action", ("valve", "pressure")), ("adhesion", ("recovering", "classic"))):
            if getattr(self, name) not in choices:
                raise ParameterError(f"{name} = {shown(getattr(self, name))} is unknown; valid: {', '.join(choices)}")
        for name in ("mechanisms", "scenario", "reward", "conditions"):
            if not isinstance(getattr(self, name), Mapping):
                raise ParameterError(f"{name} = {shown(getattr(self, name))} must be a dictionary, {{name: value}}")
        if not isinstance(self.vehicle, str | Mapping):  # a path would not survive `to_json`
            raise ParameterError(f"vehicle = {shown(self.vehicle)} must be a name, a file's path as text, or {{field: value}}")
        if not isinstance(self.model, str):
            raise ParameterError(f"model = {shown(self.model)} must be a file's path as text")
        if self.modelled is not None:
            object.__setattr__(self, "mechanisms", {**self.modelled.mechanisms, **self.mechanisms})
            object.__setattr__(self, "scenario", {**self.modelled.scenario, **self.scenario})
        check_mechanisms(self.mechanisms)
        if unknown := sorted(set(self.conditions) - {"vehicle", "stops"}):
            raise ParameterError(f"conditions: unknown key {', '.join(unknown)}; valid: vehicle, stops")
        if not isinstance(self.stops, Sequence) or not all(isinstance(stop, Mapping) for stop in self.stops):
            raise ParameterError("conditions: stops must be a list of dictionaries {quantity: value}")
        if not isinstance(self.pressure_sensors, bool):
            raise ParameterError(f"pressure_sensors = {shown(self.pressure_sensors)} must be True or False")
        for stop in self.stops:
            if unknown := sorted(set(stop) - {"name", *PINS}):
                raise ParameterError(f"conditions: unknown quantity {', '.join(unknown)}; valid: name, {', '.join(PINS)}")
        _ = self.distributions, self.weights
        limits = {"slide_limit_speed_mps": (0.0, math.inf), "track_limit_m": (TRACK_STEP_M, 1e6)}
        for name in (
            "control_interval_s",
            "substep_s",
            "slide_limit",
            "slide_limit_speed_mps",
            "time_limit_s",
            "track_limit_m",
        ):
            low, high = limits.get(name, (math.ulp(0.0), math.inf))
            value = getattr(self, name)
            if not low <= number(value) <= high:
                bounds = "above zero" if low == math.ulp(0.0) else f"in [{low:g}, {high:g}]"
                raise ParameterError(f"{name} = {shown(value)} is impossible: it must be a finite number {bounds}")

    @property
    def distributions(self) -> Scenario:
        """What the stops are drawn from."""
        scenario: Scenario = replace(Scenario(), dict(self.scenario), "scenario quantity")
        return scenario

    @property
    def weights(self) -> RewardWeights:
        """The weights of the reward."""
        weights: RewardWeights = replace(RewardWeights(), dict(self.reward), "reward term")
        return weights

    @property
    def stops(self) -> Sequence[Mapping[str, Any]]:
        """The replayed stops, none without `conditions`."""
        stops: Sequence[Mapping[str, Any]] = self.conditions.get("stops", ())
        return stops

    def condition(self, chosen: Any) -> Mapping[str, Any]:
        """Return the replayed stop of a name or number."""
        names = [stop.get("name", str(index)) for index, stop in enumerate(self.stops)]
        if chosen in names:
            return self.stops[names.index(chosen)]
        if isinstance(chosen, int | np.integer) and 0 <= chosen < len(names):
            return self.stops[int(chosen)]
        valid = ", ".join(names) or "none, the environment was made without conditions"
        raise ParameterError(f"unknown condition {shown(chosen)}; valid: {valid}")

    @property
    def track_nodes(self) -> int:
        """Nodes that describe the track, up to its limit."""
        return math.ceil(self.track_limit_m / TRACK_STEP_M) + 1

    @functools.cached_property
    def modelled(self) -> TunedModel | None:
        """What the file `model` holds; None without one."""
        return read_model(self.model) if self.model else None

    def make_vehicle(self, name: str) -> Vehicle:
        """Return what brakes: the vehicle of that name, or what `model`, `conditions` and `vehicle` say; `coaches` of it.

        Warns where a model or conditions bring a vehicle with another number of axles.
        """
        replayed = dict(self.conditions.get("vehicle", {}))
        if isinstance(self.vehicle, str):
            vehicle = find_vehicle(self.vehicle)
            vehicle = self.modelled.tuned(vehicle) if self.modelled else vehicle
            replayed = {"contact": replayed["contact"]} if "contact" in replayed else {}
        else:
            vehicle = find_vehicle(name)
            vehicle = self.modelled.own_vehicle(vehicle) if self.modelled else vehicle
        vehicle = replace(vehicle, replayed, "conditions: vehicle parameter")
        if not isinstance(self.vehicle, str) and vehicle.axles != find_vehicle(name).axles:
            whose = "the conditions" if replayed else f"model {self.model}"
            warnings.warn(
                f"the vehicle of {whose} brakes, with {vehicle.axles} axle{'s' * (vehicle.axles > 1)}, and not the {name} of "
                f"the environment's id; vehicle={name!r} brakes the {name} under the same law",
                stacklevel=2,
            )
        values = {} if isinstance(self.vehicle, str) else self.vehicle
        return train(find_vehicle(values, vehicle), self.coaches)


def make_task(options: Mapping[str, Any]) -> Task:
    """Return the task of the keyword options given to `gym.make`; `None` means the default, an unknown name is an error."""
    defaults = Task()
    given = {name: getattr(defaults, name, None) if value is None else value for name, value in options.items()}
    task: Task = replace(defaults, given, "environment option")
    return task
