"""A run whose wheels grip with more than the friction that was believed: its rail was dry, unlike the others."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from synthetic_stops import stop, write_campaign

from wsp_env.diagnosis.balances import Balances
from wsp_env.diagnosis.baseline import baseline
from wsp_env.diagnosis.stops import prepare
from wsp_env.diagnosis.weights import sliding
from wsp_env.recordings import read_campaign

TAU, WET, DRY = 2e-4, 0.05, 0.11


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    runs = {f"wet{k}": stop(TAU, WET, noise=1.0, seed=k) for k in range(2)}
    runs |= {f"dry{k}": stop(TAU, DRY, peak=0.006, noise=1.0, seed=k) for k in range(2)}
    return read_campaign(write_campaign(tmp_path_factory.mktemp("dry") / "campaign", runs))


def test_its_friction_is_the_likeliest(campaign):
    stops, _ = prepare(campaign)
    recorded = Balances(campaign, stops)
    assert {stop.believed_mu_cd for stop in stops} == {campaign.contact.kinetic_friction_d}
    assert sliding(recorded).tolist() == [stop.name.startswith("wet") for stop in stops]
    found = baseline(recorded)
    for one, mu_cd in zip(stops, found.baseline.mu_cd, strict=True):
        assert_allclose(mu_cd, WET if one.name.startswith("wet") else DRY, rtol=0.1, err_msg=one.name)
    squares = found.whitening(found.about)(found.raw(found.baseline)) ** 2
    dry = [i for i, one in enumerate(stops) if one.name.startswith("dry")]
    assert np.mean(squares[found.rows.wheels & np.isin(found.rows.run, dry)]) < 2.0
