"""Do the parts of the recordings agree on the size of a mechanism? If they do not, its evidence is reduced.

Each run has two parts: the blocks in which a wheel slides, and the rest. In slides, random changes of friction may look like a
mechanism. In rolling and in the vehicle balance they do not. Each part has a size of its own, as a multiple of the size fitted
to all rows. These sizes are estimated together with all nuisances. Nuisances of one run are estimated from that run, shared
ones (gain of a brake, form of the law) from all runs. The uncertainty of the sizes contains noise, nuisances and the form
error: the true form may differ from the mechanism's from part to part (`wsp_env.diagnosis.trials.FORM`). If the parts differ
from their common size by more, the variance was computed too small by an unknown factor. The prior of this factor is centred at
1, and the parts update it. With the factor integrated out, the likelihood ratio is that of Student's t distribution (the
factor: Wedderburn, Biometrika 61, 1974; the integral: Gelman et al., Bayesian data analysis, 2014, chapter 3).
"""

from typing import NamedTuple

import numpy as np
from scipy import stats

from wsp_env.diagnosis.candidates import Variant, without
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.variation import LOG_TAU, MU_CD, law_columns
from wsp_env.diagnosis.weights import Weights

#: Number of squares by which the prior of the variance factor counts (assumption: half of the number that eight runs give).
PRIOR_DEGREES = 4.0
#: Share of the total information on a size below which a part is not used.
_LEAST_SHARE = 0.02


class Agreement(NamedTuple):
    """Sizes of a mechanism in the P parts of the recordings that carry information on it."""

    multiples: np.ndarray  # (P,) multiples of the size fitted to all rows
    covariance: np.ndarray  # (P, P) of the multiples, including the form error

    @property
    def common(self) -> float:
        """Common size of the parts, as a multiple of the fitted size: the generalised least-squares mean."""
        if not len(self.multiples):
            return 1.0
        precision = np.linalg.inv(self.covariance)
        return float(precision.sum(axis=0) @ self.multiples) / float(precision.sum())

    @property
    def chi_square(self) -> float:
        """Chi-square of the parts about their common size; its expectation is the number of parts less one."""
        rest = self.multiples - self.common
        return float(rest @ np.linalg.inv(self.covariance) @ rest)

    @property
    def degrees_of_freedom(self) -> float:
        """Degrees of freedom of the variance factor: the prior's and those of the parts."""
        return PRIOR_DEGREES + max(len(self.multiples) - 1.0, 0.0)

    def student_evidence(self, evidence: float) -> float:
        """Return the evidence that remains with Student's t distribution in place of the normal one."""
        return (
            0.5
            * (self.degrees_of_freedom + 1.0)
            * float(np.log1p(2.0 * max(evidence, 0.0) / (PRIOR_DEGREES + self.chi_square)))
        )

    def interval(
        self, value: float, deviation: float, change: float, form: float, absent: float = np.inf
    ) -> tuple[float, float]:
        """Return the 90 % interval of a fitted value.

        Parameters
        ----------
        deviation : standard deviation of the value, as computed
        change : value less the null value of the mechanism
        form : standard deviation due to the form error
        absent : standard deviation that follows from the increase of chi-square at the null value; inf if it does not apply. It
            is smaller than the tangent's if a size depends nonlinearly on a shape, as the change on a patch depends on the
            patch's length (likelihood root, O. Barndorff-Nielsen, Biometrika 73, 1986)

        """
        away, back = (self._half_width(one, change, form) for one in (deviation, min(deviation, absent)))
        return (value - back, value + away) if change > 0.0 else (value - away, value + back)

    def _half_width(self, deviation: float, change: float, form: float) -> float:
        # The common and the fitted size are two estimates that agree if the model is right; their difference is an error of the
        # model (J. Hausman, Econometrica 46, 1978).
        differs = (self.common - 1.0) * change
        spread = deviation * np.sqrt((PRIOR_DEGREES + self.chi_square) / self.degrees_of_freedom)
        return float(stats.t.ppf(0.95, self.degrees_of_freedom) * np.sqrt(spread**2 + differs**2 + form**2))


def agreement(replica: Replica, model: Model, variant: Variant, weights: Weights, form: float = 0.0) -> Agreement:
    """Estimate the size of a mechanism that is on in each part of the recordings, with tau, mu_cd and all nuisances.

    Parameters
    ----------
    form : standard deviation of the form error from part to part, as a share of the effect

    """
    base = replica.raw(model)
    off, left = weights(replica.raw(without(model, variant)) - base), weights(base)
    part = 2 * replica.rows.run + replica.rows.slides
    parts = np.arange(2 * len(replica.stops))
    own = off[:, None] * (part[:, None] == parts)
    law = weights(law_columns(replica, model, base)) * [LOG_TAU, *[MU_CD] * len(replica.stops)]
    every = np.column_stack([own, law, left])
    known = weights.projector.inner(every, every)
    information = np.diag(known)[parts]
    used = np.concatenate([information > _LEAST_SHARE * information.sum(), np.ones(law.shape[1], dtype=bool)])
    gram, against = known[:-1, :-1][np.ix_(used, used)], known[:-1, -1][used]
    several = int(used[parts].sum())
    gram[np.diag_indices_from(gram)] += np.arange(len(gram)) >= several  # priors of tau and mu_cd
    inverse = np.linalg.inv(gram)
    covariance = inverse[:several, :several] + form**2 * np.eye(several)
    return Agreement(1.0 + (inverse @ against)[:several], covariance)
