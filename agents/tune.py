"""Optuna search of the training's arguments: `python -m agents.tune --vehicle bogie --trials 20`; again to go on."""

import dataclasses
import json
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro

from agents import checkpoint
from agents.train import Arguments, train


@dataclasses.dataclass(frozen=True)
class Search:
    """What a search is made of."""

    vehicle: Literal["wheelset", "bogie", "coach"] = "bogie"
    trials: int = 20
    steps: int = 1_500_000  # of each trial
    seed: int = 1
    slide_price: float = Arguments.slide_price  # decides what is wanted: it is not searched
    out: Path = Path("out/agents/tune")


def suggest(trial: Any, search: Search) -> Arguments:
    """Return the arguments of a trial."""
    return Arguments(
        vehicle=search.vehicle,
        seed=search.seed,
        steps=search.steps,
        out=search.out / f"trial_{trial.number}",
        slide_price=search.slide_price,
        log_deviation=trial.suggest_float("log_deviation", -4.0, -1.0),
        learning_rate=trial.suggest_float("learning_rate", 3e-5, 2e-3, log=True),
        gamma=1.0 - trial.suggest_float("one_minus_gamma", 5e-4, 1e-2, log=True),
        gae_lambda=trial.suggest_float("gae_lambda", 0.8, 0.99),
        epochs=trial.suggest_int("epochs", 2, 10),
        clip=trial.suggest_float("clip", 0.1, 0.3),
        hidden=(trial.suggest_categorical("width", [32, 64, 128]),) * 2,
    )


def score(arguments: Arguments) -> float:
    """Train; return the best score on the watched stops, see `agents.watch.Watch`."""
    train(arguments)
    with np.load(arguments.out / checkpoint.BEST) as best:
        return float(best["curve/score"][-1])


def main(search: Search) -> None:
    """Search; the study is kept in the folder, the best arguments printed."""
    try:
        import optuna
    except ImportError as error:
        raise SystemExit('the search needs optuna: pip install "wsp-env[train]"') from error
    search.out.mkdir(parents=True, exist_ok=True)
    study = optuna.create_study(
        storage=f"sqlite:///{search.out / 'study.db'}",
        study_name=search.vehicle,
        sampler=optuna.samplers.TPESampler(seed=search.seed),
        load_if_exists=True,
    )
    study.optimize(lambda trial: score(suggest(trial, search)), n_trials=search.trials)
    print(json.dumps({"score": study.best_value} | study.best_params, indent=2))


if __name__ == "__main__":
    main(tyro.cli(Search))
