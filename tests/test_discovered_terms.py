"""Which terms without a name are tried: in which slots, on which axles, and on which side."""

from types import SimpleNamespace

import numpy as np
import pytest
from trial_cases import trial

from wsp_env.diagnosis import discovered
from wsp_env.diagnosis.accepted import Accepted
from wsp_env.diagnosis.balances import ACTUATOR, ADHESION, VEHICLE
from wsp_env.diagnosis.candidates import Candidate, Variant, located, refined
from wsp_env.diagnosis.discovered import (
    MISREAD,
    MISREAD_WHEEL,
    NAME,
    axle_groups,
    behind_the_first,
    curves,
    equation,
    slot_of,
    slot_of_title,
    terms,
    unit_in,
)
from wsp_env.diagnosis.search import is_possible
from wsp_env.diagnosis.verdict import has_another_form
from wsp_env.plant.mechanisms.term_words import SLOTS
from wsp_env.plant.mechanisms.terms import Feature, Slot


@pytest.mark.parametrize(
    ("gear", "groups"),
    [
        (((1,),), []),
        (((2,),), [(1,), (2,)]),
        (((1, 1),), [(1,), (2,)]),
        (((2, 2),), [(1,), (2,), (3,), (4,), (1, 2), (3, 4), (1, 3), (2, 4)]),
        (((2, 3),), [(1,), (2,), (3,), (4,), (5,), (1, 2), (3, 4, 5), (1, 3), (2, 4)]),
    ],
)
def test_groups_are_axles_bogies_and_places_within_them_but_never_all(gear, groups):
    assert axle_groups(gear) == groups


@pytest.mark.parametrize(("gear", "behind"), [(((2, 2),), [(2, 3, 4)]), (((2,),), []), (((1,),), [])])
def test_axles_behind_the_first_are_a_group_where_they_are_no_other(gear, behind):
    assert behind_the_first(gear) == behind


def test_what_the_first_axle_does_to_the_rail_acts_on_the_others():
    families = {one.family for one in tried()}
    assert "friction of axles 2, 3 and 4 by speed" in families
    assert not any("of axles 2, 3 and 4" in one for one in families if not one.startswith("friction"))


def tried(accepted=(), measured=False, slides=True, search=terms, rolls=False, pressures=False):
    """The terms, or the curves, that are tried on a coach; `rolls`: under the brake, but without a slide."""
    n = 500
    balance = np.full(n, ADHESION if slides else VEHICLE)
    balance[-1] = ACTUATOR if pressures else balance[-1]
    rows = SimpleNamespace(
        balance=balance, place=np.linspace(0.0, 900.0, n), time=np.linspace(0.0, 40.0, n),
        speed=np.linspace(40.0, 2.0, n), slip=np.linspace(0.0, 5.0, n), slides=np.full(n, slides and not rolls),
    )  # fmt: skip
    vehicle = SimpleNamespace(running_gear=((2, 2),))
    campaign = SimpleNamespace(vehicle=SimpleNamespace(torque_is_measured=measured))
    return search(SimpleNamespace(rows=rows, vehicle=vehicle, campaign=campaign), accepted)


def slots(variants):
    return {slot_of(one) for one in variants}


def test_every_slot_is_tried_but_those_that_recordings_say_nothing_of():
    names = {slot: words for slot, (words, _) in SLOTS.items()}
    assert slots(tried()) == set(names.values())
    assert slots(tried(measured=True)) == set(names.values()) - {names[Slot.BRAKE_TORQUE]}
    assert slots(tried(measured=True, pressures=True)) == set(names.values())
    assert slots(tried(slides=False)) == set(names.values()) - {names[Slot.FRICTION], names[Slot.RECOVERY]}


def test_a_model_holds_three_terms_of_the_plant_one_of_the_recorded_speed_and_one_of_a_wheel_sensor():
    names = {NAME, MISREAD, MISREAD_WHEEL}
    of_plant, of_speed, of_wheel = (next(one for one in tried() if one.name == name) for name in (NAME, MISREAD, MISREAD_WHEEL))
    assert {one.name for one in tried([of_speed])} == names - {MISREAD}
    assert {one.name for one in tried([of_wheel])} == names - {MISREAD_WHEEL}
    assert {one.name for one in tried([of_plant] * 3)} == names - {NAME}
    assert not tried([of_plant] * 3 + [of_speed, of_wheel])
    # The next term has numbers of its own.
    assert {one.sizes[0] for one in tried([of_plant]) if one.name == NAME} == {"coefficient_2"}


def test_a_refit_moves_a_bump_what_dies_away_and_the_speed_above_which_pulses_are_lost_and_no_other_term():
    """The search tries few places, widths, times and works."""
    for one in tried([next(one for one in tried() if one.name == NAME)]):
        bump = "place bump" in one.family
        lost = one.family.startswith("wheel reading") and one.family.endswith("always")
        dies_away = one.family.endswith(("settling", "warming", "fading out"))
        moved = {"scale_2", "second_scale_2"} if bump else {"above_mps"} if lost else {"scale_2"} if dies_away else set()
        assert set(located(one)) == moved
        assert len(refined(one).sizes) == len(one.sizes) + len(located(one))
        assert slot_of(refined(one)) == slot_of(one)


@pytest.mark.parametrize(
    ("family", "units"),
    [
        ("vehicle force by place bump", {"coefficient_2": "N", "scale_2": "m", "second_scale_2": "m", "low_2": "-"}),
        ("brake torque by slip", {"coefficient_2": "N m / (m/s)", "scale_2": "-", "high_2": "m/s", "slot_2": "-"}),
        ("wheel reading of axle 2 by time", {"coefficient": "- / (s)", "axles": "-"}),
        ("wheel reading of axle 2 by always", {"coefficient": "-", "above_mps": "m/s"}),
        ("recorded speed by time", {"coefficient": "m/s / (s)", "feature": "-"}),
    ],
)
def test_parameters_of_terms_have_the_units_of_slot_and_feature(family, units):
    one = next(one for one in tried([next(one for one in tried() if one.name == NAME)]) if one.family == family)
    assert {name: unit_in(one, name) for name in units} == units


def test_friction_by_the_rate_of_the_slip_can_only_rise():
    rising = next(one for one in tried() if one.family == "friction by slip rate")
    candidate = Candidate(rising, np.zeros((0, 1)), np.ones(1))
    assert is_possible(candidate, np.array([-1.0]))  # a residual is taken away: the coefficient is minus the amplitude
    assert not is_possible(candidate, np.array([1.0]))
    either = next(one for one in tried() if one.family == "friction by work")
    assert is_possible(Candidate(either, np.zeros((0, 1)), np.ones(1)), np.array([1.0]))


def test_a_rigging_can_only_hold_the_torque_back():
    play = next(one for one in tried() if one.family == "brake torque of axles 3 and 4 by torque play")
    candidate = Candidate(play, np.zeros((0, 1)), np.ones(1))
    assert is_possible(candidate, np.array([-1.0]))
    assert not is_possible(candidate, np.array([1.0]))


def test_a_curve_is_a_partition_of_one_over_what_was_recorded():
    """Its tents with equal coefficients are a constant between the first knot and the last."""
    curve = next(one for one in tried(search=curves) if one.family == "friction by a curve over slip")
    tents = [(curve.fixed[f"scale_{k}"], curve.fixed[f"second_scale_{k}"]) for k in (1, 2, 3)]
    assert {curve.fixed[f"feature_{k}"] for k in (1, 2, 3)} == {float(Feature.SLIP_TENT)}
    slip = np.linspace(tents[0][0], tents[-1][0], 50)
    sums = sum(np.clip(1.0 - np.abs(slip - middle) / half, 0.0, None) for middle, half in tents)
    np.testing.assert_allclose(sums, 1.0)
    assert 0.0 < tents[0][0] < 0.2 < 4.8 < tents[-1][0] < 5.0


def test_curves_take_the_terms_that_are_left():
    of_plant = next(one for one in tried() if one.name == NAME and len(one.sizes) == 1)
    assert {len(one.sizes) for one in tried(search=curves)} == {3}
    assert {one.sizes for one in tried([of_plant], search=curves)} == {("coefficient_2", "coefficient_3")}
    assert not tried([of_plant] * 2, search=curves)  # one tent is no curve
    assert slots(tried(measured=True, search=curves)) == {"friction", "vehicle force"}
    assert slots(tried(slides=False, search=curves)) == {"brake torque", "vehicle force"}
    assert slots(tried(rolls=True, search=curves)) == {"brake torque", "vehicle force"}


def test_a_group_of_axles_is_said():
    one = next(one for one in tried() if one.family == "friction of axles 3 and 4 by speed")
    words = equation(one, one.fixed | {"coefficient_1": -0.1})
    assert words.axles == (3, 4)
    assert words.equation == "friction of axles 3 and 4 falls by 10 %, times running speed over 30 m/s"


def test_what_competes_with_a_term_has_a_slot():
    assert all(slot_of_title(one.title) == slot_of(one) for search in (terms, curves) for one in tried(search=search))
    slots_of = {name: slot_of_title(name) for name in ("flash_temperature", "dragging_brake", "vehicle_mass", "clock_offset")}
    assert list(slots_of.values()) == ["friction", "brake torque", "vehicle force", "sensor"]


@pytest.mark.parametrize(
    ("name", "fixed", "thing"),
    [
        ("brake_gain_imbalance", {"axle": 2.0}, (Slot.BRAKE_TORQUE, (2,))),
        ("dragging_brake", {"axle": 1.0, "from_start": 1.0}, (Slot.BRAKE_TORQUE, (1,))),
        ("blended_brake", {"axle": 3.0, "last_axle": 4.0}, (Slot.BRAKE_TORQUE, (3, 4))),
        ("brake_delay", {"axle": 0.0}, None),  # all brakes
        ("pad_friction", {}, None),
        ("wheel_radius", {"axle": 2.0}, (Slot.RECORDED_SPEED, ())),
        ("clock_offset", {}, (Slot.RECORDED_SPEED, ())),
        ("sanding", {"axle": 2.0}, None),
        ("track_gradient", {}, None),
    ],
)
def test_the_one_thing_on_which_a_mechanism_acts(name, fixed, thing):
    assert discovered.one_thing(Variant(name, (), fixed)) == thing


@pytest.mark.parametrize(
    ("name", "slot", "on", "another"),
    [
        ("brake_gain_imbalance", Slot.BRAKE_TORQUE, (2,), True),  # two faults of one brake
        ("brake_gain_imbalance", Slot.BRAKE_TORQUE, (1,), False),
        ("brake_gain_imbalance", Slot.BRAKE_TORQUE, (1, 2), False),
        ("brake_gain_imbalance", Slot.BRAKE_TORQUE, (), False),
        ("brake_gain_imbalance", Slot.FRICTION, (2,), False),
        ("brake_gain_imbalance", Slot.RECORDED_SPEED, (), False),
        ("wheel_radius", Slot.RECORDED_SPEED, (), True),  # a wheel's sensor that loses pulses
        ("wheel_radius", Slot.BRAKE_TORQUE, (2,), False),
        ("speed_dependent_friction", Slot.FRICTION, (), False),  # all that is of the contact is friction
    ],
)
def test_a_name_beside_a_term_of_the_same_thing_has_another_form(name, slot, on, another):
    def accepted(variant):
        return Accepted(trial(variant, 40.0), (variant.title,), 1.0)

    one = accepted(Variant(name, (), {"axle": 2.0}))
    beside = accepted(discovered._variant(1, slot, on, Feature.SPEED, (1.0, 1.0)))
    assert has_another_form(one, [one, beside]) == another
    assert not has_another_form(one, [one])
