"""The Gymnasium environment of one vehicle: the batch of one."""

from typing import Any

import gymnasium as gym
import numpy as np

from wsp_env.envs.batch import BrakingBatch
from wsp_env.envs.rendering import Recorder
from wsp_env.envs.task import make_task
from wsp_env.parameters.quantity import ParameterError, shown


class BrakingEnv(gym.Env[np.ndarray, Any]):
    """A railway vehicle brakes to standstill on a contaminated rail; the agent works the dump valves of its brake cylinders.

    Ids: `wsp_env/Wheelset-v1` (1 axle), `wsp_env/Bogie-v1` (2), `wsp_env/Coach-v1` (4), `wsp_env/Train-v1` (40).

    **Action**: `MultiDiscrete([3] * axles)`, per axle 0 vent, 1 hold, 2 apply; with `action="pressure"` `Box(-1, 1)`, per axle
    from no pressure (-1) to the demanded one (+1).

    **Observation**: float32, built from measured wheel speeds, the brake demand and own commands, see
    `wsp_env.observer.observation.Observer`. The true speed, adhesion and conditions are in `info` only.

    **Reward**: the sum of the terms in `info["reward_terms"]`: stopping distance, time, what the rest of the stop costs, slip,
    slip beyond the limit, locked wheels, air; weights in `wsp_env.envs.task.RewardWeights`.

    **Start**: rolling freely, cylinders empty, conditions drawn as `wsp_env.scenario.Scenario` says; `reset(options={"mu_cd":
    0.03})` pins any of `wsp_env.scenario.PINS`.

    **End**: terminated at standstill; truncated at the time or track limit.

    **Arguments**: `vehicle_name`, `render_mode` ("rgb_array", "human", "ansi") and the options of `wsp_env.envs.task.Task`.

    **Versions**: v1, what the brake does is rewarded at once and a metre slid has a price; v0, metres and slides as they pass.
    """

    metadata = {"render_modes": ["rgb_array", "human", "ansi"], "render_fps": 50}  # noqa: RUF012  # as Gymnasium declares it

    def __init__(self, vehicle_name: str = "bogie", render_mode: str | None = None, **options: Any) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ParameterError(
                f"render_mode {shown(render_mode)} is unknown; valid: {', '.join(self.metadata['render_modes'])}"
            )
        self.batch = BrakingBatch(vehicle_name, 1, make_task(options))
        self.metadata = {**self.metadata, "render_fps": max(1, round(1.0 / self.batch.task.control_interval_s))}
        self.observation_space = self.batch.observation_space
        self.action_space = self.batch.action_space
        self.render_mode = render_mode
        self._recorder = Recorder(self.batch) if render_mode is not None else None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """Draw the conditions of a new stop; `options` pins any by name."""
        super().reset(seed=seed)
        observation = self.batch.start([self.np_random], options)
        if self._recorder is not None:
            self._recorder.begin()
            if self.render_mode == "human":
                self._recorder.show()
        return observation[0], self._info({name: np.zeros(1) for name in vars(self.batch.weights)})

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Advance by one control interval."""
        observation, reward, terms, terminated, truncated = self.batch.step(np.asarray(action)[None])
        if self._recorder is not None:
            self._recorder.add()
            if self.render_mode == "human":
                self._recorder.show()
        return observation[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), self._info(terms)

    def _info(self, terms: dict[str, np.ndarray]) -> dict[str, Any]:
        info: dict[str, Any] = {name: values[0] for name, values in self.batch.truth().items()}
        info["reward_terms"] = {name: float(term[0]) for name, term in terms.items()}
        return info

    def render(self) -> Any:
        """Return the picture (H, W, 3) uint8 or the text of the stop so far, by `render_mode`."""
        if self._recorder is None:
            gym.logger.warn("render() needs a render_mode: gym.make(..., render_mode='rgb_array')")
            return None
        if not self._recorder.history:
            raise RuntimeError("render before reset: call reset() first, it begins a stop")
        if self.render_mode == "ansi":
            return self._recorder.text()
        return self._recorder.picture() if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Close the window, if any."""
        if self._recorder is not None:
            self._recorder.close()
