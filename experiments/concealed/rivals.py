"""Simpler ways to the same answer, on the same bank: DIR/rivals/NAME/CASE/diagnosis.json.

- `bic`: forward selection by the Bayesian information criterion;
- `held_out`: forward selection of what improves the runs to validate, with amplitudes fitted to the runs to tune on;
- `black_box`: gradient-boosted trees, see `black_box`.

All are given the diagnosis's own residuals, noise estimate, nuisances and sensitivities about the fitted baseline, and so what
it knows of normal variation. None is given null recordings, what they say of bias and offsets, or smallest effects of interest.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from experiments.concealed import black_box
from experiments.concealed.bank import read_labels
from experiments.concealed.workers import each, quietly_read, write_whole
from wsp_env.diagnosis.balances import Balances
from wsp_env.diagnosis.candidates import step, variants
from wsp_env.diagnosis.fitting import baseline
from wsp_env.diagnosis.gls import LeastSquares, fit
from wsp_env.diagnosis.search import Products, Scan, conditioned, scan
from wsp_env.diagnosis.stops import prepare
from wsp_env.plant.mechanisms import ALL
from wsp_env.recordings import CampaignError

NAMES = ("bic", "held_out", "black_box")
#: Mechanisms at most, as for the diagnosis.
MOST = 3
#: Differences of BIC below this are no strong evidence (Kass and Raftery, J. Am. Stat. Assoc. 90, 1995, page 777).
INDISTINCT_BIC = 6.0
#: Share of the best held-out gain within which another is taken for as good: the diagnosis's share of its gain.
INDISTINCT_HELD_OUT = 0.1
_LEAST = 1e-3  # of its square that a direction must have left to be fitted
_Z90 = 1.645
_NONE = np.zeros(0, dtype=int)


class Rule(NamedTuple):
    """A criterion: what a candidate is worth beside those accepted, and which others are as good as the best."""

    worth: Callable[[Scan, np.ndarray, np.ndarray], float]  # of columns, given others; accepted if above 0
    margin: Callable[[float], float]  # of the best one's worth


def _fit(products: Products, index: np.ndarray, given: np.ndarray = _NONE) -> tuple[LeastSquares, np.ndarray, np.ndarray]:
    gram, against, squares = conditioned(products, index, given, np.zeros(len(products.against)))
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
        for i, one in enumerate(data.candidates):
            if one.variant is not None and one.name not in {data.candidates[j].name for j in chosen}:
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
        variant = data.candidates[i].variant
        if variant is None:
            raise ValueError(f"{data.candidates[i].name} is no mechanism")
        units = {parameter.name: parameter.unit for parameter in ALL[variant.name].parameters}
        found = {name: {"value": v, "unit": units[name], "interval90": [v, v]} for name, v in variant.fixed.items()}
        for name in variant.sizes:
            null, change = step(variant.name, name)
            value = null - float(together.amplitude[first]) * change
            half = _Z90 * abs(change) * float(np.sqrt(together.covariance[first, first]))
            found[name] = {"value": value, "unit": units[name], "interval90": [value - half, value + half]}
            first += 1
        reported.append(found)
    return reported


def examine(campaign: Path) -> tuple[dict[str, dict[str, Any]], dict[str, float]]:
    """Return the answers of the rules to one campaign, and the features of it that the black box is given."""
    recorded = quietly_read(campaign)
    stops, _ = prepare(recorded)
    balances = Balances(recorded, stops)
    model, weights = baseline(balances)
    data = scan(balances, model, weights, list(variants(balances)))
    gains = dict.fromkeys((*ALL, *(one.name for one in data.candidates)), 0.0)
    for i, one in enumerate(data.candidates):
        gains[one.name] = max(gains[one.name], _fit(data.whole, data.columns_of(i))[0].reduction)
    answers = {name: select(data, rule) for name, rule in RULES.items()}
    return answers, black_box.features(balances, model, weights, gains)


def _one(task: tuple[Path, Path, str]) -> None:
    campaign, out, name = task
    try:
        answers, features = examine(campaign)
    except CampaignError:  # faulty channels may leave nothing to compare
        answers, features = {rule: {"verdict": "insufficient", "mechanisms": []} for rule in RULES}, {}
    for rule, answer in answers.items():
        write_whole(out / rule / name / "diagnosis.json", answer)
    write_whole(out / "features" / f"{name}.json", features)  # last: when it is there, all is


def run(out: Path, jobs: int) -> None:
    """Let all rivals answer every case of the bank that they have not answered yet."""
    labels, folder = read_labels(out), out / "rivals"
    missing = [name for name in labels if not (folder / "features" / f"{name}.json").is_file()]
    each(_one, [(out / "campaigns" / name, folder, name) for name in missing], jobs, "rivals")
    black_box.run(labels, folder, jobs)
