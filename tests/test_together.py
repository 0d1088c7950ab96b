"""Wheelsets that clean the rail for those behind: the slips worth their price together, the rule, and the world to train in."""

import dataclasses
import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from agents import drawn, leading
from agents.axles import EachAxle
from agents.drawn import REMOVAL_M_PER_J, world
from agents.measure import low_adhesion
from agents.settings import Arguments, task_options
from agents.teacher import Teacher
from agents.together import Together, removal_of
from agents.varied import NOMINAL, VEHICLES, varied_parts
from agents.watch import LAWS
from baselines.adaptive import AdaptiveController, AdaptiveParameters
from wsp_env.contact.port import adhesion_under
from wsp_env.evaluation.runner import Conduct, run, start_plant
from wsp_env.parameters.uic_z1 import BOGIE, COACH
from wsp_env.scenario import Scenario, draw

PRICE = 3.0
CLEANS = {"leading_axle_cleaning": {"removal_m_per_j": 1.5e-4}}
CONDITIONS = {"mu_cd": 0.03, "tau": 1.9e-4, "initial_speed": 30.0, "demand": 1.0, "load": 0.0, "track": "constant"}


def stops(vehicle, count=1, classic=False, **changes):
    pins = CONDITIONS | changes
    return [draw(Scenario(), vehicle, np.random.default_rng(i), 1, pins, classic=classic) for i in range(count)]


def price_of(plant, slip, removal):
    """Price of a metre a second less (v + c mean s) / mean f, where slips (..., A) [m/s] clean the rail at 30 m/s."""
    vehicle, c = plant.vehicle, plant.conditions
    load = c.mass[0] * vehicle.gravity_mps2 / (2.0 * vehicle.axles)
    offered = vehicle.full_brake_torque_nm / (vehicle.wheel_radius_m * 2.0 * load)
    spent, total = 0.0, 0.0
    for own in np.moveaxis(slip, -1, 0):
        layer = np.exp(-removal * spent)
        adhesion = adhesion_under(vehicle.contact.law, own, 30.0, load, c.mu_cd[0], c.tau[0], layer)
        total, spent = total + np.minimum(adhesion, offered), spent + np.minimum(adhesion, offered) * load * own / 30.0
    return (30.0 + PRICE * slip.mean(axis=-1)) / (total / vehicle.axles)


@pytest.mark.parametrize("removal", [2e-5, 1.5e-4])
def test_no_pair_of_slips_is_cheaper_than_those_chosen_together(removal):
    plant = start_plant(BOGIE, stops(BOGIE), Conduct(mechanisms={"leading_axle_cleaning": {"removal_m_per_j": removal}}))
    chosen = Together(plant, PRICE).targets(np.array([30.0]))[0]
    shares = np.array(list(itertools.product(np.geomspace(0.002, 0.3, 120), repeat=2)))
    least = price_of(plant, 30.0 * shares, removal).min()
    assert price_of(plant, chosen, removal) <= 1.01 * least  # the steps between the slips tried


def test_the_leading_axle_slides_more_if_it_cleans_and_the_last_no_more():
    found = []
    for removal in (1e-9, 2e-5, 1.5e-4):
        conduct = Conduct(mechanisms={"leading_axle_cleaning": {"removal_m_per_j": removal}})
        found.append(Teacher(start_plant(COACH, stops(COACH), conduct), PRICE).targets()[0])
    alone = Teacher(start_plant(COACH, stops(COACH), Conduct()), PRICE).targets()[0]
    assert_allclose(found[0], alone, rtol=0.35)  # two ladders of slips
    for own in found[1:]:
        assert own[0] > found[0][0]
        assert own[-1] < found[0][-1] * 1.01


@pytest.mark.parametrize(
    ("mechanisms", "removal"), [({}, 0.0), (CLEANS, 1.5e-4), ({"leading_axle_cleaning": {}}, 2e-5), ({"vehicle_mass": {}}, 0.0)]
)
def test_the_removal_is_that_of_the_plant_by_default_too(mechanisms, removal):
    assert removal_of(start_plant(BOGIE, stops(BOGIE), Conduct(mechanisms=mechanisms))) == removal


def test_targets_follow_a_stop_that_begins_anew():
    plant = start_plant(BOGIE, stops(BOGIE, 2), Conduct(mechanisms=CLEANS))
    teacher = Teacher(plant, PRICE)
    before = teacher.targets()
    plant.start(1, stops(BOGIE, mu_cd=0.06)[0])
    after = teacher.targets()
    assert_allclose(after[0], before[0])
    assert (after[1] != before[1]).any()


def test_the_leading_axles_are_held_at_their_creepage():
    creepage = {}
    for axles in (0.0, 1.0, 2.0):
        own = AdaptiveParameters(leading_axles=axles, leading_creepage=0.2)
        result = run(AdaptiveController(own), COACH, stops(COACH, 2, classic=True), Conduct())
        counted = (result.speed > 10.0) & (result.speed < 25.0)
        creepage[axles] = (result.slip / np.maximum(result.speed, 1.0)[..., None])[counted].mean(axis=0)
    assert creepage[0.0].max() < 0.04
    assert_allclose(creepage[1.0][0], 0.2, atol=0.05)
    assert_allclose(creepage[2.0][:2], 0.2, atol=0.05)
    assert creepage[1.0][1:].max() < 0.1


def test_the_world_differs_from_all_by_the_cleaning_alone():
    every, cleaned = (world(name, BOGIE, "recovering", 8, 3) for name in ("all", "cleaning"))
    for (own, mechanisms, _), (other, more, _) in zip(every, cleaned, strict=True):
        added = dict(more)
        removal = added.pop("leading_axle_cleaning")["removal_m_per_j"]
        assert (own, mechanisms) == (other, added)
        assert REMOVAL_M_PER_J[0] <= removal <= REMOVAL_M_PER_J[1]


def test_drawn_vehicles_of_the_training_clean():
    options = task_options(Arguments(torque_per_bar_nm=BOGIE.brake.torque_per_bar_nm))
    parts = varied_parts("bogie", VEHICLES, "recovering", options, PRICE, 1, "cleaning")
    removal = [Teacher(part.batch.plant, PRICE).together is not None for part in parts]
    assert removal == [True] * (VEHICLES - NOMINAL) + [False] * NOMINAL


def test_a_shared_reward_counts_what_those_behind_give_away():
    own = np.array([[-1.0, -2.0, -4.0, -8.0]])
    agents = EachAxle.__new__(EachAxle)
    part = SimpleNamespace(own=own)
    agents.parts, agents.shared = [part], True
    assert_allclose(agents.rewards(), [[-15.0, -14.0, -12.0, -8.0]])
    agents.shared = False
    assert_allclose(agents.rewards(), own)


@pytest.mark.long
def test_policies_are_told_over_the_best_of_all_rivals(monkeypatch):
    def slow(*given):  # soon over
        return [dataclasses.replace(stop, initial_speed=12.0) for stop in low_adhesion(*given)]

    monkeypatch.setattr(drawn, "low_adhesion", slow)
    for name, values in {"PRICES": (1.5,), "TAUGHT": (1.5,), "CREEPAGES": (0.2,), "_LED": (1.5,)}.items():
        monkeypatch.setattr(leading, name, values)
    rows, best = leading.compare(leading.Arguments("bogie", stops=8))
    assert len(rows) == 5  # two adaptive controllers, two teachers and the shipped policy
    by_name = {row["controller"]: row for row in rows}
    assert by_name[best]["ratio"] == 1.0
    assert by_name[best]["error"] == 0.0
    rivals = [row["ratio"] for row in rows if not row["controller"].startswith(("policy", "teacher, price"))]
    assert min(rivals) == 1.0
    for row in rows:
        both = [sum(one[f"{law}_paid_m"] for law in LAWS) for one in (row, by_name[best])]
        assert_allclose(row["ratio"], both[0] / both[1])
        assert f"| {row['controller']} |" in leading.table(rows, best)
