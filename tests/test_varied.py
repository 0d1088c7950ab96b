"""The world in which brakes, gains, wear and noise are drawn: who brakes there, and what the learner sees of it."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from agents import drawn
from agents.drawn import NOISE, WORN
from agents.measure import low_adhesion
from agents.settings import Arguments, task_options
from agents.varied import NOMINAL, VEHICLES, Guarded, varied_parts
from agents.watch import LAWS, Watch
from agents.worlds import Joined
from wsp_env.envs.task import make_task
from wsp_env.evaluation.controller import load
from wsp_env.evaluation.policy import Policy, read_contract
from wsp_env.parameters.uic_z1 import BOGIE
from wsp_env.plant.command import to_action

SHIPPED = Path(__file__).parents[1] / "agents/trained/bogie"

OPTIONS = task_options(Arguments(torque_per_bar_nm=BOGIE.brake.torque_per_bar_nm))


@pytest.fixture(scope="module")
def parts():
    parts = varied_parts("bogie", 2 * VEHICLES, "recovering", OPTIONS, 4.3, 1)
    world = Joined(parts)
    world.seed(1)
    world.reset()
    return parts


def test_brakes_differ_and_some_vehicles_are_nominal(parts):
    brakes = [part.batch.vehicle.brake for part in parts]
    varied, nominal = brakes[: VEHICLES - NOMINAL], brakes[VEHICLES - NOMINAL :]
    assert len({brake.fill_time_constant_s for brake in varied}) == len(varied)
    assert len(nominal) == NOMINAL
    for brake in nominal:
        assert_allclose(brake.fill_time_constant_s, BOGIE.brake.fill_time_constant_s)
    for part in parts:
        assert part.batch.observer.vehicle.brake.fill_time_constant_s == BOGIE.brake.fill_time_constant_s


def test_one_wheelset_of_a_drawn_vehicle_is_worn_and_its_sensors_are_noisier(parts):
    given = [part.batch.plant.conditions for part in parts]
    for own in given[: VEHICLES - NOMINAL]:
        ratio = own.radius / BOGIE.wheel_radius_m
        assert (ratio == ratio[0]).all()
        assert (ratio != 1.0).sum() == len(ratio)  # of one axle
        assert 1.0 - max(WORN) - 0.003 < ratio.min() < 1.003
    noise = np.concatenate([own.noise for own in given[: VEHICLES - NOMINAL]])
    assert 0.2 < noise.max() <= NOISE
    sound = np.concatenate([own.radius for own in given[VEHICLES - NOMINAL :]])
    assert_array_equal(sound, BOGIE.wheel_radius_m)


def test_the_learner_sees_what_the_deployed_policy_does(parts):
    """Whatever is commanded, observations and executed commands are those of a policy that runs with its guard."""
    rng, seen, wishes = np.random.default_rng(2), [], []
    for part in (parts[0], parts[-1]):
        part.seed(5)
        observed = [part.reset()]
        batch = part.batch

        def infer(observation, memory, seen=seen, wishes=wishes):
            seen.append(observation.copy())
            return wishes[-1], memory

        policy = Policy(read_contract(SHIPPED), infer)
        policy.reset(part.num_envs, BOGIE)
        for _ in range(300):
            wishes.append(rng.choice([-1.0, 0.0, 1.0], p=[0.1, 0.3, 0.6], size=(part.num_envs, 2)))
            executed = policy.act(batch.measurement())
            assert_array_equal(seen[-1], observed[-1])
            assert_array_equal(executed + 1.0, part.final(to_action(wishes[-1])))
            observed.append(part.venv.step(to_action(executed))[0])


def test_a_stop_that_begins_anew_forgets_what_its_guard_found(parts):
    part = parts[0]
    part.seed(3)
    part.reset()
    observer, batch = part.batch.observer, part.batch
    assert isinstance(observer, Guarded)
    for _ in range(50):
        part.step(to_action(np.ones((part.num_envs, 2))))
    doubts = observer.guard.doubts
    doubts.failed[:, 0] = True
    before = [field.copy() for field in doubts]
    mask = np.array([True] + [False] * (part.num_envs - 1))
    observer.reset(batch.measurement(), mask)
    assert not doubts.failed[0].any()
    assert observer.estimate.trusted[0].all()
    for field, old in zip(doubts, before, strict=True):
        assert_array_equal(field[1:], old[1:])


@pytest.mark.long
def test_a_varied_training_is_watched_on_drawn_vehicles_too(monkeypatch):
    def slow(*given):  # soon over
        return [dataclasses.replace(stop, initial_speed=8.0) for stop in low_adhesion(*given)]

    monkeypatch.setattr(drawn, "low_adhesion", slow)
    task = make_task(OPTIONS)
    nominal, varied = (Watch("bogie", task, 4.3, 0.25, 2, varied) for varied in (False, True))
    assert len(nominal.parts) == 1
    assert len(varied.parts) == 1 + 2 + 2  # two stops of each law on two vehicles in each of the drawn worlds
    assert {law: int(rows.sum()) for law, rows in varied.rows.items()} == dict.fromkeys(LAWS, 6)
    rules = varied.means(load("rule-based"))
    assert rules == varied.rules
    assert varied.score(rules) == 1.0
