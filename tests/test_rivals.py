"""Rivals by rules: long slide, adaptive slip control's search and price, drawn vehicles and broken sensors."""

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from agents.drawn import DRAWS, FILL_S, KEPT, REPORTED, WORN, Drawn, against, over_seeds, standard_error, world
from agents.faults import DRY, Arguments, Broken, longest_lock, parts_of
from agents.measure import low_adhesion
from agents.rivals import at_slip, classical, envelope
from agents.rules import KINDS, RANGES
from agents.taught import over_front, paid
from agents.tolerances import TOLERANCES, _over_the_first
from baselines.adaptive import AdaptiveController, AdaptiveParameters, Settings
from baselines.rule_based import LongSlide, RuleBasedParameters
from wsp_env.evaluation.runner import StopRecords
from wsp_env.observer import rail, worth
from wsp_env.parameters.uic_z1 import BOGIE
from wsp_env.plant.port import Measurement

STEP_S = np.array([0.02])


def long_slide(gain, after=0.8):
    """Run the long slide with a deceleration of 0.5 m/s2 before its trial and `after` in it; return the creepages seen."""
    parameters = dataclasses.replace(RuleBasedParameters(), long_slide=0.2, long_slide_trial_s=2.0)
    long, speed, seen = LongSlide(dataclasses.replace(parameters, long_slide_gain=gain), 1), 40.0, []
    for step in range(400):
        found = float(long.creepage(STEP_S, np.array([speed]), np.array([step > 20]))[0])
        speed -= 0.02 * (after if found > parameters.slip_per_speed else 0.5)
        seen.append(found)
    return seen


def test_the_long_slide_is_kept_where_it_pays_and_given_up_where_it_does_not():
    usual = RuleBasedParameters().slip_per_speed
    pays, does_not = long_slide(1.2), long_slide(1.2, after=0.5)
    assert pays[:100] == [usual] * 100  # not before the protection has acted for long enough
    assert pays[150] == does_not[150] == 0.2  # the trial
    assert pays[-1] == 0.2
    assert does_not[-1] == usual
    off = LongSlide(RuleBasedParameters(), 1)
    assert all(off.creepage(1e3 * STEP_S, np.ones(1), np.ones(1, dtype=bool)) == usual for _ in range(3))


def test_what_is_searched_are_settings_of_the_controller():
    for kind, ranges in (("rule-based", RANGES), ("adaptive", KINDS["adaptive"].ranges)):
        for name, (low, high) in ranges.items():
            default = getattr(KINDS[kind].parameters(), name)
            assert low <= default <= high, name
            KINDS[kind].parameters(**{name: low}), KINDS[kind].parameters(**{name: high})
    rule = {"leading_creepage", "leading_axles"}  # chosen by who knows what wheels clean for those behind
    assert (
        set(KINDS["adaptive"].ranges) | rule
        == set(Settings._fields)
        <= {f.name for f in dataclasses.fields(AdaptiveParameters)}
    )


def believed(friction, deviation):
    """Return what is believed of one rail, and the constants, of an observer of bogies."""
    rails, constants = rail.allocate(1), rail.constants(BOGIE, 0.02)
    rails.friction[0], rails.deviation[0], rails.seen[0] = friction, deviation, 8.0
    weights = worth.weights_of(1)
    worth.believe(0, rails, weights)
    return rails, weights, constants


def test_of_the_beliefs_on_the_rail_the_one_that_fits_counts():
    _, even, _ = believed(0.03, 0.1)
    assert_allclose(even[0], 0.25)
    _, sure, _ = believed(0.03, [0.4, 0.4, 0.05, 0.4])
    assert sure[0, 2] > 0.99
    assert_allclose(sure.sum(), 1.0)


def test_the_slip_worth_its_price_falls_with_the_price_and_is_larger_where_sliding_cleans():
    classic, cleans = ([0.05, 0.4, 0.4, 0.4], [0.4, 0.4, 0.4, 0.05])
    slips = {}
    for name, deviation in (("classic", classic), ("cleans", cleans)):
        rails, weights, constants = believed(0.03, deviation)
        slips[name] = [worth.slip_worth_its_price(0, 30.0, 0.12, price, rails, weights, constants) for price in (0.5, 2.0, 8.0)]
        assert slips[name] == sorted(slips[name], reverse=True)
    assert slips["cleans"][0] > 2.0 * slips["classic"][0]
    # Where the brake asks for next to nothing the least slip carries it.
    assert worth.slip_worth_its_price(0, 30.0, 1e-3, 1.0, rails, weights, constants) <= 0.1


def test_drawn_vehicles_differ_from_the_nominal_one_and_worn_stops_in_one_wheelset():
    ((vehicle, mechanisms, stops),) = world("nominal", BOGIE, "classic", 4, 1)
    assert vehicle is BOGIE
    assert not mechanisms
    ((_, _, worn),) = world("worn", BOGIE, "classic", 4, 1)
    for nominal, own, wear in zip(stops, worn, WORN, strict=True):
        assert_allclose(sorted(own.radius / nominal.radius), [1.0 - wear, 1.0])
    parts = world("all", BOGIE, "classic", 2 * DRAWS, 1)
    assert len(parts) == DRAWS
    assert len({own.brake.fill_time_constant_s for own, _, _ in parts}) == DRAWS
    assert all(FILL_S[0] <= own.brake.fill_time_constant_s <= FILL_S[1] for own, _, _ in parts)
    with pytest.raises(SystemExit, match="no world 'x'"):
        world("x", BOGIE, "classic", 1, 1)


def test_controllers_know_the_fields_of_a_drawn_brake_that_they_are_told():
    parts = world("drawn brakes", BOGIE, "classic", DRAWS, 5)
    for (own, _, _), believed in zip(parts, Drawn(BOGIE, parts, ("demand_rise_s",)).believed, strict=True):
        assert believed.brake.demand_rise_s == own.brake.demand_rise_s != BOGIE.brake.demand_rise_s
        assert believed.brake.fill_time_constant_s == BOGIE.brake.fill_time_constant_s
    assert all(believed == BOGIE for believed in Drawn(BOGIE, parts).believed)


def test_the_line_adds_gradients_drag_and_pads_to_all_that_is_drawn():
    drawn, line = (world(name, BOGIE, "recovering", 16, 5) for name in ("all", "line"))
    for (own, mechanisms, stops), (same, more, sloping) in zip(drawn, line, strict=True):
        assert same == own
        assert {name: more[name] for name in mechanisms} == mechanisms
        assert set(more) - set(mechanisms) == {"aerodynamic_drag", "pad_friction"}
        assert all(-0.01 <= stop.gradient <= 0.01 for stop in sloping)
        assert [(stop.mu_cd, stop.noise) for stop in sloping] == [(stop.mu_cd, stop.noise) for stop in stops]
    assert len({stop.gradient for _, _, stops in line for stop in stops}) == 16
    ((vehicle, none, falling),) = world("downhill", BOGIE, "classic", 3, 5)
    assert (vehicle, none) == (BOGIE, {})
    assert [stop.gradient for stop in falling] == [-0.01] * 3


def test_a_front_is_taken_at_the_same_slip_and_without_points_that_are_none_of_it():
    points = [{"mean_slip_mps": s, "distance_m": d} for s, d in ((0.5, 900.0), (1.0, 800.0), (0.8, 950.0))]
    assert_allclose(at_slip(points, 0.75)["distance_m"], 850.0)
    assert at_slip(points, 2.0)["distance_m"] == 800.0


_SLIPS = st.integers(100, 3000).map(lambda thousandths: 1e-3 * thousandths)  # a rounding error apart, no slip lies between


@given(st.lists(st.tuples(_SLIPS, st.floats(500.0, 1500.0)), min_size=2, max_size=9))
def test_no_point_and_no_line_between_two_points_lies_below_the_envelope(pairs):
    points = [{"mean_slip_mps": slip, "distance_m": distance} for slip, distance in pairs]

    def above(slip, distance):
        return distance >= at_slip(points, slip)["distance_m"] - 1e-6

    assert all(above(*pair) for pair in pairs)
    for (first, one), (last, other) in itertools.combinations(pairs, 2):
        assert above(0.5 * (first + last), 0.5 * (one + other))


def test_a_policy_is_put_over_the_teachers_front_at_its_own_slip():
    front = [
        {name: np.full(2, 1.0) for name in KEPT} | {"mean_slip_mps": np.full(2, slip), "distance_m": np.full(2, distance)}
        for slip, distance in ((0.5, 900.0), (1.0, 800.0))
    ]
    own = front[0] | {"mean_slip_mps": np.array([0.5, 1.0]), "distance_m": np.array([867.0, 850.0])}
    assert_allclose(over_front(own, front, np.arange(2)), 858.5 / 850.0)
    assert_allclose(paid(own | {"duration_s": np.array([10.0, 20.0])}, 4.0), [887.0, 930.0])


class Echo:
    """Keeps what it is shown."""

    def reset(self, n, vehicle):
        self.seen = []

    def act(self, measurement):
        self.seen.append(measurement.wheel_speed)
        return np.ones(measurement.wheel_speed.shape)


def test_a_sensor_breaks_on_its_axle_and_at_its_time():
    for fault, expected in (("zero", 0.0), ("lost", np.nan), ("frozen", 60.0)):
        echo = Echo()
        broken = Broken(echo, fault, np.array([1]), np.array([0.03]))
        broken.reset(1, BOGIE)
        for step in range(4):
            broken.act(Measurement(np.array([0.02 * step]), np.array([[70.0, 61.0 - step]]), np.ones(1)))
        assert_array_equal(np.array(echo.seen)[:, 0, 1], [61.0, 60.0, expected, expected])
        assert_array_equal(np.array(echo.seen)[:, 0, 0], 70.0)


def test_the_longest_lock_counts_without_a_break_and_above_15_kmh():
    speed = np.array([10.0, 10.0, 10.0, 10.0, 10.0, 4.0, 4.0])[:, None]
    slip = np.array([0.0, 10.0, 10.0, 0.0, 10.0, 4.0, 4.0])[:, None, None] * np.array([1.0, 0.0])
    fields = dict.fromkeys((field.name for field in dataclasses.fields(StopRecords)), None)
    records = StopRecords(**fields | {"time": 0.02 * np.arange(7), "speed": speed, "slip": slip})
    assert_allclose(longest_lock(records), [0.04])


def measured(slip, distance, locked=0.0):
    rest = dict.fromkeys(REPORTED, distance)
    return rest | {"mean_slip_mps": slip, "distance_m": distance, "worst_locked_s": locked}


def test_who_is_compared_is_compared_with_the_best_of_all_fronts_that_lock_no_wheel():
    first, second = [measured(0.2, 1000.0), measured(0.8, 900.0)], [measured(0.5, 850.0), measured(0.9, 880.0)]
    locks = [measured(0.4, 500.0, locked=0.5)]
    assert [own["distance_m"] for own in envelope(first + second)] == [1000.0, 850.0]  # the others are beaten at less slip
    found = against(measured(0.5, 800.0), first + second + locks)
    assert found["distance_m_ratio"] == pytest.approx(800.0 / 850.0)
    assert found["rivals"] == 4
    assert not found["beyond_front"]
    assert against(measured(1.5, 800.0), first)["beyond_front"]
    assert np.isnan(against(measured(0.5, 800.0), locks)["distance_m_ratio"])


def stops(distance):
    level = dict.fromkeys(REPORTED, distance)
    return level | {"mean_slip_mps": np.full(len(distance), 0.5), "locked_s": np.zeros(len(distance))}


def test_the_error_of_a_ratio_of_distances_is_that_of_its_scatter_over_the_draws():
    rng = np.random.default_rng(1)
    rival = rng.uniform(600.0, 1200.0, 60)
    alone = np.arange(60)
    assert standard_error(stops(0.9 * rival), [stops(rival)], alone) < 1e-12  # long stops are long for both
    scattered = rival * (1.0 + 0.05 * rng.normal(size=60))
    expected = np.std(scattered - rival, ddof=1) / np.sqrt(60) / rival.mean()
    assert standard_error(stops(scattered), [stops(rival)], alone) == pytest.approx(expected, rel=0.2)
    thrice = np.repeat(np.arange(60), 3)  # three stops that are the same tell no more than one
    own, other = (stops(np.repeat(one, 3)) for one in (scattered, rival))
    assert standard_error(own, [other], thrice) == pytest.approx(expected, rel=0.2)
    assert np.isnan(standard_error(stops(rival), [stops(rival) | {"locked_s": np.ones(60)}], alone))


def test_of_several_trainings_mean_interval_and_range_are_told_and_nobody_else_counts():
    ratios = {"distance_m": 0.97, "slip_deviation_mps": 0.8, "contact_energy_mj": 0.9, "air_nl": 2.0}
    row = {f"{figure}_ratio": value for figure, value in ratios.items()} | {"world": "all", "law": "classic"}
    row |= {"mean_slip_mps": 0.5, "worst_locked_s": 0.0, "beyond_front": False}
    others = {"distance_m_ratio": 0.95, "mean_slip_mps": 0.7, "worst_locked_s": 0.3, "beyond_front": True}
    rows = [
        row | {"controller": "policy of bogie-1"},
        row | others | {"controller": "policy of bogie-2"},
        row | others | {"controller": "policy former", "distance_m_ratio": 2.0},
        row | others | {"controller": "rules 3", "distance_m_ratio": 2.0},
    ]
    assert over_seeds(rows).splitlines()[2:] == [
        "| all | classic | 2 | 0.960 ± 0.127 | 0.950 to 0.970 | 0.60 | 0.80 | 0.90 | 0.30 | 1 |"
    ]


def test_every_classical_family_has_a_front(tmp_path):
    families = classical("bogie", tmp_path)  # nothing was searched there
    assert set(families) == {"rules", "rules, long slide", "slip", "adaptive"}
    assert len(families["adaptive"]) >= 3
    prices = [controller.parameters.slide_price for controller in families["adaptive"].values()]
    assert prices == sorted(prices)
    assert all(controller.parameters.long_slide > 0.0 for controller in classical("bogie")["rules, long slide"].values())


def test_a_tolerance_changes_what_it_names_and_is_compared_with_the_stop_as_believed():
    slow = TOLERANCES["venting x 1.4"].of(BOGIE)
    assert slow.brake.vent_time_constant_s == 1.4 * BOGIE.brake.vent_time_constant_s
    assert dataclasses.replace(slow, brake=BOGIE.brake) == BOGIE
    assert TOLERANCES["as believed"].of(BOGIE) == BOGIE
    stop = low_adhesion(BOGIE, "classic", 1, 1)[0]
    assert TOLERANCES["first wheelset worn 2 %"].stop(stop).radius[0] == pytest.approx(0.98 * stop.radius[0])
    rows = [
        {"law": "classic", "controller": "a", "distances": np.array([100.0, 200.0])},
        {"law": "classic", "controller": "a", "distances": np.array([110.0, 220.0])},
    ]
    assert [row["over"] for row in _over_the_first(rows)] == pytest.approx([1.0, 1.1])


def test_adaptive_control_asks_for_the_pressures_that_it_is_to_use():
    controller = AdaptiveController(AdaptiveParameters(pressure_sensors=1.0))
    controller.reset(1, BOGIE)
    seen = Measurement(np.zeros(1), np.full((1, 2), 60.0), np.ones(1))
    controller.act(seen)
    with pytest.raises(ValueError, match="needs cylinder pressures"):
        controller.act(seen._replace(time=np.array([0.02])))


@pytest.mark.parametrize(("name", "vehicles", "dry"), [("nominal", 1, DRY), ("drawn brakes", DRAWS, DRAWS)])
def test_each_stop_is_braked_once_for_each_axle_whose_sensor_fails(name, vehicles, dry):
    parts = parts_of(Arguments("bogie", DRAWS, world=name, demand=0.5))
    for ground, count, stops in (("recovering", vehicles, DRAWS), ("classic", vehicles, DRAWS), ("dry", vehicles, dry)):
        own = [part for part in parts if part.rail == ground]
        assert len(own) == count
        assert sum(len(part.stops) for part in own) == BOGIE.axles * stops
        assert all(part.axle.tolist() == [0, 1] * (len(part.stops) // 2) for part in own)
        assert all(stop.demand == 0.5 and stop.coverage.any() == (ground != "dry") for part in own for stop in part.stops)
