"""One stop of the driving desk: what is chosen, the stop itself, and the same as a Python program."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from wsp_env.evaluation.controller import SHORT_NAMES
from wsp_env.parameters.quantity import ParameterError, shown
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.parameters.velim import TAU_M_PER_J

#: Samples of a stop that are kept to draw it: some ten a second of a long one.
SAMPLES = 600

#: A stop is given up here: from 200 km/h on the most slippery rail that can be chosen a locked coach needs some 8 km.
TIME_LIMIT_S, TRACK_LIMIT_M = 400.0, 12000.0

_KMH = 3.6
_KEPT = ("time_s", "position_m", "speed_mps", "wheel_speed_radps", "slip_speed_mps", "pressure_bar", "adhesion", "adhesion_d",
         "adhesion_r")  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Choice:
    """What the driver chooses; plain values, as they come from a page."""

    vehicle: str = "coach"
    speed_kmh: float = 120.0
    load: float = 0.0  # share of the payload [-]
    demand: float = 1.0  # share of full brake pressure [-]
    mu_cd: float = 0.03  # kinetic friction of the contaminated rail [-]
    tau: float = TAU_M_PER_J  # recovery rate [m/J]
    recovering: bool = True  # whether sliding cleans the rail
    law: str = "degraded"  # one of `wsp_env.contact.port.LAWS`
    track: str = "constant"  # one of `wsp_env.scenario.TRACKS`
    seed: int = 0  # of what a track and sensors draw
    controller: str = "rule-based"
    mechanisms: Mapping[str, Mapping[str, float]] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse names that none has; what numbers may be, the environment knows."""
        for name, valid in (("vehicle", VEHICLES), ("controller", SHORT_NAMES)):
            if getattr(self, name) not in valid:
                raise ParameterError(f"{name} = {shown(getattr(self, name))} is unknown; valid: {', '.join(valid)}")

    @property
    def id(self) -> str:
        """The environment's id."""
        return f"wsp_env/{self.vehicle.capitalize()}-v1"

    @property
    def options(self) -> dict[str, Any]:
        """Keyword arguments of `gym.make`, without those that are as by default."""
        found: dict[str, Any] = {"time_limit_s": TIME_LIMIT_S, "track_limit_m": TRACK_LIMIT_M}
        if not self.recovering:
            found["adhesion"] = "classic"
        if self.law != "degraded":
            found["vehicle"] = {"contact": {"traction_law": self.law}}
        if self.mechanisms:
            found["mechanisms"] = {name: dict(values) for name, values in self.mechanisms.items()}
        return found

    @property
    def pins(self) -> dict[str, Any]:
        """Options of `reset`."""
        return {
            "mu_cd": self.mu_cd, "tau": self.tau, "initial_speed": round(self.speed_kmh / _KMH, 6), "load": self.load,
            "demand": self.demand, "gradient": 0.0, "sensor_noise": 0.0, "track": self.track,
        }  # fmt: skip

    @property
    def words(self) -> str:
        """What brakes, on what, by what, in a line."""
        rail = f"mu_cd {self.mu_cd:g}" + (f", tau {1e4 * self.tau:.3g}e-4 m/J" if self.recovering else ", no recovery")
        more = [name.replace("_", " ") for name in self.mechanisms]
        return "; ".join([f"{self.vehicle}, {self.controller}", rail, *([f"with {', '.join(more)}"] if more else [])])

    def code(self, name: str = "stop") -> str:
        """Return a program that brakes this stop and prints its distance."""
        options = "".join(f"    {key}={value!r},\n" for key, value in self.options.items())
        pins = "".join(f"    {key!r}: {value!r},\n" for key, value in self.pins.items())
        return f'''"""{name} of the driving desk: {self.words}."""

import gymnasium as gym
import numpy as np

import wsp_env  # registers the environments
from wsp_env.evaluation.controller import load

env = gym.make(
    {self.id!r},
{options})
pins = {{
{pins}}}
observation, info = env.reset(seed={self.seed!r}, options=pins)
batch = env.unwrapped.batch
controller = load({self.controller!r})
controller.reset(1, batch.vehicle)
ended = False
while not ended:
    command = controller.act(batch.measurement())[0]  # per axle: -1 vents, 0 holds, +1 applies
    observation, reward, terminated, truncated, info = env.step(np.rint(command).astype(int) + 1)
    ended = terminated or truncated
print(f"{{info['position_m']:.2f}} m in {{info['time_s']:.2f}} s")
'''


def braked(choice: Choice) -> dict[str, Any]:
    """Brake a stop as `Choice.code` does; return its figures and its course as plain lists, [] for what is no number."""
    import gymnasium as gym

    import wsp_env.envs  # noqa: F401  # registers the environments
    from wsp_env.evaluation.controller import load

    env = gym.make(choice.id, **choice.options)
    _, info = env.reset(seed=choice.seed, options=choice.pins)
    batch = env.unwrapped.batch  # type: ignore[attr-defined]  # gymnasium: any environment
    controller = load(choice.controller)
    controller.reset(1, batch.vehicle)
    rows, locked, ended, terminated = [[info[name] for name in _KEPT]], np.zeros(batch.vehicle.axles), False, False
    while not ended:
        command = controller.act(batch.measurement())[0]
        _, _, terminated, truncated, info = env.step(np.rint(command).astype(int) + 1)
        rows.append([info[name] for name in _KEPT])
        locked += info["locked"]
        ended = terminated or truncated
    interval = batch.task.control_interval_s
    thin = np.unique(np.linspace(0, len(rows) - 1, min(SAMPLES, len(rows))).astype(int))
    course = {name: np.array([rows[i][place] for i in thin]) for place, name in enumerate(_KEPT)}
    radius = batch.plant.conditions.radius[0]
    course["wheel_mps"] = course.pop("wheel_speed_radps") * radius
    slips = np.array([row[_KEPT.index("slip_speed_mps")] for row in rows])
    return {
        "words": choice.words,
        "stopped": bool(terminated),
        "distance_m": float(info["position_m"]),
        "time_s": float(info["time_s"]),
        "mean_slip_mps": float(slips.mean()),
        "locked_s": float(interval * locked.max()),
        "air_nl": float(np.sum(info["air_nl"])),
        "vehicle": _drawn(batch.vehicle),
        "course": {name: np.round(values.astype(float), 5).tolist() for name, values in course.items()},
    }


def _drawn(vehicle: Any) -> dict[str, Any]:
    """Return what a picture of a vehicle needs."""
    return {
        "name": vehicle.name,
        "axle_positions_m": list(vehicle.axle_positions_m),
        "bodies": [list(body) for body in vehicle.running_gear],
        "radius_m": vehicle.wheel_radius_m,
        "full_pressure_bar": vehicle.brake.full_pressure_bar,
    }
