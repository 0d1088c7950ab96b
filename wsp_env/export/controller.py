"""A controller by rules as a unit of C: its methods translated, its attributes what an instance remembers."""

import copy
import dataclasses
from typing import Any

import numpy as np

from wsp_env.evaluation.controller import SHORT_NAMES, Controller, load
from wsp_env.export import kinds
from wsp_env.export.inputs import commanded, driven, measured, parameter
from wsp_env.export.observed import is_observed, observed_unit
from wsp_env.export.translator import Translator
from wsp_env.export.unit import Unit, Variable, assigned, flat
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.port import Measurement

#: By how much C and Python may differ, and why.
TOLERANCE = 1e-9
WHY = "numpy's exp of arrays may differ from the C library's in the last bit"

_RUNNING = {
    "reference": ("m/s", "reference speed"),
    "failed": ("1", "1 where a speed sensor has failed"),
    "standing": ("1", "1 where a wheel stands while the vehicle runs"),
}


def controller_unit(name: str, vehicle: Vehicle, interval_s: float = 0.02) -> Unit:
    """Return the unit of a controller by rules, for one vehicle; `UntranslatableError` for one that is written otherwise."""
    controller: Any = load(name)
    prefix = "wsp_" + (name if name in SHORT_NAMES else type(controller).__name__.lower()).replace("-", "_")
    title = f"Controller {name!r} for the {vehicle.axles} axles of the {vehicle.name}"
    if is_observed(controller):
        return observed_unit(name, title, prefix, vehicle, interval_s)
    controller.reset(kinds.SENTINEL, vehicle)
    t = Translator(prefix)
    own = t.type_of(controller)
    n, axles = kinds.SENTINEL, vehicle.axles
    seen = t.type_of(Measurement(np.zeros(n), np.zeros((n, axles)), np.zeros(n)))
    assert isinstance(own, kinds.Record)
    assert isinstance(seen, kinds.Record)
    method = type(controller).act
    call = t.call(method, [kinds.variable(own, "self->controller"), kinds.variable(seen, "seen")], None, "controller")
    wheels = getattr(controller, "wheels", None)
    running = {} if wheels is None else _RUNNING
    free, places = _parameters(controller, vehicle), _places(controller, "self->controller")
    changeable = [field for field in free if field.name in _free_names(controller, vehicle)]
    return Unit(
        name=prefix,
        title=title,
        translator=t,
        parameters=tuple(
            parameter(controller.parameters, field.name) for field in changeable
        ),
        inputs=measured(axles),
        outputs=(
            commanded(axles),
            *(Variable(what, *said, size=None if what == "reference" else axles) for what, said in running.items()),
        ),
        state=(f"{own.name} controller;",),
        start=(
            "memset(self, 0, sizeof *self);",
            *assigned("self->controller", controller, own),
            *(f"{place}.{field.name} = p->{field.name};" for place in places for field in changeable),
        ),
        step=(
            f"double result[{axles}];",
            f"{seen.name} seen;",
            "seen.time = u->time;",
            "seen.demand = u->demand;",
            f"memcpy(seen.wheel_speed, u->wheel_speed, {axles} * sizeof(double));",
            f"{call.code};",
            f"memcpy(y->command, result, {axles} * sizeof(double));",
            *(_told(what, axles) for what in running),
        ),
        reference=lambda times: driven(
            name, vehicle, interval_s, [field.name for field in changeable], outputs, drives=6 * times
        ),
        interval_s=interval_s,
        tolerance=TOLERANCE,
        why_tolerance=WHY,
        controller=True,
        axles=axles,
    )  # fmt: skip


def _told(what: str, axles: int) -> str:
    if what == "reference":
        return "y->reference = self->controller.wheels.reference;"
    return f"for (int64_t k = 0; k < {axles}; k++) {{ y->{what}[k] = self->controller.wheels.{what}[k] ? 1.0 : 0.0; }}"


def _parameters(controller: Any, vehicle: Vehicle) -> list[Any]:
    held = getattr(controller, "parameters", None)
    return [f for f in dataclasses.fields(held) if "unit" in f.metadata] if dataclasses.is_dataclass(held) else []


def _free_names(controller: Any, vehicle: Vehicle) -> set[str]:
    """Return the parameters from which nothing is computed at the start of a stop: they may be changed in C."""
    free = set()
    made = type(controller)
    for field in _parameters(controller, vehicle):
        value = getattr(controller.parameters, field.name)
        for other_value in (1.01 * value + 1e-3, 0.99 * value - 1e-3):
            try:
                other = made(dataclasses.replace(controller.parameters, **{field.name: other_value}))
            except ValueError:
                continue
            other.reset(1, vehicle)
            same = made(controller.parameters)
            same.reset(1, vehicle)
            if _numbers(other) == _numbers(same):
                free.add(field.name)
            break
    return free


def _numbers(value: Any) -> list[float]:
    """Return all that an object remembers, its parameters left out."""
    found: list[float] = []
    for name, item in vars(value).items():
        if name == "parameters":
            continue
        if isinstance(item, np.ndarray | float | int):
            found += flat(item)
        elif hasattr(item, "__dict__"):
            found += _numbers(item)
    return found


def _places(value: Any, place: str) -> list[str]:
    """Return where in the C an object and its parts keep the parameters."""
    found = [f"{place}.parameters"] if hasattr(value, "parameters") else []
    for name, item in vars(value).items():
        if name != "parameters" and hasattr(item, "__dict__") and not dataclasses.is_dataclass(item):
            found += _places(item, f"{place}.{kinds.safe(name)}")
    return found


def outputs(controller: Controller, seen: Measurement) -> list[float]:
    """Return what the C gives for a measurement, by the Python."""
    made = [copy.copy(controller.act(seen))]
    wheels = getattr(controller, "wheels", None)
    return flat(made + ([] if wheels is None else [getattr(wheels, what) for what in _RUNNING]))
