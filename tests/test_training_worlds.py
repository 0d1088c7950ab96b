"""What a training brakes: the shaped reward, joined worlds, shares of the laws, held-out conditions."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from agents.measure import HELD_OUT, WATCHED, Yardstick, low_adhesion
from agents.teacher import ideal, taught
from agents.train import Arguments, make_world
from agents.worlds import CUT_OUT_MPS, SPEEDS, TIME_PRICE_MPS, Joined, Shaped, rest_of_stop
from wsp_env.envs.sb3 import BrakingVecEnv
from wsp_env.parameters.uic_z1 import BOGIE


def test_the_ideal_stop_is_between_the_bound_and_the_teacher():
    stops = low_adhesion(BOGIE, "recovering", 4, WATCHED)
    yardstick = Yardstick("bogie", stops)
    found = yardstick.judged(taught(BOGIE, stops, 3.0, yardstick.conduct))
    paid = found["distance_m"] + 3.0 * found["mean_slip_mps"] * found["duration_s"]
    way, slid = ideal(BOGIE, stops, 3.0, 200.0)
    assert (way + 3.0 * slid < paid).all()
    assert (way + 3.0 * slid > 0.95 * paid).all()
    assert (way > yardstick.top.shortest()[0]).all()


def test_shaping_adds_what_depends_on_the_start_and_the_slide_alone():
    """Over a stop: sum of r - sum of r_env = w F(v0) - w c times the metres slid - w p times the seconds."""
    options = {"scenario": {"initial_speed": (4.0, 6.0)}}
    plain, priced = (Shaped(BrakingVecEnv("wsp_env/Bogie-v1", 3, **options), price) for price in (0.0, 5.0))
    bare = BrakingVecEnv("wsp_env/Bogie-v1", 3, **options)
    for env in (plain, priced, bare):
        env.seed(5)
        env.reset()
    start = plain.batch.plant.state.speed.copy()
    rests = [env.rest.copy() for env in (plain, priced)]
    sums = {"plain": np.zeros(3), "bare": np.zeros(3), "priced": np.zeros(3)}
    open_stops = np.ones(3, dtype=bool)
    rng = np.random.default_rng(0)
    while open_stops.any():
        action = rng.integers(0, 3, (3, 2))
        action[plain.batch.observer.estimate.speed < CUT_OUT_MPS] = 2
        outcome = {"plain": plain.step(action), "bare": bare.step(action), "priced": priced.step(action)}
        for name, (_, reward, _, _) in outcome.items():
            sums[name] += np.where(open_stops, reward, 0.0)
        for i in np.flatnonzero(outcome["plain"][2] & open_stops):
            stopped = outcome["plain"][3][i]["stopped"]
            assert stopped.stopping_distance_m == outcome["bare"][3][i]["position_m"]
            assert_allclose(stopped.reward, sums["plain"][i], rtol=1e-4)
            worth, dearer = (np.interp(start[i], SPEEDS, rest[i]) for rest in rests)
            lasted = TIME_PRICE_MPS * outcome["plain"][3][i]["time_s"]
            assert_allclose(sums["plain"][i] - sums["bare"][i], 0.01 * (worth - lasted), rtol=1e-3, atol=1e-3)
            paid = 5.0 * stopped.slide_distance_m - (dearer - worth)
            assert_allclose(sums["plain"][i] - sums["priced"][i], 0.01 * paid, rtol=1e-3, atol=1e-3)
        open_stops &= ~outcome["plain"][2]


def test_the_rest_of_a_stop_is_what_perfect_knowledge_pays():
    """On rail that never slides it is v (v / 2 + p) / d; dearer sliding, a worse rail and speed cost more."""
    options = {"scenario": {"mu_cd": (0.2, 0.2), "demand": (0.3, 0.3), "load": (0.0, 0.0)}}
    dry = BrakingVecEnv("wsp_env/Bogie-v1", 1, **options)
    dry.reset()
    plant, row = dry.env.batch.plant, np.array([0])
    full = BOGIE.full_brake_torque_nm * 2 / BOGIE.wheel_radius_m / BOGIE.mass_kg
    expected = SPEEDS * (0.5 * SPEEDS + TIME_PRICE_MPS) / (0.3 * full)
    assert_allclose(rest_of_stop(plant, row, 0.0)[0], expected, rtol=0.01, atol=0.5)
    wet = BrakingVecEnv("wsp_env/Bogie-v1", 4, scenario={"mu_cd": (0.03, 0.03), "tracks": ("constant",)})
    wet.reset()
    rows = np.arange(4)
    cheap, dear = (rest_of_stop(wet.env.batch.plant, rows, price) for price in (0.0, 5.0))
    assert (np.diff(cheap, axis=1) > 0.0).all()
    assert (dear[:, 1:] > cheap[:, 1:]).all()
    assert (cheap[:, 1:] > 0.3 * expected[1:]).all()  # dry rail under full brake, the vehicle empty


def test_joined_worlds_are_their_parts():
    def parts():
        return [BrakingVecEnv("wsp_env/Bogie-v1", n, adhesion=law) for n, law in ((2, "recovering"), (1, "classic"))]

    joined, (first, second) = Joined(parts()), parts()
    joined.seed(3)
    first.seed(3)
    second.seed(5)
    assert_array_equal(joined.reset(), np.concatenate([first.reset(), second.reset()]))
    for _ in range(50):
        action = np.full((3, 2), 2)
        observation, reward, done, infos = joined.step(action)
        one, two = first.step(action[:2]), second.step(action[2:])
        assert_array_equal(observation, np.concatenate([one[0], two[0]]))
        assert_array_equal(reward, np.concatenate([one[1], two[1]]))
        assert len(done) == len(infos) == 3


def test_a_share_of_the_stops_has_no_recovery():
    world = make_world(Arguments(action="valve", imitation=0, envs=8, classic_share=0.25))
    world.reset()
    tau = np.concatenate([part.batch.plant.conditions.tau for part in world.venv.parts])
    assert (tau == 0.0).sum() == 2


def test_conditions_of_measuring_are_held_out_and_the_same_under_both_laws():
    watched, held_out = (low_adhesion(BOGIE, "recovering", 5, seed) for seed in (WATCHED, HELD_OUT))
    assert not {stop.key for stop in watched} & {stop.key for stop in held_out}
    for one, other in zip(held_out, low_adhesion(BOGIE, "classic", 5, HELD_OUT), strict=True):
        assert (one.mu_cd, one.mass, one.initial_speed, one.key) == (other.mu_cd, other.mass, other.initial_speed, other.key)
        assert one.tau > other.tau == 0.0
        assert 0.02 < one.mu_cd < 0.045
