"""Every mechanism's row in the confusion matrix: what it does to the residuals of stops, beside what any other does."""

import warnings

import pytest

from wsp_env.diagnosis.balances import Balances
from wsp_env.diagnosis.candidates import variants
from wsp_env.diagnosis.fitting import baseline
from wsp_env.diagnosis.rules import largest_cosine
from wsp_env.diagnosis.search import scan
from wsp_env.diagnosis.stops import prepare
from wsp_env.plant.mechanisms import LIBRARY
from wsp_env.recordings import CampaignWarning, demo_campaign, read_campaign

#: Cosine from which on a campaign of several speeds and demands, with coasting, could not tell two mechanisms: a residual of
#: ten times the noise would leave no more than 1.4 times the noise between them.
SAME = 0.99


@pytest.fixture(scope="module")
def cosines():
    """Largest cosine between any variants of every two mechanisms, off the nuisances, in the demo campaign."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CampaignWarning)
        campaign = read_campaign(demo_campaign())
    balances = Balances(campaign, prepare(campaign)[0])
    model, weights = baseline(balances)
    found = scan(balances, model, weights, list(variants(balances)), held_out=False)
    members = {name: [i for i, one in enumerate(found.candidates) if one.variant and one.name == name] for name in LIBRARY}

    def cosine(i, j):
        return largest_cosine(found.whole.gram, found.columns_of(i), found.columns_of(j))

    return {a: {b: max(cosine(i, j) for i in members[a] for j in members[b]) for b in LIBRARY} for a in LIBRARY}


@pytest.mark.parametrize("name", LIBRARY)
def test_every_mechanism_has_a_trace_of_its_own(name, cosines):
    row = cosines[name]
    assert row[name] == pytest.approx(1.0, abs=1e-6)
    assert all(0.0 <= cosine < SAME for other, cosine in row.items() if other != name)


def test_what_rails_and_brakes_do_alike_looks_alike(cosines):
    """Gradient and drag retard without any wheel, cleaning and load transfer favour later or leading axles."""
    assert cosines["track_gradient"]["aerodynamic_drag"] > 0.5
    assert cosines["leading_axle_cleaning"]["load_transfer"] > 0.5
    assert cosines["track_gradient"]["leading_axle_cleaning"] < 0.3
