"""Zero errors of brake channels are read where the brakes are released."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose

from wsp_env.diagnosis.zeros import usual_zero, zero_readings, zeroed
from wsp_env.recordings import demo_campaign, read_campaign

STEP_S = 0.01
ZEROS = np.array([0.02, -0.015, 0.0, 0.01])


def readings(released_s=2.0, zeros=ZEROS, runs=2):
    """Channels that read `zeros` and noise, until the brakes fill to 1 within 0.3 s."""
    rng = np.random.default_rng(5)
    time = STEP_S * np.arange(1000)
    brake = np.clip((time - released_s) / 0.3, 0.0, 1.0)[:, None]
    return [brake + zeros + 0.01 * rng.standard_normal((1000, 4)) for _ in range(runs)]


def test_what_released_brakes_read_is_the_error_of_their_sensor():
    assert_allclose(zero_readings(readings(), STEP_S), ZEROS, atol=5.0 * 0.01 / np.sqrt(300.0))


def test_brakes_that_are_applied_from_the_start_say_nothing_nor_does_what_no_sensor_errs_by():
    assert_allclose(zero_readings(readings(0.9), STEP_S), 0.0)  # 0.4 s of each run: too short
    assert_allclose(zero_readings(readings(0.0), STEP_S), 0.0)
    assert zero_readings(readings(zeros=np.array([0.04, 0.0, 0.0, 0.0])), STEP_S)[0] == 0.0  # 4 %: it may brake


@pytest.fixture(scope="module")
def campaign():
    found = read_campaign(demo_campaign())
    assert not found.vehicle.torque_is_measured
    return found


def shifted(campaign, torques_nm):
    runs = {
        name: dataclasses.replace(run, brake_torque_nm=run.brake_torque_nm + torques_nm) for name, run in campaign.runs.items()
    }
    return dataclasses.replace(campaign, runs=runs)


def test_torques_from_pressures_are_zeroed_and_measured_ones_are_not(campaign):
    errors = np.array([60.0, -40.0, 0.0, 20.0])
    plain, wrong = zeroed(campaign), zeroed(shifted(campaign, errors))
    for name, run in plain.runs.items():
        assert_allclose(wrong.runs[name].brake_torque_nm, run.brake_torque_nm, atol=5.0)  # other samples are below 5 %
    measured = dataclasses.replace(campaign, vehicle=dataclasses.replace(campaign.vehicle, brake_torque_source="measured"))
    assert zeroed(measured) is measured


def test_the_usual_zero_error_is_that_of_the_median_axle(campaign):
    assert usual_zero(campaign) == 0.0  # computed torques have been zeroed
    measured = dataclasses.replace(campaign, vehicle=dataclasses.replace(campaign.vehicle, brake_torque_source="measured"))
    plain = zeroed(campaign).runs.values()
    measured = dataclasses.replace(measured, runs={run.name: run for run in plain})
    largest = max(float(run.brake_torque_nm.max()) for run in plain)
    for dragging_nm in (50.0, 200.0):  # an axle that drags does not count
        usual = usual_zero(shifted(measured, np.array([20.0, -30.0, 40.0, dragging_nm])))
        assert_allclose(usual, 30.0 / 0.6745 / largest, rtol=0.05)
