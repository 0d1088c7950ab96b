"""The degraded-adhesion law in closed form: against the implicit equation it solves, and what must hold of it."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.optimize import brentq
from scipy.special import lambertw

from wsp_env.contact.degraded import (
    adhesion,
    adhesion_recovered,
    adhesion_slope,
    adhesion_without_recovery,
    degraded_adhesion,
    exp_minus_lambert_w0,
)
from wsp_env.contact.polach import contact_stiffness, polach_adhesion, shear_stiffness
from wsp_env.contact.traction import Surface
from wsp_env.parameters.velim import CONTACT

pytestmark = pytest.mark.plain

LAW = CONTACT.law

creepages = st.floats(0.0, 1.0)
speeds = st.floats(0.1, 60.0)
loads = st.floats(20e3, 120e3)
frictions = st.floats(0.01, 0.15)
rates = st.floats(0.0, 1e-3)
layers = st.floats(0.0, 1.0)


def limits(slip, speed, load, mu_cd):
    """Eqs. (5) to (7), written once more from the paper: f_d and f_r."""
    c = CONTACT
    e = slip / speed
    result = []
    for mu_c, ratio, gamma, k_a, k_s in (
        (mu_cd, c.friction_ratio_d, c.friction_decrease_d_spm, c.polach_k_ad, c.polach_k_sd),
        (c.kinetic_friction_r, c.friction_ratio_r, c.friction_decrease_r_spm, c.polach_k_ar, c.polach_k_sr),
    ):
        mu = (mu_c / ratio - mu_c) * np.exp(-gamma * slip) + mu_c
        eps = 0.25 * c.shear_modulus_pa * math.pi * c.semi_axis_a_m * c.semi_axis_b_m * c.kalker_c11 / (mu * load) * e
        result.append(2.0 * mu / math.pi * (k_a * eps / (1.0 + (k_a * eps) ** 2) + np.arctan(k_s * eps)))
    return result


@given(creepages, speeds, loads, frictions, rates)
def test_closed_form_solves_the_implicit_equation(e, v, load, mu_cd, tau):
    slip = e * v
    f_d, f_r = limits(slip, v, load, mu_cd)

    def residual(f):  # eqs. (1), (3) and (4)
        recovery = 1.0 - math.exp(-tau * f * load * e)
        return f - ((1.0 - recovery) * f_d + recovery * f_r)

    root = brentq(residual, f_d - 1e-9, f_r + 1e-9, xtol=1e-15, rtol=1e-14)
    assert_allclose(degraded_adhesion(slip, v, load, mu_cd, tau, LAW), root, atol=1e-10)
    assert_allclose(adhesion_without_recovery(slip, v, load, mu_cd, tau, LAW), f_d, rtol=1e-12, atol=1e-15)
    assert_allclose(adhesion_recovered(slip, v, load, mu_cd, tau, LAW), f_r, rtol=1e-12, atol=1e-15)


def test_closed_form_is_lamberts_over_the_whole_range():
    rng = np.random.default_rng(20240607)
    count = 3000
    v, load = rng.uniform(0.1, 60.0, count), rng.uniform(20e3, 120e3, count)
    e = rng.choice([0.0, 1e-6, 1e-3, 1.0], count) * rng.integers(0, 2, count)
    e = np.where(e == 0.0, rng.uniform(0.0, 1.0, count), e)
    mu_cd, tau = rng.uniform(0.01, 0.15, count), rng.uniform(0.0, 1e-3, count)
    f_d, f_r = limits(e * v, v, load, mu_cd)
    a = tau * load * e
    expected = f_r + lambertw(-a * (f_r - f_d) * np.exp(-a * f_r)).real / a
    assert a.max() > 16.0  # where Newton's method from f_d diverges
    assert_allclose(degraded_adhesion(e * v, v, load, mu_cd, tau, LAW), expected, atol=1e-10)


@given(st.floats(-1.0 / math.e * (1.0 - 1e-9), 50.0))
def test_exponential_of_lamberts_function(z):
    # Near the branch point scipy's own error is that of the square root of a rounding error.
    tolerance = 1e-13 + 1e-15 / math.sqrt(max(1.0 + math.e * z, 1e-12))
    assert_allclose(exp_minus_lambert_w0(z), math.exp(-lambertw(z).real), rtol=tolerance)


def test_exponential_of_lamberts_function_at_its_ends():
    assert_allclose(exp_minus_lambert_w0(0.0), 1.0, rtol=1e-14)
    assert_allclose(exp_minus_lambert_w0(-1.0 / math.e), math.e, rtol=1e-7)
    assert math.isfinite(exp_minus_lambert_w0(-1.0 / math.e - 1e-12))


@given(st.floats(0.005, 1.0), speeds, loads, st.floats(0.2, 0.28), rates)
def test_contaminant_with_more_friction_than_the_clean_rail(e, v, load, mu_cd, tau):
    # Near mu_cr the slower fall of the degraded friction can put f_d above f_r: the equation keeps one root between.
    f_d, f_r = limits(e * v, v, load, mu_cd)
    f = float(degraded_adhesion(e * v, v, load, mu_cd, tau, LAW))
    assert_allclose(f, f_r - (f_r - f_d) * math.exp(-tau * load * e * f), atol=1e-12)


@given(st.floats(1e-3, 1.0), st.floats(0.5, 60.0), loads, frictions, rates, layers)
def test_derivatives_are_the_slopes_of_the_law(e, v, load, mu_cd, tau, layer):
    slip = e * v

    def f(s, speed):
        return float(degraded_adhesion(s, speed, load, mu_cd, tau, LAW, layer))

    state = adhesion(slip, v, load, Surface(mu_cd, LAW.mu_cr, layer, 0.0), tau, LAW)
    h, k = 1e-5 * slip, 1e-5 * v
    by_slip = (8.0 * (f(slip + h, v) - f(slip - h, v)) - f(slip + 2 * h, v) + f(slip - 2 * h, v)) / (12.0 * h)
    by_speed = (8.0 * (f(slip, v + k) - f(slip, v - k)) - f(slip, v + 2 * k) + f(slip, v - 2 * k)) / (12.0 * k)
    # The differences carry a rounding error of about 1e-15 / 1e-5, relative to f / slip and f / v.
    assert_allclose(state.df_ds, by_slip, rtol=1e-7, atol=1e-8 / slip)
    assert_allclose(state.df_dv, by_speed, rtol=1e-7, atol=1e-8 / v)
    batched = adhesion_slope(slip, v, load, mu_cd, tau, LAW, layer)
    assert_allclose(batched, state.df_ds, rtol=1e-13, atol=2e-14 * state.f / slip)  # of terms that cancel at the maximum
    assert adhesion_slope(-slip, v, load, mu_cd, tau, LAW, layer) == batched


@given(creepages, speeds, loads, frictions, rates, rates, layers)
def test_law_lies_between_its_limits_and_grows_with_tau(e, v, load, mu_cd, first, second, layer):
    low, high = sorted((first, second))
    state = adhesion(e * v, v, load, Surface(mu_cd, LAW.mu_cr, layer, 0.0), low, LAW)
    assert state.f_d - 1e-13 <= state.f <= state.f_r + 1e-13
    assert state.f <= degraded_adhesion(e * v, v, load, mu_cd, high, LAW, layer) + 1e-13
    # Less of the layer, more adhesion.
    assert state.f <= degraded_adhesion(e * v, v, load, mu_cd, low, LAW, 0.5 * layer) + 1e-13


@given(creepages, speeds, loads, frictions, rates)
def test_ends_of_recovery_and_layer(e, v, load, mu_cd, tau):
    arguments = (e * v, v, load, mu_cd)
    f_d, f_r = limits(*arguments)
    assert_allclose(degraded_adhesion(*arguments, 0.0, LAW), f_d, rtol=1e-12, atol=1e-15)
    assert_allclose(degraded_adhesion(*arguments, tau, LAW, layer=0.0), f_r, rtol=1e-12, atol=1e-15)


@given(st.floats(-60.0, 60.0), speeds, loads, frictions, rates)
def test_force_opposes_the_slip(slip, v, load, mu_cd, tau):
    for law in (degraded_adhesion, adhesion_without_recovery, adhesion_recovered):
        f = law(slip, v, load, mu_cd, tau, LAW)
        assert law(-slip, v, load, mu_cd, tau, LAW) == -f
        assert f * slip >= 0.0


@pytest.mark.parametrize("slip", [0.0, -0.0, 1e-12, 0.3, 40.0])
@pytest.mark.parametrize("speed", [0.0, 1e-9, 20.0])
@pytest.mark.parametrize("load", [0.0, 53e3])
def test_law_is_finite_at_standstill_without_load_and_without_slip(slip, speed, load):
    state = adhesion(slip, speed, load, Surface(0.06, LAW.mu_cr, 1.0, 0.0), 1.9e-4, LAW)
    assert all(math.isfinite(x) for x in state)
    assert state.f == 0.0 if slip == 0.0 else 0.0 < state.f <= 0.28 / 0.4


def test_law_is_the_same_one_by_one_and_in_batches():
    slips, mu_cd = np.linspace(-5.0, 20.0, 7)[:, None], np.array([0.02, 0.06, 0.1])
    batch = degraded_adhesion(slips, 30.0, 53e3, mu_cd, 1.9e-4, LAW)
    assert batch.shape == (7, 3)
    for i, j in np.ndindex(7, 3):
        state = adhesion(slips[i, 0], 30.0, 53e3, Surface(mu_cd[j], LAW.mu_cr, 1.0, 0.0), 1.9e-4, LAW)
        assert_allclose(abs(batch[i, j]), state.f, rtol=1e-14)
        assert_allclose(batch[i, j], degraded_adhesion(slips[i, 0], 30.0, 53e3, mu_cd[j], 1.9e-4, LAW), rtol=1e-14)


@pytest.mark.parametrize("law", [LAW, LAW._replace(recovery_exponent=1.3, recovery_threshold=20.0)])
def test_law_in_batches_is_that_of_the_plant_but_for_rounding(law):
    # Batches take exp and arctan from `elementary`, the plant from libm.
    rng = np.random.default_rng(7)
    v, load, layer = rng.uniform(0.1, 60.0, 2000), rng.uniform(20e3, 120e3, 2000), rng.uniform(0.0, 1.0, 2000)
    slip = v * 10.0 ** rng.uniform(-6.0, 0.0, 2000)
    mu_cd, tau = rng.uniform(0.01, 0.15, 2000), rng.uniform(0.0, 1e-3, 2000)
    contacts = zip(slip, v, load, mu_cd, tau, layer, strict=True)
    f, f_d, f_r, slope, *_ = np.transpose([adhesion(*x, Surface(mu, law.mu_cr, c, 0.0), t, law) for *x, mu, t, c in contacts])
    batch = (slip, v, load, mu_cd, tau, law, layer)
    assert_allclose(degraded_adhesion(*batch), f, rtol=1e-14)
    assert_allclose(adhesion_without_recovery(*batch), f_d, rtol=1e-15)
    assert_allclose(adhesion_recovered(*batch), f_r, rtol=1e-15)
    assert_allclose(adhesion_slope(*batch) * slip, slope * slip, atol=2e-14 * f.max(), rtol=1e-13)


@given(st.floats(1e-9, 1e-7), loads, st.floats(0.05, 0.5))
def test_clean_contact_with_small_slip_is_kalkers(e, load, mu):
    # With both reduction factors 1, Polach's curve begins with the slope G a b c11 of the linear theory.
    c = CONTACT
    stiffness = contact_stiffness(c.semi_axis_a_m, c.semi_axis_b_m, c.shear_modulus_pa, c.kalker_c11)
    f = polach_adhesion(e, 0.0, load, stiffness, mu, 1.0, 0.0, 1.0, 1.0)
    linear = c.shear_modulus_pa * c.semi_axis_a_m * c.semi_axis_b_m * c.kalker_c11 * e
    assert_allclose(f * load, linear, rtol=1e-4)


@given(creepages, speeds, loads, frictions)
def test_classic_law_is_polachs_curve(e, v, load, mu_cd):
    c = CONTACT
    arguments = (c.friction_ratio_d, c.friction_decrease_d_spm, c.polach_k_ad, c.polach_k_sd)
    expected = polach_adhesion(e, e * v, load, c.stiffness_n, mu_cd, *arguments)
    assert_allclose(degraded_adhesion(e * v, v, load, mu_cd, 0.0, LAW), expected, rtol=1e-11, atol=1e-15)


@given(st.floats(-10.0, 10.0), st.floats(-10.0, 10.0))
def test_shear_stiffness(slip_x, slip_y):
    a, shear, c11, c22 = 5e-3, 8e10, 4.1, 3.7
    along, across = 3.0 * shear * c11 / (8.0 * a), 3.0 * shear * c22 / (8.0 * a)  # eq. (8)
    assert_allclose(shear_stiffness(a, shear, c11), along, rtol=1e-14)
    slip = math.hypot(slip_x, slip_y)
    expected = math.hypot(along * slip_x / slip, across * slip_y / slip) if slip > 0.0 else along  # eq. (16)
    assert_allclose(shear_stiffness(a, shear, c11, c22, slip_x, slip_y), expected, rtol=1e-12)


def test_shear_stiffness_broadcasts():
    batch = shear_stiffness(5e-3, 8e10, 4.1, 3.7, np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 2.0]))
    assert_allclose(batch, 3.0 * 8e10 / (8.0 * 5e-3) * np.array([4.1, 4.1, 3.7]), rtol=1e-14)
