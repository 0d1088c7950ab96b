"""The policies that come with the repository."""

from pathlib import Path

import numpy as np
import pytest

from agents.measure import HELD_OUT, Yardstick, low_adhesion, mixed
from wsp_env.evaluation.controller import load
from wsp_env.evaluation.runner import Conduct, measure, start_plant
from wsp_env.parameters.uic_z1 import VEHICLES

SHIPPED = sorted(path.parent for path in (Path(__file__).parents[1] / "agents/trained").glob("*/contract.json"))


def test_policies_are_shipped():
    assert {folder.name for folder in SHIPPED} >= {"bogie"}


@pytest.mark.parametrize("folder", SHIPPED, ids=lambda folder: folder.name)
def test_shipped_policies_stop_without_locked_wheels(folder):
    yardstick = Yardstick(folder.name, mixed(folder.name, 8, 0.5, HELD_OUT))
    found = yardstick.figures(load(str(folder)))
    assert found["stopped"].all()
    assert (found["locked_s"] == 0.0).all()
    rules = yardstick.figures(load("rule-based"))
    for law in (slice(4), slice(4, 8)):  # recovering, classic
        assert found["distance_m"][law].mean() < rules["distance_m"][law].mean()


@pytest.mark.parametrize("folder", SHIPPED, ids=lambda folder: folder.name)
@pytest.mark.parametrize("law", [pytest.param("recovering", marks=pytest.mark.long), "classic"])
def test_shipped_policies_know_the_running_speed(folder, law):
    """To the deviation that they claim, at any time of stops in which all wheels may slide at once."""
    vehicle, controller = VEHICLES[folder.name], load(str(folder))
    plant = start_plant(vehicle, low_adhesion(vehicle, law, 12, 77), Conduct())
    controller.reset(plant.n, vehicle)
    wrong = []
    while (fast := plant.state.speed > 3.0).any():
        plant.step(controller.act(measure(plant)))
        estimate = controller._observer.estimate
        wrong.append(np.where(fast, (estimate.speed - plant.state.speed) / estimate.uncertainty, 0.0))
    assert 0.2 < np.sqrt(np.mean(np.square(wrong))) < 1.0
    assert np.abs(wrong).max() < 4.0
