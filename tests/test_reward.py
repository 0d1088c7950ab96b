"""The default reward: its optimum is a good stop at any discount, so that nobody is taught to release the brake."""

import gymnasium as gym
import numpy as np
import pytest

from wsp_env.envs.vector import BrakingVectorEnv
from wsp_env.evaluation.controller import load
from wsp_env.parameters.uic_z1 import VEHICLES

GAMMAS = (0.9, 0.97, 0.99, 0.999, 1.0)
STOPS = 6
INTERVAL_S = 0.05
HORIZON_S = 60.0


def returns(controller, **options):
    """Return the discounted returns (gammas, N) of the first stops, under a controller or a constant action."""
    options = {"control_interval_s": INTERVAL_S, "scenario": {"initial_speed": (15.0, 22.0)}} | options
    env = BrakingVectorEnv(STOPS, **options)
    env.reset(seed=3)
    constant = isinstance(controller, int | float)
    if not constant:
        controller.reset(STOPS, env.batch.vehicle)
    total, weight = np.zeros((len(GAMMAS), STOPS)), np.ones(len(GAMMAS))
    running = np.ones(STOPS, dtype=bool)
    for _ in range(int(HORIZON_S / INTERVAL_S)):
        if constant:
            action = np.full((STOPS, env.batch.vehicle.axles), controller)
        else:
            action = controller.act(env.batch.measurement()).astype(int) + 1
        _, reward, terminated, truncated, _ = env.step(action)
        total += weight[:, None] * np.where(running, reward, 0.0)
        weight *= GAMMAS
        running &= ~(terminated | truncated)
        if not running.any():
            break
    return total


@pytest.mark.parametrize("adhesion", ["recovering", "classic"])
def test_who_never_brakes_gets_less_than_who_brakes_whatever_the_discount(adhesion):
    released, rules = (returns(what, adhesion=adhesion) for what in (0, load("rule-based")))
    assert (released < rules).all()  # in every stop and at every discount
    by_pressure = {"adhesion": adhesion, "action": "pressure"}
    none, little = (returns(-1.0 + 2.0 * share, **by_pressure) for share in (0.0, 0.1))
    assert (none < little).all()  # so that the first steps of learning lead to the brake


def test_rules_are_worth_more_than_no_protection_on_slippery_rail():
    """Under the recovering law sliding cleans: the price of sliding alone speaks for a protection there."""
    slippery = {"mu_cd": (0.03, 0.05), "demand": (1.0, 1.0), "initial_speed": (15.0, 22.0)}
    none, rules = (returns(load(name), scenario=slippery)[-1] for name in ("none", "rule-based"))
    assert none.mean() < rules.mean()
    free = {"slip": 0.0, "large_slip": 0.0}
    none, rules = (returns(load(name), scenario=slippery, reward=free)[-1] for name in ("none", "rule-based"))
    assert none.mean() > rules.mean()


def test_a_dry_stop_with_full_brake_costs_what_the_brake_needs_to_build_up():
    weights = {"air": 0.0}
    total = returns(2, reward=weights, scenario={"initial_speed": (20.0, 20.0), "mu_cd": (0.2, 0.2), "demand": (1.0, 1.0)})[-1]
    brake = VEHICLES["bogie"].brake  # half of the rise is lost, and the cylinders' and the valves' time
    lost = (0.01 * 20.0 + 0.02) * (0.5 * brake.demand_rise_s + brake.fill_time_constant_s + brake.dead_time_s)
    assert (np.abs(total + lost) < 0.15 * lost).all()


def test_an_id_of_before_says_which_one_has_come_in_its_place():
    with pytest.warns(match="upgrading to version"), pytest.raises(gym.error.DeprecatedEnv, match="Bogie-v1"):
        gym.make("wsp_env/Bogie-v0")
