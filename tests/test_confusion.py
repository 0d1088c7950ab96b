"""Every mechanism's row in the confusion matrix: what it does to the residuals of stops, beside what any other does."""

import warnings

import numpy as np
import pytest

from wsp_env.diagnosis.balances import Balances
from wsp_env.diagnosis.baseline import baseline
from wsp_env.diagnosis.candidates import columns, variants
from wsp_env.diagnosis.stops import prepare
from wsp_env.diagnosis.variation import nuisances
from wsp_env.diagnosis.weights import weigh
from wsp_env.plant.mechanisms import LIBRARY
from wsp_env.recordings import CampaignWarning, demo_campaign, read_campaign

#: Cosine from which on a campaign of several speeds and demands, with coasting, could not tell two mechanisms: a residual of
#: ten times the noise would leave no more than 1.4 times the noise between them.
SAME = 0.99


def largest_cosine(gram: np.ndarray, a: slice, b: slice) -> float:
    """Largest cosine between what two sets of columns can do to the residuals, by their inner products."""
    roots = []
    for index in (a, b):
        values, vectors = np.linalg.eigh(gram[index, index])
        kept = values > 1e-9 * max(float(values[-1]), 1e-300)
        roots.append(vectors[:, kept] / np.sqrt(values[kept]))
    cosine = np.linalg.svd(roots[0].T @ gram[a, b] @ roots[1], compute_uv=False).max(initial=0.0)
    return float(min(cosine, 1.0))


def test_cosines_between_planes_are_those_of_geometry():
    """A plane and a line 60 degrees off it; two planes that share a line; a plane and its normal."""
    x = np.array([[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.5, 0.0, np.sqrt(0.75)], [0.0, 0.0, 1.0]]).T
    gram = x.T @ x
    plane = slice(0, 2)
    assert largest_cosine(gram, plane, slice(2, 3)) == pytest.approx(0.5)
    assert largest_cosine(gram, plane, slice(1, 3)) == pytest.approx(1.0)
    assert largest_cosine(gram, plane, slice(3, 4)) == pytest.approx(0.0, abs=1e-12)


@pytest.fixture(scope="module")
def cosines():
    """Largest cosine between any variants of every two mechanisms, off the law and all nuisances, in the demo campaign."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CampaignWarning)
        campaign = read_campaign(demo_campaign())
    replica = baseline(Balances(campaign, prepare(campaign)[0]))
    model = replica.baseline
    base, whitening = replica.raw(model), replica.whitening(model)
    # Under other names, as weights leave tau and mu_cd to the fit.
    groups = [one._replace(name=f"known: {one.name}") for one in nuisances(replica, model, base, whitening)]
    weights = weigh(replica, whitening, groups)
    found, members, first = [], {name: [] for name in LIBRARY}, 0
    for variant in variants(replica):
        found.append(weights(columns(replica, model, base, variant)))
        members[variant.name].append(slice(first, first := first + found[-1].shape[1]))
    every = np.column_stack(found)
    gram = weights.projector.inner(every, every)
    return {a: {b: max(largest_cosine(gram, i, j) for i in members[a] for j in members[b]) for b in LIBRARY} for a in LIBRARY}


@pytest.mark.parametrize("name", LIBRARY)
def test_every_mechanism_has_a_trace_of_its_own(name, cosines):
    row = cosines[name]
    assert row[name] == pytest.approx(1.0, abs=1e-6)
    assert all(0.0 <= cosine < SAME for other, cosine in row.items() if other != name)


def test_what_rails_and_brakes_do_alike_looks_alike(cosines):
    """Gradient and drag retard without any wheel, cleaning and load transfer favour later or leading axles."""
    kin, strangers = ("leading_axle_cleaning", "load_transfer"), ("track_gradient", "aerodynamic_drag")
    for name, other in (kin, strangers):
        alike = cosines[name][other]
        assert alike > 2.0 * max(cosines[a][b] for a in kin for b in strangers)
