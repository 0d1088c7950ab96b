"""Validation: simulated pieces agree with the plant's own physics, the figures of the paper with their definitions."""

import dataclasses
import json

import numpy as np
import pytest
from browser import BROWSER, open_page
from numpy.testing import assert_allclose
from synthetic_stops import stop, write_campaign

from wsp_env.cli import main
from wsp_env.recordings import (
    CampaignError,
    CampaignWarning,
    Smoothing,
    demo_campaign,
    derive,
    read_campaign,
    rolling_radii,
)
from wsp_env.recordings import simulate as simulation
from wsp_env.recordings import validation_report as report
from wsp_env.recordings.validation import ClosedLoop, validate

TAU, MU_CD = 2e-4, 0.06


@pytest.fixture(scope="module")
def exact(tmp_path_factory):
    """A stop that the law itself made, without noise."""
    campaign = read_campaign(write_campaign(tmp_path_factory.mktemp("exact"), {"A1": stop(TAU, MU_CD)}))
    radii = rolling_radii(campaign)
    return campaign, campaign.runs["A1"], derive(campaign, campaign.runs["A1"], radii), radii


@pytest.fixture(scope="module")
def demo():
    return validate(read_campaign(demo_campaign()))


def test_the_recorded_torque_gives_the_recorded_stop_under_its_own_law(exact):
    campaign, run, derived, radii = exact
    starts, samples = simulation.windows(derived, campaign.sample_time_s, Smoothing())
    assert len(starts) > 5
    right = simulation.window_error(
        derived, simulation.simulate(campaign, run, derived, radii, starts, samples, MU_CD, TAU), starts
    )
    classic = simulation.window_error(
        derived, simulation.simulate(campaign, run, derived, radii, starts, samples, MU_CD, 0.0), starts
    )
    rolling = simulation.window_error(derived, simulation.without_slip(campaign, run, derived, radii, starts, samples), starts)
    assert right < 0.05
    assert classic > 10 * right
    assert rolling > 10 * right


def test_pieces_of_other_stops_laws_and_mechanisms_in_one_batch_are_as_they_are_alone():
    campaign = read_campaign(demo_campaign())
    radii, samples = rolling_radii(campaign), 300
    drag = {"aerodynamic_drag": {"c_ns2_per_m2": 8.0}}
    laws = [(0.05, 2e-4, {}), (0.05, 2e-4, drag), (0.06, 0.0, {})]
    runs = list(campaign.runs.values())[:2]
    pieces = [simulation.Piece(run, derive(campaign, run, radii), 200, *law) for run in runs for law in laws]
    together = simulation.simulate_pieces(campaign, pieces, radii, samples)
    for index, one in enumerate(pieces):
        run, derived, start, *law = one
        alone = simulation.simulate(campaign, run, derived, radii, np.array([start]), samples - 50, *law)
        piece = together.piece(index, samples - 50)
        assert_allclose(piece.speed_mps, alone.speed_mps, rtol=1e-9)
        assert_allclose(piece.circumferential_mps, alone.circumferential_mps, atol=1e-7)
    assert together.speed_mps[1, -1] < together.speed_mps[0, -1] - 0.1  # the drag slows it


def test_windows_lie_side_by_side_where_the_vehicle_is_fast(exact):
    campaign, _, derived, _ = exact
    starts, samples = simulation.windows(derived, campaign.sample_time_s, Smoothing(least_speed_mps=28.0))
    assert samples == 100
    assert (np.diff(starts) >= samples).all()
    assert derived.speed_mps[starts + samples - 1].min() > 28.0


def test_without_slip_momentum_is_what_the_brakes_take(exact):
    campaign, run, derived, radii = exact
    n = len(run.time_s) - 1
    rolled = simulation.without_slip(campaign, run, derived, radii, np.array([0]), n)
    mass = run.mass_kg + (campaign.vehicle.wheelset_inertia_kgm2 / radii**2).sum()
    taken = np.trapezoid((run.brake_torque_nm[:n] / radii).sum(axis=1), dx=campaign.sample_time_s)
    assert_allclose(mass * (rolled.speed_mps[0, 0] - rolled.speed_mps[0, -1]), taken, rtol=1e-9)


def test_slide_statistics_are_those_of_the_paper(exact):
    _, _, derived, _ = exact
    n = 400
    speed = derived.speed_mps[100 : 100 + n] + np.linspace(0.0, 0.5, n)
    wheel = np.repeat((speed - 2.0)[:, None], 4, axis=1)
    wheel[::2] -= 1.0
    figures = simulation.slide(derived, simulation.Simulated(speed[None], wheel[None]), 100)
    assert figures.speed_error_mps == pytest.approx(0.5)  # eq. (19)
    assert_allclose(figures.simulated_mean_mps, 2.5)  # eqs. (20) and (21): s is 2 and 3 in turns
    assert_allclose(figures.simulated_deviation_mps, 0.5)
    assert_allclose(figures.recorded_mean_mps, derived.slip_speed_mps[100 : 100 + n].mean(axis=0))


def test_axles_that_were_not_recorded(exact):
    campaign = exact[0]
    with pytest.raises(CampaignError, match=r"says 3 axles, but run A1 has wheel speeds of shape \(\d+, 4\)"):
        dataclasses.replace(campaign, vehicle=dataclasses.replace(campaign.vehicle, axles=3))


def test_the_demo_campaign_meets_the_papers_figures(demo):
    assert demo.verdict.startswith("The law tuned on A1, A3, A5 meets all")
    for found in demo.stops.values():
        assert found.window_rms_mps["tuned"] < 0.1
        assert found.window_rms_mps["tuned"] < min(found.window_rms_mps[rival] for rival in ("classic", "no_slip")) / 5
        assert found.window_rms_mps["classic_refitted"] <= found.window_rms_mps["classic"]


def test_a_wrong_law_is_said_to_do_worse(tmp_path):
    runs = {"A1": stop(TAU, MU_CD), "B1": stop(8e-4, 0.03)}
    found = validate(read_campaign(write_campaign(tmp_path, runs, ["A1"], ["B1"])))
    assert "worse than the seed paper's own figures in: relative adhesion error" in found.verdict
    assert not found.criteria[0].met


def test_nothing_is_called_validated_that_is_not(demo):
    alone = dataclasses.replace(demo, campaign=dataclasses.replace(demo.campaign, validate=()))
    assert "meets all" in alone.verdict
    assert alone.verdict.endswith("this validates nothing.")
    assert "only scored" not in report.criteria_table(alone).caption
    open_ = dataclasses.replace(demo, tuning=dataclasses.replace(demo.tuning, interval95=(0.0, np.inf)))
    assert open_.verdict.startswith("Nothing is validated: tau is open")


def test_runs_that_roll_say_nothing(tmp_path):
    runs = {"A1": stop(TAU, MU_CD), "B1": stop(TAU, MU_CD, peak=0.002)}
    assert "say nothing" in validate(read_campaign(write_campaign(tmp_path, runs, ["A1"], ["B1"]))).verdict


def test_runs_without_braking_or_speed_are_no_trouble(tmp_path):
    coasting = stop(TAU, MU_CD, noise=1.0)
    coasting = {name: values * (0.0 if "torque" in name else 1.0) for name, values in coasting.items()}
    coasting |= {name: values[:90] for name, values in coasting.items()}
    crawling = stop(TAU, MU_CD, speed_mps=4.0, duration_s=2.0, noise=1.0)
    folder = write_campaign(tmp_path, {"A1": stop(TAU, MU_CD), "B1": coasting, "B2": crawling}, ["A1"], ["B1", "B2"])
    with pytest.warns(CampaignWarning, match=r"never changes|never faster"):
        found = validate(read_campaign(folder))
    assert found.stops["B2"].window_rms_mps == {}
    report.write(tmp_path / "page.html", found)
    assert (tmp_path / "page.html").exists()


def test_command_prints_json(demo, capsys):
    assert main(["validate", str(demo_campaign()), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads(json.dumps(demo.to_json()))
    assert printed["criteria"][0]["met"] is True
    assert set(printed["runs"]["A1"]) >= {"mu_cd", "error", "window_rms_mps", "speed_error_mps", "recorded_mean_mps"}


def test_command_writes_a_page_that_stands_alone(demo, tmp_path, capsys):
    page = tmp_path / "sub" / "validation.html"
    assert main(["validate", str(demo_campaign()), "--out", str(page), "--standalone"]) == 0
    printed = capsys.readouterr().out
    assert demo.verdict[:40] in printed.replace("\n", " ")
    text = page.read_text(encoding="utf-8")
    assert "<script src=" not in text
    assert "<link" not in text
    for shown in ("energy W_sp [J", "adhesion coefficient [-]", "speed [m", "time [s]", "f_d, degraded", demo.verdict[:40]):
        assert shown in text


def test_closed_loop_statistics_are_each_stops_own():
    recorded = np.array([[1.0, 2.0], [3.0, 2.0]])
    simulated = np.array([[0.0, 5.0], [3.0, 5.0], [6.0, 5.0]])  # stops last as long as they last
    found = ClosedLoop.of(recorded, simulated)
    assert found.recorded_mean_mps == (2.0, 2.0)
    assert found.recorded_deviation_mps == (1.0, 0.0)
    assert found.simulated_mean_mps == (3.0, 5.0)
    assert found.simulated_deviation_mps == (pytest.approx(np.sqrt(6.0)), 0.0)


@pytest.mark.long
def test_command_brakes_in_closed_loop(demo, tmp_path, capsys, monkeypatch):
    assert main(["validate", str(demo_campaign()), "--controller", "rule-based", "--json"]) == 0
    closed = json.loads(capsys.readouterr().out)["closed_loop"]
    assert closed["controller"] == "rule-based"
    assert "(20) and (21), only" in closed["compared_by"]
    for name, found in closed["runs"].items():
        assert_allclose(found["recorded_mean_mps"], demo.stops[name].slide.recorded_mean_mps, rtol=0.01)
    assert max(closed["runs"]["A5"]["simulated_mean_mps"]) < 2.0 < min(closed["runs"]["A5"]["recorded_mean_mps"])  # no WSP
    monkeypatch.setenv("COLUMNS", "200")
    page = tmp_path / "page.html"
    assert main(["validate", str(demo_campaign()), "--controller", "none", "--out", str(page)]) == 0
    assert "never sample by sample" in capsys.readouterr().out
    assert "never sample by sample" in page.read_text(encoding="utf-8")


@pytest.mark.long
def test_a_controller_that_ends_its_process_is_named(tmp_path):
    file = tmp_path / "dies.py"
    file.write_text("class Dies:\n    def reset(self, n, vehicle):\n        __import__('os')._exit(3)\n\n    act = reset\n")
    with pytest.raises(SystemExit, match=r"dies\.py failed: ended the process it ran in, twice"):
        main(["validate", str(demo_campaign()), "--controller", str(file), "--json"])


def test_controllers_that_cannot_brake_here(tmp_path, capsys):
    assert main(["validate", str(demo_campaign()), "--controller", "rule-based", "--fixed-mu-cd"]) == 2
    assert "leave out --fixed-mu-cd" in capsys.readouterr().err
    assert main(["validate", str(demo_campaign()), "--controller", "nobody", "--json"]) == 2


@pytest.mark.long
@pytest.mark.skipif(BROWSER is None, reason="no Chromium installed")
def test_the_page_opens_without_a_network_and_all_axes_have_units(demo, tmp_path):
    report.write(tmp_path / "validation.html", demo)
    said, plots, titles = open_page(tmp_path / "validation.html", tmp_path / "profile")
    assert said == []
    assert plots == 3 + 2 * len(demo.stops)
    assert all(title.endswith("]") for title in titles), titles
