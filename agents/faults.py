"""Controllers whose sensors fail or whose wheels are worn: `python -m agents.faults --vehicle bogie`.

In each stop the sensor of one axle fails, axle by axle, at the start, after 4 s or after 12 s. Prints the distance over that of
the default rules with the same fault, or on dry rail over the dry stop, and the longest lock of a wheel above 15 km/h.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro

from agents.measure import HELD_OUT, low_adhesion
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


def stops_of(arguments: Arguments) -> tuple[list[Stop], list[str], np.ndarray]:
    """Return the stops, their rail (recovering, classic, dry) and whose sensor fails (N,): each stop once for each axle."""
    vehicle = VEHICLES[arguments.vehicle]
    found = {law: low_adhesion(vehicle, law, arguments.stops, arguments.drawn_by) for law in ("recovering", "classic")}
    found["dry"] = [dataclasses.replace(stop, coverage=0.0 * stop.coverage) for stop in found["recovering"][:3]]
    each = [(stop, rail, axle) for rail, own in found.items() for stop in own for axle in range(vehicle.axles)]
    stops, rails, axles = zip(*each, strict=True)
    return list(stops), list(rails), np.array(axles)


def with_fault(controller: Controller, fault: str, stops: list[Stop], axle: np.ndarray, vehicle: Vehicle) -> StopRecords:
    """Brake the stops with that fault."""
    if fault == "worn":
        one = np.eye(vehicle.axles)
        wear = [1.0 - WORN[i % len(WORN)] * one[k] for i, k in enumerate(axle)]
        stops = [dataclasses.replace(stop, radius=stop.radius * own) for stop, own in zip(stops, wear, strict=True)]
    elif fault != "sound":
        controller = Broken(controller, fault, axle, np.array([FAILS_S[i % len(FAILS_S)] for i in range(len(stops))]))
    return run(controller, vehicle, stops, Conduct())


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
    vehicle, (stops, rails, axle) = VEHICLES[arguments.vehicle], stops_of(arguments)
    dry = clean_rail(vehicle, stops, Conduct()).distance
    rows: list[dict[str, Any]] = []
    sound: dict[str, np.ndarray] = {}
    for fault in arguments.faults:
        results = {
            who: with_fault(controller, fault, stops, axle, vehicle) for who, controller in contestants(arguments).items()
        }
        for who, result in results.items():
            sound.setdefault(who, result.distance)
            lock = longest_lock(result)
            for rail in dict.fromkeys(rails):
                own = np.array(rails) == rail
                ratio = result.distance[own] / (dry if rail == "dry" else results["rules"].distance)[own]
                row = {"fault": fault, "rail": rail, "controller": who, "over": ratio.mean(), "worst": ratio.max()}
                row |= {"over_sound": np.mean(result.distance[own] / sound[who][own]), "lock_s": lock[own].max()}
                row |= {"locks": (lock[own] > 0.4).sum(), "stops": own.sum(), "ran_on": (~result.stopped[own]).sum()}
                rows.append(row)
    return rows


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the rows as a table in Markdown."""
    lines = [
        "| fault | rail | controller | distance / rules, on dry rail / dry stop (worst) | / the same without fault "
        "| longest lock above 15 km/h [s] | stops with more than 0.4 s |",
        "|:--|:--|:--|--:|--:|--:|--:|",
    ]
    for row in rows:
        mark = f", {row['ran_on']} ran on" if row["ran_on"] else ""
        lines.append(
            f"| {row['fault']} | {row['rail']} | {row['controller']} | {row['over']:.3f} ({row['worst']:.3f}){mark} "
            f"| {row['over_sound']:.3f} | {row['lock_s']:.2f} | {row['locks']} of {row['stops']} |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    print(table(compare(tyro.cli(Arguments))))
