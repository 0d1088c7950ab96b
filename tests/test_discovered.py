"""Terms without a name act in the plant as along its recordings; where forms coincide they are the known physics."""

import dataclasses
import json
import math

import gymnasium as gym
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from plant_cases import a_stop, plant_of

import wsp_env  # noqa: F401  # registers the environments
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.plant.card import Doing
from wsp_env.plant.longitudinal.along import Belief, Trajectory, along, model
from wsp_env.plant.mechanisms import ALL, LIBRARY, make
from wsp_env.plant.mechanisms.discovered import CARD, TERMS, equation, parameters_of, terms_of
from wsp_env.plant.mechanisms.term_words import FEATURES, LOOKS_LIKE, SLOTS, axles_of, equation_of, looks_like, mask_of
from wsp_env.plant.mechanisms.terms import REFERENCE_MPS, Feature, Slot, Term, features_along

STEP_S, SAMPLES = 0.01, 1000
MU_CD, TAU = 0.035, 1.9e-4
BELIEF = Belief(MU_CD, TAU, COACH.mass_kg, COACH.wheel_radius_m)
#: Scales of the features that have any, and how much a feature varies in the stop below (0.2 to 2 of it is seen).
SCALES = {
    Feature.SLIP_SIGN: (3.0, 1.0), Feature.TORQUE_MEMORY: (0.4, 1.0), Feature.SLIP_RATE: (2.0, 1.0), Feature.SINE: (0.3, 1.0),
    Feature.COSINE: (0.3, 1.0), Feature.WHEEL_SINE: (0.1, 1.0), Feature.WHEEL_COSINE: (0.1, 1.0),
    Feature.TORQUE_SINE: (0.1, 1.0), Feature.TORQUE_COSINE: (0.1, 1.0), Feature.TORQUE_PLAY: (0.05, 1.0),
    Feature.SETTLING: (4.0, 1.0), Feature.TORQUE_SETTLING: (4.0, 1.0), Feature.TORQUE_WARMING: (1.0, 1.0),
    Feature.FADING_OUT: (4.0, 1.0),
    Feature.PLACE_BUMP: (150.0, 200.0), Feature.BUILT_UP: (1.5, 2.0), Feature.SPEED_TENT: (37.0, 2.0),
    Feature.SLIP_TENT: (3.0, 2.0), Feature.TIME_TENT: (4.0, 3.0),
}  # fmt: skip
RANGES = {
    Feature.SLIP: 4.0, Feature.WHEEL_RATE: 1.0, Feature.TIME: 10.0, Feature.BRAKING_TIME: 10.0, Feature.TORQUE_MEMORY: 0.2,
    Feature.WHEEL_DIFFERENCE: 1.0, Feature.WORK: 0.2, Feature.SPEED_TIME: 10.0,
}  # fmt: skip
SIZES = {Slot.BRAKE_TORQUE: 600.0, Slot.FRICTION: 0.2, Slot.RECOVERY: 0.5, Slot.VEHICLE_FORCE: 5000.0}


def a_term(slot, feature, axles=0.0):
    scale, second = SCALES.get(feature, (1.0, 1.0))
    # Below the inertia of a wheelset, or the torque that depends on the rate before would grow from substep to substep.
    size = 40.0 if (slot, feature) == (Slot.BRAKE_TORQUE, Feature.WHEEL_RATE) else SIZES[slot] / RANGES.get(feature, 1.0)
    return Term(size, slot, axles, feature, scale, second)


def choice_of(*terms):
    return {"discovered": parameters_of(terms)}


def braked(choice, samples=SAMPLES):
    """The plant's own stop under an ideal slip control, each axle a little differently, as a trajectory."""
    plant = plant_of(COACH, 1, control_interval_s=STEP_S, mechanisms=choice, pressure_control=True)
    plant.start(0, a_stop(COACH, mu_cd=MU_CD, tau=TAU, initial_speed=40.0))
    s, p = plant.state, plant.constants
    load, full, rows = COACH.mass_kg * COACH.gravity_mps2 / 8.0, COACH.full_brake_torque_nm, []
    for n in range(samples):
        torque = p.brake.torque_per_bar * s.brake.pressure[0]
        rows.append((s.time[0], s.speed[0], s.position[0], *s.wheel_speed[0], *torque))
        swing = 0.04 * np.sin(2.0 * np.pi * n * STEP_S / (2.0 + 0.3 * np.arange(4)))
        held = 2.0 * load * s.adhesion[0] * COACH.wheel_radius_m / full
        plant.step(np.clip(held + 0.1 * ((0.08 + swing) * s.speed[0] - s.slip_speed[0]), 0.0, 1.0)[None])
    time, speed, place, *rest = np.array(rows).T
    wheel, torque = np.array(rest[:4]).T, np.array(rest[4:]).T
    rates = np.gradient(speed, STEP_S), np.gradient(wheel, STEP_S, axis=0)
    return Trajectory(time, speed, rates[0], place, wheel, rates[1], torque)


def unbalanced(measured, choice):
    """Root mean squares of what is left of the wheels' adhesion and of the vehicle's deceleration over g, both [-]."""
    said = along(measured, BELIEF, model(COACH, choice))
    force = (said.torque_nm + said.inertia_kgm2 * measured.wheel_acceleration_radps2) / said.radius_m
    adhesion = force / (2.0 * said.wheel_load_n) - said.adhesion
    vehicle = measured.acceleration_mps2 + (force.sum(axis=1) + said.resistance_n) / said.mass_kg
    smooth = np.ones(10) / 10
    adhesion = np.array([np.convolve(one, smooth, "valid") for one in adhesion.T])[:, 100:-20]
    vehicle = np.convolve(vehicle, smooth, "valid")[100:-20]
    return np.sqrt(np.mean(adhesion**2)), np.sqrt(np.mean(vehicle**2)) / COACH.gravity_mps2


PAIRS = [(Slot.BRAKE_TORQUE, feature) for feature in Feature]
PAIRS += [(Slot.FRICTION, f) for f in (Feature.BRAKING, Feature.SLIP, Feature.SLIP_RATE, Feature.PLACE_BUMP, Feature.BUILT_UP)]
PAIRS += [(Slot.RECOVERY, f) for f in (Feature.ALWAYS, Feature.TIME, Feature.WORK, Feature.WHEEL_SINE)]
PAIRS += [
    (Slot.VEHICLE_FORCE, f) for f in (Feature.ALWAYS, Feature.SPEED_SQUARED, Feature.SINE, Feature.TORQUE, Feature.PLACE_BUMP)
]


@pytest.mark.parametrize(("slot", "feature"), PAIRS, ids=lambda one: one.name.lower())
def test_acts_in_the_plant_as_along_its_recording(slot, feature):
    choice = choice_of(a_term(slot, feature, 0.0 if slot is Slot.VEHICLE_FORCE else mask_of((1, 3))))
    measured = braked(choice)
    balance = int(slot is Slot.VEHICLE_FORCE)
    assert unbalanced(measured, choice)[balance] < 0.05 * unbalanced(measured, {})[balance]


@pytest.mark.parametrize(("feature", "wheel_radps"), [(Feature.TORQUE_SINE, 10.0), (Feature.TORQUE_COSINE, 95.0)])
def test_a_ripple_is_averaged_as_the_recording_is(feature, wheel_radps):
    """Means over 40 ms of what a wheel that turns evenly does in samples of 0.1 ms; 95 rad/s turn 3.8 rad in a mean."""
    ripple = choice_of(Term(1000.0, Slot.BRAKE_TORQUE, 0.0, feature, 1.0))
    step, count, together = 1e-4, 40_000, 400

    def rolling(step, count, **means):
        time, still = step * np.arange(count), np.zeros(count)
        wheel, torque = np.full((count, 4), wheel_radps), np.full((count, 4), COACH.full_brake_torque_nm)
        speed = COACH.wheel_radius_m * wheel_radps
        return Trajectory(time, still + speed, still, speed * time, wheel, 0.0 * wheel, torque, **means)

    fine, coarse = (
        along(one, BELIEF, model(COACH, ripple)).torque_nm
        for one in (rolling(step, count), rolling(step * together, count // together, mean_s=(step * together,)))
    )
    averaged = fine.reshape(-1, together, 4).mean(axis=1)
    assert np.ptp(averaged) > 300.0
    assert_allclose(coarse, averaged, atol=0.02 * np.ptp(averaged))


def test_three_terms_act_together():
    terms = (
        a_term(Slot.BRAKE_TORQUE, Feature.BRAKING, 1.0),
        a_term(Slot.FRICTION, Feature.BUILT_UP, 4.0),
        a_term(Slot.VEHICLE_FORCE, Feature.SINE),
    )
    choice = choice_of(*terms)
    measured = braked(choice)
    whole = unbalanced(measured, choice)
    for left_out in range(3):
        two = choice_of(*(term for n, term in enumerate(terms) if n != left_out))
        assert max(np.array(unbalanced(measured, two)) / whole) > 20.0


@pytest.mark.parametrize("slot", SIZES)
def test_vanishes_exactly_at_null_whatever_its_shapes(slot):
    off = {"discovered": parameters_of([a_term(slot, feature)._replace(coefficient=0.0) for feature in (12, 17, 19)])}
    assert_array_equal(braked(off, 300).wheel_speed_radps, braked({}, 300).wheel_speed_radps)
    measured = braked({}, 300)
    for got, expected in zip(*(along(measured, BELIEF, model(COACH, one)) for one in (off, {})), strict=True):
        assert_array_equal(got, expected)


def same(choice, other, rtol):
    """Both choices brake the plant alike, and predict alike along its stop."""
    measured, again, plain = (braked(one) for one in (choice, other, {}))
    moved = np.abs(measured.wheel_speed_radps - plain.wheel_speed_radps).max()
    assert moved > 0.1
    assert np.abs(measured.wheel_speed_radps - again.wheel_speed_radps).max() < rtol * moved
    assert np.abs(measured.speed_mps - again.speed_mps).max() < rtol * moved
    mine, its = (along(measured, BELIEF, model(COACH, one)) for one in (choice, other))
    assert_allclose(mine.torque_nm, its.torque_nm, rtol=1e-9)
    assert_allclose(mine.resistance_n, its.resistance_n, rtol=1e-9, atol=1e-6)
    assert_allclose(mine.adhesion, its.adhesion, rtol=1e-9)


def test_a_share_of_the_torque_is_an_imbalance_of_the_brake():
    term = Term(-0.15 * COACH.full_brake_torque_nm, Slot.BRAKE_TORQUE, mask_of((2,)), Feature.TORQUE)
    same(choice_of(term), {"brake_gain_imbalance": {"gain": -0.15, "axle": 2.0}}, 1e-3)


def test_a_constant_force_is_a_gradient():
    term = Term(COACH.mass_kg * COACH.gravity_mps2 * 0.01, Slot.VEHICLE_FORCE, 0.0, Feature.ALWAYS)
    same(choice_of(term), {"track_gradient": {"rise": 0.01}}, 1e-9)


def test_a_force_with_the_square_of_speed_is_drag():
    term = Term(10.0 * REFERENCE_MPS**2, Slot.VEHICLE_FORCE, 0.0, Feature.SPEED_SQUARED)
    same(choice_of(term), {"aerodynamic_drag": {"a_n": 0.0, "b_ns_per_m": 0.0, "c_ns2_per_m2": 10.0}}, 1e-9)


def test_torque_by_the_wheels_acceleration_is_inertia():
    """J dw/dt = r T - (C + c r dw/dt) is (J + c r) dw/dt = r T - C, but for the substep that the rate is behind."""
    extra = 20.0
    term = Term(extra / COACH.wheel_radius_m, Slot.BRAKE_TORQUE, 0.0, Feature.WHEEL_RATE)
    measured = braked(choice_of(term))
    heavier = dataclasses.replace(COACH, wheelset_inertia_kgm2=COACH.wheelset_inertia_kgm2 + extra)
    said, its = along(measured, BELIEF, model(COACH, choice_of(term))), along(measured, BELIEF, model(heavier))
    rate = measured.wheel_acceleration_radps2
    moments = [one.torque_nm + one.inertia_kgm2 * rate for one in (said, its)]
    assert_allclose(moments[0][100:], moments[1][100:], atol=1e-6 * COACH.full_brake_torque_nm)


def test_the_torque_slot_takes_away_no_more_than_all():
    choice = choice_of(Term(-1e6, Slot.BRAKE_TORQUE, 1.0, Feature.ALWAYS))
    measured = braked(choice, 300)
    said = along(measured, BELIEF, model(COACH, choice))
    assert_array_equal(said.torque_nm[:, 0], 0.0)
    assert_array_equal(said.torque_nm[:, 1:], measured.brake_torque_nm[:, 1:])
    slip = measured.speed_mps - COACH.wheel_radius_m * measured.wheel_speed_radps[:, 0]
    assert np.abs(slip).max() < 0.05  # rolls


def test_a_dragging_brake_stops_a_vehicle_without_demand():
    plant = plant_of(COACH, 1, mechanisms=choice_of(Term(500.0, Slot.BRAKE_TORQUE, 1.0, Feature.ALWAYS)))
    plant.start(0, a_stop(COACH, initial_speed=5.0, demand=0.0))
    mass = COACH.mass_kg + 4.0 * COACH.wheelset_inertia_kgm2 / COACH.wheel_radius_m**2
    for _ in range(250):
        plant.step(np.ones((1, 4)))
    lost = 500.0 / COACH.wheel_radius_m / mass * 5.0
    assert_allclose(5.0 - plant.state.speed[0], lost, rtol=1e-2)


@pytest.mark.parametrize("slot", SIZES)
def test_energy_is_conserved(slot):
    plant = plant_of(
        COACH, 1, mechanisms=choice_of(*(a_term(slot, f) for f in (Feature.BRAKING, Feature.SINE, Feature.SLIP_SIGN)))
    )
    plant.start(0, a_stop(COACH, mu_cd=0.04))
    rng, before, command = np.random.default_rng(1), plant.kinetic_energy, np.ones((1, 4))
    for _ in range(400):
        command[rng.random(command.shape) < 0.05] = rng.choice([-1.0, 0.0, 1.0])
        plant.step(command)
        work = plant.state.brake_work + plant.state.contact_work.sum(axis=1) + plant.state.resistance_work
        assert np.abs(before - plant.kinetic_energy - work)[0] < (1e-10 if plant.moving[0] else 1e-5) * before[0]


def doings_of(measured, choice):
    doings = np.empty((len(Doing._fields), *measured.wheel_speed_radps.shape))
    said = along(measured, BELIEF, model(COACH, choice), doings)
    return said, doings


def test_features_along_are_those_that_act():
    measured = braked({}, 500)
    plain, doings = doings_of(measured, {})
    for feature in Feature:
        term = a_term(Slot.BRAKE_TORQUE, feature)._replace(coefficient=1e-3)
        said, _ = doings_of(measured, choice_of(term))
        added = 1e3 * (said.torque_nm - plain.torque_nm)
        values = features_along(doings, term)
        enough = measured.brake_torque_nm + 1e-3 * values > 0.0  # a brake that is released has none to take away
        work = 1e-3 if feature is Feature.WORK else 1e-6  # to which the torque itself adds none
        assert_allclose(added[enough], values[enough], rtol=work, atol=1e-5, err_msg=feature.name)


def test_play_holds_a_torque_back_both_ways():
    """A rigging of 4 % play, filled, vented and filled again: the torque follows at the far edge of its play."""
    share = np.array([0.2, 0.5, 1.0, 0.98, 0.8, 0.4, 0.41, 0.6])
    doings = np.zeros((len(Doing._fields), len(share), 1))
    fields = {"time_s": 0.01 * np.arange(1, len(share) + 1), "duration_s": 0.01, "full_torque": 1.0, "believed_torque": share}
    for name, values in fields.items():
        doings[Doing._fields.index(name), :, 0] = values
    said = features_along(doings, Term(1.0, 0, 0, Feature.TORQUE_PLAY, 0.04))[:, 0]
    delivered = share + 0.04 * said
    assert_allclose(delivered[:3], 0.96 * share[:3])  # rising
    assert delivered[3] == pytest.approx(0.96)  # falls by less than the play: held
    assert_allclose(delivered[4:6], 1.04 * share[4:6])  # falling
    assert delivered[6] == pytest.approx(1.04 * 0.4)
    assert delivered[7] == pytest.approx(0.96 * 0.6)


def test_what_settles_begins_with_the_brake_and_dies_away_with_its_time():
    """Before, there is none: what acts while a vehicle still coasts is another thing, and fades out."""
    _, doings = doings_of(braked({}, 300), {})
    time, bare, torque, fading = (
        features_along(doings, Term(1.0, 0, 0, feature, 2.0))
        for feature in (Feature.BRAKING_TIME, Feature.SETTLING, Feature.TORQUE_SETTLING, Feature.FADING_OUT)
    )
    assert (time == 0.0).any()
    assert_allclose(bare, np.where(time > 0.0, np.exp(-time / 2.0), 0.0))
    assert_allclose(fading, np.exp(-time / 2.0))  # there before: a traction that is cut off late
    assert_allclose(torque, bare * features_along(doings, Term(1.0, 0, 0, Feature.TORQUE)))


def test_what_warms_dies_away_with_the_work_of_the_brake():
    """The work is torque times wheel speed, summed over the steps."""
    share, wheel, step_s = np.array([0.0, 0.5, 1.0, 1.0, 0.4]), np.array([90.0, 88.0, 86.0, 70.0, 80.0]), 0.1
    doings = np.zeros((len(Doing._fields), len(share), 1))
    full = 16_000.0
    fields = {
        "time_s": step_s * np.arange(len(share)), "duration_s": step_s, "full_torque": full, "believed_torque": share * full,
        "wheel": wheel,
    }  # fmt: skip
    for name, values in fields.items():
        doings[Doing._fields.index(name), :, 0] = values
    said = features_along(doings, Term(1.0, 0, 0, Feature.TORQUE_WARMING, 0.3))[:, 0]
    work_mj = 1e-6 * np.cumsum(share * full * wheel * step_s)
    assert_allclose(said, share * np.exp(-work_mj / 0.3))


def test_a_feature_is_held_at_the_edges_of_its_range():
    _, doings = doings_of(braked({}, 300), {})
    free, held = (
        features_along(doings, Term(1.0, 0, 0, Feature.SLIP, low=low, high=high)) for low, high in ((-1e9, 1e9), (0.1, 0.2))
    )
    assert_array_equal(held, np.clip(free, 0.1, 0.2))
    assert free.min() < 0.1 < 0.2 < free.max()


def test_axles_are_a_mask():
    assert mask_of(()) == 0.0
    for axles in ((1,), (2, 4), (1, 2, 3, 4)):
        assert axles_of(mask_of(axles)) == axles
        choice = choice_of(Term(100.0, Slot.BRAKE_TORQUE, mask_of(axles), Feature.ALWAYS))
        measured = braked({}, 3)
        added = along(measured, BELIEF, model(COACH, choice)).torque_nm - measured.brake_torque_nm
        assert_allclose(added, np.tile([100.0 * (k + 1 in axles) for k in range(4)], (3, 1)), atol=1e-9)


@pytest.mark.parametrize(
    ("term", "words"),
    [
        (Term(650.0, Slot.BRAKE_TORQUE, 1.0, Feature.BRAKING), "650 N m on axle 1 while braking"),
        (Term(-650.0, Slot.BRAKE_TORQUE, 0.0, Feature.ALWAYS), "650 N m less on all axles always"),
        (
            Term(42.0, Slot.BRAKE_TORQUE, 0.0, Feature.WHEEL_RATE),
            "42 N m per m/s2 of the wheel's circumferential acceleration on all axles",
        ),
        (Term(-0.12, Slot.FRICTION, 6.0, Feature.SLIP), "friction of axles 2 and 3 falls by 12 % per m/s of slip speed"),
        (Term(math.log(2.0), Slot.RECOVERY, 0.0, Feature.ALWAYS), "recovery rate of all axles rises by a factor of 2 always"),
        (
            Term(3500.0, Slot.VEHICLE_FORCE, 0.0, Feature.SINE, 0.283),
            "3500 N against the motion, times sin(2 pi 0.283 Hz t)",
        ),
        (
            Term(6545.6, Slot.VEHICLE_FORCE, 0.0, Feature.PLACE_BUMP, 306.81, 140.1),
            "6550 N against the motion at most, in a bump 140 m long about 307 m along the track",
        ),
        (
            Term(-0.01, Slot.RECORDED_SPEED, 0.0, Feature.TIME),
            "recorded speed too low by 0.01 m/s per s of time since the start",
        ),
    ],
)
def test_equation_in_words(term, words):
    assert equation_of(term) == words
    if term.slot != Slot.RECORDED_SPEED:  # which has a card of its own
        assert equation(parameters_of([term])) == words


def test_every_slot_and_feature_has_words():
    assert set(SLOTS) == set(LOOKS_LIKE) == set(Slot)
    assert set(FEATURES) == set(Feature)
    for feature in Feature:
        assert equation_of(Term(0.1, Slot.RECORDED_SPEED, 0.0, feature))
        assert all(looks_like(Slot.RECORDED_SPEED, feature))
    for slot in SIZES:
        for feature in Feature:
            assert equation_of(a_term(slot, feature))
            assert all(looks_like(slot, feature))
    assert looks_like(Slot.BRAKE_TORQUE, Feature.WHEEL_RATE) == ("wheelset inertia",)
    assert equation(parameters_of([])) == "nothing"


def test_terms_and_parameters_are_each_others_reverse():
    terms = [a_term(Slot.FRICTION, Feature.SLIP, 3.0), a_term(Slot.VEHICLE_FORCE, Feature.SINE)]
    assert terms_of(parameters_of(terms)) == terms
    assert make(choice_of(*terms)).discovered == CARD.record(**parameters_of(terms))
    with pytest.raises(ParameterError, match="4 terms are too many: a model holds 3"):
        parameters_of(terms * 2)
    assert TERMS == 3


def test_is_no_name_of_the_library():
    assert set(ALL) - set(LIBRARY) == {"discovered", "misread_speed", "misread_wheel"}


def test_environment_brakes_differently(tmp_path):
    term = {"coefficient_1": 3000.0, "slot_1": 0, "axles_1": 1, "feature_1": 0}
    path = tmp_path / "model.json"
    path.write_text(json.dumps({"tau_m_per_J": TAU, "mechanisms": {"discovered": term}}), encoding="utf-8")
    speeds = {}
    options = {"plain": {}, "term": {"mechanisms": {"discovered": term}}, "model": {"model": str(path)}}
    options["drawn"] = {"mechanisms": {"discovered": term | {"coefficient_1": [2999.0, 3001.0]}}}
    for name, option in options.items():
        env = gym.make("wsp_env/Bogie-v1", **option)
        env.reset(seed=3, options={"tau": TAU, "mu_cd": 0.2, "load": 0.0})
        for _ in range(150):
            env.step(np.full(env.action_space.shape, 2))
        speeds[name] = float(env.unwrapped.batch.plant.truth().speed[0])
    assert speeds["term"] < speeds["plain"] - 0.1
    assert speeds["model"] == speeds["term"]
    assert_allclose(speeds["drawn"], speeds["term"], atol=1e-3)
    assert speeds["drawn"] != speeds["term"]


def test_a_mechanism_may_change_the_wheelsets_inertia(monkeypatch):
    """Slot "inertia" hands it on, for every stop in the plant and along a recording."""
    card = ALL["vehicle_mass"]._replace(acts={"inertia": lambda p, believed: believed * (1.0 + p.extra)})
    monkeypatch.setitem(ALL, "vehicle_mass", card)
    on = {"vehicle_mass": {"extra": 0.25}}
    heavier = dataclasses.replace(COACH, wheelset_inertia_kgm2=1.25 * COACH.wheelset_inertia_kgm2)
    speeds = []
    for vehicle, choice in ((COACH, on), (heavier, {})):
        plant = plant_of(vehicle)
        plant.start(0, a_stop(vehicle, mu_cd=0.04), choice)
        energy = plant.kinetic_energy
        for _ in range(100):
            plant.step(np.ones((1, 4)))
        speeds.append((energy[0], *plant.state.wheel_speed[0], *plant.state.speed))
        assert_allclose(model(vehicle, choice).inertia_kgm2, heavier.wheelset_inertia_kgm2)
    assert_allclose(*speeds, rtol=1e-12)
    monkeypatch.setitem(ALL, "vehicle_mass", card._replace(acts={"inertia": lambda p, believed: 0.0 * believed}))
    with pytest.raises(ParameterError, match="inertia of 0 kg m2 is impossible"):
        model(COACH, on)
