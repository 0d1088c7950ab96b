"""The evaluation along recordings takes many contacts, and several stops, at once: what it says is what one by one says."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from wsp_env.contact.port import LAWS, traction, tractions
from wsp_env.contact.traction import Adhesion, Surface
from wsp_env.parameters.contact import ContactParameters
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.plant.card import Doing
from wsp_env.plant.longitudinal.along import Belief, Prediction, Trajectory, along, model
from wsp_env.plant.longitudinal.samples import SPARE
from wsp_env.plant.mechanisms import ALL
from wsp_env.plant.mechanisms.discovered import parameters_of
from wsp_env.plant.mechanisms.terms import UNBOUNDED, Feature, Slot, Term

STEP_S, SAMPLES, MASS_KG = 0.02, 500, 43e3
FORCES = [i for i, name in enumerate(Prediction._fields) if not name.startswith("adhesion")]
SIZES = {Slot.BRAKE_TORQUE: 300.0, Slot.FRICTION: 0.1, Slot.RECOVERY: 0.3, Slot.VEHICLE_FORCE: 900.0}
CHOICES = {name: {name: {}} for name in ALL} | {
    f"{slot.name} by {feature.name}": {
        "discovered": parameters_of([Term(SIZES[slot], float(slot), 0.0, float(feature), 1.0, 1.0, -UNBOUNDED, UNBOUNDED)])
    }
    for slot in SIZES
    for feature in (Feature.WORK, Feature.SLIP, Feature.BUILT_UP, Feature.PLACE_BUMP)
}


def a_stop(seed: int, samples: int = SAMPLES) -> Trajectory:
    """Wheels that slide now and then, under brakes that are applied after a second."""
    rng = np.random.default_rng(seed)
    time = STEP_S * np.arange(samples)
    speed = 35.0 - 0.8 * np.maximum(time - 1.0, 0.0)
    swings = np.sin(time[:, None] * rng.uniform(0.5, 2.0, 4) + rng.uniform(0.0, 6.0, 4))
    wheel = (speed[:, None] - 2.0 * np.maximum(swings, 0.0) * (time[:, None] > 1.0)) / 0.445
    torque = np.where(time[:, None] > 1.0, 3000.0 + 500.0 * swings, 0.0)
    return Trajectory(
        time, speed, np.gradient(speed, STEP_S), np.cumsum(speed) * STEP_S, wheel, np.gradient(wheel, STEP_S, axis=0), torque
    )


def belief(**changes: object) -> Belief:
    return dataclasses.replace(Belief(0.06, 2e-4, MASS_KG, 0.445, 0.002), **changes)


@pytest.mark.parametrize("choice", CHOICES.values(), ids=CHOICES)
def test_contacts_at_once_are_those_one_by_one(choice):
    """Told what every axle does the loop goes sample by sample: so a card that asks for contacts' work must say so."""
    stop, m = a_stop(0), model(COACH, choice)
    whole, one_by_one = along(stop, belief(), m), along(stop, belief(), m, np.empty((len(Doing._fields), SAMPLES, 4)))
    for a, b in zip(whole, one_by_one, strict=True):
        assert_allclose(a, b, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("choice", CHOICES.values(), ids=CHOICES)
def test_what_is_no_contact_needs_none(choice):
    stop, m = a_stop(1), model(COACH, choice)
    whole, forces = along(stop, belief(), m), along(stop, belief(), m, contacts=False)
    for i in FORCES:
        assert_array_equal(whole[i], forces[i])


@pytest.mark.parametrize("choice", CHOICES.values(), ids=CHOICES)
def test_several_stops_are_each_alone(choice):
    stops, m = [a_stop(2), a_stop(3, 333)], model(COACH, choice)
    both = Trajectory(
        *(np.concatenate([getattr(one, field.name) for one in stops]) for field in dataclasses.fields(Trajectory)[:-2]),
        first=(0, SAMPLES),
    )
    friction, masses, gradients = (0.06, 0.09), np.array([MASS_KG, 39e3]), np.array([0.002, -0.001])
    of_samples = np.repeat(friction, [SAMPLES, 333])[:, None]
    together = along(both, belief(mu_cd=of_samples, mass_kg=masses, gradient=gradients), m)
    for i, samples in enumerate(both.stops):
        alone = along(stops[i], belief(mu_cd=friction[i], mass_kg=masses[i], gradient=gradients[i]), m)
        for a, b in zip(together[:9], alone[:9], strict=True):
            assert_allclose(a[samples], b, rtol=1e-12, atol=1e-14)
        assert together.mass_kg[i] == alone.mass_kg


@pytest.mark.parametrize("count", [1, 8, 13])
@pytest.mark.parametrize("name", LAWS)
def test_many_contacts_are_each_alone(name, count):
    law, rng = ContactParameters(traction_law=name).law, np.random.default_rng(4)
    met = np.ones((8, count + SPARE))
    low, high = [0.0, 3.0, 3e4, 0.03, 0.2, 0.2, 0.0, 0.0], [6.0, 40.0, 7e4, 0.1, 0.4, 1.0, 0.2, 4e-4]
    met[:, :count] = rng.uniform(low, high, (count, 8)).T
    found = np.empty((len(Adhesion._fields), count + SPARE))
    tractions(met, count, law, found)
    for i in range(count):
        slip, speed, load, mu_cd, mu_cr, layer, held, tau = map(float, met[:, i])
        alone = traction(slip, speed, load, Surface(mu_cd, mu_cr, layer, held), tau, law)
        assert_allclose(found[:, i], alone, rtol=1e-11, atol=1e-14)
