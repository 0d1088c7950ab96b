"""Where a mechanism is said to act."""

import copy
import dataclasses
import re

import pytest
from replica_cases import LAW, sound_balances

from wsp_env.diagnosis.balances import VEHICLE
from wsp_env.diagnosis.locate import locate
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.variation import nuisances
from wsp_env.diagnosis.weights import weigh


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    return Replica(sound_balances(tmp_path_factory.mktemp("locate") / "c"), LAW)


def places(sound, **choice):
    """Return the locations by balance, of a mechanism that the recordings show and the law lacks."""
    extended = dataclasses.replace(LAW, choice=choice)
    shows = copy.copy(sound)
    shows._offset = sound._offset + sound.raw(LAW) - sound.raw(extended)
    whitening = shows.whitening(LAW)
    weights = weigh(shows, whitening, nuisances(shows, LAW, shows.raw(LAW), whitening))
    return {one.equation: one.where for one in locate(shows, LAW, extended, weights)}


def test_a_constant_force_acts_everywhere_though_its_effect_on_the_speed_grows(sound):
    assert places(sound, track_gradient={"rise": -0.01})["vehicle"] == "everywhere"


def test_a_force_above_a_speed_acts_until_the_vehicle_is_slower(sound):
    where = places(sound, non_adhesive_brake={"lowest_mps": 30.0})["vehicle"]
    name, low, high = re.match(r"(time|speed) from (\S+) to (\S+)", where).groups()
    values = getattr(sound.rows, name)
    inside = (sound.rows.balance == VEHICLE) & (values >= float(low) - 0.05) & (values <= float(high) + 0.05)
    assert sound.rows.speed[inside].min() == pytest.approx(30.0, abs=1.0)


def test_ranges_have_no_digits_that_no_sensor_has(sound):
    decimals = {"place": 0, "time": 1, "speed": 1, "slip": 2, "friction": 0}
    for choice in ({"wheel_radius": {"change": -0.006, "axle": 2.0}}, {"brake_gain_imbalance": {"gain": -0.1, "axle": 1.0}}):
        for where in places(sound, **choice).values():
            assert all(len(digits) <= decimals[where.split()[0]] for digits in re.findall(r"\.(\d+)", where)), where
