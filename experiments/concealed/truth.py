"""One stop of the truth model, compiled; all kernels in this one file, so that numba's cache follows its changes.

What the seed paper's law says (eqs. 1 to 7) is the same as anywhere; how it is solved is not. Wheel and contact are one
scalar equation: within a stage of the implicit Runge-Kutta method the wheel's balance makes the slip a linear function of
the adhesion coefficient, s(f) = b - k f, so that the implicit law f = (1 - lambda(N f e)) f_d + lambda f_r and the implicit
step share their root in f: secants, safeguarded by the Illinois method (Dowell, Jarratt, BIT 11 (1971)). The method is
Alexander's L-stable SDIRK of order two (SIAM J. Numer. Anal. 14 (1977), Theorem 5); vehicle, brake and slow states go by
fixed steps of 1 ms.

Signs are positive in braking, T is the force of a wheelset, f and N of one wheel.
"""

import math
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np

from experiments.concealed.records import Brake, Effects, History, Law, PlannedStop, State, Vehicle

Function = TypeVar("Function", bound=Callable[..., Any])

STEP_S = 1e-3  # [s], assumption: half of it changes no sample by its noise
GAMMA = 1.0 - 1.0 / math.sqrt(2.0)  # [-] Alexander's parameter
CONTROL_STEPS = 10  # steps between two decisions of the WSP (10 ms, assumption)
CELL_M = 0.5  # [m] of rail, shorter than any axle distance
BEHIND_M = 100.0  # [m] of rail behind the origin of the track
TOLERANCE = 1e-10  # [-] of the adhesion coefficient
LONGEST_S = 240.0  # [s] a stop that takes longer is cut


def kernel(function: Function) -> Function:
    """Compile (numba has no type stubs)."""
    compiled: Any = numba.njit(cache=True, error_model="numpy")(function)
    return cast(Function, compiled)


def part(function: Function) -> Function:
    """Compile into the caller: handing a record of arrays to a function of its own would count references, which is slow."""
    compiled: Any = numba.njit(inline="always", error_model="numpy")(function)
    return cast(Function, compiled)


@kernel
def limit(
    creepage: float, slip: float, load: float, stiffness: float, mu_c: float, ratio: float, gamma: float,
    k_a: float, k_s: float, drop: float,
) -> float:  # fmt: skip
    """Eqs. (5) to (7): adhesion coefficient without, or after full, recovery; `drop` bends the friction hyperbolically."""
    mu = mu_c * (1.0 + (1.0 / ratio - 1.0) * math.exp(-gamma * slip)) * (1.0 - drop * slip / (slip + 3.0))
    gradient = stiffness * creepage / (mu * load)
    reduced = k_a * gradient
    return 2.0 * mu / math.pi * (reduced / (1.0 + reduced * reduced) + math.atan(k_s * gradient))


@kernel
def recovered(energy: float, tau: float, threshold: float) -> float:
    """Eq. (4), the share of adhesion recovered; below the threshold [J/m] hardly anything (hyperbola)."""
    if threshold != 0.0:
        energy = math.sqrt(energy * energy + threshold * threshold) - threshold
    return 1.0 - math.exp(-tau * energy)


@kernel
def law_value(
    f: float,
    slip: float,
    speed: float,
    load: float,
    mu_cd: float,
    scale: float,
    share: float,
    stiffness: float,
    law: Law,
    x: Effects,
) -> float:
    """Right-hand side of the implicit law at a trial f, with its sign; share >= 0 replaces lambda (a film with a memory)."""
    s = abs(slip)
    rolling = max(speed, 0.05)
    trial = max(f if slip >= 0.0 else -f, 0.0)
    creepage = s / rolling
    energy = load * trial * creepage
    sliding = max(creepage - x.layer * trial, 0.0)
    f_d = limit(sliding, s, load, stiffness, mu_cd * scale, law.ratio_d, law.gamma_d, law.k_ad, law.k_sd, x.drop)
    f_r = limit(sliding, s, load, stiffness, law.mu_cr * scale, law.ratio_r, law.gamma_r, law.k_ar, law.k_sr, x.drop)
    part = share if share >= 0.0 else recovered(energy, law.tau, x.threshold)
    value = (1.0 - part) * f_d + part * f_r
    return value if slip >= 0.0 else -value


@kernel
def solve(
    b: float, slope: float, guess: float, steep: float, speed: float, load: float, mu_cd: float, scale: float, share: float,
    stiffness: float, law: Law, x: Effects,
) -> tuple[float, float]:  # fmt: skip
    """Root f of f = law(s = b - slope f, f): secants from a guess, and where these fail the Illinois method in a bracket.

    `steep` is a guess of the derivative of f - law by f; the one found is returned beside the root.
    """
    f, g = guess, guess - law_value(guess, b - slope * guess, speed, load, mu_cd, scale, share, stiffness, law, x)
    step = -g / steep
    for _ in range(6):
        if abs(step) < TOLERANCE:
            return f + step, steep
        trial = f + step
        g_trial = trial - law_value(trial, b - slope * trial, speed, load, mu_cd, scale, share, stiffness, law, x)
        if not abs(g_trial) < abs(g):
            break
        steep = (g_trial - g) / step
        step = -g_trial / steep
        f, g = trial, g_trial
    reach = 1e-3
    low, high = guess - reach, guess + reach
    g_low = low - law_value(low, b - slope * low, speed, load, mu_cd, scale, share, stiffness, law, x)
    g_high = high - law_value(high, b - slope * high, speed, load, mu_cd, scale, share, stiffness, law, x)
    while g_low > 0.0 and reach < 10.0:
        reach *= 4.0
        high, g_high, low = low, g_low, low - reach
        g_low = low - law_value(low, b - slope * low, speed, load, mu_cd, scale, share, stiffness, law, x)
    while g_high < 0.0 and reach < 10.0:
        reach *= 4.0
        low, g_low, high = high, g_high, high + reach
        g_high = high - law_value(high, b - slope * high, speed, load, mu_cd, scale, share, stiffness, law, x)
    side = 0
    for _ in range(60):
        f = (low * g_high - high * g_low) / (g_high - g_low)
        g = f - law_value(f, b - slope * f, speed, load, mu_cd, scale, share, stiffness, law, x)
        if abs(g) < TOLERANCE:
            break
        if g > 0.0:
            high, g_high = f, g
            g_low *= 0.5 if side == 1 else 1.0
            side = 1
        else:
            low, g_low = f, g
            g_high *= 0.5 if side == -1 else 1.0
            side = -1
    return f, 1.0


@kernel
def table_value(place: float, table: np.ndarray) -> float:
    """Linear between nodes 1 m apart, constant beyond the ends."""
    last = table.shape[0] - 1
    at = min(max(place, 0.0), last - 1e-9)
    node = int(at)
    return table[node] + (at - node) * (table[node + 1] - table[node])


@part
def decide(v_ref: float, radius: np.ndarray, state: State) -> float:
    """One decision of the WSP: vent -1, hold 0, apply 1 by slip and deceleration thresholds; returns its reference speed.

    The thresholds are assumptions, chosen so that stops slide some 5 to 30 % where the brake is stronger than the rail.
    """
    dt = CONTROL_STEPS * STEP_S
    fastest = 0.0
    for k in range(radius.shape[0]):
        fastest = max(fastest, radius[k] * state.wheel[k])
    v_ref = max(fastest, v_ref - 1.7 * dt)
    for k in range(radius.shape[0]):
        rate = radius[k] * (state.seen[k] - state.wheel[k]) / dt
        state.seen[k] = state.wheel[k]
        state.rate[k] += (rate - state.rate[k]) * dt / 0.05
        slip = v_ref - radius[k] * state.wheel[k]
        if v_ref < 2.0:
            state.command[k] = 1.0
        elif slip > 2.5 + 0.14 * v_ref:
            state.command[k] = -1.0 if state.rate[k] > -0.5 else 0.0
        elif slip > 1.0 + 0.05 * v_ref and state.rate[k] > 4.0:
            state.command[k] = -1.0
        elif state.rate[k] < -5.0:
            state.command[k] = 0.0
        else:
            state.command[k] = 1.0
    return v_ref


@kernel
def rail_friction(mu_cd: float, mu_cr: float, film: float, sand: float, gain: float) -> float:
    """Friction coefficient of rail with the share `film` of the contaminant left, and with sand on it."""
    return min((mu_cr - film * (mu_cr - mu_cd)) * (1.0 + gain * sand), mu_cr)


@kernel
def external(t: float, v: float, braking: float, run: PlannedStop, x: Effects) -> float:
    """Force against the motion beside wheels and gradient [N]."""
    force = x.drag_a + v * (x.drag_b + v * x.drag_c)
    if x.eddy != 0.0 and braking > 0.0:
        ratio = v / 20.0  # critical speed [m/s], assumption
        engaged = (1.0 - math.exp(-braking / 0.5)) / (1.0 + math.exp(-(v - 14.0) / 0.5))  # off below 50 km/h, as in service
        force += x.eddy * 2.0 * ratio / (1.0 + ratio * ratio) * engaged
    if x.slack != 0.0 and braking > 0.0:
        force += x.slack * math.sin(2.0 * math.pi * 0.6 * braking + run.phase) * (1.0 - math.exp(-braking))
    if x.gusts != 0.0:
        force += x.gusts * (v / 30.0) ** 2 * table_value(10.0 * t, run.gust)
    return force


@kernel
def rub(cell: int, energy_per_m: float, removal: float, film: np.ndarray) -> None:
    """Wear of the film on a cell of rail by what one wheel spent there: dh/dE = -removal h^(3/2), integrated."""
    film[cell] = (1.0 / math.sqrt(film[cell]) + 0.5 * removal * energy_per_m) ** -2


@part
def brake_step(k: int, target: float, command: float, pressure: np.ndarray, brake: Brake) -> float:
    """Nominal torque of axle k [N m] after one step of its dump valve and cylinder."""
    if command > 0.5:
        constant = brake.fill[k] if target > pressure[k] else brake.vent[k]
        pressure[k] = target + (pressure[k] - target) * math.exp(-STEP_S / constant)
    elif command < -0.5:
        pressure[k] *= math.exp(-STEP_S / brake.vent[k])
    return pressure[k]


@part
def braked(k: int, n: int, v: float, supply: float, brake: Brake, state: State, x: Effects) -> float:
    """Return the true torque of axle k [N m] after the step that starts at sample n."""
    command = state.waiting[max(n - brake.dead_steps[k], 0) % 64, k]
    true = brake.gain[k] * brake_step(k, supply, command, state.pressure, brake)
    true *= 1.0 + x.pad_speed * (math.exp(-v / 15.0) - math.exp(-25.0 / 15.0))
    true /= 1.0 + x.pad_heat * state.disc[k]
    return true + x.dragging if k == int(x.dragging_axle) else true


@part
def friction_scale(k: int, v: float, here: float, run: PlannedStop, state: State, x: Effects) -> float:
    """Factor on both friction coefficients."""
    scale = 1.0 / (1.0 + x.flash * state.flash[k])
    if x.running != 0.0:  # Kother: 0.116 + 9 / (42 + V), V in km/h; relative to 25 m/s
        scale *= ((0.116 + 9.0 / (42.0 + 3.6 * v)) / (0.116 + 9.0 / 132.0)) ** x.running
    if x.hunting != 0.0:  # wave of 14 m, assumption
        scale *= 1.0 - x.hunting * math.sin(math.pi * here / 14.0 + run.phase) ** 2
    return scale


@part
def turn(
    k: int, v: float, retarded: float, true: float, load: float, mu_cd: float, scale: float, share: float,
    vehicle: Vehicle, law: Law, state: State, x: Effects,
) -> tuple[float, float, bool]:  # fmt: skip
    """Wheel speed of axle k after a step [rad/s], mean force of the wheelset on the rail [N], whether it stays locked."""
    h, r, w, before = STEP_S, vehicle.radius[k], state.wheel[k], state.adhesion[k]
    stiffness = vehicle.stiffness[k]
    if w == 0.0:
        f, _ = solve(v, 0.0, before, 1.0, v, load, mu_cd, scale, share, stiffness, law, x)
        if 2.0 * r * load * f <= true:
            state.adhesion[k] = f
            return 0.0, 2.0 * load * f, True
    step = GAMMA * h * r / vehicle.inertia
    slope = 2.0 * r * load * step
    middle, end = v - GAMMA * h * retarded, v - h * retarded
    half = state.torque[k] + GAMMA * (true - state.torque[k])
    b = middle - r * w + step * half
    first, steep = solve(b, slope, before, state.steep[k], middle, load, mu_cd, scale, share, stiffness, law, x)
    reached = w + (1.0 - GAMMA) * h * (2.0 * r * load * first - half) / vehicle.inertia
    b = end - r * reached + step * true
    f, steep = solve(b, slope, first, steep, end, load, mu_cd, scale, share, stiffness, law, x)
    state.adhesion[k], state.steep[k] = f, steep
    after = reached + GAMMA * h * (2.0 * r * load * f - true) / vehicle.inertia
    return max(after, 0.0), 2.0 * load * ((1.0 - GAMMA) * first + GAMMA * f), False


@part
def remember(
    k: int, v: float, slide: float, force: float, load: float, here: float, cell: int, law: Law, state: State, x: Effects
) -> None:
    """Advance the slow states that axle k leaves behind: its film, its flash temperature, the rail's film."""
    h, f = STEP_S, abs(state.adhesion[k])
    if x.memory > 0.0:
        aim = recovered(load * f * abs(slide) / max(v, 0.05), law.tau, x.threshold)
        length = x.memory if aim > state.share[k] else 2.0 * x.memory
        state.share[k] += (aim - state.share[k]) * (1.0 - math.exp(-v * h / length))
    # Ertz, Knothe, Wear 253 (2002): flash temperature of a sliding Hertzian contact; half the heat goes to the wheel.
    flux = f * law.pressure_per_load * load * abs(slide)
    state.flash[k] = 0.5 * 1.253 * flux * math.sqrt(law.semi_axis / max(v, 0.5)) / 1.33e4  # W s^1/2 / (m2 K), steel
    if x.removal > 0.0:
        state.pending[k] += 0.5 * force * slide * h
        if int((here + v * h + BEHIND_M) / CELL_M) != cell:
            rub(cell, max(state.pending[k], 0.0) / CELL_M, x.removal, state.film)
            state.pending[k] = 0.0


@kernel
def fresh(run: PlannedStop, vehicle: Vehicle, cells: int, x: Effects) -> State:
    """State of a vehicle that rolls freely."""
    n = vehicle.radius.shape[0]
    w = run.speed / vehicle.radius
    torque = np.zeros(n)
    torque[int(x.dragging_axle)] = x.dragging
    return State(
        w, np.zeros(n), np.ones(n), torque, np.zeros(n), np.ones(n), w.copy(), np.zeros(n), np.ones((64, n)), np.zeros(n),
        np.zeros(n), np.zeros(n), np.zeros(n), np.ones(cells), np.zeros(cells), np.zeros(3),
    )  # fmt: skip


@kernel
def simulate(vehicle: Vehicle, law: Law, brake: Brake, run: PlannedStop, profile: np.ndarray, x: Effects) -> History:
    """Brake from the run's speed to its end speed; `profile` is the factor on mu_cd every metre of track."""
    axles, most, h = vehicle.radius.shape[0], int(LONGEST_S / STEP_S), STEP_S
    speeds, positions = np.empty(most), np.empty(most)
    wheels, torques, nominals = np.empty((most, axles)), np.empty((most, axles)), np.empty((most, axles))
    adhesions, loads = np.empty((most, axles)), np.empty((most, axles))
    cells = int((profile.shape[0] + 2.0 * BEHIND_M) / CELL_M)
    state = fresh(run, vehicle, cells, x)
    static = vehicle.mass * vehicle.gravity / (2.0 * axles)
    climb = vehicle.mass * vehicle.gravity * run.slope / math.sqrt(1.0 + run.slope * run.slope)
    v, place, v_ref, supply, retarded, pitched, sanding = run.speed, run.position, run.speed, 0.0, 0.0, 0.0, 0.0
    n = 0
    while n < most:
        speeds[n], positions[n] = v, place
        wheels[n], torques[n], nominals[n], adhesions[n] = state.wheel, state.torque, state.pressure, state.adhesion
        braking = n * h - run.coast
        if braking > 0.0:
            supply += (run.demand - supply) * (1.0 - math.exp(-h / brake.rise))
        if n % CONTROL_STEPS == 0 and brake.wsp > 0.0:
            v_ref = decide(v_ref, vehicle.radius, state)
        pitched += (retarded - pitched) * h / 0.2  # [s] the suspension follows the deceleration, assumption
        resisted = climb + external(n * h, v, braking, run, x)
        total = resisted
        for k in range(axles):
            state.waiting[n % 64, k] = state.command[k]
            lever = x.body_height * vehicle.body_arm[k] + x.pivot_height * vehicle.pivot_arm[k]
            load = max(static + vehicle.mass * pitched * lever, 100.0)
            loads[n, k] = load
            here = place - vehicle.offset[k]
            cell = min(max(int((here + BEHIND_M) / CELL_M), 0), cells - 1)
            local = run.mu_cd * table_value(here, profile)
            mu_cd = rail_friction(local, law.mu_cr, state.film[cell], state.sanded[cell], x.sand)
            scale = friction_scale(k, v, here, run, state, x)
            share = state.share[k] if x.memory > 0.0 else -1.0
            true = braked(k, n, v, supply, brake, state, x)
            after, force, locked = turn(k, v, retarded, true, load, mu_cd, scale, share, vehicle, law, state, x)
            mean = 0.5 * (state.wheel[k] + after)
            slide = v - 0.5 * h * retarded - vehicle.radius[k] * mean
            state.work[0] += 0.0 if locked else 0.5 * (state.torque[k] + true) * mean * h
            state.work[1] += force * slide * h
            state.disc[k] += h * (true * mean / 3e4 - state.disc[k] / 300.0)  # [J/K], [s] rubbed layers, assumption
            state.wheel[k], state.torque[k] = after, true
            total += force
            remember(k, v, slide, force, load, here, cell, law, state, x)
            if x.sand != 0.0 and k == 0:  # bursts of 1.5 s every 4 s while the leading axle slides, assumption
                sanding = sanding + h if slide > 1.0 and v > 4.0 else 0.0
                state.sanded[min(cell + 2, cells - 1)] = 1.0 if sanding > 0.0 and sanding % 4.0 < 1.5 else 0.0
        retarded = total / vehicle.mass
        mean_speed = v - 0.5 * h * retarded
        state.work[2] += resisted * mean_speed * h
        place += h * mean_speed
        v -= h * retarded
        n += 1
        if v < run.end_speed:
            break
    return History(speeds[:n], wheels[:n], torques[:n], nominals[:n], positions[:n], adhesions[:n], loads[:n], state.work)
