"""Train a wheel slide protection by imitation and PPO: `python -m agents.train --vehicle bogie --seed 1`.

Started again after a kill it goes on. The training is cut into segments. Each begins with new stops and with random numbers
that follow from the seed and the segment's number alone, and ends with a checkpoint: a run that was killed and started again
ends with the weights of one that was not.
"""

import csv
import dataclasses
import time
from collections import deque
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from sb3_contrib import RecurrentPPO
from sb3_contrib.common.recurrent.policies import RecurrentActorCriticPolicy
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.utils import set_random_seed
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from agents import checkpoint
from agents.export import Actor, ExportedPolicy, export
from agents.imitation import imitate
from agents.recurrent import RecurrentActor
from agents.settings import Arguments, check, record, same_arguments, task_options
from agents.steering import Steered, make_steering
from agents.varied import varied_parts
from agents.watch import Watch
from agents.worlds import Joined, Shaped, Stopped, observed
from wsp_env.envs.sb3 import BrakingVecEnv
from wsp_env.envs.task import make_task

#: Threads of torch: a fixed number sums in one order and gives the same weights wherever there are so many cores.
THREADS = 2

#: Rounds of the imitation between two looks at the watched stops.
LOOKS = 5


class EndedStops(BaseCallback):
    """TensorBoard: what the stops that ended in a rollout were like, in physical units."""

    def __init__(self) -> None:
        super().__init__()
        self.stops: deque[Stopped] = deque(maxlen=100)

    def _on_step(self) -> bool:
        self.stops.extend(info["stopped"] for info in self.locals["infos"] if info)
        return True

    def _on_rollout_end(self) -> None:
        if self.stops:
            for field in dataclasses.fields(Stopped):
                self.logger.record(f"stop/{field.name}", float(np.mean([getattr(stop, field.name) for stop in self.stops])))


def make_world(arguments: Arguments) -> VecNormalize:
    """Return the environments: some under the classic law, the others under the recovering one; normalised."""
    options = task_options(arguments)
    classic = round(arguments.classic_share * arguments.envs)
    parts = []
    for law, count in (("recovering", arguments.envs - classic), ("classic", classic)):
        if count and arguments.world != "nominal":
            parts += varied_parts(
                arguments.vehicle, count, law, options, arguments.slide_price, arguments.seed, arguments.world
            )
        elif count:
            env = BrakingVecEnv(f"wsp_env/{arguments.vehicle.title()}-v1", count, adhesion=law, **options)
            parts.append(Shaped(env, arguments.slide_price))
    world: VecEnv = Joined(parts)
    if arguments.action == "steered":
        world = Steered(world, make_steering(arguments.vehicle, make_task(options)))
    return VecNormalize(world, gamma=arguments.gamma)


def make_model(arguments: Arguments, world: VecNormalize) -> OnPolicyAlgorithm:
    """Return a model that has learned nothing yet."""
    networks: dict[str, Any] = {
        "net_arch": {"pi": list(arguments.hidden), "vf": list(arguments.critic)},
        "log_std_init": arguments.log_deviation,
    }
    kind: type[PPO | RecurrentPPO] = RecurrentPPO if arguments.recurrent else PPO
    if arguments.recurrent:
        networks["lstm_hidden_size"] = arguments.recurrent
    model = kind(
        "MlpLstmPolicy" if arguments.recurrent else "MlpPolicy",
        world,
        n_steps=arguments.rollout,
        batch_size=arguments.batch,
        n_epochs=arguments.epochs,
        gamma=arguments.gamma,
        gae_lambda=arguments.gae_lambda,
        clip_range=arguments.clip,
        ent_coef=arguments.entropy,
        policy_kwargs=networks,
        device="cpu",
    )
    model.lr_schedule = lambda _: arguments.learning_rate * max(0.0, 1.0 - model.num_timesteps / arguments.steps)
    model.set_logger(configure(str(arguments.out), ["tensorboard"]))
    return model


def actor(arguments: Arguments, model: OnPolicyAlgorithm, world: VecNormalize) -> ExportedPolicy:
    """Return what is exported of a model."""
    steered = arguments.action == "steered"
    steering = make_steering(arguments.vehicle, make_task(task_options(arguments))) if steered else None
    if isinstance(model.policy, RecurrentActorCriticPolicy):
        return RecurrentActor(model.policy, world, steering)
    return Actor(model.policy, world, steering)


def learns(model: OnPolicyAlgorithm, policy: bool) -> None:
    """Let the policy's own network learn or not; the value function always does."""
    own: list[torch.nn.Module] = [model.policy.mlp_extractor.policy_net, model.policy.action_net]
    own += [model.policy.lstm_actor] if isinstance(model.policy, RecurrentActorCriticPolicy) else []
    parameters = [parameter for part in own for parameter in part.parameters()]
    parameters += [model.policy.log_std] if hasattr(model.policy, "log_std") else []
    for parameter in parameters:
        parameter.requires_grad = policy


def begin_from(folder: Path, model: OnPolicyAlgorithm, world: VecNormalize) -> None:
    """Take over weights, optimiser and normalisation of another run, but not its count of steps."""
    checkpoint.load(folder / checkpoint.CHECKPOINT, model, world)
    model.num_timesteps = model._n_updates = 0


def segment_seed(seed: int, segment: int) -> int:
    """Return the seed of everything random in a segment."""
    return int(np.random.SeedSequence([seed, segment]).generate_state(1)[0] >> 1)


def train(arguments: Arguments) -> tuple[OnPolicyAlgorithm, VecNormalize]:
    """Train, from the folder's last checkpoint if it has one; return model and normalisation."""
    torch.distributions.Distribution.set_default_validate_args(False)  # twice as fast with small networks
    if arguments.imitation and arguments.action != "steered":
        raise SystemExit("the teacher says which pressures it wants: --imitation 0, or --action steered")
    check(arguments)
    arguments.out.mkdir(parents=True, exist_ok=True)
    same_arguments(arguments)
    run = Training(arguments)
    columns = (BarColumn(10), TextColumn("{task.description}"), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns) as progress:
        bar = progress.add_task(run.watch.briefly(run.curve), total=run.rounds + run.segments, completed=run.done)
        for _ in chain(run.imitate(), run.practise()):
            progress.update(bar, advance=1, description=run.watch.briefly(run.curve))
    write_curve(arguments.out / "curve.csv", run.curve)
    return run.model, run.world


class Training:
    """A training under way: `imitate` and `practise` go on with it step by step."""

    def __init__(self, arguments: Arguments) -> None:
        torch.set_num_threads(THREADS)
        set_random_seed(segment_seed(arguments.seed, 0))
        self.arguments = arguments
        self.world = make_world(arguments)
        self.model = make_model(arguments, self.world)
        self.folder = arguments.out
        if arguments.start and not (self.folder / checkpoint.CHECKPOINT).exists():
            begin_from(Path(arguments.start), self.model, self.world)
        self.done, self.curve = checkpoint.load(self.folder / checkpoint.CHECKPOINT, self.model, self.world)
        self.rounds = arguments.imitation if self.done == 0 and not arguments.start else 0  # of the imitation, still to come
        self.taught = 0 if arguments.start else arguments.imitation - self.rounds  # and those behind
        self.lessons = 0 if arguments.start else arguments.imitation * arguments.imitation_decisions * arguments.envs
        self.segments = max(1, round(arguments.steps / (arguments.envs * arguments.rollout * arguments.segment)))
        task = make_task(task_options(arguments))
        self.watch = Watch(
            arguments.vehicle,
            task,
            arguments.slide_price,
            arguments.classic_share,
            arguments.watched,
            arguments.world != "nominal",
        )

    def imitate(self) -> Iterator[None]:
        """Learn from the teacher, round by round; a run that was killed meanwhile begins anew."""
        if not self.rounds:
            return
        torch.set_num_threads(1)  # its small batches gain nothing by more
        given, begun = self.arguments, time.perf_counter()
        self.world.seed(segment_seed(given.seed, 0))
        lessons = imitate(
            self.model, self.world, given.slide_price, self.rounds, given.imitation_decisions, given.imitation_thin
        )
        for difference in lessons:
            self.taught += 1
            if self.taught % LOOKS == 0 or self.taught == given.imitation:
                rate = self.decisions / (time.perf_counter() - begun)
                self._look(f"imitation, mean squared difference to the teacher {difference:.3f}", rate, 0)
            yield
        if warning := self.watch.runs_on(self.curve[-1]):
            print(f"{warning}. Give the imitation more rounds (--imitation, now {given.imitation}).", flush=True)
        observed(self.world).count = 1e12  # what was learned is not moved by it any more

    def practise(self) -> Iterator[None]:
        """Learn by PPO, segment by segment, with a checkpoint after each."""
        torch.set_num_threads(THREADS)
        given = self.arguments
        update = given.envs * given.rollout * given.segment
        for segment in range(self.done, self.segments):
            begun = time.perf_counter()
            seed = segment_seed(given.seed, segment + 1)
            set_random_seed(seed)
            self.world.seed(seed)
            learns(self.model, segment >= given.critic_segments)
            self.model._last_obs = None  # `learn` then begins new stops
            self.model.learn(update, callback=EndedStops(), reset_num_timesteps=False)
            self._look("PPO", update / (time.perf_counter() - begun), segment + 1)
            checkpoint.save(self.folder / checkpoint.CHECKPOINT, self.model, self.world, segment + 1, self.curve)
            yield

    @property
    def decisions(self) -> int:
        """Decisions so far, those of the imitation and those of PPO."""
        return self.taught * self.arguments.imitation_decisions * self.arguments.envs + self.model.num_timesteps

    def _look(self, phase: str, rate: float, segment: int) -> None:
        """Watch the policy, report on it, and keep it if it is the best since the whole imitation."""
        self.model.logger.dump(self.model.num_timesteps)  # what PPO has reported, over its own decisions
        row = {"decisions": float(self.decisions), "ppo_decisions": float(self.model.num_timesteps)}
        self.curve.append(row | self.watch.look(actor(self.arguments, self.model, self.world)))
        for name, value in self.curve[-1].items():
            self.model.logger.record(f"watched/{name}", value)
        self.model.logger.record("time/steps_per_second", rate)
        self.model.logger.dump(self.decisions)
        ready = [row["score"] for row in self.curve if row["decisions"] >= self.lessons]
        if ready and self.curve[-1]["score"] == min(ready):
            checkpoint.save(self.folder / checkpoint.BEST, self.model, self.world, segment, self.curve)
        print(f"{phase}: {self.decisions} decisions, {rate:.0f} a second, {self.watch.words(self.curve)}", flush=True)


def write_curve(path: Path, curve: list[dict[str, float]]) -> None:
    """Write the looks at the watched stops as a table."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(curve[0]))
        writer.writeheader()
        writer.writerows({name: f"{value:.6g}" for name, value in row.items()} for row in curve)


def main(arguments: Arguments) -> None:
    """Train and export to `policy/` in the run's folder what had the best score on the watched stops after the imitation."""
    if not arguments.out.name:
        arguments = dataclasses.replace(arguments, out=Path(f"out/agents/{arguments.vehicle}-{arguments.seed}"))
    model, world = train(arguments)
    _, curve = checkpoint.load(arguments.out / checkpoint.BEST, model, world)
    training: dict[str, Any] = {"arguments": record(arguments), "torch": torch.__version__.partition("+")[0]}
    training |= {name: int(curve[-1][name]) for name in ("decisions", "ppo_decisions")} | {"watched_score": curve[-1]["score"]}
    training["ran_on"] = {law: curve[-1][f"{law}_ran_on"] for law in ("recovering", "classic")}
    difference = export(
        model.policy, world, actor(arguments, model, world), arguments.vehicle, make_task(task_options(arguments)),
        arguments.out / "policy", training,
    )  # fmt: skip
    print(f"{arguments.out / 'policy'}: the ONNX network agrees with the trained one to {difference:.1g}")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
