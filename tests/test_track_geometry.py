"""Tracks from files: curves, irregularities, profiles; what cannot be is refused with one clause."""

import math
from importlib.resources import files

import numpy as np
import pytest

from wsp_env.contact.geometry.profile import evaluate
from wsp_env.contact.geometry.standard import s1002
from wsp_env.parameters.irregularities import COLUMNS, GROWS_M, HALF_M, Irregularities, densities
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.track_geometry import Curve, TrackGeometry, find_track_geometry
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.plant.longitudinal.plant import LongitudinalPlant
from wsp_env.plant.multibody.plant import MultibodyPlant
from wsp_env.plant.multibody.way import ACROSS, BEGIN, CURVATURE, HEADING, TILT, here, rail, way_of
from wsp_env.plant.port import Setup

LEFT = Curve(begin_m=50.0, transition_m=60.0, length_m=200.0, radius_m=400.0, cant_m=0.12)
RIGHT = Curve(begin_m=370.0, transition_m=40.0, length_m=0.0, radius_m=-600.0)


def test_a_spectrum_is_what_it_says():
    """The periodogram of what was drawn is the density itself, within the wavelengths asked for, and nothing beyond."""
    rough = Irregularities(spectrum="low", seed=3, length_m=2000.0)
    left_y, left_z, right_y, right_z = rough.drawn().T
    n, step = left_y.size, rough.node_m
    omega = 2.0 * math.pi * np.arange(n // 2 + 1) / (n * step)
    inside = (omega >= 2.0 * math.pi / rough.longest_m) & (omega <= 2.0 * math.pi / rough.shortest_m)
    signals = 0.5 * (left_z + right_z), left_y, (left_z - right_z) / (2.0 * HALF_M)
    for signal, density in zip(signals, densities(omega, "low"), strict=True):
        power = 2.0 * np.abs(np.fft.rfft(signal) / n) ** 2 / omega[1]
        np.testing.assert_allclose(power[inside], density[inside], rtol=1e-9)
        np.testing.assert_allclose(power[~inside], 0.0, atol=1e-20)
    np.testing.assert_array_equal(left_y, right_y)
    assert not np.array_equal(rough.rails(), Irregularities(spectrum="low", seed=4, length_m=2000.0).rails())
    omega = np.linspace(2.0 * math.pi / 70.0, 2.0 * math.pi / 3.0, 20_001)
    vertical, _, roll = densities(omega, "high")
    variance = np.trapezoid(vertical + HALF_M**2 * roll, omega)
    assert Irregularities(spectrum="high").drawn()[:, 1].var() == pytest.approx(variance, rel=0.1)  # of one draw


def test_rails_follow_the_nodes_and_begin_smoothly():
    way = way_of(TrackGeometry(irregularities=Irregularities(spectrum="high", length_m=500.0)))
    for node in (200, 777, 1999, 2000 + 300):  # the table is repeated
        own = rail(node * way.node, 1, way)
        assert (own.y, own.z) == pytest.approx(tuple(way.rails[node % 2000, 2:]), abs=1e-12)
    for place in (0.3 * GROWS_M, 41.37, 430.1, 540.0):  # derivatives are those of the values
        before, own, after = (rail(place + d, 0, way) for d in (-1e-5, 0.0, 1e-5))
        assert own.z_rate == pytest.approx((after.z - before.z) / 2e-5, rel=1e-5, abs=1e-9)
        assert own.y_rate == pytest.approx((after.y - before.y) / 2e-5, rel=1e-5, abs=1e-9)
    for place in (0.0, -5.0, -40.0, 480.0):  # under the vehicle at the start
        np.testing.assert_allclose(rail(place, 1, way), 0.0, atol=1e-5)


def test_a_measured_file_is_read(tmp_path):
    place = np.arange(0.0, 200.0, 0.5)
    table = np.column_stack([100.0 + place, *(1e-3 * k * np.sin(place / 7.0) for k in (1.0, 2.0, 3.0, 4.0))])
    np.savetxt(tmp_path / "rough.csv", table, delimiter=",", header=",".join(COLUMNS), comments="")
    (tmp_path / "track.toml").write_text('[irregularities]\nfile = "rough.csv"\n')
    rails = find_track_geometry(tmp_path / "track.toml").irregularities.rails()
    np.testing.assert_allclose(rails[::2][60:240], table[60:240, 1:], atol=1e-12)
    np.testing.assert_array_equal(rails[-1], rails[0])  # it can be repeated


def test_curves_join_without_a_jump():
    """Curvature, heading, place and tilt are continuous; the heading is the integral of the curvature."""
    geometry = TrackGeometry(curves=(LEFT, RIGHT))
    way = way_of(geometry)
    ends = way.segments[2:, BEGIN]
    for place in ends:
        before, after = here(place - 1e-9, way.segments), here(place, way.segments)
        for column in ("curvature", "heading", "across", "tilt"):
            assert getattr(before, column) == pytest.approx(getattr(after, column), abs=1e-8)
    full = here(200.0, way.segments)
    assert full.curvature == pytest.approx(1.0 / 400.0)
    assert full.tilt == pytest.approx(-math.asin(0.12 / 1.5))  # to the left: the right-hand rail is the higher one
    straight = here(1e4, way.segments)
    assert straight.curvature == straight.tilt == 0.0
    assert straight.heading == pytest.approx((60.0 + 200.0) / 400.0 - 40.0 / 600.0)
    first = way.segments[0]
    assert first[CURVATURE] == first[HEADING] == first[ACROSS] == first[TILT] == 0.0


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"gauge_m": 3.0}, "gauge_m = 3.0 m is impossible"),
        ({"gauge": 1.4}, "unknown key gauge; valid: gauge_m"),
        ({"curves": [{"radius_m": 20.0}]}, "too narrow"),
        ({"curves": [{}, {}]}, "begins before the last one ends"),
        ({"curves": {"radius_m": 300.0}}, r"write \[\[curves\]\]"),
        ({"irregularities": {"spectrum": "FRA 6"}}, "valid: low, high"),
        ({"irregularities": {"file": "none.csv"}}, "cannot be read"),
        ({"irregularities": {"shortest_m": 0.5}}, "shortest"),
        ({"irregularities": {"points": [[1.0]]}}, "in a file"),
        ({"wheel_profile": 3}, "must be a file's path"),
        (7, "must be a file's path as text, or a dictionary"),
        ("none.toml", "cannot be read"),
    ],
)
def test_impossible_tracks_are_refused(given, words):
    with pytest.raises(ParameterError, match=words):
        find_track_geometry(given)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("place_m,left_y_m\n0,0\n", "columns left_z_m, right_y_m, right_z_m are missing"),
        (",".join(COLUMNS) + "\n0,0,0,0,0\n1,0,x,0,0\n", "line 3: five numbers"),
        (",".join(COLUMNS) + "\n0,0,nan,0,0\n", "line 2: numbers must be finite"),
        (",".join(COLUMNS) + "\n0,0,4,0,0\n", "are they in metres"),
        (",".join(COLUMNS) + "\n0,0,0,0,0\n0,0,0,0,0\n", "line 3: the place must rise"),
        (",".join(COLUMNS) + "\n0,0,0,0,0\n9,0,0,0,0\n", "100 m of track or more"),
        ("", "are missing"),
    ],
)
def test_damaged_irregularities_are_refused(tmp_path, text, words):
    (tmp_path / "rough.csv").write_text(text)
    (tmp_path / "track.toml").write_text('[irregularities]\nfile = "rough.csv"\n')
    with pytest.raises(ParameterError, match=words):
        find_track_geometry(tmp_path / "track.toml")


def _profile(tmp_path, change):
    y = np.arange(-50.0, 60.0, 0.2)
    table = np.column_stack([y, evaluate(s1002(), y * 1e-3)[0] * 1e3])
    change(table)
    np.savetxt(tmp_path / "wheel.txt", table)
    return Setup(track_geometry=TrackGeometry(wheel_profile=str(tmp_path / "wheel.txt")))


def test_a_measured_wheel_runs(tmp_path):
    """A file with S1002 carries as S1002 itself does, within what smoothing points of 10 um noise moves."""
    measured = MultibodyPlant(COACH, 1, _profile(tmp_path, lambda table: None)).body_constants.rolling
    own = MultibodyPlant(COACH, 1).body_constants.rolling
    assert measured.pair.radius == pytest.approx(own.pair.radius, abs=2e-5)
    assert measured.reference == pytest.approx(own.reference, rel=0.02)


def test_profiles_that_cannot_be_run_on_are_one_clear_error(tmp_path):
    def fold(table):
        table[300:310, 0] -= 5.0

    with pytest.raises(ParameterError, match=r"track geometry: .*wheel\.txt: the profile folds back at y"):
        MultibodyPlant(COACH, 1, _profile(tmp_path, fold))
    with pytest.raises(ParameterError, match="track geometry: "):  # the wheels fall between the rails
        MultibodyPlant(COACH, 1, Setup(track_geometry=TrackGeometry(gauge_m=1.6)))
    with pytest.raises(ParameterError, match=r"track geometry: .*cannot be read"):
        MultibodyPlant(COACH, 1, Setup(track_geometry=TrackGeometry(rail_profile=str(files("wsp_env") / "none.txt"))))
    with pytest.raises(ParameterError, match="take plant multibody"):
        LongitudinalPlant(COACH, 1, Setup(track_geometry=TrackGeometry()))
