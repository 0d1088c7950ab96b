"""PPO on top of an imitation, every wheelset an agent of its own: `python -m agents.improve --base out/agents/bogie-1/policy`.

The base is a policy folder that `agents.train` wrote. PPO goes on with its network, see `agents.axles`, on the conditions of
its training and on vehicles that are drawn, see `agents.varied`. What has the best score on the watched stops is exported to
`policy/` in the run's folder. Started again after a kill, a run goes on from its last checkpoint, and ends with the weights of
one that was not killed. With `--cosine K` nothing is learned but the value function: the mean cosine between the policy
gradients of K independent rollouts is printed, which says how much of one is signal.
"""

import dataclasses
import hashlib
import itertools
import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.utils import set_random_seed
from stable_baselines3.common.vec_env import VecNormalize

from agents import checkpoint, settings
from agents.axles import HELD, AxlePolicy, EachAxle
from agents.export import Actor, export
from agents.settings import Arguments, task_options
from agents.steering import make_steering
from agents.train import EndedStops, make_model, make_world, segment_seed, write_curve
from agents.varied import varied_parts
from agents.watch import Watch
from agents.worlds import Joined, observed
from wsp_env.envs.task import RewardWeights, make_task
from wsp_env.evaluation.policy import NETWORK, load_policy
from wsp_env.parameters.quantity import ParameterError

#: Between the seeds of the stops of two rollouts whose gradients are compared: each stop has a seed of its own.
APART = 100_000


@dataclasses.dataclass(frozen=True)
class Improvement:
    """Let PPO go on with an imitated policy; every wheelset is an agent that is rewarded for what it gives away itself."""

    base: Path  # policy folder that is improved, written by `agents.train`
    seed: int = 1  # of the vehicles, the stops and the exploration
    out: Path = Path()  # folder of the run; none: out/agents/VEHICLE-ppo-SEED
    envs: int = 1024  # vehicles at once
    classic_share: float = 0.5  # of them under the classic law
    updates: int = 72  # rounded to whole segments
    segment: int = 24  # updates between two checkpoints; each begins new stops
    rollout: int = 16  # deviations of 0.16 s of each wheelset between two updates
    critic_updates: int = 4  # first updates in which only the value function learns
    epochs: int = 4  # passes over each rollout
    batches: int = 8  # steps of the optimiser in a pass
    learning_rate: float = 3e-4  # falls linearly to zero
    gamma: float = 0.98  # discount of 20 ms: a time constant of 1 s; what comes later is in the potential, see `agents.worlds`
    gae_lambda: float = 0.9  # of 0.16 s
    clip: float = 0.1  # largest change of a probability ratio that is rewarded
    deviation: float = 0.07  # of the exploration, in units of the brake wanted: 0.007 of adhesion
    air_price: float = 0.1  # metres travelled that a normal litre is worth, of the axles together
    watched: int = 24  # stops under each law, in each of three worlds, by which learning is watched
    cosine: int = 0  # independent rollouts whose gradients are compared; 0: PPO learns


class Base:
    """An exported policy as a model again; its network is what PPO changes.

    Parameters
    ----------
    folder : of the policy
    out : folder for logs

    Raises
    ------
    SystemExit
        if `agents.train` did not write it, or it has a memory, or does not tell the brake wanted

    """

    def __init__(self, folder: Path, out: Path) -> None:
        import onnx
        from onnx import numpy_helper

        try:
            training = load_policy(folder).contract.training
        except ParameterError as error:
            raise SystemExit(str(error)) from None
        given = training.get("arguments", {})
        if given.get("action") != "steered" or given.get("recurrent"):
            raise SystemExit(f"{folder} is no steered policy without memory from `python -m agents.train`: nothing to improve")
        known = {field.name for field in dataclasses.fields(Arguments)}
        values: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value for name, value in given.items() if name in known
        }
        self.arguments = dataclasses.replace(Arguments(**values), envs=2, world="nominal", start="", out=out)
        self.training = training
        self.normalisation: VecNormalize = make_world(self.arguments)
        self.model = make_model(dataclasses.replace(self.arguments, batch=self.arguments.rollout), self.normalisation)
        content = (folder / NETWORK).read_bytes()
        self.sha256 = hashlib.sha256(content).hexdigest()
        stored = {one.name: numpy_helper.to_array(one) for one in onnx.load_from_string(content).graph.initializer}
        weights = self.model.policy.state_dict()
        weights |= {name: torch.tensor(value) for name, value in stored.items() if name in weights}
        self.model.policy.load_state_dict(weights)
        statistics = observed(self.normalisation)
        statistics.mean, statistics.count = stored["mean"].astype(np.float64), 1e12
        statistics.var = stored["deviation"].astype(np.float64) ** 2 - self.normalisation.epsilon
        self.steering = make_steering(self.arguments.vehicle, make_task(task_options(self.arguments)))
        self.actor = Actor(self.model.policy, self.normalisation, self.steering)


def make_agents(given: Improvement, base: Base, seed: int) -> EachAxle:
    """Return the wheelsets of vehicles drawn with a seed, under the conditions of the base's training."""
    options, classic = task_options(base.arguments), round(given.classic_share * given.envs)
    options["reward"] |= {"air": given.air_price * RewardWeights.stopping_distance}
    kind, price = base.training["arguments"].get("world", "varied"), base.arguments.slide_price
    parts = [
        part
        for law, count in (("recovering", given.envs - classic), ("classic", classic))
        if count
        for part in varied_parts(base.arguments.vehicle, count, law, options, price, seed, kind)
    ]
    return EachAxle(Joined(parts), base.steering, base.actor, price, given.gamma, shared=kind == "cleaning")


def make_ppo(given: Improvement, base: Base, agents: EachAxle) -> PPO:
    """Return PPO that shares the base's network."""
    return PPO(
        AxlePolicy,
        agents,
        n_steps=given.rollout,
        batch_size=max(1, agents.num_envs * given.rollout // given.batches),
        n_epochs=given.epochs,
        gamma=given.gamma**HELD,
        gae_lambda=given.gae_lambda,
        clip_range=given.clip,
        policy_kwargs={
            "policy": base.actor,
            "own": agents.own,
            "axles": agents.axles,
            "log_std_init": float(np.log(given.deviation)),
        },
        device="cpu",
    )


def network_of(model: PPO) -> list[torch.nn.Parameter]:
    """Return the parameters of the policy's network."""
    split: Any = model.policy.mlp_extractor
    return [*split.policy.mlp_extractor.policy_net.parameters(), *split.policy.action_net.parameters()]


def let_learn(model: PPO, policy: bool) -> None:
    """Let the policy's network learn or not; the value function always does."""
    for parameter in network_of(model):
        parameter.requires_grad = policy


class Practice:
    """PPO under way; `segments` goes on with it."""

    def __init__(self, given: Improvement, base: Base) -> None:
        self.given, self.base, own = given, base, base.arguments
        self.agents = make_agents(given, base, given.seed)
        self.model = make_ppo(given, base, self.agents)
        self.model.set_logger(base.model.logger)
        self.rate = given.learning_rate  # of the update under way
        self.model.lr_schedule = lambda _: self.rate
        self.count = max(1, round(given.updates / given.segment))
        task = make_task(task_options(own))
        self.watch = Watch(own.vehicle, task, own.slide_price, given.classic_share, given.watched, varied=True)
        self.done, self.curve = checkpoint.load(given.out / checkpoint.CHECKPOINT, self.model, base.normalisation)

    def segments(self) -> Iterator[None]:
        """Learn, segment by segment, with a look at the watched stops and a checkpoint after each."""
        given = self.given
        if not self.curve:
            self._look("imitation")
        each, last = self.agents.num_envs * given.rollout, self.count * given.segment
        for segment in range(self.done, self.count):
            begun, seed = time.perf_counter(), segment_seed(given.seed, segment + 1)
            set_random_seed(seed)
            self.agents.venv.seed(seed)
            self.model._last_obs = None  # `learn` then begins new stops
            for update in range(segment * given.segment, (segment + 1) * given.segment):
                self.rate = given.learning_rate * (1.0 - update / last)
                let_learn(self.model, update >= given.critic_updates)
                self.model.learn(each, callback=EndedStops(), reset_num_timesteps=update == 0)
            self.done = segment + 1
            self._look(f"PPO, {time.perf_counter() - begun:.0f} s")
            yield

    def _look(self, phase: str) -> None:
        """Watch the policy, report on it, write a checkpoint, and keep the policy if it is the best one so far."""
        taught = float(self.base.training["decisions"])
        own = float(self.model.num_timesteps * HELD // self.agents.axles)
        before = float(self.base.training.get("ppo_decisions", 0))
        row = {"decisions": taught + own, "ppo_decisions": before + own}
        self.curve.append(row | self.watch.look(self.base.actor))
        if self.curve[-1]["score"] == min(row["score"] for row in self.curve):
            checkpoint.save(self.given.out / checkpoint.BEST, self.model, self.base.normalisation, self.done, self.curve)
        checkpoint.save(self.given.out / checkpoint.CHECKPOINT, self.model, self.base.normalisation, self.done, self.curve)
        print(f"{phase}: {self.watch.words(self.curve)}", flush=True)


def gradient(model: PPO) -> np.ndarray:
    """Return the policy gradient (P,) of the rollout that the model holds."""
    let_learn(model, policy=True)
    buffer = model.rollout_buffer
    assert isinstance(buffer, RolloutBuffer)
    data = next(buffer.get(buffer.buffer_size * buffer.n_envs))
    _, log_probability, _ = model.policy.evaluate_actions(data.observations, data.actions)
    advantage = (data.advantages - data.advantages.mean()) / (data.advantages.std() + 1e-8)
    parts: Any = torch.autograd.grad(-(advantage * log_probability).mean(), network_of(model))
    return torch.cat([part.reshape(-1) for part in parts]).numpy().astype(np.float64)


def cosines(given: Improvement, base: Base) -> dict[str, float]:
    """Return the mean cosine between the gradients of independent rollouts, and the share of returns that is explained.

    The rollouts have other stops and another exploration, the vehicles are the same.
    """
    _begin(given)
    agents = make_agents(given, base, given.seed)
    model = make_ppo(given, base, agents)
    let_learn(model, policy=False)
    each, found = agents.num_envs * given.rollout, []
    agents.venv.seed(APART * 1000 * given.seed)
    model.learn(each * given.critic_updates)
    for number in range(given.cosine):
        torch.manual_seed(1000 * given.seed + number)
        agents.venv.seed(APART * (1000 * given.seed + 1 + number))
        model._last_obs = None  # new stops
        _, callback = model._setup_learn(each, None, False)
        model.collect_rollouts(model.env, callback, model.rollout_buffer, model.n_steps)  # type: ignore[arg-type]  # SB3: env may be None before learning
        found.append(gradient(model))
    buffer = model.rollout_buffer
    explained = 1.0 - np.var(buffer.returns - buffer.values) / np.var(buffer.returns)
    pairs = [a @ b / np.linalg.norm(a) / np.linalg.norm(b) for a, b in itertools.combinations(found, 2)]
    return {"cosine": float(np.mean(pairs)), "deviation": float(np.std(pairs)), "explained": float(explained)}


def improve(given: Improvement) -> Path:
    """Let PPO learn and export what had the best score; return the folder of the policy."""
    _begin(given)
    base = Base(given.base, given.out)
    settings.same_arguments(given)
    practice = Practice(given, base)
    columns = (BarColumn(10), TextColumn("{task.description}"), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns) as progress:
        bar = progress.add_task(practice.watch.briefly(practice.curve), total=practice.count, completed=practice.done)
        for _ in practice.segments():
            progress.update(bar, advance=1, description=practice.watch.briefly(practice.curve))
    write_curve(given.out / "curve.csv", practice.curve)
    _, curve = checkpoint.load(given.out / checkpoint.BEST, practice.model, base.normalisation)
    training = base.training | {name: int(curve[-1][name]) for name in ("decisions", "ppo_decisions")}
    training |= {"watched_score": curve[-1]["score"], "base_sha256": base.sha256, "improved": settings.record(given)}
    training["ran_on"] = {law: curve[-1][f"{law}_ran_on"] for law in ("recovering", "classic")}
    task, folder = make_task(task_options(base.arguments)), given.out / "policy"
    difference = export(base.model.policy, base.normalisation, base.actor, base.arguments.vehicle, task, folder, training)
    print(f"{folder}: score {curve[0]['score']:.4f} before, {curve[-1]['score']:.4f} after; ONNX agrees to {difference:.1g}")
    return folder


def _begin(given: Improvement) -> None:
    torch.set_num_threads(1)
    torch.distributions.Distribution.set_default_validate_args(False)  # twice as fast with small networks
    set_random_seed(segment_seed(given.seed, 0))


def check(given: Improvement) -> None:
    """Refuse arguments that cannot be before anything is written."""
    least = {"envs": 2, "updates": 1, "segment": 1, "rollout": 2, "epochs": 1, "batches": 1, "watched": 1}
    for name, lowest in least.items():
        if getattr(given, name) < lowest:
            raise SystemExit(f"--{name} {getattr(given, name)} is impossible: it must be at least {lowest}")
    for name in ("deviation", "learning_rate", "clip"):
        if not 0.0 < getattr(given, name) < np.inf:
            raise SystemExit(f"--{name.replace('_', '-')} {getattr(given, name):g} is impossible: it must be above 0")
    for name in ("classic_share", "gamma", "gae_lambda"):
        if not 0.0 <= getattr(given, name) <= 1.0:
            raise SystemExit(f"--{name.replace('_', '-')} {getattr(given, name):g} is impossible: it must lie in [0, 1]")
    if given.cosine == 1 or given.cosine < 0:
        raise SystemExit(f"--cosine {given.cosine} is impossible: two gradients at least are compared, or none with 0")
    if not (given.base / NETWORK).exists():
        raise SystemExit(
            f"--base {given.base} holds no {NETWORK}: give the folder of a policy, such as out/agents/bogie-1/policy"
        )


def main(given: Improvement) -> None:
    """Compare gradients or learn."""
    check(given)
    if not given.out.name:
        vehicle = load_policy(given.base).contract.vehicle
        given = dataclasses.replace(given, out=Path(f"out/agents/{vehicle}-ppo-{given.seed}"))
    if given.cosine:
        print(json.dumps(cosines(given, Base(given.base, given.out))))
    else:
        improve(given)


if __name__ == "__main__":
    main(tyro.cli(Improvement))
