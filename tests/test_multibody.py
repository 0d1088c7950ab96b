"""The multibody plant in motion: energy, convergence, the longitudinal plant as its limit, curves, what it gives up."""

import dataclasses
import json
import math

import gymnasium as gym
import numba
import numpy as np
import pytest
from plant_cases import a_stop

from wsp_env import cli  # registers the environments too
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.track_geometry import Curve, TrackGeometry
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.plant.longitudinal.plant import LongitudinalPlant
from wsp_env.plant.multibody.plant import MultibodyPlant
from wsp_env.plant.multibody.structure import WHEELSETS, Y_
from wsp_env.plant.port import Setup

compiled = pytest.mark.long  # the longest of all kernels to compile; the first test takes steps of it as plain Python


def brake(plant, seconds=60.0, cycling=False):
    """Brake to a stop; cycling: every axle vents and applies at its own times, wheels slide and lock and roll again."""
    for step in range(round(seconds / plant.setup.control_interval_s)):
        phase = (step + 11 * np.arange(4)) % 100
        command = np.where(cycling & (phase < 25), -1.0, np.where(cycling & (phase < 35), 0.0, 1.0))
        plant.step(np.broadcast_to(command, (plant.n, 4)))
        if not plant.moving.any():
            break
    return plant


def started(kind=MultibodyPlant, setup=None, n=1, track=None, blocked=False, **changes):
    more = {} if kind is LongitudinalPlant else {"blocked": blocked}
    plant = kind(COACH, n, dataclasses.replace(setup or Setup(), track_geometry=track), **more)
    for i in range(n):
        plant.start(i, a_stop(COACH, **changes))
    return plant


@pytest.mark.plain
@pytest.mark.skipif(not numba.config.DISABLE_JIT, reason="run as plain Python only")
def test_the_first_steps_keep_energy_and_momentum():
    """As plain Python, suspensions free: the energy that is lost was braked, rubbed or damped; the rails carry the weight."""
    plant = started(mu_cd=0.06, initial_speed=25.0)
    before = plant.kinetic_energy[0] + plant.stored_energy[0]
    for _ in range(12):
        plant.step(np.ones((1, 4)))
    state = plant.state
    spent = state.brake_work[0] + state.contact_work[0].sum() + state.resistance_work[0] + plant.bodies.damper_work[0]
    assert before - plant.kinetic_energy[0] - plant.stored_energy[0] == pytest.approx(spent, rel=1e-4)
    assert spent > 1e3  # J
    assert plant.bodies.wheel_load.sum() == pytest.approx(COACH.mass_kg * COACH.gravity_mps2, rel=1e-2)
    assert state.position[0] == pytest.approx(25.0 * state.time[0], rel=0.01)


@compiled
@pytest.mark.parametrize(("mu_cd", "cycling"), [(0.28, False), (0.06, False), (0.03, True)])
def test_it_is_the_longitudinal_plant_in_its_limit(mu_cd, cycling):
    """Suspensions blocked: 0.1 % in distance, standstill included. Free: 1 %, as load moves to the leading axles."""
    stop = {"mu_cd": mu_cd, "initial_speed": 25.0}
    fine = Setup(substep_s=5e-4)
    one = brake(started(LongitudinalPlant, fine, **stop), cycling=cycling)
    for blocked, tolerance in ((True, 1e-3), (False, 1e-2)):
        three = started(blocked=blocked, **stop)
        before = three.kinetic_energy[0] + three.stored_energy[0]
        brake(three, cycling=cycling)
        state = three.state
        assert not three.moving.any()
        assert not three.given_up()
        assert state.position[0] == pytest.approx(one.state.position[0], rel=tolerance)
        spent = state.brake_work[0] + state.contact_work[0].sum() + state.resistance_work[0] + three.bodies.damper_work[0]
        left = three.kinetic_energy[0] + three.stored_energy[0]
        assert abs(before - left - spent) < (1e-9 if blocked else 1e-4) * before
        assert (state.wheel_speed == 0.0).all()


@compiled
def test_load_moves_forward_as_the_moments_say():
    """Sum of the wheel loads, and of their moments about the leading axle, under a steady deceleration."""
    plant = started(mu_cd=0.28, initial_speed=40.0, demand=0.6)
    load = COACH.mass_kg * COACH.gravity_mps2
    for _ in range(20):
        plant.step(np.zeros((1, 4)))
    np.testing.assert_allclose(plant.bodies.wheel_load, load / 8.0, rtol=2e-3)
    brake(plant, 8.0)
    axles = plant.bodies.wheel_load[0].sum(axis=1)
    assert axles.sum() == pytest.approx(load, rel=1e-3)
    m, slowing = COACH.multibody, plant.state.deceleration[0]
    heights = m.carbody_kg(COACH.mass_kg, 4) * 1.8 + 2 * m.bogie_mass_kg * 0.6 + 4 * 1700.0 * 0.445
    turning = 4 * COACH.wheelset_inertia_kgm2 / COACH.wheel_radius_m
    moment = float(np.dot(axles, [10.78, 8.22, -8.22, -10.78]))
    assert moment == pytest.approx(slowing * (heights + turning), rel=0.01)


@compiled
def test_halving_the_substep_halves_the_error():
    """At least first order, in distance and wheel load, of a slide that begins."""
    found = []
    for substep in (5e-4, 2.5e-4, 1.25e-4, 6.25e-5):
        plant = started(setup=Setup(substep_s=substep), mu_cd=0.03, initial_speed=20.0)
        brake(plant, 4.0)
        found.append([plant.state.position[0], plant.bodies.wheel_load[0, 3, 0]])
    errors = np.abs(np.array(found[:-1]) - found[-1])
    assert (errors[0] < np.array([1e-3, 1e-2]) * found[-1]).all()
    assert (errors[1:] < 0.75 * errors[:-1] + 1e-9 * np.array(found[-1])).all()


@compiled
def test_a_lateral_offset_decays():
    plant = started(mu_cd=0.28, initial_speed=20.0, demand=0.0)
    plant.bodies.position[0, Y_ : WHEELSETS + 24 : 6] = 2e-3
    brake(plant, 6.0)
    assert np.abs(plant.bodies.shift).max() < 5e-4


@compiled
def test_a_narrow_curve_is_run_on_the_flange():
    """300 m with transitions and cant at the speed where cant and curvature balance: the outer wheels guide, nothing jumps."""
    radius, cant = 300.0, 0.15
    speed = math.sqrt(math.tan(math.asin(cant / 1.5)) * 9.81 * radius)
    track = TrackGeometry(curves=(Curve(begin_m=60.0, transition_m=60.0, length_m=1e4, radius_m=radius, cant_m=cant),))
    plant = started(track=track, mu_cd=0.28, initial_speed=speed, demand=0.0)
    loads, shifts = [], []
    for _ in range(round(14.0 / 0.02)):
        plant.step(np.ones((1, 4)))
        loads.append(plant.bodies.wheel_load[0].copy())
        shifts.append(plant.bodies.shift[0].copy())
    assert not plant.given_up()
    loads, shifts = np.array(loads), np.array(shifts)
    assert loads.min() > 0.0
    assert loads.max() < 1.6 * COACH.static_wheel_load_n
    assert np.abs(np.diff(shifts, axis=0)).max() < 2e-3
    guiding = plant.bodies.guiding[0]
    assert shifts[-1, 0] < -5e-3  # outwards: to the right in a curve to the left
    assert guiding[0, 1] > max(guiding[1, 1], 0.0)  # the leading outer wheel guides, more than the one behind it
    quotient = plant.further_truth()["derailment_quotient"]
    assert np.nanmax(quotient) < 0.8  # Nadal's limit for a flange angle of 70 degrees and friction 0.36


@compiled
def test_what_a_curve_takes_is_the_heat_of_its_contacts():
    """150 m, dry, no brake: what motion loses is heat, between 200 / R (Astakhov) and 500 / (R - 30) per mille (Roeckl).

    The heat is 2.0 % more than that at a substep of 0.5 ms, 2.8 % at 0.25 ms and 3.2 % at 0.125 ms: no error of the step.
    """
    curve = Curve(begin_m=20.0, transition_m=40.0, length_m=200.0, radius_m=150.0, cant_m=0.15)
    plant = started(track=TrackGeometry(curves=(curve,)), mu_cd=0.28, initial_speed=12.1, demand=0.0)
    seen = []
    for end_m in (19.0, 100.0, 200.0):  # on straight track, with all axles in the full curve, before the first leaves it
        while plant.state.position[0] < end_m:
            plant.step(np.ones((1, 4)))
        heat = plant.state.contact_work[0].sum() + plant.bodies.damper_work[0]
        seen.append((plant.state.position[0], plant.kinetic_energy[0], heat))
    assert seen[0][2] < 1.0  # straight track takes nothing
    way, motion, heat = np.diff(seen[1:], axis=0)[0]
    assert -motion == pytest.approx(heat, rel=0.035)
    share = 1e3 * heat / (way * COACH.mass_kg * COACH.gravity_mps2)
    assert 200.0 / curve.radius_m < share < 500.0 / (curve.radius_m - 30.0)


@compiled
def test_what_leaves_the_rails_is_truncated_with_the_reason():
    env = gym.make("wsp_env/Coach-v1", plant="multibody", disable_env_checker=True)
    env.reset(seed=1)
    plant = env.unwrapped.batch.plant
    plant.bodies.position[0, WHEELSETS + Y_] = 0.05
    _, _, terminated, truncated, info = env.step([2, 2, 2, 2])
    assert truncated
    assert not terminated
    assert info["given_up"] == "derailed: wheelset 1 has left the rails"
    env.reset(seed=1)
    plant.bodies.speed[0, 3] = math.nan
    _, _, terminated, truncated, info = env.step([2, 2, 2, 2])
    assert truncated
    assert "not finite" in info["given_up"]
    assert math.isfinite(info["speed_mps"])


@compiled
def test_the_batch_is_the_single_environment():
    """Stop i of `make_vec` is the single environment with seed + i, in 3D as in 1D."""
    envs = gym.make_vec("wsp_env/Coach-v1", num_envs=2, plant="multibody")
    together, _ = envs.reset(seed=7)
    single = gym.make("wsp_env/Coach-v1", plant="multibody")
    alone, _ = single.reset(seed=8)
    np.testing.assert_array_equal(together[1], alone)
    for _ in range(25):
        together, *_, infos = envs.step(np.full((2, 4), 2))
        alone, *_, info = single.step([2, 2, 2, 2])
    np.testing.assert_array_equal(together[1], alone)
    np.testing.assert_array_equal(infos["wheel_load_n"][1], info["wheel_load_n"])


@compiled
def test_irregularities_shake_the_wheels_and_spare_the_carbody():
    """By `gym.make`: on a rough track wheel loads vary about the same mean; the suspension keeps it from the carbody."""
    loads, lifts = [], []
    env = gym.make(
        "wsp_env/Coach-v1", plant="multibody", track_geometry={"irregularities": {"spectrum": "low", "length_m": 500}}
    )
    env.reset(seed=1, options={"initial_speed": 30.0, "mu_cd": 0.28, "demand": 0.0, "load": 0.0})
    for _ in range(400):
        _, _, _, truncated, info = env.step([2, 2, 2, 2])
        loads.append(info["wheel_load_n"])
        lifts.append(info["body_shift_m"][:2, 2])
        assert not truncated
    rough = np.array(loads[100:])
    assert rough.mean() == pytest.approx(COACH.static_wheel_load_n, rel=0.02)
    assert 0.01 < rough.std() / rough.mean() < 0.3
    carbody, bogie = np.diff(np.array(lifts), n=2, axis=0)[100:].std(axis=0)
    assert carbody < 0.5 * bogie  # accelerations


@compiled
def test_too_fast_for_a_curve_is_truncated_without_a_nan():
    """40 m/s in a curve of 150 m: 10.7 m/s2 outwards tip and derail any vehicle; every stop of the batch ends with a reason."""
    env = gym.make("wsp_env/Coach-v1", plant="multibody", track_geometry={"curves": [{"begin_m": 20.0, "radius_m": -150.0}]})
    env.reset(seed=1, options={"initial_speed": 40.0, "mu_cd": 0.06, "demand": 0.0})
    truncated = False
    for _ in range(600):
        observation, reward, terminated, truncated, info = env.step([2, 2, 2, 2])
        assert np.isfinite(observation).all()
        assert math.isfinite(reward)
        if terminated or truncated:
            break
    assert truncated
    assert "derailed: wheelset" in info["given_up"] or "not finite" in info["given_up"]
    assert np.isfinite(info["wheel_load_n"]).all()


@compiled
def test_the_commands_brake_in_three_dimensions(tmp_path, capsys):
    """`wsp evaluate` and `wsp compare` with a track from a file; the same in a plant without rails is refused."""
    (tmp_path / "track.toml").write_text("[[curves]]\nbegin_m = 5.0\nradius_m = 500.0\n")
    options = ["--plant", "multibody", "--track-geometry", str(tmp_path / "track.toml")]
    given = ["--mu-cd", "0.06", "--tau", "1.9e-4", "--speed", "8", "--json", "--out", str(tmp_path / "page.html")]
    assert cli.main(["compare", *given, *options]) == 0
    (pair,) = json.loads(capsys.readouterr().out)["pairs"]
    assert 10.0 < pair["recovering_m"] < 60.0
    assert cli.main(["compare", *given, *options[2:]]) != 0
    assert "take plant multibody" in capsys.readouterr().err
    case = '[[case]]\nname = "slow"\nabout = "short"\ninitial_speed_kmh = 25.0\ninitial_adhesion = [0.1, 0.1]\n'
    (tmp_path / "programme.toml").write_text('[programme]\nname = "short"\n' + case)
    run = ["--programme", str(tmp_path / "programme.toml"), "--controllers", "none", "--draws", "1", "--jobs", "1", "--json"]
    assert cli.main(["evaluate", *run, *options, "--out", str(tmp_path / "out")]) == 0
    stops = json.loads(capsys.readouterr().out)["stops"]
    assert {stop["controller"] for stop in stops} == {"none", "perfect-knowledge", "bound"}
    assert all(stop["stopped"] for stop in stops)


@compiled
def test_info_says_what_the_wheels_do():
    env = gym.make("wsp_env/Coach-v1", plant="multibody")
    plain = gym.make("wsp_env/Coach-v1")
    assert env.observation_space == plain.observation_space
    env.reset(seed=1)
    _, _, _, _, info = env.step([2, 2, 2, 2])
    assert info["wheel_load_n"].shape == info["derailment_quotient"].shape == (4, 2)
    assert info["lateral_shift_m"].shape == (4,)
    assert np.isfinite(info["contact_points_m"][:, :, 0]).all()
    assert info["given_up"] == ""


@compiled
def test_load_transfer_is_the_plants_own():
    for choice in ({"load_transfer": {}},):
        with pytest.raises(ParameterError, match="moves the wheel loads by itself"):
            MultibodyPlant(COACH, 1, Setup(mechanisms=choice))
    with pytest.raises(ParameterError, match="takes one body on two bogies"):
        MultibodyPlant(dataclasses.replace(COACH, bodies=((4,),)))
