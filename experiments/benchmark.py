"""How fast the law, the plant and the environments are, as ratios measured in one run.

    python experiments/benchmark.py [--quick] [--json]

The machine may be busy with other work: times are the process's own, what is compared runs in turns, every figure is the
median of the rounds and a ratio the median of the rounds' ratios. Everything runs on one core. CartPole is Gymnasium's
`make_vec("CartPole-v1", vectorization_mode="sync")`; its cost is that of a step of all N environments, as is the plant's: one
control interval of 20 ms with all its substeps. By `gym.make`, both are single environments in Gymnasium's wrappers.
"""

import copy
import dataclasses
import json
import math
import statistics
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, cast

import gymnasium as gym
import numpy as np
import tyro
from rich.console import Console
from rich.table import Table
from scipy.optimize import brentq

from experiments.exported import compiler, exported
from wsp_env.contact.degraded import adhesion_recovered, adhesion_without_recovery, degraded_adhesion
from wsp_env.contact.fastsim import fastsim_force
from wsp_env.contact.kalker import Patch, kalker_coefficients
from wsp_env.contact.polach import polach_adhesion
from wsp_env.envs import IDS
from wsp_env.envs.vector import BrakingVectorEnv
from wsp_env.evaluation.policy import load_policy
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.parameters.velim import CONTACT
from wsp_env.plant import make_plant
from wsp_env.plant.longitudinal.plant import LongitudinalPlant
from wsp_env.plant.longitudinal.state import SUBSTEP_S
from wsp_env.plant.port import Plant, Setup
from wsp_env.scenario import Scenario, draw

SIZES = (1, 64, 1024, 8192)
QUICK_SIZES = (1, 64)
CONTACTS = 8192
BY_ROOT_FINDER = 200
TRACK_NODES = 801
AT_MOST = (("Bogie-v1 by gym.make", 1, 12.0), ("Bogie-v1", 1, 4.0), ("Bogie-v1", 1024, 0.12))  # times CartPole, by batch size
MOST_IN_SPACE, IN_SPACE = 64, "coach, multibody"  # batches of more take minutes
FASTEST = {1: 10.0, 64: 15.0}  # times real time that the multibody coach is to reach, by batch size, on one core
WARM_UP_S = 3.0  # of the stops before they are timed: brakes on, wheels sliding


@dataclasses.dataclass(frozen=True)
class Goal:
    """A figure that the project wants to reach."""

    what: str
    measured: float
    goal: float
    at_least: bool

    @property
    def met(self) -> bool:
        """Whether the measured figure reaches the goal."""
        return self.measured >= self.goal if self.at_least else self.measured <= self.goal


def in_turns(runs: Mapping[str, Callable[[], int]], rounds: int, seconds: float) -> dict[str, np.ndarray]:
    """Time the runs in turns; return the seconds per unit of work in every round (rounds,).

    A run returns how many units it did; it is repeated for about `seconds` in each round.
    """
    repeats = {}
    for name, run in runs.items():
        run()  # compiles
        start = time.process_time()
        run()
        repeats[name] = max(1, math.ceil(seconds / max(time.process_time() - start, 1e-7)))
    taken: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(rounds):
        for name, run in runs.items():
            units = 0
            start = time.process_time()
            for _ in range(repeats[name]):
                units += run()
            taken[name].append((time.process_time() - start) / units)
    return {name: np.array(values) for name, values in taken.items()}


def ratio(of: np.ndarray, to: np.ndarray) -> float:
    """Median of the rounds' ratios."""
    return float(np.median(of / to))


# --- the law ----------------------------------------------------------------------------------------------------------


def contact_runs() -> dict[str, Callable[[], int]]:
    """Evaluate contacts drawn over the whole range of use by the closed form, a root-finder, Polach and FASTSIM."""
    rng = np.random.default_rng(1)
    creepage, speed = rng.uniform(0.0, 1.0, CONTACTS), rng.uniform(0.1, 60.0, CONTACTS)
    load, mu_cd, tau = rng.uniform(20e3, 120e3, CONTACTS), rng.uniform(0.01, 0.15, CONTACTS), rng.uniform(0.0, 1e-3, CONTACTS)
    slip, law = creepage * speed, CONTACT.law
    states = (slip, speed, load, mu_cd, tau, law)
    samples = np.stack([creepage, slip, load, mu_cd, tau], axis=1)[:BY_ROOT_FINDER].tolist()
    limits = adhesion_without_recovery(*states), adhesion_recovered(*states)
    given = np.stack([*limits, tau * load * creepage], axis=1)[:BY_ROOT_FINDER].tolist()
    coefficients = (float(c) for c in kalker_coefficients(CONTACT.semi_axis_a_m / CONTACT.semi_axis_b_m, 0.25))
    patch = Patch(CONTACT.semi_axis_a_m, CONTACT.semi_axis_b_m, CONTACT.shear_modulus_pa, *coefficients)

    def root(f_d: float, f_r: float, a: float) -> float:
        gap = f_r - f_d
        return brentq(lambda f: f - f_r + gap * math.exp(-a * f), f_d - 1e-9, f_r + 1e-9)

    def closed_form() -> int:
        degraded_adhesion(*states)
        return CONTACTS

    def root_finder() -> int:
        for f_d, f_r, a in given:
            root(f_d, f_r, a)
        return BY_ROOT_FINDER

    def root_finder_and_limits() -> int:
        for e, s, n, mu, t in samples:
            f_d = float(polach_adhesion(e, s, n, law.stiffness, mu, law.ratio_d, law.gamma_d, law.k_ad, law.k_sd))
            f_r = float(polach_adhesion(e, s, n, law.stiffness, law.mu_cr, law.ratio_r, law.gamma_r, law.k_ar, law.k_sr))
            root(f_d, f_r, t * n * e)
        return BY_ROOT_FINDER

    def polach() -> int:
        polach_adhesion(creepage, slip, load, law.stiffness, mu_cd, law.ratio_d, law.gamma_d, law.k_ad, law.k_sd)
        return CONTACTS

    def fastsim() -> int:
        few = slice(BY_ROOT_FINDER)
        fastsim_force(creepage[few], 0.0, 0.0, load[few], mu_cd[few], patch)
        return BY_ROOT_FINDER

    return {
        "closed form": closed_form,
        "brentq and the limits": root_finder_and_limits,
        "brentq alone": root_finder,
        "Polach": polach,
        "FASTSIM": fastsim,
    }


# --- plant and environments -------------------------------------------------------------------------------------------


def changing(plant: Plant) -> list[np.ndarray]:
    """Return the arrays of a plant that a step changes."""

    def arrays(state: Any) -> list[np.ndarray]:
        return [array for part in state for array in (arrays(part) if isinstance(part, tuple) else [part])]

    return [*arrays(cast(LongitudinalPlant, plant).state), *getattr(plant, "bodies", ()), plant.moving]


def plant_run(name: str, n: int, steps: int, kind: str = "longitudinal") -> Callable[[], int]:
    """Step a batch of sliding stops under changing valve commands, from the same state every time."""
    vehicle = VEHICLES[name]
    rng = np.random.default_rng(1)
    plant = make_plant(vehicle, n, Setup(track_nodes=TRACK_NODES), kind)
    scenario = Scenario(mu_cd=(0.02, 0.06), demand=(0.7, 1.0), initial_speed=(25.0, 44.5))
    stops = [draw(scenario, vehicle, rng, TRACK_NODES) for _ in range(min(n, 64))]
    for i in range(n):
        plant.start(i, stops[i % len(stops)])
    for _ in range(round(WARM_UP_S / plant.setup.control_interval_s)):
        plant.step(np.ones((n, vehicle.axles)))
    whole = copy.deepcopy(plant)
    commands = [rng.choice([-1.0, 0.0, 1.0, 1.0], size=(n, vehicle.axles)) for _ in range(10)]

    def run() -> int:
        for array, first in zip(changing(plant), changing(whole), strict=True):
            array[...] = first
        for step in range(steps):
            plant.step(commands[step // 10 % 10])
        return steps

    return run


def env_run(env: gym.vector.VectorEnv[Any, Any, Any], steps: int) -> Callable[[], int]:
    """Step a vector environment under one batch of random actions."""
    env.reset(seed=1)
    env.action_space.seed(1)
    actions = [env.action_space.sample() for _ in range(8)]

    def run() -> int:
        for step in range(steps):
            env.step(actions[step % 8])
        return steps

    return run


def single_run(env_id: str, steps: int) -> Callable[[], int]:
    """Step an environment of `gym.make` under random actions, through the ends of its episodes."""
    env = gym.make(env_id)
    env.reset(seed=1)
    env.action_space.seed(1)
    actions = [env.action_space.sample() for _ in range(8)]

    def run() -> int:
        for step in range(steps):
            _, _, terminated, truncated, _ = env.step(actions[step % 8])
            if terminated or truncated:
                env.reset()
        return steps

    return run


def step_runs(n: int) -> dict[str, Callable[[], int]]:
    """Return steps of a batch of n: the plant of each vehicle, the bogie's environment, CartPole."""
    steps = max(3, min(50, 20_000 // n))
    runs: dict[str, Callable[[], int]] = {name: plant_run(name, n, steps) for name in VEHICLES}
    if n <= MOST_IN_SPACE:
        runs[IN_SPACE] = plant_run("coach", n, steps, "multibody")
    runs["Bogie-v1"] = env_run(BrakingVectorEnv(n, IDS["wsp_env/Bogie-v1"]), steps)
    runs["CartPole"] = env_run(gym.make_vec("CartPole-v1", num_envs=n, vectorization_mode="sync"), steps)
    return runs


def single_runs() -> dict[str, Callable[[], int]]:
    """Return steps of single environments as `gym.make` makes them."""
    return {"Bogie-v1 by gym.make": single_run("wsp_env/Bogie-v1", 50), "CartPole": single_run("CartPole-v1", 50)}


def decision_run() -> Callable[[], int]:
    """Ask the shipped bogie policy's network for the command of one vehicle."""
    policy = load_policy(Path(__file__).parents[1] / "agents" / "trained" / "bogie")
    observation, memory = np.zeros((1, len(policy.contract.observation)), dtype=np.float32), np.zeros((1, 0), dtype=np.float32)

    def run() -> int:
        for _ in range(100):
            policy.infer(observation, memory)
        return 100

    return run


# --- C beside numba ---------------------------------------------------------------------------------------------------


def exported_rows(rounds: int, seconds: float) -> list[dict[str, Any]]:
    """Return size and cost of the exported C beside the Python it was made from; nothing without a C compiler."""
    if compiler() is None:
        return []
    with tempfile.TemporaryDirectory() as folder:
        rows = []
        for one in exported(Path(folder)):
            times = in_turns({"C": one.in_c, "Python": one.by_numba}, rounds, seconds)
            c_s, python_s = (statistics.median(times[name].tolist()) for name in ("C", "Python"))
            sizes = {name: getattr(one, name) for name in ("lines", "object_bytes", "remembered_bytes")}
            rows.append({"what": one.what, "c_s": c_s, "python_s": python_s, **sizes})
    return rows


# --- the report -------------------------------------------------------------------------------------------------------


def measure(quick: bool) -> dict[str, Any]:
    """Return all figures: seconds per contact and per step, ratios and goals."""
    rounds, seconds = (5, 0.02) if quick else (15, 0.05)
    contact = in_turns(contact_runs(), rounds, seconds)
    law = contact["closed form"]
    goals = [
        Goal("a contact by the closed form, batched [ns]", 1e9 * float(np.median(law)), 25.0, False),
        Goal("brentq and limits per sample / closed form, batched", ratio(contact["brentq and the limits"], law), 200.0, True),
        Goal("closed form / one Polach evaluation", ratio(law, contact["Polach"]), 3.0, False),
    ]
    decision = 1e6 * float(np.median(in_turns({"decision": decision_run()}, rounds, seconds)["decision"]))
    goals.append(Goal("a decision of the bogie's ONNX policy for one vehicle [us]", decision, 50.0, False))
    rows = []
    sizes = QUICK_SIZES if quick else SIZES
    for n, runs in ((1, single_runs()), *((n, step_runs(n)) for n in sizes)):
        times = in_turns(runs, rounds, seconds)
        medians = {name: statistics.median(values.tolist()) for name, values in times.items()}
        shares = {name: ratio(values, times["CartPole"]) for name, values in times.items()}
        rows += [
            {"n": n, "what": name, "step_s": medians[name], "steps_per_s": n / medians[name], "to_cartpole": shares[name]}
            for name in times
        ]
        for name, size, most in AT_MOST:
            if n == size and name in shares:
                goals.append(Goal(f"{name} / CartPole, N = {n}", shares[name], most, False))
        if IN_SPACE in medians:
            share = n * Setup().control_interval_s / medians[IN_SPACE]
            goals.append(Goal(f"{IN_SPACE}, simulated seconds a second, N = {n}", share, FASTEST[n], True))
        if n >= 64:
            goals.append(Goal(f"bogie step / CartPole step, N = {n}", shares["bogie"], 0.5, False))
            interval = Setup().control_interval_s
            goals.append(Goal(f"coach, simulated seconds a second, N = {n}", n * interval / medians["coach"], 2000.0, True))
    return {
        "substep_s": SUBSTEP_S,
        "contact_s": {name: statistics.median(values.tolist()) for name, values in contact.items()},
        "closed_form_to_fastsim": ratio(law, contact["FASTSIM"]),
        "steps": rows,
        "exported": exported_rows(rounds, seconds),
        "goals": [dataclasses.asdict(goal) | {"met": goal.met} for goal in goals],
    }


def print_tables(result: Mapping[str, Any]) -> None:
    """Print the figures as aligned tables."""
    console = Console(width=100, markup=False)  # a unit in brackets is no markup
    law = result["contact_s"]["closed form"]
    table = Table(title="Adhesion of one contact", title_justify="left")
    table.add_column("by")
    table.add_column("time [ns]", justify="right")
    table.add_column("to the closed form", justify="right")
    for name, seconds in result["contact_s"].items():
        table.add_row(name, f"{1e9 * seconds:.1f}", f"{seconds / law:.3g}")
    console.print(table)
    table = Table(title=f"One step of N, substep {1e3 * result['substep_s']:g} ms", title_justify="left")
    table.add_column("N", justify="right")
    table.add_column("of")
    for heading in ("time [us]", "steps a second", "to CartPole"):
        table.add_column(heading, justify="right")
    for row in result["steps"]:
        last = row["what"] == "CartPole"
        figures = f"{1e6 * row['step_s']:.1f}", f"{row['steps_per_s']:.3g}", f"{row['to_cartpole']:.3f}"
        table.add_row(str(row["n"]), row["what"], *figures, end_section=last)
    console.print(table)
    if result["exported"]:
        table = Table(title="Exported C beside the Python it is made from (numba; the rules: numpy)", title_justify="left")
        table.add_column("unit")
        for heading in ("C [us]", "Python [us]", "lines of C", "object [kB]", "instance [B]"):
            table.add_column(heading, justify="right")
        for row in result["exported"]:
            sizes = f"{row['lines']}", f"{row['object_bytes'] / 1000:.0f}", f"{row['remembered_bytes']}"
            table.add_row(row["what"], f"{1e6 * row['c_s']:.3g}", f"{1e6 * row['python_s']:.3g}", *sizes)
        console.print(table)
    table = Table(title="Goals", title_justify="left")
    table.add_column("figure")
    for heading in ("measured", "goal", "met"):
        table.add_column(heading, justify="right")
    for goal in result["goals"]:
        bound = f"{'>=' if goal['at_least'] else '<='} {goal['goal']:g}"
        table.add_row(goal["what"], f"{goal['measured']:.3g}", bound, "yes" if goal["met"] else "no")
    console.print(table)


def main(
    quick: tyro.conf.FlagCreatePairsOff[bool] = False,
    as_json: Annotated[bool, tyro.conf.arg(name="json"), tyro.conf.FlagCreatePairsOff] = False,
) -> None:
    """Print the benchmarks.

    Parameters
    ----------
    quick
        Fewer and shorter rounds, batches of 1 and 64 only.
    as_json
        Print JSON instead of tables.

    """
    result = measure(quick)
    if as_json:
        print(json.dumps(result))
    else:
        print_tables(result)


if __name__ == "__main__":
    tyro.cli(main)
