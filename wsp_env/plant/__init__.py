"""A braked vehicle on its rail, behind one front door: `wsp_env.plant.port`."""

import importlib
from typing import Any

from wsp_env.parameters.quantity import ParameterError, shown
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.port import MEMBERS, Plant, Setup

#: The plants that come along, each with its class.
PLANTS = {
    "longitudinal": "wsp_env.plant.longitudinal.plant:LongitudinalPlant",
    "multibody": "wsp_env.plant.multibody.plant:MultibodyPlant",
}


def make_plant(vehicle: Vehicle, n: int = 1, setup: Setup | None = None, name: str = "longitudinal") -> Plant:
    """Return n vehicles at rest.

    `name` is one of `PLANTS`, or the import path `package.module:Class` of somebody else's, which is then run as Python.
    `ParameterError` says what could not be found.
    """
    module, colon, attribute = PLANTS.get(name, name).partition(":") if isinstance(name, str) else ("", "", "")
    if not (module.strip(".") and colon and attribute):
        raise ParameterError(f"unknown plant {shown(name)}; valid: {', '.join(PLANTS)}, or package.module:Class")
    try:
        found: Any = getattr(importlib.import_module(module), attribute)
    except Exception as error:  # whatever a module of somebody else raises
        hint = "; PYTHONPATH=. finds a module in this folder" if isinstance(error, ModuleNotFoundError) else ""
        raise ParameterError(f"plant {shown(name)} cannot be loaded: {error}{hint}") from error
    try:
        plant: Plant = found(vehicle, n, setup or Setup())
    except ParameterError:
        raise
    except Exception as error:
        raise ParameterError(f"plant {shown(name)} cannot be made: {type(error).__name__}: {error}") from error
    if missing := [member for member in MEMBERS if not hasattr(plant, member)]:
        raise ParameterError(f"plant {shown(name)} is none: it lacks {', '.join(missing)}; see wsp_env/plant/port.py")
    return plant
