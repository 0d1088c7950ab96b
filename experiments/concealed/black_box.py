"""A black box: gradient-boosted trees that learn from the labels of the other cases which name belongs to which residuals.

It alone is trained on the bank itself, four fifths of it at a time, and so knows sizes, noise and frequencies of the very kind
of cases that it is asked about; that is more than any diagnosis in service can have.
"""

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from experiments.concealed.workers import dumped, results, write_whole
from wsp_env.diagnosis.balances import ADHESION, BALANCES, VEHICLE
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.weights import Weights
from wsp_env.executor import Executor

FOLDS = 5
#: Names with at least this share of the best one's probability are in its set: assumption.
AS_GOOD = 1 / 3
NOTHING, UNKNOWN = "nothing", "unknown"
_AXLES = 4
_LEVELS = 5  # of slip, speed, friction work and deceleration


def features(replica: Replica, weights: Weights, gains: dict[str, float]) -> dict[str, float]:
    """Describe the residuals of a fitted baseline; what a campaign does not have is left out.

    Parameters
    ----------
    weights : of all rows
    gains : fall of the sum of squares by every mechanism alone

    """
    rows, model = replica.rows, replica.baseline
    rest = weights.projector.rest(weights(replica.raw(model)))
    reported = {
        "axles": float(replica.axles),
        "measured torque": float(replica.campaign.vehicle.brake_torque_source == "measured"),
        "log tau": float(np.log(model.tau)),
    }
    drift = np.log([mu / stop.believed_mu_cd for mu, stop in zip(model.mu_cd, replica.stops, strict=True)])
    reported |= {"mu_cd over believed": float(drift.mean()), "spread of mu_cd": float(drift.std())}

    def describe(name: str, mine: np.ndarray) -> None:
        if mine.any():
            reported[f"mean of {name}"] = float(rest[mine].mean())
            reported[f"squares of {name}"] = float(np.log(np.mean(rest[mine] ** 2) + 1e-6))

    for balance, name in enumerate(BALANCES):
        mine = rows.balance == balance
        describe(name, mine)
        describe(f"{name} to validate", mine & rows.validate)
        if balance != VEHICLE:
            for axle in range(min(replica.axles, _AXLES)):
                describe(f"{name} of axle {axle + 1}", mine & (rows.axle == axle))
        by = {"speed": rows.speed, "deceleration": rows.deceleration}
        if balance == ADHESION:
            by |= {"slip": rows.slip, "work": rows.work}
        for what, values in by.items():
            edges = np.quantile(values[mine], np.linspace(0.0, 1.0, _LEVELS + 1)) if mine.any() else []
            for level in range(len(edges) - 1):
                describe(f"{name} at {what} {level}", mine & (values >= edges[level]) & (values <= edges[level + 1]))
    return reported | {f"gain of {name}": float(np.log1p(max(gain, 0.0))) for name, gain in gains.items()}


def target(label: dict[str, Any]) -> str:
    """Return what is to be learned of a case: the first name, or that it is nothing or in no library."""
    if label["mechanisms"]:
        return str(label["mechanisms"][0])
    return UNKNOWN if label["effects"] else NOTHING


def folds(targets: list[str]) -> np.ndarray:
    """Deal the cases (n,) of every target in turn to the folds, so that each fold has its share of every target."""
    result = np.empty(len(targets), dtype=int)
    result[np.argsort(targets, kind="stable")] = np.arange(len(targets)) % FOLDS
    return result


class Fold(NamedTuple):
    """What one process does: train on all cases but those of one fold, answer these."""

    features: dict[str, dict[str, float]]  # of every case
    targets: dict[str, str]  # of every case
    held: int

    def __str__(self) -> str:
        """Return what a line may call it."""
        return f"fold {self.held}"


def answer_fold(task: Fold) -> bytes:
    """Answer the cases of one fold by trees trained on the others; JSON, by case."""
    try:
        from sklearn.ensemble import HistGradientBoostingClassifier
    except ImportError:
        raise ModuleNotFoundError('the black box needs scikit-learn: pip install "wsp-env[dev]"') from None
    names = sorted(task.targets)
    read = [task.features[name] for name in names]
    keys = sorted(set().union(*read))
    x = np.array([[one.get(key, np.nan) for key in keys] for one in read])
    y = np.array([task.targets[name] for name in names])
    mine = folds(list(y)) == task.held
    # Some targets have five cases: leaves of two, and few leaves.
    trees = HistGradientBoostingClassifier(max_iter=60, max_leaf_nodes=8, min_samples_leaf=2, random_state=0)
    trees.fit(x[~mine], y[~mine])
    said = {}
    for i, probabilities in zip(np.flatnonzero(mine), trees.predict_proba(x[mine]), strict=True):
        said[names[i]] = _answer(dict(zip(map(str, trees.classes_), map(float, probabilities), strict=True)))
    return dumped(said)


def run(labels: dict[str, dict[str, Any]], folder: Path, executor: Executor) -> None:
    """Answer all cases of a bank from FOLDER/features/CASE.json, in FOLDER/black_box/CASE."""
    targets = {name: target(label) for name, label in labels.items()}
    seen = {name: json.loads((folder / "features" / f"{name}.json").read_text(encoding="utf-8")) for name in targets}
    tasks = [Fold(seen, targets, held) for held in range(min(FOLDS, len(targets)))]
    for _, content in results(answer_fold, tasks, executor, "black box"):
        for name, answer in json.loads(content).items():
            write_whole(folder / "black_box" / name / "diagnosis.json", answer)


def _answer(belief: dict[str, float]) -> dict[str, Any]:
    best = max(belief, key=lambda name: belief[name])
    if best in (NOTHING, UNKNOWN):
        return {"verdict": "adequate" if best == NOTHING else "unknown", "mechanisms": [], "belief": belief}
    near = sorted(
        (name for name in belief if name not in (NOTHING, UNKNOWN) and belief[name] >= AS_GOOD * belief[best]),
        key=lambda name: -belief[name],
    )
    one = {"name": best, "confidence": belief[best], "alternatives": near}
    return {"verdict": "ambiguous" if len(near) > 2 else "named", "mechanisms": [one], "belief": belief}
