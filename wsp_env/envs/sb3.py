"""Adaptor of the vector environment to Stable-Baselines3's `VecEnv`, which refuses Gymnasium's own vector environments."""

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np

from wsp_env.envs import IDS
from wsp_env.envs.vector import BrakingVectorEnv
from wsp_env.parameters.quantity import ParameterError, shown

try:
    from stable_baselines3.common.vec_env import VecEnv
except ImportError as error:
    raise ImportError("wsp_env.envs.sb3 needs stable-baselines3: pip install 'wsp-env[train]'") from error


class BrakingVecEnv(VecEnv):
    """N braking stops for Stable-Baselines3, computed as one batch.

    `infos[i]` holds `terminal_observation`, `TimeLimit.truncated` and the truth of the stop when it has ended, and is empty
    otherwise. `seed(s)` seeds the next reset: stop i with s + i. `set_options` pins conditions at the next reset.

    Parameters
    ----------
    env_id : one of `wsp_env.envs.IDS`
    num_envs : number of stops in the batch
    options : as for `gym.make`

    """

    def __init__(self, env_id: str, num_envs: int, **options: Any) -> None:
        if env_id not in IDS:
            raise ParameterError(f"unknown environment {shown(env_id)}; valid: {', '.join(IDS)}")
        self.env = BrakingVectorEnv(num_envs, **{**gym.spec(env_id).kwargs, **options})
        self.render_mode = None
        super().__init__(num_envs, self.env.single_observation_space, self.env.single_action_space)
        self._actions: Any = None

    def reset(self) -> np.ndarray:
        """Begin new stops and return their observations (N, size)."""
        # SB3 keeps one seed and one dictionary of options per environment.
        seeds = list(self._seeds) if any(seed is not None for seed in self._seeds) else None
        names = set(self._options[0])
        if any(set(options) != names for options in self._options):
            raise ParameterError("set_options: every stop must pin the same quantities, each its own value")
        options = {name: [own[name] for own in self._options] for name in names}
        observation, _ = self.env.reset(seed=seeds, options=options or None)
        self._reset_seeds()
        self._reset_options()
        self.reset_infos = [{} for _ in range(self.num_envs)]
        return observation

    def step_async(self, actions: np.ndarray) -> None:
        """Take the actions (N, A)."""
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Advance; a stop that ends begins anew in the same step."""
        observation, reward, terminated, truncated, info = self.env.step(self._actions)
        done = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(done):
            final = info["final_info"]
            infos[i] = {name: value[i] for name, value in final.items() if name[0] != "_" and name != "reward_terms"}
            infos[i]["reward_terms"] = {name: float(term[i]) for name, term in final["reward_terms"].items()}
            infos[i]["terminal_observation"] = info["final_obs"][i]
            infos[i]["TimeLimit.truncated"] = bool(truncated[i])
        return observation, reward.astype(np.float32), done, infos

    def close(self) -> None:
        """Nothing to close: the batch lives in this process."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of the batch, the same for every index."""
        return [getattr(self.env, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuse: the stops of a batch share their attributes."""
        raise AttributeError(f"cannot set {attr_name} of single stops: make the environment with other options instead")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Call a method of the batch once; its result stands for every index."""
        result = getattr(self.env, method_name)(*args, **kwargs)
        return [result] * len(list(self._get_indices(indices)))

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Return that no stop is wrapped."""
        return [False] * len(list(self._get_indices(indices)))

    def get_images(self) -> Sequence[np.ndarray | None]:
        """Return no pictures: a batch does not render."""
        return [None] * self.num_envs
