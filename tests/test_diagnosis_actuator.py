"""The actuator's balance: torques and cylinder pressures, both measured, show what the brakes do without any contact model."""

import dataclasses
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from synthetic_stops import RADIUS_M, stop, write_campaign

from wsp_env.diagnosis import Diagnosis, diagnose
from wsp_env.diagnosis.balances import ACTUATOR, Balances
from wsp_env.diagnosis.baseline import baseline
from wsp_env.diagnosis.candidates import unavailable
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.stops import prepare, torque_per_bar
from wsp_env.diagnosis.variation import nuisances
from wsp_env.recordings import Campaign, read_campaign

PER_BAR_NM = 3000.0
SOUND = (1.005, 0.997, 1.0, 0.994)  # gains of the axles' brakes, within the normal 1 %
PADS = -0.004  # change of the pads' friction by speed [s/m]


def campaign_with(folder: Path, gains: tuple[float, ...] = SOUND, per_speed: float = 0.0, spring_nm: float = 0.0) -> Campaign:
    """Stops with measured torques, and the pressures of brakes with these gains, pads and springs that needed them."""
    runs = {}
    for i, name in enumerate(("A1", "A2", "B1")):
        speed = 30.0 + 2.0 * i
        columns, true = (stop(2e-4, 0.06, speed, duration_s=9.0, noise=noise, seed=i) for noise in (1.0, 0.0))
        rng = np.random.default_rng([i, 7])
        for k, gain in enumerate(gains):
            torque, wheel = (true[f"axle{k + 1}_{channel}"] for channel in ("brake_torque_nm", "wheel_speed_radps"))
            factor = gain * (1.0 + per_speed * (RADIUS_M * wheel - 20.0))
            noise = 0.005 * rng.standard_normal(len(torque))
            columns[f"axle{k + 1}_cylinder_pressure_bar"] = (torque + spring_nm) / (PER_BAR_NM * factor) + noise
        runs[name] = columns
    return read_campaign(write_campaign(folder, runs, ["A1", "A2"], ["B1"]))


def found_in(campaign: Campaign) -> Diagnosis:
    return diagnose(campaign)


def test_the_nominal_gain_is_that_of_all_axles_and_its_residual_is_what_the_gains_differ_by(tmp_path):
    campaign = campaign_with(tmp_path / "c")
    assert torque_per_bar(campaign) == pytest.approx(PER_BAR_NM * np.mean(SOUND), rel=2e-3)
    balances = Balances(campaign, prepare(campaign)[0])
    assert unavailable(balances) == {}
    model = baseline(balances).baseline
    raw, deviation = balances.raw(model), balances.whitening(model).deviation
    stops = balances.evaluate(model)
    for k, gain in enumerate(SOUND):
        mine = (balances.rows.balance == ACTUATOR) & (balances.rows.axle == k)
        braking = np.concatenate([part.wheel_rows(one.braking) for part, one in zip(balances.parts, stops, strict=True)])
        expected = (gain * PER_BAR_NM / torque_per_bar(campaign) - 1.0) * braking[balances.rows.axle[balances.rows.wheels] == k]
        assert np.std((raw[mine] - expected) / deviation[mine]) == pytest.approx(1.0, abs=0.3)


@pytest.mark.parametrize(("share", "used"), [(0.85, True), (1.2, True), (10.0, False), (0.1, False)])
def test_a_nominal_gain_that_is_stated_is_used_if_it_is_possible(tmp_path, share, used):
    """Two axles cannot tell whether one is weaker or the other stronger; what the brakes should give tells it."""
    measured = campaign_with(tmp_path / "c")
    campaign = dataclasses.replace(
        measured, vehicle=dataclasses.replace(measured.vehicle, torque_per_bar_nm=share * PER_BAR_NM)
    )
    assert torque_per_bar(campaign) == (share * PER_BAR_NM if used else torque_per_bar(measured))
    balances = Balances(campaign, prepare(campaign)[0])
    model = baseline(balances).baseline
    groups = nuisances(balances, model, balances.raw(model), balances.whitening(model))
    expected = next(one.expected for one in groups if one.name == "nominal gain of the brakes")
    assert np.isfinite(expected) == used


def test_pressures_alone_or_torques_alone_have_no_actuator_balance(tmp_path):
    campaign = campaign_with(tmp_path / "c")
    file = tmp_path / "c" / "campaign.toml"
    text = file.read_text(encoding="utf-8")
    source = 'brake_torque_source = "cylinder pressure times the nominal gain"'
    file.write_text(text.replace('brake_torque_source = "measured"', source), encoding="utf-8")
    computed = read_campaign(tmp_path / "c")
    assert all(one.pressed is None for one in prepare(computed)[0])
    assert not computed.vehicle.torque_is_measured
    assert campaign.vehicle.torque_is_measured


@pytest.mark.slow
def test_sound_brakes_are_adequate(tmp_path):
    found = found_in(campaign_with(tmp_path / "c"))
    assert found.verdict == "adequate"
    assert {"pad_friction", "brake_gain_imbalance"} <= set(found.detectable)


@pytest.mark.long
def test_pads_that_fade_with_speed_are_named_from_the_actuator_alone(tmp_path):
    found = found_in(campaign_with(tmp_path / "c", per_speed=PADS))
    (one,) = found.mechanisms
    assert one.name == "pad_friction"
    low, high = one.parameters["per_speed_s_per_m"].interval90
    assert low < PADS < high
    assert {place.equation for place in found.location} == {"actuator"}
    assert found.fit.removed_validate == pytest.approx(1.0, abs=0.05)


@pytest.mark.long
def test_one_weak_brake_is_named_with_its_axle(tmp_path):
    found = found_in(campaign_with(tmp_path / "c", (1.0, 0.94, 1.0, 1.0)))
    (one,) = found.mechanisms
    assert one.name == "brake_gain_imbalance"
    assert one.parameters["axle"].value == 2.0
    low, high = one.parameters["gain"].interval90
    assert low < -0.06 < high
    assert found.location[0].equation == "actuator"
    assert found.location[0].axles == (2,)


@pytest.mark.slow
@pytest.mark.long
def test_a_return_spring_is_normal_and_hides_nothing(tmp_path):
    """Every cylinder has one: its torque over the pressure is a line that does not pass through zero."""
    assert found_in(campaign_with(tmp_path / "c", spring_nm=300.0)).verdict == "adequate"
    (one,) = found_in(campaign_with(tmp_path / "d", per_speed=PADS, spring_nm=300.0)).mechanisms
    assert one.name == "pad_friction"
    low, high = one.parameters["per_speed_s_per_m"].interval90
    assert low < PADS < high


@pytest.mark.long
def test_a_misfit_that_nothing_describes_is_not_adequate(tmp_path):
    """One axle's gauge swings by a fifth, 1.3 times a second, in every run."""
    campaign_with(tmp_path / "c")
    for file in (tmp_path / "c").glob("*.csv"):
        table = pl.read_csv(file)
        swing = 1.0 + 0.2 * (2.0 * np.pi * 1.3 * pl.col("time_s")).sin()
        pressure = pl.col("axle3_cylinder_pressure_bar")
        table.with_columns((swing * pressure).alias("axle3_cylinder_pressure_bar")).write_csv(file)
    found = found_in(read_campaign(tmp_path / "c"))
    assert found.verdict == "unknown"
    assert found.location[0].equation == "actuator"


def test_a_dead_pressure_channel_is_told_and_not_compared(tmp_path):
    campaign_with(tmp_path / "c", per_speed=PADS)
    file = tmp_path / "c" / "A2.csv"
    table = pl.read_csv(file)
    table.with_columns(pl.lit(0.0).alias("axle3_cylinder_pressure_bar")).write_csv(file)
    stops, notes = prepare(read_campaign(tmp_path / "c"))
    assert [one.pressed is None for one in stops] == [False, True, False]
    assert any("A2" in note and "axle 3" in note for note in notes)


@pytest.mark.parametrize("pressures", [True, False])
def test_a_brake_beside_the_calipers_is_in_no_measured_torque(tmp_path, pressures):
    """An electrodynamic brake holds the wheel; neither the calipers' torque nor their pressure knows of it."""
    campaign = campaign_with(tmp_path / "c")
    if not pressures:
        runs = {name: dataclasses.replace(run, cylinder_pressure_bar=None) for name, run in campaign.runs.items()}
        campaign = dataclasses.replace(campaign, runs=runs)
    balances = Balances(campaign, prepare(campaign)[0])
    assert "blended_brake" not in unavailable(balances)
    assert ("pad_friction" in unavailable(balances)) == (not pressures)
    law = Model(2e-4, (0.06,) * 3)
    on = dataclasses.replace(law, choice={"blended_brake": {"torque_nm": 700.0, "blending_mps": 5.0, "axle": 2.0}})
    for stop_, before, after in zip(balances.stops, balances.evaluate(law), balances.evaluate(on), strict=True):
        more = after.torque - before.torque
        braked = stop_.torque[:, 1] > 0.1 * stop_.torque.max()
        np.testing.assert_allclose(more[braked, 1], 700.0)
        assert not more[:, [0, 2, 3]].any()
        np.testing.assert_allclose((after.force - before.force) * RADIUS_M, more, atol=1e-6)
        if pressures:
            np.testing.assert_allclose(after.braking, before.braking)
