"""What the runs leave of the evidence for a mechanism: what is missing has in every run the size that it has in the others.

The size is estimated in every run by itself, as a multiple of the one that was fitted to all, with all nuisances at liberty in
that run. How uncertain it is, noise and nuisances say, and by how much nature's form may differ from the mechanism's from run
to run (`wsp_env.diagnosis.trials.FORM`). Where the runs miss the common size by more than that, the model of what
varies is too small in just this direction, and so is the uncertainty that the evidence was computed with. By which factor is
unknown: it is believed to be 1, and learned from the runs. With the factor integrated out, a likelihood ratio is Student's t's
(Wedderburn, Biometrika 61, 1974, on the factor; Gelman et al., Bayesian data analysis, 2014, chapter 3, on the integral).

A run counts as much as it weighs in the common size: a gentle stop in which hardly a wheel slides says nothing of a slide, and
what it misses says nothing of how far the others err (the variance of a weighted mean of runs that err by factors of their own;
Liang and Zeger, Biometrika 73, 1986).
"""

from typing import NamedTuple

import numpy as np

from wsp_env.diagnosis.candidates import Variant, without
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Weights
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.variation import MU_CD, law_columns

#: Number of squares that the belief in the uncertainty as computed counts for: assumption, about the runs of a campaign.
BELIEVED = 8.0
#: Share of what the recordings say of a size, below which a run says nothing of it.
_LEAST_SHARE = 0.02


class Agreement(NamedTuple):
    """What every run that says something of a mechanism says, by itself."""

    multiples: np.ndarray  # (R,) of the size fitted to all
    information: np.ndarray  # (R,) 1 / variance of the same, that of the form included
    weight: np.ndarray  # (R,) share of each in the common size

    @property
    def misses(self) -> np.ndarray:
        """Squares (R,) by which the runs miss the size that was fitted to all: 1 is expected of each."""
        result: np.ndarray = self.information * (self.multiples - 1.0) ** 2
        return result

    @property
    def missed(self) -> float:
        """Sum of squares by which they miss it, each as much as it weighs: as many as there are runs are expected."""
        return len(self.multiples) * float(self.weight @ self.misses)

    def left_of(self, evidence: float) -> float:
        """Return what is left of an evidence."""
        counts = BELIEVED + len(self.multiples)
        return 0.5 * (counts + 1.0) * float(np.log1p(2.0 * max(evidence, 0.0) / (BELIEVED + self.missed)))


def agreement(replica: Replica, model: Model, variant: Variant, weights: Weights, form: float = 0.0) -> Agreement:
    """Return what every run says of a mechanism that is on: tau as fitted to all, mu_cd and nuisances of the run alone.

    Parameters
    ----------
    form : share of the effect that nature's form may differ by from run to run

    """
    base = replica.raw(model)
    off, left = weights(replica.raw(without(model, variant)) - base), weights(base)
    law, inner = weights(law_columns(replica, model, base)), weights.projector.inner
    given = np.linalg.pinv(inner(law, law), rcond=1e-9)
    moved, rest = (one - law @ (given @ inner(law, one[:, None])[:, 0]) for one in (off, left))
    says, asks = [], []
    for rows, alone in weights.projector.by_run:
        mu_cd = law[rows, 1 + replica.rows.run[rows][0]]
        every = np.column_stack([moved[rows], rest[rows], mu_cd])
        known = alone.inner(every, every)
        friction = known[:2, 2] / (known[2, 2] + MU_CD**-2)
        says.append(float(known[0, 0] - friction[0] * known[0, 2]))
        asks.append(float(known[0, 1] - friction[0] * known[1, 2]))
    information = np.array(says)
    used = information > _LEAST_SHARE * information.sum()
    multiples, known = 1.0 + np.array(asks)[used] / information[used], 1.0 / (1.0 / information[used] + form**2)
    return Agreement(multiples, known, information[used] / information[used].sum())
