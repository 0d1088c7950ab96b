"""exp and atan of the contact laws in batches: against numpy's, and how kernels come to use them."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from wsp_env.compiled import elementwise, kernel, with_math
from wsp_env.contact import elementary
from wsp_env.contact.elementary import atan, exp


def _exp(x: float) -> float:
    return exp(x)


def _atan(x: float) -> float:
    return atan(x)


@pytest.mark.plain
def test_relative_errors_are_two_units_in_the_last_place():
    rng = np.random.default_rng(1)
    x = np.concatenate([rng.uniform(-700.0, 700.0, 2000), rng.choice([-1.0, 1.0], 2000) * 10 ** rng.uniform(-12.0, 2.0, 2000)])
    assert_allclose(elementwise(_exp)(x), np.exp(x), rtol=5e-16)
    y = rng.choice([-1.0, 1.0], 4000) * 10 ** rng.uniform(-12.0, 12.0, 4000)
    y[:4] = [0.66, np.nextafter(0.66, 1.0), 1.0, 1.0 + math.sqrt(2.0)]
    assert_allclose(elementwise(_atan)(y), np.arctan(y), rtol=5e-16)


@pytest.mark.plain
@np.errstate(invalid="ignore")
def test_zero_infinity_and_what_is_no_number():
    assert_array_equal(elementwise(_exp)(np.array([0.0, -0.0, np.nan])), [1.0, 1.0, np.nan])
    assert 0.0 <= elementwise(_exp)(np.array([-np.inf]))[0] < 1e-307
    assert elementwise(_exp)(np.array([np.inf]))[0] > 1e307
    assert_array_equal(elementwise(_atan)(np.array([0.0, np.nan])), [0.0, np.nan])
    assert_allclose(elementwise(_atan)(np.array([np.inf, -np.inf])), [0.5 * np.pi, -0.5 * np.pi], rtol=1e-16)


@kernel
def _growth(x: float) -> float:
    return math.exp(x)


@kernel
def _compound(x: float) -> float:
    return math.sqrt(_growth(x))


@pytest.mark.plain
def test_a_kernel_and_what_it_calls_with_another_math():
    x = np.linspace(-20.0, 20.0, 400)
    again = with_math(_compound, elementary)
    assert_array_equal([again(value) for value in x], [math.sqrt(exp(value)) for value in x])
    assert_array_equal([_compound(value) for value in x], [math.sqrt(_growth(value)) for value in x])
    assert any(again(value) != _compound(value) for value in x)  # both are exact to a rounding error, but not the same
