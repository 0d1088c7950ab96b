"""What sliding wheels tell of the rail."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from agents.measure import low_adhesion
from wsp_env.contact.degraded import degraded_adhesion
from wsp_env.evaluation.controller import load
from wsp_env.evaluation.runner import Conduct, measure, start_plant
from wsp_env.observer import rail as rails
from wsp_env.observer.observation import Observer
from wsp_env.observer.rail import MEMORY_S, RECOVERY_M_PER_J
from wsp_env.parameters.uic_z1 import BOGIE

INTERVAL = 0.02
LOAD = (BOGIE.mass_kg + 0.5 * BOGIE.payload_kg) * BOGIE.gravity_mps2 / (2.0 * BOGIE.axles)


def see(rail, slip, adhesion, speed):
    """Show slips (N, A) and adhesions (N, A) at the running speeds (N,) to the estimates of N rails."""
    for i in range(len(slip)):
        rails.update(i, slip, adhesion, speed[i], rail, rails.constants(BOGIE, INTERVAL))


def fresh(n):
    """Return the estimates of n rails of which nothing was seen yet."""
    rail = rails.allocate(n)
    for i in range(n):
        rails.begin(i, rail)
    return rail


def shown(mu_cd, tau, slips, speed=30.0):
    """Return the estimate of a rail that was shown the law's own adhesion at these slips [m/s], on both axles."""
    rail = fresh(1)
    slips = np.asarray(slips)
    for slip, adhesion in zip(slips, degraded_adhesion(slips, speed, LOAD, mu_cd, tau, BOGIE.contact.law), strict=True):
        see(rail, np.full((1, 2), slip), np.full((1, 2), adhesion), np.array([speed]))
    return rail


@settings(max_examples=20, deadline=None)
@given(
    mu_cd=st.floats(0.015, 0.06),
    which=st.integers(0, len(RECOVERY_M_PER_J) - 1),
    highest=st.floats(3.0, 6.0),
)
def test_only_the_true_law_is_without_contradiction(mu_cd, which, highest):
    """Slips up and down for 20 s: mu_cd of the true tau is the true one; every other tau contradicts itself more."""
    slips = 1.0 + 0.5 * (highest - 1.0) * (1.0 - np.cos(np.arange(1000) * 0.05))
    rail = shown(mu_cd, RECOVERY_M_PER_J[which], slips)
    assert_allclose(rail.friction[0, which], mu_cd, rtol=0.02)
    assert int(np.argmin(rail.deviation[0])) == which
    assert rail.deviation[0, which] < 0.06  # what is left of the beginning


@pytest.mark.plain
def test_a_constant_slip_tells_nothing_of_the_law():
    """Every tau then has a mu_cd of its own that explains everything: the more recovery, the less friction."""
    rail = shown(0.03, 2e-4, np.full(2000, 3.0))
    assert (np.diff(rail.friction[0]) < 0.0).all()
    assert_allclose(rail.deviation[0], rail.deviation[0, 0], atol=0.02)


@pytest.mark.plain
def test_rolling_wheels_say_nothing():
    rail = shown(0.03, 2e-4, [0.0, 0.1, 0.2])
    assert_array_equal(rail.friction, fresh(1).friction)
    assert_array_equal(rail.seen, fresh(1).seen)


def test_memory_fades():
    """After several memories of another rail little is left of the first."""
    slips = 3.0 + 2.0 * np.sin(np.arange(int(4.0 * MEMORY_S / 2.0 / INTERVAL)) * 0.05)
    rail = shown(0.02, 0.0, slips)
    for slip, adhesion in zip(slips, degraded_adhesion(slips, 30.0, LOAD, 0.05, 0.0, BOGIE.contact.law), strict=True):
        see(rail, np.full((1, 2), slip), np.full((1, 2), adhesion), np.array([30.0]))
    assert_allclose(rail.friction[0, 0], 0.05, rtol=0.03)
    assert rail.seen[0] <= MEMORY_S * 1.01


@pytest.mark.plain
@pytest.mark.parametrize("begun", [[True, False, True], [True, True, True]])
def test_each_vehicle_is_for_itself(begun):
    """Vehicles in a batch are as alone, and a reset leaves the others."""
    rng = np.random.default_rng(4)
    slip, adhesion, speed = rng.uniform(0.5, 5.0, (3, 2)), rng.uniform(0.03, 0.09, (3, 2)), np.array([40.0, 20.0, 2.0])
    many, alone = fresh(3), [fresh(1) for _ in range(3)]
    see(many, slip, adhesion, speed)
    for i, one in enumerate(alone):
        see(one, slip[i : i + 1], adhesion[i : i + 1], speed[i : i + 1])
        assert_array_equal(many.friction[i], one.friction[0])
    before, start = many.friction.copy(), fresh(3)
    for i in np.flatnonzero(begun):
        rails.begin(i, many)
    assert_array_equal(many.friction[begun], start.friction[begun])
    assert_array_equal(many.friction[~np.array(begun)], before[~np.array(begun)])


@pytest.mark.parametrize("law", ["recovering", "classic"])
def test_the_observation_tells_which_law_a_sliding_vehicle_brakes_under(law):
    """After 15 s of a slip controller: the true law shows its friction, the other one contradicts itself more."""
    stops = low_adhesion(BOGIE, law, 6, 5)
    plant = start_plant(BOGIE, stops, Conduct())
    controller, observer = load("slip"), Observer(BOGIE, INTERVAL)
    controller.reset(plant.n, BOGIE)
    seen = observer.reset(measure(plant))
    for _ in range(round(15.0 / INTERVAL)):
        command = controller.act(measure(plant))
        plant.step(command)
        seen = observer.observe(measure(plant), command)
    told = seen[:, 10 * BOGIE.axles : 10 * BOGIE.axles + 9]
    friction, contradiction = Observer.FRICTION_SCALE * told[:, :4], told[:, 4:8]
    assert_allclose(friction, observer.rail.friction, rtol=1e-5)
    if law == "classic":
        assert_allclose(friction[:, 0], [stop.mu_cd for stop in stops], rtol=0.12)
        assert (contradiction[:, 0] < contradiction[:, 3]).all()
    else:
        assert (contradiction.argmin(axis=1) > 0).mean() > 0.8
    assert_allclose(told[:, 8] * MEMORY_S, observer.rail.seen, rtol=1e-5)
