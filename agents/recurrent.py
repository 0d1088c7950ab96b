"""A network with a memory of its own: an LSTM before the policy's layers, trained by RecurrentPPO of sb3-contrib."""

from typing import Any

import torch
from sb3_contrib.common.recurrent.policies import RecurrentActorCriticPolicy
from stable_baselines3.common.distributions import Distribution
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env import VecNormalize

from agents.export import ExportedPolicy
from agents.steering import Steering


class RecurrentActor(ExportedPolicy):
    """What is exported of a recurrent policy; the LSTM's hidden and cell state are one more input and output.

    Parameters
    ----------
    policy : of sb3-contrib, with one layer of LSTM for the actor

    """

    def __init__(
        self, policy: RecurrentActorCriticPolicy, normalisation: VecNormalize, steering: Steering | None = None
    ) -> None:
        super().__init__(policy, normalisation, steering)
        self.lstm: Any = policy.lstm_actor  # torch makes the names of its weights at run time
        self.memory = 2 * self.lstm.hidden_size

    def forward(self, observation: torch.Tensor, memory: torch.Tensor) -> tuple[torch.Tensor, ...]:
        """Return commands (N, axles), the last layer and the memory (N, 2 units) from observations and memory."""
        linear, lstm = torch.nn.functional.linear, self.lstm
        hidden, cell = memory.chunk(2, dim=1)
        gates = linear(self.normal(observation), lstm.weight_ih_l0, lstm.bias_ih_l0)
        gates = gates + linear(hidden, lstm.weight_hh_l0, lstm.bias_hh_l0)
        entering, kept, new, leaving = gates.chunk(4, dim=1)
        cell = torch.sigmoid(kept) * cell + torch.sigmoid(entering) * torch.tanh(new)
        hidden = torch.sigmoid(leaving) * torch.tanh(cell)
        return *self.decided(observation, hidden), torch.cat([hidden, cell], dim=1)

    def distribution(self, policy: ActorCriticPolicy, normal: torch.Tensor, memory: torch.Tensor) -> Distribution:
        """Return the distribution of actions by SB3's own way."""
        assert isinstance(policy, RecurrentActorCriticPolicy)
        hidden, cell = (part[None].contiguous() for part in memory.chunk(2, dim=1))
        return policy.get_distribution(normal, (hidden, cell), torch.zeros(len(normal)))[0]
