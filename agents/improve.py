"""Whether PPO improves on what was imitated: `python -m agents.improve --base agents/trained/bogie --cosine 6`.

The world is `agents.varied` (brakes, gains, radii and sensor noise drawn) or the nominal vehicle with noisy sensors, on low
adhesion. With `--cosine K` the policy gradients of K independent rollouts at the frozen policy are compared, and nothing is
learned but the value function: the mean cosine between them says how much of one is signal. Without it PPO learns a
residual (`agents.held`), and its score over that of the frozen policy is printed, on stops and vehicles of other draws, below
those of teacher, ideal and bound.
"""

import dataclasses
import itertools
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
import tyro
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.vec_env import VecEnv

from agents.held import Base, Held, ResidualPolicy
from agents.measure import INITIAL_SPEED_MPS, RECOVERY_M_PER_J
from agents.settings import Arguments, task_options
from agents.steering import make_steering
from agents.teacher import ideal
from agents.varied import varied_parts
from agents.worlds import Joined, Shaped, Stopped
from wsp_env.envs.sb3 import BrakingVecEnv
from wsp_env.envs.task import make_task
from wsp_env.evaluation.bound import ceiling
from wsp_env.evaluation.policy import NETWORK
from wsp_env.evaluation.reference import nearest, wanted_pressure
from wsp_env.evaluation.summary import interval
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.plant.command import to_action
from wsp_env.plant.port import Plant, Stop

#: Discount of a decision of 20 ms, as in `agents.train`.
GAMMA = 0.99

#: Seed of the stops on which the residual is judged.
JUDGED_BY = 9_000_011

#: Between the seeds of the stops of two rollouts, or of two trainings: each stop has a seed of its own, one after the other.
APART = 100_000

#: An ideal stop on extremely low adhesion is over after so long [s].
_LONGEST_S = 400.0

#: Noise of all speed sensors [rad/s] in the world "noise": twice to three times that of the shipped policies' trainings.
NOISY = (0.2, 0.3)

#: Full brake on low adhesion, about as `agents.measure.low_adhesion` draws it: an initial adhesion of 0.05 to 0.08.
LOW: dict[str, Any] = {
    "mu_cd": (0.023, 0.045), "tau": RECOVERY_M_PER_J, "initial_speed": INITIAL_SPEED_MPS, "demand": (1.0, 1.0),
    "tracks": ("constant",),
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Improvement:
    """What is done."""

    vehicle: Literal["wheelset", "bogie", "coach"] = "bogie"
    base: Path = Path("agents/trained/bogie")  # folder of the frozen policy
    world: Literal["varied", "noise"] = "varied"  # see `agents.varied`; noise: nominal, with noisy sensors
    held: int = 8  # decisions of 20 ms that a residual lasts; 1: white noise at every decision
    privileged: bool = True  # the value function sees what is true
    cosine: int = 0  # independent rollouts whose gradients are compared; 0: PPO learns
    envs: int = 256
    rollout_s: float = 12.8  # of each stop between two updates [s]
    updates: int = 40
    critic_updates: int = 4  # first updates in which only the value function learns
    log_deviation: float = -1.0  # of the residual, in shares of its reach
    learning_rate: float = 3e-4
    slide_price: float = 4.3
    classic_share: float = 0.25
    judged: int = 96  # stops
    look: int = 20  # updates between two looks at them
    seed: int = 1


def make_held(given: Improvement, envs: int, seed: int) -> Held:
    """Return the world of a seed with the frozen policy inside."""
    torque = VEHICLES[given.vehicle].brake.torque_per_bar_nm
    options = task_options(Arguments(vehicle=given.vehicle, torque_per_bar_nm=torque)) | {"scenario": LOW}
    classic = round(given.classic_share * envs)
    laws = {"recovering": envs - classic, "classic": classic}
    parts: list[Shaped] = []
    for law, count in laws.items():
        if count and given.world == "varied":
            parts += varied_parts(given.vehicle, count, law, options, given.slide_price, seed, guarded=False)
        elif count:
            noisy = options | {"scenario": LOW | {"sensor_noise": NOISY}}
            env = BrakingVecEnv(f"wsp_env/{given.vehicle.title()}-v1", count, adhesion=law, **noisy)
            parts.append(Shaped(env, given.slide_price))
    joined = Joined(parts)
    joined.seed(APART * seed)
    steering = make_steering(given.vehicle, make_task(options))
    return Held(joined, steering, Base(str(given.base / NETWORK)), given.held, GAMMA, given.slide_price)


def make_model(given: Improvement, world: Held) -> PPO:
    """Return PPO on residuals, which begins with none."""
    steps = max(1, round(given.rollout_s / (0.02 * given.held)))
    return PPO(
        ResidualPolicy,
        world,
        n_steps=steps,
        batch_size=max(1, given.envs * steps // 8),
        n_epochs=4,
        gamma=GAMMA**given.held,
        gae_lambda=0.95**given.held if given.held < 4 else 0.8,
        clip_range=0.1,
        learning_rate=given.learning_rate,
        policy_kwargs={"own": world.own, "privileged": given.privileged, "log_std_init": given.log_deviation},
        seed=given.seed,
        device="cpu",
    )


def let_learn(model: PPO, policy: bool) -> None:
    """Let the policy learn or not; the value function always does."""
    for name, parameter in model.policy.named_parameters():
        if "policy_net" in name or "action_net" in name or "log_std" in name:
            parameter.requires_grad = policy


def gradient(model: PPO) -> np.ndarray:
    """Return the policy gradient (P,) of the rollout that the model holds."""
    let_learn(model, policy=True)
    buffer = model.rollout_buffer
    assert isinstance(buffer, RolloutBuffer)
    data = next(buffer.get(buffer.buffer_size * buffer.n_envs))
    _, log_probability, _ = model.policy.evaluate_actions(data.observations, data.actions)
    advantage = (data.advantages - data.advantages.mean()) / (data.advantages.std() + 1e-8)
    own = [p for name, p in model.policy.named_parameters() if "policy_net" in name or "action_net" in name]
    parts: Any = torch.autograd.grad(-(advantage * log_probability).mean(), own, allow_unused=True)
    flat = [part.reshape(-1) for part in parts if part is not None]
    return torch.cat(flat).numpy().astype(np.float64)


def cosines(given: Improvement) -> dict[str, float]:
    """Return the mean cosine between the gradients of independent rollouts, and the share of returns that is explained.

    The rollouts have other stops and another exploration, the vehicles are the same.
    """
    world = make_held(given, given.envs, given.seed)
    model = make_model(given, world)
    let_learn(model, policy=False)
    each = given.envs * model.n_steps
    model.learn(each * given.critic_updates)
    found = []
    for number in range(given.cosine):
        torch.manual_seed(1000 * given.seed + number)
        world.venv.seed(APART * (1000 * given.seed + 1 + number))
        model._last_obs = None  # new stops
        _, callback = model._setup_learn(each, None, False)
        model.collect_rollouts(model.env, callback, model.rollout_buffer, model.n_steps)  # type: ignore[arg-type]  # SB3: env may be None before learning
        found.append(gradient(model))
    buffer = model.rollout_buffer
    explained = 1.0 - np.var(buffer.returns - buffer.values) / np.var(buffer.returns)
    pairs = [a @ b / np.linalg.norm(a) / np.linalg.norm(b) for a, b in itertools.combinations(found, 2)]
    return {"cosine": float(np.mean(pairs)), "deviation": float(np.std(pairs)), "explained": float(explained)}


def brake(given: Improvement, model: PPO | None) -> np.ndarray:
    """Return metres travelled and metres slid (2, N) of the judged stops; without a model those of the frozen policy."""
    world = make_held(given, given.judged, JUDGED_BY)
    none = np.zeros((given.judged, world.steering.axles))
    return _until_all_stand(world, lambda seen: none if model is None else model.predict(seen, deterministic=True)[0])


def _until_all_stand(world: VecEnv, act: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Return metres travelled and metres slid (2, N) of the first stop of each environment."""
    seen, found = np.asarray(world.reset()), np.full((2, world.num_envs), np.nan)
    while np.isnan(found).any():
        observed, _, done, infos = world.step(act(seen))
        seen = np.asarray(observed)
        for i in np.flatnonzero(done & np.isnan(found[0])):
            stopped: Stopped = infos[i]["stopped"]
            found[:, i] = stopped.stopping_distance_m, stopped.slide_distance_m
    return found


def marks(given: Improvement) -> dict[str, np.ndarray]:
    """Return metres travelled and slid (2, N) of who knows all, on the judged stops: teacher with the real valves, and ideal.

    "bound" holds the shortest distances (N,) within the slide limit, whatever they slide.
    """
    world = make_held(given, given.judged, JUDGED_BY)

    def command(_: np.ndarray) -> np.ndarray:
        plants = [(part.batch.plant, teacher.targets()) for part, teacher in zip(world.parts, world.teachers, strict=True)]
        return to_action(np.concatenate([nearest(plant, wanted_pressure(plant, target)) for plant, target in plants]))

    world.reset()
    each = [(part.batch.plant.vehicle, stops_of(part.batch.plant)) for part in world.parts]
    perfect = [np.array(ideal(vehicle, stops, given.slide_price, _LONGEST_S)) for vehicle, stops in each]
    bound = np.concatenate([ceiling(vehicle, stops).shortest()[0] for vehicle, stops in each])
    world.venv.seed(APART * JUDGED_BY)
    return {"teacher": _until_all_stand(world.venv, command), "ideal": np.concatenate(perfect, axis=1), "bound": bound}


def stops_of(plant: Plant) -> list[Stop]:
    """Return the conditions that a plant runs under, stop by stop."""
    c = plant.conditions
    single = ("mu_cd", "tau", "mass", "demand", "gradient", "noise")
    return [
        Stop(
            **{name: float(getattr(c, name)[i]) for name in single},
            initial_speed=float(plant.truth().speed[i]),
            key=0,
            radius=c.radius[i].copy(),
            profile=c.profile[i].copy(),
            coverage=c.coverage[i].copy(),
        )
        for i in range(plant.n)
    ]


def improve(given: Improvement) -> list[dict[str, float]]:
    """Let PPO learn a residual; return a row for each look: paid metres over those of the frozen policy, with the interval."""
    world = make_held(given, given.envs, given.seed)
    model = make_model(given, world)
    base, rows = brake(given, None), list[dict[str, float]]()
    print(json.dumps(_over(given, marks(given), base)), flush=True)
    each, spent = given.envs * model.n_steps, 0.0
    for update in range(given.updates + 1):
        if update % given.look == 0 or update == given.updates:
            own = brake(given, model)
            ratio, half = interval((own[0] + given.slide_price * own[1]) / (base[0] + given.slide_price * base[1]))
            means = {"distance": float(own[0].sum() / base[0].sum()), "slide": float(own[1].sum() / base[1].sum())}
            rows.append({"update": float(update), "cpu_s": spent, "paid": ratio, "interval": half} | means)
            print(json.dumps(rows[-1]), flush=True)
        if update < given.updates:
            begun = time.process_time()
            let_learn(model, update >= given.critic_updates)
            model.learn(each, reset_num_timesteps=update == 0)
            spent += time.process_time() - begun
    return rows


def _over(given: Improvement, found: dict[str, np.ndarray], base: np.ndarray) -> dict[str, float]:
    """Return what `marks` pay over what the frozen policy does, mean of the stops; of the bound the distance."""
    paid = {name: own[0] + given.slide_price * own[1] for name, own in found.items() if name != "bound"}
    ratios = {name: float(np.mean(own / (base[0] + given.slide_price * base[1]))) for name, own in paid.items()}
    return ratios | {"bound_distance": float(np.mean(found["bound"] / base[0]))}


def main(given: Improvement) -> None:
    """Compare gradients or learn."""
    torch.set_num_threads(1)
    if given.cosine:
        print(json.dumps(cosines(given)))
    else:
        improve(given)


if __name__ == "__main__":
    main(tyro.cli(Improvement))
