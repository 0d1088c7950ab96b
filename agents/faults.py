"""Controllers whose sensors fail or whose wheels are worn: `python -m agents.faults --vehicle bogie`.

In each stop the sensor of one axle fails, axle by axle, at the start, after 4 s or after 12 s. Prints the distance over that of
the default rules with the same fault, or on dry rail over the dry stop under full brake, and over the controller's own without
fault, means and worst; and the longest lock of a wheel above 15 km/h. With `--world "drawn brakes"` or `all` controllers are
told the nominal vehicle (`agents.drawn`).
"""

import dataclasses
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro

from agents.drawn import Believing, world
from agents.measure import HELD_OUT
from agents.rules import front
from wsp_env.envs.step import LOCKED_WHEEL_MPS
from wsp_env.evaluation.controller import Controller, load
from wsp_env.evaluation.figures import longest_run
from wsp_env.evaluation.policy import load_policy
from wsp_env.evaluation.reference import clean_rail
from wsp_env.evaluation.runner import Conduct, StopRecords, run
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.port import Measurement, Stop

#: When a sensor fails [s], stop by stop.
FAILS_S = (0.0, 4.0, 12.0)

#: Worn radius of one wheelset over the nominal one [-], stop by stop.
WORN = (0.01, 0.02, 0.03, 0.04)

#: Noise of a sensor that is noisy [rad/s].
NOISY = 3.0

FAULTS = ("sound", "zero", "lost", "frozen", "noisy", "worn")

#: Stops on dry rail.
DRY = 3

#: Locks count above this running speed [m/s], 15 km/h.
RUNNING_MPS = 15.0 / 3.6


@dataclasses.dataclass(frozen=True)
class Arguments:
    """What is measured."""

    vehicle: Literal["wheelset", "bogie", "coach"] = "bogie"
    stops: int = 6  # of each law; every one once for each axle
    faults: tuple[str, ...] = FAULTS
    price: str = "3"  # of the adaptive controller's settings
    drawn_by: int = HELD_OUT  # seed of the stops
    world: str = "nominal"  # see `agents.drawn.world`
    demand: float = 1.0  # share of the full brake that is asked for


class Broken:
    """A controller one of whose sensors fails: in row i that of `axle[i]` from `time[i]` [s].

    Parameters
    ----------
    controller : whose
    fault : zero, lost (nan), frozen or noisy

    """

    def __init__(self, controller: Controller, fault: str, axle: np.ndarray, time: np.ndarray) -> None:
        self.controller, self.fault, self.axle, self.time = controller, fault, axle, time

    def reset(self, n: int, vehicle: Vehicle) -> None:
        """Begin n new stops."""
        self.controller.reset(n, vehicle)
        self._held = np.zeros(n)
        self._rng = np.random.default_rng(0)

    def act(self, measurement: Measurement) -> np.ndarray:
        """Return the commands (N, A)."""
        wheel, rows = measurement.wheel_speed.copy(), np.arange(len(self.axle))
        now, fails = wheel[rows, self.axle], measurement.time >= self.time
        self._held = np.where(fails & (measurement.time > 0.0), self._held, now)
        read = {
            "zero": np.zeros(len(rows)),
            "lost": np.full(len(rows), np.nan),
            "frozen": self._held,
            "noisy": now + NOISY * self._rng.normal(size=len(rows)),
        }
        wheel[rows, self.axle] = np.where(fails, read[self.fault], now)
        return self.controller.act(measurement._replace(wheel_speed=wheel))


@dataclasses.dataclass(frozen=True)
class Part:
    """Stops of one vehicle on one rail, each once for each axle, whose sensor fails."""

    rail: str  # recovering, classic, dry
    vehicle: Vehicle
    conduct: Conduct
    stops: list[Stop]
    axle: np.ndarray  # (N,)


def parts_of(arguments: Arguments) -> list[Part]:
    """Return the stops under both laws, and some of the same on dry rail."""
    believed, parts = VEHICLES[arguments.vehicle], list[Part]()
    for law in ("recovering", "classic"):
        for vehicle, mechanisms, stops in world(arguments.world, believed, law, arguments.stops, arguments.drawn_by):
            asked = [dataclasses.replace(stop, demand=arguments.demand) for stop in stops]
            parts.append(_each_axle(law, vehicle, Conduct(mechanisms=mechanisms), asked))
    recovering = [part for part in parts if part.rail == "recovering"]
    for part in recovering:
        own = part.stops[:: believed.axles][: max(1, DRY // len(recovering))]
        dry = [dataclasses.replace(stop, coverage=0.0 * stop.coverage) for stop in own]
        parts.append(_each_axle("dry", part.vehicle, part.conduct, dry))
    return parts


def _each_axle(rail: str, vehicle: Vehicle, conduct: Conduct, stops: list[Stop]) -> Part:
    axle = np.tile(np.arange(vehicle.axles), len(stops))
    return Part(rail, vehicle, conduct, [stop for stop in stops for _ in range(vehicle.axles)], axle)


def with_fault(controller: Controller, fault: str, part: Part) -> StopRecords:
    """Brake the stops with that fault."""
    stops = part.stops
    if fault == "worn":
        one = np.eye(part.vehicle.axles)
        wear = [1.0 - WORN[i % len(WORN)] * one[k] for i, k in enumerate(part.axle)]
        stops = [dataclasses.replace(stop, radius=stop.radius * own) for stop, own in zip(stops, wear, strict=True)]
    elif fault != "sound":
        times = np.array([FAILS_S[i % len(FAILS_S)] for i in range(len(stops))])
        controller = Broken(controller, fault, part.axle, times)
    return run(controller, part.vehicle, stops, part.conduct)


def longest_lock(result: StopRecords) -> np.ndarray:
    """Return the longest time for which a wheel of each stop was locked above 15 km/h (N,) [s]."""
    speed, slip = result.speed.astype(np.float64)[..., None], result.slip.astype(np.float64)
    locked = (speed - slip < LOCKED_WHEEL_MPS) & (speed > RUNNING_MPS)
    longest: np.ndarray = result.time[1] * longest_run(locked).max(axis=1)
    return longest


def contestants(arguments: Arguments) -> dict[str, Controller]:
    """Return who is measured; the rules first."""
    folder = Path("agents/trained") / arguments.vehicle
    adaptive = front(folder, "adaptive").get(arguments.price, load("adaptive"))
    bare = load_policy(folder, guarded=False)
    return {"rules": load("rule-based"), "adaptive": adaptive, "policy": load_policy(folder), "policy without guard": bare}


def compare(arguments: Arguments) -> list[dict[str, Any]]:
    """Return a row for each fault, rail and controller."""
    believed, parts = VEHICLES[arguments.vehicle], parts_of(arguments)
    whos = {who: Believing(controller, believed) for who, controller in contestants(arguments).items()}
    dry = [_full(part) if part.rail == "dry" else np.zeros(0) for part in parts]
    found = {
        (who, fault): [with_fault(controller, fault, part) for part in parts]
        for who, controller in whos.items()
        for fault in dict.fromkeys(("sound", *arguments.faults))
    }
    rows: list[dict[str, Any]] = []
    for fault, who, rail in product(arguments.faults, whos, dict.fromkeys(part.rail for part in parts)):
        own = [i for i, part in enumerate(parts) if part.rail == rail]
        results = [found[who, fault][i] for i in own]
        distance = np.concatenate([result.distance for result in results])
        other = [dry[i] if rail == "dry" else found["rules", fault][i].distance for i in own]
        ratio, sound = distance / np.concatenate(other), np.concatenate([found[who, "sound"][i].distance for i in own])
        lock = np.concatenate([longest_lock(result) for result in results])
        row = {"fault": fault, "rail": rail, "controller": who, "over": ratio.mean(), "worst": ratio.max()}
        row |= {"distance_m": distance.mean(), "over_sound": (distance / sound).mean(), "worst_sound": (distance / sound).max()}
        row |= {"lock_s": lock.max(), "locks": (lock > 0.4).sum(), "stops": len(lock)}
        rows.append(row | {"ran_on": sum(int((~result.stopped).sum()) for result in results)})
    return rows


def _full(part: Part) -> np.ndarray:
    """Return the distances (N,) of the same stops under full brake on clean rail [m]."""
    stops = [dataclasses.replace(stop, demand=1.0) for stop in part.stops]
    distance: np.ndarray = clean_rail(part.vehicle, stops, part.conduct).distance
    return distance


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the rows as a table in Markdown."""
    lines = [
        "| fault | rail | controller | distance [m] | / rules, on dry rail / dry stop (worst) "
        "| / the same without fault (worst) | longest lock above 15 km/h [s] | stops with more than 0.4 s |",
        "|:--|:--|:--|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        mark = f", {row['ran_on']} ran on" if row["ran_on"] else ""
        lines.append(
            f"| {row['fault']} | {row['rail']} | {row['controller']} | {row['distance_m']:.0f} "
            f"| {row['over']:.3f} ({row['worst']:.3f}){mark} | {row['over_sound']:.3f} ({row['worst_sound']:.3f}) "
            f"| {row['lock_s']:.2f} | {row['locks']} of {row['stops']} |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    print(table(compare(tyro.cli(Arguments))))
