"""The plant: conservation, order of convergence, standstill and locked wheels, independence of the batch."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from plant_cases import DIRECT, a_plant, a_stop, arrays, plant_of, run
from scipy.integrate import solve_ivp
from scipy.special import lambertw

from wsp_env.parameters.uic_z1 import VEHICLES, WHEELSET
from wsp_env.scenario import Scenario, draw

names = st.sampled_from(sorted(VEHICLES))
seeds = st.integers(0, 2**32 - 1)
NODES = 401


def random_batch(name, seed, substep=0.01, n=6, pressure=False, scenario=None, **vehicle):
    """Random stops of a vehicle and a function that gives their random commands, some kept for a while."""
    rng = np.random.default_rng(seed)
    vehicle = dataclasses.replace(VEHICLES[name], **vehicle)
    plant = plant_of(vehicle, n, substep_s=substep, pressure_control=pressure, track_nodes=NODES)
    stops = [draw(scenario or Scenario(mu_cd=(0.005, 0.25)), vehicle, rng, NODES) for _ in range(n)]
    for i, stop in enumerate(stops):
        plant.start(i, stop)
    command = np.ones((n, vehicle.axles))

    def commands():
        anew = rng.random(command.shape) < 0.1
        new = rng.random(command.shape) if pressure else rng.choice([-1.0, 0.0, 1.0], p=[0.3, 0.2, 0.5], size=command.shape)
        command[anew] = new[anew]
        return command

    return plant, commands, stops


@pytest.mark.slow
@given(names, seeds, st.booleans(), st.sampled_from([0.02, 0.01, 0.0025]), st.floats(-0.02, 0.02), st.floats(0.0, 5.0))
@settings(max_examples=12)
def test_energy_is_conserved(name, seed, pressure, substep, gradient, drag):
    """Kinetic energy lost = brake work + contact loss + work against resistance and gradient, at any moment of any stop.

    The substep that ends in standstill is cut linearly: it may err by a small part of the little energy that it begins with.
    """
    scenario = Scenario(mu_cd=(0.005, 0.25), tau=(0.0, 1e-3), initial_speed=(2.0, 50.0), gradient=(gradient, gradient))
    plant, commands, _ = random_batch(
        name,
        seed,
        substep,
        6,
        pressure,
        scenario,
        resistance_a_n=200.0,
        resistance_b_ns_per_m=10.0,
        resistance_c_ns2_per_m2=drag,
    )
    before = plant.kinetic_energy
    for _ in range(150):
        for _ in range(20):
            plant.step(commands())
        state = plant.state
        work = state.brake_work + state.contact_work.sum(axis=1) + state.resistance_work
        error = np.abs(before - plant.kinetic_energy - work) / before
        assert (error < np.where(plant.moving, 1e-10, 1e-5)).all()
        assert (state.contact_work >= -1e-9 * before[:, None]).all()
        if not plant.moving.any():
            break


@pytest.mark.slow
@given(names, seeds, st.sampled_from([0.02, 0.01, 0.005, 0.00125]))
@settings(max_examples=12)
def test_braked_vehicle_never_speeds_up_on_level_track(name, seed, substep):
    plant, _, _ = random_batch(name, seed, substep, scenario=Scenario(mu_cd=(0.03, 0.25), initial_speed=(1.0, 10.0)))
    for _ in range(4000):
        before = plant.state.speed.copy()
        run(plant, 0.02)
        assert (plant.state.speed <= before).all()
        if not plant.moving.any():
            break
    assert not plant.moving.any()
    assert_array_equal(plant.state.speed, 0.0)
    assert_array_equal(plant.state.wheel_speed, 0.0)


@pytest.mark.parametrize("speed", [1e-7, 1.5e-6, 1e-5, 1e-4, 1e-3])
def test_locked_vehicle_next_to_standstill_stops(speed):
    """There the creep force falls to nothing with the speed, so steeply that its slope times the speed lost exceeds it."""
    plant = a_plant("wheelset", 0.02, 0.00125, mu_cd=0.0759, mass=11_947.0)
    run(plant, 6.0)
    plant.state.speed[0], plant.state.wheel_speed[0, 0] = speed, 0.0
    run(plant, 0.02)
    assert not plant.moving[0]
    assert plant.state.speed[0] == 0.0


@pytest.mark.parametrize("name", sorted(VEHICLES))
@pytest.mark.parametrize("mu_cd", [0.02, 0.06, 0.25])
@pytest.mark.parametrize("tau", [0.0, 1.9e-4])
@pytest.mark.parametrize("substep", [0.02, 0.01])
def test_slip_does_not_chatter_down_to_standstill(name, mu_cd, tau, substep):
    """With the brake applied the slip stays positive; a solver that chatters there changes its sign at every substep."""
    plant = a_plant(name, substep, substep, mu_cd=mu_cd, tau=tau, initial_speed=6.0, demand=0.6)
    run(plant, 0.2)
    slips = []
    while plant.moving.any():
        run(plant, substep)
        slips.append(plant.state.slip_speed[0].copy())
    slips = np.array(slips[:-1])
    assert (slips > 0.0).all()
    # Nor does it swing without changing sign: once the distributor is full the slip turns at most when wheels lock.
    full = slips[math.ceil(3.0 / substep) :]
    turns = np.diff(np.sign(np.diff(full, axis=0)), axis=0) != 0
    assert (turns.sum(axis=0) <= 3).all()


def radau(t_end, demand, mu_cd, tau, v0):
    """Speed, wheel speed, position and pressure of a wheelset at `t_end`: the paper's equations, written anew for scipy."""
    vehicle, c, brake = WHEELSET, WHEELSET.contact, WHEELSET.brake
    load = vehicle.mass_kg * vehicle.gravity_mps2 / 2.0
    stiffness = c.shear_modulus_pa * math.pi * c.semi_axis_a_m * c.semi_axis_b_m * c.kalker_c11 / 4.0

    def curve(s, v, mu_c, ratio, gamma, k_a, k_s):
        mu = (mu_c / ratio - mu_c) * math.exp(-gamma * s) + mu_c
        eps = stiffness * s / v / (mu * load)
        return 2.0 * mu / math.pi * (k_a * eps / (1.0 + (k_a * eps) ** 2) + math.atan(k_s * eps))

    def adhesion(s, v):
        f_d = curve(s, v, mu_cd, c.friction_ratio_d, c.friction_decrease_d_spm, c.polach_k_ad, c.polach_k_sd)
        f_r = curve(s, v, c.kinetic_friction_r, c.friction_ratio_r, c.friction_decrease_r_spm, c.polach_k_ar, c.polach_k_sr)
        a = tau * load * s / v
        return f_r + lambertw(-a * (f_r - f_d) * math.exp(-a * f_r)).real / a if a > 1e-6 else f_d

    def rates(t, y):
        v, w, _, p = y
        force = 2.0 * load * adhesion(max(v - vehicle.wheel_radius_m * w, 0.0), v)
        supply = min(t / brake.demand_rise_s, demand) * brake.full_pressure_bar
        spin = (vehicle.wheel_radius_m * force - brake.torque_per_bar_nm * p) / vehicle.wheelset_inertia_kgm2
        return [-force / vehicle.mass_kg, spin, v, (supply - p) / brake.fill_time_constant_s]

    start = [v0, v0 / vehicle.wheel_radius_m, 0.0, 0.0]
    return solve_ivp(rates, (0.0, t_end), start, method="Radau", rtol=1e-10, atol=1e-11, max_step=0.05).y[:, -1]


@pytest.mark.parametrize(("demand", "mu_cd", "tau"), [(0.5, 0.08, 1.9e-4), (1.0, 0.03, 1.9e-4), (1.0, 0.03, 0.0)])
def test_second_order_against_an_independent_solver(demand, mu_cd, tau):
    """Gripping, sliding with recovery and sliding without: the error falls by four when the substep is halved."""
    t_end, v0 = 1.92, 25.0
    v, w, x, p = radau(t_end, demand, mu_cd, tau, v0)
    errors = []
    for substep in (0.02, 0.01, 0.005, 0.0025):
        plant = a_plant("wheelset", 0.02, substep, demand=demand, mu_cd=mu_cd, tau=tau, initial_speed=v0)
        run(plant, t_end)
        s = plant.state
        errors.append(
            [abs(s.speed[0] - v), abs(s.wheel_speed[0, 0] - w), abs(s.position[0] - x), abs(s.brake.pressure[0, 0] - p)]
        )
    errors = np.array(errors)
    assert_allclose(errors[-1] / [v, w, x, p], 0.0, atol=1e-5)
    orders = np.log2(errors[:-1] / errors[1:])
    assert (orders[1:] > 1.8).all()


def test_locked_wheel_stays_locked_under_full_brake():
    plant = a_plant("wheelset", mu_cd=0.02, tau=0.0, initial_speed=30.0)
    run(plant, 8.0)
    state = plant.state
    assert state.wheel_speed[0, 0] == 0.0
    assert state.speed[0] > 20.0
    for _ in range(200):
        run(plant, 0.02)
        assert state.wheel_speed[0, 0] == 0.0
    # A locked wheel turns nothing: the brake takes no work, the contact takes all of it.
    work, heat, energy = state.brake_work[0], state.contact_work[0, 0], plant.kinetic_energy[0]
    run(plant, 1.0)
    assert state.brake_work[0] == work
    assert_allclose(state.contact_work[0, 0] - heat, energy - plant.kinetic_energy[0], rtol=1e-9)


def test_locked_wheel_regains_grip_when_vented():
    plant = a_plant("bogie", mu_cd=0.03, tau=0.0, initial_speed=40.0)
    run(plant, 8.0)
    assert (plant.state.wheel_speed == 0.0).all()
    run(plant, 12.0, [-1.0, 1.0])
    assert plant.state.speed[0] > 20.0
    assert plant.state.wheel_speed[0, 1] == 0.0
    assert_allclose(plant.state.slip_speed[0, 0], 0.0, atol=1e-3)
    # The rolling wheel takes from the rail only what slows its own rotation.
    inertia = WHEELSET.wheelset_inertia_kgm2 / WHEELSET.wheel_radius_m**2
    force = -inertia * plant.state.deceleration[0]
    assert_allclose(plant.state.adhesion[0, 0], force / (2 * WHEELSET.static_wheel_load_n), rtol=1e-2)


def test_gripping_vehicle_brakes_as_its_torque_says():
    vehicle = VEHICLES["coach"]
    plant = a_plant("coach", mu_cd=0.28, initial_speed=40.0, demand=0.5, vehicle={"brake": DIRECT})
    run(plant, 4.0)
    before = plant.state.speed[0]
    run(plant, 4.0)
    torque = 0.5 * vehicle.full_brake_torque_nm
    radius = vehicle.wheel_radius_m
    inertia = vehicle.mass_kg + 4 * vehicle.wheelset_inertia_kgm2 / radius**2  # wheels turn with the vehicle
    assert_allclose((before - plant.state.speed[0]) / 4.0, 4 * torque / radius / inertia, rtol=2e-3)  # slip takes the rest


def test_rolling_vehicle_on_a_gradient():
    vehicle = VEHICLES["bogie"]
    inertia = vehicle.mass_kg + 2 * vehicle.wheelset_inertia_kgm2 / vehicle.wheel_radius_m**2
    for gradient in (0.01, -0.01):
        plant = a_plant("bogie", demand=0.0, gradient=gradient)
        run(plant, 10.0)
        expected = 30.0 - vehicle.mass_kg * vehicle.gravity_mps2 * gradient / inertia * 10.0
        assert_allclose(plant.state.speed[0], expected, rtol=1e-4)
        assert_allclose(plant.state.position[0], 0.5 * (30.0 + expected) * 10.0, rtol=1e-4)


def test_rolling_vehicle_against_air():
    vehicle = dataclasses.replace(VEHICLES["coach"], resistance_c_ns2_per_m2=8.0)
    inertia = vehicle.mass_kg + 4 * vehicle.wheelset_inertia_kgm2 / vehicle.wheel_radius_m**2
    plant = a_plant("coach", demand=0.0, initial_speed=50.0, vehicle={"resistance_c_ns2_per_m2": 8.0})
    run(plant, 60.0)
    assert_allclose(plant.state.speed[0], 50.0 / (1.0 + 8.0 * 50.0 * 60.0 / inertia), rtol=1e-5)


def test_free_rolling_is_exact():
    plant = a_plant("coach", demand=0.0, initial_speed=33.0)
    run(plant, 20.0)
    assert_allclose(plant.state.speed[0], 33.0, rtol=1e-12)
    assert_allclose(plant.state.position[0], 660.0, rtol=1e-12)
    assert_allclose(plant.state.slip_speed, 0.0, atol=1e-9)
    assert_array_equal(plant.state.brake.air, 0.0)


def test_vehicle_that_stands_stays_as_it_is():
    plant = a_plant("bogie", initial_speed=2.0, demand=1.0, mu_cd=0.2)
    run(plant, 20.0)
    assert not plant.moving[0]
    before = {name: array.copy() for name, array in arrays(plant.state).items()}
    run(plant, 1.0, -1.0)
    for name, array in arrays(plant.state).items():
        assert_array_equal(array, before[name], err_msg=name)


def test_contamination_switched_on_and_off_by_place():
    """On the clean stretch the wheel has dry adhesion, on the contaminated one the degraded law's limit."""
    coverage = np.repeat([1.0, 0.0, 1.0], 40)  # 200 m each
    vehicle = VEHICLES["wheelset"]
    plant = plant_of(vehicle, 1, track_nodes=120)
    plant.start(0, a_stop(vehicle, mu_cd=0.03, coverage=coverage, profile=np.ones(120), initial_speed=40.0))
    seen = {}
    while plant.state.position[0] < 590.0:
        run(plant, 0.02)
        seen[plant.state.position[0]] = plant.state.adhesion[0, 0]
    place, f = np.array(list(seen)), np.array(list(seen.values()))
    inertia = vehicle.mass_kg + vehicle.wheelset_inertia_kgm2 / vehicle.wheel_radius_m**2
    needed = vehicle.full_brake_torque_nm / vehicle.wheel_radius_m / inertia / vehicle.gravity_mps2
    assert f[(place > 150.0) & (place < 195.0)].max() < 0.8 * needed  # all that mu_cd = 0.03 gives at these speeds
    assert_allclose(f[(place > 215.0) & (place < 390.0)].max(), needed, rtol=1e-3)


@given(names, seeds)
@settings(max_examples=8)
def test_numbers_do_not_depend_on_the_batch(name, seed):
    plant, commands, stops = random_batch(name, seed, n=5)
    order = np.random.default_rng(seed).permutation(5)
    other = plant_of(plant.vehicle, 5, substep_s=0.01, track_nodes=NODES)
    single = plant_of(plant.vehicle, 1, substep_s=0.01, track_nodes=NODES)
    for place, i in enumerate(order):
        other.start(place, stops[i])
    single.start(0, stops[3])
    for _ in range(700):
        command = commands()
        plant.step(command)
        other.step(command[order])
        single.step(command[3:4])
    others, alone = arrays(other.state), arrays(single.state)
    for name_, array in arrays(plant.state).items():
        assert_array_equal(array[order], others[name_], err_msg=name_)
        assert_array_equal(array[3:4], alone[name_], err_msg=name_)


def test_start_leaves_nothing_of_the_stop_before():
    plant, commands, stops = random_batch("bogie", 3, n=2)
    fresh, _, _ = random_batch("bogie", 3, n=2)
    for _ in range(400):
        plant.step(commands())
    plant.start(0, stops[0])
    plant.start(1, stops[1])
    for _ in range(100):
        run(plant, 0.02)
        run(fresh, 0.02)
    others = arrays(fresh.state)
    for name, array in arrays(plant.state).items():
        assert_array_equal(array, others[name], err_msg=name)
