"""Do the runs agree on a mechanism? What is missing has in every run the size that it has in the others.

The size is estimated in every run by itself, as a multiple of the one that was fitted to all. How uncertain the common one is,
the runs' scatter says, not the number of samples (a sandwich over clusters: Liang, Zeger, Biometrika 73, 1986). What noise, or
something else that is missing, lends a size to in some runs and not in others is no finding, however many rows fit better.
"""

from typing import NamedTuple

import numpy as np

from wsp_env.diagnosis.candidates import Variant, without
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Weights
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.variation import law_columns

#: Log of the likelihood ratio that the runs' sizes need: 95 %. They are asked this one question.
AGREED = float(np.log(19.0))
#: Share of what the recordings say of a size, below which a run says nothing of it.
_LEAST_SHARE = 0.02
#: Runs, counted by their shares, from which on their scatter can be told (assumption: that of two says next to nothing).
#: Where fewer say something, axles of runs are asked; what the vehicle's balance alone shows is then not asked.
_LEAST_RUNS = 3.0


class Agreement(NamedTuple):
    """What clusters of rows say of a mechanism, each by itself."""

    multiples: np.ndarray  # (R,) of the size fitted to all
    shares: np.ndarray  # (R,) of what is known of it; they sum to 1

    @property
    def several(self) -> float:
        """Number of clusters of equal shares that would say as much."""
        return 1.0 / float(self.shares @ self.shares)

    @property
    def evidence(self) -> float:
        """Log of the likelihood ratio of a common size over none, the scatter unknown (Student's t); inf: too few to tell."""
        several = self.several
        if several < _LEAST_RUNS:
            return np.inf
        mean = float(self.shares @ self.multiples)
        variance = float(self.shares**2 @ (self.multiples - mean) ** 2) * several / (several - 1.0)
        return 0.5 * several * float(np.log1p(mean**2 / max(variance, 1e-12) / (several - 1.0)))


def agreement(replica: Replica, model: Model, variant: Variant, weights: Weights) -> Agreement:
    """Return what every run says of a mechanism that is on, tau and each run's mu_cd free; of axles, where too few runs do."""
    base = replica.raw(model)
    off = weights(replica.raw(without(model, variant)) - base)
    law, left = weights(law_columns(replica, model, base)), weights(base)
    inner = weights.projector.inner
    given = np.linalg.pinv(inner(law, law), rcond=1e-9)
    moved, rest = (one - law @ (given @ inner(law, one[:, None])[:, 0]) for one in (off, left))
    kept = weights.projector.rest(np.column_stack([moved, rest]))
    rows = replica.rows
    found = _by(rows.run, moved, kept)
    return found if found.several >= _LEAST_RUNS else _by(rows.run * (replica.axles + 1) + rows.axle, moved, kept)


def _by(cluster: np.ndarray, moved: np.ndarray, kept: np.ndarray) -> Agreement:
    """Return what every cluster says of the size, where it says something."""
    _, index = np.unique(cluster, return_inverse=True)
    says = np.bincount(index, weights=moved * kept[:, 0])
    asks = np.bincount(index, weights=moved * kept[:, 1])
    used = says > _LEAST_SHARE * says.sum()
    return Agreement(1.0 + asks[used] / says[used], says[used] / says[used].sum())
