"""A tuned model from a file, as `wsp diagnose` writes it: the law, the mechanisms and the vehicle of the recordings."""

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from wsp_env.parameters.campaign_vehicle import CampaignVehicle, plant_vehicle
from wsp_env.parameters.document import DocumentError, read_json
from wsp_env.parameters.quantity import ParameterError, number, replace, shown
from wsp_env.parameters.vehicle import Vehicle

_KEYS = {
    "tau_m_per_J": float, "mu_cd": Mapping, "contact": Mapping, "mechanisms": Mapping, "vehicle": Mapping, "sources": Mapping,
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class TunedModel:
    """What a model file means for an environment."""

    path: str
    tau_m_per_j: float | None  # [m/J]
    mu_cd: Mapping[str, float]  # of every run [-]
    mechanisms: Mapping[str, Any]  # as the option of `Task`
    scenario: Mapping[str, Any]  # as the option of `Task`
    contact: Mapping[str, float]  # values of `ContactParameters` that replace the vehicle's
    vehicle: CampaignVehicle | None  # that it was found on; None: the file does not say
    sources: Mapping[str, str] = dataclasses.field(default_factory=dict)  # SHA-256 of each file that it was found on

    def tuned(self, vehicle: Vehicle) -> Vehicle:
        """Return a vehicle with the contact of the model."""
        try:
            tuned: Vehicle = replace(vehicle, {"contact": dict(self.contact)}, "vehicle parameter")
        except ParameterError as error:
            raise ParameterError(f"model {self.path}: {error}") from None
        return tuned

    def own_vehicle(self, base: Vehicle) -> Vehicle:
        """Return the vehicle that the model was found on; `base` with the model's contact where the file does not say.

        What the file does not tell of its vehicle (valve times, sensors, payload) is as in `base`, or as in the coach where
        `base` has another number of axles.
        """
        tuned, own = self.tuned(base), self.vehicle
        if own is None:
            return tuned
        brake = base.brake
        if own.torque_per_bar_nm > 0.0:
            brake = dataclasses.replace(brake, torque_per_bar_nm=own.torque_per_bar_nm)
        if own.axles == base.axles:
            return plant_vehicle(own, tuned.contact, base.name, base, brake=brake)
        return plant_vehicle(own, tuned.contact, "vehicle of the model", brake=brake)


def read_model(path: str) -> TunedModel:
    """Return what a model file means for an environment.

    The file is JSON with `tau_m_per_J` [m/J], `mu_cd` {run: value} [-], `contact` {field of `ContactParameters`: value},
    `mechanisms` {name: {parameter: value}}, `vehicle` {field of `CampaignVehicle`: value} and `sources` {file: SHA-256}, each
    optional; what begins with "note" is ignored. tau is then the file's, mu_cd drawn from the range of its runs.

    Raises
    ------
    ParameterError
        for a file that is none, is no JSON or holds something else under a key

    """
    try:
        document = read_json(Path(path))
    except DocumentError as error:
        raise ParameterError(f"model {path} {error}") from None
    if not isinstance(document, dict):
        raise ParameterError(f"model {path} must hold an object with any of {', '.join(_KEYS)}")
    if unknown := [key for key in document if key not in _KEYS and not key.startswith("note")]:
        if "verdict" in document:
            raise ParameterError(f"model {path} is the answer of a diagnosis; give the model.json beside it")
        raise ParameterError(f"model {path}: {', '.join(map(repr, unknown))} unknown; valid: {', '.join(_KEYS)}")
    if not document:
        raise ParameterError(f"model {path} is empty; it holds any of {', '.join(_KEYS)}")
    for key, kind in _KEYS.items():
        value = document.get(key)
        fits = math.isfinite(number(value)) if kind is float else isinstance(value, kind)
        if value is not None and not fits:
            raise ParameterError(f"model {path}: {key} = {shown(value)} must be {'a number' if kind is float else 'an object'}")
    scenario: dict[str, Any] = {}
    given = document.get("mu_cd") or {}
    if (tau := document.get("tau_m_per_J")) is not None:
        scenario["tau"] = (tau, tau)
    if given:
        if not all(math.isfinite(number(value)) for value in given.values()):
            raise ParameterError(f"model {path}: mu_cd = {shown(given)} must give each run a finite number")
        frictions = [number(value) for value in given.values()]
        scenario["mu_cd"] = (min(frictions), max(frictions))
    vehicle = _vehicle(path, document["vehicle"]) if document.get("vehicle") else None
    friction = {run: number(value) for run, value in given.items()}
    mechanisms, contact = document.get("mechanisms") or {}, document.get("contact") or {}
    return TunedModel(path, tau, friction, mechanisms, scenario, contact, vehicle, document.get("sources") or {})


def _vehicle(path: str, described: dict[str, Any]) -> CampaignVehicle:
    if lacking := [name for name in ("axles", "mass_kg", "wheelset_inertia_kgm2", "wheel_radius_m") if name not in described]:
        raise ParameterError(f"model {path}: vehicle lacks {', '.join(lacking)}; add it, or leave the vehicle out")
    try:
        vehicle: CampaignVehicle = replace(CampaignVehicle(), described, "vehicle parameter")
    except ParameterError as error:
        raise ParameterError(f"model {path}: {error}") from None
    return vehicle
