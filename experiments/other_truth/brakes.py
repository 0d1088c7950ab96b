"""Wheel slide protections of three kinds, brake cylinders of three characters, and the torque on a wheelset.

Forms and figures: assumptions, within what brakes and protections of coaches do.
"""

import math

from experiments.other_truth.compiled import kernel, part
from experiments.other_truth.records import Brake, Places, Protection, Sizes, State, Vehicle

PROTECTIONS = ("pressure_step", "deceleration", "creep_band")
PRESSURE_STEP, DECELERATION, CREEP_BAND = range(3)
CHARACTERS = ("exponential", "orifice", "rate")
EXPONENTIAL, ORIFICE, RATE = range(3)


@part
def decide(v_ref: float, radius: float, wsp: Protection, state: State) -> float:
    """Let the protection decide for all axles; return its reference speed [m/s].

    - pressure steps: `vent` and `apply` are the largest steps of the share of the distributor pressure, by the slip foreseen
    - deceleration: vents at a deceleration of the wheel beyond `vent` [m/s2], applies again as it speeds up, see `apply` [m/s2]
    - creep band: pulses in proportion to the deviation, `vent` [1], to which `apply` [1] adds the wheel's deceleration
    """
    fastest = 0.0
    for j in range(state.wheel.shape[0]):
        fastest = max(fastest, state.wheel[j] * radius)
    v_ref = max(fastest, v_ref - wsp.slowing_mps2 * wsp.period_s)
    limit = wsp.slip_mps + wsp.slip_per_speed * v_ref
    for j in range(state.wheel.shape[0]):
        slip = v_ref - state.wheel[j] * radius
        gained = (state.wheel[j] - state.before[j]) * radius / wsp.period_s
        state.before[j] = state.wheel[j]
        if wsp.kind == PRESSURE_STEP:
            ahead = slip - 0.25 * gained
            if ahead > 1.1 * limit:
                state.share[j] = max(0.0, state.share[j] - wsp.vent * min(2.0, ahead / limit - 0.5))
            elif ahead < 0.9 * limit:
                state.share[j] = min(1.0, state.share[j] + wsp.apply * min(1.5, 1.5 - ahead / limit))
        elif wsp.kind == DECELERATION:
            if (gained < -wsp.vent and slip > 0.45 * limit) or (slip > 1.4 * limit and gained < wsp.apply):
                state.valve[j], state.slid[j] = -1.0, 1.0
            elif slip < 0.5 * limit or gained > 1.5 * wsp.apply:
                state.valve[j] = 1.0
            else:
                state.valve[j] = 0.0
        else:
            off = (slip - limit) / limit - wsp.apply * gained / 9.81
            state.pulse[j] = min(1.0, wsp.vent * max(0.0, abs(off) - 0.12)) * wsp.period_s
            state.valve[j] = -1.0 if off > 0.0 else 1.0
    return v_ref


@kernel
def flow(character: int, rate: float, delta: float) -> float:
    """Return the change of a cylinder's pressure [bar/s] that lacks `delta` [bar].

    The rate is of an exponential [1/s], an orifice (square root, [bar^1/2 / s]), or a constant rate [bar/s].
    """
    if character == EXPONENTIAL:
        return rate * delta
    if character == ORIFICE:
        return rate * math.copysign(math.sqrt(abs(delta)), delta) * min(1.0, abs(delta) / 0.05)
    return math.copysign(min(rate, abs(delta) / 0.06), delta)


@part
def cylinder(
    j: int,
    h: float,
    decided_s: float,
    braking: bool,
    distributor: float,
    brake: Brake,
    wsp: Protection,
    scatter: float,
    state: State,
) -> bool:
    """Advance the cylinder pressure of axle j by h [s]; return whether it is being filled.

    `decided_s` [s] ago the protection decided, the distributor offers `distributor` [bar], `scatter` is of the axle's valves.
    """
    valve = state.valve[j]
    if wsp.kind == CREEP_BAND and decided_s > state.pulse[j]:
        valve = 0.0
    target = distributor * (state.share[j] if wsp.kind == PRESSURE_STEP else (1.0 if valve > 0.0 else 0.0))
    delta = target - state.pressure[j]
    if delta > 0.0 or wsp.kind == PRESSURE_STEP or valve < 0.0 or not braking:
        rate = (brake.fill if delta > 0.0 else brake.vent) * (1.0 + scatter)
        if wsp.kind != PRESSURE_STEP and valve == 0.0:
            rate = 0.0
        elif wsp.kind == DECELERATION and state.slid[j] > 0.0:  # throttled once the wheel has slid
            rate *= 0.35 if delta > 0.0 else 0.6
        state.pressure[j] = max(0.0, state.pressure[j] + h * flow(brake.character, rate, delta))
    return delta > 0.05 * distributor and valve > 0.0


@part
def torque_on(
    j: int,
    h: float,
    t: float,
    braked_s: float,
    filling: bool,
    pad: float,
    vehicle: Vehicle,
    sizes: Sizes,
    places: Places,
    state: State,
) -> float:
    """Return the torque on wheelset j [N m]; `braked_s` [s] since the brake was applied, `pad` is the sound variation."""
    pressure = state.pressure[j]
    state.inside[j] = max(min(state.inside[j], pressure + sizes.sticking_rigging), pressure - sizes.sticking_rigging)
    inside = max(0.0, state.inside[j])
    if sizes.leaking_valve != 0.0 and j == places.leaking_axle:
        lost = 0.0 if filling else sizes.leaking_valve * math.sqrt(pressure)
        state.leaked[j] += h * (lost - state.leaked[j]) / (0.4 if lost == 0.0 else 1.5)
        inside = max(0.0, inside - state.leaked[j])
    speed = state.wheel[j] * vehicle.radius_m
    torque = vehicle.torque_per_bar_nm * inside * (1.0 + pad)
    torque *= 1.0 + sizes.pad_friction * (speed - 15.0) * 1.25 / (1.0 + speed / 60.0)
    torque *= 1.0 - sizes.wet_pads * math.exp(-state.pad_work[j] / places.drying_j)
    if j == places.gain_axle:
        torque *= 1.0 + sizes.brake_gain_imbalance
    state.pad_work[j] += h * torque * state.wheel[j]
    if braked_s > 0.0 and j == places.dragging_axle:
        torque += sizes.dragging_brake * (1.0 - math.exp(-braked_s / 1.5))
    if j == places.parking_axle:
        torque += sizes.parking_brake_remnant * math.exp(-t / places.release_s)
    if sizes.coupled_axles != 0.0 and j < 2:
        twist = state.wheel[j] - state.wheel[1 - j] + (0.015 if j == 0 else -0.015) * state.wheel[0]
        torque += sizes.coupled_axles * twist
    return torque
