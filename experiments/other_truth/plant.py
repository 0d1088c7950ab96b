"""One stop, compiled: a vehicle with two or four braked wheelsets in one dimension.

The wheels follow J dw/dt = r T - C by a linearised implicit midpoint rule, the vehicle M dv/dt = -sum T + other forces with the
forces of the same step; brakes, protection and slow states go by explicit steps. Load transfer: moments about the rail.
"""

import math

import numpy as np

from experiments.other_truth.brakes import cylinder, decide, torque_on
from experiments.other_truth.compiled import loop, part
from experiments.other_truth.contact import adhesion
from experiments.other_truth.records import Array, Brake, Places, Protection, Run, Sizes, Sound, State, Vehicle
from experiments.other_truth.sound import GRID_S

GRAVITY_MPS2 = 9.81
STEP_S = 5e-4
ROW_S = 5e-3  # between recorded rows
END_MPS = 2.0  # a stop is recorded down to this speed
LONGEST_S = 160.0  # a stop that takes longer is cut
CELL_M, BEHIND_M, RAIL_M = 0.1, 60.0, 6000.0  # cells of rail, from BEHIND_M before the start of the track
LAG_S = 0.3  # the bodies' pitch follows the deceleration, assumption
DAMPING = 0.07  # of the bogie's resonance, assumption


def fresh(run: Run, vehicle: Vehicle, sound: Sound, sizes: Sizes, places: Places) -> State:
    """Return the state of a vehicle that rolls freely."""
    n = len(vehicle.positions_m)
    radius = vehicle.radius_m * (1.0 + sound.radius)
    radius[places.radius_axle] *= 1.0 + sizes.wheel_radius
    return State(*np.zeros((len(State._fields), n)))._replace(
        radius=radius,
        wheel=run.speed_mps / radius,
        before=run.speed_mps / radius,
        share=np.ones(n),
        valve=np.ones(n),
        cell=np.full(n, -1),
        rail=np.zeros(int(RAIL_M / CELL_M)),
    )


@part
def load_on(j: int, mass: float, varied: float, slowing: float, swing: float, vehicle: Vehicle, sizes: Sizes) -> float:
    """Return the load of one wheel of axle j [N]; `varied`: sound variation, `slowing` [m/s2], `swing` of the resonance."""
    n = vehicle.positions_m.shape[0]
    load = mass * GRAVITY_MPS2 / (2.0 * n) * (1.0 + varied)
    front, lead = (1.0 if 2 * j < n else -1.0), (1.0 if j % 2 == 0 else -1.0)
    if n == 2:
        load += sizes.load_transfer * vehicle.mass_kg * slowing * 1.8 / vehicle.pivots_m * 0.5 * lead
    else:
        levers = 1.2 / vehicle.pivots_m * 0.25 * front + 0.3 / vehicle.wheelbase_m * 0.5 * lead
        load += sizes.load_transfer * slowing * vehicle.mass_kg * levers
    return load * max(0.2, 1.0 + sizes.bogie_resonance * lead * swing)


@part
def friction_at(
    j: int, h: float, v: float, here: float, cell: int, slip: float, mu: float, sizes: Sizes, places: Places, state: State
) -> float:
    """Return mu_cd under axle j, at `here` [m] in a cell of rail, from that of the run and of the track there."""
    if sizes.adhesion_patch != 0.0:
        z = abs(here - places.patch_m) / (0.5 * places.patch_length_m)
        mu *= 1.0 + sizes.adhesion_patch / (1.0 + z**10)
    mu *= math.exp(-0.0089 * sizes.speed_dependent_friction * (v - 20.0))
    mu *= 1.0 - sizes.hydroplaning / (1.0 + math.exp(-(v - places.planing_mps) / 1.2))
    mu *= 1.0 + 1.5 * (1.0 - math.exp(-sizes.leading_axle_cleaning * state.rail[cell]))
    state.slip_rate[j] += h * ((slip - state.slip[j]) / h - state.slip_rate[j]) / 0.05
    state.slip[j] = slip
    return mu * max(0.3, 1.0 + sizes.squeeze_film * math.tanh(state.slip_rate[j] / 3.0))


@part
def traction(
    j: int, h: float, v: float, load: float, mu: float, cell: int, tau: float, sizes: Sizes, state: State
) -> tuple[float, float]:
    """Return the force of wheelset j on the rail [N] and its slope over the slip [N s/m]; note the work done on the rail."""
    s = state.slip[j]
    remembered = state.remembered[j] if sizes.contaminant_memory > 0.0 else -1.0
    step = 1e-4 + 1e-3 * abs(s)
    f, work = adhesion(s, v, load, mu, tau, sizes.recovery_shape, sizes.falling_friction, remembered)
    beyond = s + step if s >= 0.0 else s - step
    f_more, _ = adhesion(beyond, v, load, mu, tau, sizes.recovery_shape, sizes.falling_friction, remembered)
    if sizes.contaminant_memory > 0.0:
        state.remembered[j] += h * v * (work - state.remembered[j]) / max(sizes.contaminant_memory, v * h)
    if cell != state.cell[j]:
        if state.cell[j] >= 0:
            state.rail[state.cell[j]] += state.passing[j]
        state.cell[j] = cell
    state.passing[j] = work
    return 2.0 * load * math.copysign(f, s), 2.0 * load * (f_more - f) / step


@part
def pull(
    v: float, x: float, braking: bool, gust: float, rise: float, mass: float, vehicle: Vehicle, sizes: Sizes, places: Places
) -> float:
    """Return the force on the vehicle [N], positive forwards, beside that of the wheels."""
    force = gust - mass * GRAVITY_MPS2 * (sizes.track_gradient + rise)
    force -= sizes.aerodynamic_drag * v * v * (25.0 / v) ** 0.15
    if braking and v > places.electric_from_mps:
        force -= sizes.non_adhesive_brake * math.tanh(v / 12.0)
    if sizes.curve_resistance != 0.0:
        z = abs(x - places.curve_m) / (0.5 * places.curve_length_m)
        force -= vehicle.mass_kg * GRAVITY_MPS2 * sizes.curve_resistance / (1.0 + z**8)
    return force


@loop
def simulate(
    run: Run,
    vehicle: Vehicle,
    brake: Brake,
    wsp: Protection,
    sound: Sound,
    sizes: Sizes,
    places: Places,
    state: State,
    out: Array,
    h: float,
) -> int:
    """Integrate one stop by steps of h [s] into `out`, see `campaign.Rows`, from a `fresh` state; return its number of rows."""
    n, metres = vehicle.positions_m.shape[0], sound.roughness.shape[0]
    mass = vehicle.mass_kg * (1.0 + sizes.vehicle_mass)
    every, period = round(ROW_S / h), max(1, round(wsp.period_s / h))
    v, x, v_ref, slowing, swing, swing_rate, t = run.speed_mps, run.position_m, run.speed_mps, 0.0, 0.0, 0.0, 0.0
    row, i = 0, 0
    while v > END_MPS and row < out.shape[0]:
        k = min(int(t / GRID_S), sound.ripple.shape[0] - 1)
        braked_s = t - run.coast_s
        braking = braked_s > 0.0
        distributor = run.pressure_bar * min(1.0, max(0.0, braked_s / run.rise_s)) * (1.0 + sound.ripple[k])
        if i % period == 0 and braking:
            v_ref = decide(v_ref, vehicle.radius_m, wsp, state)
        wave = math.sin(2.0 * math.pi * x / places.wave_m)
        swing_rate += h * places.resonance_radps**2 * (wave - swing - 2.0 * DAMPING * swing_rate / places.resonance_radps)
        swing += h * swing_rate
        thrust = 0.0
        for j in range(n):
            filling = cylinder(j, h, (i % period) * h, braking, distributor, brake, wsp, sound.valves[j], state)
            torque = torque_on(j, h, t, braked_s, filling, sound.pads[j, k], vehicle, sizes, places, state)
            load = load_on(j, mass, sound.loads[j] + sound.bounce[j, k], slowing, swing, vehicle, sizes)
            here = x - vehicle.positions_m[j]
            cell = max(0, int((here + BEHIND_M) / CELL_M))
            slip = v - state.radius[j] * state.wheel[j]
            mu = run.mu_cd * (1.0 + sound.friction[j] + sound.roughness[min(metres - 1, cell // 10)])
            mu = friction_at(j, h, v, here, cell, slip, mu, sizes, places, state)
            force, slope = traction(j, h, v, load, mu, cell, run.tau_m_per_j, sizes, state)
            turn = h * (state.radius[j] * force - torque) / vehicle.inertia_kgm2
            turn = turn / (1.0 + 0.5 * h * max(-200.0, slope) * state.radius[j] ** 2 / vehicle.inertia_kgm2)
            turn = max(turn, -state.wheel[j])
            if i % every == 0:
                out[row, 2 + 4 * j] = state.wheel[j] * (1.0 + sound.teeth[j] * math.sin(state.turned[j]))
                out[row, 3 + 4 * j], out[row, 4 + 4 * j], out[row, 5 + 4 * j] = state.pressure[j], torque, slip
            state.turned[j] += h * state.wheel[j]
            state.wheel[j] += turn
            thrust += force - 0.5 * slope * state.radius[j] * turn
        rise = sound.gradient[min(metres - 1, int(max(0.0, x + BEHIND_M)))]
        change = (pull(v, x, braking, sound.gusts_n[k], rise, mass, vehicle, sizes, places) - thrust) / mass
        slowing += h * (-change - slowing) / LAG_S
        if i % every == 0:
            out[row, 0], out[row, 1] = v, x
            row += 1
        x += h * (v + 0.5 * h * change)
        v += h * change
        t += h
        i += 1
    return row
