"""What the learner brakes in: batches of different worlds joined to one, with a reward that is quick to learn from."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecNormalize

from wsp_env.contact.port import adhesion_under
from wsp_env.envs.sb3 import BrakingVecEnv
from wsp_env.observer.observation import Observer
from wsp_env.plant.command import APPLIES, to_action
from wsp_env.plant.port import Plant

#: Place of the reference speed in an observation.
REFERENCE = -2

#: Reference speed [m/s] below which the brake is applied whatever the policy says, 5 km/h (assumption: EN 15595, no WSP below
#: 3 to 5 km/h); part of the exported network.
CUT_OUT_MPS = 5.0 / 3.6

#: Weights of the environment's reward in trainings: without its potential, which is that of the dry stop, and without its price
#: of sliding, as `Shaped` has both; with a slide limit that is not to be crossed (5 a second and unit of creepage at 30 m/s,
#: assumption).
REWARD = {"time": 0.0, "rest_of_stop": 0.0, "slip": 0.0, "large_slip": 0.17, "locked_wheels": 0.17}

#: Seconds count as so many metres [m/s]: else nothing is gained from coming to a stand at the end (assumption).
TIME_PRICE_MPS = 2.0

#: Running speeds [m/s] at which the rest of a stop is estimated, linear between them, and slips tried as shares of these.
SPEEDS = np.arange(0.0, 61.0, 2.0)
_SHARES = np.geomspace(0.002, 0.25, 16)


@dataclasses.dataclass(frozen=True)
class Stopped:
    """What is reported about a stop that has ended, in physical units."""

    stopping_distance_m: float
    slide_distance_m: float  # integral of the slip speed over time, mean of the axles
    beyond_limit_s: float  # time beyond the slide limit, mean of the axles
    locked_s: float  # time locked, mean of the axles
    air_nl: float
    contact_energy_mj: float  # worst wheelset
    reward: float


class Shaped(VecEnvWrapper):
    """The environment's reward, given earlier, less the metres that the wheels slide; and the cut-out at low speed.

    r = r_env - w (c s + p) dt + w (F(v) - F(v'))

    with w the environment's weight of a metre travelled. The price c of sliding: a metre by which the wheels slide (mean of the
    axles) counts as c metres travelled; heat in the contact, wear and the deviation of the slip speed fall with it. The price p
    of time makes the end of a stop worth something. The last term is a potential (Ng, Harada, Russell 1999, without the
    discount): F(v) is what the rest of the stop costs who knows its rail, see `rest_of_stop`. The sum over a stop depends on
    its conditions alone, but what the brake does now is rewarded now and not half a minute later, and weighed against the slide
    as it is worth on this rail.

    Parameters
    ----------
    venv : environments to wrap
    slide_price : c [-]

    """

    venv: BrakingVecEnv

    def __init__(self, venv: BrakingVecEnv, slide_price: float) -> None:
        super().__init__(venv)
        self.batch = venv.env.batch
        self.slide_price = slide_price
        self._sums = np.zeros((4, self.num_envs))  # of the stops under way: slide, beyond, locked, reward

    def reset(self) -> np.ndarray:
        """Begin new stops."""
        observation = np.asarray(self.venv.reset())
        self._reference = Observer.SPEED_SCALE * observation[:, REFERENCE]
        self.rest = rest_of_stop(self.batch.plant, np.arange(self.num_envs), self.slide_price)
        self._owed = self._rest_at(self.batch.plant.truth().speed)
        self._air = self.batch.plant.truth().air.copy()
        self._sums[:] = 0.0
        return observation

    def step_async(self, actions: np.ndarray) -> None:
        """Take the actions (N, A); where the vehicle is as good as at rest the brake is applied."""
        full = int(to_action(APPLIES)) if self.batch.task.action == "valve" else APPLIES
        self.venv.step_async(self.final(np.where((self._reference < CUT_OUT_MPS)[:, None], full, actions)))

    def final(self, actions: np.ndarray) -> np.ndarray:
        """Return what is done of actions (N, A): all."""
        return actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Advance; `infos[i]["stopped"]` holds a `Stopped` when stop i has ended."""
        observation, reward, done, infos = self.venv.step_wait()
        task, weight = self.batch.task, self.batch.weights.stopping_distance
        truth = self.batch.plant.truth()
        speed, slip, locked = truth.speed.copy(), truth.slip_speed.copy(), self.batch.locked
        ended = np.flatnonzero(done)
        for i in ended:  # the batch holds the next stop already
            speed[i], slip[i], locked[i] = infos[i]["speed_mps"], infos[i]["slip_speed_mps"], infos[i]["locked"]
        interval = task.control_interval_s
        slid = slip.mean(axis=1) * interval
        owed = self._rest_at(speed)
        self.own = self._given_away(speed, slip, locked, done)
        reward = reward + weight * (self._owed - owed - self.slide_price * slid - TIME_PRICE_MPS * interval)
        fast = speed > task.slide_limit_speed_mps
        beyond = (slip > task.slide_limit * speed[:, None]).mean(axis=1) * fast
        self._sums += [slid, beyond * interval, locked.mean(axis=1) * interval, reward]
        for i in ended:
            end, (slide, limit, lock, total) = infos[i], self._sums[:, i]
            work = 1e-6 * float(np.max(end["contact_energy_j"]))
            distance, air = float(end["position_m"]), float(end["air_nl"])
            infos[i]["stopped"] = Stopped(distance, slide, limit, lock, air, work, total)
        self._sums[:, ended] = 0.0
        self._reference = Observer.SPEED_SCALE * observation[:, REFERENCE]
        if len(ended):
            self.rest[ended] = rest_of_stop(self.batch.plant, ended, self.slide_price)
            owed = self._rest_at(self.batch.plant.truth().speed)
        self._owed = owed
        return observation, reward.astype(np.float32), done, infos

    def _given_away(self, speed: np.ndarray, slip: np.ndarray, locked: np.ndarray, done: np.ndarray) -> np.ndarray:
        """Return what each wheelset gives away in a step (N, A) [m], at most 0 where it brakes as well as can be.

        With the deceleration g f of a wheelset's adhesion, (F'(v) g f - v - p - c s) dt; beyond the slide limit, locked and for
        air it pays as in the environment's reward. The mean over the wheelsets is the reward in metres while no wheel is faster
        than the vehicle, but for the running resistance, which nobody decides. 0 where the stop has ended: its last adhesion is
        not known.
        """
        task, weights, truth = self.batch.task, self.batch.weights, self.batch.plant.truth()
        place = np.clip(speed / SPEEDS[1], 0.0, len(SPEEDS) - 1.001).astype(int)
        rows = np.arange(len(speed))
        per_mps = ((self.rest[rows, place + 1] - self.rest[rows, place]) / SPEEDS[1])[:, None]
        running, fast = speed[:, None], (speed > task.slide_limit_speed_mps)[:, None]
        rate = per_mps * self.batch.vehicle.gravity_mps2 * truth.adhesion
        rate -= running + TIME_PRICE_MPS + self.slide_price * np.maximum(slip, 0.0)
        beyond, filled = np.maximum(slip - task.slide_limit * running, 0.0) * fast, slip.shape[1] * (truth.air - self._air)
        self._air = truth.air.copy()
        in_metres = 1.0 / weights.stopping_distance
        paid = (weights.large_slip * beyond + weights.locked_wheels * locked * running) * task.control_interval_s
        own = rate * task.control_interval_s - in_metres * (paid + weights.air * filled)
        return np.where(done[:, None], 0.0, own)

    def _rest_at(self, speed: np.ndarray) -> np.ndarray:
        """Price of the rest of the stops (N,) [m] at their running speeds (N,) [m/s]."""
        place = np.clip(speed / SPEEDS[1], 0.0, len(SPEEDS) - 1.001)
        below = place.astype(int)
        rows, share = np.arange(len(speed)), place - below
        price: np.ndarray = (1.0 - share) * self.rest[rows, below] + share * self.rest[rows, below + 1]
        return price


def rest_of_stop(plant: Plant, rows: np.ndarray, slide_price: float) -> np.ndarray:
    """Return the least price [m] of the rest of the stops `rows` (n,) from each of `SPEEDS`: (n, K).

    F(v) = integral of min over s of (v' + p + c s) / d(s, v') from 0 to v, with the deceleration d that the rail under the
    recovering or classic law allows at slip s, or the brake.
    """
    c, vehicle, axles = plant.conditions, plant.vehicle, plant.vehicle.axles
    weight = c.mass[rows] * vehicle.gravity_mps2
    offered = c.demand[rows] * vehicle.full_brake_torque_nm * axles / (vehicle.wheel_radius_m * weight)
    friction = c.mu_cd[rows] * c.profile[rows].mean(axis=1)
    speed = np.maximum(SPEEDS, 0.5)[:, None]  # of the contact, which needs one
    slip = speed * _SHARES
    of_rows = (weight / (2.0 * axles), friction, c.tau[rows], offered)
    load, friction, tau, offered = (value[:, None, None] for value in of_rows)
    adhesion = adhesion_under(vehicle.contact.law, slip, speed, load, friction, tau)
    deceleration = vehicle.gravity_mps2 * np.minimum(adhesion, offered)
    price = ((SPEEDS[:, None] + TIME_PRICE_MPS + slide_price * slip) / deceleration).min(axis=-1)
    steps = 0.5 * (price[:, 1:] + price[:, :-1]) * np.diff(SPEEDS)
    return np.concatenate([np.zeros((len(rows), 1)), np.cumsum(steps, axis=1)], axis=1)


def observed(world: VecNormalize) -> RunningMeanStd:
    """Return the running mean and variance of the observations."""
    assert isinstance(world.obs_rms, RunningMeanStd)  # one array; of a dictionary there would be several
    return world.obs_rms


class Joined(VecEnv):
    """Several vector environments with the same spaces, one after another, as one; for worlds of different physics.

    `seed(s)` seeds the stops with s, s + 1, ... through all of them.
    """

    def __init__(self, parts: Sequence[VecEnv]) -> None:
        self.parts = list(parts)
        self._ends = np.cumsum([part.num_envs for part in parts])
        self.render_mode = None
        super().__init__(int(self._ends[-1]), parts[0].observation_space, parts[0].action_space)

    def reset(self) -> np.ndarray:
        """Begin new stops."""
        if self._seeds[0] is not None:
            for part, end in zip(self.parts, self._ends, strict=True):
                part.seed(self._seeds[end - part.num_envs])
        self._reset_seeds()
        self.reset_infos = [{} for _ in range(self.num_envs)]
        return np.concatenate([part.reset() for part in self.parts])

    def step_async(self, actions: np.ndarray) -> None:
        """Take the actions (N, A)."""
        for part, own in zip(self.parts, np.split(actions, self._ends[:-1]), strict=True):
            part.step_async(own)

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Advance all."""
        observation, reward, done, infos = zip(*(part.step_wait() for part in self.parts), strict=True)
        return np.concatenate(observation), np.concatenate(reward), np.concatenate(done), [i for own in infos for i in own]

    def close(self) -> None:
        """Close all."""
        for part in self.parts:
            part.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of every stop's environment."""
        values = [value for part in self.parts for value in part.get_attr(attr_name)]
        return [values[i] for i in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuse, as the parts do."""
        raise AttributeError(f"cannot set {attr_name} of single stops")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Call a method once in every part."""
        values = [value for part in self.parts for value in part.env_method(method_name, *args, **kwargs)]
        return [values[i] for i in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Return whether the parts are wrapped so."""
        return [isinstance(part, wrapper_class) for part in self.parts for _ in range(part.num_envs)]
