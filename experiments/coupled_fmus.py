"""A coach and its wheel slide protection as two FMUs, coupled by FMPy: the same stop as in Python.

    wsp export fmu plant --out coach.fmu
    wsp export fmu rule-based --out rules.fmu
    pip install fmpy
    python experiments/coupled_fmus.py coach.fmu rules.fmu

The FMUs need nothing of Python. At every communication point the protection decides on what the sensors say there, then the
plant moves under the new command: one function of ten lines, `couple`. FMPy's own `simulate_fmu`, or a tool that steps both
at once, gives the plant the command of the point before.
"""

import dataclasses
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import tyro

from wsp_env.evaluation.controller import load
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.parameters.vehicle_file import find_vehicle
from wsp_env.plant import make_plant
from wsp_env.plant.port import Setup, Stop

#: What is compared, one value for the vehicle or one for each axle.
OF_THE_VEHICLE, OF_AXLES = ("position", "speed", "brake_work"), ("wheel_speed", "pressure", "contact_work")

#: By how much the two may differ, relative from 1 on: rounding of the units' conversions in a tool, were there any.
TOLERANCE = 1e-12

#: A stop that has not ended after so long is given up [s].
LIMIT_S = 400.0


class Slave(Protocol):
    """An FMU that runs."""

    def set(self, values: Mapping[str, float]) -> None:
        """Set variables by name."""

    def initialise(self) -> None:
        """Begin at time 0, once the parameters are set."""

    def get(self, names: Sequence[str]) -> list[float]:
        """Return variables by name."""

    def step(self, time: float, length: float) -> None:
        """Go on from a time for so long [s]."""


class InFMPy:
    """An FMU in FMPy, of FMI 2.0 or 3.0."""

    def __init__(self, file: Path) -> None:
        import fmpy

        self._described = fmpy.read_model_description(str(file))
        self._folder = fmpy.extract(str(file))
        self._fmu: Any = fmpy.instantiate_fmu(self._folder, self._described, fmi_type="CoSimulation")
        self._numbers = {one.name: one.valueReference for one in self._described.modelVariables}
        self._old = self._described.fmiVersion.startswith("2")

    def set(self, values: Mapping[str, float]) -> None:
        """Set variables by name."""
        put = self._fmu.setReal if self._old else self._fmu.setFloat64
        put([self._numbers[name] for name in values], list(values.values()))

    def initialise(self) -> None:
        """Begin at time 0, once the parameters are set."""
        if self._old:
            self._fmu.setupExperiment(startTime=0.0)
        self._fmu.enterInitializationMode()
        self._fmu.exitInitializationMode()

    def get(self, names: Sequence[str]) -> list[float]:
        """Return variables by name."""
        read = self._fmu.getReal if self._old else self._fmu.getFloat64
        return list(read([self._numbers[name] for name in names]))

    def step(self, time: float, length: float) -> None:
        """Go on from a time for so long [s]."""
        self._fmu.doStep(currentCommunicationPoint=time, communicationStepSize=length)

    def close(self) -> None:
        """End it."""
        self._fmu.terminate()
        self._fmu.freeInstance()
        shutil.rmtree(self._folder, ignore_errors=True)


def names(axles: int) -> list[str]:
    """Return the variables that are compared."""
    return [*OF_THE_VEHICLE, *(f"{name}[{k}]" for name in OF_AXLES for k in range(1, axles + 1))]


def couple(
    plant: Slave, wsp: Slave, parameters: Mapping[str, float], demand: float, axles: int, interval_s: float
) -> np.ndarray:
    """Brake to standstill; return what `names` lists, after every interval (T, n)."""
    sensors, wheels = ([f"{name}[{k}]" for k in range(1, axles + 1)] for name in ("measured_wheel_speed", "wheel_speed"))
    commands = [f"command[{k}]" for k in range(1, axles + 1)]
    plant.set(parameters)
    for one in (plant, wsp):
        one.initialise()
        one.set({"demand": demand})
    rows = []
    for n in range(round(LIMIT_S / interval_s)):
        time = n * interval_s
        wsp.set(dict(zip(wheels, plant.get(sensors), strict=True)))
        wsp.step(time, interval_s)
        plant.set(dict(zip(commands, wsp.get(commands), strict=True)))
        plant.step(time, interval_s)
        rows.append(plant.get(names(axles)))
        if plant.get(["moving"]) == [0.0]:
            break
    return np.array(rows)


def in_python(vehicle: Vehicle, stop: Stop, controller: str, interval_s: float) -> np.ndarray:
    """Brake the same stop by the package itself; return the same (T, n)."""
    plant = make_plant(vehicle, 1, Setup(interval_s))
    plant.start(0, stop)
    wsp = load(controller)
    wsp.reset(1, vehicle)
    rows: list[list[float]] = []
    while plant.moving[0] and len(rows) < round(LIMIT_S / interval_s):
        # The clock of a coupled simulation counts intervals, the plant adds up its substeps: the last digit of a time decides
        # when a pulse ends.
        seen = plant.reading()._replace(time=np.array([len(rows) * interval_s]))
        plant.step(wsp.act(seen))
        now = plant.truth()._asdict()
        rows.append([now[name][0] for name in OF_THE_VEHICLE] + [value for name in OF_AXLES for value in now[name][0]])
    return np.array(rows)


def worst_difference(one: np.ndarray, other: np.ndarray) -> float:
    """Return the largest difference, relative from 1 on; inf where the two have not the same length."""
    if one.shape != other.shape:
        return np.inf
    return float(np.max(np.abs(one - other) / np.maximum(1.0, np.abs(other))))


@dataclasses.dataclass(frozen=True)
class Coupled:
    """Couple two FMUs in FMPy and compare the stop with the package's own."""

    plant: tyro.conf.Positional[Path]
    """Of `wsp export fmu plant`."""
    wsp: tyro.conf.Positional[Path]
    """Of `wsp export fmu rule-based`."""
    vehicle: str = "coach"
    """The one that both were exported for."""
    controller: str = "rule-based"
    """What the second FMU was made from."""
    initial_speed: float = 120.0 / 3.6
    """[m/s]"""
    mu_cd: float = 0.04
    """Kinetic friction coefficient of the contaminated rail."""
    tau: float = 1e-4
    """Recovery rate [m/J]."""

    def run(self) -> float:
        """Print both stops; return their largest difference."""
        vehicle = find_vehicle(self.vehicle)
        interval_s = Setup().control_interval_s
        one = np.ones(1)
        radius = np.full(vehicle.axles, vehicle.wheel_radius_m)
        stop = Stop(
            mu_cd=self.mu_cd, tau=self.tau, initial_speed=self.initial_speed, mass=vehicle.mass_kg, demand=1.0, gradient=0.0,
            noise=0.0, key=0, radius=radius, profile=one, coverage=one,
        )  # fmt: skip
        parameters = {name: float(getattr(stop, name)) for name in ("mu_cd", "tau", "initial_speed", "mass")}
        plant, wsp = InFMPy(self.plant), InFMPy(self.wsp)
        coupled = couple(plant, wsp, parameters, stop.demand, vehicle.axles, interval_s)
        plant.close()
        wsp.close()
        own = in_python(vehicle, stop, self.controller, interval_s)
        for what, rows in (("FMUs in FMPy", coupled), ("Python", own)):
            print(
                f"{what:13} {len(rows) * interval_s:8.2f} s {rows[-1, 0]:12.6f} m {1e-6 * rows[-1, 2]:10.6f} MJ in the brakes"
            )
        worst = worst_difference(coupled, own)
        print(f"largest difference of {len(names(vehicle.axles))} variables over {len(own)} intervals: {worst:.3g}")
        return worst


if __name__ == "__main__":
    raise SystemExit(0 if tyro.cli(Coupled).run() <= TOLERANCE else 1)
