"""The size of an effect net of the law: none where the law does the same, all of it where no law does."""

import dataclasses

import numpy as np
import pytest

from experiments.concealed.effects import ALL, Place
from experiments.concealed.interest import _mean_slip, sizes
from experiments.concealed.net import net
from experiments.concealed.setup import reference
from wsp_env.recordings.tuning import RunScore, Tuning


def tuned(setup, tau=1.0, mu_cd=1.0):
    """The law that a setup was driven with, or one by factors beside it."""
    runs = {name: RunScore("tune", mu_cd * run.mu_cd, True, (None,) * 4) for name, run in setup.runs.items()}
    return Tuning(tau * setup.law.tau, (0.0, 1.0), runs)


@pytest.fixture(scope="module")
def plain():
    return reference()


def test_what_another_law_does_as_well_is_nothing(plain):
    """Stops on a rail with 20 % more friction and twice the recovery: the law tuned to them does just that."""
    law = plain.law._replace(tau=2.0 * plain.law.tau)
    moved = {name: run._replace(mu_cd=1.2 * run.mu_cd) for name, run in plain.runs.items()}
    better = dataclasses.replace(plain, law=law, runs=moved)
    assert net(better, plain, tuned(better), tuned(plain)) == 0.0
    assert net(better, plain, None, None) > 5.0  # the same, where nothing was tuned


def test_what_no_law_does_is_left(plain):
    """A gradient that slows the gentle stop by twice what matters, whatever the law."""
    slope = ALL["track_gradient"].apply(plain, 2.0 * sizes()["track_gradient/0"], Place())
    assert net(slope, plain, tuned(plain), tuned(plain)) == pytest.approx(2.0, rel=0.2)


def test_a_stop_that_ends_fast_says_nothing_of_low_speeds():
    columns = {"vehicle_speed_mps": np.linspace(28.0, 14.5, 50), "axle1_wheel_speed_radps": np.linspace(60.0, 30.0, 50)}
    slip = _mean_slip(columns)
    assert slip[1, 0] == 0.0
    assert slip[0, 0] != 0.0
