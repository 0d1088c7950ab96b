"""FASTSIM and Polach's force with spin: against CONTACT, closed integrals and the printed equations."""

import csv
import io
import math
from importlib.resources import files

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.integrate import quad

from wsp_env.contact.fastsim import ELEMENTS, STRIPS, fastsim, fastsim_force
from wsp_env.contact.kalker import Patch, linear_force
from wsp_env.contact.polach import contact_stiffness, force_with_spin, polach_adhesion, polach_force

pytestmark = pytest.mark.plain

LOAD, FRICTION = 106.7e3, 0.33
LIMIT = FRICTION * LOAD
# The Eurosprinter's ellipse (6.304 mm, 12.61 mm) and Kalker's coefficients at a / b = 0.5, nu = 0.28.
PATCH = Patch(6.304e-3, 12.61e-3, 82e9, 3.62 + 0.12 * (4.83 - 3.62), 3.01 + 0.12 * (3.14 - 3.01), 0.929 + 0.12 * 0.141)
OTHER = Patch(7e-3, 4e-3, 80e9, 4.6, 4.3, 2.0)

creepage = st.floats(-0.02, 0.02)
spins = st.floats(-2.0, 2.0)
patches = st.sampled_from([PATCH, OTHER])


def reference_curve(model):
    text = (files("wsp_env") / "data" / "contact_reference_curves.csv").read_text()
    rows = [row for row in csv.DictReader(io.StringIO(text)) if row["model"] == model]
    return (
        np.array([float(row["creepage"]) for row in rows]),
        -np.array([float(row["longitudinal_force_n"]) for row in rows]),
    )


def simplified_theory(creep, load, friction, patch):
    """T_x of the simplified theory without spin, by quadrature: in each strip the stress is the smaller of two curves."""
    a, b = patch.semi_axis_a, patch.semi_axis_b
    rate = abs(creep) * 3.0 * patch.c11 * patch.shear_modulus / (8.0 * a)
    peak = 2.0 * friction * load / (math.pi * a * b)

    def strip(angle):
        half = a * math.cos(angle)
        # rate (half - x) meets peak (half^2 - x^2) / a^2 at x = rate a^2 / peak - half, if that is in the strip
        x = min(rate * a**2 / peak - half, half)
        stick = 0.5 * rate * (half - x) ** 2
        slip = peak / a**2 * ((half**2 * x - x**3 / 3.0) - (-2.0 * half**3 / 3.0))
        return (stick + slip) * b * math.cos(angle)

    kink = math.acos(min(1.0, rate * a / (2.0 * peak)))  # strips further out slip along their whole length
    total = quad(strip, -0.5 * math.pi, 0.5 * math.pi, points=[-kink, kink], epsabs=1e-9 * friction * load)[0]
    return math.copysign(total, creep)


def observed_order(error_of, sizes):
    errors = [error_of(size) for size in sizes]
    return math.log(errors[0] / errors[-1]) / math.log(sizes[-1] / sizes[0])


def test_fastsim_is_that_of_contact():
    creep, forces = reference_curve("fastsim_coulomb")
    same_slope, _ = fastsim_force(creep, 0.0, 0.0, LOAD, FRICTION, PATCH._replace(c11=3.849))
    table, _ = fastsim_force(creep, 0.0, 0.0, LOAD, FRICTION, PATCH)
    print(f"from CONTACT's FASTSIM: {np.max(np.abs(same_slope / forces - 1.0)):.2%} with c11 = 3.849")
    print(f"from CONTACT's FASTSIM: {np.max(np.abs(table / forces - 1.0)):.2%} with Kalker's table")
    assert_allclose(same_slope, forces, rtol=0.01)
    assert_allclose(table, forces, rtol=0.025)


def test_fastsim_stays_near_the_exact_solution():
    creep, forces = reference_curve("contact_coulomb")
    force, lateral = fastsim_force(creep, 0.0, 0.0, LOAD, FRICTION, PATCH)
    worst = np.argmax(np.abs(force / forces - 1.0))
    print(f"from CONTACT: {force[worst] / forces[worst] - 1.0:+.2%} at most, at a creepage of {creep[worst]}")
    assert_allclose(force, forces, rtol=0.06)
    assert_allclose(lateral, 0.0, atol=1e-9 * LIMIT)


@given(st.floats(1e-6, 0.02), st.floats(1e3, 2e5), st.floats(0.02, 0.6), patches)
def test_fastsim_without_spin_is_the_integral_of_the_simplified_theory(creep, load, friction, patch):
    expected = simplified_theory(creep, load, friction, patch)
    force, lateral = fastsim(creep, 0.0, 0.0, load, friction, patch, STRIPS, ELEMENTS)
    assert abs(force - expected) <= 5e-4 * friction * load
    assert abs(lateral) <= 1e-9 * friction * load
    # Across the rolling direction the theory is the same with c22.
    turned = fastsim(0.0, creep, 0.0, load, friction, patch._replace(c22=patch.c11), STRIPS, ELEMENTS)
    assert_allclose(turned, (lateral, force), rtol=1e-12, atol=1e-9 * friction * load)


def test_fastsim_is_of_second_order_without_spin():
    creeps = np.linspace(0.0003, 0.004, 12)
    exact = np.array([simplified_theory(e, LOAD, FRICTION, PATCH) for e in creeps])

    def error(elements):
        force, _ = fastsim_force(creeps, 0.0, 0.0, LOAD, FRICTION, PATCH, 48, elements)
        return float(np.sqrt(np.mean((force - exact) ** 2))) / LIMIT

    order = observed_order(error, [6, 12, 24, 48])
    print(f"order along a strip without spin {order:.2f}; error of the default {error(ELEMENTS):.1e} of mu N")
    assert 1.7 < order < 2.3


def test_fastsim_is_of_first_order_with_spin_and_its_default_is_converged():
    rng = np.random.default_rng(7)
    slips = (*rng.uniform(-0.004, 0.004, (2, 16)), rng.uniform(-0.6, 0.6, 16))
    fine = np.array(fastsim_force(*slips, LOAD, FRICTION, PATCH, 24, 1024))

    def error(elements, strips=24):
        coarse = np.array(fastsim_force(*slips, LOAD, FRICTION, PATCH, strips, elements))
        return float(np.sqrt(np.mean(np.sum((coarse - fine) ** 2, axis=0)))) / LIMIT

    order = observed_order(error, [8, 16, 32, 64])
    print(f"order along a strip with spin {order:.2f}; error of the default {error(ELEMENTS, STRIPS):.1e} of mu N")
    assert 0.8 < order < 1.3
    assert error(ELEMENTS, STRIPS) < 0.01


def test_fastsim_begins_with_kalkers_linear_theory():
    for slip in ((1e-8, 0.0, 0.0), (0.0, 1e-8, 0.0), (0.0, 0.0, 1e-6), (1e-8, -2e-8, 1e-6)):
        for patch in (PATCH, OTHER):
            force = np.array(fastsim_force(*slip, LOAD, FRICTION, patch))
            linear = np.array(linear_force(*slip, patch))
            assert np.linalg.norm(force - linear) <= 2e-3 * np.linalg.norm(linear)


@given(creepage, creepage, spins, patches)
def test_fastsim_keeps_the_limit_and_its_symmetries(slip_x, slip_y, spin, patch):
    force = np.array(fastsim(slip_x, slip_y, spin, LOAD, FRICTION, patch, STRIPS, ELEMENTS))
    assert np.linalg.norm(force) <= LIMIT * 1.0005
    opposite = fastsim(-slip_x, -slip_y, -spin, LOAD, FRICTION, patch, STRIPS, ELEMENTS)
    assert_allclose(opposite, -force, atol=1e-9 * LIMIT)
    mirrored = fastsim(slip_x, -slip_y, -spin, LOAD, FRICTION, patch, STRIPS, ELEMENTS)
    assert_allclose(mirrored, force * (1.0, -1.0), atol=1e-9 * LIMIT)


def test_fastsim_slides_as_a_whole():
    # Its springs differ along and across, so that it slides in the direction of the linear force.
    linear = np.array(linear_force(0.3, 0.4, 0.0, PATCH))
    expected = LIMIT * linear / np.linalg.norm(linear)
    assert_allclose(fastsim_force(0.3, 0.4, 0.0, LOAD, FRICTION, PATCH), expected, rtol=1e-3)
    spinning = fastsim_force(0.0, 0.0, 1e4, LOAD, FRICTION, PATCH)  # about the centre: the forces cancel
    assert_allclose(spinning, 0.0, atol=0.05 * LIMIT)


def test_fastsim_without_load_friction_or_slip_is_zero():
    assert_allclose(fastsim_force(0.01, 0.01, 0.1, [0.0, -1.0], FRICTION, PATCH), 0.0, atol=0.0)
    assert_allclose(fastsim_force(0.01, 0.01, 0.1, LOAD, 0.0, PATCH), 0.0, atol=0.0)
    assert_allclose(fastsim_force(0.0, 0.0, 0.0, LOAD, FRICTION, PATCH), 0.0, atol=0.0)
    no_contact = PATCH._replace(semi_axis_a=0.0, semi_axis_b=0.0)
    assert_allclose(fastsim_force(0.01, 0.01, 0.1, 0.0, FRICTION, no_contact), 0.0, atol=0.0)


@pytest.mark.parametrize(("strips", "elements"), [(0, 10), (10, 1)])
def test_fastsim_refuses_a_grid_that_is_none(strips, elements):
    with pytest.raises(ValueError, match="FASTSIM needs one strip and two elements"):
        fastsim_force(0.001, 0.0, 0.0, LOAD, FRICTION, PATCH, strips, elements)


def test_fastsim_is_the_same_one_by_one_and_in_batches():
    creep, load = np.array([[-0.002], [0.0], [0.01]]), np.array([0.0, 5e4])
    batch = fastsim_force(creep, 0.001, 0.2, load, FRICTION, PATCH)
    assert batch[0].shape == batch[1].shape == (3, 2)
    for i, j in np.ndindex(3, 2):
        single = fastsim(creep[i, 0], 0.001, 0.2, load[j], FRICTION, PATCH, STRIPS, ELEMENTS)
        assert_allclose([batch[0][i, j], batch[1][i, j]], single, rtol=1e-13)


def printed_polach(s_x, s_y, omega, load, mu, patch):
    """Polach (1999) as printed, constant friction, forces along the creepage."""
    a, b, shear, c11, c22, c23 = patch
    s_yc = s_y if abs(s_y + omega * a) <= abs(s_y) else s_y + omega * a
    s_c, s = math.sqrt(s_x**2 + s_yc**2), math.sqrt(s_x**2 + s_y**2)
    c_jj = math.sqrt((c11 * s_x / s) ** 2 + (c22 * s_y / s) ** 2)
    eps = math.pi * shear * a * b * c_jj / (4.0 * load * mu) * s_c
    force = 2.0 * load * mu / math.pi * (eps / (1.0 + eps**2) + math.atan(eps))
    bracket = 1.0 + 6.3 * (1.0 - math.exp(-a / b))
    eps_m = 8.0 / 3.0 * shear * b * math.sqrt(a * b) * c23 * s_yc / (load * mu * bracket)
    delta = (eps_m**2 - 1.0) / (eps_m**2 + 1.0)
    k_m = abs(eps_m) * (delta**3 / 3.0 - delta**2 / 2.0 + 1.0 / 6.0) - math.sqrt((1.0 - delta**2) ** 3) / 3.0
    f_ys = -9.0 / 16.0 * a * load * mu * k_m * bracket
    return force * s_x / s_c, force * s_y / s_c + f_ys * omega / s_c


signed = st.floats(1e-5, 0.02) | st.floats(-0.02, -1e-5)


@given(signed, signed, spins, st.floats(1e3, 2e5), st.floats(0.02, 0.6), patches)
def test_polach_is_as_printed(slip_x, slip_y, spin, load, friction, patch):
    expected = printed_polach(slip_x, slip_y, spin, load, friction, patch)
    force = force_with_spin(slip_x, slip_y, spin, 0.0, load, friction, 1.0, 0.0, 1.0, 1.0, patch)
    assert_allclose(force, expected, rtol=1e-9, atol=1e-9 * friction * load)


@pytest.mark.parametrize("patch", [PATCH, OTHER])
def test_polach_begins_with_kalkers_linear_theory(patch):
    for slip in ((1e-8, 0.0, 0.0), (0.0, 1e-8, 0.0), (0.0, 0.0, 1e-6)):
        linear = linear_force(*slip, patch)
        assert max(linear) > 0.0
        assert_allclose(polach_force(*slip, 0.0, LOAD, patch, FRICTION), linear, rtol=1e-5, atol=0.0)
    reduced = polach_force(1e-8, 0.0, 0.0, 0.0, LOAD, patch, FRICTION, k_adhesion=0.3, k_slip=0.1)
    assert_allclose(reduced[0], 0.2 * linear_force(1e-8, 0.0, 0.0, patch)[0], rtol=1e-5)


@given(creepage, st.floats(0.0, 60.0), st.floats(1e3, 2e5), st.floats(0.02, 0.3), st.floats(0.3, 1.0))
def test_polach_on_straight_track_is_the_adhesion_curve(creep, slip_speed, load, friction, ratio):
    stiffness = contact_stiffness(PATCH.semi_axis_a, PATCH.semi_axis_b, PATCH.shear_modulus, PATCH.c11)
    f = polach_adhesion(creep, slip_speed, load, stiffness, friction, ratio, 0.4, 0.6, 0.2)
    force = polach_force(creep, 0.0, 0.0, slip_speed, load, PATCH, friction, ratio, 0.4, 0.6, 0.2)
    assert_allclose(force, (f * load, 0.0), rtol=1e-11, atol=1e-12)


@given(creepage, creepage, spins, st.floats(0.0, 60.0), patches)
def test_polach_keeps_the_limit_and_its_symmetries(slip_x, slip_y, spin, slip_speed, patch):
    def law(x, y, omega):
        return np.array(force_with_spin(x, y, omega, slip_speed, LOAD, FRICTION, 0.5, 0.3, 0.8, 0.4, patch))

    force = law(slip_x, slip_y, spin)
    assert np.linalg.norm(force) <= LIMIT / 0.5 * (1.0 + 1e-12)
    assert_allclose(law(-slip_x, -slip_y, -spin), -force, atol=1e-9 * LIMIT)
    assert_allclose(law(slip_x, -slip_y, -spin), force * (1.0, -1.0), atol=1e-9 * LIMIT)
    assert_allclose(law(-slip_x, slip_y, spin), force * (-1.0, 1.0), atol=1e-9 * LIMIT)


def test_polach_at_large_slip_is_kinetic_friction_and_at_large_spin_nothing():
    ratio, rate = 0.4, 0.6
    sliding = polach_force(0.6, 0.8, 0.0, 40.0, LOAD, PATCH, FRICTION, ratio, rate)
    assert_allclose(sliding, (0.6 * LIMIT, 0.8 * LIMIT), rtol=1e-3)
    slow = polach_force(0.6, 0.8, 0.0, 0.0, LOAD, PATCH, FRICTION, ratio, rate)
    assert_allclose(slow, (0.6 * LIMIT / ratio, 0.8 * LIMIT / ratio), rtol=5e-3)
    assert_allclose(polach_force(0.0, 0.0, 1e3, 0.0, LOAD, PATCH, FRICTION), 0.0, atol=1e-3 * LIMIT)


@pytest.mark.parametrize("slip", [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, -1e3, 0.0), (0.0, 0.0, -1.0), (1e6, 1e6, 1.0)])
@pytest.mark.parametrize("load", [0.0, -1.0, 1e-9, LOAD])
def test_polach_is_finite(slip, load):
    force = polach_force(*slip, 0.3, load, PATCH, FRICTION, 0.4, 0.6, 0.3, 0.1)
    assert np.all(np.isfinite(force))
    assert np.hypot(*force) <= max(load, 0.0) * FRICTION / 0.4 * (1.0 + 1e-12)


def test_polach_stays_near_the_exact_solution():
    creep, forces = reference_curve("contact_coulomb")
    force, _ = polach_force(creep, 0.0, 0.0, 0.0, LOAD, PATCH, FRICTION)
    print(f"from CONTACT: {np.max(np.abs(force - forces)) / LIMIT:.2%} of mu N at most")
    assert_allclose(force, forces, atol=0.15 * LIMIT)


def test_polach_is_the_same_one_by_one_and_in_batches():
    creep, friction = np.array([[-0.002], [0.0], [0.01]]), np.array([0.1, 0.3])
    batch = polach_force(creep, 0.001, 0.2, 0.5, LOAD, PATCH, friction, 0.4, 0.6, 0.3, 0.1)
    for i, j in np.ndindex(3, 2):
        single = force_with_spin(creep[i, 0], 0.001, 0.2, 0.5, LOAD, friction[j], 0.4, 0.6, 0.3, 0.1, PATCH)
        assert_allclose([batch[0][i, j], batch[1][i, j]], single, rtol=1e-13)


def test_measured_points_are_at_hand():
    text = (files("wsp_env") / "data" / "eurosprinter" / "measured.csv").read_text()
    points = np.array([[float(x) for x in row.values()] for row in csv.DictReader(io.StringIO(text))])
    assert points.shape == (180, 2)
    assert np.all((points[:, 0] > 0.0) & (points[:, 1] > 0.0) & (points[:, 1] < 0.5))
