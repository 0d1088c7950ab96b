"""What a mechanism removes of held-out rows, beside nuisances that could do nearly the same."""

from types import SimpleNamespace

import numpy as np
import pytest
from trial_cases import GAIN, PLAIN, trial

from wsp_env.diagnosis import quality as module
from wsp_env.diagnosis.accepted import Accepted
from wsp_env.diagnosis.balances import BALANCES, Whitening
from wsp_env.diagnosis.candidates import Variant, switched
from wsp_env.diagnosis.covariance import Sizes
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Fitted
from wsp_env.diagnosis.gls import Projector
from wsp_env.diagnosis.quality import Level, Side, _removed, level, misfits, quality
from wsp_env.diagnosis.weights import Weights

GRADIENT = Variant("track_gradient", ("rise",), {})
TRUE = 0.003
RUNS, EACH = 2, 400


class Linear:
    """Recordings of a gradient, of friction that differs between runs and of sound variation, and models of them."""

    def __init__(self, seed: int, alike: float) -> None:
        rng = np.random.default_rng(seed)
        n = RUNS * EACH
        self.rows = SimpleNamespace(run=np.repeat(np.arange(RUNS), EACH))
        self.stops = range(RUNS)
        self._effect, self._friction = 4e3 * rng.standard_normal(n), 30.0 * rng.standard_normal(n)
        self.sound = rng.standard_normal((n, 15))
        self.sound[:, 0] = alike * self._effect / 4e3  # a nuisance that is the gradient, at a size that matters little
        mu = np.where(self.rows.run == 0, 0.1, -0.2)
        drawn = self.sound @ rng.standard_normal(15) + rng.standard_normal(n)
        self._data = self._effect * TRUE + self._friction * mu + drawn

    def raw(self, model: Model, beside: Model | None = None) -> np.ndarray:
        rise = model.choice.get("track_gradient", {}).get("rise", 0.0)
        return self._data - self._effect * rise - self._friction * np.log(np.array(model.mu_cd))[self.rows.run] / np.log(0.9)

    def weights(self) -> Weights:
        n = len(self._data)
        return Weights(Whitening(np.ones(n), ()), np.ones(n), Projector.of(self.sound, np.ones(15, dtype=bool)))


@pytest.mark.parametrize("alike", [0.0, 3.0])
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0, 2.0])
def test_what_is_removed_is_what_the_size_gets_right(share, alike):
    removed = []
    for seed in range(12):
        made = Linear(seed, alike)
        model = switched(Model(2e-4, (0.9, 0.9)), GRADIENT, np.array([share * TRUE]))
        both = level(made, model, [GRADIENT], made.weights(), Model(2e-4, (0.9, 0.9)))
        found = both.left(np.ones(RUNS * EACH, dtype=bool))
        assert found.best <= found.after + 1e-9
        removed.append(_removed(found, RUNS * EACH))
    assert np.median(removed) == pytest.approx(1.0 - (1.0 - share) ** 2, abs=0.15)


def test_nothing_can_be_removed_of_noise():
    made = Linear(3, 0.0)
    bare = Model(2e-4, (0.9, 0.9))
    found = level(made, bare, [], made.weights(), bare).left(made.rows.run == RUNS - 1)
    without = SimpleNamespace(before=1.02, after=1.02, best=1.0)
    assert found.before == pytest.approx(found.after)
    assert _removed(without, 800) is None
    assert _removed(None, 0) is None


class Asked(SimpleNamespace):
    """A replica that is only passed on."""

    __hash__ = object.__hash__


@pytest.mark.parametrize("second", [False, True])
def test_an_extension_is_asked_about_its_own_replica_and_the_baseline_about_its_own(monkeypatch, second):
    """About the baseline's it would fit worse than nothing. What is left beside a name that the runs refuse is fitted again."""
    rows = SimpleNamespace(validate=np.array([False, True]), balance=np.zeros(2, dtype=int), run=np.arange(2))
    bare = Model(2e-4, (0.06, 0.06))
    base, own = (Asked(name=name, rows=rows, baseline=bare, about=bare, recorded=None) for name in "bo")
    again, asked = Asked(name="again", rows=rows, about=bare), []
    on = switched(base.baseline, GRADIENT, np.array([TRUE]))
    accepted = [Accepted(trial(GRADIENT, 40.0), ("track_gradient",), 1.0)]
    if second:
        on = switched(on, GAIN, np.array([0.05]))
        accepted.append(Accepted(trial(GAIN, 40.0), ("brake_gain_imbalance",), 1.0))
    variants = tuple(one.trial.variant for one in accepted)

    def refit(replica, model, variants, weights, keep=None):
        asked.append((replica.name, tuple(model.choice), len(variants)))
        # The brake's gain costs the held-out runs 5, the gradient saves them 90.
        cost = 100.0 - 90.0 * ("track_gradient" in model.choice) + 5.0 * ("brake_gain_imbalance" in model.choice)
        return Fitted(model, tuple(variants), (), (), cost if replica.name != "b" else 1000.0)

    def stub_level(replica, model, kept, weights, baseline):
        assert not baseline.choice
        assert tuple(model.choice) == ("track_gradient",)
        return Level(*(Side(np.full(2, np.sqrt(square)), np.zeros((2, 1)), 0.0)
                       for square in ((30.0, 80.0, 1.0) if replica.name == "b" else (90.0, 1.0, 1.0))))  # fmt: skip

    monkeypatch.setattr(module, "weigh", lambda *_: PLAIN)
    monkeypatch.setattr(module, "Weighing", lambda *_: lambda keep: PLAIN)
    monkeypatch.setattr(module, "slide_whitening", lambda *_: None)
    monkeypatch.setattr(module, "refit", refit)
    monkeypatch.setattr(module, "level", stub_level)
    monkeypatch.setattr(module, "replica_of", lambda *_: again)
    white, sizes = Whitening(np.ones(2), ()), Sizes(np.ones(0), np.ones(5))
    screen = SimpleNamespace(groups=(), times=None, whitening=white, colour=None, sizes=sizes)
    outcome = SimpleNamespace(
        first=screen, last=screen, replica=own, fitted=Fitted(on, variants, (), (), 10.0), accepted=accepted
    )
    found = quality(base, outcome)
    assert found.repeated == ((True, False) if second else (True,))
    assert found.held_out == ((90.0, 0.0) if second else (90.0,))
    assert (found.fit.baseline["validate"], found.fit.extended["validate"]) == (pytest.approx(30.0), 1.0)
    assert found.fit.removed_validate == pytest.approx(1.0)
    assert found.removed_of == {BALANCES[0]: pytest.approx(1.0)} | dict.fromkeys(BALANCES[1:])
    assert asked[0] == ("b", (), 0)
    assert ("again", ("track_gradient",), 1) in asked or not second
    assert {name for name, choice, _ in asked if choice} == ({"o", "again"} if second else {"o"})


def test_runs_misfit_if_all_of_them_do():
    run, rng = np.repeat(np.arange(4), 500), np.random.default_rng(4)
    noise = rng.standard_normal(len(run)) ** 2
    assert not misfits(noise, run)
    assert misfits(1.3 * noise, run)
    assert not misfits(np.where(run == 3, 1.5, 1.0) * noise, run)  # its own rail, which says nothing of the others
    assert misfits(1.3 * noise, np.zeros(len(run), dtype=int))  # a single run has only its rows


def test_a_misfit_counts_runs_not_rows():
    """With friction of its own in each run, whose mean square is right on average, few campaigns misfit."""
    rng = np.random.default_rng(5)
    run = np.repeat(np.arange(6), 400)
    found = []
    for _ in range(300):
        own = rng.gamma(8.0, 1.0 / 8.0, 6)[run]
        found.append(misfits(own * rng.standard_normal(len(run)) ** 2, run))
    assert np.mean(found) < 0.08
