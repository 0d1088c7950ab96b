"""Diagnosis of stops of known truth: what is wrong in a campaign's belief must be found, and nothing else."""

import dataclasses
import html
import json
import re
import shutil
import warnings
from pathlib import Path
from typing import get_args

import gymnasium as gym
import numpy as np
import polars as pl
import pytest
from browser import BROWSER, open_page
from few_stops import few_stops, small_demo
from synthetic_stops import stop, write_campaign

from experiments.concealed.campaign import build, write
from experiments.concealed.interest import sizes
from experiments.concealed.plan import Case
from wsp_env.cli import main
from wsp_env.diagnosis import Diagnosis, diagnose
from wsp_env.diagnosis.answer import Location, Verdict
from wsp_env.diagnosis.balances import VEHICLE, Balances
from wsp_env.diagnosis.baseline import baseline
from wsp_env.diagnosis.effects import course
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import refit
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.stops import prepare
from wsp_env.diagnosis.variation import nuisances
from wsp_env.diagnosis.weights import weigh
from wsp_env.plant.mechanisms import ALL, LIBRARY
from wsp_env.recordings import Campaign, CampaignError, CampaignWarning, demo_campaign, read_campaign

PAGE = Path(__file__).parents[1] / "docs" / "diagnosis.md"
VERDICTS = {"adequate", "named", "ambiguous", "discovered", "unknown", "insufficient", "data"}


def campaign_of(folder: Path) -> Campaign:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CampaignWarning)
        return read_campaign(folder)


def changed(folder: Path, *replacements: tuple[str, str]) -> Campaign:
    """Return the demo campaign with a changed belief."""
    shutil.copytree(demo_campaign(), folder)
    file = folder / "campaign.toml"
    text = file.read_text(encoding="utf-8")
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new)
    file.write_text(text, encoding="utf-8")
    return campaign_of(folder)


@pytest.fixture(scope="module")
def sound() -> Diagnosis:
    """Return what the code on the page of the diagnosis finds in the demo campaign."""
    (block,) = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    names: dict[str, Diagnosis] = {}
    exec(compile(block, str(PAGE), "exec"), names)
    return names["found"]


@pytest.mark.slow
def test_a_sound_campaign_is_adequate_and_says_what_would_have_been_seen(sound):
    assert sound.verdict == "adequate"
    assert sound.mechanisms == ()
    assert sound.location == ()
    assert set(sound.detectable) == set(LIBRARY)
    assert all(value > 0.0 for sizes in sound.detectable.values() for value in sizes.values())


@pytest.mark.slow
def test_the_answer_is_plain_json_with_the_contract_keys(sound):
    plain = json.loads(json.dumps(sound.to_json(), allow_nan=False))
    assert plain["verdict"] in VERDICTS
    assert {"verdict", "mechanisms", "location", "fit", "detectable", "next_test"} <= set(plain)
    assert {"noise_floor", "baseline", "extended", "removed_validate"} <= set(plain["fit"])
    assert set(plain["model"]) == {"tau_m_per_J", "mu_cd", "mechanisms", "contact", "vehicle"}
    # The true tau of the demo campaign is 2.338e-4 m/J, see wsp_env/data/README.md.
    assert plain["model"]["tau_m_per_J"] == pytest.approx(2.338e-4, rel=0.05)


@pytest.fixture(scope="module")
def sloping(tmp_path_factory) -> Path:
    """Return the folder with the diagnosis of a campaign that believes in a gradient that is not there."""
    folder = tmp_path_factory.mktemp("sloping")
    changed(folder / "campaign", ("start_position_m", "gradient = 0.006\nstart_position_m"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CampaignWarning)
        assert main(["diagnose", str(folder / "campaign"), "--out", str(folder / "out")]) == 0
    return folder / "out"


@pytest.mark.slow
def test_a_gradient_that_is_not_there_is_found(sloping, sound):
    found = json.loads((sloping / "diagnosis.json").read_text(encoding="utf-8"))
    assert found["verdict"] in ("named", "ambiguous")
    (one,) = found["mechanisms"]
    assert one["name"] == "track_gradient"
    low, high = one["parameters"]["rise"]["interval90"]
    assert low < -0.006 < high
    assert one["parameters"]["rise"]["value"] == pytest.approx(-0.006, rel=0.2)
    assert found["location"][0]["equation"] == "vehicle"
    # The extension leaves what the sound campaign leaves.
    assert found["fit"]["extended"]["validate"] == pytest.approx(sound.fit.baseline["validate"], rel=0.1)
    # What it changes grows with time, and the recordings lie about it.
    curve = one["curve"]
    assert np.corrcoef(curve["fitted"], curve["observed"])[0, 1] > 0.95
    assert all(run["speed_error_after_mps"] < run["speed_error_before_mps"] for run in found["runs"])


@pytest.mark.slow
def test_what_was_found_brakes_in_the_environment(sloping):
    rise = json.loads((sloping / "model.json").read_text(encoding="utf-8"))["mechanisms"]["track_gradient"]["rise"]
    env = gym.make("wsp_env/Bogie-v1", model=str(sloping / "model.json"))
    env.reset(seed=1)
    batch = env.unwrapped.batch
    assert batch.task.mechanisms["track_gradient"]["rise"] == rise


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no Chromium or Chrome is installed")
def test_report_opens_without_a_network_and_its_plots_have_axes(sloping, tmp_path):
    said, plots, titles = open_page(sloping / "report.html", tmp_path / "profile")
    assert said == []
    assert plots >= 6
    assert "time [s]" in titles
    assert "change of the speed [m/s]" in titles


@pytest.mark.long
@pytest.mark.parametrize(("axles", "measured"), [(1, False), (2, True)])
def test_vehicles_of_one_and_two_axles_torque_by_pressure_or_measured(axles, measured, tmp_path):
    case = Case(0, "null", (), 0.0, 1.0, axles=axles, measured_torque=measured)
    with few_stops():
        setup, _ = build(case, 7, 0, sizes(), 1.0)
        write(tmp_path / "case", case, setup, 7, 0)
    campaign = campaign_of(tmp_path / "case")
    found = diagnose(campaign)
    assert found.verdict == "adequate"
    assert any("leading axle cleaning" in note for note in found.notes) == (axles == 1)
    assert any("the torque itself is measured" in note for note in found.notes) == measured


@pytest.mark.slow
@pytest.mark.long
def test_a_patch_of_another_adhesion_is_found_where_it_is(tmp_path):
    """Friction in the wheels' loop: it is found only if models about different replicas are compared rightly."""
    case = Case(0, "single", ("adhesion_patch",), 4.0, 1.0, axles=2)
    with few_stops():
        setup, (patch,) = build(case, 2, 0, sizes(), 1.0)
        write(tmp_path / "case", case, setup, 2, 0)
    (one,) = diagnose(campaign_of(tmp_path / "case")).mechanisms
    assert one.name == "adhesion_patch"
    low, high = one.parameters["change"].interval90
    assert low < patch.size < high
    middle = one.parameters["start_m"].value + 0.5 * one.parameters["length_m"].value
    assert middle == pytest.approx(patch.place.track_m, abs=5.0)


@pytest.mark.slow
@pytest.mark.long
def test_a_wheelset_of_another_radius_is_found(tmp_path):
    folder = small_demo(tmp_path / "campaign")
    for file in folder.glob("*.csv"):
        table = pl.read_csv(file)
        table.with_columns(pl.col("axle3_wheel_speed_radps") * 1.01, pl.col("axle3_brake_torque_nm") / 1.01).write_csv(file)
    found = diagnose(campaign_of(folder))
    assert found.mechanisms[0].name == "wheel_radius"
    parameters = found.mechanisms[0].parameters
    assert parameters["axle"].value == 3.0
    assert parameters["change"].value == pytest.approx(1.0 / 1.01 - 1.0, abs=5e-4)


@pytest.mark.slow
def test_one_run_alone_and_no_run_to_validate(tmp_path):
    one = write_campaign(tmp_path / "one", {"A1": stop(2e-4, 0.06, noise=1.0)})
    found = diagnose(campaign_of(one))
    assert found.verdict == "adequate"
    # Stops need no null recordings: the answer depends on nothing but the recordings.
    assert diagnose(campaign_of(one), workers=1).to_json() == found.to_json()
    assert found.fit.removed_validate is None  # stretches of the run are held out, and nothing can be removed of them


@pytest.mark.slow
def test_stops_without_sliding_are_insufficient_for_adhesion(tmp_path):
    gentle = {f"A{i}": stop(2e-4, 0.06, speed_mps=30.0 + i, peak=0.001, noise=1.0, seed=i) for i in range(2)}
    found = diagnose(campaign_of(write_campaign(tmp_path / "gentle", gentle)))
    assert found.verdict in ("insufficient", "adequate")
    assert not any("adhesion" in ALL[one.name].signature.balances for one in found.mechanisms)


@pytest.mark.slow
def test_a_torque_that_is_wrong_in_one_run_is_a_matter_of_data(tmp_path):
    folder = small_demo(tmp_path / "campaign")
    table = pl.read_csv(folder / "A3.csv")
    table.with_columns(pl.col("axle2_brake_torque_nm") * 1.8).write_csv(folder / "A3.csv")
    found = diagnose(campaign_of(folder))
    assert found.verdict == "data"
    (one,) = found.suspect_channels
    assert (one.channel, one.runs) == ("axle2_brake_torque", ("A3",))
    assert found.mechanisms == found.discovered == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("column", "rest"), [("axle2_wheel_speed_radps", True), ("vehicle_speed_mps", False)], ids=["a wheel", "the vehicle"]
)
def test_a_channel_that_jumps_and_stays_is_not_diagnosed(column, rest, tmp_path):
    folder = small_demo(tmp_path / "campaign")
    table = pl.read_csv(folder / "A3.csv")
    broken = np.where(np.arange(len(table)) < len(table) // 3, 1.0, 0.5)
    table.with_columns(pl.col(column) * broken).write_csv(folder / "A3.csv")
    with pytest.warns(CampaignWarning, match="not compared with the law"):
        campaign = read_campaign(folder)
    found = diagnose(campaign)
    assert found.verdict == "adequate"
    assert any("jumps" in note and "not compared with the law" in note for note in found.notes)
    assert ("A3" in found.model["mu_cd"]) == rest


def test_too_few_axles_and_too_many(tmp_path):
    campaign = campaign_of(demo_campaign())
    vehicle = dataclasses.replace(campaign.vehicle, axles=3, axle_positions_m=())
    with pytest.raises(CampaignError, match="3 axles"):
        diagnose(dataclasses.replace(campaign, vehicle=vehicle))


def test_verdicts_are_those_of_the_contract():
    assert set(get_args(Verdict)) == VERDICTS


@pytest.fixture(scope="module")
def replica() -> Replica:
    campaign = campaign_of(demo_campaign())
    campaign = dataclasses.replace(campaign, tune=("A1",), validate=("B1",))
    return baseline(Balances(campaign, prepare(campaign)[0]))


def adhesions(balances, model):
    """Measured adhesion, slip, the model's adhesion and its slope (n_wheels,) each, as rows of the wheels."""
    found = []
    for part, one in zip(balances.parts, balances.evaluate(model), strict=True):
        values = (one.force / (2.0 * one.load), one.slip, one.adhesion, one.slope)
        found.append([part.wheel_rows(value) for value in values])
    return map(np.concatenate, zip(*found, strict=True))


def test_residuals_of_the_replica_are_those_of_the_recordings(replica):
    """The vehicle's to rounding; the wheels' linear in the slip, which leaves less than their noise where wheels roll."""
    model, recorded = replica.baseline, replica.recorded
    rows, copied, own = replica.rows, replica.raw(model), recorded.raw(model)
    np.testing.assert_allclose(copied[~rows.wheels], own[~rows.wheels], atol=1e-9)
    rolls = rows.wheels & (rows.slip < 0.005 * rows.speed)
    beyond = (copied - own)[rolls] / replica.whitening(model).deviation[rolls]
    assert np.sqrt(np.mean(beyond**2)) < 0.5


def test_the_replica_balances_itself(replica):
    """Where it rolls its force is what the law gives at its slip: what the recordings' noise did to either is gone."""
    model = replica.baseline
    deviation = replica.whitening(model).deviation[replica.rows.wheels]
    measured, _, expected, _ = adhesions(replica, model)
    recorded, _, law, _ = adhesions(replica.recorded, model)
    rolls = ~replica.rows.slides[replica.rows.wheels]  # in a slide the slip is the one that was foreseen
    assert np.sqrt(np.mean(((measured - expected) / deviation)[rolls] ** 2)) < 0.3
    assert np.sqrt(np.mean(((recorded - law) / deviation) ** 2)) > 0.8


def test_stops_without_noise_by_the_law_leave_nothing(tmp_path):
    """Recordings and replica alike, at the truth; and the truth is what is fitted."""
    campaign = campaign_of(write_campaign(tmp_path, {"A1": stop(2e-4, 0.06), "B1": stop(2e-4, 0.07, speed_mps=30.0)}))
    recorded = Balances(campaign, prepare(campaign)[0])
    true = Model(2e-4, (0.06, 0.07))
    for balances in (recorded, Replica(recorded, true)):
        raw, rows = balances.raw(true), balances.rows
        assert np.sqrt(np.mean(raw[rows.wheels] ** 2)) < 0.02 * 0.06  # of the friction
        assert np.abs(raw[rows.balance == VEHICLE]).max() < 0.01
    found = baseline(recorded).baseline
    assert found.tau == pytest.approx(true.tau, rel=0.03)
    assert found.mu_cd == pytest.approx(true.mu_cd, rel=0.01)


def test_the_course_of_a_held_out_run_is_what_the_law_predicts(replica):
    model = replica.baseline
    slippery = dataclasses.replace(model, mu_cd=tuple(0.8 * mu for mu in model.mu_cd))
    shown = course(replica.recorded, slippery, model)
    assert (shown.run, shown.group) == ("B1", "validate")
    assert len(shown.time_s) == len(shown.adhesion_measured) <= 200
    assert np.all(np.diff(shown.time_s) > 0.0)
    measured, before, after = map(np.array, (shown.adhesion_measured, shown.adhesion_before, shown.adhesion_after))
    assert np.abs(after - measured).mean() < 0.05 * measured.mean()  # the demo campaign is made with this law
    assert before[measured > 0.05].mean() < after[measured > 0.05].mean()
    assert shown.speed_residual_before_mps == shown.speed_residual_after_mps  # the vehicle's balance holds no law


def test_the_course_is_of_a_run_in_which_something_was_found(replica):
    """Held-out stops may be too gentle to show it: a picture of one that it hardly moves would contradict the answer."""
    recorded, model = replica.recorded, replica.baseline
    found = dataclasses.replace(model, choice={"leading_axle_cleaning": {"removal_m_per_j": 2e-5}})
    tuned = next(stop.name for stop in recorded.stops if stop.group == "tune")
    for runs, shown in (((tuned,), tuned), ((tuned, "B1"), "B1"), ((), "B1")):
        where = (Location("adhesion", (2,), runs, "everywhere", 1.0),)
        assert course(recorded, model, found, where).run == shown


def test_the_law_is_found_from_wherever_it_is_sought(replica):
    """Far from it the residuals are no straight lines in tau and mu_cd: the fit must go there, not look from afar."""
    model, whitening = replica.baseline, replica.whitening(replica.baseline)
    weights = weigh(replica, whitening, nuisances(replica, model, replica.raw(model), whitening))
    near = refit(replica, model, (), weights)
    far = dataclasses.replace(model, tau=0.4 * model.tau, mu_cd=tuple(1.4 * mu for mu in model.mu_cd))
    found = refit(replica, far, (), weights)
    assert found.model.tau == pytest.approx(near.model.tau, rel=0.01)
    assert found.model.mu_cd == pytest.approx(near.model.mu_cd, rel=0.005)
    assert found.cost == pytest.approx(near.cost, rel=1e-3)


def test_residuals_do_not_see_the_law_in_the_vehicle_balance(replica):
    """Neither those of the recordings nor those of their replica; the wheels' do."""
    model = replica.baseline
    vehicle = replica.rows.balance == VEHICLE
    slippery = dataclasses.replace(model, tau=2.0 * model.tau, mu_cd=tuple(0.8 * mu for mu in model.mu_cd))
    for balances in (replica, replica.recorded):
        assert np.array_equal(balances.raw(model)[vehicle], balances.raw(slippery)[vehicle])
        assert np.abs(balances.raw(model) - balances.raw(slippery))[replica.rows.wheels].max() > 0.005


@pytest.mark.slow
def test_command_writes_json_model_and_report(tmp_path, capsys):
    folder = write_campaign(
        tmp_path / "campaign",
        {name: stop(2e-4, 0.06, noise=1.0, seed=i) for i, name in enumerate(("A1", "B1"))},
        ["A1"],
        ["B1"],
    )
    assert main(["diagnose", str(folder), "--out", str(tmp_path / "out"), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    assert printed["model"] == json.loads((tmp_path / "out" / "model.json").read_text(encoding="utf-8"))
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert html.escape(printed["sentence"]) in page
    asked = re.findall(r'(?:src|href)="(http[^"]+)"', page)
    assert all("plotly" in one for one in asked)  # nothing is asked of the network but what draws the plots
    assert main(["diagnose", str(folder), "--effort", "0"]) == 2
