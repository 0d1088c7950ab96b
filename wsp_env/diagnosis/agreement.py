"""What the parts of the recordings leave of the evidence for a mechanism: what is missing has in all of them the same size.

The parts are the runs, and of each the slides and the rest: where a wheel slides friction's own swings may look like a
mechanism, and do not where it rolls, nor in the vehicle's balance. Every part has a size of its own, as a multiple of the one
that was fitted to all, estimated beside all nuisances: those of one run are learned from it, those that runs share (a brake's
gain, the law's form) from all. How uncertain the sizes are, noise and nuisances say, and by how much nature's form may differ
from the mechanism's from part to part (`wsp_env.diagnosis.trials.FORM`). Where the parts miss their common size by more than
that, the model of what varies is too small in just this direction, and so is the uncertainty that the evidence was computed
with. By which factor is unknown: it is believed to be 1, and learned from the parts. With the factor integrated out, a
likelihood ratio is Student's t's (Wedderburn, Biometrika 61, 1974, on the factor; Gelman et al., Bayesian data analysis, 2014,
chapter 3, on the integral).
"""

from typing import NamedTuple

import numpy as np
from scipy import stats

from wsp_env.diagnosis.candidates import Variant, without
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Weights
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.variation import LOG_TAU, MU_CD, law_columns

#: Number of squares that the belief in the uncertainty as computed counts for: assumption, half of what eight runs say.
BELIEVED = 4.0
#: Share of what the recordings say of a size, below which a part says nothing of it.
_LEAST_SHARE = 0.02


class Agreement(NamedTuple):
    """What every part that says something of a mechanism says."""

    multiples: np.ndarray  # (P,) of the size fitted to all
    covariance: np.ndarray  # (P, P) of the same, that of the form included

    @property
    def common(self) -> float:
        """The parts' common size, as a multiple of the fitted one."""
        if not len(self.multiples):
            return 1.0
        precision = np.linalg.inv(self.covariance)
        return float(precision.sum(axis=0) @ self.multiples) / float(precision.sum())

    @property
    def missed(self) -> float:
        """Sum of squares by which they miss their common size: one less than there are parts is expected."""
        rest = self.multiples - self.common
        return float(rest @ np.linalg.inv(self.covariance) @ rest)

    @property
    def counts(self) -> float:
        """Number of squares that the uncertainty as computed is judged by."""
        return BELIEVED + max(len(self.multiples) - 1.0, 0.0)

    def left_of(self, evidence: float) -> float:
        """Return what is left of an evidence."""
        return 0.5 * (self.counts + 1.0) * float(np.log1p(2.0 * max(evidence, 0.0) / (BELIEVED + self.missed)))

    def interval(
        self, value: float, deviation: float, change: float, form: float, absent: float = np.inf
    ) -> tuple[float, float]:
        """Return the interval of 90 % of a fitted value.

        Parameters
        ----------
        deviation : of the value, as computed
        change : from where the mechanism does nothing
        form : deviation by nature's form
        absent : the same as `deviation`, by how much worse the recordings are explained where the mechanism does nothing;
            inf where the value alone does not say whether it does. Where a size bends with a shape, as a patch's change with
            its length, that is less than a tangent says (likelihood root, O. Barndorff-Nielsen, Biometrika 73, 1986)

        """
        away, back = (self._half_width(one, change, form) for one in (deviation, min(deviation, absent)))
        return (value - back, value + away) if change > 0.0 else (value - away, value + back)

    def _half_width(self, deviation: float, change: float, form: float) -> float:
        # Two estimates that would be the same if the model were right: what they differ by is its error (J. Hausman,
        # Econometrica 46, 1978).
        differs = (self.common - 1.0) * change
        spread = deviation * np.sqrt((BELIEVED + self.missed) / self.counts)
        return float(stats.t.ppf(0.95, self.counts) * np.sqrt(spread**2 + differs**2 + form**2))


def agreement(replica: Replica, model: Model, variant: Variant, weights: Weights, form: float = 0.0) -> Agreement:
    """Return what every run's slides and its rest say of a mechanism that is on, beside tau, mu_cd and all nuisances.

    Parameters
    ----------
    form : share of the effect that nature's form may differ by from part to part

    """
    base = replica.raw(model)
    off, left = weights(replica.raw(without(model, variant)) - base), weights(base)
    part = 2 * replica.rows.run + replica.rows.slides
    parts = np.arange(2 * len(replica.stops))
    own = off[:, None] * (part[:, None] == parts)
    law = weights(law_columns(replica, model, base)) * [LOG_TAU, *[MU_CD] * len(replica.stops)]
    every = np.column_stack([own, law, left])
    known = weights.projector.inner(every, every)
    says = np.diag(known)[parts]
    used = np.concatenate([says > _LEAST_SHARE * says.sum(), np.ones(law.shape[1], dtype=bool)])
    gram, against = known[:-1, :-1][np.ix_(used, used)], known[:-1, -1][used]
    several = int(used[parts].sum())
    gram[np.diag_indices_from(gram)] += np.arange(len(gram)) >= several  # the law's priors
    inverse = np.linalg.inv(gram)
    covariance = inverse[:several, :several] + form**2 * np.eye(several)
    return Agreement(1.0 + (inverse @ against)[:several], covariance)
