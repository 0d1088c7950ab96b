"""Hertz's ellipse, Kalker's table and the linear theory with its saturation, against independent references."""

import csv
import io
import math
from importlib.resources import files

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.special import ellipe, ellipk

from wsp_env.contact.hertz import axis_ratio, hertz
from wsp_env.contact.kalker import Patch, kalker_coefficients, kalker_force, kalker_table, linear_force, saturated_force

pytestmark = pytest.mark.plain

# The Eurosprinter case of Polach (2005).
LOAD, SHEAR, POISSON, FRICTION = 106.7e3, 82e9, 0.28, 0.33
YOUNG = 2.0 * SHEAR * (1.0 + POISSON)
CURVATURES = (0.8, 0.2814)

curvature = st.floats(1e-2, 1e2)
creepage = st.floats(-0.02, 0.02)
spins = st.floats(-2.0, 2.0)


def eurosprinter_patch() -> Patch:
    ellipse = hertz(*CURVATURES, LOAD, YOUNG, POISSON)
    a, b = float(ellipse.semi_axis_a_m), float(ellipse.semi_axis_b_m)
    return Patch(a, b, SHEAR, *(float(c) for c in kalker_coefficients(a / b, POISSON)))


def reference_curve(model: str) -> tuple[np.ndarray, np.ndarray]:
    text = (files("wsp_env") / "data" / "contact_reference_curves.csv").read_text()
    rows = [row for row in csv.DictReader(io.StringIO(text)) if row["model"] == model]
    assert rows
    assert all(float(row["normal_force_n"]) == LOAD for row in rows)
    return (
        np.array([float(row["creepage"]) for row in rows]),
        -np.array([float(row["longitudinal_force_n"]) for row in rows]),
    )


def test_ellipse_of_the_eurosprinter():
    ellipse = hertz(*CURVATURES, LOAD, YOUNG, POISSON)
    print(f"a = {ellipse.semi_axis_a_m * 1e3:.4f} mm, b = {ellipse.semi_axis_b_m * 1e3:.4f} mm")
    assert_allclose(ellipse.semi_axis_a_m, 6.304e-3, rtol=2e-3)
    assert_allclose(ellipse.semi_axis_b_m, 12.61e-3, rtol=2e-3)


@given(st.floats(0.05, 10.0), st.floats(1.0, 1e6))
def test_circle_has_the_textbook_solution(radius, load):
    # Johnson (1985), eqs. (4.22) to (4.24): z = r^2 / (2 R)
    modulus = YOUNG / (2.0 * (1.0 - POISSON**2))
    a = (3.0 * load * radius / (4.0 * modulus)) ** (1.0 / 3.0)
    ellipse = hertz(0.5 / radius, 0.5 / radius, load, YOUNG, POISSON)
    assert_allclose(ellipse, [a, a, a**2 / radius, 1.5 * load / (math.pi * a**2)], rtol=1e-11)


@given(curvature, curvature, st.floats(1.0, 1e6), st.floats(0.0, 0.5))
def test_ellipse_satisfies_hertz_equations(curvature_a, curvature_b, load, poisson):
    # Johnson (1985), eqs. (4.26), with Legendre's integrals of the longer semi-axis c and the shorter d.
    ellipse = hertz(curvature_a, curvature_b, load, YOUNG, poisson)
    a, b, approach, pressure = (float(x) for x in ellipse)
    assert (a - b) * (curvature_a - curvature_b) <= 0.0  # the stronger curvature has the shorter axis
    c, d = max(a, b), min(a, b)
    m = 1.0 - (d / c) ** 2
    scale = pressure * 2.0 * (1.0 - poisson**2) / YOUNG
    assert_allclose(pressure, 1.5 * load / (math.pi * a * b), rtol=1e-12)
    assert_allclose(approach, scale * d * ellipk(m), rtol=1e-9)
    if m > 1e-3:  # the equations lose their digits as the ellipse becomes a circle
        weak = scale * d / (c**2 * m) * (ellipk(m) - ellipe(m))
        strong = scale * d / (c**2 * m) * ((c / d) ** 2 * ellipe(m) - ellipk(m))
        assert_allclose([weak, strong], sorted([curvature_a, curvature_b]), rtol=1e-9)


@given(curvature, curvature)
def test_turning_the_bodies_turns_the_ellipse(curvature_a, curvature_b):
    assert_allclose(axis_ratio(curvature_a, curvature_b) * axis_ratio(curvature_b, curvature_a), 1.0, rtol=1e-12)


@given(st.floats(1.0, 1e6), st.floats(1e-3, 1e3))
def test_axes_grow_with_the_cube_root_of_the_load(load, factor):
    first, second = hertz(*CURVATURES, load, YOUNG, POISSON), hertz(*CURVATURES, factor * load, YOUNG, POISSON)
    assert_allclose(second.semi_axis_a_m, first.semi_axis_a_m * factor ** (1.0 / 3.0), rtol=1e-12)
    assert_allclose(second.max_pressure_pa, first.max_pressure_pa * factor ** (1.0 / 3.0), rtol=1e-12)


def test_without_load_there_is_no_contact():
    assert_allclose(hertz(*CURVATURES, 0.0, YOUNG, POISSON), 0.0, atol=0.0)


def test_hertz_broadcasts():
    loads = np.array([0.0, 1e3, 1e5])
    sums = np.array([[0.5], [1.0]])
    batch = hertz(sums, 0.3, loads, YOUNG, POISSON)
    assert {field.shape for field in batch} == {(2, 3)}
    for i, j in np.ndindex(2, 3):
        assert_allclose([field[i, j] for field in batch], hertz(sums[i, 0], 0.3, loads[j], YOUNG, POISSON), rtol=1e-13)


@pytest.mark.parametrize("bad", [0.0, -0.1, math.nan, math.inf, [0.5, -1.0]])
def test_curvature_that_does_not_close_is_refused(bad):
    with pytest.raises(ValueError, match="curvature sums must be finite and above zero"):
        hertz(bad, 0.3, LOAD, YOUNG, POISSON)
    with pytest.raises(ValueError, match="curvature sums must be finite and above zero"):
        hertz(0.3, bad, LOAD, YOUNG, POISSON)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((0.8, 0.3, -1.0, YOUNG, POISSON), "only pushes"),
        ((0.8, 0.3, LOAD, 0.0, POISSON), "Young's modulus"),
        ((0.8, 0.3, LOAD, YOUNG, 0.6), "Poisson's ratio"),
    ],
)
def test_impossible_load_or_material_is_refused(arguments, sentence):
    with pytest.raises(ValueError, match=sentence):
        hertz(*arguments)


def test_table_is_met_at_its_nodes_and_linear_in_poissons_ratio():
    ratios, values = kalker_table()
    for column, poisson in enumerate((0.0, 0.25, 0.5)):
        assert_allclose(np.stack(kalker_coefficients(ratios, poisson), axis=1), values[:, :, column], rtol=1e-12)
    for low, high in ((0.0, 0.25), (0.25, 0.5)):
        ends = np.array([kalker_coefficients(0.63, low), kalker_coefficients(0.63, high)])
        assert_allclose(kalker_coefficients(0.63, 0.3 * low + 0.7 * high), 0.3 * ends[0] + 0.7 * ends[1], rtol=1e-12)


def test_table_has_no_misprint():
    # Each inner number must follow from its neighbours by a cubic through the two on either side (logarithms).
    ratios, values = kalker_table()
    x, y = np.log(ratios), np.log(values)
    for i in range(2, len(x) - 2):
        near = [i - 2, i - 1, i + 1, i + 2]
        guess = sum(y[j] * np.prod([(x[i] - x[k]) / (x[j] - x[k]) for k in near if k != j]) for j in near)
        assert_allclose(np.exp(guess), values[i], rtol=0.015)


@pytest.mark.parametrize("poisson", [0.0, 0.25, 0.5])
def test_ends_of_the_table_approach_kalkers_asymptotes(poisson):
    g = 0.1
    narrow = [
        math.pi**2 / (4.0 * (1.0 - poisson)),
        math.pi**2 / 4.0,
        math.pi * math.sqrt(g) / (3.0 * (1.0 - poisson)) * (1.0 + poisson * (math.log(16.0 / g) - 5.0)),
    ]
    assert_allclose(kalker_coefficients(g, poisson), narrow, rtol=0.07)
    log, gap = math.log(16.0 / g**2), 3.0 - math.log(4.0)
    shear = (1.0 - poisson) * log + 2.0 * poisson
    slender = [
        2.0 * math.pi / ((log - 2.0 * poisson) * g) * (1.0 + gap / (log - 2.0 * poisson)),
        2.0 * math.pi / (shear * g) * (1.0 + (1.0 - poisson) * gap / shear),
        2.0 * math.pi / (3.0 * g**1.5 * ((1.0 - poisson) * log - 2.0 + 4.0 * poisson)),
    ]
    assert_allclose(kalker_coefficients(1.0 / g, poisson), slender, rtol=0.07)


@given(st.floats(0.1, 10.0), st.floats(0.1, 10.0), st.floats(0.0, 0.5))
def test_lateral_coefficients_grow_with_the_ratio_of_axes(first, second, poisson):
    low, high = (kalker_coefficients(x, poisson) for x in sorted((first, second)))
    assert low.c22 <= high.c22 * (1.0 + 1e-12)
    assert low.c23 <= high.c23 * (1.0 + 1e-12)


def test_coefficients_broadcast():
    ratios, poissons = np.array([[0.2], [1.0], [7.0]]), np.array([0.1, 0.3])
    batch = kalker_coefficients(ratios, poissons)
    for i, j in np.ndindex(3, 2):
        single = kalker_coefficients(ratios[i, 0], poissons[j])
        assert_allclose([field[i, j] for field in batch], single, rtol=1e-14)


@pytest.mark.parametrize("ratio", [0.09, 10.1, 0.0, -1.0, math.nan, [1.0, 20.0]])
def test_ellipse_outside_the_table_is_refused(ratio):
    with pytest.raises(ValueError, match=r"covers a / b from 0\.1 to 10"):
        kalker_coefficients(ratio, 0.3)


@pytest.mark.parametrize("poisson", [-0.01, 0.51, math.nan])
def test_material_outside_the_table_is_refused(poisson):
    with pytest.raises(ValueError, match=r"covers Poisson's ratio from 0 to 0\.5"):
        kalker_coefficients(1.0, poisson)


def test_initial_slope_is_that_of_the_exact_solution():
    creepages, forces = reference_curve("contact_coulomb")
    linear, _ = linear_force(creepages[0], 0.0, 0.0, eurosprinter_patch())
    print(f"initial slope, linear theory over CONTACT: {linear / forces[0] - 1.0:+.2%}")
    assert_allclose(linear, forces[0], rtol=0.015)


def test_johnson_vermeulen_stays_near_the_exact_solution():
    creepages, forces = reference_curve("contact_coulomb")
    saturated, lateral = kalker_force(creepages, 0.0, 0.0, LOAD, FRICTION, eurosprinter_patch())
    print(f"Johnson-Vermeulen from CONTACT: {np.max(np.abs(saturated - forces)) / (FRICTION * LOAD):.2%} of mu N at most")
    assert_allclose(saturated, forces, atol=0.05 * FRICTION * LOAD)
    assert_allclose(lateral, 0.0, atol=0.0)


@given(creepage, creepage, spins)
def test_saturated_force_points_along_the_linear_one_and_keeps_the_limit(slip_x, slip_y, spin):
    patch = eurosprinter_patch()
    linear = np.array(linear_force(slip_x, slip_y, spin, patch))
    force = np.array(saturated_force(slip_x, slip_y, spin, LOAD, FRICTION, patch))
    limit = FRICTION * LOAD
    assert np.linalg.norm(force) <= limit * (1.0 + 1e-12)
    assert np.linalg.norm(force) <= np.linalg.norm(linear) * (1.0 + 1e-12)
    assert_allclose(force[0] * linear[1], force[1] * linear[0], rtol=1e-12, atol=1e-12)
    assert np.dot(force, linear) >= 0.0
    assert_allclose(saturated_force(-slip_x, -slip_y, -spin, LOAD, FRICTION, patch), -force, atol=0.0)
    if np.linalg.norm(linear) >= 3.0 * limit:
        assert_allclose(np.linalg.norm(force), limit, rtol=1e-12)


def test_saturated_force_begins_with_the_linear_one():
    patch = eurosprinter_patch()
    for slip in ((1e-9, 0.0, 0.0), (0.0, 1e-9, 0.0), (0.0, 0.0, 1e-7)):
        linear = linear_force(*slip, patch)
        assert max(linear) > 0.0  # positive creepage or spin: positive force
        assert_allclose(saturated_force(*slip, LOAD, FRICTION, patch), linear, rtol=1e-5)


def test_saturated_force_without_load_friction_or_slip_is_zero():
    patch = eurosprinter_patch()
    assert_allclose(kalker_force(0.01, 0.01, 0.1, [0.0, LOAD, LOAD], [0.3, 0.0, 0.3], patch)[0][:2], 0.0, atol=0.0)
    assert_allclose(kalker_force(0.0, 0.0, 0.0, LOAD, 0.3, patch), 0.0, atol=0.0)


def test_force_is_the_same_one_by_one_and_in_batches():
    patch = eurosprinter_patch()
    creepages, loads = np.linspace(-0.01, 0.01, 5)[:, None], np.array([0.0, 5e4, 1e5])
    batch = kalker_force(creepages, 0.002, 0.1, loads, 0.3, patch)
    assert batch[0].shape == batch[1].shape == (5, 3)
    for i, j in np.ndindex(5, 3):
        single = saturated_force(creepages[i, 0], 0.002, 0.1, loads[j], 0.3, patch)
        assert_allclose([batch[0][i, j], batch[1][i, j]], single, rtol=1e-14)
