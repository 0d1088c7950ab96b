"""The running speed's filter: what it learns of the distributor's rise, and that its covariances are those of something."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from agents.measure import low_adhesion
from baselines.adaptive import AdaptiveController
from wsp_env.evaluation.runner import Conduct, measure, start_plant
from wsp_env.observer import bounds, running_speed
from wsp_env.observer.estimate import allocate, constants
from wsp_env.observer.observation import Observer
from wsp_env.parameters.uic_z1 import BOGIE, WHEELSET
from wsp_env.plant.port import Measurement

INTERVAL_S = 0.02


def rising(seconds, vehicle=BOGIE):
    """Return a vehicle whose distributor takes this time [s]."""
    return dataclasses.replace(vehicle, brake=dataclasses.replace(vehicle.brake, demand_rise_s=seconds))


def braked(rise_s, noise, seconds, mu_cd=0.1):
    """Brake eight bogies with open valves, whose distributors take `rise_s`; return plant and observer, which assumes 4 s."""
    drawn = low_adhesion(BOGIE, "classic", 8, 3)
    mass = BOGIE.mass_kg + 0.5 * BOGIE.payload_kg
    stops = [dataclasses.replace(s, noise=noise, mass=mass, mu_cd=mu_cd, initial_speed=40.0) for s in drawn]
    plant, observer = start_plant(rising(rise_s), stops, Conduct()), Observer(BOGIE, INTERVAL_S)
    observer.reset(measure(plant))
    opened = np.ones((plant.n, BOGIE.axles))
    for _ in range(round(seconds / INTERVAL_S)):
        plant.step(opened)
        observer.observe(measure(plant), opened)
    return plant, observer


@pytest.mark.parametrize("rise_s", [3.2, 4.0, 4.9])
def test_the_rise_of_the_distributor_is_learnt_while_the_wheels_still_roll(rise_s):
    """Within its own deviation, and towards the truth; another force takes the rest, so that the running speed is right."""
    plant, observer = braked(rise_s, 0.05, 1.6)
    e, true = observer.estimate, np.log(rise_s / BOGIE.brake.demand_rise_s)
    assert (np.abs(e.rise - true) < 2.0 * np.sqrt(e.rise_variance)).all()
    assert np.abs(np.mean(e.rise) - true) < max(0.95 * abs(true), 0.02)
    assert_allclose(e.speed, plant.truth().speed, atol=0.1)
    assert (e.rise_variance < running_speed.RISE_DEVIATION**2).all()
    share = plant.truth().pressure / BOGIE.brake.full_pressure_bar
    assert_allclose(np.mean(np.log(e.pressure / share)), true - np.mean(e.rise), atol=0.02)


def test_a_brake_that_rises_slowly_does_not_pass_for_a_heavy_vehicle():
    """Once all of the demand has come, the mass is that of the vehicle; the running speed was never lost."""
    plant, observer = braked(4.9, 0.05, 8.0)
    assert_allclose(observer.estimate.mass_ratio, 1.0, atol=0.05)
    assert_allclose(observer.estimate.speed, plant.truth().speed, atol=0.25)


def test_a_slide_too_small_to_be_seen_is_not_taken_for_the_vehicle_while_the_controller_holds_it():
    """Half the demand: the wheels slid by 1 % for a minute, the mass was learnt as 0.83 and the speed as 4 m/s too low."""
    drawn = low_adhesion(BOGIE, "classic", 1, 3)
    stops = [dataclasses.replace(drawn[0], mu_cd=0.0226, demand=0.5, mass=21500.0, noise=0.06, initial_speed=44.4)]
    plant, controller = start_plant(BOGIE, stops, Conduct()), AdaptiveController()
    controller.reset(1, BOGIE)
    wrong = []
    while plant.truth().speed[0] > 12.0:
        plant.step(controller.act(measure(plant)))
        if controller._begun:
            wrong.append(controller._observer.estimate.speed[0] - plant.truth().speed[0])
    assert np.abs(wrong).max() < 0.5


def test_with_measured_pressures_the_rise_is_not_learnt():
    """The forces do not depend on it; a pressure above the full one is believed, too."""
    observer, n = Observer(WHEELSET, INTERVAL_S, pressure_sensors=True), 4
    speed = np.full((n, 1), 60.0)
    observer.reset(Measurement(np.zeros(n), speed, np.ones(n)))
    for tick in range(100):
        pressure = np.full((n, 1), 0.042 * tick)
        observer.observe(Measurement(np.full(n, tick * INTERVAL_S), speed - 0.02 * tick, np.ones(n), pressure), np.ones((n, 1)))
    assert (observer.estimate.rise == 0.0).all()
    assert_allclose(observer.estimate.pressure, pressure / WHEELSET.brake.full_pressure_bar)


@pytest.mark.parametrize("by_pressure", [False, True])
def test_the_derivative_of_a_pressure_is_the_difference_between_two_rises(by_pressure):
    """Of distributor and cylinder, under commands at random, while nothing is learnt (central difference)."""
    rng, step = np.random.default_rng(5), 1e-4
    levels = rng.uniform(-1.0, 1.0, 20) if by_pressure else rng.integers(-1, 2, 20).astype(float)
    commands = np.repeat(levels, rng.integers(2, 12, 20))
    nominal, found = BOGIE.brake.demand_rise_s, []
    for factor in (np.exp(-step), 1.0, np.exp(step)):
        observer = Observer(rising(nominal * factor), INTERVAL_S, by_pressure=by_pressure)
        observer.reset(Measurement(np.zeros(1), np.full((1, 2), 80.0), np.ones(1)))
        observer.estimate.rise_variance[0] = 0.0
        history = []
        for tick, command in enumerate(commands):
            now = Measurement(np.full(1, tick * INTERVAL_S), np.full((1, 2), 80.0), np.ones(1))
            observer.observe(now, np.full((1, 2), command))
            e = observer.estimate
            history.append([e.pressure[0, 0], e.distributor[0], e.pressure_by_rise[0, 0], e.distributor_by_rise[0]])
        found.append(np.array(history))
    less, middle, more = found
    rises = middle[:, 1] < 0.99
    assert rises.sum() > 20
    assert_allclose(middle[rises, 2:], (more - less)[rises, :2] / (2.0 * step), atol=2e-3)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.floats(0.0, 0.05), st.floats(-0.05, 0.05), st.sampled_from(["no", "roll", "unsure"]), st.floats(-3.0, 3.0)
        ),
        min_size=1,
        max_size=60,
    )
)
def test_covariances_stay_those_of_something(steps):
    """Whatever is predicted, corrected and doubted: no variance is negative, no correlation beyond one."""
    e, c = allocate(1, BOGIE, INTERVAL_S), constants(BOGIE, INTERVAL_S, False)
    running_speed.begin(0, 30.0, e)
    for slowed, by_rise, kind, missing in steps:
        running_speed.predict(0, slowed, by_rise, e, c)
        if kind != "no":
            running_speed.correct(0, e.speed[0] + missing, 0.1, kind == "roll", e)
        v, q, r = e.speed_variance[0], e.mass_variance[0], e.rise_variance[0]
        vq, vr, qr = e.covariance[0], e.rise_speed[0], e.rise_mass[0]
        a, va, qa, ra = e.other_variance[0], e.other_speed[0], e.other_mass[0], e.other_rise[0]
        matrix = np.array([[v, vq, vr, va], [vq, q, qr, qa], [vr, qr, r, ra], [va, qa, ra, a]])
        scale = np.sqrt(np.diag(matrix))
        assert (np.diag(matrix) >= 0.0).all()
        assert np.linalg.eigvalsh(matrix / np.outer(scale, scale)).min() > -1e-6
        assert running_speed.MASS_RANGE[0] <= e.mass_ratio[0] <= running_speed.MASS_RANGE[1]
        assert abs(e.rise[0]) <= np.log(bounds.RISES_FASTER) + 1e-12


@pytest.mark.parametrize("gradient", [-0.01, 0.01])
def test_a_gradient_passes_for_a_force_and_not_for_a_mass(gradient):
    """Found before a wheel slides to half of it at least, kept with a brake released; the mass is that of the vehicle."""
    drawn = low_adhesion(BOGIE, "classic", 8, 3)
    mass = BOGIE.mass_kg + 0.5 * BOGIE.payload_kg
    stops = [dataclasses.replace(s, gradient=gradient, noise=0.05, mass=mass, mu_cd=0.1, initial_speed=40.0) for s in drawn]
    plant, observer = start_plant(BOGIE, stops, Conduct()), Observer(BOGIE, INTERVAL_S)
    observer.reset(measure(plant))
    for seconds, command in ((5.0, 1.0), (1.5, -1.0), (4.0, 1.0)):
        commands = np.full((plant.n, BOGIE.axles), command)
        for _ in range(round(seconds / INTERVAL_S)):
            plant.step(commands)
            observer.observe(measure(plant), commands)
    e = observer.estimate
    resisted = gradient * BOGIE.gravity_mps2
    assert_allclose(np.mean(e.other), resisted, atol=0.5 * abs(resisted))
    assert_allclose(e.mass_ratio, 1.0, atol=0.05)
    assert_allclose(e.speed, plant.truth().speed, atol=0.25)


def test_distrust_forgets_the_mass_and_doubts_the_speed():
    e, c = allocate(1, BOGIE, INTERVAL_S), constants(BOGIE, INTERVAL_S, False)
    running_speed.begin(0, 30.0, e)
    for _ in range(200):
        running_speed.predict(0, 0.02, -0.01, e, c)
    running_speed.correct(0, e.speed[0] + 0.3, 0.1, True, e)
    assert e.mass_ratio[0] != 1.0
    assert e.other[0] != 0.0
    running_speed.distrust(0, 1.0, e)
    assert (e.mass_ratio[0], e.other[0]) == (1.0, 0.0)
    assert e.speed_variance[0] >= 1.0
    assert e.covariance[0] == e.rise_speed[0] == e.rise_mass[0] == 0.0
    assert e.other_speed[0] == e.other_mass[0] == e.other_rise[0] == 0.0
