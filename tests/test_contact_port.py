"""The contact port: every law gives force and derivatives through one interface, and can brake the coach."""

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from plant_cases import a_plant, a_stop, run

from wsp_env.contact.degraded import degraded_adhesion
from wsp_env.contact.fastsim import fastsim
from wsp_env.contact.kalker import Patch, saturated_force
from wsp_env.contact.laws.capped import FITTED_CREEPAGE
from wsp_env.contact.laws.fastsim import ELEMENTS, STRIPS
from wsp_env.contact.polach import falling_friction, polach_adhesion
from wsp_env.contact.port import LAWS, adhesion_under, traction
from wsp_env.contact.traction import Surface
from wsp_env.parameters.contact import ContactParameters
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.plant.mechanisms import NULL, believed_to_true, make

CONTACT = ContactParameters()
LOAD, TAU = 53e3, 1.9e-4


def law_of(name):
    return ContactParameters(traction_law=name).law


@pytest.mark.parametrize("name", LAWS)
@given(st.floats(1e-3, 12.0), st.floats(2.0, 50.0), st.floats(0.01, 0.2), st.floats(0.0, 1.0))
@settings(max_examples=25, deadline=None)
def test_derivatives_are_the_slopes_of_the_law(name, slip, speed, mu_cd, layer):
    assume(name != "capped" or abs(slip / speed - FITTED_CREEPAGE) > 1e-3)  # at the cap the curve has a kink, and two slopes
    law, on = law_of(name), Surface(mu_cd, 0.28, layer, 0.0)
    here, h = traction(slip, speed, LOAD, on, TAU, law), 1e-5
    step = min(h, 2e-4 * slip)  # on little friction a wheel slides from some mm/s on: the curve bends on that scale

    def f(s, v):
        return traction(s, v, LOAD, on, TAU, law).f

    by_slip = (f(slip + step, speed) - f(slip - step, speed)) / (2.0 * step)
    by_speed = (f(slip, speed + h) - f(slip, speed - h)) / (2.0 * h)
    # FASTSIM's elements switch from adhesion to slip one by one: its slope is that of a polygon.
    tolerance = {"rtol": 0.05, "atol": 2e-3} if name == "fastsim" else {"rtol": 1e-4, "atol": 1e-6}
    assert_allclose(here.df_ds, by_slip, **tolerance)
    assert_allclose(here.df_dv, by_speed, **tolerance)


@pytest.mark.parametrize("name", LAWS)
def test_work_and_limits(name):
    """Friction works against the slip, lies between its limits, and grows as the layer goes."""
    law = law_of(name)
    slips, layers = np.geomspace(1e-3, 15.0, 40), (1.0, 0.6, 0.3, 0.0)
    last = np.zeros(40)
    for layer in layers:
        found = [traction(s, 20.0, LOAD, Surface(0.05, 0.28, layer, 0.0), TAU, law) for s in slips]
        f = np.array([one.f for one in found])
        assert (f > 0.0).all()
        assert (f >= last - 1e-9).all()
        assert all(one.f <= one.f_r * (1.0 + 1e-9) for one in found)
        assert all(0.0 <= one.kept <= 1.0 + 1e-9 for one in found)
        last = f
    assert_allclose(f, [one.f_r for one in found], rtol=1e-9)  # clean
    signed = adhesion_under(law, [-1.0, 1.0], 20.0, LOAD, 0.05, TAU)
    assert signed[0] == -signed[1] < 0.0


@given(st.floats(1e-3, 12.0), st.floats(2.0, 50.0), st.floats(0.01, 0.2))
@settings(max_examples=30, deadline=None)
def test_laws_are_those_of_their_own_modules(slip, speed, mu_cd):
    """On rail with the whole layer each law gives what its module computes, with the friction of eq. (7)."""
    c, e = CONTACT, slip / speed
    mu = falling_friction(slip, mu_cd, c.friction_ratio_d, c.friction_decrease_d_spm)
    c11 = c.stiffness_n / (0.25 * np.pi * c.shear_modulus_pa * c.semi_axis_a_m * c.semi_axis_b_m)
    patch = Patch(c.semi_axis_a_m, c.semi_axis_b_m, c.shear_modulus_pa, c11, 3.67, 1.47)
    expected = {
        "degraded": degraded_adhesion(slip, speed, LOAD, mu_cd, TAU, law_of("degraded")),
        "capped": degraded_adhesion(slip, speed, LOAD, mu_cd, TAU * min(1.0, FITTED_CREEPAGE / e), law_of("degraded")),
        "classic": degraded_adhesion(slip, speed, LOAD, mu_cd, 0.0, law_of("degraded")),
        "polach": polach_adhesion(
            e, slip, LOAD, c.stiffness_n, mu_cd, c.friction_ratio_d, c.friction_decrease_d_spm, c.polach_k_ad, c.polach_k_sd
        ),
        "kalker": saturated_force(e, 0.0, 0.0, LOAD, mu, patch)[0] / LOAD,
        "fastsim": fastsim(e, 0.0, 0.0, LOAD, mu, patch, STRIPS, ELEMENTS)[0] / LOAD,
    }
    assert set(expected) == set(LAWS)
    for name, value in expected.items():
        assert_allclose(adhesion_under(law_of(name), slip, speed, LOAD, mu_cd, TAU), value, rtol=1e-9, err_msg=name)


def test_the_elements_of_fastsim_are_fine_enough():
    """The share of the friction limit is within 0.2 % of the one with eight times the elements, as its module says."""
    law, mu = law_of("fastsim"), 0.28
    for epsilon in np.geomspace(0.05, 20.0, 25):
        patch = Patch(1.0, 1.0, 1.0, 4.0 / np.pi, 1.0, 1.0)
        fine = fastsim(epsilon, 0.0, 0.0, 1.0, 1.0, patch, 8 * STRIPS, 8 * ELEMENTS)[0]
        assert fastsim(epsilon, 0.0, 0.0, 1.0, 1.0, patch, STRIPS, ELEMENTS)[0] == pytest.approx(fine, abs=2e-3)
    kalker = 4.0 / np.pi * law.stiffness / LOAD / 20.0  # T = G a b c11 e, stiffness = pi G a b c11 / 4
    assert traction(0.0, 20.0, LOAD, Surface(mu, mu), 0.0, law).df_ds == pytest.approx(kalker, rel=0.02)


@pytest.mark.slow
@pytest.mark.long
def test_another_law_brakes_the_coach():
    """By strips, compiled into the plant anew: the coach stops and its energy balances."""
    plant = a_plant("coach", vehicle={"contact": ContactParameters(traction_law="fastsim")}, mu_cd=0.05, initial_speed=20.0)
    before = plant.kinetic_energy.copy()
    run(plant, 120.0)
    truth = plant.truth()
    assert not plant.moving.any()
    spent = truth.brake_work + truth.contact_work.sum(axis=1) + truth.resistance_work
    assert_allclose(spent, before, rtol=1e-9)


def test_without_recovery_the_coach_travels_further():
    """With tau = 0 the degraded law is the classic one, see above."""
    recovering, classic = (a_plant("coach", mu_cd=0.05, initial_speed=20.0, tau=tau) for tau in (1.9e-4, 0.0))
    for plant in (recovering, classic):
        run(plant, 120.0)
        assert not plant.moving.any()
    assert classic.truth().position[0] > 1.01 * recovering.truth().position[0]


def test_a_law_needs_only_what_it_uses():
    """Mechanisms that are off touch no record; one that is on and acts on what a record lacks is refused."""
    bare = NamedTuple("Bare", [("mu_cr", float)])(0.28)
    assert believed_to_true("law", NULL, bare) is bare
    for choice in ({"initial_slope": {}}, {"falling_friction": {}}, {"recovery_shape": {}}):
        with pytest.raises(ParameterError, match=r"the traction law has nothing that it acts on \(Bare\)"):
            believed_to_true("law", make(choice), bare)


def test_what_a_law_cannot_do_is_refused():
    with pytest.raises(ParameterError, match="traction_law = 'ice' is unknown; valid: degraded, capped, classic"):
        ContactParameters(traction_law="ice")
    with pytest.raises(ParameterError, match=r"recovery_shape: the traction law has nothing that it acts on \(PolachLaw\)"):
        a_plant("coach", vehicle={"contact": ContactParameters(traction_law="polach")}).start(
            0, a_stop(COACH), {"recovery_shape": {"exponent": 2.0}}
        )
