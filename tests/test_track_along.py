"""Friction along the track as columns: what they say of two places, and places that have nothing to do with each other."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wsp_env.diagnosis.variation import _track

LENGTH_M = 3.0


@given(st.integers(0, 1000))
@settings(deadline=None, max_examples=20)
def test_friction_is_alike_over_a_length_and_not_beyond(seed):
    places = np.sort(np.random.default_rng(seed).uniform(0.0, 40.0, 30))
    columns = _track(places, np.ones(30, dtype=bool), LENGTH_M)
    covariance = columns @ columns.T
    expected = np.exp(-0.5 * (np.subtract.outer(places, places) / LENGTH_M) ** 2)
    assert covariance == pytest.approx(expected, abs=0.25)  # linear between nodes half a length apart
    assert np.abs(covariance - expected).mean() < 0.05


def test_runs_far_from_each_other_have_columns_of_their_own():
    """Placed one run after the other, as where nobody knows where they began: as each alone, and none else is touched."""
    one = np.random.default_rng(0).uniform(0.0, 60.0, 50)
    both, used = np.concatenate([one, one + 500.0]), np.arange(100) % 7 > 0
    columns = _track(both, used, LENGTH_M)
    first, second = columns[:50].any(axis=0), columns[50:].any(axis=0)
    assert not (first & second).any()
    alone = _track(one, used[:50], LENGTH_M)
    assert columns[:50, first] @ columns[:50, first].T == pytest.approx(alone @ alone.T)
    assert not columns[~used].any()
    assert _track(both, np.zeros(100, dtype=bool), LENGTH_M).shape == (100, 0)
