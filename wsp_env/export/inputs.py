"""What units of controllers have in common: inputs, commands, parameters, and drives to compare them on."""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from wsp_env.evaluation.controller import load
from wsp_env.export.unit import Variable, flat
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.port import Measurement


def measured(axles: int, pressure: bool = False) -> tuple[Variable, ...]:
    """Return the inputs of a controller."""
    sensors = (Variable("pressure", "bar", "in the brake cylinders", size=axles),) if pressure else ()
    return (
        Variable("time", "s", "since the start of the stop"),
        Variable("wheel_speed", "rad/s", "measured, axle by axle from the front", size=axles),
        Variable("demand", "1", "brake demand, share of full pressure", (1.0,)),
        *sensors,
    )


def commanded(axles: int) -> Variable:
    """Return the output of a controller."""
    return Variable("command", "1", "-1 vents, 0 holds, +1 applies", (1.0,), axles)


def parameter(parameters: Any, name: str) -> Variable:
    """Return a field of a controller's parameters, with its unit, its range and its source."""
    field = next(one for one in dataclasses.fields(parameters) if one.name == name)
    said = f"{name.replace('_', ' ')}, {field.metadata['low']:g} to {field.metadata['high']:g}: {field.metadata['source']}"
    return Variable(
        name, {"-": "1"}.get(field.metadata["unit"], field.metadata["unit"]), said, (float(getattr(parameters, name)),)
    )


def changed(name: str, parameters: Sequence[str], rng: np.random.Generator | None) -> Any:
    """Return the controller of a name, with these of its parameters times up to 1.5, or from 0 to any in their range."""
    controller: Any = load(name)
    for one in parameters if rng is not None else ():
        assert rng is not None
        field = next(field for field in dataclasses.fields(controller.parameters) if field.name == one)
        value, high = float(getattr(controller.parameters, one)), field.metadata["high"]
        quick = field.metadata["unit"] == "s"  # what lasts has to end within a drive
        other = (
            value * (rng.uniform(0.1, 0.3) if quick else rng.uniform(0.5, 1.5))
            if value != 0.0
            else rng.uniform(0.0, 1.0) * high
        )
        try:
            controller = type(controller)(dataclasses.replace(controller.parameters, **{one: other}))
        except ParameterError:  # at a bound
            continue
    return controller


def random_drive(vehicle: Vehicle, interval_s: float, steps: int, rng: np.random.Generator) -> Iterator[Measurement]:
    """Yield what sensors might say in a stop: wheels that slide at random times, roll again, stand, and sensors that fail."""
    axles = vehicle.axles
    speed = float(rng.uniform(15.0, 45.0))
    slip, rate = np.zeros(axles), np.zeros(axles)
    radius = vehicle.wheel_radius_m * rng.uniform(0.985, 1.0, axles)
    fails = np.where(rng.random(axles) < 0.15, rng.uniform(0.0, steps * interval_s, axles), np.inf)
    for step in range(steps):
        time = step * interval_s
        if step > 40:
            speed = max(speed - float(rng.uniform(0.0, 2.0)) * interval_s, 0.0)
            rate = np.where(rng.random(axles) < 0.04, rng.normal(0.0, 8.0, axles), rate)
            slip = np.clip(slip + rate * interval_s, 0.0, speed)
        wheel = np.maximum((speed - slip) / radius + rng.normal(0.0, 0.01, axles), 0.0)
        wheel[time >= fails] = rng.choice([0.0, np.nan])
        yield Measurement(np.array([time]), wheel[None, :], np.array([float(rng.choice([1.0, 0.7]))]))


def driven(
    name: str, vehicle: Vehicle, interval_s: float, parameters: Sequence[str],
    outputs: Callable[[Any, Measurement], list[float]], *, drives: int, steps: int = 500, seed: int = 0,
) -> Iterator[tuple[str, list[float], list[float]]]:  # fmt: skip
    """Yield test vectors of a controller: random drives, from the second on with these parameters changed.

    Parameters
    ----------
    outputs : returns what the C gives for a measurement, by the Python

    """
    rng = np.random.default_rng(seed)
    for drive in range(drives):
        controller = changed(name, parameters, rng if drive else None)
        controller.reset(1, vehicle)
        yield "start", [float(getattr(controller.parameters, one)) for one in parameters], []
        for seen in random_drive(vehicle, interval_s, steps, rng):
            yield "step", flat((seen.time, seen.wheel_speed, seen.demand)), outputs(controller, seen)
