"""Cholesky factors and triangular systems without Python's lock, against numpy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from wsp_env.diagnosis.triangular import cholesky, inverse_of, solved


def positive(seed, size):
    root = np.random.default_rng(seed).standard_normal((size, size + 2))
    return root @ root.T + np.eye(size)


@given(st.integers(0, 10_000), st.integers(0, 40))
def test_factor_and_inverse_belong_to_the_matrix(seed, size):
    matrix = positive(seed, size)
    factor = cholesky(matrix)
    assert_allclose(factor, np.tril(factor))
    assert_allclose(factor @ factor.T, matrix, atol=1e-9)
    assert_allclose(inverse_of(factor) @ matrix, np.eye(size), atol=1e-8)


@given(st.integers(0, 10_000), st.integers(1, 40), st.integers(0, 5), st.sampled_from("CF"), st.booleans())
def test_systems_are_solved_in_any_order_of_memory(seed, size, wanted, order, transposed):
    factor = np.asarray(cholesky(positive(seed, size)), order=order)
    matrix = factor.T if transposed else factor
    rng = np.random.default_rng(seed)
    several, one = np.asarray(rng.standard_normal((size, wanted)), order=order), rng.standard_normal(size)
    kept = several.copy()
    assert_allclose(matrix @ solved(factor, several, transposed), several, atol=1e-8)
    assert_allclose(matrix @ solved(factor, one, transposed), one, atol=1e-8)
    assert_allclose(several, kept, err_msg="the right-hand sides are not overwritten")


def test_a_matrix_that_is_not_positive_definite_is_told():
    with pytest.raises(np.linalg.LinAlgError, match="leading minor 2"):
        cholesky(np.array([[1.0, 2.0], [2.0, 1.0]]))
