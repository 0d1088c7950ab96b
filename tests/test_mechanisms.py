"""Every mechanism alike: it vanishes at its null, acts at its typical values, forward as along, and is found again."""

import functools
import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from plant_cases import a_stop, plant_of
from reference_stops import NAMES, effect, reference_stops, smallest_effect
from scipy.optimize import least_squares
from scipy.special import lambertw

from wsp_env.contact.degraded import degraded_adhesion
from wsp_env.contact.recovery import _WORK_FLOOR, kept_by_shape
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.uic_z1 import BOGIE, COACH
from wsp_env.plant.card import Passage
from wsp_env.plant.longitudinal.along import Belief, Trajectory, along, model
from wsp_env.plant.mechanisms import ALL, NULL, leading_axle_cleaning, make, misread_wheel, wheel_speed_lag

every = pytest.mark.parametrize("name", ALL)
STEP_S = 0.01
FAST_MPS = 5.0
#: What a balance, or several, of the four must be named by.
BALANCES = ("vehicle", "adhesion", "kinematics", "actuator")


def null(name):
    """Sizes null, shapes and axles as when it is on."""
    return {one.name: one.null if one.kind == "size" else one.typical for one in ALL[name].parameters}


def typical(name):
    return {one.name: one.typical for one in ALL[name].parameters}


@pytest.fixture(scope="module")
def plain():
    return reference_stops(COACH)


@functools.lru_cache(maxsize=len(ALL) + 1)
def recorded(name=None):
    """The sliding reference stop as a trajectory, with the adhesion that the plant had at each of its samples."""
    choice = {name: typical(name)} if name else {}
    stops = reference_stops(COACH, choice, STEP_S)
    i = NAMES.index("sliding")
    samples = int((stops.speed_mps[:, i] > FAST_MPS).sum())
    wheel = stops.wheel_speed_radps[:, i]
    if name == "wheel_speed_lag":  # without the pulses' resolution
        p = wheel_speed_lag.Parameters(**choice[name])
        read = wheel.copy()
        for j in range(1, len(read)):
            read[j] = [wheel_speed_lag.reading(p, wheel[j, k], read[j - 1, k], wheel[j - 1, k], STEP_S) for k in range(4)]
        wheel = read
    if name == "misread_wheel":
        p, radius = misread_wheel.Parameters(**choice[name]), COACH.wheel_radius_m
        read = [[misread_wheel.reading_factor(p, k, radius * w, 0.0) * w for k, w in enumerate(row)] for row in wheel]
        wheel = np.array(read)
    speed = stops.recorded_speed_mps[:, i]
    trajectory = Trajectory(
        time_s=stops.time_s[:samples],
        speed_mps=speed[:samples],
        acceleration_mps2=np.gradient(speed, STEP_S)[:samples],
        position_m=stops.position_m[:samples, i],
        wheel_speed_radps=wheel[:samples],
        wheel_acceleration_radps2=np.gradient(wheel, STEP_S, axis=0)[:samples],
        brake_torque_nm=stops.nominal_torque_nm[:samples, i],
    )
    return trajectory, stops.adhesion[1 : samples + 1, i]  # the plant's is that at the start of its last substep


@pytest.fixture(scope="module")
def trajectory():
    return recorded()[0]


RUN = Belief(mu_cd=0.035, tau=1.9e-4, mass_kg=COACH.mass_kg, radius_m=COACH.wheel_radius_m)


@every
def test_says_what_it_is(name):
    mechanism = ALL[name]
    assert mechanism.record._fields == tuple(one.name for one in mechanism.parameters)
    assert mechanism.sizes
    assert mechanism.signature.balances
    assert mechanism.signature.balances <= set(BALANCES)
    for one in mechanism.parameters:
        assert one.low <= one.null <= one.high
        assert one.low <= one.typical <= one.high
        assert one.unit
        assert one.source
        assert one.kind in ("size", "shape", "axle", "stop")
    assert any(one.typical != one.null for one in mechanism.sizes)


@every
def test_vanishes_forward_at_its_null(name, plain):
    stops = reference_stops(COACH, {name: null(name)})
    for field in stops.__dataclass_fields__:
        assert_array_equal(getattr(stops, field), getattr(plain, field), err_msg=field)


@every
def test_vanishes_along_at_its_null(name, trajectory):
    off = along(trajectory, RUN, model(COACH, {name: null(name)}))
    for got, expected in zip(off, along(trajectory, RUN, model(COACH)), strict=True):
        assert_array_equal(got, expected)


@every
def test_acts_forward_at_its_typical_values(name, plain):
    moved = effect(reference_stops(COACH, {name: typical(name)}), plain, COACH.wheel_radius_m)
    assert math.isfinite(moved)
    assert moved > 0.1


def sizes():
    return [(name, one) for name, mechanism in ALL.items() for one in mechanism.sizes]


@pytest.mark.parametrize(("name", "size"), sizes(), ids=lambda value: value if isinstance(value, str) else value.name)
def test_every_size_acts_along(name, size, trajectory):
    """The derivative by a size, at its typical value, is finite and not zero; and it does not jump there."""
    step = 1e-4 * (size.typical - size.null or size.high - size.null)

    def prediction(value):
        return along(trajectory, RUN, model(COACH, {name: typical(name) | {size.name: value}}))

    at, near, nearer = (prediction(size.typical + share * step) for share in (0.0, 1.0, 0.5))
    moved = [np.abs(b - a).max() for a, b in zip(at, near, strict=True)]
    half = [np.abs(b - a).max() for a, b in zip(at, nearer, strict=True)]
    assert all(np.isfinite(value).all() for value in near)
    assert max(moved) > 0.0
    assert_allclose(half, np.array(moved) / 2, rtol=0.05, atol=1e-12)


@every
def test_is_causal(name, trajectory):
    """Another future leaves the past as it was."""
    now = 1500
    rng = np.random.default_rng(3)
    changed = {}
    for field in ("speed_mps", "acceleration_mps2", "wheel_speed_radps", "wheel_acceleration_radps2", "brake_torque_nm"):
        changed[field] = getattr(trajectory, field).copy()
        changed[field][now:] *= rng.uniform(0.5, 1.5, changed[field][now:].shape)
    other = Trajectory(**({field: getattr(trajectory, field) for field in trajectory.__dataclass_fields__} | changed))
    p = model(COACH, {name: typical(name)})
    before, after = along(trajectory, RUN, p), along(other, RUN, p)
    for a, b in zip(before[:9], after[:9], strict=True):
        assert_array_equal(a[:now], b[:now])
    assert not np.array_equal(before.adhesion[now:], after.adhesion[now:])


@every
def test_forward_and_along_agree(name):
    """Along the plant's own trajectory the same parameters give the plant's adhesion, but for the sampling."""
    choice = {name: typical(name)}
    measured, adhesion = recorded(name)
    predicted = along(measured, RUN, model(COACH, choice)).adhesion
    error = np.sqrt(np.mean((predicted - adhesion) ** 2) / np.mean(adhesion**2))
    without = along(measured, RUN, model(COACH)).adhesion
    assert error < 0.005
    wheel_only = set(ALL[name].acts) <= {"torque_factor", "torque", "inertia", "after_passage"}
    if "adhesion" in ALL[name].signature.balances and name != "discovered" and not wheel_only:
        assert error < 0.2 * np.sqrt(np.mean((without - adhesion) ** 2) / np.mean(adhesion**2))


@every
def test_wheel_and_vehicle_balance_along(name):
    """Forces, factors and masses of a prediction close the vehicle's and the wheels' balances of the plant's own stop."""
    choice = {name: typical(name)}
    measured, _ = recorded(name)
    said = along(measured, RUN, model(COACH, choice))
    rate = np.gradient(said.wheel_speed_radps, STEP_S, axis=0)
    force = (said.torque_nm + said.inertia_kgm2 * rate) / said.radius_m
    braking = said.mass_kg * np.gradient(said.speed_mps, STEP_S)
    smooth = np.ones(20) / 20
    rest = np.convolve(braking + force.sum(axis=1) + said.resistance_n, smooth, "valid")
    assert np.sqrt(np.mean(rest**2)) < 0.005 * np.sqrt(np.mean(braking**2))


def residuals(measured, choice):
    """Residuals of the four axles' adhesion (T, 4) and of the vehicle's balance over its weight, both [-], in a row."""
    said = along(measured, RUN, model(COACH, choice))
    rate = np.gradient(said.wheel_speed_radps, STEP_S, axis=0)
    force = (said.torque_nm + said.inertia_kgm2 * rate) / said.radius_m
    rest = said.mass_kg * np.gradient(said.speed_mps, STEP_S) + force.sum(axis=1) + said.resistance_n
    vehicle = np.convolve(rest, np.ones(20) / 20, "valid") / (said.mass_kg * COACH.gravity_mps2)
    return np.concatenate([(force / (2.0 * said.wheel_load_n) - said.adhesion).ravel(), vehicle])


@every
def test_recovers_its_own_parameters(name):
    """Least squares along the plant's own stop, from next to nothing, give back the sizes that the stop was braked with."""
    measured, _ = recorded(name)
    sought = [one for one in ALL[name].sizes if one.typical != one.null]

    def at(shares):
        values = {one.name: one.null + share * (one.typical - one.null) for one, share in zip(sought, shares, strict=True)}
        return residuals(measured, {name: typical(name) | values})

    ends = np.sort([[(end - one.null) / (one.typical - one.null) for end in (one.low, one.high)] for one in sought])
    start = np.full(len(sought), 1e-3)
    found = least_squares(at, start, diff_step=1e-3, bounds=(ends[:, 0] - 1e-9, ends[:, 1]))
    assert_allclose(found.x, 1.0, atol=0.03)
    assert found.cost < 0.05 * 0.5 * (at(start) ** 2).sum()


@every
def test_energy_is_conserved(name):
    vehicle = COACH
    plant = plant_of(vehicle, 2, mechanisms={name: typical(name)})
    for i, mu_cd in enumerate((0.03, 0.1)):
        plant.start(i, a_stop(vehicle, mu_cd=mu_cd, gradient=0.002))
    rng = np.random.default_rng(1)
    before = plant.kinetic_energy
    command = np.ones((2, vehicle.axles))
    for _ in range(800):
        command[rng.random(command.shape) < 0.05] = rng.choice([-1.0, 0.0, 1.0])
        plant.step(command)
        work = plant.state.brake_work + plant.state.contact_work.sum(axis=1) + plant.state.resistance_work
        error = np.abs(before - plant.kinetic_energy - work) / before
        assert (error < np.where(plant.moving, 1e-10, 1e-5)).all()


@every
def test_refuses_impossible_values(name):
    for one in ALL[name].parameters:
        for value in (one.low - 1.0, one.high + 1.0, math.nan, "much"):
            with pytest.raises(ParameterError, match=one.name):
                make({name: {one.name: value}})
        if one.whole:
            with pytest.raises(ParameterError, match="whole number"):
                make({name: {one.name: 1.5}})
        if one.kind == "axle":
            with pytest.raises(ParameterError, match="the vehicle has 2"):
                plant_of(BOGIE, mechanisms={name: {one.name: 3.0}})
    with pytest.raises(ParameterError, match="no parameter colour"):
        make({name: {"colour": 1.0}})


def test_refuses_what_it_does_not_know():
    with pytest.raises(ParameterError, match="unknown mechanism ghosts; valid: leading_axle_cleaning"):
        make({"ghosts": {}})
    with pytest.raises(ParameterError, match="unknown mechanism ghosts"):
        smallest_effect("ghosts", "size")
    with pytest.raises(ParameterError, match="valid: change"):
        smallest_effect("wheel_radius", "axle")


def test_all_at_once():
    assert make() == NULL
    stops = reference_stops(COACH, {name: {} for name in ALL})
    assert np.isfinite(stops.adhesion).all()
    assert (stops.speed_mps[-1] == 0.0).all()


@pytest.mark.slow
@pytest.mark.parametrize(("name", "size"), sizes()[::5], ids=lambda value: value if isinstance(value, str) else value.name)
def test_smallest_effect_is_just_of_interest(name, size, plain):
    value = smallest_effect(name, size.name)
    assert size.low <= value <= size.high
    rest = {one.name: one.null if one.kind == "size" else one.typical for one in ALL[name].parameters}

    def moved(value):
        return effect(reference_stops(COACH, {name: rest | {size.name: value}}), plain, COACH.wheel_radius_m)

    assert moved(size.null + 1.1 * (value - size.null)) > 1.0
    assert moved(size.null + 0.9 * (value - size.null)) < 1.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"wheel_speed_radps": np.ones(5)}, "expected \\(samples, axles\\)"),
        ({"speed_mps": np.ones(4)}, "speed_mps has shape"),
        ({"brake_torque_nm": np.full((5, 4), np.nan)}, "brake_torque_nm is not finite"),
        ({"time_s": np.zeros(5)}, "time_s does not rise"),
        ({"position_m": 50.0 * np.arange(5)}, "50 m apart"),
        ({"mean_s": (0.04, 0.04)}, "mean_s has 2 values"),
    ],
)
def test_trajectory_refuses(changes, message):
    usual = dict.fromkeys(("wheel_speed_radps", "wheel_acceleration_radps2", "brake_torque_nm"), np.ones((5, 4)))
    usual |= dict.fromkeys(("time_s", "speed_mps", "acceleration_mps2", "position_m"), np.arange(5.0))
    with pytest.raises(ParameterError, match=message):
        Trajectory(**(usual | changes))


@pytest.mark.parametrize("changes", [{"mu_cd": 0.0}, {"tau": -1.0}, {"mass_kg": -1.0}, {"radius_m": 0.0}])
def test_run_refuses(changes, trajectory):
    with pytest.raises(ParameterError, match=next(iter(changes))):
        along(trajectory, Belief(**({"mu_cd": 0.06, "tau": 1e-4, "mass_kg": 4e4, "radius_m": 0.4} | changes)), model(COACH))
    with pytest.raises(ParameterError, match="4 axles, the vehicle 2"):
        along(trajectory, RUN, model(BOGIE))


def test_along_is_the_law_without_mechanisms(trajectory):
    said = along(trajectory, RUN, model(COACH))
    speed = trajectory.speed_mps[:, None]
    slip = speed - COACH.wheel_radius_m * trajectory.wheel_speed_radps
    law = degraded_adhesion(slip, speed, COACH.static_wheel_load_n, RUN.mu_cd, RUN.tau, COACH.contact.law)
    assert_allclose(said.adhesion, law, rtol=1e-12, atol=1e-15)
    assert_array_equal(said.torque_factor, 1.0)
    assert_array_equal(said.resistance_n, 0.0)


shares = st.floats(0.0, 1.0)


@example(rest=1.0, share=0.5, a=1.1754943508222875e-38, offset=0.0, exponent=0.5)
@given(shares, shares, st.floats(0.0, 20.0), st.floats(0.0, 2.0), st.floats(0.3, 4.0))
def test_recovery_of_any_shape_is_the_lowest_root(rest, share, a, offset, exponent):
    gap = share * rest
    kept, _ = kept_by_shape(rest, gap, a, offset, exponent)
    f = rest - gap * kept

    def beyond(f):
        return rest - gap * np.exp(-(np.maximum(a * f - offset, 0.0) ** exponent)) - f

    # For exponents below 1 the slope at no work is infinite: less work than the floor counts as that.
    known = 1e-9 + gap * _WORK_FLOOR ** min(exponent, 1.0)
    assert abs(beyond(f)) < known
    below = np.linspace(rest - gap, f, 200)[:-1]
    assert (beyond(below) > -known).all()  # from below the right side lies above f until the first root


@given(shares, st.floats(0.0, 0.99), st.floats(0.0, 20.0))
def test_recovery_of_the_papers_shape(rest, share, a):
    """With n = 1 and no threshold the solver meets the closed form, whose root is unique."""
    gap = share * rest
    kept, rate = kept_by_shape(rest, gap, a, 0.0, 1.0)
    closed = math.exp(-a * rest - lambertw(-a * gap * math.exp(-a * rest)).real)
    assert_allclose(kept, closed, rtol=1e-7)
    assert rate == 1.0 or kept == 1.0


@given(st.lists(st.floats(0.01, 6.0), min_size=1, max_size=40), st.integers(-20, 20))
def test_energy_on_the_rail_does_not_depend_on_the_steps(steps, start):
    """However its way is cut, an axle that spends 1 J/m leaves 1 J/m in every cell that it has passed wholly."""
    p = leading_axle_cleaning.Parameters(1.0)
    spent = leading_axle_cleaning.Spent(np.zeros((1, 400)), np.zeros((1, 1)))
    place = float(start)
    for step in steps:
        leading_axle_cleaning.remember(p, spent, 0, 0, Passage(place, place + step, step, *[0.0] * 3, 1.0, *[0.0] * 3))
        place += step
    passed = [cell % 400 for cell in range(start, math.floor(place))]
    assert_allclose(spent.ring[0, passed], 1.0, rtol=1e-9)
    assert_allclose(spent.ring.sum() + spent.pending.sum(), place - start, rtol=1e-9)
