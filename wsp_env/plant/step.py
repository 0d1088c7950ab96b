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

import math

import numpy as np

from wsp_env.compiled import inlined, loop
from wsp_env.plant.brake import mean_pressure
from wsp_env.plant.mechanisms import leading_axle_cleaning, non_adhesive_brake, pad_friction
from wsp_env.plant.sensors import read_tachometers
from wsp_env.plant.slots import Rail, contact, rail, resistance, torque_factor, wheel_load
from wsp_env.plant.state import Conditions, Constants, State

# Rows of the scratch array `work` (ROWS, A) that holds one substep of one vehicle.
SLIP, FORCE, FORCE_BY_SLIP, FORCE_BY_SPEED, LOAD, MU_CD, FILM, HELD, TORQUE, LOCKED, ROWS = range(11)


@inlined
def _phi(z: float) -> tuple[float, float]:
    """phi_1(z) = (e^z - 1) / z and phi_2(z) = (phi_1(z) - 1) / z, by series where they would cancel."""
    if abs(z) < 1e-3:
        return 1.0 + z * (0.5 + z / 6.0), 0.5 + z * (1.0 / 6.0 + z / 24.0)
    phi_1 = (math.exp(z) - 1.0) / z
    return phi_1, (phi_1 - 1.0) / z


@inlined
def along_track(i: int, place: float, table: np.ndarray, step: float) -> float:
    """Value of stop i at a place [m], linear between the nodes of `table` (N, M), which lie `step` [m] apart."""
    x = min(max(place / step, 0.0), table.shape[1] - 1.0)
    node = min(int(x), max(table.shape[1] - 2, 0))
    following = min(node + 1, table.shape[1] - 1)
    return table[i, node] + (x - node) * (table[i, following] - table[i, node])


@inlined
def _start(i: int, state: State, c: Conditions, p: Constants, work: np.ndarray) -> float:
    """Evaluate the contacts at the start of a substep into `work`; return the vehicle's deceleration [m/s2]."""
    speed = state.speed[i]
    mass = c.mass[i]
    total = resistance(speed, mass, c.gradient[i], state.applied[i], p)
    for k in range(state.wheel_speed.shape[1]):
        place = state.position[i] - p.axle_offset[k]
        load = wheel_load(k, mass, state.deceleration[i], p)
        film = along_track(i, place, c.coverage, p.track_step)
        film *= leading_axle_cleaning.film_left(p.mechanisms.leading_axle_cleaning, i, place, state.rail_energy)
        mu_cd = c.mu_cd[i] * along_track(i, place, c.profile, p.track_step)
        on, past = rail(place, mu_cd, film, state.recovery[i, k], speed * p.substep, p)
        slip = speed - c.radius[i, k] * state.wheel_speed[i, k]
        law = contact(slip, speed, load, on, c.tau[i], p)
        state.recovery[i, k] = past * state.recovery[i, k] + (1.0 - past) * (1.0 - law.kept)
        sign = 1.0 if slip >= 0.0 else -1.0
        state.adhesion[i, k] = sign * law.f
        state.adhesion_d[i, k] = sign * law.f_d
        state.adhesion_r[i, k] = sign * law.f_r
        work[SLIP, k] = slip
        work[FORCE, k] = 2.0 * load * sign * law.f  # T [N]
        work[FORCE_BY_SLIP, k] = 2.0 * load * law.df_ds  # [N s/m]
        work[FORCE_BY_SPEED, k] = 2.0 * load * sign * law.df_dv  # [N s/m]
        work[LOAD, k] = load
        work[MU_CD, k] = on.mu_cd
        work[FILM, k] = on.film
        work[HELD, k] = on.held
        total += work[FORCE, k]
    return total / mass


@inlined
def _slip_after(
    h: float, slip: float, force: float, slope_s: float, slope_v: float, torque: float, torque_rate: float,
    deceleration: float, jerk: float, radius: float, inertia: float,
) -> float:  # fmt: skip
    """Slip speed [m/s] after h [s] of the exponential Rosenbrock-Euler step; forces per wheelset, see the module."""
    growth = -deceleration - radius * (radius * force - torque) / inertia
    rate = -radius * radius * slope_s / inertia
    drift = -jerk + radius * (radius * slope_v * deceleration + torque_rate) / inertia
    phi_1, phi_2 = _phi(h * rate)
    return slip + h * (phi_1 * growth + h * phi_2 * drift)


@inlined
def _slip(
    i: int, k: int, start_torque: float, deceleration: float, jerk: float,
    state: State, c: Conditions, p: Constants, work: np.ndarray,
) -> float:  # fmt: skip
    """Slip speed [m/s] of a turning wheelset after the substep."""
    h = p.substep
    radius = c.radius[i, k]
    slip = work[SLIP, k]
    torque_rate = 2.0 * (work[TORQUE, k] - start_torque) / h  # a linear torque with the same mean
    after = _slip_after(
        h,
        slip,
        work[FORCE, k],
        work[FORCE_BY_SLIP, k],
        work[FORCE_BY_SPEED, k],
        start_torque,
        torque_rate,
        deceleration,
        jerk,
        radius,
        p.inertia,
    )
    if slip * after >= 0.0:
        return after
    used = h * slip / (slip - after)
    speed = state.speed[i] - deceleration * used
    on = Rail(work[MU_CD, k], work[FILM, k], work[HELD, k])
    rolling = contact(0.0, speed, work[LOAD, k], on, c.tau[i], p)
    slope = 2.0 * work[LOAD, k] * rolling.df_ds
    torque = start_torque + torque_rate * used
    return _slip_after(h - used, 0.0, 0.0, slope, 0.0, torque, torque_rate, deceleration, jerk, radius, p.inertia)


@inlined
def _solve_speed(i: int, resisted: float, state: State, c: Conditions, p: Constants, work: np.ndarray) -> float:
    """Vehicle speed [m/s] after the substep: its momentum balance, linear in the speed once the slips are known.

    A turning wheelset gives T = (J dw / h + C) / r with w = (v - s) / r at the end, a locked one its contact force.
    """
    h, inertia = p.substep, p.inertia
    momentum = c.mass[i] * state.speed[i] - h * resisted
    mass = c.mass[i]
    for k in range(state.wheel_speed.shape[1]):
        if work[LOCKED, k] > 0.0:
            momentum -= h * work[FORCE, k]
        else:
            radius = c.radius[i, k]
            momentum += (inertia * (work[SLIP, k] / radius + state.wheel_speed[i, k]) - h * work[TORQUE, k]) / radius
            mass += inertia / (radius * radius)
    return momentum / mass


@inlined
def _substep(i: int, elapsed: float, state: State, c: Conditions, p: Constants, work: np.ndarray) -> bool:
    """Advance vehicle i by one substep that starts `elapsed` [s] into the control interval; True when it has stopped."""
    h = p.substep
    axles = state.wheel_speed.shape[1]
    speed, mass = state.speed[i], c.mass[i]
    last = state.deceleration[i]
    deceleration = _start(i, state, c, p, work)
    jerk = (deceleration - last) / h if state.time[i] > 0.0 else 0.0
    aim = c.demand[i] * p.full_pressure
    rise = p.demand_rise * h
    supply = min(max(aim, state.supply[i] - rise), state.supply[i] + rise)
    offered = 0.5 * (supply + state.supply[i])
    state.supply[i] = supply
    resisted = resistance(speed - 0.5 * h * deceleration, mass, c.gradient[i], state.applied[i], p)
    for k in range(axles):
        start = state.pressure[i, k]
        pressure, mean = mean_pressure(i, k, elapsed, offered, c.demand[i], state, p)
        state.air[i, k] += p.air_per_bar * max(pressure - start, 0.0)
        state.pressure[i, k] = pressure
        wheel_mps = c.radius[i, k] * state.wheel_speed[i, k]
        per_bar = p.torque_per_bar * torque_factor(k, wheel_mps, start, state.discs[i, k], p)
        start *= per_bar
        work[TORQUE, k] = per_bar * mean
        # A locked wheel stays so while the contact cannot turn it; its torque is a reaction.
        work[LOCKED, k] = 1.0 if state.wheel_speed[i, k] == 0.0 and c.radius[i, k] * work[FORCE, k] <= start else 0.0
        if work[LOCKED, k] > 0.0:
            # The mean over the substep; next to standstill, where the force falls to nothing with the speed, half of it.
            work[FORCE, k] = max(
                work[FORCE, k] - 0.5 * h * deceleration * (work[FORCE_BY_SLIP, k] + work[FORCE_BY_SPEED, k]),
                0.5 * work[FORCE, k],
            )
        else:
            work[SLIP, k] = _slip(i, k, start, deceleration, jerk, state, c, p, work)
    after = _solve_speed(i, resisted, state, c, p, work)
    locks = False
    for k in range(axles):
        if (
            work[LOCKED, k] == 0.0 and after <= work[SLIP, k]
        ):  # locks within the substep: the brake takes up what the contact gives
            work[LOCKED, k] = 1.0
            locks = True
    if locks:
        after = _solve_speed(i, resisted, state, c, p, work)
    stopped = after <= 0.0
    if stopped:  # within the substep, wheels and vehicle together
        h *= speed / (speed - after)
        after = 0.0
    travelled = 0.5 * h * (speed + after)
    rolled = state.position[i]
    for k in range(axles):
        before = state.wheel_speed[i, k]
        radius = c.radius[i, k]
        wheel, force, torque = 0.0, work[FORCE, k], work[TORQUE, k]
        if work[LOCKED, k] > 0.0:
            torque = radius * force + p.inertia * before / p.substep
        else:
            wheel = max(after - work[SLIP, k], 0.0) / radius
            force = (p.inertia * (wheel - before) / h + torque) / radius
        turned = 0.5 * h * (before + wheel)
        spent = force * (travelled - radius * turned)
        state.contact_work[i, k] += spent
        state.brake_work[i] += torque * turned
        m, place = p.mechanisms, rolled - p.axle_offset[k]
        leading_axle_cleaning.remember(
            m.leading_axle_cleaning, k, place, place + travelled, 0.5 * spent, i, state.rail_energy, state.rail_pending
        )
        state.discs[i, k] = pad_friction.warmer(m.pad_friction, state.discs[i, k], torque * turned, h)
        state.applied[i] = non_adhesive_brake.applied(
            m.non_adhesive_brake,
            state.applied[i],
            p.torque_per_bar * state.pressure[i, k],
            p.torque_per_bar * p.full_pressure,
        )
        state.wheel_speed[i, k] = wheel
        state.angle[i, k] += turned
    state.resistance_work[i] += resisted * travelled
    state.speed[i] = after
    state.position[i] = rolled + travelled
    state.deceleration[i] = deceleration
    state.time[i] += h
    return stopped


@loop
def advance(command: np.ndarray, state: State, c: Conditions, p: Constants, moving: np.ndarray, work: np.ndarray) -> None:
    """Advance every vehicle that moves by one control interval.

    Parameters
    ----------
    command : (N, A) vent -1, hold 0, apply +1; or with `pressure_control` the pressure, 0 to 1 of the demand
    state : changed in place
    c, p : conditions of the stops and constants
    moving : (N,) bool, changed in place: False once a vehicle stands; such a vehicle is left as it is
    work : (ROWS, A) scratch

    """
    n, axles = command.shape
    for i in range(n):
        if not moving[i]:
            continue
        for k in range(axles):
            for age in range(state.commands.shape[1] - 1, 0, -1):
                state.commands[i, age, k] = state.commands[i, age - 1, k]
            state.commands[i, 0, k] = command[i, k]
        for j in range(p.substeps):
            if _substep(i, j * p.substep, state, c, p, work):
                moving[i] = False
                break
        read_tachometers(i, state, c, p)
