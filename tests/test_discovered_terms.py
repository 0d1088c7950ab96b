"""Which terms without a name are tried: in which slots, on which axles, and on which side."""

from types import SimpleNamespace

import numpy as np
import pytest

from wsp_env.diagnosis.balances import ADHESION, VEHICLE
from wsp_env.diagnosis.candidates import Candidate
from wsp_env.diagnosis.discovered import MISREAD, NAME, axle_groups, equation, slot_of, terms
from wsp_env.diagnosis.search import can_be
from wsp_env.plant.mechanisms.term_words import SLOTS
from wsp_env.plant.mechanisms.terms import Slot


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


def tried(accepted=(), measured=False, slides=True):
    """The terms that are tried on a coach."""
    rows = SimpleNamespace(balance=np.array([ADHESION if slides else VEHICLE]), place=np.array([0.0, 900.0]))
    vehicle = SimpleNamespace(running_gear=((2, 2),))
    campaign = SimpleNamespace(vehicle=SimpleNamespace(torque_is_measured=measured))
    return terms(SimpleNamespace(rows=rows, vehicle=vehicle, campaign=campaign), accepted)


def slots(variants):
    return {slot_of(one) for one in variants}


def test_every_slot_is_tried_but_those_that_recordings_say_nothing_of():
    names = {slot: words for slot, (words, _) in SLOTS.items()}
    assert slots(tried()) == set(names.values())
    assert slots(tried(measured=True)) == set(names.values()) - {names[Slot.BRAKE_TORQUE]}
    assert slots(tried(slides=False)) == set(names.values()) - {names[Slot.FRICTION], names[Slot.RECOVERY]}


def test_a_model_holds_three_terms_of_the_plant_and_one_of_the_recorded_speed():
    every = tried()
    of_plant, of_speed = (next(one for one in every if one.name == name) for name in (NAME, MISREAD))
    assert slots(tried([of_speed])) == slots(every) - {slot_of(of_speed)}
    assert slots(tried([of_plant] * 3)) == {slot_of(of_speed)}
    assert not tried([of_plant] * 3 + [of_speed])
    # The next term has numbers of its own.
    assert {one.sizes[0] for one in tried([of_plant]) if one.name == NAME} == {"coefficient_2"}


def test_friction_by_the_rate_of_the_slip_can_only_rise():
    rising = next(one for one in tried() if one.family == "friction by slip rate")
    candidate = Candidate(rising, np.zeros((0, 1)), np.ones(1))
    assert can_be(candidate, np.array([-1.0]))  # a residual is taken away: the coefficient is minus the amplitude
    assert not can_be(candidate, np.array([1.0]))
    either = next(one for one in tried() if one.family == "friction by work")
    assert can_be(Candidate(either, np.zeros((0, 1)), np.ones(1)), np.array([1.0]))


def test_a_group_of_axles_is_said():
    one = next(one for one in tried() if one.family == "friction of axle 3 4 by speed")
    words = equation(one, one.fixed | {"coefficient_1": -0.1})
    assert words.axles == (3, 4)
    assert words.equation == "friction of axles 3 and 4 falls by 10 %, times running speed over 30 m/s"
