"""The compiled plant: N stops at once, one compiled call for each decision.

Longitudinal: m dv/dt = -sum 2 N f - drag - m g i, J domega/dt = 2 N f r - C for each wheelset. Integrated by ROS2 (Verwer,
Spee, Blom, Hundsdorfer 1999: two stages, order 2, L-stable) with the Jacobian of contact and drag; the cylinders, which do not
depend on the speeds, go ahead by Heun's method.
"""

import math

import numpy as np

from experiments.other_plant.contact import adhesion
from experiments.other_plant.pneumatics import ATMOSPHERE_BAR, distributor, pad_friction, pressing, pressure_rate
from experiments.other_plant.records import Body, Curve, State, Stops, compiled, inner

END_MPS = 0.3  # a stop ends below [m/s]
END_S = 200.0  # and after this time [s]
APPLIED_BAR = 0.1  # pressure with which the brake counts as applied [bar] (assumption)
WATCHED_MPS = 5.0 / 3.6  # the slip is watched above [m/s]
LOCK_MPS = 15.0 / 3.6  # a standing wheel counts as locked above [m/s]
STANDING_MPS = 0.5  # a wheel whose rim is slower stands [m/s]
_GAMMA = 1.0 - 1.0 / math.sqrt(2.0)  # of ROS2
_PITCH_S = 0.25  # time constant of the load transfer [s] (assumption: bogie pitch)
_TIMER_S = 1e-5  # resolution of the pulse counter's clock [s] (assumption)


@inner
def _brakes(n: int, t: float, h: float, interval: float, body: Body, stops: Stops, state: State, torque: np.ndarray) -> None:
    """Advance valves and cylinders of one stop; `torque` (2, A) gets C [N m] before and after, without the pads' slope."""
    supply0 = body.full_bar * distributor(t, stops.rise_s[n], stops.inshot[n], stops.curvature[n])
    supply1 = body.full_bar * distributor(t + h, stops.rise_s[n], stops.inshot[n], stops.curvature[n])
    fill, vent, hysteresis = stops.fill_ps[n], stops.vent_ps[n], stops.hysteresis[n]
    decision = math.floor((t - stops.dead_s[n] + 0.5 * stops.stroke_s[n]) / interval + 1e-9)
    for i in range(torque.shape[1]):
        aim = state.command[n, i, decision % state.command.shape[2]] if decision >= 0 else 1.0  # at rest it is open
        spool0 = state.spool[n, i]
        spool1 = spool0 + min(max(aim - spool0, -h / stops.stroke_s[n]), h / stops.stroke_s[n])
        p = state.pressure_bar[n, i]
        rate0 = pressure_rate(p, supply0, spool0, fill, vent)
        rate1 = pressure_rate(max(p + h * rate0, 0.0), supply1, spool1, fill, vent)
        state.air_nl[n] -= 0.5 * h * (min(rate0, 0.0) + min(rate1, 0.0)) * body.volume_l / ATMOSPHERE_BAR
        state.spool[n, i] = spool1
        state.pressure_bar[n, i] = max(p + 0.5 * h * (rate0 + rate1), 0.0)
        torque[0, i] = stops.torque_pbar[n, i] * state.pressing_bar[n, i]
        state.pressing_bar[n, i] = pressing(state.pressing_bar[n, i], state.pressure_bar[n, i], hysteresis)
        torque[1, i] = stops.torque_pbar[n, i] * state.pressing_bar[n, i]
        if state.pressure_bar[n, i] > APPLIED_BAR:
            state.braking[n] = True


@inner
def _rates(
    n: int, v: float, omega: np.ndarray, given: np.ndarray, locked: np.ndarray, first: bool, body: Body, stops: Stops,
    found: np.ndarray, powers: np.ndarray
) -> tuple[float, float]:  # fmt: skip
    """Fill the rates of the wheels, and return dv/dt [m/s2] and its derivative by v [1/s].

    `given` (3, A) brake torque [N m], friction of the film [-], load of a wheel [N]; `locked` (A,) is set in the `first` stage
    where a wheel stands and stays so; `found` (4, A) the rates [rad/s2], and of the Jacobian d rates / d omega, d rates / dv,
    d(dv/dt) / d omega; `powers` (3,) of contacts, brakes and resistance [W].
    """
    mass, inertia = stops.mass_kg[n], body.inertia_kgm2
    force = stops.drag_ns2pm2[n] * v * v + mass * body.gravity_mps2 * stops.gradient[n]
    by_v = 2.0 * stops.drag_ns2pm2[n] * v
    powers[0], powers[1], powers[2] = 0.0, 0.0, force * v
    for i in range(omega.size):
        r, turns = stops.radius_m[n, i], max(omega[i], 0.0)
        load = given[2, i]
        film = Curve(given[1, i], stops.film[n, 1], stops.film[n, 2], stops.film[n, 3], stops.film[n, 4])
        slip = v - r * turns
        f, f_slip, f_v = adhesion(slip, v, load, body.stiffness_n, film, body.clean, stops.tau_mpj[n])
        both = 2.0 * load
        brake = given[0, i] * pad_friction(r * turns, stops.pad_slope[n])
        balance = both * f * r - brake
        if first:
            locked[i] = omega[i] <= 0.0 and balance <= 0.0
        force += both * f
        by_v += both * (f_slip + f_v)
        powers[0] += both * f * slip
        if locked[i]:
            found[:, i] = 0.0
        else:
            powers[1] += brake * turns
            found[0, i] = balance / inertia
            found[1, i] = -both * f_slip * r * r / inertia
            found[2, i] = both * (f_slip + f_v) * r / inertia
            found[3, i] = both * f_slip * r / mass
    return -force / mass, -by_v / mass


@inner
def _solve(g: float, by_v: float, jacobian: np.ndarray, wheels: np.ndarray, speed: float) -> float:
    """Solve (I - g J) k = (wheels, speed) with an arrow-shaped J; `wheels` (A,) becomes its part of k, the speed's returns."""
    right, diagonal = speed, 1.0 - g * by_v
    for i in range(wheels.size):
        own = 1.0 - g * jacobian[0, i]
        right += g * jacobian[2, i] * wheels[i] / own
        diagonal -= g * g * jacobian[2, i] * jacobian[1, i] / own
    found = right / diagonal
    for i in range(wheels.size):
        wheels[i] = (wheels[i] + g * jacobian[1, i] * found) / (1.0 - g * jacobian[0, i])
    return found


@inner
def _sense(n: int, i: int, t: float, h: float, turned: float, stops: Stops, state: State) -> None:
    """Count the pulses while a wheel turns by `turned` [rad]; the time of the last edge is interpolated."""
    pitch = 2.0 * math.pi / stops.pulses[n]
    before = state.angle_rad[n, i]
    state.angle_rad[n, i] = before + turned
    edges = math.floor(state.angle_rad[n, i] / pitch)
    if edges > state.edges[n, i]:
        state.edges[n, i] = edges
        state.edge_s[n, i] = round((t + h * (edges * pitch - before) / turned) / _TIMER_S) * _TIMER_S


@inner
def _watch(n: int, h: float, v: float, stops: Stops, state: State) -> None:
    """Account for slip and standing wheels over a substep."""
    if state.braking[n] and v > WATCHED_MPS:
        state.watched_s[n] += h
        for i in range(state.omega_radps.shape[1]):
            slip = v - stops.radius_m[n, i] * state.omega_radps[n, i]
            state.slip_m[n, i] += h * slip
            state.slip_squared[n, i] += h * slip * slip
    for i in range(state.omega_radps.shape[1]):
        stands = v > LOCK_MPS and stops.radius_m[n, i] * state.omega_radps[n, i] < STANDING_MPS
        state.standing_s[n, i] = state.standing_s[n, i] + h if stands else 0.0
        state.locked_s[n] = max(state.locked_s[n], state.standing_s[n, i])


@inner
def _substep(n: int, h: float, interval: float, body: Body, stops: Stops, state: State, table: np.ndarray) -> None:
    """Advance one stop by `h` [s]; `table` (14, A) is room for work."""
    t, v, axles = state.time_s[n], state.speed_mps[n], state.omega_radps.shape[1]
    given, torque, moved, found, later = table[0:3], table[3:5], table[5], table[6:10], table[10:14]
    one, jacobian, two = found[0], found[1:4], later[0]
    locked, powers = np.empty(axles, np.bool_), np.empty(3)
    _brakes(n, t, h, interval, body, stops, state, torque)
    for i in range(axles):
        place = state.position_m[n] + 0.5 * h * v - body.positions_m[i]
        texture = 1.0
        for j in range(stops.ripple.shape[1]):
            texture += stops.ripple[n, j, 0] * math.sin(stops.ripple[n, j, 1] * place + stops.ripple[n, j, 2])
        given[1, i] = stops.film[n, 0] * texture
        given[2, i] = stops.load_n[n, i] * (1.0 + stops.transfer_s2pm[n, i] * state.pitch_mps2[n])
    given[0] = torque[0]
    omega = state.omega_radps[n]
    g = _GAMMA * h
    k1, by_v = _rates(n, v, omega, given, locked, True, body, stops, found, powers)
    state.contact_j[n] += h * powers[0]
    state.brake_j[n] += h * powers[1]
    state.resistance_j[n] += h * powers[2]
    k1 = _solve(g, by_v, jacobian, one, k1)
    for i in range(axles):
        moved[i] = omega[i] + h * one[i]
    given[0] = torque[1]
    k2, _ = _rates(n, v + h * k1, moved, given, locked, False, body, stops, later, powers)
    for i in range(axles):
        two[i] -= 2.0 * one[i]
    k2 = _solve(g, by_v, jacobian, two, k2 - 2.0 * k1)
    after = v + h * (1.5 * k1 + 0.5 * k2)
    for i in range(axles):
        before = omega[i]
        omega[i] = max(before + h * (1.5 * one[i] + 0.5 * two[i]), 0.0)
        _sense(n, i, t, h, 0.5 * h * (before + omega[i]), stops, state)
    state.pitch_mps2[n] += h / _PITCH_S * ((v - after) / h - state.pitch_mps2[n])
    state.speed_mps[n] = after
    state.position_m[n] += 0.5 * h * (v + after)
    state.time_s[n] = t + h
    _watch(n, h, after, stops, state)
    state.ended[n] = after < END_MPS or state.time_s[n] > END_S - 0.5 * h


@compiled
def advance(command: np.ndarray, tick: int, interval: float, substeps: int, body: Body, stops: Stops, state: State) -> None:
    """Advance all stops that have not ended by one decision.

    Parameters
    ----------
    command
        (N, A) of the dump valves: below -0.5 vents, above 0.5 applies, else holds
    tick
        number of the decision, from 0
    interval
        between decisions [s]
    substeps
        of the integration in one interval
    body, stops, state
        parameters, and what is changed

    """
    table = np.empty((14, command.shape[1]))
    for n in range(command.shape[0]):
        if state.ended[n]:
            continue
        for i in range(command.shape[1]):
            given = command[n, i]
            code = -1.0 if given < -0.5 else (1.0 if given > 0.5 else 0.0)
            state.command[n, i, tick % state.command.shape[2]] = code
        for _ in range(substeps):
            _substep(n, interval / substeps, interval, body, stops, state, table)
            if state.ended[n]:
                break
