"""Brake and tachometers against what their few numbers say, in seconds, whatever the control interval."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from plant_cases import DIRECT, a_plant, a_stop, arrays, plant_of, run

from wsp_env.parameters.uic_z1 import BOGIE, WHEELSET
from wsp_env.parameters.vehicle import ATMOSPHERE_BAR, Tachometer
from wsp_env.plant.components.tachometer import normal, uniform

BRAKE = BOGIE.brake
FULL = BRAKE.full_pressure_bar
INTERVALS = [0.02, 0.05, 0.03, 0.015, 0.1]  # the dead time of 40 ms is a multiple of the first only


def filled(interval):
    """A bogie that has braked for 6 s, its distributor and cylinders full; the rail grips."""
    plant = a_plant("bogie", interval, 0.01, mu_cd=0.28, initial_speed=50.0)
    run(plant, 6.0)
    assert_allclose(plant.state.brake.pressure, FULL, rtol=1e-3)
    return plant


@pytest.mark.parametrize("interval", INTERVALS)
def test_valve_vents_after_its_dead_time_with_its_time_constant(interval):
    plant = filled(interval)
    before, start = plant.state.brake.pressure.copy(), plant.state.time[0]
    for _ in range(math.ceil(0.4 / interval)):
        plant.step([[-1.0, 1.0]])
        since = max(plant.state.time[0] - start - BRAKE.dead_time_s, 0.0)
        assert_allclose(
            plant.state.brake.pressure[0, 0], before[0, 0] * math.exp(-since / BRAKE.vent_time_constant_s), rtol=1e-3
        )
    assert plant.state.brake.pressure[0, 1] >= before[0, 1]


@pytest.mark.parametrize("interval", INTERVALS)
def test_valve_fills_after_its_dead_time_with_its_time_constant(interval):
    plant = filled(interval)
    run(plant, 3.0, -1.0)
    assert plant.state.brake.pressure.max() < 1e-6 * FULL
    start = plant.state.time[0]
    for _ in range(math.ceil(0.5 / interval)):
        run(plant, interval)
        since = max(plant.state.time[0] - start - BRAKE.dead_time_s, 0.0)
        assert_allclose(plant.state.brake.pressure, FULL * (1.0 - math.exp(-since / BRAKE.fill_time_constant_s)), atol=1e-6)


@pytest.mark.parametrize("interval", INTERVALS)
def test_valve_holds(interval):
    plant = filled(interval)
    run(plant, 0.3, -1.0)
    run(plant, 0.3, 0.0)
    held, air = plant.state.brake.pressure.copy(), plant.state.brake.air.copy()
    run(plant, 1.5, 0.0)
    assert_array_equal(plant.state.brake.pressure, held)
    assert_array_equal(plant.state.brake.air, air)


def test_cylinders_follow_the_distributor_to_the_demand():
    plant = a_plant("bogie", demand=0.6, mu_cd=0.28, initial_speed=50.0)
    run(plant, 1.0)
    assert_allclose(plant.state.brake.distributor, FULL / BRAKE.demand_rise_s, rtol=1e-9)
    run(plant, 5.0)
    assert_allclose(plant.state.brake.distributor, 0.6 * FULL, rtol=1e-12)
    assert_allclose(plant.state.brake.pressure, 0.6 * FULL, rtol=1e-4)


def test_air_is_the_volume_times_the_pressure_that_was_let_in():
    plant = filled(0.02)
    run(plant, 0.1, 0.0)
    risen = plant.state.brake.pressure.copy()
    for _ in range(5):
        run(plant, 0.4, -1.0)
        low = plant.state.brake.pressure.copy()
        run(plant, BRAKE.dead_time_s, 0.0)
        low = np.minimum(low, plant.state.brake.pressure)
        run(plant, 0.5, 1.0)
        run(plant, BRAKE.dead_time_s, 0.0)
        risen += plant.state.brake.pressure - low
    assert_allclose(plant.state.brake.air, BRAKE.cylinder_volume_l * risen / ATMOSPHERE_BAR, rtol=1e-9)


@given(st.floats(0.0, 1.0), st.floats(0.2, 1.0))
def test_pressure_command_is_a_share_of_the_demand(share, demand):
    plant = plant_of(BOGIE, 1, pressure_control=True)
    plant.start(0, a_stop(BOGIE, mu_cd=0.28, initial_speed=50.0, demand=demand))
    run(plant, 6.0, 1.0)
    run(plant, 3.0, [share, 0.0])
    assert_allclose(plant.state.brake.pressure[0], [share * demand * FULL, 0.0], atol=1e-4)


def test_interval_changes_when_commands_are_heard_and_nothing_else():
    """One square wave of commands given at 20 ms and at 5 ms: the same stop."""
    coarse, fine = (a_plant("bogie", interval, 0.005, mu_cd=0.04) for interval in (0.02, 0.005))
    wave = np.random.default_rng(4).choice([-1.0, 0.0, 1.0], size=(100, 2))
    for command in wave:
        run(coarse, 0.2, command)
        run(fine, 0.2, command)
    for name in ("time", "position", "speed", "wheel_speed", "brake.pressure", "brake.air"):
        assert_allclose(arrays(fine.state)[name], arrays(coarse.state)[name], rtol=1e-9, atol=1e-9, err_msg=name)


def test_tachometer_reads_a_steady_wheel_exactly():
    for pulses in (1.0, 60.0, 100.0, 300.0):
        for speed in (0.5, 5.0, 55.0):
            plant = a_plant(
                "bogie", demand=0.0, initial_speed=speed, vehicle={"tachometer": Tachometer(pulses_per_turn=pulses)}
            )
            for _ in range(300):
                run(plant, 0.02)
                assert_allclose(plant.state.tachometer.measured, plant.state.wheel_speed, rtol=1e-9)


def test_tachometer_reads_the_mean_speed_between_its_edges():
    """While the wheel brakes the reading lags: it lies between the wheel's speeds now and two pulses and intervals ago."""
    for pulses in (20.0, 100.0):
        plant = a_plant(
            "wheelset",
            mu_cd=0.28,
            initial_speed=20.0,
            vehicle={"brake": DIRECT, "tachometer": Tachometer(pulses_per_turn=pulses)},
        )
        history = [plant.state.wheel_speed[0, 0]]
        while plant.state.wheel_speed[0, 0] > 0.1:
            run(plant, 0.02)
            now = plant.state.wheel_speed[0, 0]
            history.append(now)
            age = 0.04 + 2.0 * (2.0 * math.pi / pulses) / now
            past = history[max(len(history) - 1 - math.ceil(age / 0.02), 0)]
            assert now - 1e-9 <= plant.state.tachometer.measured[0, 0] <= past + 1e-9


def test_tachometer_of_a_locked_wheel_falls_to_nothing():
    plant = a_plant("wheelset", mu_cd=0.02, tau=0.0, initial_speed=30.0, vehicle={"brake": DIRECT})
    while plant.state.wheel_speed[0, 0] > 0.0:
        run(plant, 0.02)
    pulse = 2.0 * math.pi / WHEELSET.tachometer.pulses_per_turn
    locked = plant.state.time[0]
    for _ in range(100):
        run(plant, 0.02)
        # No edge since: the speed can be at most one pulse over the time that has passed.
        assert 0.0 <= plant.state.tachometer.measured[0, 0] <= pulse / (plant.state.time[0] - locked) + 1e-9


def test_noise_has_the_deviation_that_was_asked_for():
    plant = a_plant("coach", demand=0.0, noise=0.3, initial_speed=30.0)
    errors = []
    for _ in range(3000):
        run(plant, 0.02)
        errors.append(plant.state.tachometer.measured[0] - plant.state.wheel_speed[0])
    errors = np.array(errors)
    assert_allclose(errors.std(axis=0), 0.3, rtol=0.06)  # four deviations of an estimate from 3000
    assert_allclose(errors.mean(axis=0), 0.0, atol=0.022)
    assert np.abs(np.corrcoef(errors.T) - np.eye(4)).max() < 0.08


def test_noise_generator_is_uniform_and_normal():
    count = 20_000
    u = np.array([uniform(np.uint64(7), i) for i in range(count)])
    assert 0.0 < u.min() < u.max() < 1.0
    assert_allclose(np.histogram(u, 20, (0, 1))[0], count / 20, rtol=0.15)
    z = np.array([normal(np.uint64(7), i) for i in range(count)])
    assert_allclose([z.mean(), z.std(), (z**3).mean(), (z**4).mean()], [0.0, 1.0, 0.0, 3.0], atol=0.15)
    assert_allclose(np.corrcoef(z[:-1], z[1:])[0, 1], 0.0, atol=0.03)


def test_noise_differs_between_stops_and_not_between_batches():
    readings = []
    for batch in ((1, 2), (2,)):
        plant = plant_of(WHEELSET, len(batch))
        for i, key in enumerate(batch):
            plant.start(i, a_stop(WHEELSET, key=key, noise=0.1))
        run(plant, 1.0)
        readings.append(plant.state.tachometer.measured[:, 0].copy())
    assert readings[0][1] == readings[1][0]
    assert readings[0][0] != readings[0][1]


def test_worn_wheel_turns_faster():
    radius = np.array([0.445, 0.42])
    plant = a_plant("bogie", demand=0.0, radius=radius, initial_speed=20.0)
    run(plant, 5.0)
    assert_allclose(plant.state.wheel_speed[0], 20.0 / radius, rtol=1e-9)


def test_dead_time_longer_than_many_intervals():
    slow = dataclasses.replace(BRAKE, dead_time_s=0.5)
    plant = a_plant("bogie", 0.02, 0.01, mu_cd=0.28, initial_speed=50.0, vehicle={"brake": slow})
    run(plant, 6.0)
    before, start = plant.state.brake.pressure[0, 0], plant.state.time[0]
    run(plant, 0.5, -1.0)
    assert plant.state.brake.pressure[0, 0] >= before
    run(plant, 0.1, -1.0)
    since = plant.state.time[0] - start - 0.5
    assert_allclose(plant.state.brake.pressure[0, 0], before * math.exp(-since / slow.vent_time_constant_s), rtol=1e-3)


def with_reservoirs(volume_l: float, **changes):
    brake = dataclasses.replace(BRAKE, reservoir_volume_l=volume_l, **changes)
    return a_plant("bogie", 0.02, 0.01, vehicle={"brake": brake}, mu_cd=0.28, initial_speed=80.0)


def test_reservoirs_lose_what_the_cylinders_take_and_an_empty_device_has_no_brake():
    plant = with_reservoirs(10.0)
    brake = plant.state.brake
    for _ in range(12):
        run(plant, 1.0, 1.0)
        taken = brake.air.sum() * ATMOSPHERE_BAR / (10.0 * 2)  # [bar], isothermal
        assert_allclose(BRAKE.reservoir_pressure_bar - brake.reservoir, taken, rtol=1e-9)
        run(plant, 1.0, -1.0)
    assert 0.0 <= brake.reservoir[0] < 1.0
    run(plant, 2.0, 1.0)
    assert (brake.pressure < 1.0).all()  # of 3.8 bar that are asked for
    assert (brake.pressure >= brake.reservoir - 1e-6).all()


def test_cylinders_keep_their_air_when_the_reservoirs_are_lower_and_a_supply_fills_them_again():
    plant = with_reservoirs(2.0, reservoir_supply_nlps=100.0)
    brake = plant.state.brake
    run(plant, 6.0, 1.0)
    full = brake.pressure.copy()
    brake.reservoir[:] = 1.0
    plant.step([[1.0, 1.0]])
    assert (brake.pressure >= full - 1e-9).all()
    before = brake.reservoir[0]
    run(plant, 0.1, 0.0)
    assert_allclose(brake.reservoir[0] - before, 100.0 * 0.1 * ATMOSPHERE_BAR / (2.0 * 2), rtol=1e-6)
    run(plant, 5.0, 0.0)
    assert brake.reservoir[0] == BRAKE.reservoir_pressure_bar


def test_a_supply_that_never_ends_changes_nothing():
    plain, large = a_plant("bogie", 0.02, 0.01), with_reservoirs(1e4)
    for plant in (plain, large):
        run(plant, 3.0, 1.0)
        run(plant, 0.2, -1.0)
        run(plant, 1.0, 1.0)
    assert_array_equal(plain.state.brake.pressure, large.state.brake.pressure)
