"""Supervised beginning of a training: the policy learns to command as the teacher does, on the stops that it brakes itself.

DAgger (Ross, Gordon, Bagnell 2011): the teacher brakes the first round, the policy so far the others; the teacher says what it
would command there, and the policy is fitted to everything seen until then.
"""

from typing import Any

import numpy as np
import torch
from rich.progress import track
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize

from agents.teacher import Teacher

#: Decisions between two that are kept: neighbours are alike.
THIN = 4

#: Passes over everything seen in each round, states of one step of the optimiser, its learning rate.
PASSES, BATCH, LEARNING_RATE = 1, 4096, 1e-3


def imitate(model: PPO, world: VecNormalize, slide_price: float, rounds: int, decisions: int) -> list[float]:
    """Fit the policy of `model` to the teacher; return the mean squared difference to it at the end of each round.

    Parameters
    ----------
    rounds : of braking and fitting
    decisions : of every stop in a round

    """
    steered: Any = world.venv
    batches = [part.batch for part in steered.venv.parts]
    teachers = [Teacher(batch.plant, slide_price) for batch in batches]
    optimiser = torch.optim.Adam(model.policy.parameters(), lr=LEARNING_RATE)
    seen: list[np.ndarray] = []
    wanted: list[np.ndarray] = []
    losses = []
    observation: Any = world.reset()
    for turn in track(range(rounds), "imitation"):
        for step in range(decisions):
            if turn == 0 or step % THIN == 0:
                doubts = [batch.observer.reckoning.doubtful for batch in batches]
                label = np.concatenate([t.wanted(doubt) for t, doubt in zip(teachers, doubts, strict=True)])
            if step % THIN == 0:
                seen.append(np.asarray(world.get_original_obs()))
                wanted.append(label)
            action = label if turn == 0 else model.predict(np.asarray(observation), deterministic=True)[0]
            observation = world.step(action)[0]
        losses.append(_fit(model, world, optimiser, np.concatenate(seen), np.concatenate(wanted)))
    return losses


def _fit(model: PPO, world: VecNormalize, optimiser: torch.optim.Adam, seen: np.ndarray, wanted: np.ndarray) -> float:
    normal = torch.as_tensor(world.normalize_obs(seen))
    labels = torch.as_tensor(wanted, dtype=torch.float32)
    losses = []
    for _ in range(PASSES):
        shuffled: Any = torch.randperm(len(normal))
        for rows in shuffled.split(BATCH):
            distribution: Any = model.policy.get_distribution(normal[rows]).distribution
            wish = labels[rows]
            # A wish for all or nothing is met by anything beyond.
            own = torch.where(wish >= 1.0, torch.clamp(distribution.mean, max=1.0), distribution.mean)
            own = torch.where(wish <= -1.0, torch.clamp(own, min=-1.0), own)
            loss: Any = torch.nn.functional.mse_loss(own, wish)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            losses.append(float(loss.detach()))
    return float(np.mean(losses[-len(losses) // PASSES :]))
