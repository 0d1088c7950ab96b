"""A first training: plain algorithms of Stable-Baselines3 on an environment with documented options.

`python -m agents.quickstart` trains PPO for half a minute of the processor, prints it beside the rules on held-out stops and
draws docs/first_training.png. `--algorithm recurrent` and `sac` train the others at the same budget of the processor's time.
The thirty lines that matter stand in docs/first_training.md.
"""

import copy
import dataclasses
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
import tyro
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecNormalize

from agents.measure import Yardstick, means
from wsp_env.envs.sb3 import BrakingVecEnv
from wsp_env.evaluation.controller import Controller, load
from wsp_env.evaluation.runner import Conduct
from wsp_env.observer.observation import Observer
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.port import TRACK_STEP_M, Measurement, Stop
from wsp_env.scenario import Scenario, draw

#: The agent asks for a pressure ten times a second, on rail that is slippery for full brake.
INTERVAL_S = 0.1
SCENARIO: dict[str, Any] = {"mu_cd": (0.02, 0.05), "demand": (1.0, 1.0)}
OPTIONS: dict[str, Any] = {"action": "pressure", "control_interval_s": INTERVAL_S, "scenario": SCENARIO}

#: Stops at once, and the discount.
ENVS, GAMMA = 64, 0.99

#: Seed of the stops by which a training is judged, and the described track [m].
JUDGED_BY, _TRACK_M = 8_000_009, 8000.0

#: What is asked for: metres travelled and as many for a metre slid, as in the default reward.
SLIDE_PRICE = 3.0

_SHOWN = ("distance_m", "mean_slip_mps", "slip_deviation_mps", "contact_energy_mj", "air_nl", "locked_s", "paid_m")


@dataclasses.dataclass(frozen=True)
class Arguments:
    """What is trained."""

    algorithm: Literal["ppo", "recurrent", "sac"] = "ppo"
    vehicle: Literal["wheelset", "bogie", "coach"] = "wheelset"
    adhesion: Literal["recovering", "classic"] = "recovering"
    decisions: int = 400_000
    ends: int = 0  # ends early, after so many decisions: the learning rate falls as if it went on; 0: it does not
    cpu_s: float = 0.0  # the training ends after so much time of the processor [s]; 0: after the decisions
    seed: int = 1
    every: int = 50_000  # decisions between two looks at the held-out stops
    stops: int = 32
    picture: Path = Path("docs/first_training.png")
    json: bool = False


class Learned:
    """A controller that asks a model of Stable-Baselines3; as deployed: measurements in, commands out."""

    action = "pressure"

    def __init__(self, model: BaseAlgorithm, normal: Callable[[np.ndarray], Any]) -> None:
        self.model, self.normal = model, normal

    def reset(self, n: int, vehicle: Vehicle) -> None:
        """Begin n new stops."""
        self._observer = Observer(vehicle, INTERVAL_S, by_pressure=True)
        self._command: np.ndarray | None = None
        self._memory: Any = None

    def act(self, measurement: Measurement) -> np.ndarray:
        """Return the pressures wanted (N, A), -1 none to +1 the demanded one."""
        before = self._command
        first = before is None
        seen = self._observer.reset(measurement) if before is None else self._observer.observe(measurement, before)
        begun = np.full(len(seen), first)
        self._command, self._memory = self.model.predict(self.normal(seen), self._memory, begun, deterministic=True)
        return self._command


def make(algorithm: str, env: VecNormalize, seed: int) -> BaseAlgorithm:
    """Return an algorithm with the settings of docs/first_training.md."""
    shared: dict[str, Any] = {"gamma": GAMMA, "seed": seed, "device": "cpu"}
    if algorithm == "sac":  # the best of four pilots of one seed; larger batches and fewer gradient steps learned less
        small: dict[str, Any] = {"policy_kwargs": {"net_arch": [64, 64]}, "batch_size": 256, "learning_starts": 1920}
        return SAC("MlpPolicy", env, learning_rate=2e-3, gradient_steps=16, **small, **shared)
    shared |= {"n_steps": 64, "batch_size": 1024, "n_epochs": 5, "learning_rate": lambda left: max(1e-3 * left, 5e-5)}
    networks: dict[str, Any] = {"net_arch": [64, 64], "log_std_init": -1.0}
    if algorithm == "recurrent":
        from sb3_contrib import RecurrentPPO

        return RecurrentPPO("MlpLstmPolicy", env, policy_kwargs=networks | {"lstm_hidden_size": 64}, **shared)
    return PPO("MlpPolicy", env, policy_kwargs=networks, **shared)


def held_out(vehicle: str, count: int, classic: bool) -> list[Stop]:
    """Draw stops as the environment of the training draws them, from a seed of their own."""
    kind, scenario = VEHICLES[vehicle], Scenario(**SCENARIO)
    nodes = int(_TRACK_M / TRACK_STEP_M) + 1
    return [draw(scenario, kind, np.random.default_rng([JUDGED_BY, i]), nodes, classic=classic) for i in range(count)]


class Judge:
    """Held-out stops, braked by anybody."""

    def __init__(self, arguments: Arguments) -> None:
        self.stops = held_out(arguments.vehicle, arguments.stops, arguments.adhesion == "classic")
        self.valves = Yardstick(arguments.vehicle, self.stops)
        self.learned = copy.copy(self.valves)
        self.learned.conduct = Conduct(INTERVAL_S)

    def means(self, controller: Controller) -> dict[str, float]:
        """Return the means of a controller's figures, and the metres travelled and paid for sliding."""
        own = means((self.learned if isinstance(controller, Learned) else self.valves).figures(controller))
        return own | {"paid_m": own["distance_m"] + SLIDE_PRICE * own["slide_distance_m"]}

    def rivals(self) -> dict[str, dict[str, float]]:
        """Return the figures of those who do not learn, by name."""
        found = {name: self.means(load(name)) for name in ("none", "rule-based", "adaptive")}
        return found | {"bound": {"distance_m": float(self.valves.top.shortest()[0].mean())}}


class Curve(BaseCallback):
    """Looks at the held-out stops from time to time; ends the training when its time of the processor is spent."""

    def __init__(self, judge: Judge, arguments: Arguments) -> None:
        super().__init__()
        self.judge, self.given, self.rows = judge, arguments, list[dict[str, float]]()
        self._looked = 0.0
        self._begun = time.process_time()

    @property
    def spent(self) -> float:
        """Time of the processor that the training took so far, the looks left out [s]."""
        return time.process_time() - self._begun - self._looked

    def look(self) -> None:
        """Judge the policy as it is."""
        begun, spent = time.process_time(), self.spent
        env = self.model.get_vec_normalize_env()
        assert env is not None
        found = self.judge.means(Learned(self.model, env.normalize_obs))
        self.rows.append({"decisions": float(self.num_timesteps), "cpu_s": spent} | found)
        self._looked += time.process_time() - begun
        print(_words(self.rows[-1]), file=sys.stderr if self.given.json else sys.stdout, flush=True)

    def _on_step(self) -> bool:
        if self.num_timesteps >= len(self.rows) * self.given.every:
            self.look()
        return not (0 < self.given.ends <= self.num_timesteps or 0.0 < self.given.cpu_s < self.spent)


def _words(row: dict[str, float]) -> str:
    return (
        f"{row['decisions']:.0f} decisions, {row['cpu_s']:.0f} s: {row['distance_m']:.0f} m, "
        f"slip {row['mean_slip_mps']:.2f} m/s, with its price {row['paid_m']:.0f} m"
    )


def train(arguments: Arguments, judge: Judge) -> tuple[Learned, list[dict[str, float]]]:
    """Train; return the controller and the curve."""
    name = f"wsp_env/{arguments.vehicle.title()}-v1"
    env = VecNormalize(BrakingVecEnv(name, ENVS, adhesion=arguments.adhesion, **OPTIONS), gamma=GAMMA)
    model = make(arguments.algorithm, env, arguments.seed)
    curve = Curve(judge, arguments)
    limit = arguments.decisions if arguments.cpu_s == 0.0 else 10**9
    if arguments.cpu_s > 0.0:  # a learning rate that falls does so with the time that is left
        falling = model.lr_schedule
        model.lr_schedule = lambda _: falling(max(1.0 - curve.spent / arguments.cpu_s, 0.0))
    model.learn(limit, callback=curve)
    if curve.num_timesteps - curve.rows[-1]["decisions"] > 0.5 * arguments.every or len(curve.rows) == 1:
        curve.look()
    return Learned(model, env.normalize_obs), curve.rows


def table(rivals: dict[str, dict[str, float]], last: dict[str, float], name: str) -> str:
    """Return the figures as a table in Markdown, in shares of the rules' ones."""
    lines = ["| | " + " | ".join(_SHOWN) + " |", "|:--|" + "--:|" * len(_SHOWN)]
    for who, row in (rivals | {name: last}).items():
        lines.append(f"| {who} | " + " | ".join(f"{row[figure]:.3g}" if figure in row else "" for figure in _SHOWN) + " |")
    return "\n".join(lines)


def draw_curve(rows: list[dict[str, float]], rivals: dict[str, dict[str, float]], path: Path) -> None:
    """Draw distance, slip and what both cost together over the decisions, with those who do not learn."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 3, figsize=(11.0, 3.4))
    decisions = [row["decisions"] / 1e6 for row in rows]
    labels = {
        "distance_m": "stopping distance [m]",
        "mean_slip_mps": "mean slip [m/s]",
        "paid_m": "metres travelled + 3 x metres slid",
    }
    for axis, (figure_name, label) in zip(axes, labels.items(), strict=True):
        axis.plot(decisions, [row[figure_name] for row in rows], marker=".", color="black", label="PPO")
        who_is = {"none": "no WSP", "rule-based": "default rules"}
        for (who, row), style in zip(rivals.items(), (":", "--", "-.", (0, (1, 4))), strict=True):
            if figure_name in row:
                axis.axhline(row[figure_name], linestyle=style, color="tab:blue", label=who_is.get(who, who))
        top = 1.4 * rivals["rule-based"][figure_name]
        axis.set_ylim(0.7 * rivals["rule-based"][figure_name] if figure_name != "mean_slip_mps" else 0.0, top)
        axis.set_title(label, fontsize=10)
        axis.set_xlabel("decisions [million]")
        axis.grid(alpha=0.3)
    axes[0].legend(frameon=False, fontsize=8)
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110, metadata={"Software": None})
    pyplot.close(figure)


def main(arguments: Arguments) -> None:
    """Train, print and draw."""
    torch.set_num_threads(1)  # small networks gain nothing by more
    judge = Judge(arguments)
    rivals = judge.rivals()
    _, rows = train(arguments, judge)
    print(json.dumps({"rivals": rivals, "curve": rows}) if arguments.json else table(rivals, rows[-1], arguments.algorithm))
    if arguments.algorithm == "ppo" and arguments.picture.name:
        draw_curve(rows, rivals, arguments.picture)


if __name__ == "__main__":
    main(tyro.cli(Arguments))
