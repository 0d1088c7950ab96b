"""Mechanisms whose parameters are drawn for every stop."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from plant_cases import arrays, plant_of

import wsp_env  # noqa: F401  # registers the environments
from wsp_env.envs.sb3 import BrakingVecEnv
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.uic_z1 import BOGIE
from wsp_env.plant.mechanisms import ALL
from wsp_env.scenario import Scenario, draw, draw_mechanisms

RANGES = {
    "pad_friction": {"per_speed_s_per_m": (-0.01, 0.0), "per_temperature_1_per_k": -5e-4},
    "brake_gain_imbalance": {"gain": [-0.2, -0.1], "axle": [1, 2]},
    "vehicle_mass": {"extra": [0.0, 0.2]},
    "wheelset_inertia": {"share": [-0.3, 0.2]},
    "brake_delay": {"lag_s": [0.0, 0.2], "axle": [0, 2]},
    "dragging_brake": {"torque_nm": [0.0, 900.0], "axle": [1, 2]},
    "blended_brake": {"torque_nm": [0.0, 900.0], "blending_mps": [5.0, 15.0]},
    "sanding": {"share": [0.0, 0.2], "axle": [0, 2]},
    "coupler_force": {"sine_n": [-3000.0, 3000.0], "frequency_hz": [0.2, 0.8]},
    "rail_drift": {"per_stop": 0.1, "earlier_stops": [0, 9]},
}


def stops(count):
    rng = np.random.default_rng(4)
    return [draw(Scenario(), BOGIE, rng, 801) for _ in range(count)]


def brake(plant, steps=150):
    rng = np.random.default_rng(1)
    commands = rng.integers(-1, 2, (steps, 5, 2))[:, : plant.n]
    for command in commands:
        plant.step(command)
    return arrays(plant.state)


def test_stops_of_different_physics_in_one_batch_brake_as_each_alone():
    """One stop has the batch's own physics, the others theirs; bit for bit."""
    rng = np.random.default_rng(2)
    choices = [None, *(draw_mechanisms(RANGES, rng) for _ in range(4))]
    together = plant_of(BOGIE, 5, track_nodes=801, mechanisms={"aerodynamic_drag": {}})
    for i, (stop, choice) in enumerate(zip(stops(5), choices, strict=True)):
        together.start(i, stop, choice)
    state = brake(together)
    for i, (stop, choice) in enumerate(zip(stops(5), choices, strict=True)):
        alone = plant_of(BOGIE, 5, track_nodes=801, mechanisms=choice or {"aerodynamic_drag": {}})
        for row, other in enumerate(stops(5)):
            alone.start(row, other)
        expected = brake(alone)
        for name in ("speed", "wheel_speed", "position", "tachometer.measured", "contact_work"):
            assert_array_equal(state[name][i], expected[name][i], err_msg=f"{name}, {stop.key}, {choice}")
    assert len(np.unique(state["position"])) == 5


def test_a_vehicle_that_starts_anew_without_its_own_physics_has_the_batchs():
    plant, plain = (plant_of(BOGIE, 1, track_nodes=801) for _ in range(2))
    plant.start(0, stops(1)[0], {"vehicle_mass": {"extra": 0.2}})
    brake(plant, 10)
    for one in (plant, plain):
        one.start(0, stops(1)[0])
    assert_array_equal(brake(plant)["position"], brake(plain)["position"])


@pytest.mark.parametrize("taken", [copy.deepcopy, lambda plant: pickle.loads(pickle.dumps(plant))])
def test_a_copy_brakes_as_the_original(taken):
    plant = plant_of(BOGIE, 2, track_nodes=801)
    plant.start(0, stops(2)[0], {"vehicle_mass": {"extra": 0.2}})
    plant.start(1, stops(2)[1])
    brake(plant, 10)
    other = taken(plant)
    before = plant.state.position.copy()
    assert_array_equal(brake(other)["position"], brake(plant)["position"])
    assert (plant.state.position > before).all()


def test_a_range_without_width_is_its_value():
    fixed = {"pad_friction": {"per_speed_s_per_m": -0.005}, "load_transfer": {}}
    narrow = {"pad_friction": {"per_speed_s_per_m": [-0.005, -0.005]}, "load_transfer": {}}
    found = []
    for choice in (fixed, narrow):
        env = BrakingVecEnv("wsp_env/Bogie-v1", 3, mechanisms=choice)
        env.seed(5)
        env.reset()
        found.append(np.array([env.step(np.full((3, 2), 2))[0] for _ in range(200)]))
    assert_array_equal(*found)


def test_every_reset_draws_anew_and_a_seed_draws_the_same():
    env = gym.make("wsp_env/Bogie-v1", mechanisms={"vehicle_mass": {"extra": [0.0, 0.5]}})
    factors = []
    for seed in (1, None, None, 1):
        _, info = env.reset(seed=seed, options={"load": 0.0})
        factors.append(info["mass_kg"] / BOGIE.mass_kg)
    assert len(set(factors)) == 3
    assert factors[0] == factors[3]
    assert all(1.0 <= factor <= 1.5 for factor in factors)
    _, info = gym.make(EnvSpec.from_json(env.spec.to_json())).reset(seed=1, options={"load": 0.0})
    assert info["mass_kg"] / BOGIE.mass_kg == factors[0]


@settings(deadline=None)
@given(st.sampled_from(sorted(ALL)), st.integers(0, 2**32 - 1))
def test_whatever_is_drawn_lies_in_its_range(name, seed):
    ranges = {parameter.name: (parameter.low, parameter.high) for parameter in ALL[name].parameters}
    drawn = draw_mechanisms({name: ranges}, np.random.default_rng(seed))[name]
    for parameter in ALL[name].parameters:
        value = drawn[parameter.name]
        assert parameter.low <= value <= parameter.high
        assert not parameter.whole or value == round(value)


@pytest.mark.parametrize(
    ("choice", "said"),
    [
        ({"pad_friction": {"per_speed_s_per_m": [0.0, -0.01]}}, "pair"),
        ({"pad_friction": {"per_speed_s_per_m": [0.0]}}, "pair"),
        ({"pad_friction": {"per_speed_s_per_m": ["a", "b"]}}, "pair"),
        ({"pad_friction": {"per_speed_s_per_m": [-0.01, 9.0]}}, r"impossible.*0\.03"),
        ({"pad_friction": {"per_speed_s_per_m": [-9.0, 0.0]}}, r"impossible.*-0\.03"),
        ({"pad_friction": {"speed": [0.0, 1.0]}}, "no parameter speed"),
        ({"friction_of_pads": {}}, "unknown mechanism"),
        ({"wheel_radius": {"axle": [1, 4]}}, "axle = 4, but the vehicle has 2"),
        ({"pad_friction": [0.0, 1.0]}, "must be a dictionary"),
    ],
)
def test_ranges_that_cannot_be_are_refused(choice, said):
    with pytest.raises(ParameterError, match=said):
        BrakingVecEnv("wsp_env/Bogie-v1", 2, mechanisms=choice)
