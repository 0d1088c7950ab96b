"""The part of a mechanism's effect that slip and torque predicted before each block do not contain."""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from replica_cases import LAW, sound_balances

from wsp_env.diagnosis import baseline, fitting
from wsp_env.diagnosis.balances import ADHESION
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.gls import Projector
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.weights import Weights

TRANSFER = {"load_transfer": {"body_height_m": 0.5, "pivot_height_m": 0.6}}
LATE = {"wheel_speed_lag": {"lag_s": 0.05}}


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    return sound_balances(tmp_path_factory.mktemp("unpredicted") / "c")


def sliding(balances):
    rows = balances.rows
    return (rows.balance == ADHESION) & (rows.slip > 0.05 * rows.speed)


def test_a_fit_is_charged_for_how_much_its_friction_follows_the_slip(sound):
    """About a memory, friction follows the slip less at once: its determinant is larger. Each cost contains it."""
    law, memory = (
        Replica(sound, Model(LAW.tau, LAW.mu_cd, choice)) for choice in ({}, {"contaminant_memory": {"distance_m": 3.0}})
    )
    assert law.determinant < memory.determinant
    assert sound.determinant == 0.0
    weights = Weights(law.whitening(LAW), np.ones(len(law.rows)), Projector.of(np.zeros((len(law.rows), 0)), np.zeros(0, bool)))
    left = weights(law.raw(LAW))
    assert fitting.cost(law, LAW, weights) == pytest.approx(left @ left + law.determinant)


def test_only_mechanisms_that_change_the_contact_have_an_unpredicted_part(sound):
    assert Replica(sound, LAW).unpredicted is None
    assert Replica(sound, Model(LAW.tau, LAW.mu_cd, LATE)).unpredicted is None
    found = Replica(sound, Model(LAW.tau, LAW.mu_cd, TRANSFER)).unpredicted
    assert np.abs(found[sliding(sound)]).max() > 0.0
    assert_allclose(found[~sound.rows.wheels], 0.0, atol=1e-12)  # no force of the vehicle differs


def test_without_it_the_recordings_are_compared_as_the_law_alone_compares_them(sound):
    """A mechanism's effect is then only the predicted one: where wheels slide, the law's residuals are what they were."""
    slides = sliding(sound)
    about, bare = Replica(sound, Model(LAW.tau, LAW.mu_cd, TRANSFER)), Replica(sound, LAW)
    before = bare.raw(LAW)[slides]
    far, near = ((about.without(share).raw(LAW)[slides] - before).std() for share in (0.0, 1.0))
    assert near < 0.5 * before.std() < far  # half of what the law leaves
    assert about.without(0.0) is about
    half = about.without(0.5)
    assert_allclose(half.raw(LAW), about.raw(LAW) - 0.5 * about.unpredicted, rtol=1e-12, atol=1e-15)
    assert_allclose(half.without(1.0).raw(LAW), about.without(1.0).raw(LAW), rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize(("true", "found"), [(0.3, 0.3), (-0.5, 0.0), (1.7, 1.0)])
def test_the_share_that_fits_best_is_removed_within_its_limits(monkeypatch, true, found):
    """Beyond the nuisances: a constant in the residuals is none of it."""
    random = np.random.default_rng(1)
    part = random.normal(size=200)
    removed = []
    replica = SimpleNamespace(
        unpredicted=part, about=LAW, raw=lambda _: true * part + 5.0, without=lambda share: removed.append(share)
    )
    monkeypatch.setattr(baseline, "Replica", lambda *_: replica)
    constant = Projector.of(np.ones((200, 1)), np.zeros(1, dtype=bool))
    weights = type("Weights", (), {"__call__": lambda _, raw: raw, "projector": constant})()
    baseline.replica_of(None, LAW, weights)
    assert removed == pytest.approx([found], abs=1e-9)
