"""PPO on top of an imitation: every wheelset an agent with the reward of what it gives away itself."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal

import agents.watch
from agents import checkpoint
from agents.axles import HELD
from agents.improve import Base, Improvement, cosines, improve, let_learn, main, make_agents, make_ppo, network_of
from agents.worlds import TIME_PRICE_MPS
from wsp_env.evaluation.policy import load_policy
from wsp_env.evaluation.runner import Conduct
from wsp_env.parameters.uic_z1 import BOGIE
from wsp_env.plant.command import to_action

SHIPPED = Path(__file__).parents[1] / "agents/trained"
SMALL = Improvement(
    base=SHIPPED / "bogie", envs=8, rollout=4, updates=4, segment=2, critic_updates=1, epochs=2, batches=2, watched=1, cosine=3
)


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    return Base(SMALL.base, tmp_path_factory.mktemp("base"))


@pytest.fixture(scope="module")
def world(base):
    world = make_agents(SMALL, base, 1)
    world.venv.seed(1)  # by chance, the drawn noise of all parts but one may be small
    world.reset()
    return world


def test_a_policy_folder_becomes_the_network_again(base):
    policy = load_policy(SMALL.base)
    observation = np.random.default_rng(0).normal(size=(100, len(policy.contract.observation))).astype(np.float32)
    with torch.no_grad():
        command, _ = base.actor(torch.as_tensor(observation))
    assert_array_equal(command.numpy(), policy.infer(observation, np.zeros((100, 0), dtype=np.float32))[0])


@pytest.mark.parametrize(("name", "value"), [("action", "valve"), ("recurrent", 8)])
def test_what_cannot_be_improved_is_refused(tmp_path, name, value):
    folder = tmp_path / "policy"
    folder.mkdir()
    (folder / "policy.onnx").write_bytes((SMALL.base / "policy.onnx").read_bytes())
    contract = json.loads((SMALL.base / "contract.json").read_text())
    contract["training"]["arguments"][name] = value
    (folder / "contract.json").write_text(json.dumps(contract))
    with pytest.raises(SystemExit, match="no steered policy without memory"):
        Base(folder, tmp_path)


def test_vehicles_differ_and_the_observer_believes_the_nominal_one(world):
    parts = [part for part in world.parts if part.batch.plant.conditions.noise.max() > 0.1]
    assert len({part.batch.vehicle.brake.fill_time_constant_s for part in parts}) == len(parts) > 1
    for part in world.parts:
        assert part.batch.observer.vehicle.brake.fill_time_constant_s == BOGIE.brake.fill_time_constant_s
    assert len({part.batch.plant.conditions.tau.max() > 0.0 for part in world.parts}) == 2  # both laws


def test_as_the_policy_wishes_it_brakes_alone(world, base):
    """The agents' wishes for some time are the network and the steering at every decision of 20 ms."""

    def begin():
        world.venv.seed(5)
        seen = world.reset()
        return seen, np.concatenate([part.batch.plant.truth().speed.copy() for part in world.parts])

    model = make_ppo(SMALL, base, world)
    seen, speeds = begin()
    for _ in range(6):
        action, _ = model.predict(seen, deterministic=True)
        seen, *_ = world.step(action)
    together = np.concatenate([part.batch.plant.truth().speed.copy() for part in world.parts])
    assert_array_equal(begin()[1], speeds)
    observation = world._observation
    for _ in range(6 * HELD):
        with torch.no_grad():
            wanted = np.clip(base.actor.raw(torch.as_tensor(observation)).numpy(), -1.0, 1.0)
        command = base.steering.commands(torch.as_tensor(observation), torch.as_tensor(wanted))
        observation = np.asarray(world.venv.step(to_action(command.numpy()))[0])
    alone = np.concatenate([part.batch.plant.truth().speed.copy() for part in world.parts])
    assert_allclose(alone, together, rtol=1e-5)
    assert (alone < speeds).any()


def test_a_deviation_from_the_wish_lasts_and_is_that_of_the_own_axle_alone(world, base, monkeypatch):
    world.venv.seed(7)
    world.reset()
    told, commands, added = [], type(base.steering).commands, np.array([0.3, 0.0])

    def listen(steering, seen, wanted):
        told.append((base.actor.raw(seen).detach().numpy(), wanted.numpy()))
        return commands(steering, seen, wanted)

    monkeypatch.setattr(type(base.steering), "commands", listen)
    with torch.no_grad():
        wished = base.actor.raw(torch.as_tensor(world._observation)).numpy()
    world.step((wished + added).reshape(-1, 1))
    assert len(told) == HELD
    for wish, wanted in told:
        assert_allclose(wanted, np.clip(wish + added, -1.0, 1.0), atol=1e-6)


def test_what_all_wheelsets_give_away_is_the_reward(base):
    """In metres, but for the running resistance; step by step within the error of a step of 20 ms."""
    world = make_agents(SMALL, base, 3)
    world.venv.seed(11)
    world.reset()
    part = world.parts[-1]
    part.reset()
    rng, own, reward, resisted = np.random.default_rng(0), 0.0, 0.0, 0.0
    c = part.batch.plant.conditions
    for _ in range(200):
        before = part._rest_at(part.batch.plant.truth().speed)
        work = part.batch.plant.truth().resistance_work.copy()
        command = rng.choice([-1.0, 0.0, 1.0, 1.0], size=(part.num_envs, world.axles))
        _, one, done, _ = part.step(to_action(command))
        assert not done.any()
        state = part.batch.plant.truth()
        travelled = np.maximum(state.speed, 0.1) * part.batch.task.control_interval_s
        slope = (before - part._rest_at(state.speed)) / np.maximum(
            state.deceleration * part.batch.task.control_interval_s, 1e-6
        )
        resisted = resisted + slope * (state.resistance_work - work) / c.mass / travelled * part.batch.task.control_interval_s
        own, reward = own + part.own.mean(axis=1), reward + one / part.batch.weights.stopping_distance
    assert np.abs(reward).min() > 5.0
    assert_allclose(own + resisted, reward, rtol=0.05)


def test_nothing_is_given_away_by_who_rolls_at_rest_of_all_terms(world):
    """Without adhesion, slip and air the time and the way alone are paid."""
    world.venv.seed(5)
    world.reset()
    part = world.parts[0]
    part.step(to_action(np.full((part.num_envs, world.axles), -1.0)))
    state = part.batch.plant.truth()
    expected = -(state.speed + TIME_PRICE_MPS) * part.batch.task.control_interval_s
    rolls = np.abs(state.adhesion).max(axis=1) < 1e-4
    assert rolls.any()
    assert_allclose(part.own[rolls], np.broadcast_to(expected[rolls, None], part.own[rolls].shape), rtol=0.02)


def test_the_policy_sees_nothing_that_only_the_truth_tells(world, base):
    model = make_ppo(SMALL, base, world)
    seen = world.reset()
    other = seen.copy()
    other[:, world.own + world.axles :] += 1.0
    with torch.no_grad():
        acts = [model.policy.get_distribution(torch.as_tensor(own)).distribution.mean for own in (seen, other)]
        values = [model.policy.predict_values(torch.as_tensor(own)) for own in (seen, other)]
        wished = base.actor.raw(torch.as_tensor(world._observation))
    assert_array_equal(acts[0].numpy(), acts[1].numpy())
    assert not np.array_equal(values[0].numpy(), values[1].numpy())
    assert_allclose(acts[0].numpy().reshape(-1, world.axles), wished.numpy(), rtol=1e-6)


def test_while_the_value_function_learns_the_network_does_not_move(world, base):
    model = make_ppo(SMALL, base, world)
    before = [parameter.detach().clone() for parameter in network_of(model)]
    values = [parameter.detach().clone() for parameter in model.policy.value_net.parameters()]
    let_learn(model, policy=False)
    model.learn(world.num_envs * SMALL.rollout)
    assert all(torch.equal(old, new) for old, new in zip(before, network_of(model), strict=True))
    assert not all(torch.equal(old, new) for old, new in zip(values, model.policy.value_net.parameters(), strict=True))
    let_learn(model, policy=True)
    model.learn(world.num_envs * SMALL.rollout)
    assert not any(torch.equal(old, new) for old, new in zip(before, network_of(model), strict=True))


def test_gradients_of_independent_rollouts_are_compared(tmp_path):
    found = [cosines(SMALL, Base(SMALL.base, tmp_path))["cosine"] for _ in range(2)]
    assert -1.0 <= found[0] <= 1.0
    assert found[0] == pytest.approx(found[1])  # of the same seeds the same


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"envs": 1}, "--envs 1"), ({"segment": 0}, "--segment 0"), ({"deviation": 0.0}, "--deviation 0"),
        ({"classic_share": 1.5}, "--classic-share 1.5"), ({"cosine": 1}, "--cosine 1"), ({"base": Path("nix")}, "--base nix"),
    ],
)  # fmt: skip
def test_arguments_that_cannot_be_are_refused_before_anything_is_written(tmp_path, change, message):
    with pytest.raises(SystemExit, match=message):
        main(dataclasses.replace(SMALL, **({"out": tmp_path / "run", "cosine": 0} | change)))
    assert not (tmp_path / "run").exists()


@pytest.mark.long
def test_a_run_that_was_killed_ends_with_the_same_weights(tmp_path, monkeypatch):
    monkeypatch.setattr(agents.watch, "GIVEN_UP", Conduct(time_limit_s=1.0))
    whole = dataclasses.replace(SMALL, out=tmp_path / "whole")
    improve(whole)
    killed, copy = dataclasses.replace(SMALL, out=tmp_path / "killed"), checkpoint.save

    def die(path, model, normalisation, segment, curve):
        copy(path, model, normalisation, segment, curve)
        if segment == 1:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:  # dies where the best one so far is written, if it is, and the last one is not
        patch.setattr(checkpoint, "save", die)
        with pytest.raises(KeyboardInterrupt):
            improve(killed)
    improve(killed)
    states = [np.load(one.out / checkpoint.CHECKPOINT) for one in (whole, killed)]
    assert int(states[0]["segment"]) == 2
    states += [np.load(one.out / checkpoint.BEST) for one in (whole, killed)]
    for one, other in (states[:2], states[2:]):
        for name in one.files:
            assert_array_equal(one[name], other[name], err_msg=name)
    networks = [(one.out / "policy/policy.onnx").read_bytes() for one in (whole, killed)]
    assert networks[0] == networks[1]
    contract = load_policy(whole.out / "policy").contract
    assert contract.training["improved"]["updates"] == SMALL.updates
    assert contract.training["arguments"] == load_policy(SMALL.base).contract.training["arguments"]
    with pytest.raises(SystemExit, match="another seed"):
        improve(dataclasses.replace(whole, seed=2))
