"""Derived quantities and tuning: the equations' identities, and known truths found again."""

import dataclasses
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from synthetic_stops import MASS_KG, RADIUS_M, SAMPLE_S, WHEEL_LOAD_N, creepages, stop, stops, write_campaign

from wsp_env.cli import main
from wsp_env.contact.degraded import degraded_adhesion
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.velim import CONTACT
from wsp_env.recordings import (
    CampaignError,
    CampaignWarning,
    RunScore,
    Smoothing,
    Tuning,
    demo_campaign,
    derive,
    limits,
    read_campaign,
    rolling_radii,
    transition,
    tune,
)
from wsp_env.recordings.bootstrap import Blocks, interval95
from wsp_env.recordings.tuning import warn_of_errors
from wsp_env.recordings.validation_report import adhesion_table

#: wsp_env/data/README.md: what the demo campaign was made with.
DEMO_TAU = 2.338e-4
DEMO_MU_CD = {"A1": 0.05791, "A3": 0.06082, "A5": 0.05100, "B1": 0.05759, "B2": 0.05897}

TRUE_TAU = 1.9e-4
TRUE_MU_CD = {"A1": 0.055, "A2": 0.066, "B1": 0.058}


@pytest.fixture(scope="module")
def exact(tmp_path_factory):
    runs = {name: stop(TRUE_TAU, mu_cd) for name, mu_cd in TRUE_MU_CD.items()}
    return read_campaign(write_campaign(tmp_path_factory.mktemp("exact"), runs, ["A1", "A2"], ["B1"]))


@pytest.fixture(scope="module")
def demo():
    campaign = read_campaign(demo_campaign())
    return campaign, tune(campaign)


def test_derived_quantities_satisfy_their_equations(exact):
    run = exact.runs["A1"]
    d = derive(exact, run, rolling_radii(exact))
    speed = d.speed_mps[:, None]
    assert_allclose(d.normal_load_n, WHEEL_LOAD_N)
    assert_allclose(d.slip_speed_mps, d.creepage * speed, atol=1e-12)  # eq. (2)
    assert_allclose(d.contact_force_n, d.adhesion * d.normal_load_n)  # eq. (1)
    assert_allclose(d.energy_jpm, d.contact_force_n * d.creepage)  # eq. (1)
    f_d, f_r = limits(d, 0.055, CONTACT.law)
    share = transition(d, 0.055, CONTACT.law)
    assert_allclose(((1.0 - share) * f_d + share * f_r)[d.usable], d.adhesion[d.usable])  # eq. (3)


def test_derived_quantities_are_those_that_the_stop_was_made_with(exact):
    run = exact.runs["A1"]
    d = derive(exact, run, np.full(4, RADIUS_M))
    creepage = creepages(run.time_s, 0.25)
    law = degraded_adhesion(creepage * d.speed_mps[:, None], d.speed_mps[:, None], WHEEL_LOAD_N, 0.055, TRUE_TAU, CONTACT.law)
    usable = d.usable
    assert usable.sum() > 1000
    assert_allclose(d.creepage[usable], creepage[usable], atol=2e-4)
    assert_allclose(d.adhesion[usable], law[usable], atol=1e-3)
    assert_allclose(
        transition(d, 0.055, CONTACT.law)[usable], 1 - np.exp(-TRUE_TAU * d.energy_jpm[usable]), atol=5e-3
    )  # eq. (4)
    inside = slice(250, -50)  # the onset is sharper than the long filter of the vehicle
    assert_allclose(-MASS_KG * d.acceleration_mps2[inside], 2 * d.contact_force_n[inside].sum(axis=1), rtol=5e-3)


def test_filter_leaves_a_parabola_and_its_slope_as_they_are(exact):
    run = exact.runs["A1"]
    time = run.time_s
    columns = {"time_s": time, "vehicle_speed_mps": 30.0 - time - 0.05 * time**2}
    for k in range(1, 5):
        columns[f"axle{k}_wheel_speed_radps"] = columns["vehicle_speed_mps"] / RADIUS_M
        columns[f"axle{k}_brake_torque_nm"] = 1000.0 + 10.0 * time
    parabola = type(run)(
        "P", time, columns["vehicle_speed_mps"], np.stack([columns[f"axle{k}_wheel_speed_radps"] for k in range(1, 5)], 1),
        np.stack([columns[f"axle{k}_brake_torque_nm"] for k in range(1, 5)], 1), 0.0, MASS_KG, 0.06,
    )  # fmt: skip
    d = derive(exact, parabola, np.full(4, RADIUS_M))
    assert_allclose(d.speed_mps, columns["vehicle_speed_mps"], rtol=1e-12)
    assert_allclose(d.acceleration_mps2, -1.0 - 0.1 * time, rtol=1e-9)
    assert_allclose(d.slip_speed_mps, 0.0, atol=1e-9)


def test_worn_wheels_are_measured_while_they_roll(exact):
    worn = RADIUS_M * np.array([1.0, 0.985, 1.01, 1.0])
    runs = {
        name: type(run)(**{**vars(run), "wheel_speed_radps": run.wheel_speed_radps * RADIUS_M / worn})
        for name, run in exact.runs.items()
    }
    campaign = type(exact)(**{**vars(exact), "runs": runs})
    assert_allclose(rolling_radii(campaign), worn, rtol=2e-4)


def test_a_speed_in_another_unit_is_not_taken_for_a_worn_wheel(exact):
    runs = {
        name: type(run)(**{**vars(run), "vehicle_speed_mps": 3.6 * run.vehicle_speed_mps}) for name, run in exact.runs.items()
    }
    with pytest.raises(CampaignError, match="check the units of vehicle_speed_mps"):
        tune(type(exact)(**{**vars(exact), "runs": runs}))


def test_exact_recordings_give_the_truth_back(exact):
    tuning = tune(exact)
    assert_allclose(tuning.tau_m_per_J, TRUE_TAU, rtol=5e-3)
    for name, mu_cd in TRUE_MU_CD.items():
        assert_allclose(tuning.runs[name].mu_cd, mu_cd, rtol=5e-3)
        assert max(tuning.runs[name].error) < 0.01
    assert [score.group for score in tuning.runs.values()] == ["tune", "tune", "validate"]


@pytest.mark.long
@settings(max_examples=6)
@given(tau=st.floats(0.8e-4, 4e-4), mu_cd=st.floats(0.03, 0.09), noise=st.floats(0.0, 2.0), seed=st.integers(0, 2**31))
def test_any_truth_is_found_through_sensor_noise(tmp_path_factory, tau, mu_cd, noise, seed):
    runs = dict(zip(("A1", "A2"), stops(tau, [mu_cd, 1.1 * mu_cd], noise=noise, seeds=(seed, seed + 1)), strict=True))
    tuning = tune(read_campaign(write_campaign(tmp_path_factory.mktemp("noisy"), runs)))
    assert_allclose(tuning.tau_m_per_J, tau, rtol=0.03)
    assert_allclose(tuning.runs["A1"].mu_cd, mu_cd, rtol=0.05)
    assert tuning.interval95[0] < tuning.tau_m_per_J < tuning.interval95[1]


def test_a_torque_computed_from_pressures_widens_the_interval(exact):
    """The gain of the brake is uncertain where a nominal one made the torque."""

    def interval(**changes):
        return tune(dataclasses.replace(exact, vehicle=dataclasses.replace(exact.vehicle, **changes))).interval95

    measured = interval()
    modelled = interval(brake_torque_source="cylinder pressure times the nominal gain")
    assert interval(torque_per_bar_nm=2500.0) == measured
    assert modelled[0] < measured[0] < measured[1] < modelled[1]


@pytest.mark.long
def test_interval_of_tau_covers_the_truth_as_often_as_it_says(tmp_path):
    """On rails whose mu_cd varies along the track; 95 % of 40 leaves at least 33 with a probability of 0.999."""
    made = stops(TRUE_TAU, [0.055, 0.066] * 40, noise=1.0, seeds=range(80), uneven=0.02)
    covered = 0
    for k in range(40):
        campaign = read_campaign(write_campaign(tmp_path / str(k), {"A1": made[2 * k], "A2": made[2 * k + 1]}))
        low, high = tune(campaign).interval95
        covered += low < TRUE_TAU < high
        assert high < 1.2 * low
    assert covered >= 33


def test_one_step_is_the_whole_way_where_the_model_is_linear():
    random = np.random.default_rng(3)
    jacobian, measured, sensitivity = random.normal(size=(60, 2)), random.normal(size=60), random.normal(size=60)
    block, gain = np.arange(60) // 10, np.arange(60) % 4
    solution = np.linalg.lstsq(jacobian, -measured, rcond=None)[0]
    residuals = measured + jacobian @ solution
    weights, errors = np.array([[2.0, 0.0, 1.0, 3.0, 0.0, 1.0]]), random.normal(size=(1, 4))
    steps = Blocks.of(jacobian, residuals, block, gain, sensitivity).steps(weights, errors)
    root = np.sqrt(weights[0][block])
    again = np.linalg.lstsq(root[:, None] * jacobian, -root * (measured + sensitivity * errors[0][gain]), rcond=None)[0]
    assert_allclose(solution + steps[0], again, rtol=1e-9)


def test_interval_of_a_mean_is_the_textbooks():
    """Blocks of one sample and the mean: two-sided, t-distributed, and wider by what is not known of the gain."""
    sample = np.random.default_rng(5).normal(size=400)
    sample -= sample.mean()
    one = np.ones(400)
    known = Blocks.of(-one[:, None], sample, np.arange(400), np.zeros(400, dtype=int), one)
    deviation = sample.std(ddof=1) / 20.0
    assert_allclose(
        interval95(known, 0.0), (-1.966 * deviation, 1.966 * deviation), rtol=0.1
    )  # 3 % is the quantile's own deviation
    unknown = 1.96 * np.hypot(deviation, 0.05 / np.sqrt(3.0))
    assert_allclose(interval95(known, 0.05), (-unknown, unknown), rtol=0.1)


def test_the_validate_group_never_moves_tau(exact, tmp_path):
    other = {"A1": stop(TRUE_TAU, 0.055), "A2": stop(TRUE_TAU, 0.066), "B1": stop(4e-4, 0.03)}
    tuning = tune(read_campaign(write_campaign(tmp_path, other, ["A1", "A2"], ["B1"])))
    assert tuning.tau_m_per_J == tune(exact).tau_m_per_J
    assert min(tuning.runs["B1"].error) > 0.05  # and a stop under another law is found out


def test_known_friction_may_be_kept(tmp_path):
    campaign = read_campaign(write_campaign(tmp_path, {"A1": stop(TRUE_TAU, CONTACT.kinetic_friction_d)}))
    tuning = tune(campaign, tune_friction=False)
    assert tuning.runs["A1"].mu_cd == CONTACT.kinetic_friction_d
    assert_allclose(tuning.tau_m_per_J, TRUE_TAU, rtol=5e-3)


def test_a_stop_without_sliding_says_nothing(tmp_path):
    rolling = stop(TRUE_TAU, 0.06, peak=0.002)
    both = read_campaign(write_campaign(tmp_path / "both", {"A1": stop(TRUE_TAU, 0.055), "A2": rolling}))
    score = tune(both).runs["A2"]
    assert score.error == (None,) * 4
    assert score.mu_cd == CONTACT.kinetic_friction_d
    with pytest.raises(CampaignError, match="no run to tune on"):
        tune(read_campaign(write_campaign(tmp_path / "none", {"A1": rolling})))


def test_a_recording_shorter_than_the_filter(tmp_path):
    with pytest.raises(CampaignError, match="run A1 has 20 samples"):
        tune(read_campaign(write_campaign(tmp_path, {"A1": stop(TRUE_TAU, 0.06, duration_s=20 * SAMPLE_S, noise=1.0)})))


def test_demo_campaign_gives_its_truth_back(demo):
    _, tuning = demo
    assert_allclose(tuning.tau_m_per_J, DEMO_TAU, rtol=0.03)
    low, high = tuning.interval95
    assert low < DEMO_TAU < high < 1.1 * low
    assert set(tuning.runs) == set(DEMO_MU_CD)
    for name, score in tuning.runs.items():
        assert_allclose(score.mu_cd, DEMO_MU_CD[name], rtol=0.05)
        assert max(score.error) < 0.025


def test_tau_hardly_depends_on_the_filter(demo):
    campaign, tuning = demo
    for smoothing in (Smoothing(vehicle_window_s=0.3), Smoothing(wheel_window_s=0.2)):
        assert_allclose(tune(campaign, smoothing).tau_m_per_J, tuning.tau_m_per_J, rtol=0.02)


def test_impossible_filter():
    with pytest.raises(ParameterError, match="wheel_window_s"):
        Smoothing(wheel_window_s=-1.0)


def test_command_prints_json(demo, capsys):
    assert main(["tune", str(demo_campaign()), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    tuning = demo[1]
    assert printed == {
        "tau_m_per_J": tuning.tau_m_per_J,
        "interval95": list(tuning.interval95),
        "determined": True,
        "runs": {
            name: {"group": score.group, "mu_cd": score.mu_cd, "mu_cd_tuned": True, "error": list(score.error)}
            for name, score in tuning.runs.items()
        },
    }


def test_a_tau_that_the_runs_leave_open_is_said(demo):
    """Where wheels hardly slide, recovery cannot be distinguished from a rail with more friction."""
    weak = dataclasses.replace(demo[0], tune=("A1", "A3"))
    with pytest.warns(CampaignWarning, match="the runs to tune on do not determine it"):
        tuning = tune(weak)
    assert not tuning.determined
    assert tuning.interval95 == (0.0, np.inf)
    assert json.loads(json.dumps(tuning.to_json(), allow_nan=False))["interval95"] == [0.0, None]


def test_command_prints_a_table(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "110")  # of a terminal that shows every column
    assert main(["tune", str(demo_campaign()), "--fixed-mu-cd"]) == 0
    printed = capsys.readouterr().out
    for expected in ("tau =", "axle 4 [%]", "validate", "0.0587*", "as believed"):
        assert expected in printed


def test_command_says_what_is_wrong(tmp_path, capsys):
    assert main(["tune", str(tmp_path)]) == 2
    assert "campaign.toml does not exist" in capsys.readouterr().err


def test_an_axle_that_no_law_could_miss_so_far_is_told():
    runs = {"A1": RunScore("tune", 0.06, True, (0.02, 0.51, None)), "B1": RunScore("validate", 0.06, True, (0.49, 0.1, 0.2))}
    tuning = Tuning(2e-4, (1.9e-4, 2.1e-4), runs)
    with pytest.warns(CampaignWarning, match=r"run A1, axle 2: .* by 51 %") as said:
        warn_of_errors(tuning)
    assert len(said) == 1


def test_an_axle_without_a_sensor_is_not_said_to_roll():
    runs = {"A1": RunScore("tune", 0.06, True, (0.02, None, None), missing_axles=(3,))}
    table = adhesion_table(Tuning(2e-4, (1.9e-4, 2.1e-4), runs))
    assert table.rows[0][-3:] == ("2.0", "no slide", "no sensor")
