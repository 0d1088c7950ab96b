"""Stops on vehicles that are not quite what the policy believes: brakes, gains, radii and sensors drawn, to train in.

The vehicles are those of `agents.drawn`: each part of the batch has a brake and a gain of its own, and the observer believes
the nominal one, as when deployed. Worn wheelsets are left out: the guard of a deployed policy learns the radii while they roll
(`wsp_env.observer.guard`), and a training has no guard.
"""

import dataclasses
from typing import Any

import numpy as np

from agents.drawn import NOISE, RADIUS, drawn_vehicle
from agents.worlds import Shaped
from wsp_env.envs.sb3 import BrakingVecEnv
from wsp_env.envs.task import make_task
from wsp_env.observer.observation import Observer

#: Vehicles drawn for a training; each brakes as many of the stops.
VEHICLES_DRAWN = 8


def varied_parts(
    vehicle: str, count: int, law: str, options: dict[str, Any], slide_price: float, seed: int
) -> list[Shaped]:  # fmt: skip
    """Return `count` stops under a law, spread over drawn vehicles."""
    rng = np.random.default_rng([seed, law == "classic"])
    nominal = make_task(options).make_vehicle(vehicle)
    parts = []
    for share in np.array_split(np.arange(count), min(VEHICLES_DRAWN, count)):
        own, mechanisms = drawn_vehicle(nominal, rng)
        changed = dict(options)
        changed["vehicle"] = {"brake": dataclasses.asdict(own.brake)}
        changed["scenario"] = {**options.get("scenario", {}), "sensor_noise": (0.0, NOISE)}
        radius = {"change": float(RADIUS * rng.normal()), "axle": float(rng.integers(nominal.axles) + 1)}
        changed["mechanisms"] = {**options.get("mechanisms", {}), **mechanisms, "wheel_radius": radius}
        env = BrakingVecEnv(f"wsp_env/{vehicle.title()}-v1", len(share), adhesion=law, **changed)
        batch = env.env.batch
        batch.observer = Observer(nominal, batch.task.control_interval_s, batch.task.pressure_sensors)
        parts.append(Shaped(env, slide_price))
    return parts
