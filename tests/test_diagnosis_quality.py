"""What a mechanism removes of held-out rows, beside nuisances that could do nearly the same."""

from types import SimpleNamespace

import numpy as np
import pytest

from wsp_env.diagnosis.balances import Whitening
from wsp_env.diagnosis.candidates import Variant, switched
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Weights
from wsp_env.diagnosis.gls import Projector
from wsp_env.diagnosis.quality import _removed, left

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

    def raw(self, model: Model) -> np.ndarray:
        rise = model.choice.get("track_gradient", {}).get("rise", 0.0)
        return self._data - self._effect * rise - self._friction * np.log(np.array(model.mu_cd))[self.rows.run] / np.log(0.9)

    def weights(self) -> Weights:
        n = len(self._data)
        return Weights(Whitening(np.ones(n), ()), np.ones(n), Projector(self.sound, np.ones(15, dtype=bool)))


@pytest.mark.parametrize("alike", [0.0, 3.0])
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0, 2.0])
def test_what_is_removed_is_what_the_size_gets_right(share, alike):
    removed = []
    for seed in range(12):
        made = Linear(seed, alike)
        model = switched(Model(2e-4, (0.9, 0.9)), GRADIENT, np.array([share * TRUE]))
        found = left(made, model, [GRADIENT], made.weights(), {"all": np.ones(RUNS * EACH, dtype=bool)})["all"]
        assert found.best <= found.after + 1e-9
        removed.append(_removed(found, RUNS * EACH))
    assert np.median(removed) == pytest.approx(1.0 - (1.0 - share) ** 2, abs=0.15)


def test_nothing_can_be_removed_of_noise():
    made = Linear(3, 0.0)
    found = left(made, Model(2e-4, (0.9, 0.9)), [], made.weights(), {"last": made.rows.run == RUNS - 1})["last"]
    without = SimpleNamespace(before=1.02, after=1.02, best=1.0)
    assert found.before == pytest.approx(found.after)
    assert _removed(without, 800) is None
    assert _removed(None, 0) is None
