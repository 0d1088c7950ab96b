"""Physics beyond the seed paper's model, one small file each.

A mechanism names its parameters (unit, bounds, null value, source), acts in one slot of the plant and says what it would
leave in which residual of a recording. At its null value it vanishes exactly. To add one: write its file, then name it in
`Mechanisms` and `ALL` below and call it in its slot, in `wsp_env/plant/slots.py` (or in `constants` and `Plant.start` where it
changes what is constant in a stop).
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from wsp_env.parameters.quantity import ParameterError, check
from wsp_env.plant.mechanisms import (
    adhesion_patch,
    aerodynamic_drag,
    brake_gain_imbalance,
    clock_offset,
    contaminant_memory,
    falling_friction,
    flash_temperature,
    initial_slope,
    leading_axle_cleaning,
    load_transfer,
    non_adhesive_brake,
    pad_friction,
    recovery_shape,
    speed_dependent_friction,
    track_gradient,
    vehicle_mass,
    wheel_radius,
    wheel_speed_lag,
)
from wsp_env.plant.mechanisms.mechanism import Mechanism, Parameter

__all__ = ["ALL", "NULL", "Mechanism", "Mechanisms", "Parameter", "check_axles", "make"]


class Mechanisms(NamedTuple):
    """The parameters of all mechanisms, as the compiled step takes them."""

    leading_axle_cleaning: leading_axle_cleaning.Parameters
    contaminant_memory: contaminant_memory.Parameters
    adhesion_patch: adhesion_patch.Parameters
    speed_dependent_friction: speed_dependent_friction.Parameters
    recovery_shape: recovery_shape.Parameters
    flash_temperature: flash_temperature.Parameters
    load_transfer: load_transfer.Parameters
    pad_friction: pad_friction.Parameters
    brake_gain_imbalance: brake_gain_imbalance.Parameters
    track_gradient: track_gradient.Parameters
    aerodynamic_drag: aerodynamic_drag.Parameters
    vehicle_mass: vehicle_mass.Parameters
    non_adhesive_brake: non_adhesive_brake.Parameters
    initial_slope: initial_slope.Parameters
    falling_friction: falling_friction.Parameters
    wheel_radius: wheel_radius.Parameters
    wheel_speed_lag: wheel_speed_lag.Parameters
    clock_offset: clock_offset.Parameters


ALL: dict[str, Mechanism] = {
    module.MECHANISM.name: module.MECHANISM
    for module in (
        leading_axle_cleaning,
        contaminant_memory,
        adhesion_patch,
        speed_dependent_friction,
        recovery_shape,
        flash_temperature,
        load_transfer,
        pad_friction,
        brake_gain_imbalance,
        track_gradient,
        aerodynamic_drag,
        vehicle_mass,
        non_adhesive_brake,
        initial_slope,
        falling_friction,
        wheel_radius,
        wheel_speed_lag,
        clock_offset,
    )
}


def make(choice: Mapping[str, Mapping[str, float]] | None = None) -> Mechanisms:
    """Return the parameter record with the mechanisms of `choice` switched on and all others at their null value.

    `choice` maps a mechanism to its parameters; those left out take their typical value, so `{"load_transfer": {}}` switches
    it on as in the literature. `ParameterError` names an unknown mechanism or parameter and lists the valid ones.
    """
    choice = dict(choice or {})
    unknown = sorted(set(choice) - set(ALL))
    if unknown:
        raise ParameterError(f"unknown mechanism {', '.join(unknown)}; valid: {', '.join(ALL)}")
    records: dict[str, Any] = {name: _record(ALL[name], given) for name, given in choice.items()}
    return NULL._replace(**records)


def _record(mechanism: Mechanism, given: Mapping[str, float]) -> tuple[float, ...]:
    names = [parameter.name for parameter in mechanism.parameters]
    if not isinstance(given, Mapping):
        raise ParameterError(f"mechanism {mechanism.name} = {given!r} must be a dictionary of any of {', '.join(names)}")
    wrong = sorted(set(given) - set(names))
    if wrong:
        raise ParameterError(f"mechanism {mechanism.name} has no parameter {', '.join(wrong)}; valid: {', '.join(names)}")
    values = []
    for parameter in mechanism.parameters:
        value = given.get(parameter.name, parameter.typical)
        metadata = {"low": parameter.low, "high": parameter.high, "unit": parameter.unit, "open_low": False}
        check(f"mechanism {mechanism.name}: {parameter.name}", value, metadata)
        if parameter.kind == "axle" and value != math.floor(value):
            raise ParameterError(f"mechanism {mechanism.name}: {parameter.name} = {value:g} must be a whole number, from 1")
        values.append(float(value))
    record: tuple[float, ...] = mechanism.record(*values)
    return record


def check_axles(mechanisms: Mechanisms, axles: int) -> None:
    """Raise `ParameterError` for a mechanism that is on and concerns an axle which the vehicle does not have."""
    for mechanism, record, null in zip(ALL.values(), mechanisms, NULL, strict=True):
        for parameter, value in zip(mechanism.parameters, record, strict=True):
            if parameter.kind == "axle" and record != null and value > axles:
                raise ParameterError(f"mechanism {mechanism.name}: axle = {value:g}, but the vehicle has {axles}")


#: All mechanisms off.
NULL = Mechanisms(*(mechanism.record(*(parameter.null for parameter in mechanism.parameters)) for mechanism in ALL.values()))
