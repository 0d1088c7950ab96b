"""The Gymnasium vector environment: N stops in one compiled batch."""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from wsp_env.envs.batch import BrakingBatch
from wsp_env.envs.task import make_task
from wsp_env.parameters.quantity import ParameterError


class BrakingVectorEnv(gym.vector.VectorEnv[np.ndarray, Any, np.ndarray]):
    """N vehicles of `BrakingEnv` at once; stop i equals the single environment with seed + i.

    A finished stop is begun anew in the same step (`AutoresetMode.SAME_STEP`): its last observation and info are
    `infos["final_obs"][i]` and `infos["final_info"]`. Time and track limits are inside, no wrapper is needed. Options are
    those of `wsp_env.envs.task.Task`; reset options take one value for all or one per stop.
    """

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012  # as Gymnasium declares it

    def __init__(self, num_envs: int = 1, vehicle_name: str = "bogie", render_mode: str | None = None, **options: Any) -> None:
        if render_mode is not None:
            raise ParameterError("vector environments do not render: make a single one with gym.make for pictures")
        self.batch = BrakingBatch(vehicle_name, num_envs, make_task(options))
        self.num_envs = num_envs
        self.render_mode = None
        self.single_observation_space = self.batch.observation_space
        self.single_action_space = self.batch.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._generators = [np.random.default_rng() for _ in range(num_envs)]

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin N new stops; stop i is seeded with `seed + i`, or with `seed[i]`."""
        seeds = [seed + i for i in range(self.num_envs)] if isinstance(seed, int | np.integer) else seed
        if seeds is not None:
            if len(seeds) != self.num_envs:
                raise ValueError(f"{len(seeds)} seeds for {self.num_envs} environments: give one number or one seed each")
            for i, own in enumerate(seeds):
                if own is not None:
                    self._generators[i] = gym.utils.seeding.np_random(own)[0]
        observation = self.batch.start(self._generators, options)
        return observation, self._info({name: np.zeros(self.num_envs) for name in vars(self.batch.weights)})

    def step(self, actions: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance all stops by one control interval; those that end begin anew."""
        observation, reward, terms, terminated, truncated = self.batch.step(actions)
        info = self._info(terms)
        done = terminated | truncated
        if done.any():
            final_observation = np.full(self.num_envs, None, dtype=object)
            for i in np.flatnonzero(done):
                final_observation[i] = observation[i].copy()
            final = {name: value for name, value in info.items() if not name.startswith("_")}
            final |= {f"_{name}": done.copy() for name in final}
            observation = self.batch.start(self._generators, mask=done)
            info = self._info({name: np.where(done, 0.0, term) for name, term in terms.items()})
            info |= {"final_obs": final_observation, "_final_obs": done.copy(), "final_info": final, "_final_info": done.copy()}
        return observation, reward, terminated, truncated, info

    def _info(self, terms: dict[str, np.ndarray]) -> dict[str, Any]:
        info: dict[str, Any] = self.batch.truth()
        info["reward_terms"] = terms
        everyone = np.ones(self.num_envs, dtype=bool)
        info.update([(f"_{name}", everyone) for name in info])
        return info
