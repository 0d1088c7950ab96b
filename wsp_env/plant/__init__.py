"""A braked vehicle on its rail, behind one front door: `wsp_env.plant.port`."""

import importlib
from typing import Any

from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.port import Plant, Setup

#: The plants that come along, each with its class.
PLANTS = {"longitudinal": "wsp_env.plant.longitudinal.plant:LongitudinalPlant"}


def make_plant(vehicle: Vehicle, n: int = 1, setup: Setup | None = None, name: str = "longitudinal") -> Plant:
    """Return n vehicles at rest.

    `name` is one of `PLANTS`, or the import path `package.module:Class` of somebody else's, which is then run as Python.
    `ParameterError` says what could not be found.
    """
    path = PLANTS.get(name, name)
    module, colon, attribute = path.partition(":")
    if not colon:
        raise ParameterError(f"unknown plant {name!r}; valid: {', '.join(PLANTS)}, or package.module:Class")
    try:
        found: Any = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise ParameterError(f"plant {name!r} cannot be loaded: {error}") from None
    plant: Plant = found(vehicle, n, setup or Setup())
    return plant
