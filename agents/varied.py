"""Stops on vehicles that are not quite what the policy believes: brakes, gains, radii and sensors drawn, to train in.

The vehicles are those of `agents.drawn`: each part of the batch has a brake and a gain of its own, and the observer believes
the nominal one, as when deployed. Some are nominal. The guard of deployed policies (`wsp_env.observer.guard`) stands before and
behind: it learns the radii, filters noise and overrules commands, so that the learner sees what it will see.
"""

import dataclasses
from typing import Any

import numpy as np

from agents.drawn import GRADIENT, NOISE, RADIUS, WORN, drawn_cleaning, drawn_line, drawn_vehicle
from agents.worlds import Shaped
from wsp_env.envs.sb3 import BrakingVecEnv
from wsp_env.envs.task import make_task
from wsp_env.observer.estimate import VehicleEstimate
from wsp_env.observer.guard import Guard
from wsp_env.observer.observation import Observer
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.command import to_action
from wsp_env.plant.port import Measurement

#: Vehicles of a training under each law, and how many of them, the last, are nominal with usual noise; each brakes as many of
#: the stops.
VEHICLES, NOMINAL = 32, 8


class Guarded:
    """An observer with the guard of deployed policies before it, for environments: stops begin anew one by one.

    Parameters
    ----------
    vehicle : that is believed
    interval_s : time between observations [s]
    pressure_sensors : measurements hold cylinder pressures

    """

    guard: Guard

    def __init__(self, vehicle: Vehicle, interval_s: float, pressure_sensors: bool) -> None:
        self.vehicle = vehicle
        self.observer, self._spare = (Observer(vehicle, interval_s, pressure_sensors) for _ in range(2))
        self.size = self.observer.size

    @property
    def estimate(self) -> VehicleEstimate:
        """What is estimated of the vehicles; to be read, never to be kept."""
        return self.observer.estimate

    def reset(self, measurement: Measurement, mask: np.ndarray | None = None) -> np.ndarray:
        """Begin new stops, of all N vehicles or where `mask` (N,) is True; return all observations (N, size)."""
        if mask is None:
            self.guard = Guard(self.vehicle, self.observer, len(measurement.wheel_speed))
            return self.guard.begin(measurement)
        begun = Guard(self.vehicle, self._spare, len(mask))
        begun.begin(measurement)
        for own, new in zip(self.guard.doubts, begun.doubts, strict=True):
            own[mask] = new[mask]
        observation = self.observer.reset(measurement._replace(wheel_speed=self.guard.doubts.clean), mask)
        self.estimate.trusted[mask] = ~self.guard.failed[mask]
        return observation

    def observe(self, measurement: Measurement, command: np.ndarray) -> np.ndarray:
        """Take the next measurement and the command (N, A) given before it; return the observation (N, size)."""
        return self.guard.observe(measurement, command)


class Overruled(Shaped):
    """The same with the guard behind the policy."""

    def final(self, actions: np.ndarray) -> np.ndarray:
        """Return the actions (N, A) that the guard lets pass."""
        observer: Any = self.batch.observer
        return to_action(observer.guard.overrule(actions.astype(np.float64) - to_action(0.0)))


def varied_parts(
    vehicle: str, count: int, law: str, options: dict[str, Any], slide_price: float, seed: int,
    kind: str = "varied",
) -> list[Shaped]:  # fmt: skip
    """Return `count` stops under a law, spread over drawn vehicles, of which the last are nominal.

    Of the kind "line", drawn vehicles have drag and fading pads, and run on gradients; of the kind "cleaning", their wheels
    clean the rail for those behind.
    """
    rng = np.random.default_rng([seed, law == "classic"])
    nominal = make_task(options).make_vehicle(vehicle)
    parts: list[Shaped] = []
    for share in np.array_split(np.arange(count), min(VEHICLES, count)):
        changed = dict(options)
        if len(parts) < VEHICLES - NOMINAL:
            own, mechanisms = drawn_vehicle(nominal, rng)
            changed["vehicle"] = {"brake": dataclasses.asdict(own.brake)}
            changed["scenario"] = {**options.get("scenario", {}), "sensor_noise": (0.0, NOISE)}
            if kind == "cleaning":
                mechanisms = mechanisms | drawn_cleaning(rng)
            if kind == "line":
                changed["scenario"]["gradient"], mechanisms = GRADIENT, mechanisms | drawn_line(rng)
            radius = {"change": float(RADIUS * rng.normal()), "axle": float(rng.integers(nominal.axles) + 1)}
            radius["change"] -= float(rng.uniform(0.0, max(WORN)))
            changed["mechanisms"] = {**options.get("mechanisms", {}), **mechanisms, "wheel_radius": radius}
        env = BrakingVecEnv(f"wsp_env/{vehicle.title()}-v1", len(share), adhesion=law, **changed)
        batch: Any = env.env.batch
        batch.observer = Guarded(nominal, batch.task.control_interval_s, batch.task.pressure_sensors)
        parts.append(Overruled(env, slide_price))
    return parts
