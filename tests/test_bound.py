"""The bound: against an independent integral, against known values, and never beaten by a stop within the slide limit."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wsp_env.contact.degraded import degraded_adhesion
from wsp_env.evaluation.bound import SlideLimit, best_adhesion, ceiling
from wsp_env.evaluation.figures import figures
from wsp_env.evaluation.reference import perfect_knowledge
from wsp_env.evaluation.runner import Conduct, measure, record, start_plant
from wsp_env.parameters.uic_z1 import BOGIE, COACH, WHEELSET
from wsp_env.plant.command import share_of_pressure
from wsp_env.plant.port import Stop
from wsp_env.scenario import Scenario, draw

LAW = WHEELSET.contact.law


def stop(vehicle=WHEELSET, seed: int = 0, nodes: int = 500, **pins) -> Stop:
    conditions = {"initial_speed": 30.0, "demand": 1.0, "track": "constant", "load": 0.0, "gradient": 0.0} | pins
    return draw(Scenario(), vehicle, np.random.default_rng(seed), nodes, conditions)


def by_quadrature(vehicle, conditions: Stop, limit: SlideLimit) -> float:
    """The integral of v / a dv, with the capacity and the law's largest value written down once more."""
    load = conditions.mass * vehicle.gravity_mps2 / (2 * vehicle.axles)
    radius = vehicle.wheel_radius_m
    capacity = conditions.demand * vehicle.full_brake_torque_nm * vehicle.axles / radius
    capacity /= conditions.mass + vehicle.axles * vehicle.wheelset_inertia_kgm2 / radius**2
    v = np.linspace(0.02, conditions.initial_speed, 1500)
    creepage = np.geomspace(1e-4, 1.0, 2000)[:, None]
    allowed = creepage <= np.where(v > limit.above_mps, limit.creepage, 1.0)
    f = degraded_adhesion(creepage * v, v, load, conditions.mu_cd, conditions.tau, vehicle.contact.law)
    a = np.minimum(capacity, vehicle.gravity_mps2 * np.where(allowed, f, 0.0).max(axis=0))
    return float(np.trapezoid(v / a, v))


def capped(share_of_g: float):
    """A wheelset whose brake alone gives this share of g, with next to no rotating inertia."""
    torque = share_of_g * WHEELSET.gravity_mps2 * WHEELSET.mass_kg * WHEELSET.wheel_radius_m
    brake = dataclasses.replace(WHEELSET.brake, torque_per_bar_nm=torque / WHEELSET.brake.full_pressure_bar)
    return dataclasses.replace(WHEELSET, brake=brake, wheelset_inertia_kgm2=1e-6)


@pytest.mark.parametrize(("creepage", "metres"), [(0.05, 1198.0), (0.2, 1080.0), (0.3, 854.0), (1.0, 457.0)])
def test_known_stops(creepage, metres):
    """From 42.3 m/s with the demand capped at 0.2 g, mu_cd 0.03, tau 1.9e-4 m/J: values found with another programme."""
    vehicle = capped(0.2)
    distance, _ = ceiling(
        vehicle, [stop(vehicle, mu_cd=0.03, tau=1.9e-4, initial_speed=42.3)], SlideLimit(creepage, 0.0)
    ).shortest()
    assert distance[0] == pytest.approx(metres, rel=0.005)


@pytest.mark.parametrize("mu_cd", [0.02, 0.05, 0.2])
@pytest.mark.parametrize("tau", [0.0, 2e-4])
@pytest.mark.parametrize("demand", [0.4, 1.0])
def test_agrees_with_the_integral(mu_cd, tau, demand):
    """Where the brake is limited by one thing throughout, or by the adhesion first: no momentum is given back then."""
    conditions = stop(COACH, mu_cd=mu_cd, tau=tau, demand=demand, initial_speed=40.0)
    distance, _ = ceiling(COACH, [conditions]).shortest()
    integral = by_quadrature(COACH, conditions, SlideLimit())
    assert distance[0] == pytest.approx(integral, rel=0.01)
    assert distance[0] <= integral * 1.0005


@given(st.floats(1.0, 55.0), st.floats(0.02, 0.15), st.floats(0.0, 4e-4), st.floats(0.05, 1.0), st.floats(0.0, 1.0))
@settings(max_examples=60)
def test_best_adhesion_is_the_largest_of_all(speed, mu_cd, tau, limit, film):
    best, slip = best_adhesion(speed, limit * speed, 53e3, mu_cd, tau, LAW, film)
    tried = degraded_adhesion(limit * speed * np.linspace(0.0, 1.0, 20001), speed, 53e3, mu_cd, tau, LAW, film)
    assert best >= tried.max() * (1.0 - 1e-6)
    assert 0.0 < slip <= limit * speed * (1.0 + 1e-12)
    assert degraded_adhesion(slip, speed, 53e3, mu_cd, tau, LAW, film) == pytest.approx(best, rel=1e-9)


CONDITIONS = st.fixed_dictionaries({
    "mu_cd": st.floats(0.02, 0.12), "tau": st.sampled_from([0.0, 1e-4, 4e-4]), "initial_speed": st.floats(5.0, 18.0),
    "demand": st.floats(0.1, 1.0), "gradient": st.floats(0.0, 0.02), "load": st.floats(0.0, 1.0),
})  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", [WHEELSET, pytest.param(BOGIE, marks=pytest.mark.long)])
@pytest.mark.parametrize("quick", [pytest.param(False, marks=pytest.mark.long), True], ids=["real brake", "instant brake"])
@given(data=st.data())
@settings(max_examples=3)
def test_never_beaten_within_the_limit(vehicle, quick, data):
    """Under random conditions, commands by chance and by feedback: a stop within the slide limit at every step is longer."""
    if quick:
        brake = dataclasses.replace(
            vehicle.brake, demand_rise_s=0.01, fill_time_constant_s=0.01, vent_time_constant_s=0.01, dead_time_s=0.0
        )
        vehicle = dataclasses.replace(vehicle, brake=brake)
    track = data.draw(st.sampled_from(["constant", "patches", "varying"]), "track")
    drawn = data.draw(st.lists(CONDITIONS, min_size=24, max_size=24), "conditions")  # side by side: steps cost little more
    seed = data.draw(st.integers(0, 1000), "seed")
    nodes = 120 if track == "varying" else 500
    stops = [stop(vehicle, seed + i, nodes, track=track, **one) for i, one in enumerate(drawn)]
    top = ceiling(vehicle, stops)
    shortest, _ = top.shortest()
    controller = Fickle(top, seed)
    conduct = Conduct(control_interval_s=0.005, time_limit_s=400.0)
    plant = start_plant(vehicle, stops, conduct, by_pressure=True)
    controller.reset(len(stops), vehicle)
    result = record(plant, lambda: share_of_pressure(controller.act(measure(plant))), conduct)
    inside = ~violates(result, top.limit) & result.stopped
    assert (result.distance[inside] >= shortest[inside]).all()


def violates(result, limit: SlideLimit) -> np.ndarray:
    """Return who (N,) was beyond the limit at any step."""
    return (result.slip > limit.slip(result.speed)[..., None] + 1e-9).any(axis=(0, 2))


class Fickle:
    """Half its stops are braked by chance, the others by holding the slip near a set-point that changes by chance."""

    def __init__(self, top, seed):
        self.top, self.rng = top, np.random.default_rng(seed)

    def reset(self, n, vehicle):
        self.radius, self.command = vehicle.wheel_radius_m, np.ones((n, vehicle.axles))
        self.share, self.speed = np.full((n, vehicle.axles), 0.1), None

    def act(self, measurement):
        wheels = self.radius * measurement.wheel_speed
        fastest, held = wheels.max(axis=1), slice(len(wheels) // 2, None)
        # as far as the wheels tell
        self.speed = fastest if self.speed is None else np.maximum(fastest, self.speed - 0.005 * 1.5)
        if self.rng.random() < 0.02:
            self.share = self.rng.uniform(0.0, 0.28, wheels.shape)
            self.command[: held.start] = self.rng.uniform(-1.0, 1.0, (held.start, wheels.shape[1]))
        speed = self.speed[held, None]
        feedback = 20.0 * (self.share[held] - (speed - wheels[held]) / np.maximum(speed, 1.0))
        self.command[held] = np.minimum(np.maximum(feedback, -1.0), 1.0)
        return self.command


def test_a_stop_beyond_the_limit_may_be_shorter_and_is_marked():
    """Under the recovering law a large slide dries the rail: shorter than the bound, but not within the limit."""
    conditions = [stop(COACH, mu_cd=0.02, tau=1.9e-4, initial_speed=44.4, nodes=1000)]
    top = ceiling(COACH, conditions)
    plant = start_plant(COACH, conditions, Conduct())
    result = record(plant, lambda: np.ones((1, 4)), Conduct())
    assert result.distance[0] < top.shortest()[0][0]
    assert figures(result, top)["beyond_limit_s"][0] > 1.0
    assert violates(result, top.limit)[0]


@pytest.mark.parametrize("tau", [0.0, 1.9e-4])
def test_perfect_knowledge_is_near_the_bound_and_within_the_limit(tau):
    conditions = [stop(BOGIE, mu_cd=mu_cd, tau=tau, initial_speed=40.0, nodes=1000) for mu_cd in (0.02, 0.03, 0.05)]
    top = ceiling(BOGIE, conditions)
    result = perfect_knowledge(BOGIE, conditions, top, Conduct())
    shortest, _ = top.shortest()
    assert not violates(result, top.limit).any()
    assert (result.distance >= shortest).all()
    filling = 0.5 * BOGIE.brake.demand_rise_s * 40.0  # what a linear build-up of the brake costs at most [m]
    assert (result.distance <= 1.1 * shortest + filling).all()


def test_a_vehicle_that_the_rail_cannot_hold_runs_on():
    distance, duration = ceiling(WHEELSET, [stop(mu_cd=0.005, tau=0.0, gradient=-0.05)]).shortest()
    assert np.isinf(distance[0])
    assert np.isinf(duration[0])


def test_capacity_of_a_coach_on_two_kinds_of_rail():
    """The leading axles on film give what it holds, the others what their brake does beside slowing their wheels."""
    conditions = stop(COACH, mu_cd=0.02, tau=0.0)
    coverage = np.zeros(500)
    coverage[20:] = 1.0  # from 100 m on
    top = ceiling(COACH, [dataclasses.replace(conditions, coverage=coverage)])
    speed, position = np.array([[20.0]]), np.array([[108.0]])  # axles at 108, 105.4, 89, 86.4 m
    force = top.capacity(speed, position)[0, 0]
    best, _ = top.at(speed, position)
    load = COACH.mass_kg * COACH.gravity_mps2 / 4
    np.testing.assert_allclose(force[:2], best[0, 0, :2] * load)
    deceleration = force.sum() / COACH.mass_kg
    radius = COACH.wheel_radius_m
    braked = COACH.full_brake_torque_nm / radius - COACH.wheelset_inertia_kgm2 / radius**2 * deceleration
    np.testing.assert_allclose(force[2:], braked)
