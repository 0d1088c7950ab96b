"""Optuna search of the training's arguments: `python -m agents.tune --vehicle bogie --trials 20`; again to go on.

Each trial is a whole training and ends with the least score on the watched stops, see `agents.watch`. The price of sliding and
the conditions decide what is wanted: they are not searched.
"""

import dataclasses
import json
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro

from agents import checkpoint
from agents.settings import Arguments
from agents.train import train


@dataclasses.dataclass(frozen=True)
class HyperparameterSearch:
    """What a search is made of."""

    vehicle: Literal["wheelset", "bogie", "coach"] = "bogie"
    trials: int = 20
    steps: int = Arguments.steps  # decisions of PPO in each trial
    seed: int = 1
    slide_price: float = Arguments.slide_price
    out: Path = Path("out/agents/tune")


def suggest(trial: Any, search: HyperparameterSearch) -> Arguments:
    """Return the arguments of a trial."""
    return Arguments(
        vehicle=search.vehicle,
        seed=search.seed,
        steps=search.steps,
        out=search.out / f"trial_{trial.number}",
        slide_price=search.slide_price,
        hidden=(trial.suggest_categorical("width", [64, 128, 192]),) * 2,
        imitation=trial.suggest_int("imitation", 20, 60, step=10),
        log_deviation=trial.suggest_float("log_deviation", -4.0, -2.0),
        learning_rate=trial.suggest_float("learning_rate", 3e-5, 1e-3, log=True),
        gamma=1.0 - trial.suggest_float("one_minus_gamma", 2e-3, 5e-2, log=True),
        gae_lambda=trial.suggest_float("gae_lambda", 0.8, 0.99),
        epochs=trial.suggest_int("epochs", 1, 5),
        clip=trial.suggest_float("clip", 0.05, 0.3),
    )


def score(arguments: Arguments) -> float:
    """Train; return the best score on the watched stops."""
    train(arguments)
    with np.load(arguments.out / checkpoint.BEST) as best:
        return float(best["curve/score"][-1])


def main(search: HyperparameterSearch) -> None:
    """Search; the study is kept in the folder, the best arguments printed."""
    try:
        import optuna
    except ImportError as error:
        raise SystemExit('the search needs optuna: pip install "wsp-env[train]"') from error
    search.out.mkdir(parents=True, exist_ok=True)
    study = optuna.create_study(
        storage=f"sqlite:///{search.out / 'study.db'}",
        study_name=search.vehicle,
        load_if_exists=True,
    )
    drawn_by = np.random.SeedSequence([search.seed, len(study.trials)]).generate_state(1)[0]  # others when it goes on
    study.sampler = optuna.samplers.TPESampler(seed=int(drawn_by))
    study.optimize(lambda trial: score(suggest(trial, search)), n_trials=search.trials)
    print(json.dumps({"score": study.best_value} | study.best_params, indent=2))


if __name__ == "__main__":
    main(tyro.cli(HyperparameterSearch))
