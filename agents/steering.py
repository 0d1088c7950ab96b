"""From the brake that a policy wants to the valve's command, within the exported network.

A policy wants a brake force, as the adhesion that it asks of the wheelset. Of venting, holding and applying that command is
chosen whose force, one interval after the dead time, comes nearest to the one wanted. The forces are those of the observation,
estimated by `wsp_env.observer.estimator` from the commands alone. Whatever is wanted, a wheelset that has not slid for seconds
is braked, as a WSP takes away no braking where nothing slides; and one that slides beyond the slide limit is vented, so that
no wheel locks.
"""

from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from wsp_env.envs.task import Task
from wsp_env.observer.observation import Observer
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.command import to_action

#: Places in an observation of A axles, in blocks of A: creepage, brake to come, recent and slow slip.
CREEPAGE, BRAKE_TO_COME, RECENT_SLIP, SLOW_SLIP = 1, 4, 6, 8

#: And from its end: the doubt on the running speed, the distributor's pressure and that speed.
DOUBTFUL, DISTRIBUTOR, SPEED = -4, -3, -2

#: A wheelset does not slide while its recent and its slow slip are below this speed [m/s] or this creepage [-]: so much has a
#: wheel that rolls under brake (assumption).
ROLLS_MPS, ROLLS_CREEPAGE = 0.05, 0.003

#: Creepage [-] beyond which a wheelset is vented whatever is wanted: the default slide limit of the environments.
LARGEST_CREEPAGE = 0.3


class Steering:
    """Chooses commands for a vehicle's valves.

    It is written for few operations: each takes half a microsecond of a decision.
    """

    def __init__(self, vehicle: Vehicle, interval: float) -> None:
        self.axles = vehicle.axles
        kept = np.exp(-interval / np.array([vehicle.brake.fill_time_constant_s, vehicle.brake.vent_time_constant_s]))
        self.half_way_filling, self.half_way_venting = float(0.5 * (1.0 - kept[0])), float(0.5 * (1.0 + kept[1]))

    def commands(self, observation: torch.Tensor, wanted: torch.Tensor) -> torch.Tensor:
        """Return -1 vent, 0 hold, 1 apply (N, A) towards `wanted` (N, A), see `wanted_brake`."""
        creepage, held, recent, slow, doubtful, distributor, speed = self._parts(observation)
        brake = wanted + 1.0
        apply = brake > held + self.half_way_filling * (distributor - held)
        vent = brake < self.half_way_venting * held
        command = apply.to(torch.float32) - vent.to(torch.float32)
        limit = torch.clamp(
            ROLLS_CREEPAGE * Observer.SPEED_SCALE / Observer.SLIP_SCALE * speed, min=ROLLS_MPS / Observer.SLIP_SCALE
        )
        rolls = (torch.maximum(recent, slow) < limit) & (doubtful < 0.5)  # not while one is released for the speed's sake
        command = torch.where(rolls, 1.0, command)
        return torch.where(creepage > LARGEST_CREEPAGE, -1.0, command)

    def _parts(self, observation: torch.Tensor) -> list[torch.Tensor]:
        """Return what is used of observations (N, size), in order; one cut of the whole."""
        places = [(block * self.axles, self.axles) for block in (CREEPAGE, BRAKE_TO_COME, RECENT_SLIP, SLOW_SLIP)]
        size = Observer.size_for(self.axles)
        places += [(size + place, 1) for place in (DOUBTFUL, DISTRIBUTOR, SPEED)]
        cuts = sorted({0, size, *(start for start, _ in places), *(start + length for start, length in places)})
        parts = torch.split(observation, np.diff(cuts).tolist(), dim=1)
        return [parts[cuts.index(start)] for start, _ in places]


def wanted_brake(adhesion: np.ndarray) -> np.ndarray:
    """Return what is wanted of a policy for brakes that ask for an adhesion [-]: -1 none, 1 that of 0.2 or more."""
    return np.clip(adhesion / Observer.ADHESION_SCALE - 1.0, -1.0, 1.0)


def make_steering(vehicle: str, task: Task) -> Steering:
    """Return the steering of a vehicle's valves at a task's interval."""
    return Steering(task.make_vehicle(vehicle), task.control_interval_s)


class Steered(VecEnvWrapper):
    """Valve environments that are told the brake wanted, see `wanted_brake`."""

    def __init__(self, venv: VecEnv, steering: Steering) -> None:
        super().__init__(venv, action_space=spaces.Box(-1.0, 1.0, (steering.axles,), np.float32))
        self.steering = steering

    def reset(self) -> Any:
        """Begin new stops."""
        self._observation = np.asarray(self.venv.reset())
        return self._observation

    def step_async(self, actions: np.ndarray) -> None:
        """Take the brakes wanted (N, A)."""
        commands = self.steering.commands(torch.as_tensor(self._observation), torch.as_tensor(actions))
        self.venv.step_async(to_action(commands.numpy()))

    def step_wait(self) -> Any:
        """Advance."""
        observation, reward, done, infos = self.venv.step_wait()
        self._observation = np.asarray(observation)
        return self._observation, reward, done, infos
