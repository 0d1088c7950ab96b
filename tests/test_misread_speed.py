"""An error of the recorded speed: in the plant's recorder, undone along a recording, and found where a radar pitches."""

import shutil

import numpy as np
import polars as pl
import pytest
from numpy.testing import assert_allclose
from plant_cases import a_stop, plant_of

from wsp_env.diagnosis import diagnose
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.plant.longitudinal.along import Belief, Trajectory, along, model
from wsp_env.plant.mechanisms.misread_speed import term_of
from wsp_env.plant.mechanisms.term_words import equation_of
from wsp_env.plant.mechanisms.terms import REFERENCE_MPS, Feature
from wsp_env.recordings import demo_campaign, read_campaign

#: Feature -> what it is of speed [m/s], deceleration [m/s2] and time [s].
FEATURES = {
    Feature.ALWAYS: lambda v, d, t: 1.0,
    Feature.TIME: lambda v, d, t: t,
    Feature.SPEED_TIME: lambda v, d, t: v / REFERENCE_MPS * t,
    Feature.SPEED_SQUARED: lambda v, d, t: (v / REFERENCE_MPS) ** 2,
    Feature.SPEED_DECELERATION: lambda v, d, t: v / REFERENCE_MPS * d,
}
SIZE = 0.03


@pytest.mark.parametrize("feature", FEATURES, ids=lambda one: one.name.lower())
def test_the_plant_records_it_and_the_recording_is_read_without_it(feature):
    choice = {"misread_speed": {"coefficient": SIZE, "feature": float(feature)}}
    plant = plant_of(COACH, 1, mechanisms=choice)
    plant.start(0, a_stop(COACH, mu_cd=0.05))
    rows = []
    for _ in range(100):
        plant.step(np.ones((1, 4)))
        s = plant.state
        rows.append((s.time[0], s.speed[0], s.deceleration[0], s.recorded_speed[0], s.position[0], *s.wheel_speed[0]))
    time, speed, deceleration, recorded, place, *wheel = np.array(rows).T
    error = SIZE * np.array([FEATURES[feature](*one) for one in zip(speed, deceleration, time, strict=True)])
    assert np.abs(error).max() > 0.01
    assert_allclose(recorded - speed, error, atol=1e-12)
    time -= time[0]
    error = SIZE * np.array([FEATURES[feature](*one) for one in zip(speed, deceleration, time, strict=True)])
    wheels, none = np.array(wheel).T, np.zeros((len(time), 4))
    read = Trajectory(time, speed + error, -deceleration, place, wheels, none, none)
    said = along(read, Belief(0.05, 1e-4, COACH.mass_kg, COACH.wheel_radius_m), model(COACH, choice))
    # To first order: what is left is the error's own share of the error.
    assert_allclose(said.speed_mps, speed, atol=np.abs(error).max() * 0.01)


def test_equation_in_words():
    words = equation_of(term_of({"coefficient": 0.2, "feature": float(Feature.SPEED_DECELERATION)}))
    assert words == "recorded speed too high by 0.2 m/s per m/s2 of deceleration, times running speed over 30 m/s"


@pytest.mark.slow
@pytest.mark.long
def test_a_radar_that_pitches_is_an_error_of_the_sensor_and_no_physics_of_wheels(tmp_path):
    """On wheels that roll under the brake it looks like a late clock, a soft contact, more inertia: none of these is named."""
    folder, pitch = shutil.copytree(demo_campaign(), tmp_path / "campaign"), 0.007
    for file in folder.glob("*.csv"):
        table = pl.read_csv(file, comment_prefix="#")
        speed, time = table["vehicle_speed_mps"].to_numpy(), table["time_s"].to_numpy()
        window = np.ones(51) / 51.0
        smooth = np.convolve(np.pad(speed, 25, mode="edge"), window, "valid")
        deceleration = -np.gradient(smooth, time)
        table.with_columns(vehicle_speed_mps=pl.Series(np.round(speed * (1.0 + pitch * deceleration), 3))).write_csv(file)
    found = diagnose(read_campaign(folder))
    assert [one.slot for one in found.discovered] == ["sensor"]
    assert found.mechanisms == ()
    term = found.discovered[0]
    assert term.looks_like == ("radar that pitches with the body",)
    assert_allclose(term.parameters["coefficient"].value, pitch * REFERENCE_MPS, rtol=0.15)
    assert term.removed_validate > 0.7
