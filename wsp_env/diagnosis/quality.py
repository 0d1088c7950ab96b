"""How well baseline and extension fit: to the runs to tune on, then with the law frozen to those to validate."""

import numpy as np

from wsp_env.diagnosis.answer import FitQuality
from wsp_env.diagnosis.balances import Balances
from wsp_env.diagnosis.decide import Outcome
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Weights, refit
from wsp_env.diagnosis.gls import Projector
from wsp_env.diagnosis.rules import Accepted
from wsp_env.diagnosis.variation import nuisances

_BEYOND = 2.0  # deviations of null recordings by which the baseline must misfit, that a share of it can be removed: assumption


def quality(
    balances: Balances, model: Model, weights: Weights, outcome: Outcome | None, raws: np.ndarray
) -> tuple[FitQuality, Model, Model]:
    """Return mean squares relative to null recordings, and baseline and extension as fitted for them.

    Parameters
    ----------
    outcome : None: nothing is added to the baseline
    raws : (n, R) residuals of null recordings

    """
    base, before = _costs(balances, model, (), weights)
    extended, after = dict(base), before
    if outcome:
        extended, after = _costs(balances, outcome.fitted.model, outcome.accepted, weights)
    floor, scatter = _floor(balances, model, weights, raws)
    base = {key: value / floor[key] for key, value in base.items()}
    extended = {key: value / floor[key] for key, value in extended.items()}
    removed = None
    if outcome and "validate" in base and base["validate"] > 1.0 + _BEYOND * scatter["validate"]:
        removed = (base["validate"] - extended["validate"]) / (base["validate"] - 1.0)
    return FitQuality(1.0, base, extended, removed), before, after


def _costs(
    balances: Balances, start: Model, accepted: tuple[Accepted, ...], weights: Weights
) -> tuple[dict[str, float], Model]:
    tune, validate = ~balances.rows.validate, balances.rows.validate
    fitted = refit(
        balances, start, [one.variant for one in accepted], weights, tune if tune.any() else None,
        tilts=[one.tilt for one in accepted],
    )  # fmt: skip
    found = {"tune": fitted.cost / max(int(tune.sum()), 1)}
    if validate.any():
        fitted = refit(balances, fitted.model, (), weights, validate, False)
        found["validate"] = fitted.cost / int(validate.sum())
    return found, fitted.model


def _floor(balances: Balances, model: Model, weights: Weights, raws: np.ndarray) -> tuple[dict[str, float], dict[str, float]]:
    """Mean squares of null recordings, treated alike, and their deviation over that mean."""
    found = nuisances(balances, model, balances.raw(model))
    y = (raws - weights.bias[:, None]) / weights.deviation[:, None]
    y *= np.sqrt(raws.shape[1] / max(raws.shape[1] - 1, 1))  # the bias is their own mean
    mean, scatter = {}, {}
    for key, keep in (("tune", ~balances.rows.validate), ("validate", balances.rows.validate)):
        if keep.any():
            projector = Projector((found.columns / weights.deviation[:, None])[keep], found.prior)
            squares = np.diag(projector.inner(y[keep], y[keep])) / int(keep.sum())
            mean[key], scatter[key] = float(squares.mean()), float(squares.std(ddof=1) / squares.mean())
    return mean, scatter
