"""Errors of form: the true form of an accepted mechanism may differ from the library's, and look like a further effect."""

from collections.abc import Sequence

import numpy as np
from scipy import linalg

from wsp_env.diagnosis.balances import Whitening
from wsp_env.diagnosis.candidates import Variant, without
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.search import Screen
from wsp_env.diagnosis.trials import SURE, Trial, form_of
from wsp_env.diagnosis.variation import Group, Net, law_columns, segment_columns, shapes

#: One-sided 95 % quantile of the normal distribution.
_Z95 = 1.645


def forms(replica: Replica, model: Model, variants: Sequence[Variant], whitening: Whitening) -> list[Group]:
    """Return for each mechanism that is on the columns of its form error.

    They are its effect, weighted over measured quantities, minus their part along the effect itself, whose size is fitted (M.
    Plumlee, Journal of the American Statistical Association 112, 2017, on calibration with a discrepancy).
    """
    base, bent, net = replica.raw(model), shapes(replica), _law_projection(replica, model, whitening)
    effects = [(one, replica.raw(without(model, one)) - base) for one in variants if form_of(one) > 0.0]
    return [
        Group(f"form of {one.title}", _orthogonal(net, whitening, effect, bent), form_of(one), True) for one, effect in effects
    ]


def _law_projection(replica: Replica, model: Model, whitening: Whitening) -> Net:
    """Return the projection off the law's parameters."""
    return Net(whitening, np.column_stack([segment_columns(replica), law_columns(replica, model, replica.raw(model))]))


def _orthogonal(net: Net, whitening: Whitening, effect: np.ndarray, bent: np.ndarray) -> np.ndarray:
    """Return an effect (n,) times weights (n, k), minus the projection on the effect itself."""
    columns = effect[:, None] * bent
    seen = whitening(net(np.column_stack([columns, effect]))[0])
    shares = seen[:, -1] @ seen[:, :-1] / max(float(seen[:, -1] @ seen[:, -1]), np.finfo(float).tiny)
    result: np.ndarray = columns - effect[:, None] * shares
    return result


class FormErrorThreshold:
    """Least log odds of a further mechanism: 95 %, or more if form errors of accepted ones may produce its effect.

    The true form of an accepted mechanism may differ by a share s of its effect (`form_of`). At 95 %, this error produces
    (1.645 s)^2 of its evidence, in an effect of the same form. A further mechanism needs this evidence times the squared cosine
    between its effect and the form error, after refitting the law. Directions of the form error count by their strength. The
    need is limited to that share of its own evidence. Example: a drag that grows with speed does not resemble an oscillating
    coupler.

    Parameters
    ----------
    accepted : each accepted mechanism, as it is on in the model, with its evidence

    """

    def __init__(self, replica: Replica, model: Model, accepted: Sequence[tuple[Variant, float]], seen: Screen) -> None:
        self._replica, self._whitening = replica, seen.whitening
        self._law_projection = _law_projection(replica, model, seen.whitening)
        self._form_errors: list[tuple[np.ndarray, float]] = []
        for variant, evidence in accepted:
            for form in forms(replica, model, [variant], seen.whitening):
                vectors, values = linalg.svd(self._seen(form.columns), full_matrices=False)[:2]
                strength = values / max(float(values.max(initial=0.0)), np.finfo(float).tiny)
                self._form_errors.append((vectors * strength, (_Z95 * form.expected) ** 2 * evidence))

    def _seen(self, columns: np.ndarray) -> np.ndarray:
        return self._whitening(self._law_projection(columns)[0])

    def __call__(self, trial: Trial) -> float:
        """Return the log odds that a trial must exceed."""
        on, off = trial.fitted.model, without(trial.fitted.model, trial.variant)
        effect = self._seen((self._replica.raw(off) - self._replica.raw(on))[:, None])[:, 0]
        square = max(float(effect @ effect), np.finfo(float).tiny)
        alike = [(float(np.sum((basis.T @ effect) ** 2)) / square, limit) for basis, limit in self._form_errors]
        return max(SURE, sum(share * min(limit, 0.5 * max(trial.reduction, 0.0)) for share, limit in alike))
