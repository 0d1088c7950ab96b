"""The coach in one and in three dimensions: where they agree, what load transfer explains, which substep is small enough.

    python -m experiments.multibody.limits [--only same substeps protected]

`same` brakes with the same commands: the longitudinal coach; the multibody coach with its suspensions blocked, which is the
same vehicle; the free one; and the longitudinal one with the mechanism `load_transfer` at the vehicle's own heights.
`substeps` is one stop at several substeps against the smallest. `protected` repeats a stop under the rule-based
controller with other sensor noise: single stops part, so their distributions are compared.
"""

import dataclasses
import math
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import tyro
from rich.console import Console

from wsp_env.evaluation.controller import load
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.parameters.velim import CONTACT, TAU_M_PER_J
from wsp_env.plant.longitudinal.plant import LongitudinalPlant
from wsp_env.plant.multibody import plant as multibody
from wsp_env.plant.port import Setup, Stop
from wsp_env.report import Table, terminal_table

VEHICLE = dataclasses.replace(COACH, contact=CONTACT)
#: Substeps [s] that are compared; the last is what the others stand against.
SUBSTEPS_S = (1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4, 3.125e-5)
FINE = Setup(substep_s=5e-4)  # for both plants, so that only dimensions differ


class Case(NamedTuple):
    """A stop with given commands."""

    name: str
    mu_cd: float
    speed_mps: float
    cycling: bool  # whether every axle vents and applies at its own times: wheels slide, lock and roll again


CASES = (
    Case("dry rail", 0.28, 40.0, False), Case("full brake", 0.06, 25.0, False),
    Case("brakes cycling", 0.03, 25.0, True), Case("brakes cycling, fast", 0.06, 40.0, True),
)  # fmt: skip


class Braked(NamedTuple):
    """What a stop says."""

    distance_m: float
    loads: np.ndarray  # (T, A, 2) wheel loads [N]; empty of a plant that has none
    duration_s: float
    computed_s: float


def started(plant: LongitudinalPlant, case: Case, noise: float = 0.0) -> LongitudinalPlant:
    """Start the stop in the whole batch; the sensors' noise differs."""
    radius, flat = np.full(VEHICLE.axles, VEHICLE.wheel_radius_m), np.ones(1)
    for i in range(plant.n):
        plant.start(
            i, Stop(case.mu_cd, TAU_M_PER_J, case.speed_mps, VEHICLE.mass_kg, 1.0, 0.0, noise, i + 1, radius, flat, flat)
        )
    return plant


def brake(plant: LongitudinalPlant, case: Case) -> Braked:
    """Brake one stop with the commands of the case."""
    started(plant, case)
    loads = []
    begin, step = time.process_time(), 0
    while plant.moving[0]:
        phase = (step + 11 * np.arange(VEHICLE.axles)) % 100
        command = np.where(case.cycling & (phase < 25), -1.0, np.where(case.cycling & (phase < 35), 0.0, 1.0))
        plant.step(command[None])
        if isinstance(plant, multibody.MultibodyPlant):
            loads.append(plant.bodies.wheel_load[0].copy())
        step += 1
    spent = time.process_time() - begin
    return Braked(float(plant.state.position[0]), np.array(loads), float(plant.state.time[0]), spent)


def heights() -> dict[str, float]:
    """Return the vehicle's own heights for `load_transfer`; nothing is fitted."""
    own = VEHICLE.multibody
    return {"body_height_m": own.carbody_height_m - own.drawing_height_m, "pivot_height_m": own.drawing_height_m}


def same(console: Console) -> None:
    """Print distances of the same commands in one and three dimensions."""
    rows = []
    for case in CASES:
        one = brake(LongitudinalPlant(VEHICLE, 1, FINE), case).distance_m
        blocked = brake(multibody.MultibodyPlant(VEHICLE, 1, FINE, blocked=True), case).distance_m
        free = brake(multibody.MultibodyPlant(VEHICLE, 1, FINE), case).distance_m
        moved = dataclasses.replace(FINE, mechanisms={"load_transfer": heights()})
        with_it = brake(LongitudinalPlant(VEHICLE, 1, moved), case).distance_m
        off = (f"{100.0 * (other / one - 1.0):+.3f} %" for other in (blocked, free, with_it))
        rows.append((case.name, f"{case.mu_cd:g}", f"{one:.2f}", *off))
    header = ("commands", "mu_cd", "1D [m]", "3D blocked", "3D free", "1D with load transfer")
    console.print(terminal_table(Table(header, rows, "stopping distance against the longitudinal coach")))


def substeps(console: Console) -> None:
    """Print errors and speed over the substep."""
    chosen = multibody.SUBSTEP_S
    for case in (CASES[1], CASES[2]):
        found: list[Braked] = []
        for substep in SUBSTEPS_S:
            multibody.SUBSTEP_S = substep  # the plant takes no longer one than its own
            found.append(brake(multibody.MultibodyPlant(VEHICLE, 1, Setup(substep_s=substep)), case))
        multibody.SUBSTEP_S = chosen
        fine, rows = found[-1], []
        before = (math.nan, math.nan, math.nan)  # substep and errors of the row above
        for substep, stop in zip(SUBSTEPS_S[:-1], found[:-1], strict=True):
            n = min(len(stop.loads), len(fine.loads)) - 1  # the last interval ends within it
            off = 1e2 * np.abs(stop.loads[:n] - fine.loads[:n]) / VEHICLE.static_wheel_load_n
            errors = 1e2 * abs(stop.distance_m / fine.distance_m - 1.0), float(off.mean())
            orders = [math.log(old / new) / math.log(before[0] / substep) for old, new in zip(before[1:], errors, strict=True)]
            before = (substep, *errors)
            cells = f"{1e3 * substep:g}", f"{errors[0]:.6f}", f"{errors[1]:.4f}", f"{np.quantile(off, 0.99):.4f}"
            rows.append((*cells, *(f"{order:.1f}" for order in orders), f"{stop.duration_s / stop.computed_s:.0f}"))
        header = (
            "substep [ms]", "distance off [%]", "wheel load off, mean [%]", "99 % below [%]", "order: distance", "wheel load",
            "times real time",
        )  # fmt: skip
        console.print(terminal_table(Table(header, rows, f"{case.name}, mu_cd {case.mu_cd:g}, {case.speed_mps:g} m/s")))


def protected(console: Console, stops: int = 12) -> None:
    """Print distances under the rule-based controller of stops that differ in the noise of their sensors."""
    case, rows, found = Case("", 0.03, 30.0, False), [], {}
    plants: dict[str, Callable[[], LongitudinalPlant]] = {
        "1D": lambda: LongitudinalPlant(VEHICLE, stops, FINE),
        "3D blocked": lambda: multibody.MultibodyPlant(VEHICLE, stops, FINE, blocked=True),
        "3D free": lambda: multibody.MultibodyPlant(VEHICLE, stops, FINE),
    }
    for name, make in plants.items():
        plant = started(make(), case, noise=0.05)
        controller = load("rule-based")
        controller.reset(stops, VEHICLE)
        while plant.moving.any():
            plant.step(np.asarray(controller.act(plant.reading()._replace(pressure=None))))
        found[name] = plant.state.position.copy()
    one = found["1D"]
    for name, three in found.items():
        error = math.sqrt((one.var(ddof=1) + three.var(ddof=1)) / stops)
        longer = three.mean() - one.mean()
        rows.append((name, f"{three.mean():.1f}", f"{three.std(ddof=1):.1f}", f"{longer:+.1f}", f"{error:.1f}"))
    title = f"{stops} stops from {case.speed_mps:g} m/s at mu_cd {case.mu_cd:g} under the rule-based controller"
    header = ("plant", "mean distance [m]", "deviation [m]", "less 1D [m]", "its standard error [m]")
    console.print(terminal_table(Table(header, rows, title)))


PARTS: dict[str, Callable[[Console], None]] = {"same": same, "substeps": substeps, "protected": protected}


def main(only: tuple[str, ...] = tuple(PARTS)) -> None:
    """Print the tables.

    Parameters
    ----------
    only
        Names of the tables.

    """
    console = Console(width=150, highlight=False)
    for name in only:
        PARTS[name](console)


if __name__ == "__main__":
    tyro.cli(main)
