"""The studies' worlds, tables and pictures."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from agents import behaviour, front, replayed, spread, study
from agents import tune as tune_agents
from agents.measure import HELD_OUT, Yardstick, low_adhesion
from agents.seeds import REPORTED, at_slip
from agents.study import OUTSIDE, SIZES, Arguments, compare, table, worlds
from wsp_env.evaluation.controller import load
from wsp_env.evaluation.policy import load_policy
from wsp_env.evaluation.replay import braked
from wsp_env.executor import ThisProcess
from wsp_env.parameters.uic_z1 import VEHICLES
from wsp_env.plant.mechanisms import ALL, make
from wsp_env.recordings import conditions, demo_campaign, read_campaign, tune


def test_every_mechanism_is_switched_on_at_a_size_that_acts():
    for name, size in SIZES.items():
        record = getattr(make({name: size}), name)
        on = dict(zip((one.name for one in ALL[name].parameters), record, strict=True))
        assert any(on[one.name] != one.null for one in ALL[name].sizes), name


def test_worlds_change_what_their_name_says_and_nothing_else():
    found = {name: (stops, mechanisms) for name, stops, mechanisms in worlds("bogie", 2)}
    assert set(found) == {"recovering law", "classic law", *SIZES, *OUTSIDE}
    plain = found["recovering law"][0]
    for name, changes in OUTSIDE.items():
        for one, other in zip(plain, found[name][0], strict=True):
            for field in dataclasses.fields(one):
                expected = changes.get(field.name, getattr(one, field.name))
                assert np.array_equal(getattr(other, field.name), expected)
    assert all(stop.tau == 0.0 for stop in found["classic law"][0])
    assert found["load_transfer"][0] is plain
    assert found["load_transfer"][1] == {"load_transfer": SIZES["load_transfer"]}


def test_rows_compare_with_the_first_and_the_table_names_who_runs_on():
    rows = compare({"rules": load("rule-based"), "none": load("none")}, Yardstick.drawn("wheelset", "recovering", 2, HELD_OUT))
    assert rows[0]["ratio"] == 1.0
    assert rows[0]["ratio_ci"] == 0.0
    assert rows[1]["ratio"] != 1.0
    text = table({"a world": [rows[0], rows[1] | {"ran_on": 0.5}]})
    assert text.count("\n") == 2
    assert "(some ran on)" in text
    assert "| a world | none | " in text


def test_without_thresholds_there_is_nothing_to_compare_with():
    with pytest.raises(SystemExit, match=r"agents\.rules"):
        study.study(Arguments(price="17"))


@pytest.mark.slow
def test_one_world_as_json(capsys):
    study.main(Arguments(stops=1, only="wheel_speed_lag", json=True))
    found = json.loads(capsys.readouterr().out)
    assert [row["controller"] for row in found["wheel_speed_lag"]] == ["rules", "bogie"]


def test_the_front_is_drawn(tmp_path):
    pairs = {"rules": [(0.5, 900.0), (1.0, 850.0)], "bound": [(float("nan"), 700.0)]}
    front.draw({"recovering": pairs, "classic": pairs}, tmp_path / "docs" / "front.png")
    assert Path(tmp_path / "docs" / "front.png").read_bytes().startswith(b"\x89PNG")


def test_a_front_is_linear_between_its_points_and_keeps_its_ends():
    front = [{name: float(value) for name in REPORTED} | {"mean_slip_mps": slip} for value, slip in ((700, 2.0), (800, 1.0))]
    assert at_slip(front, 1.25)["distance_m"] == pytest.approx(775.0)
    assert at_slip(front, 1.25)["mean_slip_mps"] == pytest.approx(1.25)
    assert [at_slip(front, slip)["distance_m"] for slip in (0.5, 3.0)] == [800.0, 700.0]


@pytest.mark.long
def test_replayed_conditions_are_those_of_the_recordings_and_nobody_beats_the_bound():
    campaign = read_campaign(demo_campaign())
    tuning = tune(campaign)
    vehicle, stops, names = braked(campaign, conditions(campaign, tuning))
    assert names == list(tuning.runs)
    assert vehicle.axles == campaign.vehicle.axles
    for name, one in zip(names, stops, strict=True):
        assert one.initial_speed == pytest.approx(campaign.runs[name].vehicle_speed_mps[:5].mean(), rel=0.02)
        assert one.tau == tuning.tau_m_per_J
    rows = replayed.compare(replayed.Arguments((demo_campaign(),)))
    assert {row["stops"] for row in rows} == {len(names)}
    assert {"policy", "adaptive 1.5", "rules 2"} <= {row["controller"] for row in rows}
    assert all(row["over_bound"] > 1.0 and row["ran_on"] == 0 for row in rows)
    of = {row["controller"]: row for row in rows}
    assert np.isnan(of["rules 2"]["over_rules"]["distance_m_ratio"])  # it is on that front
    # The policy is compared with all others, and these hold the rules.
    assert of["policy"]["over_envelope"]["distance_m_ratio"] >= of["policy"]["over_rules"]["distance_m_ratio"]
    assert replayed.table(rows).count("\n") == 1 + len(rows)


def test_a_campaign_of_another_number_of_axles_is_refused_before_anything_is_braked():
    with pytest.raises(SystemExit, match=r"2 axles of a bogie, .* has 4; choose its policy with --vehicle"):
        replayed.compare(replayed.Arguments((demo_campaign(),), vehicle="bogie"))


def test_behaviour_counts_braked_wheels_by_speed_and_those_let_roll():
    time, n = np.arange(0.0, 60.0, 0.5), 120
    speed = np.linspace(44.0, 0.0, n)[:, None]
    slip = np.where(speed > 30.0, 2.0, 1.0)[..., None] * np.ones((1, 1, 2))
    pressure = np.ones((n, 1, 2))
    pressure[:, :, 1] = 0.05  # the second axle is let roll all the time, its slip does not count
    slip[:, :, 1] = 9.0
    row = behaviour.summary(behaviour.Traces(time, speed, slip, 0.5 * slip, pressure))
    assert [row[f"slip {name}"] for name in ("45 to 30", "30 to 20", "20 to 10")] == [2.0, 1.0, 1.0]
    assert row["worth 45 to 30"] == 1.0
    assert row["let_roll"] == 0.5
    assert behaviour.table([{"tau_m_per_J": 0.0, **row}]).count("\n") == 2


@pytest.mark.long
def test_failures_are_drawn_beside_the_rules(tmp_path, monkeypatch):
    assert set(behaviour.FAILURES) <= {*SIZES, *OUTSIDE}
    monkeypatch.setattr(behaviour, "FAILURES", ("pad_friction", "50 km/h"))
    own, rules = behaviour.failures(load_policy(Path("agents/trained/bogie")), behaviour.Arguments())
    assert set(own) == set(rules) == set(behaviour.FAILURES)
    for name in own:
        assert not np.array_equal(own[name].slip[100:300], rules[name].slip[100:300])
    behaviour.draw(own, 0, tmp_path / "failures.png", rules)
    assert (tmp_path / "failures.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(SystemExit, match="no price 7"):
        behaviour.failures(load_policy(Path("agents/trained/bogie")), behaviour.Arguments(price="7"))


@pytest.mark.long
def test_behaviour_of_a_shipped_policy_is_that_of_its_stops():
    stops = low_adhesion(VEHICLES["wheelset"], "recovering", 2, HELD_OUT)
    policy = load_policy(Path("agents/trained/wheelset"))
    found = behaviour.trace(policy, "wheelset", stops, 3.0)
    assert found.speed[0] == pytest.approx([stop.initial_speed for stop in stops])
    distance = Yardstick("wheelset", stops).figures(policy)["distance_m"]
    step = found.time[1]
    assert step * found.speed.sum(axis=0) == pytest.approx(distance, rel=0.01)
    assert (found.worth > 0.0).all()


def test_a_search_goes_on_where_it_was_and_prints_the_best(tmp_path, monkeypatch, capsys):
    """Trainings are replaced by a score that is least for narrow networks."""
    seen = []

    def score(task):
        seen.append(task.arguments)
        return json.dumps(float(task.arguments.hidden[0])).encode()

    monkeypatch.setattr(spread, "score", score)
    search = tune_agents.HyperparameterSearch(trials=4, out=tmp_path, steps=1000)
    for _ in range(2):
        tune_agents.main(search, ThisProcess())
    assert len({arguments.out for arguments in seen}) == 8
    assert len({arguments.learning_rate for arguments in seen}) == 8
    assert all(arguments.steps == 1000 and arguments.out.parent == tmp_path for arguments in seen)
    printed = capsys.readouterr().out
    best = json.loads(printed[printed.rindex("{") :])
    assert best["score"] == best["width"] == min(arguments.hidden[0] for arguments in seen)
