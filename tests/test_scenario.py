"""What is drawn at reset: in the ranges it says, unmoved by pins, kinds of track as described."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.uic_z1 import BOGIE
from wsp_env.plant.port import TRACK_STEP_M
from wsp_env.scenario import PINS, Scenario, draw

NODES = 801
QUANTITIES = ("mu_cd", "tau", "initial_speed", "demand", "gradient", "noise")


def draws(count, scenario=None, **arguments):
    rng = np.random.default_rng(0)
    return [draw(scenario or Scenario(), BOGIE, rng, NODES, **arguments) for _ in range(count)]


def test_draws_fill_their_ranges():
    scenario = Scenario(gradient=(-0.02, 0.01))
    stops = draws(400, scenario)
    for name, field in (("noise", "sensor_noise"), *((name, name) for name in QUANTITIES if name != "noise")):
        low, high = getattr(scenario, field)
        values = np.array([getattr(stop, name) for stop in stops])
        share = (np.log(values / low) / math.log(high / low)) if name == "tau" else (values - low) / (high - low)
        assert 0.0 <= share.min() < 0.02
        assert 0.98 < share.max() <= 1.0
        assert_allclose(share.mean(), 0.5, atol=0.06)
    mass = np.array([stop.mass for stop in stops])
    assert BOGIE.mass_kg <= mass.min()
    assert mass.max() <= BOGIE.mass_kg + BOGIE.payload_kg
    assert len({stop.key for stop in stops}) == 400


@given(st.sampled_from(sorted(PINS)), st.integers(0, 1000))
def test_pinning_one_quantity_leaves_the_others(name, seed):
    value = "varying" if name == "track" else 0.05
    free, pinned = (draw(Scenario(), BOGIE, np.random.default_rng(seed), NODES, pins) for pins in (None, {name: value}))
    changed = {"load": "mass", "sensor_noise": "noise"}.get(name, name)
    for field in dataclasses.fields(free):
        if field.name == changed or (name == "track" and field.name in ("profile", "coverage")):
            continue
        assert_array_equal(getattr(free, field.name), getattr(pinned, field.name), err_msg=field.name)


def test_classic_is_the_same_draw_without_recovery():
    for recovering, classic in zip(draws(5), draws(5, classic=True), strict=True):
        assert classic.tau == 0.0
        assert dataclasses.replace(classic, tau=recovering.tau, profile=0, coverage=0) == dataclasses.replace(
            recovering, profile=0, coverage=0, radius=classic.radius
        )


def test_constant_track():
    for stop in draws(5, pins={"track": "constant"}):
        assert_array_equal(stop.profile, 1.0)
        assert_array_equal(stop.coverage, 1.0)


def test_varying_track_has_the_deviation_and_correlation_it_is_given():
    length = 15.0
    scenario = Scenario(variation=0.05, variation_length=(length, length))
    profiles = np.array([stop.profile for stop in draws(60, scenario, pins={"track": "varying"})])
    assert_allclose(profiles.mean(), 1.0, atol=2e-3)
    assert_allclose(profiles.std(), 0.05, rtol=0.03)
    deviation = profiles - 1.0
    for lag in (1, 3):
        correlation = (deviation[:, lag:] * deviation[:, :-lag]).mean() / deviation.var()
        assert_allclose(correlation, math.exp(-lag * TRACK_STEP_M / length), atol=0.03)
    assert_array_equal(draws(1, scenario, pins={"track": "varying"})[0].coverage, 1.0)


def test_patches_lie_on_a_clean_rail():
    scenario = Scenario(patch_length=(50.0, 100.0))
    for stop in draws(20, scenario, pins={"track": "patches"}):
        assert set(np.unique(stop.coverage)) == {0.0, 1.0}
        assert stop.coverage[0] == 1.0
        ends = np.flatnonzero(np.diff(stop.coverage)) + 1
        lengths = TRACK_STEP_M * np.diff(ends)
        assert lengths.min() >= 50.0 - TRACK_STEP_M
        assert lengths.max() <= 100.0 + TRACK_STEP_M
        assert_array_equal(stop.profile, 1.0)


def test_all_kinds_of_track_are_drawn():
    kinds = {(bool(np.ptp(stop.profile)), bool(np.ptp(stop.coverage))) for stop in draws(40)}
    assert kinds == {(False, False), (True, False), (False, True)}


def test_range_of_one_value_is_that_value():
    scenario = Scenario(mu_cd=(0.05, 0.05), tau=(0.0, 0.0), tracks=("constant",))
    assert {stop.mu_cd for stop in draws(5, scenario)} == {0.05}
    assert {stop.tau for stop in draws(5, scenario)} == {0.0}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mu_cd": (0.09, 0.02)}, "mu_cd = .* lowest first"),
        ({"mu_cd": 0.05}, "mu_cd = 0.05 must be a pair"),
        ({"mu_cd": (0.0, 0.05)}, "above zero"),
        ({"tau": (-1e-4, 1e-4)}, "must lie in"),
        ({"initial_speed": (10.0, math.inf)}, "finite"),
        ({"tracks": ()}, "some of constant, varying, patches"),
        ({"tracks": ("leaves",)}, "leaves.*some of constant, varying, patches"),
        ({"variation": 0.9}, "variation = 0.9 is impossible"),
    ],
)
def test_impossible_distributions_are_refused(changes, message):
    with pytest.raises(ParameterError, match=message):
        Scenario(**changes)
