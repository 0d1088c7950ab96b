"""Optuna search of the training's arguments: `python -m agents.tune --vehicle bogie --trials 20`; again to go on.

Each trial is a whole training and ends with the least score on the watched stops, see `agents.watch`. The price of sliding and
the conditions decide what is wanted: they are not searched. With `--together 4` four trials are drawn at once and done side by
side; what they find goes into the search in the order in which they were drawn: who is ready first does not matter.
"""

import dataclasses
import json
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro

from agents import spread
from agents.settings import Arguments
from agents.train import THREADS
from wsp_env.executor import Executor, Workers


@dataclasses.dataclass(frozen=True)
class HyperparameterSearch:
    """What a search is made of."""

    vehicle: Literal["wheelset", "bogie", "coach"] = "bogie"
    trials: int = 20
    steps: int = Arguments.steps  # decisions of PPO in each trial
    seed: int = 1
    slide_price: float = Arguments.slide_price
    out: Path = Path("out/agents/tune")
    together: int = 1  # trials drawn at once, and done side by side
    workers: spread.WorkersOption = Workers()


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


def main(search: HyperparameterSearch, executor: Executor) -> None:
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
    for first in range(0, search.trials, search.together):
        trials = [study.ask() for _ in range(min(search.together, search.trials - first))]
        tasks = [spread.task_of(suggest(trial, search), executor) for trial in trials]
        found = {run.out: (content, failure) for run, content, failure in spread.results(spread.score, tasks, executor)}
        for trial, task in zip(trials, tasks, strict=True):
            content, failure = found[task.arguments.out]
            if failure:
                print(f"{task} {failure}", flush=True)
                study.tell(trial, state=optuna.trial.TrialState.FAIL)
            else:
                study.tell(trial, json.loads(content))
    print(json.dumps({"score": study.best_value} | study.best_params, indent=2))


if __name__ == "__main__":
    chosen = tyro.cli(HyperparameterSearch)
    main(chosen, chosen.workers.make(THREADS))
