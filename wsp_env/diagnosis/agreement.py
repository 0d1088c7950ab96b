"""What the runs leave of the evidence for a mechanism: what is missing has in every run the size that it has in the others.

Every run has a size of its own, as a multiple of the one that was fitted to all, estimated beside all nuisances: those of one
run are learned from it, those that runs share (a brake's gain, the law's form) from all. How uncertain the sizes are, noise
and nuisances say, and by how much nature's form may differ from the mechanism's from run to run
(`wsp_env.diagnosis.trials.FORM`). Where the runs miss their common size by more than that, the model of what varies is too
small in just this direction, and so is the uncertainty that the evidence was computed with. By which factor is unknown: it is
believed to be 1, and learned from the runs. With the factor integrated out, a likelihood ratio is Student's t's (Wedderburn,
Biometrika 61, 1974, on the factor; Gelman et al., Bayesian data analysis, 2014, chapter 3, on the integral).
"""

from typing import NamedTuple

import numpy as np

from wsp_env.diagnosis.candidates import Variant, without
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Weights
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.variation import LOG_TAU, MU_CD, law_columns

#: Number of squares that the belief in the uncertainty as computed counts for: assumption, half of what eight runs say.
BELIEVED = 4.0
#: Share of what the recordings say of a size, below which a run says nothing of it.
_LEAST_SHARE = 0.02


class Agreement(NamedTuple):
    """What every run that says something of a mechanism says."""

    multiples: np.ndarray  # (R,) of the size fitted to all
    covariance: np.ndarray  # (R, R) of the same, that of the form included

    @property
    def missed(self) -> float:
        """Sum of squares by which they miss their common size: one less than there are runs is expected."""
        if not len(self.multiples):
            return 0.0
        precision = np.linalg.inv(self.covariance)
        rest = self.multiples - float(precision.sum(axis=0) @ self.multiples) / float(precision.sum())
        return float(rest @ precision @ rest)

    def left_of(self, evidence: float) -> float:
        """Return what is left of an evidence."""
        counts = BELIEVED + len(self.multiples) - 1.0
        return 0.5 * (counts + 1.0) * float(np.log1p(2.0 * max(evidence, 0.0) / (BELIEVED + self.missed)))


def agreement(replica: Replica, model: Model, variant: Variant, weights: Weights, form: float = 0.0) -> Agreement:
    """Return what every run says of a mechanism that is on, beside tau, every run's mu_cd and all nuisances.

    Parameters
    ----------
    form : share of the effect that nature's form may differ by from run to run

    """
    base = replica.raw(model)
    off, left = weights(replica.raw(without(model, variant)) - base), weights(base)
    runs = np.arange(len(replica.stops))
    own = off[:, None] * (replica.rows.run[:, None] == runs)
    law = weights(law_columns(replica, model, base)) * [LOG_TAU, *[MU_CD] * len(runs)]
    every = np.column_stack([own, law, left])
    known = weights.projector.inner(every, every)
    says = np.diag(known)[runs]
    used = np.concatenate([says > _LEAST_SHARE * says.sum(), np.ones(len(runs) + 1, dtype=bool)])
    gram, against = known[:-1, :-1][np.ix_(used, used)], known[:-1, -1][used]
    several = int(used[runs].sum())
    gram[np.diag_indices_from(gram)] += np.arange(len(gram)) >= several  # the law's priors
    inverse = np.linalg.inv(gram)
    covariance = inverse[:several, :several] + form**2 * np.eye(several)
    return Agreement(1.0 + (inverse @ against)[:several], covariance)
