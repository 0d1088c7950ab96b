"""A learned policy from its folder as a controller: measurement in, valve command out, on onnxruntime alone.

The folder holds `policy.onnx` (normalisation and clipping inside), `contract.json` (what goes in and comes out, for which
vehicle and rate) and a model card. Nothing in it is code and nothing is unpickled.
"""

import dataclasses
import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from wsp_env.evaluation.network import Infer, open_network
from wsp_env.observer import estimate, estimator, rail, running_speed
from wsp_env.observer.guard import Guard
from wsp_env.observer.observation import Observer
from wsp_env.parameters.document import DocumentError, read_json
from wsp_env.parameters.quantity import ParameterError, number, shown
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.parameters.vehicle import Vehicle, check_vehicle
from wsp_env.plant.port import Measurement

#: Version of the contract's form; another one is refused.
CONTRACT_VERSION = 1

#: Files of a policy folder.
NETWORK, CONTRACT = "policy.onnx", "contract.json"

#: Names of the network's outputs, and what they are.
OUTPUTS = {
    "command": "(N, axles); valve: -1 vent, 0 hold, +1 apply; pressure: -1 none to +1 the demanded one",
    "raw": "the network's last layer; valve: (N, 3 x axles), the logits of vent, hold and apply, axle by axle, "
    "or (N, axles), the brake wanted, -1 none to +1 that which asks for an adhesion of 0.2, or the pressure commanded",
}

#: Kind of each entry of a contract; those left out have checks of their own.
_KINDS = {
    "contract": int,
    "wsp_env": str,
    "vehicle": str,
    "axles": int,
    "measurement": list,
    "observation": list,
    "observer": dict,
    "output": dict,
    "limits": dict,
    "training": dict,
    "sha256": str,
}

_SHORTEST_S = 1e-4  # control interval, as plants take it

#: Share of the control interval by which the time between two measurements may differ from it (assumption).
_INTERVAL_TOLERANCE = 0.01


@dataclasses.dataclass(frozen=True)
class Contract:
    """What a policy needs to be run by anybody; see `contract.json`."""

    contract: int  # version of this form
    wsp_env: str  # version of the package that wrote it
    vehicle: str
    axles: int
    control_interval_s: float
    action: str  # "valve" or "pressure"
    pressure_sensors: bool
    measurement: list[dict[str, str]]  # name, unit, shape, meaning
    observation: list[dict[str, str]]  # one entry per number, in order
    observer: dict[str, float]  # constants of `Observer` and its estimates, see `observer_constants`
    output: dict[str, str]
    limits: dict[str, Any]  # what the policy was trained for: ranges of the conditions, adhesion that full brake asks for
    training: dict[str, Any]  # arguments, decisions, score on the watched stops, version of torch
    sha256: str  # of the network's file

    def __post_init__(self) -> None:
        """Refuse what this version cannot run."""
        for name, kind in _KINDS.items():
            if type(getattr(self, name)) is not kind:
                raise ParameterError(f"its {name} is {shown(getattr(self, name))}, not of the kind {kind.__name__}")
        if self.contract != CONTRACT_VERSION:
            raise ParameterError(
                f"its contract has version {shown(self.contract)}, this wsp_env runs version {CONTRACT_VERSION}"
            )
        if self.action not in ("valve", "pressure"):
            raise ParameterError(f"its action is {shown(self.action)}; valid: valve, pressure")
        if self.vehicle not in VEHICLES:
            raise ParameterError(f"it is for a {shown(self.vehicle)}; valid: {', '.join(VEHICLES)}")
        if self.axles != VEHICLES[self.vehicle].axles:
            raise ParameterError(f"it is for {self.axles!r} axles, a {self.vehicle} has {VEHICLES[self.vehicle].axles}")
        if not _SHORTEST_S <= number(self.control_interval_s) < 1.0:
            given = shown(self.control_interval_s)
            raise ParameterError(f"its control interval is {given} s; valid: from {_SHORTEST_S:g}, below 1")
        if not isinstance(self.pressure_sensors, bool):
            raise ParameterError(f"its pressure_sensors are {shown(self.pressure_sensors)}; valid: true, false")
        measured = describe_measurement(self.axles, self.pressure_sensors)
        observed = describe_observation(self.axles, self.pressure_sensors)
        compared: tuple[tuple[str, Mapping[str, object], Mapping[str, object]], ...] = (
            ("observer", self.observer, observer_constants()),
            ("measurement", _numbered(self.measurement), _numbered(measured)),
            ("observation", _numbered(self.observation), _numbered(observed)),
        )
        for what, own, here in compared:
            wrong = [name for name in {**own, **here} if own.get(name) != here.get(name)]
            if others := [f"{name}: {shown(own.get(name))}, not {shown(here.get(name))}" for name in wrong]:
                more = f", and {len(others) - 3} more" if len(others) > 3 else ""
                raise ParameterError(f"its {what} is not that of this wsp_env: {'; '.join(others[:3])}{more}")


def _numbered(entries: list[dict[str, str]]) -> dict[str, dict[str, str]]:
    return {f"entry {i + 1}": entry for i, entry in enumerate(entries)}


def observer_constants() -> dict[str, float]:
    """Return the constants of `Observer` that decide what a policy sees."""
    holders = (Observer, estimate, estimator, running_speed, rail)
    constants = {name: value for holder in holders for name, value in vars(holder).items() if name.isupper()}
    found: dict[str, float] = {}
    for name, value in constants.items():
        if isinstance(value, tuple):
            found |= {f"{name}[{i}]": float(one) for i, one in enumerate(value)}
        else:
            found[name] = float(value)
    return found


def describe_measurement(axles: int, pressure_sensors: bool) -> list[dict[str, str]]:
    """Return name, unit and shape of what is measured, in order, as `Measurement` holds it."""
    described = [
        {"name": "time", "unit": "s", "shape": "(N,)", "meaning": "since the start of the stop"},
        {"name": "wheel_speed", "unit": "rad/s", "shape": f"(N, {axles})", "meaning": "measured, axle by axle from the front"},
        {"name": "demand", "unit": "1", "shape": "(N,)", "meaning": "brake demand, share of full pressure"},
    ]
    if pressure_sensors:
        described.append({"name": "pressure", "unit": "bar", "shape": f"(N, {axles})", "meaning": "in the cylinders"})
    return described


def describe_observation(axles: int, pressure_sensors: bool) -> list[dict[str, str]]:
    """Return name and unit of every number of an observation, in order, as `Observer` builds it."""
    blocks = [
        ("slip: estimated running speed less circumferential wheel speed", f"{Observer.SLIP_SCALE:g} m/s"),
        ("creepage", "1"),
        ("circumferential wheel acceleration, low-passed", f"{Observer.ACCELERATION_SCALE:g} m/s2"),
        ("adhesion that the brake asks for" + ("" if pressure_sensors else ", estimated"), f"{Observer.ADHESION_SCALE:g}"),
        ("the same once the commands on their way have acted, estimated", f"{Observer.ADHESION_SCALE:g}"),
        ("used adhesion, estimated", f"{Observer.ADHESION_SCALE:g}"),
        ("recent slip", f"{Observer.SLIP_SCALE:g} m/s"),
        ("recent adhesion", f"{Observer.ADHESION_SCALE:g}"),
        ("slow slip", f"{Observer.SLIP_SCALE:g} m/s"),
        ("slow adhesion", f"{Observer.ADHESION_SCALE:g}"),
    ]
    numbers = [{"name": f"{name}, axle {k + 1}", "unit": unit} for name, unit in blocks for k in range(axles)]
    taus = [f"tau = {tau:g} m/J" for tau in rail.RECOVERY_M_PER_J]
    return [
        *numbers,
        *({"name": f"mu_cd that fits what was seen if {tau}", "unit": f"{Observer.FRICTION_SCALE:g}"} for tau in taus),
        *(
            {"name": f"log10 of the deviation of its logarithm if {tau}", "unit": f"{Observer.CONTRADICTION_SCALE:g}"}
            for tau in taus
        ),
        {"name": "time that wheels have slid, fading", "unit": f"{rail.MEMORY_S:g} s"},
        {"name": "standard deviation of the running speed", "unit": f"{Observer.UNCERTAINTY_SCALE:g} m/s"},
        {"name": "running speed in doubt", "unit": "1"},
        {"name": "adhesion that the distributor's pressure asks for, estimated", "unit": f"{Observer.ADHESION_SCALE:g}"},
        {"name": "running speed, estimated", "unit": f"{Observer.SPEED_SCALE:g} m/s"},
        {"name": "adhesion that the demanded brake asks for", "unit": f"{Observer.ADHESION_SCALE:g}"},
    ]


class Policy:
    """A controller that asks a network, with a guard before and behind it (`wsp_env.observer.guard`).

    `wheels.failed` and `wheels.standing` (N, axles) report sensors that are not believed and locked wheels.

    Parameters
    ----------
    contract : what it needs
    infer : from observations (N, size) and memory (N, M), both float32, to commands (N, axles) and memory
    memory : M, 0 for a network without
    guarded : sensors are doubted, radii learned, axles that are not watched braked by rules; False: what comes from the network
        alone, as in its training

    """

    wheels: Guard

    def __init__(self, contract: Contract, infer: Infer, memory: int = 0, guarded: bool = True) -> None:
        self.contract = contract
        self.guarded = guarded
        self.action = contract.action
        self.infer, self._size = infer, memory
        self._vehicle: Vehicle | None = None

    def check(self, vehicle: Vehicle, interval_s: float, pressure_sensors: bool) -> None:
        """Raise `ParameterError` for another number of axles, another interval of measurements [s] or missing sensors."""
        check_vehicle(vehicle)
        if vehicle.axles != self.contract.axles:
            raise ParameterError(
                f"the policy is for the {self.contract.axles} axles of a {self.contract.vehicle}, the {vehicle.name} has "
                f"{vehicle.axles}"
            )
        if self.contract.pressure_sensors and not pressure_sensors:
            raise ParameterError("the policy needs cylinder pressures, the vehicle does not measure them")
        wanted = self.contract.control_interval_s
        if abs(interval_s - wanted) > _INTERVAL_TOLERANCE * wanted:
            raise ParameterError(f"the policy decides every {wanted:g} s, but its measurements come every {interval_s:g} s")

    def reset(self, n: int, vehicle: Vehicle) -> None:
        """Begin n new stops; `ParameterError` for a vehicle with another number of axles."""
        self.check(vehicle, self.contract.control_interval_s, self.contract.pressure_sensors)
        self._vehicle = vehicle
        self._observer = Observer(
            vehicle, self.contract.control_interval_s, self.contract.pressure_sensors, by_pressure=self.action == "pressure"
        )
        self.wheels = Guard(vehicle, self._observer, n)
        self._command = np.ones((n, vehicle.axles))
        self._memory = np.zeros((n, self._size), dtype=np.float32)
        self._time = np.zeros(n)
        self._decisions = 0

    def act(self, measurement: Measurement) -> np.ndarray:
        """Return the commands (N, A); `ParameterError` for measurements at another interval or without a needed sensor.

        The interval is that between the first two measurements; later ones are taken to come as regularly.
        """
        if self._vehicle is None:
            raise ParameterError("call reset(n, vehicle) before act")
        if self._decisions < 2:
            since = float(np.max(measurement.time - self._time)) if self._decisions else self.contract.control_interval_s
            self.check(self._vehicle, since, measurement.pressure is not None)
        if self.guarded:
            first, later = self.wheels.begin, self.wheels.observe
        else:
            first, later = self._observer.reset, self._observer.observe
        observation = first(measurement) if self._decisions == 0 else later(measurement, self._command)
        self._time = np.array(measurement.time)
        self._decisions += 1
        command, self._memory = self.infer(observation, self._memory)
        self._command = np.array(command, dtype=np.float64, order="C")
        if self.guarded and self.action == "valve":
            self.wheels.overrule(self._command)
        return self._command.copy()


def load_policy(folder: str | Path, guarded: bool = True) -> Policy:
    """Return the policy of a folder, see `Policy`; `ParameterError` says what is missing in it or does not fit."""
    place = Path(folder)
    contract, network = read_contract(place), place / NETWORK
    try:
        content = network.read_bytes()
    except OSError as error:
        raise ParameterError(f"policy {place}: {NETWORK} cannot be read: {error.strerror}") from None
    if hashlib.sha256(content).hexdigest() != contract.sha256:
        raise ParameterError(f"policy {place}: {NETWORK} is not the network that {CONTRACT} was written for (sha256 differs)")
    try:
        return Policy(contract, *open_network(content, len(contract.observation), contract.axles), guarded)
    except ParameterError:  # not installed
        raise
    except ValueError as error:
        raise ParameterError(f"policy {place}: {NETWORK} {error}") from None


def read_contract(folder: Path) -> Contract:
    """Return the contract of a folder; `ParameterError` says what does not fit."""
    path = folder / CONTRACT
    try:
        document = read_json(path)
    except DocumentError as error:
        raise ParameterError(f"policy {folder}: {CONTRACT} {error}") from None
    names = [field.name for field in dataclasses.fields(Contract)]
    if not isinstance(document, Mapping) or (wrong := set(document) ^ set(names)):
        what = ", ".join(sorted(wrong)) if isinstance(document, Mapping) else "everything"
        raise ParameterError(f"policy {folder}: {CONTRACT} lacks or does not know {what}; it holds {', '.join(names)}")
    try:
        return Contract(**document)
    except ParameterError as error:
        raise ParameterError(f"policy {folder}: {error}") from None
