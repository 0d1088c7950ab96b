"""The statics of the load transfer: moments in balance, and the wheel loads of the coach in three dimensions."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose
from plant_cases import a_stop

from wsp_env.parameters.uic_z1 import BOGIE, COACH
from wsp_env.plant.longitudinal.along import Belief, Trajectory, along, model
from wsp_env.plant.mechanisms.load_transfer import Driven, Parameters, derive, steadily, wheel_load
from wsp_env.plant.multibody.plant import MultibodyPlant
from wsp_env.plant.port import Setup

M = COACH.multibody
OWN = Parameters(M.carbody_height_m - M.drawing_height_m, M.drawing_height_m)  # the coach's own heights
SAMPLE_S = 0.01


def loads(vehicle, force, turning, deceleration, p=OWN):
    """Change of the load of each axle's wheels (A,) [N]."""
    driven = Driven(np.array([force]), np.array([turning]))
    lever = derive(vehicle)
    return np.array(
        [wheel_load(p, lever, driven, 0, k, 1e6, vehicle.mass_kg, deceleration) - 1e6 for k in range(vehicle.axles)]
    )


def test_the_moments_of_every_body_are_in_balance():
    """At the vehicle's own heights: about the rail, bodies one by one, whatever each wheelset does."""
    rng = np.random.default_rng(1)
    force, turning, slowing = rng.uniform(0.0, 2e4, 4), rng.uniform(-1e4, 1e4, 4), 1.1
    change = loads(COACH, force, turning, slowing)
    wheelset = M.wheelset_mass_kg + 2.0 * M.axle_box_mass_kg
    body = M.carbody_kg(COACH.mass_kg, COACH.axles) * slowing * OWN.body_height_m
    places, centres = np.array(COACH.axle_positions_m), np.repeat([1.28, 20.28], 2)
    assert_allclose(change.sum(), 0.0, atol=1e-6)
    assert_allclose(-2.0 * change @ centres, body, rtol=1e-9)
    for own in (slice(0, 2), slice(2, 4)):
        pulled = force[own].sum() - slowing * (M.bogie_mass_kg + 2.0 * wheelset)  # by the body
        moment = pulled * M.drawing_height_m - turning[own].sum()
        moment += slowing * (M.bogie_mass_kg * M.bogie_height_m + 2.0 * wheelset * COACH.wheel_radius_m)
        assert_allclose(-2.0 * change[own] @ (places[own] - places[own].mean()), moment, rtol=1e-9)


def test_alike_braked_axles_that_roll_shift_load_with_the_deceleration_alone():
    slowing = 0.9
    turning = np.full(4, -COACH.wheelset_inertia_kgm2 * slowing / COACH.wheel_radius_m)
    force = np.full(4, COACH.mass_kg * slowing / 4)
    for p in (OWN, Parameters(1.0, 0.0), Parameters(0.0, 0.5)):
        assert_allclose(loads(COACH, force, turning, slowing, p), slowing * steadily(p, COACH), rtol=1e-9)


def test_a_vehicle_lighter_than_its_bogies_has_no_body_to_pitch():
    light = dataclasses.replace(BOGIE, mass_kg=4000.0, payload_kg=0.0)
    assert (derive(light).body == 0.0).all()
    assert np.isfinite(steadily(OWN, light)).all()


@pytest.mark.long
def test_it_is_the_wheel_loads_of_the_coach_in_three_dimensions():
    """Nothing fitted: heights, masses and inertia are the vehicle's. Axles brake and are released in turn, bogies unlike."""
    plant = MultibodyPlant(COACH, 1, Setup(SAMPLE_S))
    plant.start(0, a_stop(COACH, mu_cd=0.08, initial_speed=30.0))
    kept = []
    for step in range(round(9.0 / SAMPLE_S)):
        phase = (step + np.array([0, 40, 90, 200])) % 260
        plant.step(np.where(phase < [30, 30, 30, 90], -1.0, 1.0)[None])
        s = plant.state
        torque = COACH.brake.torque_per_bar_nm * s.brake.pressure[0]
        one = (s.time[0], s.speed[0], -s.deceleration[0], s.position[0])
        kept.append(np.concatenate([one, s.wheel_speed[0], s.wheel_rate[0], torque, plant.bodies.wheel_load[0].mean(axis=1)]))
    time, speed, rate, place, *wheels = np.array(kept).T
    wheel, wheel_rate, torque, true = (np.array(wheels[4 * n : 4 * n + 4]).T for n in range(4))
    measured = Trajectory(time, speed, rate, place, wheel, wheel_rate, torque)
    belief = Belief(0.08, 1e-4, COACH.mass_kg, COACH.wheel_radius_m)
    said = along(measured, belief, model(COACH, {"load_transfer": OWN._asdict()})).wheel_load_n
    braked = time > 4.0
    moved = (true - COACH.static_wheel_load_n)[braked]
    left = (true - said)[braked]
    assert np.sqrt(np.mean(moved**2)) > 1500.0
    assert np.sqrt(np.mean(left**2)) < 0.06 * np.sqrt(np.mean(moved**2))
    of_vehicle = rate[braked, None] * steadily(OWN, COACH)  # by the deceleration alone, as if all axles did the same
    assert np.sqrt(np.mean((moved + of_vehicle) ** 2)) > 4.0 * np.sqrt(np.mean(left**2))
