"""What a substep does to the axles of any plant with these arrays: brake, discs, memory of the mechanisms, sensors."""

from typing import Any, NamedTuple

import numpy as np

from wsp_env.compiled import inlined, loop
from wsp_env.parameters.resistance import running_resistance
from wsp_env.plant.card import Passage
from wsp_env.plant.components import brake, tachometer
from wsp_env.plant.longitudinal.doing import doing
from wsp_env.plant.longitudinal.state import PlantConstants, State
from wsp_env.plant.mechanisms import Active
from wsp_env.plant.port import Conditions
from wsp_env.plant.slots import after_passage, before_contact, recorded_speed, torque, torque_acts, torque_factor

# Rows of the scratch array `work` (ROWS, A) that holds one substep of one vehicle.
SLIP, FORCE, FORCE_BY_SLIP, FORCE_BY_SPEED, LOAD, MU_CD, MU_CR, LAYER, HELD, TAU, TORQUE, LOCKED, ROWS = range(13)


class Stepping(NamedTuple):
    """What the functions of a step work on."""

    state: State
    c: Conditions
    p: PlantConstants
    law: Any  # the traction law of the vehicle at hand, with the mechanisms that change it
    active: Active  # its mechanisms
    work: np.ndarray  # (ROWS, A) scratch
    inertia: np.ndarray  # (N, A) of the wheelsets [kg m2]


@inlined
def believed_resistance(i: int, speed: float, c: Conditions, p: PlantConstants) -> float:
    """Return running resistance and gradient [N]."""
    return running_resistance(speed, p.resistance) + c.mass[i] * p.gravity * c.gradient[i]


@loop
def notice(i: int, on_step: Stepping) -> None:
    """Let mechanisms take notice of every axle at the start of a substep."""
    state, c, p, _, active, _, _ = on_step
    since = p.substep if state.time[i] > 0.0 else 0.0
    for k in range(state.wheel_speed.shape[1]):
        pressure = state.brake.pressure[i, k]
        now = doing(i, k, 0.0, since, pressure, state.deceleration[i], state, c, p)
        before_contact(active, i, k, now)


@loop
def _changed_torque(
    i: int, k: int, pressure: float, factor: float, deceleration: float, on_step: Stepping
) -> float:  # fmt: skip
    """Let the mechanisms on the torque act on axle k; return it at the start of the substep, where `pressure` [bar] was.

    What they add changes linearly over the substep: its mean is that of start and end.
    """
    state, c, p, _, active, work, _ = on_step
    after = state.brake.pressure[i, k]
    before, end = brake.torque(pressure, factor, p.brake), brake.torque(after, factor, p.brake)
    now = doing(i, k, 0.0, 0.0, pressure, deceleration, state, c, p)
    then = doing(i, k, p.substep, p.substep, after, deceleration, state, c, p)
    start = torque(i, k, before, now, active)
    added = torque(i, k, end, then, active) - end
    work[TORQUE, k] = max(work[TORQUE, k] + 0.5 * (start - before + added), 0.0)
    return start


@inlined
def brake_axle(i: int, k: int, elapsed: float, distributor: float, deceleration: float, on_step: Stepping) -> float:
    """Let valve, cylinder and discs of axle k act for a substep; note the mean torque in `work`, return that at its start."""
    state, c, p, _, active, work, _ = on_step
    start = state.brake.pressure[i, k]
    mean = brake.fill(i, k, elapsed, p.substep, distributor, c.demand[i], state.brake, p.brake)
    factor = torque_factor(active, i, k, c.radius[i, k] * state.wheel_speed[i, k], start)
    work[TORQUE, k] = brake.torque(mean, factor, p.brake)
    if torque_acts(active):
        return _changed_torque(i, k, start, factor, deceleration, on_step)
    return brake.torque(start, factor, p.brake)


@inlined
def turn_axle(
    i: int, k: int, h: float, wheel: float, braking: float, spent: float, travelled: float, on_step: Stepping
) -> None:  # fmt: skip
    """Let axle k end a substep of h [s] with the speed `wheel` [rad/s], after the vehicle `travelled` so far [m].

    `braking` is its mean brake torque [N m], `spent` the heat in its two contacts [J].
    """
    state, c, p, _, active, _, _ = on_step
    before = state.wheel_speed[i, k]
    turned = 0.5 * h * (before + wheel)
    turning = on_step.inertia[i, k] * (wheel - before) / h
    state.contact_work[i, k] += spent
    state.brake_work[i] += braking * turned
    place = state.position[i] - p.axle_offset[k]
    passage = Passage(
        place, place + travelled, 0.5 * spent, braking * turned, h,
        brake.torque(state.brake.pressure[i, k], 1.0, p.brake), brake.torque(p.brake.full_pressure, 1.0, p.brake),
        (travelled - c.radius[i, k] * turned) / h, (braking + turning) / c.radius[i, k], turning,
    )  # fmt: skip
    after_passage(active, i, k, passage)
    state.wheel_speed[i, k] = wheel
    state.wheel_rate[i, k] = (wheel - before) / p.substep
    state.tachometer.angle[i, k] += turned


@inlined
def read_sensors(i: int, state: State, c: Conditions, p: PlantConstants, active: Active) -> None:
    """Read the sensors of vehicle i at the end of a control interval."""
    state.recorded_speed[i] = recorded_speed(active, state.speed[i], -state.deceleration[i], state.time[i])
    axles = state.wheel_speed.shape[1]
    now, interval = state.time[i], p.substep * p.substeps
    step = round(now / interval)
    for k in range(axles):
        noise = c.noise[i] * tachometer.normal(c.key[i], step * axles + k) if c.noise[i] > 0.0 else 0.0
        wheel, radius = state.wheel_speed[i, k], c.radius[i, k]
        tachometer.read(i, k, wheel, radius, now, interval, noise, state.tachometer, p.tachometer, active)
        state.slip_speed[i, k] = state.speed[i] - radius * wheel
