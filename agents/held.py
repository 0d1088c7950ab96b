"""PPO on top of an imitation: a residual on the brake that the frozen policy wants, held long enough for the valves.

What a policy wants anew every 20 ms at random, the valves filter away: the reward hardly depends on it. Here the frozen policy
decides as ever, and the learner adds to the brake that it wants a residual that stays for `held` decisions. With
`privileged` the value function sees what is true, see `Split`.
"""

from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from agents.steering import Steering
from agents.teacher import Teacher
from agents.worlds import Joined, Shaped
from wsp_env.evaluation.network import INPUT
from wsp_env.observer.observation import Observer
from wsp_env.plant.command import to_action

#: Share of the range of wanted brakes that a residual of 1 adds: 0.02 of adhesion (assumption: a quarter of what is wanted).
REACH = 0.2

#: The reward of a decision is worth some hundredths: times this, returns are of the order of one.
REWARD_SCALE = 10.0


class Base:
    """The frozen policy: observations to the brakes that it wants, from the network of a policy folder."""

    def __init__(self, network: bytes | str) -> None:
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        self.session = onnxruntime.InferenceSession(network, options, providers=["CPUExecutionProvider"])

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Return the brakes wanted (N, A), not clipped."""
        wanted: np.ndarray = self.session.run(["raw"], {INPUT: observation})[0]
        return wanted


class Held(VecEnvWrapper):
    """Valve environments under the frozen policy, whose actions are residuals that last `held` decisions.

    Observations are those of the environment, and behind them what is true (`truth`). Rewards are summed over the time that a
    residual lasts, discounted by `gamma` a decision; what comes after a stop has ended counts for nobody.
    """

    venv: Joined

    def __init__(self, venv: Joined, steering: Steering, base: Base, held: int, gamma: float, slide_price: float) -> None:
        self.parts = [part for part in venv.parts if isinstance(part, Shaped)]
        self.teachers = [Teacher(part.batch.plant, slide_price) for part in self.parts]
        assert isinstance(venv.observation_space, spaces.Box)
        self.own = int(venv.observation_space.shape[0])
        size = self.own + 5 * steering.axles + 4
        super().__init__(
            venv,
            observation_space=spaces.Box(-np.inf, np.inf, (size,), np.float32),
            action_space=spaces.Box(-1.0, 1.0, (steering.axles,), np.float32),
        )
        self.steering, self.base, self.held, self.gamma = steering, base, held, gamma

    def reset(self) -> np.ndarray:
        """Begin new stops."""
        self._observation = np.asarray(self.venv.reset())
        return self._seen()

    def step_async(self, actions: np.ndarray) -> None:
        """Take the residuals (N, A)."""
        self._residual = np.clip(actions, -1.0, 1.0)

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Advance by the time that a residual lasts."""
        total, over = np.zeros(self.num_envs, dtype=np.float32), np.zeros(self.num_envs, dtype=bool)
        ends: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for age in range(self.held):
            wanted = np.clip(self.base(self._observation) + REACH * self._residual, -1.0, 1.0).astype(np.float32)
            command = self.steering.commands(torch.as_tensor(self._observation), torch.as_tensor(wanted))
            observation, reward, done, infos = self.venv.step(to_action(command.numpy()))
            self._observation = np.asarray(observation)
            total += np.where(over, 0.0, self.gamma**age * REWARD_SCALE * reward)
            for i in np.flatnonzero(done & ~over):
                # What the value function would see of a stop that was cut short is not kept: none is in these tasks.
                ends[i] = {name: value for name, value in infos[i].items() if name == "stopped"}
            over |= done
        return self._seen(), total, over, ends

    def _seen(self) -> np.ndarray:
        return np.concatenate([self._observation, self.truth()], axis=1).astype(np.float32)

    def truth(self) -> np.ndarray:
        """Return what no policy may know (N, 5 A + 4), all of order one.

        Slips, adhesions, pressures, slips worth their price and what is missed of these; the error of the estimated speed,
        friction, recovery and mass.
        """
        rows = []
        for part, teacher in zip(self.parts, self.teachers, strict=True):
            batch = part.batch
            plant = batch.plant
            state, c = plant.truth(), plant.conditions
            target = teacher.targets()
            per_axle = [
                state.slip_speed / Observer.SLIP_SCALE,
                state.adhesion / Observer.ADHESION_SCALE,
                state.pressure / plant.vehicle.brake.full_pressure_bar,
                target / Observer.SLIP_SCALE,
                np.clip(np.log(np.maximum(state.slip_speed, 1e-2) / target), -3.0, 3.0),
            ]
            error = np.clip((batch.observer.estimate.speed - state.speed) / 0.5, -5.0, 5.0)
            single = [error, c.mu_cd / 0.05, c.tau / 2e-4, c.mass / plant.vehicle.mass_kg - 1.0]
            rows.append(np.concatenate([*per_axle, np.stack(single, axis=1)], axis=1))
        return np.concatenate(rows)


class Split(torch.nn.Module):
    """Networks of which the policy sees the first `own` entries alone, the value function these or all."""

    def __init__(self, size: int, own: int, privileged: bool) -> None:
        super().__init__()
        self.own, self.seen = own, size if privileged else own
        self.latent_dim_pi = self.latent_dim_vf = 64
        self.policy_net, self.value_net = (
            torch.nn.Sequential(torch.nn.Linear(width, 64), torch.nn.Tanh(), torch.nn.Linear(64, 64), torch.nn.Tanh())
            for width in (own, self.seen)
        )

    def forward(self, features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the last hidden layers of both."""
        return self.forward_actor(features), self.forward_critic(features)

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        """Return the policy's last hidden layer."""
        hidden: torch.Tensor = self.policy_net(features[:, : self.own])
        return hidden

    def forward_critic(self, features: torch.Tensor) -> torch.Tensor:
        """Return the value function's last hidden layer."""
        hidden: torch.Tensor = self.value_net(features[:, : self.seen])
        return hidden


class ResidualPolicy(ActorCriticPolicy):
    """SB3's policy with `Split`, which begins with no residual at all."""

    def __init__(self, *given: Any, own: int, privileged: bool, **more: Any) -> None:
        self._own, self._privileged = own, privileged
        super().__init__(*given, **more)
        for parameter in self.action_net.parameters():
            torch.nn.init.zeros_(parameter)

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor: Any = Split(self.features_dim, self._own, self._privileged)


def worlds_of(venv: VecEnv) -> Joined:
    """Return the joined worlds below wrappers."""
    while not isinstance(venv, Joined):
        assert isinstance(venv, VecEnvWrapper)
        venv = venv.venv
    return venv
