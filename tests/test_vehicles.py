"""Vehicles of any number of axles: load transfer, environments, campaigns and their models, trains."""

import dataclasses
import json
import warnings

import gymnasium as gym
import numpy as np
import pytest
import synthetic_stops
from few_stops import small_demo
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from synthetic_stops import stop, write_campaign

from wsp_env.cli import main
from wsp_env.diagnosis import diagnose
from wsp_env.diagnosis.evaluate import vehicle_of
from wsp_env.envs.task import Task
from wsp_env.evaluation.replay import replay
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.uic_z1 import BOGIE, COACH, VEHICLES, WHEELSET, usual_positions
from wsp_env.parameters.vehicle import Vehicle, usual_bodies
from wsp_env.parameters.vehicle_file import write_vehicle
from wsp_env.plant.mechanisms.load_transfer import arms
from wsp_env.recordings import conditions, derive, read_campaign, rolling_radii, tune
from wsp_env.recordings.simulate import simulate

TAU, MU_CD = 2e-4, 0.05
MINE = {
    3: Vehicle("bogie of three", axle_positions_m=(0.0, 1.8, 3.6), mass_kg=45_000.0, payload_kg=0.0),
    6: Vehicle("locomotive", axle_positions_m=(0.0, 2.1, 4.2, 11.0, 13.1, 15.2), mass_kg=120_000.0, payload_kg=0.0),
}


# Load transfer


@st.composite
def running_gears(draw):
    """Bodies on bogies with axles at rising places, at most 64 axles."""
    bodies = draw(st.lists(st.lists(st.integers(1, 4), min_size=1, max_size=3).map(tuple), min_size=1, max_size=5).map(tuple))
    count = sum(map(sum, bodies))
    gaps = draw(st.lists(st.floats(0.5, 20.0), min_size=count, max_size=count))
    return tuple(np.concatenate([[0.0], np.cumsum(gaps[1:])])), bodies


@given(gear=running_gears())
def test_the_loads_of_any_vehicle_sum_to_zero_and_balance_its_moments(gear):
    positions, bodies = gear
    body_arms, bogie_arms = map(np.array, arms(positions, bodies))
    places, axles, first = np.array(positions), len(positions), 0
    assert_allclose([body_arms.sum(), bogie_arms.sum()], 0.0, atol=1e-12)
    for body in bodies:
        centres = []
        under = slice(first, first + sum(body))
        for count in body:
            own = slice(first, first + count)
            first += count
            centres.append(places[own].mean())
            moment = -2.0 * np.sum(bogie_arms[own] * places[own])  # of the changes of the wheels' load, per the bogie's own
            assert_allclose(moment, 1.0 if count > 1 else 0.0, atol=1e-9)
            assert_allclose(bogie_arms[own].sum(), 0.0, atol=1e-12)
        moment = -2.0 * np.sum(body_arms[under] * np.repeat(centres, body))
        assert_allclose(moment, sum(body) / axles if len(body) > 1 else 0.0, atol=1e-9)
        assert (np.diff(body_arms[under]) <= 1e-15).all() or len(set(body)) > 1  # the front is loaded, the rear relieved


def test_the_arms_of_the_named_vehicles_are_those_of_two_supports():
    """Bit for bit what the formulas of one and of two bogies give."""
    assert arms(WHEELSET.axle_positions_m, WHEELSET.running_gear) == ((0.0,), (0.0,))
    lever = 1.0 / 2.56
    assert arms(BOGIE.axle_positions_m, BOGIE.running_gear) == ((0.0, 0.0), (lever / 2, -lever / 2))
    body, bogie = 1.0 / 19.0 / 4, lever / 2
    rear = 1.0 / (21.56 - 19.0) / 2
    assert arms(COACH.axle_positions_m, COACH.running_gear) == ((body, body, -body, -body), (bogie, -bogie, rear, -rear))


@pytest.mark.parametrize("axles", range(1, 65))
def test_any_number_of_axles_has_usual_bodies_and_places(axles):
    bodies = usual_bodies(axles)
    assert sum(map(sum, bodies)) == axles
    vehicle = Vehicle("any", axle_positions_m=usual_positions(bodies))
    assert vehicle.axles == axles
    assert vehicle.running_gear == bodies


def test_axles_too_far_apart_for_a_bogie_carry_their_body():
    """A two-axle wagon pitches over its axles: its body's height counts, and no frame's."""
    wagon = Vehicle("wagon", axle_positions_m=(0.0, 9.5))
    assert wagon.running_gear == ((1, 1),)
    assert arms(wagon.axle_positions_m, wagon.running_gear) == ((1.0 / 9.5 / 2, -1.0 / 9.5 / 2), (0.0, 0.0))
    assert Vehicle("bogie", axle_positions_m=(0.0, 4.2)).running_gear == ((2,),)
    assert Vehicle("five", axle_positions_m=(0.0, 2.5, 19.0, 21.5, 27.0)).running_gear == ((2, 2), (1,))
    assert Vehicle("own", axle_positions_m=(0.0, 9.5), bodies=((2,),)).running_gear == ((2,),)


# Environments and the programme


@pytest.mark.parametrize("axles", sorted(MINE))
def test_a_vehicle_file_brakes_in_the_environments(tmp_path, axles):
    file = tmp_path / "mine.toml"
    file.write_text(write_vehicle(MINE[axles]), encoding="utf-8")
    pins = {"mu_cd": MU_CD, "tau": TAU, "initial_speed": 8.0, "demand": 1.0, "track": "constant"}
    options = {"vehicle": str(file), "mechanisms": {"load_transfer": {}, "leading_axle_cleaning": {}}}
    env = gym.make("wsp_env/Coach-v1", **options)
    assert env.unwrapped.batch.vehicle == MINE[axles]
    assert env.action_space.nvec.tolist() == [3] * axles
    observation, info = env.reset(seed=1, options=pins)
    again = gym.make(type(env.spec).from_json(env.spec.to_json()))
    assert_array_equal(again.reset(seed=1, options=pins)[0], observation)
    ended = False
    while not ended:
        _, _, terminated, truncated, info = env.step(env.action_space.nvec - 1)
        ended = terminated or truncated
    assert terminated
    assert 5.0 < info["position_m"] < 200.0
    assert info["slip_speed_mps"].shape == (axles,)
    vector = gym.make_vec("wsp_env/Wheelset-v1", num_envs=2, **options)
    assert_array_equal(vector.reset(seed=1, options=pins)[0][0], observation)


def test_a_name_or_values_brake_too_and_nothing_else():
    assert gym.make("wsp_env/Coach-v1", vehicle="wheelset").unwrapped.batch.vehicle == WHEELSET
    heavy = gym.make("wsp_env/Bogie-v1", vehicle={"mass_kg": 3e4, "bodies": [[1, 1]]}).unwrapped.batch.vehicle
    assert heavy == dataclasses.replace(BOGIE, mass_kg=3e4, bodies=((1, 1),))
    for wrong, says in (
        ("tram", "unknown vehicle 'tram'; valid: wheelset"),
        ("no.toml", "no.toml cannot be read"),
        (3, "vehicle = 3 must be a name, a file's path as text, or"),
        (["coach"], "vehicle = .* must be a name"),
        ({"bodies": [2]}, "must list the axles of each bogie"),
        ({"bodies": 2}, "must list the axles of each bogie"),
        ({"bodies": [[2, 2]]}, "stand on 4 axles, but the vehicle has 2"),
    ):
        with pytest.raises(ParameterError, match=says):
            gym.make("wsp_env/Bogie-v1", vehicle=wrong)


@pytest.mark.long
@pytest.mark.parametrize("axles", sorted(MINE))
def test_a_vehicle_file_runs_under_every_command(tmp_path, capsys, axles):
    file = tmp_path / "mine.toml"
    file.write_text(write_vehicle(MINE[axles]), encoding="utf-8")
    common = ["--vehicle", str(file), "--out"]
    programme = ["--cases", "low-120", "--controllers", "rule-based", "--draws", "1", "--jobs", "1", "--json"]
    assert main(["evaluate", *common, str(tmp_path / "e"), *programme]) == 0
    found = json.loads(capsys.readouterr().out)
    assert f"energy_wheel_{axles}_mj" in found["stops"][0]
    assert not found["failures"]
    assert (
        main(["compare", *common, str(tmp_path / "c.html"), "--mu-cd", "0.04", "--tau", "2e-4", "--speed", "15", "--json"]) == 0
    )
    assert MINE[axles].name in json.loads(capsys.readouterr().out)["stop"]
    for command in ("evaluate", "compare"):
        assert main([command, "--vehicle", "tram"]) == 2
        assert "unknown vehicle 'tram'; valid: wheelset, bogie, coach, train, or a vehicle file" in capsys.readouterr().err


# Trains


def used(env):
    """Mean adhesion (12,) of a train of three coaches whose wheels are kept at a tenth of creepage."""
    info = env.reset(seed=0, options={"mu_cd": 0.03, "tau": TAU, "initial_speed": 25.0, "demand": 1.0, "track": "constant"})[1]
    adhesion = []
    while info["speed_mps"] > 10.0:
        sliding = info["slip_speed_mps"] > 0.1 * info["speed_mps"]
        info = env.step(np.where(sliding, 0, 2))[-1]
        adhesion.append(info["adhesion"])
    return np.mean(adhesion[150:], axis=0)


def test_the_wheels_of_a_train_clean_the_rail_for_the_last():
    env = gym.make("wsp_env/Train-v1", coaches=3, vehicle={"brake": {"torque_per_bar_nm": 3000.0}})
    assert env.unwrapped.batch.vehicle.axles == 12
    assert env.unwrapped.batch.task.mechanisms == {"leading_axle_cleaning": {}}
    cleaned = used(env)
    assert cleaned[8:].mean() > 1.05 * cleaned[:4].mean()
    plain = used(gym.make("wsp_env/Train-v1", coaches=3, vehicle={"brake": {"torque_per_bar_nm": 3000.0}}, mechanisms={}))
    assert plain[8:].mean() == pytest.approx(plain[:4].mean(), rel=0.01)


def test_a_train_is_made_of_any_vehicle_and_registered(tmp_path):
    assert gym.make("wsp_env/Train-v1").unwrapped.batch.vehicle == VEHICLES["train"]
    file = tmp_path / "mine.toml"
    file.write_text(write_vehicle(MINE[6]), encoding="utf-8")
    env = gym.make("wsp_env/Train-v1", vehicle=str(file), coaches=2)
    assert env.unwrapped.batch.vehicle.axles == 12
    assert type(env.spec).from_json(env.spec.to_json()).kwargs["coaches"] == 2
    with pytest.raises(ParameterError, match="takes 1 to 16 of them"):
        gym.make("wsp_env/Train-v1", coaches=17)
    with pytest.raises(ParameterError, match="coaches = 'ten'"):
        gym.make("wsp_env/Train-v1", coaches="ten")


@pytest.mark.filterwarnings("error")
def test_a_train_is_drawn_with_a_legend_that_fits():
    env = gym.make("wsp_env/Train-v1", render_mode="rgb_array")
    env.reset(seed=0)
    env.step(np.full(40, 2))
    assert env.render().shape == (600, 900, 3)  # matplotlib would warn of axes without height


# Campaigns


def campaign_of(folder, axles, monkeypatch, vehicle=""):
    """A campaign of two stops of a vehicle with so many axles; `vehicle` is more of its [vehicle]."""
    if axles != synthetic_stops.AXLES:
        driven = synthetic_stops._driven
        monkeypatch.setattr(synthetic_stops, "_driven", getattr(driven, "__wrapped__", driven))  # uncached
        monkeypatch.setattr(synthetic_stops, "AXLES", axles)
        monkeypatch.setattr(synthetic_stops, "MASS_KG", axles * 10_750.0)
    write_campaign(folder, {"A1": stop(TAU, MU_CD, noise=0.3), "B1": stop(TAU, 0.04, 30.0, noise=0.3)}, ["A1"], ["B1"])
    file = folder / "campaign.toml"
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("[contact]", f"{vehicle}\n[contact]"), encoding="utf-8")
    return read_campaign(folder)


@pytest.mark.parametrize("axles", [3, 6])
def test_campaigns_of_other_numbers_of_axles_are_tuned_simulated_and_braked(tmp_path, monkeypatch, axles):
    campaign = campaign_of(tmp_path / "c", axles, monkeypatch)
    assert vehicle_of(campaign).axles == axles
    found = replay(campaign, {"none": {}})
    assert found.tau_m_per_j == pytest.approx(TAU, rel=0.05)
    assert all(course.slip_mps.shape[1] == axles for course in found.courses)
    env = gym.make("wsp_env/Coach-v1", conditions=json.loads(json.dumps(conditions(campaign))))
    assert env.action_space.nvec.tolist() == [3] * axles
    assert env.reset(options={"condition": "B1"})[1]["mass_kg"] == axles * 10_750.0


def test_axle_positions_may_start_anywhere(tmp_path, monkeypatch):
    """They are shifted to the leading axle once, so that every answer is the same."""
    answers = []
    for name, first in (("a", 0.0), ("b", 16.0), ("c", -32.0)):
        places = [first + x for x in (0.0, 2.5, 19.0, 21.5)]  # exact in binary
        campaign = campaign_of(tmp_path / name, 4, monkeypatch, f"axle_positions_m = {places}")
        tuning, radii = tune(campaign), rolling_radii(campaign)
        run = campaign.runs["A1"]
        derived = derive(campaign, run, radii)
        pieces = simulate(campaign, run, derived, radii, np.array([100, 300]), 50, MU_CD, TAU, {"leading_axle_cleaning": {}})
        answers.append(
            (tuning, conditions(campaign, tuning, along_track=True), vehicle_of(campaign), pieces.circumferential_mps)
        )
    for tuning, given_, vehicle, speeds in answers[1:]:
        assert tuning.to_json() == answers[0][0].to_json()
        assert given_ == answers[0][1]
        assert vehicle == answers[0][2]
        assert vehicle.axle_positions_m[0] == 0.0
        assert_array_equal(speeds, answers[0][3])


@pytest.mark.parametrize("places", [[0.0, 2.5, 2.5, 21.5], [21.5, 19.0, 2.5, 0.0], [0.0, 2.5]])
def test_axle_positions_that_do_not_rise_are_refused(tmp_path, monkeypatch, places):
    with pytest.raises(ValueError, match="axle_positions_m"):
        campaign_of(tmp_path / "c", 4, monkeypatch, f"axle_positions_m = {places}")


def test_the_campaigns_own_vehicle_brakes_whatever_has_as_many_axles(tmp_path, monkeypatch):
    campaign = campaign_of(tmp_path / "c", 4, monkeypatch, "axle_positions_m = [1.0, 2.8, 9.0, 10.8]")
    monkeypatch.setitem(VEHICLES, "wagon", dataclasses.replace(COACH, name="wagon", brake=dataclasses.replace(COACH.brake)))
    with pytest.warns(UserWarning, match="vehicle of the conditions brakes, with 4 axles, and not the bogie"):
        braked = Task(conditions=conditions(campaign)).make_vehicle("bogie")
    assert braked.axle_positions_m == pytest.approx((0.0, 1.8, 8.0, 9.8))
    assert braked.name == "synthetic"
    slow = dataclasses.replace(COACH, brake=dataclasses.replace(COACH.brake, dead_time_s=0.2))
    assert Task(conditions=conditions(campaign, base=slow)).make_vehicle("coach").brake.dead_time_s == 0.2
    with pytest.raises(ParameterError, match="of a vehicle with 4 axles, the locomotive has 6"):
        conditions(campaign, base=MINE[6])
    own = json.loads(json.dumps(conditions(campaign)))
    own["vehicle"]["contact"]["kinetic_friction_r"] = 0.35
    named = Task(conditions=own, vehicle="bogie").make_vehicle("coach")  # asked for by name, it is not replaced
    assert named == dataclasses.replace(BOGIE, contact=dataclasses.replace(BOGIE.contact, kinetic_friction_r=0.35))
    assert Task(conditions=own, coaches=3).make_vehicle("coach").axles == 12


@pytest.mark.long
def test_replay_takes_what_a_campaign_does_not_tell_from_a_vehicle(tmp_path, capsys):
    file = tmp_path / "slow.toml"
    slow = dataclasses.replace(COACH, brake=dataclasses.replace(COACH.brake, dead_time_s=0.2))
    file.write_text(write_vehicle(slow), encoding="utf-8")
    demo = small_demo(tmp_path / "demo")
    figures = []
    for vehicle in ("coach", str(file)):
        options = ["--controllers", "rule-based", "--vehicle", vehicle, "--out", str(tmp_path / "out"), "--json"]
        assert main(["replay", str(demo), *options]) == 0
        figures.append(json.loads(capsys.readouterr().out)["stops"])
    who = [[row for row in rows if row["controller"] == "rule-based"] for rows in figures]
    assert who[0] != who[1]
    assert [row for row in figures[0] if "recorded" in row["controller"]] == [
        row for row in figures[1] if "recorded" in row["controller"]
    ]
    assert main(["replay", str(demo), "--vehicle", "bogie", "--out", str(tmp_path / "out")]) == 2
    assert "of a vehicle with 4 axles, the bogie has 2" in capsys.readouterr().err


# model.json


def model_file(tmp_path, **vehicle):
    described = {"axles": 4, "mass_kg": 52_000.0, "wheelset_inertia_kgm2": 120.0, "wheel_radius_m": 0.46} | vehicle
    path = tmp_path / "model.json"
    path.write_text(json.dumps({"contact": {"kinetic_friction_r": 0.3}, "vehicle": described}), encoding="utf-8")
    return str(path)


def test_the_vehicle_of_a_model_is_braked_with(tmp_path):
    path = model_file(
        tmp_path, axle_positions_m=[3.0, 5.0, 15.0, 17.0], resistance_n=[500.0, 0.0, 4.0], torque_per_bar_nm=2000.0
    )
    vehicle = gym.make("wsp_env/Coach-v1", model=path).unwrapped.batch.vehicle
    assert vehicle.axle_positions_m == (0.0, 2.0, 12.0, 14.0)
    assert (vehicle.mass_kg, vehicle.payload_kg, vehicle.wheel_radius_m) == (52_000.0, COACH.payload_kg, 0.46)
    assert (vehicle.resistance_a_n, vehicle.resistance_c_ns2_per_m2) == (500.0, 4.0)
    assert vehicle.brake == dataclasses.replace(COACH.brake, torque_per_bar_nm=2000.0)
    assert vehicle.contact.kinetic_friction_r == 0.3
    by_hand = gym.make("wsp_env/Coach-v1", model=path, vehicle={"mass_kg": 4e4}).unwrapped.batch.vehicle
    assert by_hand == dataclasses.replace(vehicle, mass_kg=4e4)


def test_the_vehicle_of_a_model_goes_before_the_ids_and_a_named_one_before_both(tmp_path):
    path = model_file(tmp_path)
    with pytest.warns(
        UserWarning, match=r"model\.json brakes, with 4 axles, and not the bogie .* vehicle='bogie' brakes the bogie"
    ):
        assert gym.make("wsp_env/Bogie-v1", model=path).unwrapped.batch.vehicle.axles == 4
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert gym.make("wsp_env/Train-v1", model=path, coaches=3).unwrapped.batch.vehicle.mass_kg == 156_000.0
        named = gym.make("wsp_env/Bogie-v1", model=path, vehicle="bogie").unwrapped.batch.vehicle
    assert named == dataclasses.replace(BOGIE, contact=dataclasses.replace(BOGIE.contact, kinetic_friction_r=0.3))


@pytest.mark.parametrize(
    ("vehicle", "says"),
    [
        ({"axles": 0}, "model .*: CampaignVehicle.axles = 0"),
        ({"axles": 4.5}, r"model .*: axles = 4.5 must be a whole number"),
        ({"mass": 1.0}, "model .*: unknown vehicle parameter mass; valid: axles, mass_kg"),
        ({"mass_kg": "heavy"}, "model .*mass_kg must be a number"),
        ({"axle_positions_m": [0.0, 1.0]}, "model .*2 values for 4 axles"),
        ({"axle_positions_m": 1.0}, "model .*axle_positions_m must be a list"),
        ({"brake_torque_source": 5}, "model .*brake_torque_source = 5 is unknown"),
    ],
)
def test_a_wrong_vehicle_in_a_model_is_refused(tmp_path, vehicle, says):
    with pytest.raises(ParameterError, match=says):
        gym.make("wsp_env/Coach-v1", model=model_file(tmp_path, **vehicle))


def test_a_model_must_say_what_it_describes(tmp_path):
    path = tmp_path / "model.json"
    path.write_text('{"vehicle": {"axles": 4}}', encoding="utf-8")
    with pytest.raises(ParameterError, match="vehicle lacks mass_kg, wheelset_inertia_kgm2, wheel_radius_m"):
        gym.make("wsp_env/Coach-v1", model=str(path))


@pytest.mark.slow
def test_a_campaign_of_three_axles_is_diagnosed_and_its_model_brakes(tmp_path, monkeypatch):
    campaign = campaign_of(tmp_path / "c", 3, monkeypatch, "axle_positions_m = [1.0, 2.8, 4.6]")
    found = diagnose(campaign)
    assert found.verdict in ("adequate", "insufficient")
    path = tmp_path / "model.json"
    path.write_text(json.dumps(found.model), encoding="utf-8")
    vehicle = gym.make("wsp_env/Coach-v1", model=str(path)).unwrapped.batch.vehicle
    assert vehicle.axle_positions_m == pytest.approx((0.0, 1.8, 3.6))
    assert vehicle.mass_kg == campaign.vehicle.mass_kg
