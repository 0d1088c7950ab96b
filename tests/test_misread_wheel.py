"""An error of a wheel sensor's scale: read by the plant's WSP, undone along a recording, and found where teeth are missed."""

import shutil

import numpy as np
import polars as pl
import pytest
from numpy.testing import assert_allclose
from plant_cases import a_stop, plant_of

from wsp_env.diagnosis import diagnose
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.readings import misread_wheels, readings_of
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.plant.longitudinal.along import Belief, Trajectory, along, model
from wsp_env.plant.mechanisms.misread_wheel import RISE_MPS, term_of
from wsp_env.plant.mechanisms.term_words import equation_of
from wsp_env.plant.mechanisms.terms import REFERENCE_MPS, Feature
from wsp_env.recordings import demo_campaign, read_campaign

#: Feature -> what it is of circumferential speed [m/s] and time [s].
FEATURES = {
    Feature.SPEED: lambda v, t: v / REFERENCE_MPS,
    Feature.TIME: lambda v, t: t,
    Feature.ALWAYS: lambda v, t: np.clip((v - ABOVE_MPS) / RISE_MPS + 0.5, 0.0, 1.0),
}
SIZE, AXLE, ABOVE_MPS = 0.01, 3, 25.0


@pytest.mark.parametrize("feature", FEATURES, ids=lambda one: one.name.lower())
def test_the_sensor_reads_it_and_the_recording_is_read_without_it(feature):
    given = {"coefficient": SIZE, "axles": float(1 << (AXLE - 1)), "feature": float(feature)}
    choice = {"misread_wheel": given | {"above_mps": ABOVE_MPS if feature is Feature.ALWAYS else 0.0}}
    plant, sound = plant_of(COACH, 1, mechanisms=choice), plant_of(COACH, 1)
    for one in (plant, sound):
        one.start(0, a_stop(COACH, mu_cd=0.05))
    rows = []
    for _ in range(100):
        for one in (plant, sound):
            one.step(np.ones((1, 4)))
        s = plant.state
        assert_allclose(s.wheel_speed, sound.state.wheel_speed)  # the valves do not listen to it
        read, right = s.tachometer.measured[0], sound.state.tachometer.measured[0]
        rows.append((s.time[0], s.speed[0], s.position[0], *read, *right))
    time, speed, place, *wheels = np.array(rows).T
    read, right = np.split(np.array(wheels).T, 2, axis=1)
    error = SIZE * np.column_stack([FEATURES[feature](COACH.wheel_radius_m * wheel, time) for wheel in right.T])
    assert error[:, AXLE - 1].max() > 0.009
    error[:, [k for k in range(4) if k != AXLE - 1]] = 0.0
    assert_allclose(read, right * (1.0 + error), rtol=1e-12)
    time -= time[0]
    again = SIZE * np.column_stack([FEATURES[feature](COACH.wheel_radius_m * wheel, time) for wheel in right.T])
    again[:, error.max(axis=0) == 0.0] = 0.0
    none = np.zeros((len(time), 4))
    recorded = Trajectory(time, speed, np.zeros(len(time)), place, right * (1.0 + again), none, none)
    said = along(recorded, Belief(0.05, 1e-4, COACH.mass_kg, COACH.wheel_radius_m), model(COACH, choice))
    assert_allclose(said.wheel_speed_radps, right, rtol=1.1 * again.max() ** 3)


def test_a_scale_is_no_reading_at_another_time():
    read = Model(1e-4, (0.05,), {"misread_wheel": {"coefficient": SIZE, "axles": 5.0, "feature": float(Feature.SPEED)}})
    assert readings_of(read) == {}
    assert misread_wheels(read, 4).tolist() == [True, False, True, False]
    assert misread_wheels(Model(1e-4, (0.05,)), 4).tolist() == [False] * 4


def test_equation_in_words():
    given = {"coefficient": -0.012, "axles": 4.0, "above_mps": 0.0}
    words = equation_of(term_of(given | {"feature": float(Feature.SPEED)}))
    assert words == "wheel speed of axle 3 read too low by 1.2 %, times running speed over 30 m/s"
    words = equation_of(term_of(given | {"feature": float(Feature.ALWAYS), "above_mps": 22.4}))
    assert words == "wheel speed of axle 3 read too low by 1.2 % above 22 m/s"


@pytest.mark.slow
@pytest.mark.long
def test_a_sensor_that_is_not_linear_is_an_error_of_the_sensor_and_no_wheel_of_another_size(tmp_path):
    folder = shutil.copytree(demo_campaign(), tmp_path / "campaign")
    radius = read_campaign(folder).vehicle.wheel_radius_m
    for file in folder.glob("*.csv"):
        table = pl.read_csv(file, comment_prefix="#")
        name = f"axle{AXLE}_wheel_speed_radps"
        wheel = table[name].to_numpy()
        missed = wheel * (1.0 - 0.015 * radius * wheel / REFERENCE_MPS)
        table.with_columns(pl.Series(name, np.round(missed, 3))).write_csv(file)
    found = diagnose(read_campaign(folder))
    assert found.mechanisms == ()
    assert [(one.slot, one.axles) for one in found.discovered] == [("sensor", (AXLE,))]
    term = found.discovered[0]
    assert term.looks_like == ("wheel-speed sensor that is not linear",)
    assert_allclose(term.parameters["coefficient"].value, -0.015, rtol=0.15)
    assert term.removed_validate > 0.7
