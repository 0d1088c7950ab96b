"""The test programme: its cases and requirements, what is drawn for them, the figures of a stop."""

import dataclasses
import math

import numpy as np
import pytest
from scipy import stats

from wsp_env.contact.degraded import adhesion_without_recovery
from wsp_env.evaluation.bound import SlideLimit, ceiling
from wsp_env.evaluation.controller import load
from wsp_env.evaluation.figures import figures, losses
from wsp_env.evaluation.programme import (
    STANDARD,
    Case,
    Draws,
    Programme,
    draw_stops,
    friction_for,
    read_programme,
    select_cases,
)
from wsp_env.evaluation.runner import StopRecords, run
from wsp_env.evaluation.summary import interval
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.uic_z1 import COACH, WHEELSET
from wsp_env.scenario import Scenario


def test_the_standard_programme_holds_what_the_standard_tests():
    programme = read_programme()
    names = {case.name for case in programme.cases}
    assert {"dry-160", "low-120", "low-160", "low-200", "extremely-low-160", "change-up-160", "change-down-160"} <= names
    assert {"patches-160", "downhill-160", "worn-wheelset-160", "failed-sensor-160", "low-160-full"} <= names
    assert {"dry-worn-160", "dry-failed-160"} <= names
    assert all("EN 15595" in r.source or "assumption" in r.source for r in programme.requirements)
    assert select_cases(programme, COACH) == programme.cases
    slow = dataclasses.replace(COACH, max_speed_mps=36.0)
    assert {case.initial_speed_kmh for case in select_cases(programme, slow)} == {80.0, 120.0}
    assert {"spray-160", "air-160", "partial-160", "drag-80", "valve-open-160", "valve-shut-160", "dry-no-power-160"} <= names


def test_standard_programme_travels_with_the_package():
    assert STANDARD.is_file()


@pytest.mark.parametrize(("mu_cd", "adhesion"), [(0.03, 0.062), (0.06, 0.115)])
def test_initial_adhesion_at_44_mps(mu_cd, adhesion):
    """The peaks of f_d that the law gives an empty coach at 44 m/s."""
    assert friction_for(adhesion, 44.0, COACH.mass_kg, COACH) == pytest.approx(mu_cd, rel=0.01)


def test_drawn_stops_have_the_initial_adhesion_of_their_case():
    programme = read_programme()
    case = select_cases(programme, COACH, ["low-160-full"])[0]
    drawn = draw_stops(case, programme, COACH, Draws(4, 1))
    slip = np.linspace(1e-3, 44.0, 20000)
    for stop in drawn.stops:
        load_n = stop.mass * COACH.gravity_mps2 / 8
        peak = adhesion_without_recovery(slip, stop.initial_speed, load_n, stop.mu_cd, 0.0, COACH.contact.law).max()
        assert 0.05 - 1e-5 <= peak <= 0.08 + 1e-5
        assert stop.mass == COACH.mass_kg + COACH.payload_kg


def test_both_laws_see_the_same_stops_and_more_draws_keep_the_first():
    programme = read_programme()
    case = select_cases(programme, COACH, ["worn-wheelset-160"])[0]
    few, many = (draw_stops(case, programme, COACH, Draws(n, 7)) for n in (2, 3))
    assert few.laws == ("classic", "recovering") * 2
    for classic, recovering in zip(few.stops[::2], few.stops[1::2], strict=True):
        assert classic.tau == 0.0 < recovering.tau
        assert (classic.mu_cd, classic.key, classic.noise) == (recovering.mu_cd, recovering.key, recovering.noise)
        np.testing.assert_array_equal(classic.radius, recovering.radius)
        assert sorted(np.round(COACH.wheel_radius_m - classic.radius, 6)) == [0.0, 0.0, 0.0, 0.015]
    for a, b in zip(few.stops, many.stops, strict=False):
        assert (a.mu_cd, a.tau, a.key) == (b.mu_cd, b.tau, b.key)


def test_contamination_lies_where_the_case_says():
    programme = read_programme()
    up, down = select_cases(programme, COACH, ["change-up-160", "change-down-160"])
    for case, before, after in ((up, 1.0, 0.0), (down, 0.0, 1.0)):
        coverage = draw_stops(case, programme, COACH, Draws(1, 0)).stops[0].coverage
        assert coverage[0] == before
        assert coverage[-1] == after
        assert np.abs(np.diff(coverage)).sum() == 1.0


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[programme", "not valid TOML"),
        ("[programme]\nname='a'", "at least one"),
        ("[[case]]\nname='a'\nabout=''\ninitial_speed_kmh=80.0\nspeed=3", "unexpected keyword argument 'speed'"),
        ("[[case]]\nname='a'\nabout=''", "initial_speed_kmh"),
        ("[[case]]\nname='a'\nabout=''\ninitial_speed_kmh=80.0\ninitial_adhesion=[0.5, 0.6]", "initial_adhesion"),
        (
            "[[case]]\nname='a'\nabout=''\ninitial_speed_kmh=80.0\n[[requirement]]\nname='r'\nfigure='f'\nat_most=1\nsource=''",
            "figure",
        ),
    ],
)
def test_a_wrong_programme_is_refused(tmp_path, text, complaint):
    path = tmp_path / "programme.toml"
    path.write_text(text)
    with pytest.raises(ParameterError, match=complaint):
        read_programme(path)


def test_figures_of_a_made_up_stop():
    """Eqs. (20), (21) and the times, on a course that is known: 3 s in 1 s steps, one axle, the first stop shorter."""
    ones = np.ones((4, 2, 1))
    slip = np.stack([np.array([0.0, 1.0, 3.0, 9.0]), np.array([0.0, 4.0, 4.0, 10.0])], axis=1)[:, :, None]
    result = StopRecords(
        time=np.arange(4.0),
        speed=np.full((4, 2), 10.0),
        position=10.0 * np.arange(4.0)[:, None] * np.ones(2),
        slip=slip,
        pressure=ones,
        adhesion=0.05 * ones,
        command=np.array([[[-1.0], [-1.0]], [[-1.0], [1.0]], [[1.0], [-1.0]]]),
        steps=np.array([2, 3]),
        duration=np.array([2.0, 3.0]),
        distance=np.array([20.0, 30.0]),
        stopped=np.array([True, True]),
        air=np.array([[5.0], [6.0]]),
        contact_work=np.array([[2e6], [4e6]]),
    )
    programme = Programme("small", SlideLimit(), Scenario(), (Case("a", "", 36.0, (0.05, 0.05)),), ())
    top = ceiling(WHEELSET, draw_stops(programme.cases[0], programme, WHEELSET, Draws(1, 0)).stops)
    found = figures(result, top)
    np.testing.assert_allclose(found["mean_slip_mps"], [2.0, 6.0])
    np.testing.assert_allclose(found["slip_deviation_mps"], [1.0, math.sqrt(8.0)])
    np.testing.assert_allclose(found["largest_slip_mps"], [3.0, 10.0])
    np.testing.assert_allclose(found["beyond_limit_s"], [0.0, 3.0])
    np.testing.assert_allclose(found["locked_s"], [0.0, 1.0])
    np.testing.assert_allclose(found["valve_switchings"], [0.0, 2.0])
    np.testing.assert_allclose(found["longest_vent_s"], [2.0, 1.0])
    np.testing.assert_allclose(found["contact_energy_mj"], [1.0, 2.0])


@pytest.mark.parametrize("name", ["none", "rule-based"])
def test_the_causes_account_for_all_metres_beyond_the_bound(name):
    programme = read_programme()
    case = dataclasses.replace(select_cases(programme, COACH, ["low-120"])[0], initial_speed_kmh=70.0)
    drawn = draw_stops(case, programme, COACH, Draws(2, 0))
    top = ceiling(COACH, drawn.stops, programme.limit)
    result = run(load(name), COACH, drawn.stops)
    beyond = result.distance - top.shortest()[0]
    np.testing.assert_allclose(sum(losses(result, top).values()), beyond, atol=0.01 * result.distance.max())


def test_the_interval_is_students():
    values = np.array([1.0, 2.0, 4.0])
    mean, half = interval(values)
    low, high = stats.t.interval(0.95, 2, loc=values.mean(), scale=stats.sem(values))
    assert (mean - half, mean + half) == pytest.approx((low, high))
    assert math.isnan(interval(values[:1])[1])
