"""One control interval of a braked vehicle: the compiled step of the plant.

Equations, per wheelset k with both wheels alike (signs positive in braking; seed paper eqs. 1, 2 and 11):

    J dw_k/dt = r_k T_k - C_k,   T_k = 2 N_k f(s_k, v),   s_k = v - r_k w_k
    M dv/dt   = -sum T_k - R(v) - M g i

The wheel equation is stiff at low speed (time constant about 2e-4 s per m/s) and set-valued when the wheel locks. Each
substep integrates it for the slip by the exponential Rosenbrock-Euler method, of second order, with the law's exact
derivatives: ds/dt = G + L (s - s_0) + H t gives s_1 = s_0 + h phi_1(h L) G + h^2 phi_2(h L) H (Hochbruck, Ostermann, Acta
Numerica 19 (2010), section 2.4). A step that would cross s = 0 is taken anew from there, so that a wheel regaining grip
lands in the steep part of the curve instead of jumping across it. The mean contact force of the substep follows from the
wheel's own momentum and is what the vehicle feels: momentum is exact, and the works below balance to rounding until the
vehicle stands.
"""

from typing import Any

import numpy as np

from wsp_env.compiled import inlined, loop
from wsp_env.contact.traction import Surface
from wsp_env.plant.components import brake, rail
from wsp_env.plant.longitudinal.axles import (
    FORCE,
    FORCE_BY_SLIP,
    FORCE_BY_SPEED,
    HELD,
    LAYER,
    LOAD,
    LOCKED,
    MU_CD,
    MU_CR,
    ROWS,
    SLIP,
    TAU,
    TORQUE,
    Stepping,
    believed_resistance,
    brake_axle,
    notice,
    turn_axle,
)
from wsp_env.plant.longitudinal.doing import moment
from wsp_env.plant.longitudinal.exponential import slip_after, slip_drift, slip_growth
from wsp_env.plant.longitudinal.interval import advance_by
from wsp_env.plant.slots import (
    after_contact,
    before_contact_acts,
    contact,
    recovery,
    resistance,
    surface,
    wheel_load,
)

__all__ = ["ROWS", "advance"]


@inlined
def _start(i: int, on_step: Stepping) -> float:
    """Evaluate the contacts at the start of a substep into `work`; return the vehicle's deceleration [m/s2]."""
    state, c, p, law, active, work, _ = on_step
    speed = state.speed[i]
    mass = c.mass[i]
    now = moment(i, 0.0, state.deceleration[i], state, p)
    total = resistance(i, speed, believed_resistance(i, speed, c, p), now, active)
    static = mass * p.gravity / (2.0 * len(p.axle_offset))
    rolled = speed * p.substep
    for k in range(state.wheel_speed.shape[1]):
        place = state.position[i] - p.axle_offset[k]
        load = wheel_load(i, k, mass, state.deceleration[i], static, active)
        mu_cd, layer = rail.look(i, place, c, p.rail)
        on = surface(i, k, place, rolled, mu_cd, layer, law.mu_cr, active)
        slip = speed - c.radius[i, k] * state.wheel_speed[i, k]
        tau = recovery(active, i, k, c.tau[i])
        adhesion = contact(slip, speed, load, on, tau, law, active)
        after_contact(active, i, k, rolled, adhesion.kept)
        sign = 1.0 if slip >= 0.0 else -1.0
        state.adhesion[i, k] = sign * adhesion.f
        state.adhesion_d[i, k] = sign * adhesion.f_d
        state.adhesion_r[i, k] = sign * adhesion.f_r
        work[SLIP, k] = slip
        work[FORCE, k] = 2.0 * load * sign * adhesion.f  # T [N]
        work[FORCE_BY_SLIP, k] = 2.0 * load * adhesion.df_ds  # [N s/m]
        work[FORCE_BY_SPEED, k] = 2.0 * load * sign * adhesion.df_dv  # [N s/m]
        work[LOAD, k] = load
        work[MU_CD, k] = on.mu_cd
        work[MU_CR, k] = on.mu_cr
        work[TAU, k] = tau
        work[LAYER, k] = on.layer
        work[HELD, k] = on.held
        total += work[FORCE, k]
    return total / mass


@inlined
def _slip(i: int, k: int, start_torque: float, deceleration: float, jerk: float, on_step: Stepping) -> float:
    """Slip speed [m/s] of a turning wheelset after the substep."""
    state, c, p, law, active, work, inertias = on_step
    h, inertia = p.substep, inertias[i, k]
    radius = c.radius[i, k]
    slip = work[SLIP, k]
    torque_rate = 2.0 * (work[TORQUE, k] - start_torque) / h  # a linear torque with the same mean
    growth = slip_growth(work[FORCE, k], start_torque, deceleration, radius, inertia)
    drift = slip_drift(work[FORCE_BY_SPEED, k], torque_rate, deceleration, jerk, radius, inertia)
    after = slip_after(h, slip, growth, -radius * radius * work[FORCE_BY_SLIP, k] / inertia, drift)
    if slip * after >= 0.0:
        return after
    used = h * slip / (slip - after)
    speed = state.speed[i] - deceleration * used
    on = Surface(work[MU_CD, k], work[MU_CR, k], work[LAYER, k], work[HELD, k])
    rolling = contact(0.0, speed, work[LOAD, k], on, work[TAU, k], law, active)
    slope = 2.0 * work[LOAD, k] * rolling.df_ds
    torque = start_torque + torque_rate * used
    growth = slip_growth(0.0, torque, deceleration, radius, inertia)
    drift = slip_drift(0.0, torque_rate, deceleration, jerk, radius, inertia)
    return slip_after(h - used, 0.0, growth, -radius * radius * slope / inertia, drift)


@inlined
def _solve_speed(i: int, resisted: float, on_step: Stepping) -> float:
    """Vehicle speed [m/s] after the substep: its momentum balance, linear in the speed once the slips are known.

    A turning wheelset gives T = (J dw / h + C) / r with w = (v - s) / r at the end, a locked one its contact force.
    """
    state, c, p, _, _, work, inertias = on_step
    h = p.substep
    momentum = c.mass[i] * state.speed[i] - h * resisted
    mass = c.mass[i]
    for k in range(state.wheel_speed.shape[1]):
        if work[LOCKED, k] > 0.0:
            momentum -= h * work[FORCE, k]
        else:
            radius, inertia = c.radius[i, k], inertias[i, k]
            momentum += (inertia * (work[SLIP, k] / radius + state.wheel_speed[i, k]) - h * work[TORQUE, k]) / radius
            mass += inertia / (radius * radius)
    return momentum / mass


@inlined
def _brake(i: int, elapsed: float, deceleration: float, jerk: float, on_step: Stepping) -> None:
    """Let valves, cylinders and discs act on every wheelset for a substep; note torques and new slips in `work`."""
    state, c, p, _, _, work, _ = on_step
    h = p.substep
    distributor = brake.distribute(i, c.demand[i], h, state.brake, p.brake)
    for k in range(state.wheel_speed.shape[1]):
        start = brake_axle(i, k, elapsed, distributor, deceleration, on_step)
        # A locked wheel stays so while the contact cannot turn it; its torque is a reaction.
        work[LOCKED, k] = 1.0 if state.wheel_speed[i, k] == 0.0 and c.radius[i, k] * work[FORCE, k] <= start else 0.0
        if work[LOCKED, k] > 0.0:
            # The mean over the substep; next to standstill, where the force falls to nothing with the speed, half of it.
            work[FORCE, k] = max(
                work[FORCE, k] - 0.5 * h * deceleration * (work[FORCE_BY_SLIP, k] + work[FORCE_BY_SPEED, k]),
                0.5 * work[FORCE, k],
            )
        else:
            work[SLIP, k] = _slip(i, k, start, deceleration, jerk, on_step)


@inlined
def _move(i: int, h: float, after: float, on_step: Stepping) -> None:
    """Move vehicle and wheelsets to the end of a substep of h [s], at which the vehicle runs with `after` [m/s]."""
    state, c, p, _, _, work, inertia = on_step
    travelled = 0.5 * h * (state.speed[i] + after)
    for k in range(state.wheel_speed.shape[1]):
        before = state.wheel_speed[i, k]
        radius = c.radius[i, k]
        wheel, force, braking = 0.0, work[FORCE, k], work[TORQUE, k]
        if work[LOCKED, k] > 0.0:
            braking = radius * force + inertia[i, k] * before / p.substep
        else:
            wheel = max(after - work[SLIP, k], 0.0) / radius
            force = (inertia[i, k] * (wheel - before) / h + braking) / radius
        turned = 0.5 * h * (before + wheel)
        turn_axle(i, k, h, wheel, braking, force * (travelled - radius * turned), travelled, on_step)
    state.speed[i] = after
    state.position[i] += travelled


@inlined
def _substep(i: int, j: int, on_step: Stepping, more: tuple[()]) -> bool:
    """Advance vehicle i by substep j of the control interval; True when it has stopped."""
    state, c, p, _, active, work, _ = on_step
    h = p.substep
    axles = state.wheel_speed.shape[1]
    speed = state.speed[i]
    last = state.deceleration[i]
    if before_contact_acts(active):
        notice(i, on_step)
    deceleration = _start(i, on_step)
    jerk = (deceleration - last) / h if state.time[i] > 0.0 else 0.0
    middle = speed - 0.5 * h * deceleration
    halfway = moment(i, 0.5 * h, deceleration, state, p)
    resisted = resistance(i, middle, believed_resistance(i, middle, c, p), halfway, active)
    _brake(i, j * h, deceleration, jerk, on_step)
    after = _solve_speed(i, resisted, on_step)
    locks = False
    for k in range(axles):
        if (
            work[LOCKED, k] == 0.0 and after <= work[SLIP, k]
        ):  # locks within the substep: the brake takes up what the contact gives
            work[LOCKED, k] = 1.0
            locks = True
    if locks:
        after = _solve_speed(i, resisted, on_step)
    stopped = after <= 0.0
    if stopped:  # within the substep, wheels and vehicle together
        h *= speed / (speed - after)
        after = 0.0
    state.resistance_work[i] += resisted * (0.5 * h * (speed + after))
    _move(i, h, after, on_step)
    state.deceleration[i] = deceleration
    state.time[i] += h
    return stopped


@loop
def advance(command: np.ndarray, believed: Any, given: Any, moving: np.ndarray, work: np.ndarray) -> None:
    """Advance every vehicle that moves by one control interval, see `advance_by`."""
    advance_by(_substep, command, believed, given, moving, work, ())
