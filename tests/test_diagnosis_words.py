"""What a diagnosis says in words: the right direction, size, axle and place, and no more certainty than there is."""

import dataclasses

import numpy as np
import pytest

from wsp_env.diagnosis.answer import Discovered, Estimate, Location, Named
from wsp_env.diagnosis.words import capital, mechanism_words, next_test, parameter_said, parameter_words, sentence, unit_words
from wsp_env.plant.mechanisms import ALL, leading_axle_cleaning


def estimates(mechanism: str, **values: float | tuple[float, float, float]) -> dict[str, Estimate]:
    """Return estimates: value, or value with its interval."""
    units = {one.name: one.unit for one in ALL[mechanism].parameters}
    found = {}
    for name, given in values.items():
        value, low, high = given if isinstance(given, tuple) else (given, given, given)
        found[name] = Estimate(value, units[name], (low, high))
    return found


def named(mechanism: str, parameters: dict[str, Estimate], multiple: float = 3.0, others: tuple[str, ...] = ()) -> Named:
    return Named(mechanism, 0.9, (mechanism, *others), parameters, multiple, 100.0, 10.0, 50.0)


WEAKER = estimates("brake_gain_imbalance", gain=(-0.039, -0.051, -0.027), axle=2.0)


@pytest.mark.parametrize(
    ("mechanism", "values", "words"),
    [
        ("brake_gain_imbalance", {"gain": (-0.039, -0.051, -0.027), "axle": 2.0},
         "axle 2's brake is 3.9 % weaker than believed (2.7 to 5.1 %)"),
        ("brake_gain_imbalance", {"gain": (0.039, -0.01, 0.08), "axle": 4.0},
         "axle 4's brake is 4 % stronger than believed (-1 to 8 %)"),
        ("adhesion_patch", {"change": (0.13, 0.11, 0.152), "start_m": 582.0, "length_m": 120.0, "edge_m": 2.0},
         "the adhesion is 13 % higher from 582 m to 702 m (11 to 15 %)"),
        ("adhesion_patch", {"change": (0.26, 0.15, 0.37), "start_m": -14234.0, "length_m": 14386.0, "edge_m": 2.0},
         "the adhesion is 26 % higher up to 152 m (15 to 37 %)"),
        ("adhesion_patch", {"change": (0.2, 0.13, 0.28), "start_m": 647.0, "length_m": 1.0, "edge_m": 44.3},
         "the adhesion is 20 % higher from 608 m to 687 m (13 to 28 %)"),
        ("adhesion_patch", {"change": (-0.2, -0.25, -0.15), "start_m": 582.0, "length_m": 9000.0, "edge_m": 2.0},
         "the adhesion is 20 % lower from 582 m on (15 to 25 %)"),
        ("track_gradient", {"rise": (-0.0089, -0.0097, -0.0081)},
         "the track falls by 8.9 per mille more than believed (8.1 to 9.7 per mille)"),
        ("initial_slope", {"factor": (1.047, 1.03, 1.06)}, "the creep curve begins 4.7 % steeper than Kalker's (3.0 to 6.0 %)"),
        ("initial_slope", {"factor": (0.4, 0.35, 0.45)}, "the creep curve begins 60 % flatter than Kalker's (55 to 65 %)"),
        ("wheel_radius", {"change": (-0.01, -0.0102, -0.0098), "axle": 3.0},
         "axle 3's wheels are 1.00 % smaller than believed (0.98 to 1.02 %)"),
        ("clock_offset", {"offset_s": (0.1, 0.09, 0.11)},
         "the vehicle's speed is recorded 100 ms late beside the wheel speeds (90 to 110 ms)"),
        ("pad_friction", {"per_speed_s_per_m": (-5e-3, -6e-3, -4e-3), "per_temperature_1_per_k": (1e-5, -2e-5, 4e-5)},
         "the pads' friction falls by 5.0 % for every 10 m/s of speed (4.0 to 6.0 %)"),
        ("aerodynamic_drag", {"c_ns2_per_m2": (2.0, 1.0, 3.0)},
         "the running resistance at 30 m/s is 1.8 kN higher than believed (0.9 to 2.7 kN)"),
        ("non_adhesive_brake", {"force_n": (5e3, 4e3, 6e3), "lowest_mps": 8.0},
         "a brake that needs no wheels gives 5.0 kN above 8 m/s (4.0 to 6.0 kN)"),
    ],
)  # fmt: skip
def test_a_mechanism_is_said_with_direction_size_and_place(mechanism, values, words):
    assert mechanism_words(mechanism, estimates(mechanism, **values)) == words


@pytest.mark.parametrize("name", ALL)
def test_every_mechanism_of_the_library_has_words_for_every_size_and_sign(name):
    for size in ALL[name].sizes:
        if not size.fitted:
            continue
        texts = set()
        for value in {size.low, size.high} - {size.null}:
            given = {one.name: one.typical for one in ALL[name].parameters if one.kind != "size"} | {size.name: value}
            texts.add(mechanism_words(name, estimates(name, **given)).partition(" (")[0])
        assert len(texts) == (1 if size.null in (size.low, size.high) else 2)


def test_the_layer_taken_away_is_the_plant_s():
    removal = 2e-5
    spent = leading_axle_cleaning.Spent(np.full((1, 4), 1e4), np.zeros((1, 2)))
    left, _ = leading_axle_cleaning.layer_left(leading_axle_cleaning.Parameters(removal), spent, 0, 1, 0.0, 0.0, 1.0, 0.0)
    words = mechanism_words("leading_axle_cleaning", estimates("leading_axle_cleaning", removal_m_per_j=(removal, 1e-5, 3e-5)))
    assert f"takes away {100.0 * (1.0 - left):.0f} % of the contaminant layer" in words


def test_the_sentence_claims_no_more_than_there_is():
    sure = sentence("named", [named("brake_gain_imbalance", WEAKER)], ())
    assert sure == "What the simulation lacks: axle 2's brake is 3.9 % weaker than believed (2.7 to 5.1 %)."
    small = sentence("named", [named("brake_gain_imbalance", WEAKER, multiple=0.7)], ())
    assert "perhaps axle 2's brake" in small
    assert "at the limit of what matters in a stop" in small
    torn = sentence("named", [named("brake_gain_imbalance", WEAKER, others=("load_transfer",))], ())
    assert "probably axle 2's brake" in torn
    assert "(or it is load transfer: these recordings cannot tell)" in torn


def test_a_term_without_a_name_is_said_with_its_equation_and_what_it_looks_like():
    term = Discovered(
        "brake torque", (), (), (3,), "650 N m on axle 3 while braking", ("braking",),
        {"coefficient_1": Estimate(650.0, "-", (600.0, 700.0))}, ("dragging brake",), 0.8, 3.0, 100.0, 50.0,
    )  # fmt: skip
    words = sentence("discovered", (), (), (term,))
    assert words.startswith("What the simulation lacks: something without a name in the library, 650 N m on axle 3")
    assert "looks like: dragging brake" in words
    further = dataclasses.replace(term, equation="30 N m more per s on axle 3", looks_like=("dragging brake", "fading"))
    elsewhere = dataclasses.replace(term, axles=(4,), equation="9 N m on axle 4", looks_like=())
    words = sentence("discovered", (), (), (term, elsewhere, further))
    assert words.count("something without a name") == 2
    assert "while braking, and 30 N m more per s on axle 3, which looks like: dragging brake or fading; and" in words
    assert words.endswith("something without a name in the library, 9 N m on axle 4.")
    both = sentence("named", [named("brake_gain_imbalance", WEAKER)], (), (term,))
    assert both.index("axle 2's brake") < both.index("something without a name")
    test = next_test("discovered", (), {}, (), (term,))
    assert "braking" in test
    assert "brake torque on axle 3" in test
    plain = dataclasses.replace(term, features=())
    assert next_test("discovered", (), {}, (), (plain,)) == "the brake torque on axle 3 measured by itself"
    bump = dataclasses.replace(term, slot="vehicle force", features=("a bump 140 m long about 307 m along the track",))
    assert next_test("discovered", (), {}, (), (bump,)).endswith("earlier: the vehicle force must stay at its place")


def test_an_unknown_cause_is_said_with_the_balance_that_is_off():
    place = Location("actuator", (3,), ("A1",), "everywhere", 0.9)
    said = sentence("unknown", (), (place,), nearest=("brake delay",))
    assert "It shows in the balance of brake torque against pressure of axle 3." in said
    assert "in no form that holds: brake delay" in said
    assert next_test("unknown", (), {})


@pytest.mark.parametrize(
    ("balance", "wanted"),
    [("adhesion", "controlled slip"), ("actuator", "torque measured"), ("vehicle", "couplers"), ("kinematics", "diameters")],
)
def test_the_next_test_of_an_unknown_cause_follows_the_balance_that_is_off(balance, wanted):
    assert wanted in next_test("unknown", (), {}, (Location(balance, (), ("A1",), "everywhere", 0.9),))


@pytest.mark.parametrize(
    ("parameter", "estimate", "words"),
    [
        ("axle", Estimate(3.0, "-", (3.0, 3.0)), "axle 3"),
        ("axle", Estimate(0.0, "-", (0.0, 0.0)), "every axle"),
        ("start_m", Estimate(582.0, "m", (582.0, 582.0)), "start 582 m"),
        ("gain", Estimate(-0.039, "-", (-0.051, -0.027)), "relative change of the gain -0.039 (-0.051 to -0.027)"),
        ("torque_nm", Estimate(650.0, "N m", (600.0, 700.0)), "torque 650 N m (600 to 700 N m)"),
    ],
)
def test_a_parameter_is_said_once_and_without_a_dash_for_a_unit(parameter, estimate, words):
    assert parameter_said(parameter, estimate) == words


@pytest.mark.parametrize("name", ALL)
def test_names_of_parameters_are_words_without_their_units(name):
    words = [parameter_words(one.name) for one in ALL[name].parameters]
    assert len(set(words)) == len(words)
    assert not any("_" in one or len(one) < 3 for one in words)
    assert "-" not in [unit_words(one.unit) for one in ALL[name].parameters]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("the axle slides", "The axle slides"),
        ("odd/A1.csv: late", "odd/A1.csv: late"),
        (r"d:\a1.csv is late", r"d:\a1.csv is late"),
    ],
)
def test_a_path_at_the_beginning_of_a_sentence_stays_as_it_is(text, expected):
    assert capital(text) == expected
