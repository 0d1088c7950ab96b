"""The guarded observer in C, as policies and controllers on an observer share it: what is remembered, and three calls."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from wsp_env.export import kinds
from wsp_env.export.source import plain_function
from wsp_env.export.translator import Direct, Translator
from wsp_env.export.unit import Variable, assigned
from wsp_env.observer import doubts as judging
from wsp_env.observer import estimate, guard, observation, overrule
from wsp_env.observer.observation import Observer
from wsp_env.parameters.vehicle import Vehicle

#: What guard and observer found, as outputs: where it is in the C, name, unit, meaning, whether for each axle, whether a truth.
_FOUND = (
    ("memory.estimate.speed", "running_speed", "m/s", "estimated", False, False),
    ("memory.estimate.uncertainty", "uncertainty", "m/s", "standard deviation of the estimated running speed", False, False),
    ("memory.estimate.adhesion", "used_adhesion", "1", "estimated", True, False),
    ("doubts.failed", "failed", "1", "1 where a speed sensor is not believed", True, True),
    ("doubts.standing", "standing", "1", "1 where a wheel stands while the vehicle runs", True, True),
)


def rebuilders(*modules: Mapping[str, Any]) -> dict[Any, Any]:
    """Return what stands in C for the kernels of `wsp_env.compiled.rebuilder` in these modules' names: what they are given."""
    same = Direct(lambda given, body: given[0])
    return {
        held: same
        for names in modules
        for held in names.values()
        if callable(held) and getattr(plain_function(held), "__name__", "") == "rebuild"
    }


def kernels_names() -> tuple[Mapping[str, Any], ...]:
    """Return the names of the modules whose kernels are translated here."""
    return vars(guard), vars(overrule), vars(observation)


@dataclasses.dataclass(frozen=True)
class Guarded:
    """Lines of C for a unit's state, start and step, around `self->memory`, `->constants`, `->doubts` and `->guard`."""

    state: tuple[str, ...]
    start: tuple[str, ...]
    begin: tuple[str, ...]  # with the first measurement
    observe: tuple[str, ...]  # with a later one
    overrule: str  # changes the last command
    outputs: tuple[Variable, ...]
    tell: tuple[str, ...]  # fills them in
    memory: kinds.Value
    constants: kinds.Value


def guarded_observer(
    t: Translator,
    vehicle: Vehicle,
    interval_s: float,
    command: str,
    timers: tuple[float, float] = (overrule.TIMER_S, overrule.TIMER_REST_S),
    by_pressure: bool = False,
    sensors: bool = False,
) -> Guarded:
    """Return the guarded observer of one vehicle, whose last command (A,) stands in the C at `command`."""
    axles, size = vehicle.axles, Observer.size_for(vehicle.axles)
    given = observation._constants_of(vehicle, interval_s, by_pressure)
    doubted = judging.allocate(kinds.SENTINEL, axles)
    slow = estimate.approach(interval_s, judging.NOISE_FILTER_S)
    judged = judging.GuardConstants(vehicle.wheel_radius_m, interval_s, slow, *timers)
    memory, constants, doubts, own = (
        kinds.variable(t.type_of(example), f"self->{name}")
        for name, example in (
            ("memory", observation._allocate(kinds.SENTINEL, vehicle, interval_s)), ("constants", given), ("doubts", doubted),
            ("guard", judged),
        )
    )  # fmt: skip
    table = kinds.Array(kinds.REAL, (kinds.BATCH, axles), const=True)
    wheel, last = kinds.variable(table, "u->wheel_speed"), kinds.variable(table, command)
    demand = kinds.variable(kinds.Array(kinds.REAL, (kinds.BATCH,)), "u->demand")
    pressure = kinds.variable(table if sensors else kinds.Array(kinds.REAL, (0, 0)), "u->pressure")
    seen = kinds.variable(kinds.Array(kinds.SINGLE, (kinds.BATCH, size)), "self->observation")
    changed = kinds.variable(dataclasses.replace(table, const=False), command)
    mask, clean = kinds.variable(kinds.Array(kinds.BOOL, (kinds.BATCH,)), "true"), doubts.member("clean")

    def call(function: Callable[..., Any], *arguments: kinds.Value) -> str:
        return f"{t.call(function, arguments, None).code};"

    state = (memory, constants, doubts, own)
    names = ("memory", "constants", "doubts", "guard")
    return Guarded(
        state=(
            *(f"{t.c_type(one.type)} {name};" for one, name in zip(state, names, strict=True)),
            f"float observation[{size}];",
            "bool begun;",
        ),
        start=(
            *assigned("self->constants", given, constants.type),
            *assigned("self->doubts", doubted, doubts.type),
            *assigned("self->guard", judged, own.type),
        ),
        begin=(
            call(guard._begin, wheel, doubts),
            call(observation._begin, mask, clean, demand, memory, constants, seen),
            f"for (int64_t k = 0; k < {axles}; k++) {{",
            "    self->memory.estimate.trusted[k] = !self->doubts.failed[k];",
            "}",
            call(guard._note, doubts, own, memory),
            "self->begun = true;",
        ),
        observe=(
            call(guard._doubt, wheel, doubts, own, memory, constants),
            call(observation._observe, clean, last, demand, pressure, memory, constants, seen),
        ),
        overrule=call(overrule.overrule, changed, doubts, own, memory, constants),
        outputs=tuple(Variable(name, unit, said, size=axles if each else None) for _, name, unit, said, each, _ in _FOUND),
        tell=(
            *(f"y->{name} = self->{place};" for place, name, _, _, each, _ in _FOUND if not each),
            f"for (int64_t k = 0; k < {axles}; k++) {{",
            *(
                f"    y->{name}[k] = self->{place}[k]{' ? 1.0 : 0.0' if truth else ''};"
                for place, name, _, _, each, truth in _FOUND
                if each
            ),
            "}",
        ),
        memory=memory,
        constants=constants,
    )


def found(observer: Observer, wheels: guard.Guard) -> list[np.ndarray]:
    """Return what the outputs say, by the Python."""
    estimate = observer.estimate
    return [estimate.speed, estimate.uncertainty, estimate.adhesion, wheels.failed, wheels.standing]
