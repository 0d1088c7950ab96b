"""One control interval of a braked vehicle: the compiled step of the plant.

Equations, per wheelset k with both wheels alike (signs positive in braking; seed paper eqs. 1, 2 and 11):

    J dw_k/dt = r_k T_k - C_k,   T_k = 2 N_k f(s_k, v),   s_k = v - r_k w_k
    M dv/dt   = -sum T_k - R(v) - M g i

The wheel equation is stiff at low speed (time constant about 2e-4 s per m/s) and set-valued when the wheel locks. Each
substep integrates it for the slip by the exponential Rosenbrock-Euler method, of second order, with the law's exact
derivatives: ds/dt = G + L (s - s_0) + H t gives s_1 = s_0 + h phi_1(h L) G + h^2 phi_2(h L) H (Hochbruck, Ostermann, Acta
Numerica 19 (2010), section 2.4). A step that would cross s = 0 is taken anew from there, so that a wheel regaining grip
lands in the steep part of the curve instead of jumping across it. The mean contact force of the substep follows from the
wheel's own momentum and is what the vehicle feels: momentum is exact, and the works below balance to rounding.
"""

import math

import numpy as np

from wsp_env.compiled import inlined, kernel
from wsp_env.contact.degraded import adhesion
from wsp_env.plant.brake import mean_pressure
from wsp_env.plant.mechanisms import leading_axle_cleaning, load_transfer
from wsp_env.plant.sensors import read_tachometers
from wsp_env.plant.state import Conditions, Constants, State


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
    """Evaluate the contacts at the start of a substep into `work` (9, A); return the vehicle's deceleration [m/s2]."""
    speed = state.speed[i]
    mass = c.mass[i]
    axles = state.wheel_speed.shape[1]
    static = mass * p.gravity / (2.0 * axles)
    total = resistance(speed, mass, c.gradient[i], p)
    for k in range(axles):
        place = state.position[i] - p.axle_offset[k]
        load = load_transfer.wheel_load(
            p.mechanisms.load_transfer, static, mass, state.deceleration[i], p.body_arm[k], p.pivot_arm[k]
        )
        mu_cd = min(c.mu_cd[i] * along_track(i, place, c.profile, p.track_step), p.law.mu_cr)
        film = along_track(i, place, c.coverage, p.track_step)
        film *= leading_axle_cleaning.film_left(p.mechanisms.leading_axle_cleaning, i, place, state.rail_energy)
        slip = speed - c.radius[i, k] * state.wheel_speed[i, k]
        law = adhesion(slip, speed, load, mu_cd, c.tau[i], film, p.law)
        sign = 1.0 if slip >= 0.0 else -1.0
        state.adhesion[i, k] = sign * law.f
        state.adhesion_d[i, k] = sign * law.f_d
        state.adhesion_r[i, k] = sign * law.f_r
        work[0, k] = slip
        work[1, k] = 2.0 * load * sign * law.f  # T [N]
        work[2, k] = 2.0 * load * law.df_ds  # dT/ds [N s/m]
        work[3, k] = 2.0 * load * sign * law.df_dv  # dT/dv [N s/m]
        work[4, k] = load
        work[5, k] = mu_cd
        work[6, k] = film
        total += work[1, k]
    return total / mass


@inlined
def resistance(speed: float, mass: float, gradient: float, p: Constants) -> float:
    """Return running resistance and gradient force [N] against the motion."""
    return p.resistance_a + speed * (p.resistance_b + speed * p.resistance_c) + mass * p.gravity * gradient


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
    slip = work[0, k]
    torque_rate = 2.0 * (work[7, k] - start_torque) / h  # a linear torque with the same mean
    after = _slip_after(
        h, slip, work[1, k], work[2, k], work[3, k], start_torque, torque_rate, deceleration, jerk, radius, p.inertia
    )
    if slip * after >= 0.0:
        return after
    used = h * slip / (slip - after)
    speed = state.speed[i] - deceleration * used
    rolling = adhesion(0.0, speed, work[4, k], work[5, k], c.tau[i], work[6, k], p.law)
    slope = 2.0 * work[4, k] * rolling.df_ds
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
        if work[8, k] > 0.0:
            momentum -= h * work[1, k]
        else:
            radius = c.radius[i, k]
            momentum += (inertia * (work[0, k] / radius + state.wheel_speed[i, k]) - h * work[7, k]) / radius
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
    resisted = resistance(speed - 0.5 * h * deceleration, mass, c.gradient[i], p)
    for k in range(axles):
        start = state.pressure[i, k]
        pressure, mean = mean_pressure(i, k, elapsed, offered, c.demand[i], state, p)
        state.air[i, k] += p.air_per_bar * max(pressure - start, 0.0)
        state.pressure[i, k] = pressure
        start *= p.torque_per_bar
        work[7, k] = p.torque_per_bar * mean
        # A locked wheel stays so while the contact cannot turn it; its torque is a reaction.
        work[8, k] = 1.0 if state.wheel_speed[i, k] == 0.0 and c.radius[i, k] * work[1, k] <= start else 0.0
        if work[8, k] > 0.0:
            # The mean over the substep; next to standstill, where the force falls to nothing with the speed, half of it.
            work[1, k] = max(work[1, k] - 0.5 * h * deceleration * (work[2, k] + work[3, k]), 0.5 * work[1, k])
        else:
            work[0, k] = _slip(i, k, start, deceleration, jerk, state, c, p, work)
    after = _solve_speed(i, resisted, state, c, p, work)
    locks = False
    for k in range(axles):
        if work[8, k] == 0.0 and after <= work[0, k]:  # locks within the substep: the brake takes up what the contact gives
            work[8, k] = 1.0
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
        wheel, force, torque = 0.0, work[1, k], work[7, k]
        if work[8, k] > 0.0:
            torque = radius * force + p.inertia * before / p.substep
        else:
            wheel = max(after - work[0, k], 0.0) / radius
            force = (p.inertia * (wheel - before) / h + torque) / radius
        turned = 0.5 * h * (before + wheel)
        spent = force * (travelled - radius * turned)
        state.contact_work[i, k] += spent
        state.brake_work[i] += torque * turned
        leading_axle_cleaning.remember(
            p.mechanisms.leading_axle_cleaning, k, rolled - p.axle_offset[k], rolled + travelled - p.axle_offset[k],
            0.5 * spent, i, state.rail_energy, state.rail_pending,
        )  # fmt: skip
        state.wheel_speed[i, k] = wheel
        state.angle[i, k] += turned
    state.resistance_work[i] += resisted * travelled
    state.speed[i] = after
    state.position[i] = rolled + travelled
    state.deceleration[i] = deceleration
    state.time[i] += h
    return stopped


@kernel
def advance(command: np.ndarray, state: State, c: Conditions, p: Constants, moving: np.ndarray) -> None:
    """Advance every vehicle that moves by one control interval.

    Parameters
    ----------
    command : (N, A) vent -1, hold 0, apply +1; or with `pressure_control` the pressure, 0 to 1 of the demand
    state : changed in place
    c, p : conditions of the stops and constants
    moving : (N,) bool, changed in place: False once a vehicle stands; such a vehicle is left as it is

    """
    n, axles = command.shape
    work = np.empty((9, axles))
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
