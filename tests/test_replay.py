"""Recorded stops as conditions, and controllers under them."""

import dataclasses
import json

import gymnasium as gym
import numpy as np
import pytest
from browser import BROWSER, open_page
from elsewhere import Elsewhere

import wsp_env  # noqa: F401  # registers the environments
from wsp_env.cli import main
from wsp_env.cli.replay import _warn_of_other_sources
from wsp_env.envs.model import read_model
from wsp_env.evaluation.replay import RECORDED, SIMULATED, replay
from wsp_env.parameters.quantity import ParameterError
from wsp_env.recordings import conditions, demo_campaign, read_campaign, tune
from wsp_env.recordings.origin import hashes


@pytest.fixture(scope="module")
def campaign():
    return read_campaign(demo_campaign())


@pytest.fixture(scope="module")
def replayed(campaign):
    return replay(campaign, {"none": {}, "rule-based": {}})


def test_conditions_are_the_recorded_ones_and_plain_data(campaign):
    tuning = tune(campaign)
    given = json.loads(json.dumps(conditions(campaign, tuning)))
    assert [stop["name"] for stop in given["stops"]] == list(tuning.runs)
    for stop in given["stops"]:
        run = campaign.runs[stop["name"]]
        assert stop["initial_speed"] == pytest.approx(run.vehicle_speed_mps[0], rel=0.01)
        assert stop["mu_cd"] == tuning.runs[run.name].mu_cd
        assert 0.02 < stop["sensor_noise"] < 0.03  # the recordings' noise is 0.025 rad/s
    assert max(stop["demand"] for stop in given["stops"]) == 1.0
    full = given["vehicle"]["brake"]["torque_per_bar_nm"] * 3.8
    assert full == pytest.approx(max(run.brake_torque_nm.max() for run in campaign.runs.values()), rel=0.03)  # noise on top


def test_noise_is_no_brake_torque(campaign):
    rng = np.random.default_rng(0)
    noisy = {}
    for name, run in campaign.runs.items():
        noise = 200.0 * rng.standard_normal(run.brake_torque_nm.shape)
        noisy[name] = dataclasses.replace(run, brake_torque_nm=run.brake_torque_nm + noise)
    tuning = tune(campaign)
    quiet, loud = (conditions(recorded, tuning) for recorded in (campaign, dataclasses.replace(campaign, runs=noisy)))
    per_bar = [given["vehicle"]["brake"]["torque_per_bar_nm"] for given in (quiet, loud)]
    assert per_bar[1] == pytest.approx(per_bar[0], rel=0.005)
    for one, other in zip(quiet["stops"], loud["stops"], strict=True):
        assert other["demand"] == pytest.approx(one["demand"], rel=0.005)


def test_mu_cd_along_the_track_stays_near_the_run_s_own(campaign):
    for stop in conditions(campaign, along_track=True)["stops"]:
        track = np.array(stop["track"])
        assert np.abs(track - 1.0).max() < 0.1  # the truth varies by 2 %
        assert track.std() > 0.0


def test_environments_take_them(campaign):
    given = conditions(campaign)
    vector = gym.make_vec("wsp_env/Coach-v1", num_envs=2, conditions=given)
    _, info = vector.reset(seed=0, options={"condition": ["A5", "B1"]})
    assert info["speed_mps"].tolist() == [given["stops"][2]["initial_speed"], given["stops"][3]["initial_speed"]]
    assert info["mass_kg"].tolist() == [43_000.0, 43_000.0]


def test_a_model_brings_its_law_and_its_mechanisms_to_every_row(campaign, tmp_path):
    """On rail on which nothing slides, with one of four brakes at half of its torque."""
    tuning = tune(campaign)
    friction = dict.fromkeys(tuning.runs, 0.25)  # nothing slides
    weak = {"brake_gain_imbalance": {"gain": -0.5, "axle": 1.0}}
    file = tmp_path / "model.json"
    file.write_text(json.dumps({"tau_m_per_J": 1e-5, "mu_cd": friction, "mechanisms": weak}), encoding="utf-8")
    found = replay(campaign, {"none": {}}, model=read_model(str(file)))
    assert found.tau_m_per_j == 1e-5
    plain = replay(campaign, {"none": {}}, model=dataclasses.replace(read_model(str(file)), mechanisms={}))
    for one, other in zip(found.courses, plain.courses, strict=True):
        longer = one.figures["distance_m"] / other.figures["distance_m"]
        # One brake of four lacks half of its torque: an eighth of the deceleration.
        assert (longer == 1.0) if one.who == RECORDED else (1.05 < longer < 1.0 / (1.0 - 0.125)), (one.stop, one.who)
    strange = dataclasses.replace(read_model(str(file)), mu_cd={"elsewhere": 0.1})
    with pytest.raises(ParameterError, match=r"has no mu_cd of A1, .* it knows elsewhere"):
        replay(campaign, {"none": {}}, model=strange)


@pytest.mark.slow
def test_the_replay_can_be_trusted_where_no_controller_acted(replayed):
    figures = {(course.stop, course.who): course.figures for course in replayed.courses}
    for stop in ("A1", "A3", "B1", "B2"):
        recorded = figures[stop, RECORDED]["distance_m"]
        assert figures[stop, SIMULATED]["distance_m"] == pytest.approx(recorded, rel=0.01)
        assert figures[stop, "none"]["distance_m"] == pytest.approx(recorded, rel=0.01)  # its WSP had nothing to do there
    deep = figures["A5", RECORDED]
    assert figures["A5", SIMULATED]["mean_slip_mps"] == pytest.approx(deep["mean_slip_mps"], rel=0.03)
    assert figures["A5", "rule-based"]["mean_slip_mps"] < deep["mean_slip_mps"]
    assert not any(course.figures["locked_s"] for course in replayed.courses)


@pytest.mark.slow
def test_who_brakes_the_stops_does_not_matter(campaign, replayed):
    there = replay(campaign, {"none": {}, "rule-based": {}}, executor=Elsewhere())
    assert there.to_json() == replayed.to_json()
    for one, other in zip(there.courses, replayed.courses, strict=True):
        np.testing.assert_array_equal(one.slip_mps, other.slip_mps)


@pytest.mark.slow
def test_a_controller_that_fails_is_reported_and_the_others_replayed(campaign, tmp_path):
    bad = tmp_path / "bad.py"
    act = "    def act(self, measurement): return measurement.wheel_speed * float('nan')"
    bad.write_text(f"class Bad:\n    def reset(self, n, vehicle): ...\n{act}\n", encoding="utf-8")
    result = replay(campaign, {str(bad): {}, "none": {}})
    assert "returned nan" in result.failures[str(bad)]
    assert {course.who for course in result.courses} == {RECORDED, SIMULATED, "none"}


@pytest.mark.slow
def test_the_command_prints_json_and_writes_a_page(tmp_path, capsys):
    assert main(["replay", str(demo_campaign()), "--controllers", "none", "--out", str(tmp_path), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert {row["stop"] for row in printed["stops"]} == {"A1", "A3", "A5", "B1", "B2"}
    assert (tmp_path / "replay.html").read_text(encoding="utf-8").count('class="plot"') == 6
    assert main(["replay", str(demo_campaign()), "--controllers", "nobody"]) == 2
    assert "nobody" in capsys.readouterr().err


@pytest.mark.long
@pytest.mark.skipif(BROWSER is None, reason="no Chromium installed")
def test_the_page_opens_without_a_network_and_all_axes_have_units(tmp_path):
    assert main(["replay", str(demo_campaign()), "--controllers", "none", "--out", str(tmp_path)]) == 0
    said, plots, titles = open_page(tmp_path / "replay.html", tmp_path / "profile")
    assert said == []
    assert plots == 6
    assert all(title.endswith("]") for title in titles), titles


def test_a_model_of_other_recordings_is_told(tmp_path, capsys):
    """Runs of the same names would get the mu_cd of other stops."""
    folder = demo_campaign()
    files = dict(hashes(folder))
    file = tmp_path / "model.json"
    for sources, told in ((files, ""), (files | {"campaign.toml": "another remark in it"}, ""), ({}, "")):
        file.write_text(json.dumps({"tau_m_per_J": 2e-4, "sources": sources}))
        _warn_of_other_sources(read_model(str(file)), folder)
        assert capsys.readouterr().err == told
    file.write_text(json.dumps({"tau_m_per_J": 2e-4, "sources": dict.fromkeys(files, "0")}))
    _warn_of_other_sources(read_model(str(file)), folder)
    assert "was found on other recordings" in capsys.readouterr().err
