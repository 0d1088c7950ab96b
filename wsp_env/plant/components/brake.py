"""Pneumatic brake: distributor of the vehicle, and on each axle a dump valve with dead time, a cylinder and discs.

Reservoirs feed the distributor's cylinders, if they have a volume: what a dump valve lets out must be let in again, and a
vehicle that has emptied them has no more brake.

This is where a command becomes a cylinder pressure and a torque. A valve applies (+1: the cylinder fills towards the
distributor's pressure), holds (0) or vents (-1); with pressure control a command is the wanted share of the demanded pressure.
"""

import math
from typing import NamedTuple

import numpy as np

from wsp_env.compiled import inlined, kernel
from wsp_env.parameters.vehicle import ATMOSPHERE_BAR, Brake
from wsp_env.plant.command import APPLIES, VENTS


class BrakeConstants(NamedTuple):
    """The brake as compiled code takes it."""

    full_pressure: float  # [bar]
    torque_per_bar: float  # per axle [N m/bar]
    demand_rise: float  # rate of the distributor [bar/s]
    fill_time: float  # time constant [s]
    vent_time: float  # time constant [s]
    substep: float  # that the plant integrates by [s]
    fill_kept: float  # share of the difference that is left after it while filling [-]
    vent_kept: float  # the same while venting [-]
    air_per_bar: float  # air let in per rise of the cylinder pressure [Nl/bar]
    reservoir_full: float  # pressure of the reservoirs at the start of a stop, and that they are filled to [bar]
    reservoir_per_nl: float  # fall of their pressure by a normal litre taken [bar/Nl]; 0: they never end
    reservoir_supply: float  # what refills them [Nl/s]
    dead_steps: int  # whole control intervals of the valves' dead time
    dead_rest: float  # what is left of it [s]
    pressure_control: bool  # commands are shares of the demanded pressure, 0 to 1, instead of valve commands


class BrakeState(NamedTuple):
    """The brakes of N vehicles with A axles."""

    distributor: np.ndarray  # (N,) pressure that the distributor gives [bar]
    pressure: np.ndarray  # (N, A) in the cylinders [bar]
    commands: np.ndarray  # (N, K, A) commands on their way to the valves, newest first
    air: np.ndarray  # (N, A) let into the cylinders [Nl]
    reservoir: np.ndarray  # (N,) pressure of the reservoirs [bar]


def constants(
    brake: Brake, axles: int, control_interval_s: float, substep_s: float, pressure_control: bool
) -> BrakeConstants:  # fmt: skip
    """Return a brake as compiled code takes it, in a plant that integrates by `substep_s` [s]."""
    volume = brake.reservoir_volume_l * axles
    dead_steps = math.floor(brake.dead_time_s / control_interval_s + 1e-9)
    return BrakeConstants(
        full_pressure=brake.full_pressure_bar,
        torque_per_bar=brake.torque_per_bar_nm,
        demand_rise=brake.full_pressure_bar / brake.demand_rise_s,
        fill_time=brake.fill_time_constant_s,
        vent_time=brake.vent_time_constant_s,
        substep=substep_s,
        fill_kept=math.exp(-substep_s / brake.fill_time_constant_s),
        vent_kept=math.exp(-substep_s / brake.vent_time_constant_s),
        air_per_bar=brake.cylinder_volume_l / ATMOSPHERE_BAR,
        reservoir_full=brake.reservoir_pressure_bar,
        reservoir_per_nl=ATMOSPHERE_BAR / volume if volume > 0.0 else 0.0,
        reservoir_supply=brake.reservoir_supply_nlps,
        dead_steps=dead_steps,
        dead_rest=max(brake.dead_time_s - dead_steps * control_interval_s, 0.0),
        pressure_control=pressure_control,
    )


def allocate(n: int, axles: int, b: BrakeConstants) -> BrakeState:
    """Return the brakes of n vehicles, cylinders empty, valves applying."""
    return BrakeState(
        np.zeros(n), np.zeros((n, axles)), np.ones((n, b.dead_steps + 2, axles)), np.zeros((n, axles)),
        np.full(n, b.reservoir_full),
    )  # fmt: skip


def release(i: int, state: BrakeState, b: BrakeConstants) -> None:
    """Put the brake of vehicle i as it is before a stop: released, valves open to the distributor."""
    for array in state:
        array[i] = 0.0
    state.commands[i] = APPLIES
    state.reservoir[i] = b.reservoir_full


@inlined
def receive(i: int, command: np.ndarray, state: BrakeState) -> None:
    """Send the commands (N, A) of vehicle i on their way to the valves."""
    for k in range(command.shape[1]):
        for age in range(state.commands.shape[1] - 1, 0, -1):
            state.commands[i, age, k] = state.commands[i, age - 1, k]
        state.commands[i, 0, k] = command[i, k]


@inlined
def distribute(i: int, demand: float, h: float, state: BrakeState, b: BrakeConstants) -> float:
    """Let the distributor follow the demand, 0 to 1, for h [s], and refill the reservoirs; return its mean pressure [bar]."""
    if b.reservoir_per_nl > 0.0:
        refilled = state.reservoir[i] + h * b.reservoir_supply * b.reservoir_per_nl
        state.reservoir[i] = max(min(refilled, b.reservoir_full), state.reservoir[i])
    aim, before = demand * b.full_pressure, state.distributor[i]
    rise = b.demand_rise * h
    after = min(max(aim, before - rise), before + rise)
    state.distributor[i] = after
    return 0.5 * (after + before)


@inlined
def _flow(
    h: float, pressure: float, command: float, distributor: float, demanded: float, b: BrakeConstants
) -> tuple[float, float]:
    """Return the pressure after h [s] under one command, and its integral [bar s]; first order towards where air flows."""
    if h <= 0.0:
        return pressure, 0.0
    if b.pressure_control:
        target = min(command * demanded, distributor)
    elif command > 0.5 * APPLIES:
        target = distributor
    elif command < 0.5 * VENTS:
        target = 0.0
    else:
        return pressure, pressure * h
    fills = target > pressure
    constant = b.fill_time if fills else b.vent_time
    # Over a whole substep it is known: an exponential less, of some seven that an axle takes.
    decay = (b.fill_kept if fills else b.vent_kept) if h == b.substep else math.exp(-h / constant)
    after = target + (pressure - target) * decay
    return after, target * h + (pressure - target) * constant * (1.0 - decay)


@inlined
def fill(
    i: int, k: int, elapsed: float, h: float, distributor: float, demand: float, state: BrakeState, b: BrakeConstants
) -> float:  # fmt: skip
    """Let the valve of axle k act for the substep of h [s] that starts `elapsed` [s] into the control interval.

    A command acts after the dead time, also in the middle of a substep; `distributor` is its mean pressure [bar].
    Returns the mean cylinder pressure [bar].
    """
    demanded = demand * b.full_pressure
    early = min(max(b.dead_rest - elapsed, 0.0), h)
    start = state.pressure[i, k]
    if b.reservoir_per_nl > 0.0:  # air does not flow back: a cylinder keeps what it has
        distributor = min(distributor, max(state.reservoir[i], start))
    middle, area = _flow(early, start, state.commands[i, b.dead_steps + 1, k], distributor, demanded, b)
    after, rest = _flow(h - early, middle, state.commands[i, b.dead_steps, k], distributor, demanded, b)
    taken = b.air_per_bar * max(after - start, 0.0)
    state.air[i, k] += taken
    state.reservoir[i] -= b.reservoir_per_nl * taken
    state.pressure[i, k] = after
    return (area + rest) / h


@inlined
def torque(pressure: float, factor: float, b: BrakeConstants) -> float:
    """Torque of one axle [N m] at a cylinder pressure [bar], with the factor of the mechanisms on the brake [-]."""
    return b.torque_per_bar * factor * pressure


@kernel
def look_ahead(
    pressure: np.ndarray, then: float, h: float, demand: np.ndarray, state: BrakeState, b: BrakeConstants
) -> None:  # fmt: skip
    """Let the commands on their way act on `pressure` (N, A) [bar], one after the other for h [s] each, and then `then`.

    The distributor keeps its pressure; nan in place of a last command: none.
    """
    n, axles = pressure.shape
    for i in range(n):
        distributor, demanded = state.distributor[i], demand[i] * b.full_pressure
        for k in range(axles):
            value = pressure[i, k]
            for age in range(b.dead_steps - 1, -1, -1):
                value, _ = _flow(h, value, state.commands[i, age, k], distributor, demanded, b)
            if not math.isnan(then):
                value, _ = _flow(h, value, then, distributor, demanded, b)
            pressure[i, k] = value
