"""PPO on top of an imitation: drawn vehicles, held residuals, the privileged value function, gradients."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal

import agents.improve
from agents.improve import NOISY, Improvement, cosines, make_held, make_model, marks, stops_of
from wsp_env.parameters.uic_z1 import BOGIE
from wsp_env.plant.command import to_action

SMALL = Improvement(
    base=Path(__file__).parents[1] / "agents/trained/bogie", envs=8, rollout_s=0.32, cosine=3, critic_updates=1, held=4
)


@pytest.fixture(scope="module")
def world():
    world = make_held(SMALL, SMALL.envs, 1)
    world.reset()
    return world


def test_vehicles_differ_and_the_observer_believes_the_nominal_one(world):
    brakes = [part.batch.vehicle.brake for part in world.parts]
    assert len({brake.fill_time_constant_s for brake in brakes}) == len(brakes)
    for part in world.parts:
        assert part.batch.observer.vehicle.brake.fill_time_constant_s == BOGIE.brake.fill_time_constant_s
    noise = np.concatenate([part.batch.plant.conditions.noise for part in world.parts])
    assert noise.max() > 0.1


def test_in_the_noisy_world_the_vehicle_is_nominal_and_every_sensor_noisy():
    noisy = make_held(dataclasses.replace(SMALL, world="noise"), SMALL.envs, 1)
    noisy.reset()
    for part in noisy.parts:
        assert part.batch.plant.vehicle.brake == BOGIE.brake
        noise = part.batch.plant.conditions.noise
        assert (noise >= NOISY[0]).all()
        assert (noise <= NOISY[1]).all()
    assert len({part.batch.plant.conditions.tau.max() > 0.0 for part in noisy.parts}) == 2  # both laws


def test_without_residual_the_frozen_policy_brakes_alone(world):
    """Four decisions at once are as four by the network and the steering."""

    def begin():
        world.venv.seed(5)
        world.reset()
        return np.concatenate([part.batch.plant.truth().speed.copy() for part in world.parts])

    speeds = begin()
    for _ in range(10):
        world.step(np.zeros((SMALL.envs, 2)))
    together = np.concatenate([part.batch.plant.truth().speed.copy() for part in world.parts])
    assert_array_equal(begin(), speeds)
    observation = world._observation
    for _ in range(10 * SMALL.held):
        wanted = torch.as_tensor(np.clip(world.base(observation), -1.0, 1.0))
        command = world.steering.commands(torch.as_tensor(observation), wanted)
        observation = np.asarray(world.venv.step(to_action(command.numpy()))[0])
    alone = np.concatenate([part.batch.plant.truth().speed.copy() for part in world.parts])
    assert_array_equal(alone, together)
    assert (alone < speeds).any()


@pytest.mark.parametrize("privileged", [False, True])
def test_the_policy_sees_nothing_that_only_the_truth_tells(world, privileged):
    model = make_model(dataclasses.replace(SMALL, privileged=privileged), world)
    seen = world.reset()
    other = seen.copy()
    other[:, world.own :] += 1.0
    with torch.no_grad():
        for layer in (model.policy.action_net.weight, model.policy.action_net.bias):
            assert_array_equal(layer.numpy(), 0.0)  # it begins with no residual
        torch.nn.init.normal_(model.policy.action_net.weight)
        acts = [model.policy.get_distribution(torch.as_tensor(own)).distribution.mean for own in (seen, other)]
        values = [model.policy.predict_values(torch.as_tensor(own)) for own in (seen, other)]
    assert_array_equal(acts[0].numpy(), acts[1].numpy())
    assert np.array_equal(values[0].numpy(), values[1].numpy()) == (not privileged)


def test_gradients_of_independent_rollouts_are_compared():
    found = cosines(SMALL)
    assert -1.0 <= found["cosine"] <= 1.0
    assert_allclose(cosines(SMALL)["cosine"], found["cosine"])  # of the same seeds the same


def test_who_knows_all_pays_less_than_the_teacher_with_valves_and_travels_further_than_the_bound(monkeypatch):
    monkeypatch.setattr(agents.improve, "LOW", agents.improve.LOW | {"initial_speed": [12.0, 16.0]})  # soon over
    found = marks(dataclasses.replace(SMALL, judged=8))
    paid = {name: own[0] + SMALL.slide_price * own[1] for name, own in found.items() if name != "bound"}
    assert paid["ideal"].mean() < paid["teacher"].mean() < 1.1 * paid["ideal"].mean()
    assert (found["ideal"][0] > found["bound"]).all()


def test_the_judged_stops_are_those_of_the_plants(world):
    world.reset()
    for part in world.parts:
        plant = part.batch.plant
        for i, stop in enumerate(stops_of(plant)):
            assert stop.initial_speed == plant.truth().speed[i] > 20.0
            assert stop.mu_cd == plant.conditions.mu_cd[i]
            assert_array_equal(stop.radius, plant.conditions.radius[i])
