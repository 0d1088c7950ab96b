"""Corrects recordings whose speeds are late or wrong according to a model, and computes the readings of such sensors.

Late wheel speeds are not advanced, because this would add the rate of their noise and of the friction, which no model predicts.
Instead, the other channels are delayed equally. Torques and vehicle speed that pass the same filter balance the wheels as they
are read: all balances except the law's are linear, and the law hardly changes within such a time.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.signal import lfilter

from wsp_env.diagnosis.evaluate import Choice, Evaluation, Evaluator, Model, read_late
from wsp_env.diagnosis.stops import PreparedStop
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.mechanisms import ALL, misread_wheel
from wsp_env.plant.mechanisms.terms import concerns
from wsp_env.recordings import Campaign

_ITERATIONS = 3  # iterations from true values to readings: the rate of a late reading is late, too


_OF_SCALE = frozenset({"radii", "reading_factor"})  # slots that change by how much a wheel's reading errs, not its time


def on_sensors(model: Model) -> Choice:
    """Return the mechanisms of a model that act on sensors."""
    return {name: values for name, values in model.choice.items() if ALL[name].signature.acts_on == "sensor"}


def of_noise(model: Model) -> Choice:
    """Return the mechanisms of a model that change the noise of its residuals: on sensors, and on the wheelsets' inertia."""
    heavier = {name: values for name, values in model.choice.items() if "inertia" in ALL[name].acts}
    return {**on_sensors(model), **heavier}


def readings_of(model: Model) -> Choice:
    """Return the mechanisms of a model that change what is read when; wrong scales of wheel sensors (a radius) are excluded."""
    return {name: values for name, values in on_sensors(model).items() if not _OF_SCALE & ALL[name].acts.keys()}


def misread_wheels(model: Model, axles: int) -> np.ndarray:
    """Return the axles (A,) bool whose wheel-speed sensors a model says to misread by a share that changes."""
    values = model.choice.get(misread_wheel.CARD.name)
    return np.array([values is not None and concerns(values["axles"], k) for k in range(axles)])


def correct_readings(campaign: Campaign, stops: Sequence[PreparedStop], readings: Choice) -> list[PreparedStop]:
    """Return stops with the true vehicle speed, and with all channels except the wheel speeds as late as these."""
    evaluator = Evaluator(campaign, stops)
    lag = read_late(evaluator.vehicle, readings)
    found = evaluator.forces(_model(stops, readings))
    return [_as_late(_with_speed(stop, one), lag) for stop, one in zip(stops, found, strict=True)]


def simulate_readings(campaign: Campaign, stops: Sequence[PreparedStop], readings: Choice) -> list[PreparedStop]:
    """Return stops as sensors read them: a model with these sensors evaluates them as a model without does the true ones."""
    read = list(stops)
    for _ in range(_ITERATIONS):
        evaluator = Evaluator(campaign, read)
        found = zip(read, evaluator.forces(_model(stops, readings)), stops, strict=True)
        read = [_corrected(one, _true_values(one, evaluation, evaluator.vehicle), stop) for one, evaluation, stop in found]
    return read


def _model(stops: Sequence[PreparedStop], readings: Choice) -> Model:
    """Return a model with readings only; its friction is not used."""
    return Model(0.0, (1.0,) * len(stops), readings)


def _with_speed(stop: PreparedStop, one: Evaluation) -> PreparedStop:
    return dataclasses.replace(stop, speed=one.speed, recorded_speed=one.recorded_speed)


def _as_late(stop: PreparedStop, lag_s: float) -> PreparedStop:
    """Return a stop with all channels except the wheel speeds filtered by a lag."""
    if lag_s == 0.0:
        return stop

    def late(values: np.ndarray) -> np.ndarray:
        return _filtered(values, lag_s, stop.step_s)

    return dataclasses.replace(
        stop, speed=late(stop.speed), recorded_speed=late(stop.recorded_speed), torque=late(stop.torque),
        pressed=None if stop.pressed is None else late(stop.pressed),
    )  # fmt: skip


def _filtered(values: np.ndarray, lag_s: float, step_s: float) -> np.ndarray:
    """Filter values (T, ...) by lag dy/dt + y = x, exactly for lines between samples; the first line is extended backwards."""
    kept, steps = np.exp(-step_s / lag_s), lag_s / step_s
    numerator = [1.0 - steps * (1.0 - kept), steps * (1.0 - kept) - kept]
    behind = lag_s / step_s * (values[1:2] - values[:1])  # a line is delayed by the lag
    start = values[:1] - behind
    result: np.ndarray = lfilter(numerator, [1.0, -kept], values, axis=0, zi=start - numerator[0] * values[:1])[0]
    return result


def _true_values(read: PreparedStop, one: Evaluation, vehicle: Vehicle) -> PreparedStop:
    """Return a stop with the true values that a model derives from the readings."""
    wheel = (one.speed[:, None] - one.slip) / vehicle.wheel_radius_m
    rate = (one.force * vehicle.wheel_radius_m - one.torque) / vehicle.wheelset_inertia_kgm2
    return dataclasses.replace(_with_speed(read, one), wheel=wheel, wheel_rate=rate)


def _corrected(read: PreparedStop, found: PreparedStop, true: PreparedStop) -> PreparedStop:
    """Return a corrected reading: subtract the error that remains after the model's correction."""

    def less(name: str) -> np.ndarray:
        result: np.ndarray = getattr(read, name) - (getattr(found, name) - getattr(true, name))
        return result

    return dataclasses.replace(
        read, speed=less("speed"), recorded_speed=less("recorded_speed"), wheel=less("wheel"), wheel_rate=less("wheel_rate")
    )
