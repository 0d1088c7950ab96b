"""PPO in which every wheelset is an agent of its own: what it sees, what it is rewarded for, and its policy.

The price of a stop is a sum over its wheelsets (`agents.worlds.Shaped.own`). If all of them share one reward, the credit of one
is hidden in the noise of the others. Here each has the reward of what it gives away itself. All have the same network, the
imitated one, of whose outputs each agent takes its own (parameter sharing; Gupta, Egorov, Kochenderfer 2017).
"""

from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env import VecEnvWrapper

from agents.export import ExportedPolicy
from agents.steering import Steering
from agents.teacher import Teacher
from agents.worlds import Joined, Shaped
from wsp_env.observer.observation import Observer
from wsp_env.plant.command import to_action

#: Decisions of 20 ms that a deviation from the policy lasts: what is wanted anew every 20 ms at random, the valves filter away.
HELD = 8

#: A metre that is given away is worth so much reward: with it returns are of the order of one.
PER_METRE = 0.15

#: Bounds of an action, which SB3 asks for: far beyond any wish, whose range is -1 to 1.
_BEYOND = 10.0

#: What is true of a wheelset, its mean over the vehicle, and what is true of the stop.
_PER_AXLE, _PER_STOP = 5, 4


class EachAxle(VecEnvWrapper):
    """Valve environments of N vehicles with A axles as N A agents, vehicle by vehicle; each tells the brake that it wants.

    Observations are those of the vehicle, the agent's axle (one of A entries is 1), and what is true, for the value function
    alone. The policy decides every 20 ms; what an action adds to its wish lasts `HELD` decisions. Rewards are the sum over that
    time, discounted by `gamma` a decision. What comes after a stop has ended counts for nobody.

    Parameters
    ----------
    venv : the vehicles
    steering : chooses the valves' commands
    policy : whose wishes the actions change
    slide_price : of the slips worth their price, which the value function sees
    gamma : discount of a decision of 20 ms
    shared : a wheelset is also rewarded for what those behind it give away, on the rail that it has cleaned for them

    """

    venv: Joined

    def __init__(
        self, venv: Joined, steering: Steering, policy: ExportedPolicy, slide_price: float, gamma: float, *,
        shared: bool = False,
    ) -> None:  # fmt: skip
        assert isinstance(venv.observation_space, spaces.Box)
        self.parts = [part for part in venv.parts if isinstance(part, Shaped)]
        self.teachers = [Teacher(part.batch.plant, slide_price) for part in self.parts]
        self.steering, self.policy, self.gamma, self.shared = steering, policy, gamma, shared
        self.axles, self.vehicles = steering.axles, venv.num_envs
        self.own = int(venv.observation_space.shape[0])
        size = self.own + self.axles + 2 * _PER_AXLE + _PER_STOP
        super().__init__(
            venv,
            observation_space=spaces.Box(-np.inf, np.inf, (size,), np.float32),
            action_space=spaces.Box(-_BEYOND, _BEYOND, (1,), np.float32),
        )
        self.num_envs = self.vehicles * self.axles

    def reset(self) -> np.ndarray:
        """Begin new stops."""
        self._observation = np.asarray(self.venv.reset())
        return self._seen()

    def step_async(self, actions: np.ndarray) -> None:
        """Take the brakes wanted (N A, 1), see `agents.steering.wanted_brake`."""
        self._actions = actions.reshape(self.vehicles, self.axles)

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Advance by the time that a deviation lasts."""
        total = np.zeros((self.vehicles, self.axles), dtype=np.float32)
        over = np.zeros(self.vehicles, dtype=bool)
        ends: list[dict[str, Any]] = [{} for _ in range(self.vehicles)]
        for age in range(HELD):
            seen = torch.as_tensor(self._observation)
            with torch.no_grad():
                wished = self.policy.raw(seen).numpy()
            if age == 0:
                added = self._actions - wished
            wanted = torch.as_tensor(np.clip(wished + added, -1.0, 1.0))
            command = self.steering.commands(seen, wanted)
            observation, _, done, infos = self.venv.step(to_action(command.numpy()))
            self._observation = np.asarray(observation)
            total += np.where(over[:, None], 0.0, self.gamma**age * PER_METRE * self.rewards())
            for i in np.flatnonzero(done & ~over):
                ends[i] = {"stopped": infos[i]["stopped"]}
            over |= done
        return self._seen(), total.reshape(-1), np.repeat(over, self.axles), [end for end in ends for _ in range(self.axles)]

    def rewards(self) -> np.ndarray:
        """Return what each wheelset is rewarded for in the last decision (N, A) [m]."""
        own = np.concatenate([part.own for part in self.parts])
        return own[:, ::-1].cumsum(axis=1)[:, ::-1] if self.shared else own

    def _seen(self) -> np.ndarray:
        """Return what the agents see (N A, size)."""
        each = np.repeat(self._observation, self.axles, axis=0)
        axle = np.tile(np.eye(self.axles, dtype=np.float32), (self.vehicles, 1))
        return np.concatenate([each, axle, self.truth()], axis=1).astype(np.float32)

    def truth(self) -> np.ndarray:
        """Return what no policy may know (N A, 14), all of order one.

        Of the own wheelset and in the mean of all: slip, adhesion, pressure, slip worth its price and the logarithm of the slip
        over it. Of the stop: the error of the estimated speed, friction, recovery and mass.
        """
        rows = []
        for part, teacher in zip(self.parts, self.teachers, strict=True):
            plant = part.batch.plant
            state, c = plant.truth(), plant.conditions
            target = teacher.targets()
            per_axle = np.stack(
                [
                    state.slip_speed / Observer.SLIP_SCALE,
                    state.adhesion / Observer.ADHESION_SCALE,
                    state.pressure / plant.vehicle.brake.full_pressure_bar,
                    target / Observer.SLIP_SCALE,
                    np.clip(np.log(np.maximum(state.slip_speed, 1e-2) / target), -3.0, 3.0),
                ],
                axis=2,
            )
            error = np.clip((part.batch.observer.estimate.speed - state.speed) / 0.5, -5.0, 5.0)
            single = np.stack([error, c.mu_cd / 0.05, c.tau / 2e-4, c.mass / plant.vehicle.mass_kg - 1.0], axis=1)
            mean = np.broadcast_to(per_axle.mean(axis=1, keepdims=True), per_axle.shape)
            shared = np.broadcast_to(single[:, None], (*per_axle.shape[:2], _PER_STOP))
            rows.append(np.concatenate([per_axle, mean, shared], axis=2).reshape(-1, 2 * _PER_AXLE + _PER_STOP))
        return np.concatenate(rows)


class _Split(torch.nn.Module):
    """The imitated network, of which each agent takes its own axle's output, and a value function that sees all."""

    def __init__(self, size: int, policy: ExportedPolicy, own: int, axles: int) -> None:
        super().__init__()
        self.policy, self.own, self.axles = policy, own, axles
        self.latent_dim_pi, self.latent_dim_vf = 1, 64
        self.value_net = torch.nn.Sequential(
            torch.nn.Linear(size, 64), torch.nn.Tanh(), torch.nn.Linear(64, 64), torch.nn.Tanh()
        )

    def forward(self, features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the brake wanted (B, 1) and the value function's last hidden layer."""
        return self.forward_actor(features), self.forward_critic(features)

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        """Return the brake that each agent wants (B, 1)."""
        wanted: torch.Tensor = self.policy.raw(features[:, : self.own])
        axle = features[:, self.own : self.own + self.axles]
        return (wanted * axle).sum(dim=1, keepdim=True)

    def forward_critic(self, features: torch.Tensor) -> torch.Tensor:
        """Return the value function's last hidden layer."""
        hidden: torch.Tensor = self.value_net(features)
        return hidden


class AxlePolicy(ActorCriticPolicy):
    """SB3's policy whose mean is what the imitated network wants for the agent's axle."""

    def __init__(self, *given: Any, policy: ExportedPolicy, own: int, axles: int, **more: Any) -> None:
        self._split = policy, own, axles
        more["ortho_init"] = False  # the network has learned already
        super().__init__(*given, **more)

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor: Any = _Split(self.features_dim, *self._split)

    def _build(self, lr_schedule: Any) -> None:
        super()._build(lr_schedule)
        self.action_net: Any = torch.nn.Identity()
        self.log_std.requires_grad = False
        adam: Any = self.optimizer_class
        self.optimizer = adam(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)
