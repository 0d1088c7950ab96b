"""The law alone: fitted with the nuisance sizes that the recordings show, on a replica about itself."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose
from synthetic_stops import stop, write_campaign

from wsp_env.diagnosis.balances import Balances
from wsp_env.diagnosis.baseline import baseline
from wsp_env.diagnosis.convergence import converge_law
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.stops import prepare
from wsp_env.recordings import read_campaign

TRUE = Model(2e-4, (0.06, 0.05, 0.07))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    stops = {f"A{i}": stop(TRUE.tau, mu, noise=4.0, seed=i) for i, mu in enumerate(TRUE.mu_cd)}
    folder = tmp_path_factory.mktemp("law") / "c"
    write_campaign(folder, stops, list(stops), [])
    campaign = read_campaign(folder)
    return Balances(campaign, prepare(campaign)[0])


@pytest.fixture(scope="module")
def converged(recorded):
    return converge_law(baseline(recorded))


def law(model):
    return np.array([model.tau, *model.mu_cd])


def test_noisy_recordings_of_the_law_give_the_law(converged):
    replica, _ = converged
    assert replica.baseline.tau == pytest.approx(TRUE.tau, rel=0.02)
    assert_allclose(replica.baseline.mu_cd, TRUE.mu_cd, rtol=0.02)


def test_it_is_where_it_stays(converged):
    again, _ = converge_law(converged[0])
    assert_allclose(law(again.baseline), law(converged[0].baseline), rtol=0.005)


def test_it_does_not_depend_on_the_law_it_begins_with(recorded, converged):
    far = dataclasses.replace(TRUE, tau=0.5 * TRUE.tau, mu_cd=tuple(1.15 * mu for mu in TRUE.mu_cd))
    found, _ = converge_law(Replica(recorded, far))
    assert_allclose(law(found.baseline), law(converged[0].baseline), rtol=0.02)
