"""Supervised beginning of a training: the policy learns to command as the teacher does, on the stops that it brakes itself.

DAgger (Ross, Gordon, Bagnell 2011): the teacher brakes the first round, the policy so far the others; the teacher says what it
would command there, and the policy is fitted to everything seen until then.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.vec_env import VecNormalize

from agents.teacher import Teacher

#: Decisions between two that the teacher answers, if nothing else is said: neighbours are alike.
THIN = 4

#: States of one step of the optimiser, and its learning rate, which falls linearly to zero over the rounds.
BATCH, LEARNING_RATE = 4096, 3e-3


class Round(NamedTuple):
    """R decisions of N stops, and what the teacher wanted at every `thin`th; without memory only these decisions are kept."""

    observation: np.ndarray  # (R, N, size), not normalised
    begun: np.ndarray  # (R, N) a stop began with it
    wanted: np.ndarray  # (R / thin, N, A)
    memory: tuple[np.ndarray, ...] | None  # of the network before: hidden and cell state, each (1, N, units); None: it has none


def imitate(
    model: OnPolicyAlgorithm, world: VecNormalize, slide_price: float, rounds: int, decisions: int, thin: int = THIN
) -> Iterator[float]:  # fmt: skip
    """Fit the policy of `model` to the teacher; yield the mean squared difference to it in each round's pass over all rounds.

    Parameters
    ----------
    rounds : of braking and fitting
    decisions : of every stop in a round
    thin : decisions between two that the teacher answers

    """
    steered: Any = world.venv
    batches = [part.batch for part in steered.venv.parts]
    teachers = [Teacher(batch.plant, slide_price, batch.observer.vehicle) for batch in batches]
    optimiser = torch.optim.Adam(model.policy.parameters(), lr=LEARNING_RATE)
    seen: list[Round] = []
    observation: Any = world.reset()
    begun, memory = np.ones(world.num_envs, dtype=bool), None
    for turn in range(rounds):
        observations, starts, wanted, before = [], [], [], memory
        for step in range(decisions):
            answered = step % thin == 0
            if turn == 0 or answered:
                told = zip(teachers, batches, strict=True)
                label = np.concatenate([teacher.wanted(batch.observer.estimate) for teacher, batch in told])
            own, memory = model.predict(np.asarray(observation), memory, begun, deterministic=True)
            if answered or memory is not None:
                observations.append(np.asarray(world.get_original_obs()))
                starts.append(begun)
            if answered:
                wanted.append(label)
            observation, _, begun, _ = world.step(label if turn == 0 else own)
        if before is None and memory is not None:
            before = tuple(np.zeros_like(part) for part in memory)
        for group in optimiser.param_groups:
            group["lr"] = LEARNING_RATE * (1.0 - turn / rounds)
        seen.append(Round(np.array(observations), np.array(starts), np.array(wanted), before))
        fit = _fit if memory is None else _fit_in_sequence
        yield float(np.mean([_improve(optimiser, *pair) for pair in fit(model, world, seen)]))


def _fit(model: OnPolicyAlgorithm, world: VecNormalize, seen: Sequence[Round]) -> Iterator[tuple[Any, torch.Tensor]]:
    """Yield what the policy wants (B, A) and what it should, once for everything seen, in random order."""
    size = seen[0].observation.shape[-1]
    normal = torch.as_tensor(world.normalize_obs(np.concatenate([one.observation.reshape(-1, size) for one in seen])))
    wanted = np.concatenate([one.wanted for one in seen])
    labels = torch.as_tensor(wanted.reshape(len(normal), -1), dtype=torch.float32)
    shuffled: Any = torch.randperm(len(normal))
    for rows in shuffled.split(BATCH):
        distribution: Any = model.policy.get_distribution(normal[rows]).distribution
        yield distribution.mean, labels[rows]


def _fit_in_sequence(
    model: OnPolicyAlgorithm, world: VecNormalize, seen: Sequence[Round]
) -> Iterator[tuple[Any, torch.Tensor]]:
    """Do the same with a network that remembers: whole rounds of some stops, from the memory that it then had."""
    policy: Any = model.policy
    decisions, stops, size = seen[0].observation.shape
    thin = decisions // len(seen[0].wanted)
    together = max(1, BATCH * thin // decisions)
    places: Any = torch.randperm(len(seen) * stops)
    for chosen in places.split(together):
        turns, rows = np.divmod(chosen.numpy(), stops)
        pairs = list(zip(turns, rows, strict=True))
        normal = torch.as_tensor(world.normalize_obs(np.stack([seen[turn].observation[:, row] for turn, row in pairs])))
        begun = torch.as_tensor(np.stack([seen[turn].begun[:, row] for turn, row in pairs]), dtype=torch.float32)
        wanted = torch.as_tensor(np.stack([seen[turn].wanted[:, row] for turn, row in pairs]), dtype=torch.float32)
        memory = tuple(
            torch.as_tensor(np.stack([seen[turn].memory[part][:, row] for turn, row in pairs], axis=1)) for part in (0, 1)
        )
        distribution: Any = policy.get_distribution(normal.reshape(-1, size), memory, begun.reshape(-1))[0].distribution
        own = distribution.mean.reshape(len(chosen), decisions, -1)[:, ::thin]
        yield own, wanted


def _improve(optimiser: torch.optim.Adam, own: Any, wish: torch.Tensor) -> float:
    """Go one step towards what is wished, both (..., A); return the mean squared difference before it."""
    # A wish for all or nothing is met by anything beyond.
    own = torch.where(wish >= 1.0, torch.clamp(own, max=1.0), own)
    own = torch.where(wish <= -1.0, torch.clamp(own, min=-1.0), own)
    loss: Any = torch.nn.functional.mse_loss(own, wish)
    optimiser.zero_grad()
    loss.backward()
    optimiser.step()
    return float(loss.detach())
