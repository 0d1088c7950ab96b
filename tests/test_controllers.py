"""What every controller must do, and the rules of the rule-based one."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from plant_cases import plant_of

from baselines.adaptive import AdaptiveController
from baselines.extremum_seeking import ExtremumSeeker
from baselines.none import NoWSP
from baselines.reference_speed import ReferenceParameters, ReferenceSpeed
from baselines.rule_based import RuleBasedWSP
from baselines.slip_control import SlipController, SlipParameters
from wsp_env.envs.step import LOCKED_RUNNING_MPS, LOCKED_WHEEL_MPS
from wsp_env.evaluation.controller import SHORT_NAMES, Controller, load
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.uic_z1 import BOGIE, COACH, WHEELSET
from wsp_env.plant.port import Measurement, Stop

INTERVAL_S = 0.02
TRAINED = Path(__file__).parents[1] / "agents" / "trained"
PROTECTING = [RuleBasedWSP, SlipController, ExtremumSeeker, AdaptiveController]


def make_stop(vehicle, mu_cd=0.03, tau=0.0, speed=30.0, noise=0.05, radius=None):
    radii = np.full(vehicle.axles, vehicle.wheel_radius_m) if radius is None else np.array(radius)
    one = np.ones(1)
    return Stop(mu_cd, tau, speed, vehicle.mass_kg, 1.0, 0.0, noise, 7, radii, one, one)


def drive(controller, vehicle, stops, interval_s=INTERVAL_S, change=lambda measurement: measurement):
    """Brake to standstill; return the plant, the commands (T, N, A) and which wheels ever locked (N, A)."""
    plant = plant_of(vehicle, len(stops), control_interval_s=interval_s)
    for index, stop in enumerate(stops):
        plant.start(index, stop)
    controller.reset(len(stops), vehicle)
    locked = np.zeros((len(stops), vehicle.axles), dtype=bool)
    commands = []
    while plant.moving.any():
        state = plant.state
        measurement = plant.reading()._replace(pressure=None)
        commands.append(controller.act(change(measurement)).copy())
        plant.step(commands[-1])
        standing = plant.conditions.radius * state.wheel_speed < LOCKED_WHEEL_MPS
        locked |= standing & (state.speed[:, None] > LOCKED_RUNNING_MPS)
    return plant, np.array(commands), locked


@pytest.mark.parametrize("name", SHORT_NAMES)
def test_short_names_give_controllers_with_checked_parameters(name):
    controller = load(name)
    assert isinstance(controller, Controller)
    if hasattr(controller, "parameters"):
        field = dataclasses.fields(controller.parameters)[0].name
        assert getattr(load(name, {field: 0.5}).parameters, field) == 0.5
        with pytest.raises(ParameterError, match="no_such"):
            load(name, {"no_such": 1.0})
        with pytest.raises(ParameterError, match=field):
            load(name, {field: -1.0})
    else:
        with pytest.raises(ParameterError, match="no parameters"):
            load(name, {"any": 1.0})


@pytest.mark.parametrize("name", [*(name for name in SHORT_NAMES if name != "none"), str(TRAINED / "bogie")])
def test_a_vehicles_name_is_no_vehicle(name):
    with pytest.raises(ParameterError, match=r"vehicle = 'bogie' must be a Vehicle; .*find_vehicle"):
        load(name).reset(1, "bogie")


def slippery(vehicle):
    return [make_stop(vehicle, mu, tau, v) for mu, v in ((0.024, 40.0), (0.035, 20.0)) for tau in (0.0, 2e-4)]


@pytest.fixture(
    scope="module", params=[WHEELSET, BOGIE, pytest.param(COACH, marks=pytest.mark.long)], ids=["wheelset", "bogie", "coach"]
)
def without_protection(request):
    """Return a vehicle and what becomes of it on slippery rails."""
    return request.param, drive(NoWSP(), request.param, slippery(request.param))


@pytest.mark.slow
@pytest.mark.parametrize("make", PROTECTING)
def test_no_wheel_locks_where_it_would_without_protection(make, without_protection):
    vehicle, (unprotected, _, would_lock) = without_protection
    plant, commands, locked = drive(make(), vehicle, slippery(vehicle))
    assert not locked.any()
    assert np.isin(commands, (-1.0, 0.0, 1.0)).all()
    classic = plant.conditions.tau == 0.0
    assert would_lock[classic].all()
    assert (plant.state.position[classic] < 0.85 * unprotected.state.position[classic]).all()


@pytest.mark.parametrize("make", PROTECTING)
def test_a_stop_does_not_depend_on_its_batch(make):
    stops = [make_stop(BOGIE, mu, tau, 15.0) for mu, tau in ((0.025, 0.0), (0.03, 2e-4), (0.05, 0.0))]
    together, commands, _ = drive(make(), BOGIE, stops)
    for index, stop in enumerate(stops):
        alone, own, _ = drive(make(), BOGIE, [stop])
        assert alone.state.position[0] == together.state.position[index]
        np.testing.assert_array_equal(own[:, 0], commands[: len(own), index])


@pytest.mark.parametrize(
    "make",
    [
        RuleBasedWSP,
        AdaptiveController,
        *(pytest.param(one, marks=pytest.mark.long) for one in (SlipController, ExtremumSeeker)),
    ],
)
def test_a_control_interval_half_as_long_changes_little(make):
    stops = [make_stop(BOGIE, 0.03, tau, 25.0) for tau in (0.0, 2e-4)]
    usual, _, _ = drive(make(), BOGIE, stops)
    finer, _, locked = drive(make(), BOGIE, stops, 0.5 * INTERVAL_S)
    np.testing.assert_allclose(finer.state.position, usual.state.position, rtol=0.06)
    assert not locked.any()


@pytest.mark.parametrize("make", PROTECTING)
def test_a_failed_sensor_is_reported_and_the_sound_axle_protected(make):
    def fail(measurement):
        speeds = measurement.wheel_speed.copy()
        speeds[measurement.time > 3.0, 0] = np.nan
        return measurement._replace(wheel_speed=speeds)

    controller = make()
    plant, _, locked = drive(controller, BOGIE, [make_stop(BOGIE, 0.04, 0.0, 25.0)], change=fail)
    assert controller.wheels.failed.tolist() == [[True, False]]
    assert not locked[0, 1]
    assert np.isfinite(plant.state.position).all()


def test_rule_based_degraded_mode_keeps_the_blind_axle_from_locking():
    def fail(measurement):
        speeds = measurement.wheel_speed.copy()
        speeds[measurement.time > 3.0, 0] = np.nan
        return measurement._replace(wheel_speed=speeds)

    _, _, locked = drive(RuleBasedWSP(), BOGIE, [make_stop(BOGIE, 0.035, 0.0, 25.0)], change=fail)
    assert not locked.any()


def measured(time, speeds, vehicle=BOGIE):
    return Measurement(np.array([time]), np.array([speeds]) / vehicle.wheel_radius_m, np.ones(1))


@pytest.mark.parametrize("make", PROTECTING)
def test_safety_timer_ends_endless_venting(make):
    controller = make()
    controller.parameters = dataclasses.replace(controller.parameters, safety_timer_s=3.0)
    controller.reset(1, BOGIE)
    longest = unbraked = 0.0
    for step in range(1000):  # rolls for a second, then one wheel stands for ever though it is vented
        time = step * INTERVAL_S
        rolling = 25.0 - 1e-6 * time  # no sensor reads the same to the last digit
        commands = controller.act(measured(time, [rolling, np.clip(25.0 - 20.0 * (time - 1.0), 0.0, rolling)]))
        unbraked = 0.0 if commands[0, 1] > 0.0 else unbraked + INTERVAL_S
        longest = max(longest, unbraked)
    # The guarded one finds earlier that the wheel does not do what its valve is told.
    least = 0.5 if make is AdaptiveController else 2.0
    assert least < longest <= controller.parameters.safety_timer_s + 2 * INTERVAL_S
    assert controller.wheels.standing.tolist() == [[False, True]]


def test_below_the_cut_out_speed_the_brake_is_left_alone():
    controller = RuleBasedWSP()
    controller.reset(1, BOGIE)
    for step in range(400):
        speed = 4.0 - step * INTERVAL_S  # from 2 m/s on the second wheel stands
        commands = controller.act(measured(step * INTERVAL_S, [max(speed, 0.0), speed if speed > 2.0 else 0.0]))
        below = controller.wheels.reference[0] < controller.parameters.cut_out_mps
        assert (commands == 1.0).all() or not below
    assert below


def test_wheel_diameters_are_learnt_while_rolling():
    wheels = ReferenceSpeed(ReferenceParameters(), 1, BOGIE)
    worn = np.array([1.0, 0.95]) * BOGIE.wheel_radius_m
    for step in range(50):
        reading = Measurement(np.array([step * INTERVAL_S]), 30.0 / worn[None], np.ones(1))
        wheels.update(reading, np.ones((1, 2)), np.zeros(1, dtype=bool))
    assert np.ptp(wheels.speed) < 0.02


def test_reference_follows_a_rolling_vehicle_and_is_renewed_by_a_released_axle():
    wheels = ReferenceSpeed(ReferenceParameters(), 1, BOGIE)
    true, deceleration, creepage = 30.0, 0.5, 0.0
    commands, asked = np.ones((1, 2)), False
    for step in range(1500):
        time = step * INTERVAL_S
        true -= deceleration * INTERVAL_S
        active = time > 5.0
        if active:  # both axles slide away slowly, more and more; a vented one rolls
            creepage = min(creepage + 0.02 * INTERVAL_S, 0.5)
        speeds = np.where(commands[0] < 0.0, true, true * (1.0 - creepage))
        wheels.update(measured(time, speeds), commands, np.array([active]))
        commands = np.where(wheels.released, -1.0, 1.0)
        asked |= bool(wheels.released.any())
        assert abs(wheels.reference[0] - true) < 1.0
    assert asked


def lost(stands):
    """Return a reference that was last renewed long ago; wheels that `stands` have been vented, longer than the others."""
    wheels = ReferenceSpeed(ReferenceParameters(), 1, BOGIE)
    speeds = np.full(2, 30.0)
    for step in range(400):
        slows = stands & (step > 50)  # once it is known how fast the wheels roll
        speeds = np.where(slows, np.maximum(speeds - 1.0, 0.0), 30.0)  # 50 m/s2: no sensor fault
        command = np.where(slows, -1.0, 1.0)[None]
        wheels.update(measured(step * INTERVAL_S, speeds), command, np.ones(1, dtype=bool))
    return wheels


@pytest.mark.parametrize("standing", [0, 1])
def test_a_wheel_that_stands_though_vented_is_not_asked_for_the_running_speed(standing):
    """Its valve may be stuck: waiting for it to roll, the running speed would never be renewed."""
    stands = np.arange(2) == standing
    wheels = lost(stands)
    assert_array_equal(wheels.standing, stands[None])
    assert_array_equal(wheels.released, ~stands[None])


def test_where_all_wheels_stand_one_of_them_is_released():
    wheels = lost(np.ones(2, dtype=bool))
    assert wheels.standing.all()
    assert wheels.released.sum() == 1


def test_set_point_is_held_and_recovers_more_adhesion_when_it_is_deeper():
    stops = [make_stop(BOGIE, 0.03, 3e-4, 40.0)]
    shallow, deep = (drive(SlipController(SlipParameters(creepage=c)), BOGIE, stops)[0] for c in (0.05, 0.2))
    assert deep.state.position[0] < 0.9 * shallow.state.position[0]


@pytest.mark.parametrize("make", PROTECTING)
@pytest.mark.parametrize("wear_m", [0.005, 0.015, 0.025])
def test_a_worn_wheelset_on_a_clean_rail_is_left_alone(make, wear_m):
    radii = [BOGIE.wheel_radius_m, BOGIE.wheel_radius_m - wear_m]
    _, commands, _ = drive(make(), BOGIE, [make_stop(BOGIE, 0.25, 0.0, 40.0, radius=radii)])
    assert (commands[: int(0.9 * len(commands))] == 1.0).all()
