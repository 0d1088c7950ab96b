"""Training: exact resume, seeds, export that agrees with SB3."""

import copy
import csv
import dataclasses
import json
import re
from types import SimpleNamespace

import numpy as np
import onnxruntime
import pytest
import torch
from elsewhere import Elsewhere
from numpy.testing import assert_allclose, assert_array_equal
from stable_baselines3 import PPO

import agents.imitation
import agents.watch
from agents import checkpoint, spread, tune
from agents.export import AGREEMENT, Actor, disagreement, export
from agents.measure import WATCHED, Yardstick
from agents.train import LOOKS, Arguments, actor, begin_from, make_world, segment_seed, task_options, train
from agents.watch import Watch
from agents.worlds import CUT_OUT_MPS, REFERENCE
from wsp_env.envs.task import make_task
from wsp_env.evaluation.controller import load
from wsp_env.evaluation.runner import Conduct
from wsp_env.executor import ThisProcess
from wsp_env.observer.observation import Observer

TINY = Arguments(
    action="valve", imitation=0, critic_segments=0,
    envs=4, rollout=16, batch=32, epochs=2, segment=2, steps=4 * 16 * 2 * 3, watched=1, hidden=(8,), critic=(8,),
    scenario='{"initial_speed": [3.0, 4.0]}',
)  # fmt: skip


def arrays(folder):
    with np.load(folder / checkpoint.CHECKPOINT) as file:
        return {name: file[name] for name in file.files}


@pytest.fixture(scope="module", autouse=True)
def _short_looks():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(agents.watch, "GIVEN_UP", Conduct(time_limit_s=1.0))
        yield


def die_half_way(file, **_):
    file.write(b"half")
    raise KeyboardInterrupt


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    arguments = dataclasses.replace(TINY, out=tmp_path_factory.mktemp("run"))
    return arguments, *train(arguments)


def test_a_training_on_another_machine_ends_with_the_same_weights(trained, tmp_path):
    here, _, _ = trained
    there = dataclasses.replace(TINY, out=tmp_path / "run")
    spread.main(spread.Arguments((TINY.seed,), there), Elsewhere())
    (run,) = (tmp_path / "run").iterdir()
    assert run.name == f"{TINY.vehicle}-{TINY.seed}"
    assert (run / "policy").is_dir()
    expected = arrays(here.out)
    assert arrays(run).keys() == expected.keys()
    for name, values in arrays(run).items():
        assert_array_equal(values, expected[name], err_msg=name)
    before = (run / checkpoint.CHECKPOINT).stat().st_mtime_ns
    spread.main(spread.Arguments((TINY.seed,), there), Elsewhere())  # it is ready
    assert (run / checkpoint.CHECKPOINT).stat().st_mtime_ns == before


class Backwards(ThisProcess):
    """Is ready with the last task first."""

    def run(self, work, tasks, report=None):
        return super().run(work, list(reversed(tasks)), report)


def test_trials_do_not_depend_on_who_is_ready_first(tmp_path, monkeypatch):
    monkeypatch.setattr(spread, "score", lambda task: json.dumps(task.arguments.learning_rate).encode())
    found = []
    for name, executor in (("one", ThisProcess()), ("two", Backwards())):
        search = tune.HyperparameterSearch(trials=5, together=3, out=tmp_path / name)
        tune.main(search, executor)
        found.append((tmp_path / name / "study.db").exists() and best_of(search))
    assert found[0] == found[1]


def best_of(search):
    import optuna

    study = optuna.load_study(storage=f"sqlite:///{search.out / 'study.db'}", study_name=search.vehicle)
    return [(trial.params, trial.value) for trial in study.trials]


@pytest.mark.parametrize("killed", ["while learning", "while writing"])
def test_killed_and_resumed_ends_with_the_same_weights(trained, tmp_path, monkeypatch, killed):
    whole, _, _ = trained
    arguments = dataclasses.replace(whole, out=tmp_path)
    with monkeypatch.context() as patch:
        real_save, real_learn = checkpoint.save, torch.optim.Adam.step
        calls = {"save": 0, "step": 0}

        def save(*given):
            calls["save"] += 1
            if calls["save"] == 3 and killed == "while writing":
                patch.setattr(np, "savez", die_half_way)
            real_save(*given)

        def step(*given, **named):
            calls["step"] += 1
            if calls["step"] == 14 and killed == "while learning":
                raise KeyboardInterrupt
            return real_learn(*given, **named)

        patch.setattr(checkpoint, "save", save)
        patch.setattr(torch.optim.Adam, "step", step)
        with pytest.raises(KeyboardInterrupt):
            train(arguments)
    assert arrays(tmp_path)["segment"] == 1
    assert [file.suffix for file in tmp_path.iterdir() if file.suffix == ".part"] == []
    train(arguments)
    expected, found = arrays(whole.out), arrays(tmp_path)
    assert set(expected) == set(found)
    for name, value in expected.items():
        assert_array_equal(found[name], value, err_msg=name)


def test_another_seed_gives_other_weights_and_the_same_folder_refuses_it(trained, tmp_path):
    whole, model, _ = trained
    other, _ = train(dataclasses.replace(whole, out=tmp_path, seed=2))
    first, second = model.policy.state_dict(), other.policy.state_dict()
    assert any(not torch.equal(first[name], second[name]) for name in first)
    with pytest.raises(SystemExit, match="another seed"):
        train(dataclasses.replace(whole, seed=2))


def test_segments_have_their_own_random_numbers():
    assert len({segment_seed(seed, segment) for seed in range(5) for segment in range(20)}) == 100


@pytest.mark.parametrize("action", ["steered", *(pytest.param(one, marks=pytest.mark.long) for one in ("valve", "pressure"))])
def test_onnx_and_sb3_agree(tmp_path, action):
    arguments = dataclasses.replace(TINY, out=tmp_path, action=action, steps=128, hidden=(64, 64), scenario=Arguments.scenario)
    model, world = train(arguments)
    task = make_task(task_options(arguments))
    made = actor(arguments, model, world)
    assert export(model.policy, world, made, "bogie", task, tmp_path / "policy", {"seed": 1}) <= AGREEMENT
    rng = np.random.default_rng(8)
    observation = rng.uniform(-3.0, 3.0, (2000, model.observation_space.shape[0])).astype(np.float32)
    session = onnxruntime.InferenceSession(tmp_path / "policy" / "policy.onnx", providers=["CPUExecutionProvider"])
    command, raw = session.run(["command", "raw"], {"observation": observation})
    assert disagreement(model.policy, world, made, (observation,), raw) <= AGREEMENT
    slow = observation[:, REFERENCE] < CUT_OUT_MPS / Observer.SPEED_SCALE
    assert (command[slow] == 1.0).all()
    command, raw, observation = command[~slow], raw[~slow], observation[~slow]
    chosen, _ = model.predict(world.normalize_obs(observation), deterministic=True)
    if action == "pressure":
        assert_allclose(command, chosen, atol=AGREEMENT)
    elif action == "steered":
        steering = made.steering
        expected = steering.commands(torch.as_tensor(observation), torch.as_tensor(chosen)).numpy()
        assert (command == expected).mean() > 0.999  # but where two commands come as near
    else:
        two = np.sort(raw.reshape(len(raw), -1, 3), axis=2)
        clear = two[..., 2] - two[..., 1] > AGREEMENT
        assert clear.mean() > 0.99
        assert_array_equal(command[clear], chosen[clear] - 1.0)
    policy = load(str(tmp_path / "policy"))
    assert policy.action == ("pressure" if action == "pressure" else "valve")
    assert policy.contract.limits["mu_cd"] == [0.02, 0.065]
    assert json.loads((tmp_path / "policy" / "contract.json").read_text())["training"] == {"seed": 1}
    yardstick = Yardstick.drawn("bogie", "recovering", 1, WATCHED)
    assert np.isfinite(yardstick.means(policy)["distance_m"])


@pytest.mark.long
def test_a_recurrent_policy_remembers_in_its_folder_as_it_does_in_training(tmp_path):
    arguments = dataclasses.replace(TINY, out=tmp_path, action="steered", recurrent=6, steps=128, scenario=Arguments.scenario)
    model, world = train(arguments)
    made = actor(arguments, model, world)
    assert export(model.policy, world, made, "bogie", make_task(task_options(arguments)), tmp_path / "p", {}) <= AGREEMENT
    policy = load(str(tmp_path / "p"))
    assert policy.contract.output.keys() == {"command", "raw", "remembered"}
    rng = np.random.default_rng(3)
    state, memory, start = None, np.zeros((5, 12), dtype=np.float32), np.ones(5, dtype=bool)
    session = onnxruntime.InferenceSession(tmp_path / "p" / "policy.onnx", providers=["CPUExecutionProvider"])
    for _ in range(20):
        observation = rng.uniform(-3.0, 3.0, (5, model.observation_space.shape[0])).astype(np.float32)
        chosen, state = model.predict(world.normalize_obs(observation), state, start, deterministic=True)
        raw, memory = session.run(["raw", "remembered"], {"observation": observation, "memory": memory})
        assert_allclose(np.clip(raw, -1.0, 1.0), chosen, atol=AGREEMENT)
        start = np.zeros(5, dtype=bool)
    yardstick = Yardstick.drawn("bogie", "recovering", 1, WATCHED)
    assert yardstick.means(policy) == yardstick.means(policy)  # it forgets between stops


def test_a_policy_that_runs_on_is_told_as_such(tmp_path, monkeypatch, capsys):
    """A second of stops ends nowhere: neither the rules stand by then, and nobody is blamed; where they do, the policy is."""
    given = dataclasses.replace(TINY, action="steered", imitation=LOOKS, imitation_decisions=8, steps=4 * 16 * 2)
    train(dataclasses.replace(given, out=tmp_path / "both"))
    assert "runs on" not in capsys.readouterr().out
    real, look = Watch.means, Watch.look

    def rules_stand(watch, controller):
        found = real(watch, controller)
        return {law: row | {"ran_on": 0.0} for law, row in found.items()}

    monkeypatch.setattr(Watch, "means", rules_stand)
    monkeypatch.setattr(Watch, "look", lambda watch, who: look(watch, who) | {"classic_ran_on": 0.25})
    train(dataclasses.replace(given, out=tmp_path / "policy"))
    said = " ".join(capsys.readouterr().out.split())
    assert "WARNING: this policy runs on: after 1 s it still runs in 25% of the watched stops under the classic law" in said
    assert f"(--imitation, now {LOOKS})" in said


def test_the_curve_begins_with_the_imitation(tmp_path):
    arguments = dataclasses.replace(
        TINY, out=tmp_path, action="steered", imitation=2 * LOOKS, imitation_decisions=8, steps=4 * 16 * 2 * 2
    )
    train(arguments)
    with (tmp_path / "curve.csv").open() as file:
        rows = list(csv.DictReader(file))
    taught, practised = 4 * 8 * LOOKS, 4 * 16 * 2
    assert [float(row["decisions"]) for row in rows] == [taught, 2 * taught, 2 * taught + practised, 2 * taught + 2 * practised]
    assert [float(row["ppo_decisions"]) for row in rows] == [0, 0, practised, 2 * practised]


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"mechanisms": "{"}, "--mechanisms '{' is not JSON"),
        ({"mechanisms": '{"pads": {}}'}, "unknown mechanism pads"),
        ({"scenario": '{"speed": [1, 2]}'}, "scenario quantity"),
        ({"envs": 0}, "--envs 0 is impossible"),
        ({"classic_share": 2.0}, "--classic-share 2 is impossible"),
        ({"start": "nowhere"}, "nowhere holds no checkpoint.npz to begin from"),
    ],
)
def test_arguments_that_cannot_be_leave_no_run_behind(tmp_path, wrong, said):
    with pytest.raises(SystemExit, match=re.escape(said) if "[" in said else said):
        train(dataclasses.replace(TINY, out=tmp_path / "run", **wrong))
    assert not (tmp_path / "run").exists()


def test_killed_in_the_imitation_it_begins_anew_and_ends_with_the_same_weights(tmp_path, monkeypatch):
    whole = dataclasses.replace(
        TINY,
        out=tmp_path / "whole",
        action="steered",
        recurrent=4,
        imitation=2 * LOOKS,
        imitation_decisions=8,
        steps=4 * 16 * 2,
    )
    train(whole)
    killed, improve, calls = dataclasses.replace(whole, out=tmp_path / "killed"), agents.imitation._improve, []

    def die(*given):
        calls.append(given)
        if len(calls) > LOOKS + 2:
            raise KeyboardInterrupt
        return improve(*given)

    with monkeypatch.context() as patch:
        patch.setattr(agents.imitation, "_improve", die)
        with pytest.raises(KeyboardInterrupt):
            train(killed)
    assert not (killed.out / checkpoint.BEST).exists()  # nothing is exported of a teaching half way
    train(killed)
    expected, found = arrays(whole.out), arrays(killed.out)
    for name, value in expected.items():
        assert_array_equal(found[name], value, err_msg=name)
    for name in (checkpoint.BEST, "curve.csv"):
        assert (whole.out / name).exists()
    assert (whole.out / "curve.csv").read_text() == (killed.out / "curve.csv").read_text()


def test_a_recurrent_policy_killed_and_resumed_ends_with_the_same_weights(tmp_path, monkeypatch):
    whole = dataclasses.replace(TINY, out=tmp_path / "whole", action="steered", recurrent=6)
    train(whole)
    killed, real_save = dataclasses.replace(whole, out=tmp_path / "killed"), checkpoint.save

    def save(path, *given):
        real_save(path, *given)
        if path.name == checkpoint.CHECKPOINT:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(checkpoint, "save", save)
        with pytest.raises(KeyboardInterrupt):
            train(killed)
    train(killed)
    expected, found = arrays(tmp_path / "whole"), arrays(tmp_path / "killed")
    for name, value in expected.items():
        assert_array_equal(found[name], value, err_msg=name)


def test_a_policy_with_pressure_sensors_is_trained_watched_and_measured(tmp_path):
    arguments = dataclasses.replace(TINY, out=tmp_path, action="steered", pressure_sensors=True, steps=128)
    model, world = train(arguments)
    export(model.policy, world, actor(arguments, model, world), "bogie", make_task(task_options(arguments)), tmp_path / "p", {})
    policy = load(str(tmp_path / "p"))
    assert policy.contract.pressure_sensors
    assert np.isfinite(Yardstick.drawn("bogie", "recovering", 1, WATCHED).means(policy)["distance_m"])


def test_what_differs_is_not_exported(tmp_path, trained):
    arguments, model, world = trained
    other = copy.deepcopy(world.obs_rms)
    other.mean += 1.0  # the network would see something else than in training
    wrong = Actor(model.policy, SimpleNamespace(**vars(world) | {"obs_rms": other}))
    with pytest.raises(RuntimeError, match="differs"):
        export(model.policy, world, wrong, "bogie", make_task(task_options(arguments)), tmp_path / "policy", {})
    assert not (tmp_path / "policy").exists()


def test_a_run_begins_from_another_ones_weights(trained):
    arguments, finished, _ = trained
    world = make_world(arguments)
    model = PPO("MlpPolicy", world, policy_kwargs={"net_arch": [8]}, device="cpu")
    begin_from(arguments.out, model, world)
    assert model.num_timesteps == 0
    for name, value in finished.policy.state_dict().items():
        assert torch.equal(model.policy.state_dict()[name], value), name
