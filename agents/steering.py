"""From the pressure that a policy wants to the valve's command, within the exported network.

Of venting, holding and applying that command is chosen whose cylinder pressure, one interval after the dead time, comes nearest
to the one wanted. The pressures are those of the observation, reckoned by `wsp_env.envs.reckoning` from the commands alone.
A wheelset that has not slid for seconds is braked whatever is wanted: a WSP takes away no braking where nothing slides.
"""

from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from wsp_env.envs.observation import Observer
from wsp_env.envs.task import Task
from wsp_env.parameters.vehicle import Vehicle

#: Places in an observation of A axles: the pressures to come begin at 4 A, the offered one is the third from its end.
PRESSURE_TO_COME, OFFERED = 4, -3

#: And those of the recent and the slow slip, in axles; of the doubt on the running speed and of that speed, from the end.
RECENT_SLIP, SLOW_SLIP, DOUBTFUL, SPEED = 6, 8, -4, -2

#: A wheelset does not slide while its recent and its slow slip are below this speed [m/s] or this creepage [-]: so much has a
#: wheel that rolls under brake (assumption).
ROLLS_MPS, ROLLS_CREEPAGE = 0.05, 0.003


class Steering:
    """Chooses commands for a vehicle's valves."""

    def __init__(self, vehicle: Vehicle, interval: float) -> None:
        self.axles = vehicle.axles
        self.kept_filling = float(np.exp(-interval / vehicle.brake.fill_time_constant_s))
        self.kept_venting = float(np.exp(-interval / vehicle.brake.vent_time_constant_s))

    def commands(self, observation: torch.Tensor, wanted: torch.Tensor) -> torch.Tensor:
        """Return -1 vent, 0 hold, 1 apply (N, A) towards `wanted` (N, A), -1 none to 1 full pressure."""
        share = 0.5 * (torch.clamp(wanted, -1.0, 1.0) + 1.0)
        start = PRESSURE_TO_COME * self.axles
        held = observation[:, start : start + self.axles]
        offered = observation[:, OFFERED, None]
        filled = offered + (held - offered) * torch.where(offered > held, self.kept_filling, self.kept_venting)
        rest, applied, vented = (torch.abs(pressure - share) for pressure in (held, filled, self.kept_venting * held))
        apply = ((applied < rest) & (applied <= vented)) | (share >= 1.0)
        vent = (vented < rest) & ~apply
        apply, vent = apply | (rolls := self.rolls(observation)), vent & ~rolls
        return apply.to(torch.float32) - vent.to(torch.float32)

    def rolls(self, observation: torch.Tensor) -> torch.Tensor:
        """Return which wheelsets (N, A) have not slid for seconds; none while one is released for the speed's sake."""
        limit = torch.clamp(ROLLS_CREEPAGE * Observer.SPEED_SCALE * observation[:, SPEED, None], min=ROLLS_MPS)
        slips = [observation[:, place * self.axles : (place + 1) * self.axles] for place in (RECENT_SLIP, SLOW_SLIP)]
        slides = (Observer.SLIP_SCALE * torch.maximum(*slips)) >= limit
        return ~slides & (observation[:, DOUBTFUL, None] < 0.5)


def make_steering(vehicle: str, task: Task) -> Steering:
    """Return the steering of a vehicle's valves at a task's interval."""
    return Steering(task.make_vehicle(vehicle), task.control_interval_s)


class Steered(VecEnvWrapper):
    """Valve environments that are told the pressures wanted, -1 to 1 of full pressure."""

    def __init__(self, venv: VecEnv, steering: Steering) -> None:
        super().__init__(venv, action_space=spaces.Box(-1.0, 1.0, (steering.axles,), np.float32))
        self.steering = steering

    def reset(self) -> Any:
        """Begin new stops."""
        self._observation = np.asarray(self.venv.reset())
        return self._observation

    def step_async(self, actions: np.ndarray) -> None:
        """Take the pressures wanted (N, A)."""
        commands = self.steering.commands(torch.as_tensor(self._observation), torch.as_tensor(actions))
        self.venv.step_async(commands.numpy().astype(int) + 1)

    def step_wait(self) -> Any:
        """Advance."""
        observation, reward, done, infos = self.venv.step_wait()
        self._observation = np.asarray(observation)
        return self._observation, reward, done, infos
