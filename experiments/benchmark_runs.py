"""What `experiments/benchmark.py` times: contacts, steps of plants and environments, decisions of a policy."""

import copy
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import gymnasium as gym
import numpy as np
from scipy.optimize import brentq

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
from wsp_env.plant.port import Plant, Setup
from wsp_env.scenario import Scenario, draw

CONTACTS = 8192
BY_ROOT_FINDER = 200
TRACK_NODES = 801
MOST_IN_SPACE, IN_SPACE = 64, "coach, multibody"  # batches of more take minutes
WARM_UP_S = 3.0  # of the stops before they are timed: brakes on, wheels sliding


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
