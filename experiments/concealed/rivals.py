"""Simpler ways to the same answer, on the same bank: DIR/rivals/NAME/CASE/diagnosis.json.

- `bic`: forward selection by the Bayesian information criterion;
- `held_out`: forward selection of what improves the runs to validate, with amplitudes fitted to the runs to tune on;
- `black_box`: gradient-boosted trees, see `black_box`.

All are given the diagnosis's own residuals, noise estimate, nuisances and sensitivities about the fitted baseline, and so what
it knows of normal variation. None is given what the recordings' disagreement says of its size, refits, or smallest effects of
interest.
"""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from experiments.concealed import black_box
from experiments.concealed.bank import read_labels
from experiments.concealed.workers import Task, dumped, quietly_read, results, write_whole
from wsp_env.diagnosis.balances import Balances
from wsp_env.diagnosis.baseline import baseline
from wsp_env.diagnosis.candidates import Variant, columns, parameter_of, variants
from wsp_env.diagnosis.gls import LeastSquares, fit
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.search import held_out_rows
from wsp_env.diagnosis.stops import prepare
from wsp_env.diagnosis.variation import nuisances
from wsp_env.diagnosis.weights import Weighing, Weights
from wsp_env.executor import Executor, send
from wsp_env.plant.mechanisms import LIBRARY
from wsp_env.recordings import CampaignError

NAMES = ("bic", "held_out", "black_box")
#: Mechanisms at most, as for the diagnosis.
MOST = 3
#: Differences of BIC below this are no strong evidence (Kass and Raftery, J. Am. Stat. Assoc. 90, 1995, page 777).
INDISTINCT_BIC = 6.0
#: Share of the best held-out gain within which another is taken for as good: the diagnosis's share of its gain.
INDISTINCT_HELD_OUT = 0.1
_LEAST = 1e-3  # of its square that a direction must have left to be fitted
_SPANNED = 1e-6  # of its square, before the nuisances are taken away, that a column must have left
_Z90 = 1.645
_NONE = np.zeros(0, dtype=int)


class Products(NamedTuple):
    """Inner products of all columns with each other and with the residual, off the nuisances, over some rows."""

    gram: np.ndarray  # (K, K)
    against: np.ndarray  # (K,)
    rows: int


class Scan(NamedTuple):
    """All variants of the library about a fitted baseline."""

    variants: tuple[Variant, ...]
    whole: Products
    tune: Products
    validate: Products

    def columns_of(self, which: int) -> np.ndarray:
        """Return the indices of a variant's columns."""
        first = sum(len(one.sizes) for one in self.variants[:which])
        return first + np.arange(len(self.variants[which].sizes))


class Rule(NamedTuple):
    """A criterion: what a candidate is worth beside those accepted, and which others are as good as the best."""

    worth: Callable[[Scan, np.ndarray, np.ndarray], float]  # of columns, given others; accepted if above 0
    margin: Callable[[float], float]  # of the best one's worth


def _conditioned(products: Products, index: np.ndarray, given: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return Gram matrix and inner products of some columns, off others as well, and their squares before."""
    gram, against = products.gram, products.against
    squares = np.diag(gram)[index]
    if not len(given):
        return gram[np.ix_(index, index)], against[index], squares
    inverse = fit(gram[np.ix_(given, given)], against[given], least=_LEAST).covariance
    cross = gram[np.ix_(index, given)]
    freed = gram[np.ix_(index, index)] - cross @ inverse @ cross.T
    return freed, against[index] - cross @ inverse @ against[given], squares


def _fit(products: Products, index: np.ndarray, given: np.ndarray = _NONE) -> tuple[LeastSquares, np.ndarray, np.ndarray]:
    gram, against, squares = _conditioned(products, index, given)
    return fit(gram, against, squares, _LEAST), gram, against


def _bic(data: Scan, index: np.ndarray, given: np.ndarray) -> float:
    return _fit(data.whole, index, given)[0].reduction - len(index) * float(np.log(data.whole.rows))


def _held_out(data: Scan, index: np.ndarray, given: np.ndarray) -> float:
    amplitude = _fit(data.tune, index, given)[0].amplitude
    _, gram, against = _fit(data.validate, index, given)
    return float(2.0 * amplitude @ against - amplitude @ gram @ amplitude)


RULES = {
    "bic": Rule(_bic, lambda best: INDISTINCT_BIC),
    "held_out": Rule(_held_out, lambda best: INDISTINCT_HELD_OUT * best),
}


def select(data: Scan, rule: Rule) -> dict[str, Any]:
    """Accept mechanisms one after the other by a rule; the answer in the format of diagnosis.json."""
    mechanisms: list[dict[str, Any]] = []
    chosen: list[int] = []
    for _ in range(MOST):
        given = _columns(data, chosen)
        best: dict[str, tuple[float, int]] = {}
        for i, one in enumerate(data.variants):
            if one.name not in {data.variants[j].name for j in chosen}:
                worth = rule.worth(data, data.columns_of(i), given)
                best[one.name] = max(best.get(one.name, (-np.inf, -1)), (worth, i))
        ranked = sorted(best, key=lambda name: best[name], reverse=True)
        if not ranked or (top := best[ranked[0]][0]) <= 0.0:
            break
        chosen.append(best[ranked[0]][1])
        near = [name for name in ranked if best[name][0] >= top - rule.margin(top)]
        # Odds by exp(worth / 2), the one of nothing more among them.
        odds = [float(np.exp((worth - top) / 2.0)) for worth, _ in best.values()] + [float(np.exp(-top / 2.0))]
        mechanisms.append({"name": ranked[0], "confidence": 1.0 / sum(odds), "alternatives": near})
    for mechanism, parameters in zip(mechanisms, _parameters(data, chosen), strict=True):
        mechanism["parameters"] = parameters
    wide = any(len(mechanism["alternatives"]) > 2 for mechanism in mechanisms)
    verdict = "ambiguous" if wide else "named" if mechanisms else "adequate"
    return {"verdict": verdict, "mechanisms": mechanisms}


def _columns(data: Scan, chosen: list[int]) -> np.ndarray:
    return np.concatenate([_NONE, *(data.columns_of(i) for i in chosen)])


def _parameters(data: Scan, chosen: list[int]) -> list[dict[str, Any]]:
    """Parameters of the mechanisms chosen, fitted together, linear about the baseline."""
    together, first, reported = _fit(data.whole, _columns(data, chosen))[0], 0, []
    for i in chosen:
        variant = data.variants[i]
        units = {name: parameter_of(variant.name, name).unit for name in (*variant.fixed, *variant.sizes)}
        found = {name: {"value": v, "unit": units[name], "interval90": [v, v]} for name, v in variant.fixed.items()}
        for name, null, change in zip(variant.sizes, map(float, variant.null()), map(float, variant.moves()), strict=True):
            value = null - float(together.amplitude[first]) * change
            half = _Z90 * abs(change) * float(np.sqrt(together.covariance[first, first]))
            found[name] = {"value": value, "unit": units[name], "interval90": [value - half, value + half]}
            first += 1
        reported.append(found)
    return reported


def scan(replica: Replica, weights: Callable[[np.ndarray | None], Weights], tried: Sequence[Variant]) -> Scan:
    """Compute the inner products of all variants about the baseline.

    Parameters
    ----------
    weights : of some rows (n,) bool; None: of all

    """
    model = replica.baseline
    base = replica.raw(model)
    found = [columns(replica, model, base, one) for one in tried]
    every = weights(None)
    white = every(np.column_stack([*found, base]))

    def products(own: Weights, keep: np.ndarray) -> Products:
        both = white[keep]
        inner = own.projector.inner(both, both)
        # What the nuisances span leaves rounding errors.
        spanned = np.diag(inner)[:-1] < _SPANNED * np.einsum("nk,nk->k", both, both)[:-1]
        gram, against = np.where(spanned | spanned[:, None], 0.0, inner[:-1, :-1]), np.where(spanned, 0.0, inner[:-1, -1])
        return Products(gram, against, int(keep.sum()))

    held = held_out_rows(replica.rows)
    whole = products(every, np.ones(len(held), dtype=bool))
    return Scan(tuple(tried), whole, products(weights(~held), ~held), products(weights(held), held))


def weighing(replica: Replica) -> Callable[[np.ndarray | None], Weights]:
    """Return the function that gives the weights of some rows, every nuisance at the size expected of it.

    The law's parameters, which are not fitted again, are among the nuisances.
    """
    model, whitening = replica.baseline, replica.whitening(replica.baseline)
    # `Weighing` leaves out what is named as the law's parameters are.
    groups = [one._replace(name=f"any {one.name}") for one in nuisances(replica, model, replica.raw(model), whitening)]
    return Weighing(replica, whitening, groups)


def examine(campaign: Path) -> tuple[dict[str, dict[str, Any]], dict[str, float]]:
    """Return the answers of the rules to one campaign, and the features of it that the black box is given."""
    recorded = quietly_read(campaign)
    stops, notes = prepare(recorded)
    balances = Balances(recorded, stops) if stops else None
    if balances is None or not len(balances.rows):
        raise CampaignError(f"campaign {recorded.name}: no run can be compared: {'; '.join(notes)}")
    replica = baseline(balances)
    weights = weighing(replica)
    data = scan(replica, weights, list(variants(replica)))
    gains = dict.fromkeys(LIBRARY, 0.0)
    for i, one in enumerate(data.variants):
        gains[one.name] = max(gains[one.name], _fit(data.whole, data.columns_of(i))[0].reduction)
    answers = {name: select(data, rule) for name, rule in RULES.items()}
    return answers, black_box.features(replica, weights(None), gains)


def _one(task: Task) -> bytes:
    with task.campaign.here() as campaign:
        try:
            answers, features = examine(campaign)
        except CampaignError:  # faulty channels may leave nothing to compare
            answers, features = {rule: {"verdict": "insufficient", "mechanisms": []} for rule in RULES}, {}
    return dumped({"answers": answers, "features": features})


def run(out: Path, executor: Executor, first: int | None = None) -> None:
    """Let all rivals answer every case of the bank, or its first ones, that they have not answered yet."""
    labels, folder = read_labels(out, first), out / "rivals"
    done = {name: folder / "features" / f"{name}.json" for name in labels}
    todo = [Task(name, send(out / "campaigns" / name, executor.far)) for name, file in done.items() if not file.is_file()]
    for task, content in results(_one, todo, executor, "rivals"):
        said = json.loads(content)
        for rule, answer in said["answers"].items():
            write_whole(folder / rule / task.name / "diagnosis.json", answer)
        write_whole(done[task.name], said["features"])  # last: when it is there, all is
    black_box.run(labels, folder, executor)
