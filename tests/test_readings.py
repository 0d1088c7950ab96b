"""Recordings whose speeds were read late are put right, and compared with those as they were read."""

import dataclasses

import numpy as np
import pytest
from scipy import linalg
from test_diagnosis_replica import LAW, campaign_of

from wsp_env.diagnosis.balances import Balances, Whitening
from wsp_env.diagnosis.candidates import Variant, values_in
from wsp_env.diagnosis.evaluate import Evaluator, Model
from wsp_env.diagnosis.fitting import refit
from wsp_env.diagnosis.gls import Projector
from wsp_env.diagnosis.readings import _filtered, correct_readings, readings_of, simulate_readings
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.stops import prepare
from wsp_env.diagnosis.variation import Group
from wsp_env.diagnosis.weights import Weights, weigh

LAG_S = 0.04
LAG = {"wheel_speed_lag": {"lag_s": LAG_S}}
CLOCK = {"clock_offset": {"offset_s": 0.15}}
LATE = dataclasses.replace(LAW, choice=LAG)


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    campaign = campaign_of(tmp_path_factory.mktemp("sound") / "c")
    return Balances(campaign, prepare(campaign)[0])


def late_wheels(balances: Balances) -> Balances:
    """Return the stops with wheel speeds that pass a filter of first order, and their rates with them."""

    def late(stop):
        wheels = ("wheel", "wheel_rate", "wheel_jerk")
        return dataclasses.replace(stop, **{name: _filtered(getattr(stop, name), LAG_S, stop.step_s) for name in wheels})

    return balances.like([late(stop) for stop in balances.sources])


def test_a_lag_filters_a_line_and_a_swing_as_its_equation_says():
    time, omega = np.arange(0.0, 4.0, 0.01), 5.0
    line = 3.0 - 2.0 * time
    np.testing.assert_allclose(_filtered(line, LAG_S, 0.01), line + 2.0 * LAG_S, atol=1e-12)
    swing = _filtered(np.sin(omega * time)[:, None], LAG_S, 0.01)[200:, 0]
    expected = np.sin(omega * time[200:] - np.arctan(LAG_S * omega)) / np.hypot(1.0, LAG_S * omega)
    np.testing.assert_allclose(swing, expected, atol=5e-4)


@pytest.mark.parametrize("readings", [LAG, CLOCK, LAG | CLOCK, {"misread_speed": {"coefficient": 0.01, "feature": 1.0}}])
def test_of_stops_as_sensors_read_them_a_model_with_the_sensors_says_what_it_says_of_true_ones(sound, readings):
    stops = simulate_readings(sound.campaign, sound.sources, readings)
    model = dataclasses.replace(LAW, choice=readings)
    assert readings_of(model) == readings
    for read, true in zip(Evaluator(sound.campaign, stops)(model), Evaluator(sound.campaign, sound.sources)(LAW), strict=True):
        for name in ("speed", "slip", "adhesion", "force", "recorded_speed"):
            np.testing.assert_allclose(getattr(read, name), getattr(true, name), rtol=1e-6, atol=1e-6)


def test_a_wheel_of_another_radius_reads_right():
    assert readings_of(Model(2e-4, (0.06,), {"wheel_radius": {"change": 0.01, "axle": 1.0}})) == {}


def test_late_wheels_balance_what_is_made_as_late(sound):
    """The wheel's own balance is linear: filtered, it holds for filtered torques and forces."""
    (stop, *_), (read, *_) = sound.sources, late_wheels(sound).sources
    (right,) = correct_readings(sound.campaign, [read], LAG)
    force = stop.torque + sound.inertia * stop.wheel_rate
    inside = stop.time > 0.5
    found = right.torque + sound.inertia * right.wheel_rate
    missed, before = found - _filtered(force, LAG_S, stop.step_s), read.torque + sound.inertia * read.wheel_rate - force
    assert np.abs(missed[inside]).max() < 0.02 * np.abs(before[inside]).max()


def test_about_a_lag_late_wheels_are_explained_and_its_size_is_found(sound):
    recorded = late_wheels(sound)
    clean, bare, own = Replica(sound, LAW), Replica(recorded, LAW), Replica(recorded, LATE)

    def weights(one: Replica):
        return weigh(one, one.whitening(one.about), [Group("none", np.zeros((len(one.rows), 1)), 1.0)])

    lag = Variant("wheel_speed_lag", ("lag_s",), {})
    before, least = (weights(one).deviance(refit(one, LAW, (), weights(one)).cost) for one in (bare, clean))
    found = refit(own, dataclasses.replace(LAW, choice={"wheel_speed_lag": {"lag_s": 0.03}}), (lag,), weights(own))
    assert weights(own).deviance(found.cost) - least < 0.2 * (before - least)
    assert values_in(found.model, lag)[0] == pytest.approx(LAG_S, rel=0.15)


def test_about_a_late_clock_rows_have_the_slip_that_was(sound):
    """By which it is told whether a wheel slides, and what its rows vary by."""

    def late(stop):
        error = -CLOCK["clock_offset"]["offset_s"] * stop.acceleration
        return dataclasses.replace(stop, speed=stop.speed + stop.estimator(stop.time, error))

    recorded = sound.like([late(stop) for stop in sound.sources])
    wheels = sound.rows.wheels
    said, bare = (Replica(recorded, dataclasses.replace(LAW, choice=choice)).rows.slip[wheels] for choice in (CLOCK, {}))
    missed, before = (np.abs(one - sound.rows.slip[wheels]) for one in (said, bare))
    assert before.max() > 0.1
    assert missed.max() < 0.05 * before.max()


def test_the_constant_of_the_deviance_is_the_determinant_of_the_rows_covariance():
    """Of rows of two runs, with a nuisance of each and a common one."""
    rng = np.random.default_rng(4)
    run = np.repeat([0, 1], 30)
    columns = rng.standard_normal((60, 3))
    columns[:30, 1] = columns[30:, 0] = 0.0
    dense = np.eye(60) + columns @ columns.T
    projector = Projector.of(columns, np.ones(3, dtype=bool), run)
    assert projector.logdet == pytest.approx(np.linalg.slogdet(dense)[1])
    weights = Weights(Whitening(np.ones(60), ()), np.ones(60), projector, projector.logdet)
    y = rng.standard_normal(60)
    cost = float(projector.inner(y[:, None], y[:, None])[0, 0])
    expected = float(y @ linalg.solve(dense, y)) + np.linalg.slogdet(dense)[1]
    assert weights.deviance(cost) == pytest.approx(expected)
