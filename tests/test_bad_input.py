"""Every mistake gets one clear error that names what is wrong and what would be right."""

import gymnasium as gym
import numpy as np
import pytest

from wsp_env.envs import IDS
from wsp_env.parameters.contact import ContactParameters
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.uic_z1 import BOGIE
from wsp_env.parameters.vehicle import Brake, Tachometer, Vehicle
from wsp_env.plant import make_plant
from wsp_env.plant.port import Setup
from wsp_env.scenario import PINS

ID = "wsp_env/Bogie-v1"

OPTIONS = [
    ({"contrl_interval_s": 0.02}, "unknown environment option contrl_interval_s; valid: .*control_interval_s"),
    ({"action": "torque"}, "action = 'torque' is unknown; valid: valve, pressure"),
    ({"adhesion": "dry"}, "adhesion = 'dry' is unknown; valid: recovering, classic"),
    ({"mechanisms": {"load_transfr": {}}}, "unknown mechanism load_transfr; valid: .*load_transfer"),
    ({"mechanisms": {"load_transfer": {"height": 1.0}}}, "load_transfer has no parameter height; valid: .*body_height_m"),
    ({"mechanisms": {"load_transfer": {"body_height_m": -1.0}}}, "body_height_m = -1.0 m is impossible"),
    ({"mechanisms": ["load_transfer"]}, "mechanisms = .* must be a dictionary"),
    ({"scenario": {"friction": (0.1, 0.2)}}, "unknown scenario quantity friction; valid: mu_cd"),
    ({"scenario": {"tau": (-1.0, 1.0)}}, "tau = .* must lie in"),
    (
        {"reward": {"speed": 1.0}},
        "unknown reward term speed; valid: stopping_distance, time, rest_of_stop, slip, large_slip, locked_wheels, air",
    ),
    ({"reward": {"air": -1.0}}, "reward weight air = -1.0 is impossible"),
    ({"reward": {"air": float("nan")}}, "reward weight air = nan is impossible"),
    ({"vehicle": {"mass": 1.0}}, "unknown vehicle parameter mass; valid: .*mass_kg"),
    ({"vehicle": {"mass_kg": -1.0}}, r"mass_kg = -1.0 kg is impossible: it must be finite and in \(0, "),
    ({"vehicle": {"mass_kg": "heavy"}}, "mass_kg must be a number in kg, got 'heavy'"),
    ({"vehicle_name": "tram"}, "unknown vehicle 'tram'; valid: wheelset, bogie, coach"),
    ({"control_interval_s": 0.0}, "control_interval_s = 0.0 is impossible"),
    ({"control_interval_s": 2.0}, "control_interval_s = 2.0 s is impossible"),
    ({"substep_s": -0.001}, "substep_s = -0.001 is impossible"),
    ({"time_limit_s": float("inf")}, "time_limit_s = inf is impossible"),
    ({"track_limit_m": "far"}, "track_limit_m = 'far' is impossible"),
]

PINNED = [
    ({"friction": 0.05}, "unknown reset option 'friction'; valid: " + ", ".join(PINS)),
    ({"mu_cd": 0.5}, r"mu_cd = 0.5 is impossible: .*kinetic_friction_r \(mu_cr\)"),
    ({"mu_cd": 0.0}, "mu_cd = 0 is impossible"),
    ({"tau": -1e-4}, "tau = -0.0001 is impossible: it must lie in"),
    ({"initial_speed": -3.0}, "initial_speed = -3 is impossible"),
    ({"demand": 1.5}, "demand = 1.5 is impossible: it must lie in"),
    ({"load": 2.0}, "load = 2 is impossible"),
    ({"gradient": 1.0}, "gradient = 1 is impossible"),
    ({"sensor_noise": float("nan")}, "sensor_noise = nan must be a finite number"),
    ({"tau": "fast"}, "tau = 'fast' must be a finite number"),
    ({"track": "muddy"}, "unknown track 'muddy'; valid: constant, varying, patches"),
]

PARAMETERS = [
    (Vehicle, {"name": "x", "mass_kg": -1.0}, "mass_kg = -1.0 kg is impossible"),
    (Vehicle, {"name": "x", "axle_positions_m": tuple(map(float, range(65)))}, "must hold 1 to 64 rising distances"),
    (Vehicle, {"name": "x", "axle_positions_m": (0.0, -2.0)}, "axle_positions_m"),
    (Vehicle, {"name": "x", "wheelset_inertia_kgm2": float("nan")}, "wheelset_inertia_kgm2 = nan"),
    (Brake, {"vent_time_constant_s": 0.0}, r"vent_time_constant_s = 0.0 s is impossible: .*\(0, "),
    (Brake, {"dead_time_s": -0.1}, "dead_time_s = -0.1 s is impossible"),
    (Tachometer, {"pulses_per_turn": 0.0}, "pulses_per_turn = 0.0"),
    (ContactParameters, {"kinetic_friction_d": 0.5}, r"\(mu_cd\) = 0.5 exceeds kinetic_friction_r \(mu_cr\) = 0.28"),
    (ContactParameters, {"semi_axis_a_m": 0.0}, "semi_axis_a_m = 0.0 m is impossible"),
]


@pytest.mark.parametrize("make", [lambda **o: gym.make(ID, **o), lambda **o: gym.make_vec(ID, num_envs=2, **o)])
@pytest.mark.parametrize(("options", "message"), OPTIONS)
def test_options(make, options, message):
    with pytest.raises(ParameterError, match=message):
        make(**options)


@pytest.mark.parametrize("make", [lambda: gym.make(ID), lambda: gym.make_vec(ID, num_envs=2)])
@pytest.mark.parametrize(("options", "message"), PINNED)
def test_reset_options(make, options, message):
    with pytest.raises(ParameterError, match=message):
        make().reset(seed=0, options=options)


@pytest.mark.parametrize(("record", "values", "message"), PARAMETERS)
def test_parameters(record, values, message):
    with pytest.raises(ParameterError, match=message):
        record(**values)


@pytest.mark.parametrize(
    ("mode", "action", "message"),
    [
        ("pressure", [np.nan, 0.0], "is not finite"),
        ("pressure", [np.inf, 0.0], "is not finite"),
        ("pressure", [0.0], r"has shape \(1,\), expected \(2,\): one entry per axle of the bogie"),
        ("pressure", [[0.0, 0.0]], r"has shape \(1, 2\), expected \(2,\)"),
        ("pressure", 0.0, r"expected \(2,\)"),
        ("valve", [np.nan, 1], "is not finite"),
        ("valve", [0, 3], "0 vents, 1 holds, 2 applies"),
        ("valve", [0.5, 1], "0 vents, 1 holds, 2 applies"),
        ("valve", [1, 1, 1], r"has shape \(3,\), expected \(2,\)"),
        ("valve", ["apply", "apply"], "actions must be numbers"),
        ("valve", None, "actions must be numbers|is not finite|expected"),
    ],
)
def test_actions(mode, action, message):
    env = gym.make(ID, action=mode).unwrapped  # Gymnasium's own wrapper would complain first, less clearly
    env.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        env.step(action)
    env.step(env.action_space.sample())  # the stop goes on


def test_actions_of_a_batch():
    env = gym.make_vec(ID, num_envs=3)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"has shape \(2,\), expected \(3, 2\)"):
        env.step([2, 2])
    with pytest.raises(ValueError, match=r"has shape \(2, 2\), expected \(3, 2\)"):
        env.step([[2, 2], [2, 2]])


@pytest.mark.parametrize("env_id", sorted(IDS))
def test_step_before_reset(env_id):
    single = gym.make(env_id).unwrapped
    with pytest.raises(RuntimeError, match="call reset"):
        single.step(single.action_space.sample())
    vector = gym.make_vec(env_id, num_envs=2)
    with pytest.raises(RuntimeError, match="call reset"):
        vector.step(vector.action_space.sample())


@pytest.mark.parametrize(
    ("command", "message"),
    [([1.0, 1.0], r"shape \(2,\), expected \(1, 2\)"), ([[np.nan, 1.0]], "vehicle 0, axle 1 is nan: commands must be finite")],
)
def test_commands_of_the_plant(command, message):
    with pytest.raises(ValueError, match=message):
        make_plant(BOGIE).step(command)


@pytest.mark.parametrize(
    ("values", "message"),
    [({"n": 0}, "batch of 0"), ({"control_interval_s": 0.0}, "control_interval_s"), ({"substep_s": np.nan}, "substep_s")],
)
def test_plants_that_cannot_be(values, message):
    with pytest.raises(ParameterError, match=message):
        make_plant(BOGIE, values.pop("n", 1), Setup(**values))
