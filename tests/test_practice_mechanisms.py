"""What practice meets every day: worn wheels, late, dragging and blended brakes, sand, couplers and worn rails."""

import dataclasses
import math

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from plant_cases import DIRECT, a_stop, arrays, plant_of, run
from synthetic_stops import AXLES, stop, write_campaign

import wsp_env  # noqa: F401  # registers the environments
from wsp_env.diagnosis.balances import Balances
from wsp_env.diagnosis.baseline import baseline
from wsp_env.diagnosis.candidates import Variant, refined, switched, unavailable, variants
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.interest import Compared
from wsp_env.diagnosis.net import net_effect
from wsp_env.diagnosis.stops import prepare
from wsp_env.parameters.uic_z1 import BOGIE, COACH
from wsp_env.plant.card import Recorded
from wsp_env.plant.longitudinal.along import Belief, Trajectory, along, model
from wsp_env.plant.mechanisms import ALL, adhesion_patch, at_stop, sanding
from wsp_env.recordings import read_campaign

NAMES = (
    "sanding",
    "coupler_force",
    "rail_drift",
    "wheelset_inertia",
    "brake_delay",
    "dragging_brake",
    "blended_brake",
)
RUN = Belief(mu_cd=0.05, tau=0.0, mass_kg=COACH.mass_kg, radius_m=COACH.wheel_radius_m)
STEP_S = 0.01
FULL_NM = COACH.full_brake_torque_nm


def trajectory(torque_nm, creepage=0.0, speed_mps=20.0, seconds=6.0) -> Trajectory:
    """A vehicle at constant speed; torque and creepage are numbers or functions of the time (T,), the same for every axle."""
    time = STEP_S * np.arange(round(seconds / STEP_S) + 1)
    ones = np.ones((len(time), COACH.axles))

    def history(value):
        return (value(time) if callable(value) else np.full(len(time), value))[:, None] * ones

    wheel = (1.0 - history(creepage)) * speed_mps / COACH.wheel_radius_m
    still = np.zeros(len(time))
    return Trajectory(time, still + speed_mps, still, speed_mps * time, wheel, 0.0 * wheel, history(torque_nm))


def said(measured: Trajectory, name=None, **values):
    return along(measured, RUN, model(COACH, {name: values} if name else {}))


def test_inertia_is_that_of_another_vehicle():
    """A share of the inertia and a vehicle with that inertia brake alike, to the last digit but for the estimate of energy."""
    other = dataclasses.replace(COACH, wheelset_inertia_kgm2=0.75 * COACH.wheelset_inertia_kgm2)
    plants = [plant_of(COACH, mechanisms={"wheelset_inertia": {"share": -0.25}}), plant_of(other)]
    for plant in plants:
        plant.start(0, a_stop(COACH))
        run(plant, 5.0)
    for name, value in arrays(plants[0].state).items():
        if not name.startswith("memory"):
            assert_allclose(value, arrays(plants[1].state)[name], rtol=1e-12, err_msg=name)
    assert_allclose(plants[0].kinetic_energy, plants[1].kinetic_energy)


@pytest.mark.parametrize("rise_share", [1.0, 0.4, 0.0])
def test_a_late_brake_follows_a_rising_torque_after_its_dead_time(rise_share):
    """A line that rises by g is given, after the dead time, with a deficit of g T (1 - exp(-t / T)) by the time constant T."""
    lag, rate = 0.15, 1000.0
    constant = max(rise_share * lag, 1e-9)
    measured = trajectory(lambda time: rate * time)
    late = said(measured, "brake_delay", lag_s=lag, rise_share=rise_share, axle=2.0).torque_nm
    since = np.clip(measured.time_s - (1.0 - rise_share) * lag, 0.0, None)
    expected = rate * (since - constant * -np.expm1(-since / constant))
    assert_allclose(late[:, 1], expected, atol=1e-9 * FULL_NM)
    assert_array_equal(late[:, [0, 2, 3]], measured.brake_torque_nm[:, [0, 2, 3]])
    every = said(measured, "brake_delay", lag_s=lag, rise_share=rise_share).torque_nm
    assert_allclose(every, expected[:, None] * np.ones(4), atol=1e-5)


@given(lag_s=st.floats(0.02, 1.5), rise_share=st.floats(0.0, 1.0), per_s=st.floats(0.1, 0.8))
@settings(max_examples=25, deadline=None)
def test_a_late_brake_is_a_linear_system_with_that_frequency_response(lag_s, rise_share, per_s):
    """A swinging torque is given as by exp(-s dead time) / (1 + s time constant), once what it began with has died away."""
    turning = 2.0j * np.pi * per_s
    measured = trajectory(lambda time: 0.5 * FULL_NM * (1.0 + np.exp(turning * time).imag), seconds=12.0 * lag_s + 1.0)
    late = said(measured, "brake_delay", lag_s=lag_s, rise_share=rise_share).torque_nm[:, 0]
    response = np.exp(-turning * (1.0 - rise_share) * lag_s) / (1.0 + turning * rise_share * lag_s)
    expected = 0.5 * FULL_NM * (1.0 + (response * np.exp(turning * measured.time_s)).imag)
    settled = measured.time_s > 12.0 * lag_s
    # A chord is below its arc by an eighth of (w dt)^2: between samples, and between instants that are kept, up to a 30th
    # of the dead time and a sample apart.
    chord = sum((abs(turning) * apart) ** 2 / 8.0 for apart in (STEP_S, (1.0 - rise_share) * lag_s / 30.0 + STEP_S))
    assert_allclose(late[settled], expected[settled], atol=(chord + 2e-5) * 0.5 * FULL_NM)


def test_brakes_of_the_plant_give_what_they_gave_a_dead_time_before():
    """A vehicle whose wheels all roll is braked by the torques alone."""
    late_s, lost = 0.2, []
    for choice in ({"brake_delay": {"lag_s": late_s, "rise_share": 0.0}}, {}):
        plant = plant_of(COACH, mechanisms=choice)
        plant.start(0, a_stop(COACH, mu_cd=0.28, demand=0.3))
        speeds = []
        for _ in range(200):
            run(plant, plant.setup.control_interval_s)
            speeds.append(float(plant.state.speed[0]))
        lost.append(-np.diff(speeds) / plant.setup.control_interval_s)
    late = round(late_s / plant.setup.control_interval_s)
    assert lost[1].max() > 0.2
    assert_allclose(lost[0][late:], lost[1][:-late], atol=0.01 * lost[1].max())


def test_a_late_brake_gives_a_steady_torque_as_believed():
    """Also one that a recording begins with."""
    measured = trajectory(0.8 * FULL_NM)
    assert_array_equal(said(measured, "brake_delay", lag_s=0.3).torque_nm, measured.brake_torque_nm)


def test_a_dragging_brake_stays_on_its_axle_once_it_was_applied():
    measured = trajectory(lambda time: np.where((time > 1.0) & (time < 2.0), FULL_NM, 0.0))
    added = said(measured, "dragging_brake", torque_nm=400.0, axle=3.0).torque_nm - measured.brake_torque_nm
    assert_allclose(added[measured.time_s > 1.01, 2], 400.0)
    assert_array_equal(added[measured.time_s < 1.0], 0.0)
    assert_array_equal(added[:, [0, 1, 3]], 0.0)


def test_a_drag_that_builds_up_follows_its_time_constant_from_the_first_application_on():
    """Whatever the cylinder does afterwards: it is released after a second, and the drag goes on growing."""
    drag, rise, begins = 400.0, 1.5, 1.0
    measured = trajectory(lambda time: np.where((time >= begins) & (time < 2.0), FULL_NM, 0.0))
    values = {"torque_nm": drag, "axle": 3.0, "rise_s": rise}
    added = said(measured, "dragging_brake", **values).torque_nm[:, 2] - measured.brake_torque_nm[:, 2]
    expected = drag * -np.expm1(-np.maximum(measured.time_s - begins, 0.0) / rise)
    sample_s = measured.time_s[1] - measured.time_s[0]
    assert_allclose(added, expected, atol=1.01 * drag * sample_s / rise)
    finer = said(measured, "dragging_brake", **(values | {"rise_s": 1e-9})).torque_nm
    assert_array_equal(finer, said(measured, "dragging_brake", **(values | {"rise_s": 0.0})).torque_nm)


def test_a_brake_that_has_stuck_since_the_stop_before_drags_from_the_start():
    measured = trajectory(lambda time: np.where(time > 1.0, FULL_NM, 0.0))
    torque = said(measured, "dragging_brake", torque_nm=400.0, axle=3.0, from_start=1.0).torque_nm
    assert_allclose((torque - measured.brake_torque_nm)[:, 2], 400.0)


def test_a_dragging_brake_slows_a_vehicle_that_was_released():
    drag = 600.0
    plant = plant_of(BOGIE, mechanisms={"dragging_brake": {"torque_nm": drag}})
    plant.start(0, a_stop(BOGIE, mu_cd=0.2))
    before = plant.state.speed[0]
    plant.conditions.demand[0] = 0.0
    run(plant, 1.0)
    assert plant.state.speed[0] == pytest.approx(before, rel=1e-12)  # not yet applied
    plant.conditions.demand[0] = 1.0
    run(plant, 1.0)
    run(plant, 3.0, command=-1.0)
    speed = plant.state.speed[0]
    run(plant, 2.0, command=-1.0)
    radius = BOGIE.wheel_radius_m
    mass = BOGIE.mass_kg + 2 * BOGIE.wheelset_inertia_kgm2 / radius**2
    assert (speed - plant.state.speed[0]) / 2.0 == pytest.approx(drag / radius / mass, rel=0.01)


def test_sand_comes_after_its_delay_and_goes_after_the_slide():
    """The share of the layer taken away is `share` times the sand, which builds up and goes exponentially."""
    start, end, delay, build_up, decay = 1.0, 4.0, 0.5, 0.4, 0.8
    creeps = trajectory(0.0, lambda time: np.where((time >= start) & (time < end), 0.1, 0.05))
    times = {"threshold_mps": 1.5, "delay_s": delay, "build_up_s": build_up, "decay_s": decay}

    def adhesion(share):
        return said(creeps, "sanding", share=share, axle=2.0, **times).adhesion

    none, some = adhesion(0.0), adhesion(0.3)
    clean = along(creeps, RUN, model(COACH, {"sanding": {"share": 1.0, "axle": 2.0} | times})).adhesion
    time = creeps.time_s
    works = (time > start + delay + 0.05) & (time < end)
    sand = -np.expm1(-(time - start - delay) / build_up)
    # tau is zero: f = f_r - (f_r - f_d) layer, and the clean rail is where the sand has taken the whole layer away.
    late = works & (sand > 0.99)
    f_r = none[late][-1, 1] + (clean[late][-1, 1] - none[late][-1, 1]) / sand[late][-1]
    share = (some[:, 1] - none[:, 1]) / (f_r - none[:, 1])
    assert_array_equal(share[time <= start + delay], 0.0)
    assert_allclose(share[works], 0.3 * sand[works], atol=0.3 * 3.0 * STEP_S / build_up)
    behind = (some[works] - none[works])[:, [2, 3]] / (some[works] - none[works])[:, [1]]
    assert_allclose(behind, np.ones_like(behind) * [sanding.BEHIND, sanding.BEHIND**2], rtol=1e-6)
    assert_array_equal(some[:, 0], none[:, 0])
    after = time > end + 0.05
    left = (some - none)[after, 1]
    assert_allclose(left[100] / left[0], math.exp(-1.0 / decay), rtol=1e-6)


def test_a_sander_that_needs_no_slide_works_late_or_slow():
    """With a threshold of 0 it works from its delay on, whatever the slip; above its running speed it does not."""
    given = {"axle": 2.0, "share": 0.3, "threshold_mps": 0.0, "build_up_s": 0.1, "decay_s": 0.1}
    for speed, below, works in ((30.0, 20.0, False), (15.0, 20.0, True)):
        creeps = trajectory(0.0, 1e-3, speed_mps=speed)
        gained = said(creeps, "sanding", delay_s=2.0, below_mps=below, **given).adhesion - said(creeps).adhesion
        assert_array_equal(gained[creeps.time_s < 2.0], 0.0)
        assert (gained[creeps.time_s > 2.5, 1] > 0.0).all() == works
        assert (gained[:, 1] != 0.0).any() == works


def test_sanders_of_all_bogies_stand_before_their_leading_axles():
    creeps = trajectory(0.0, 0.1)
    gained = said(creeps, "sanding", axle=0.0, share=0.2).adhesion[-1] - said(creeps).adhesion[-1]
    assert_allclose(gained[[0, 1]], gained[[2, 3]])
    assert_allclose(gained[1] / gained[0], sanding.BEHIND)


def test_a_blended_brake_of_one_bogie_leaves_the_other():
    measured = trajectory(0.5 * FULL_NM, speed_mps=30.0)
    torque = said(measured, "blended_brake", torque_nm=500.0, axle=3.0, last_axle=4.0).torque_nm - measured.brake_torque_nm
    assert_allclose(torque[1:], np.broadcast_to([0.0, 0.0, 500.0, 500.0], torque[1:].shape), atol=1e-9)


def test_a_blended_brake_fades_below_its_speed_and_leaves_a_vented_axle():
    blending, added = 10.0, 1000.0
    for speed, share in ((30.0, 1.0), (10.0, 1.0), (5.0, 0.5)):
        measured = trajectory(lambda time: np.where(time > 1.0, 0.5 * FULL_NM, 0.0), speed_mps=speed)
        torque = said(measured, "blended_brake", torque_nm=added, blending_mps=blending).torque_nm
        expected = np.where(measured.time_s > 1.0, added * share, 0.0)
        assert_allclose(torque - measured.brake_torque_nm, expected[:, None] * np.ones(4), atol=1e-9)


def test_a_blended_brake_takes_the_energy_that_its_torque_gives():
    """Heat of all brakes beyond that of the discs is the integral of the torque that the discs do not give."""
    added, axle = 900.0, 2
    brakes = {"blended_brake": {"torque_nm": added, "axle": float(axle), "blending_mps": 8.0}}
    plant = plant_of(dataclasses.replace(BOGIE, brake=DIRECT), mechanisms=brakes)
    plant.start(0, a_stop(BOGIE, mu_cd=0.25))
    work = discs = 0.0
    while plant.moving[0] and plant.state.speed[0] > 1.0:
        before, pressure = plant.state.wheel_speed[0].copy(), plant.state.brake.pressure[0].copy()
        plant.step(np.ones((1, 2)))
        mean = 0.5 * (before + plant.state.wheel_speed[0])
        h = plant.setup.control_interval_s
        discs += h * (plant.constants.brake.torque_per_bar * 0.5 * (pressure + plant.state.brake.pressure[0]) * mean).sum()
        work += h * added * min(BOGIE.wheel_radius_m * mean[axle - 1] / 8.0, 1.0) * mean[axle - 1]
    assert plant.state.brake_work[0] - discs == pytest.approx(work, rel=0.01)


def test_a_coupler_force_has_no_mean_and_is_less_without_braking():
    frequency, sine, cosine = 0.5, 3000.0, -1000.0
    measured = trajectory(lambda time: np.where((time >= 1.0) & (time < 5.0), FULL_NM, 0.0), seconds=7.0)
    swing = {"frequency_hz": frequency, "sine_n": sine, "cosine_n": cosine}
    force = said(measured, "coupler_force", **swing).resistance_n
    since = measured.time_s - 1.0
    phase = 2.0 * np.pi * frequency * since
    expected = sine * np.sin(phase) + cosine * np.cos(phase)
    braking = (measured.time_s >= 1.0) & (measured.time_s < 5.0)
    assert_allclose(force[braking], expected[braking], atol=1e-6)
    assert_allclose(force[braking][:400].mean(), 0.0, atol=1.0)  # two periods
    assert_array_equal(force[since < 0.0], 0.0)
    released = measured.time_s >= 5.0
    assert_allclose(force[released], 0.3 * expected[released], atol=1e-6)


@pytest.mark.parametrize("released", [0.0, 0.3, 1.0])
def test_a_train_that_swings_already_pushes_from_the_start(released):
    measured = trajectory(lambda time: np.where((time >= 1.0) & (time < 5.0), FULL_NM, 0.0), seconds=7.0)
    swing = {"frequency_hz": 0.5, "sine_n": 3000.0, "cosine_n": 0.0, "from_start": 1.0, "released": released}
    force = said(measured, "coupler_force", **swing).resistance_n
    expected = 3000.0 * np.sin(np.pi * measured.time_s)
    braking = (measured.time_s >= 1.0) & (measured.time_s < 5.0)
    assert_allclose(force, np.where(braking, 1.0, released) * expected, atol=1e-6)


def test_a_coupler_force_moves_the_vehicle_by_its_impulse():
    """On a rail without slip the vehicle and its wheels lose what the force pushes, and have it back after a period."""
    frequency, force = 0.5, 2000.0
    swing = {"coupler_force": {"frequency_hz": frequency, "sine_n": force, "cosine_n": 0.0}}
    plants = [plant_of(BOGIE, mechanisms=choice, pressure_control=True) for choice in (swing, {})]
    for plant in plants:
        plant.start(0, a_stop(BOGIE, mu_cd=0.28))
    changes = []
    for _ in range(200):
        for plant in plants:
            plant.step(np.full((1, 2), 0.3))
        changes.append(plants[0].state.speed[0] - plants[1].state.speed[0])
    begun = plants[0].state.memory.coupler_force.since_s[0]
    time = 0.02 * np.arange(1, 201) - begun
    mass = BOGIE.mass_kg + 2 * BOGIE.wheelset_inertia_kgm2 / BOGIE.wheel_radius_m**2
    omega = 2.0 * np.pi * frequency
    expected = np.where(time > 0.0, -force / (mass * omega) * (1.0 - np.cos(omega * np.maximum(time, 0.0))), 0.0)
    assert_allclose(changes, expected, atol=0.02 * force / (mass * omega))


def test_edges_of_a_patch_are_as_wide_as_they_are_said_to_be():
    """Half of the change at either end, 0.76 of it within an edge's width about them; a sharp patch is a box."""
    at = np.array([-500.0, 70.0, 100.0, 130.0, 250.0, 370.0, 400.0, 430.0, 900.0])
    wide = {"start_m": 100.0, "length_m": 300.0, "edge_m": 30.0}
    changed = np.array([adhesion_patch.friction_factor(adhesion_patch.Parameters(-0.4, **wide), x) for x in at]) - 1.0
    within = 0.5 * (1.0 + np.tanh([-1.0, 0.0, 1.0]))
    assert_allclose(changed, -0.4 * np.array([0.0, *within, 1.0, *within[::-1], 0.0]), atol=2e-4)
    assert_allclose(changed, -0.4 * adhesion_patch.inside(wide, at), atol=1e-12)
    box = np.array([adhesion_patch.friction_factor(adhesion_patch.Parameters(-0.4, **wide | {"edge_m": 0.5}), x) for x in at])
    assert_allclose(box, [1.0, 1.0, 0.8, 0.6, 0.6, 0.6, 0.8, 1.0, 1.0], atol=1e-9)


def test_a_refit_does_not_sharpen_the_edges_of_a_patch_to_the_roughness_of_a_rail():
    """The plant may have sharper ones; the friction of sound rails varies within metres, for all wheels of all runs alike."""
    searched = Variant("adhesion_patch", ("change",), {"start_m": 100.0, "length_m": 60.0, "edge_m": 3.0})
    wide = refined(searched)
    moved = switched(Model(2e-4, (0.06,)), wide, np.array([-0.2, 100.0, 60.0, 0.6])).choice["adhesion_patch"]
    assert moved == {"change": -0.2, "start_m": 100.0, "length_m": 60.0, "edge_m": 3.0}
    recorded = Recorded(4, np.linspace(300.0, 600.0, 50))
    assert {shape["edge_m"] for shape in adhesion_patch.stretches(recorded)} == {3.0}


@given(length=st.floats(1.0, 1000.0), edge=st.floats(0.5, 100.0))
def test_the_change_of_a_patch_is_reached_in_its_middle_and_half_of_it_where_it_is_said(length, edge):
    reach = adhesion_patch.half_reach_m(length, edge)
    p = adhesion_patch.Parameters(-0.4, 100.0, length, edge)
    changed = [adhesion_patch.friction_factor(p, 100.0 + 0.5 * length + x) - 1.0 for x in (-reach, 0.0, reach)]
    assert_allclose(changed, [-0.2, -0.4, -0.2], atol=1e-9)


def test_the_rail_of_a_later_stop_recovers_sooner():
    plant = plant_of(BOGIE, 3)
    for i, earlier in enumerate((0.0, 3.0, 10.0)):
        plant.start(i, a_stop(BOGIE), {"rail_drift": {"per_stop": 0.1, "earlier_stops": earlier}})
    assert_allclose(plant.conditions.tau, a_stop(BOGIE).tau * np.exp(0.1 * np.array([0.0, 3.0, 10.0])))


def test_only_what_depends_on_the_stop_changes_with_it():
    choice = {"rail_drift": {"per_stop": 0.1}, "load_transfer": {}}
    assert at_stop(choice, 2) == {"rail_drift": {"per_stop": 0.1, "earlier_stops": 2.0}, "load_transfer": {}}
    plain = {"load_transfer": {}}
    assert at_stop(plain, 2) is plain


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """Four stops with torques from the pressures."""
    runs = {name: stop(2e-4, 0.06, 32.0 + i, duration_s=9.0, noise=1.0, seed=i) for i, name in enumerate("ABCD")}
    folder = write_campaign(tmp_path_factory.mktemp("practice"), runs, list("AB"), list("CD"))
    file = folder / "campaign.toml"
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace('source = "measured"', 'source = "pressure times the nominal gain"'), encoding="utf-8")
    return read_campaign(folder)


@pytest.fixture(scope="module")
def balances(campaign):
    return Balances(campaign, prepare(campaign)[0])


def test_every_recording_has_its_own_place_in_the_series(balances):
    """A drift is the same as a law with another recovery rate in each run."""
    rate = 0.2
    mu_cd = (0.06,) * 4
    drifting = balances.evaluate(Model(2e-4, mu_cd, {"rail_drift": {"per_stop": rate, "earlier_stops": 7.0}}))
    for i, one in enumerate(drifting):
        alone = balances.evaluate(Model(2e-4 * math.exp(rate * i), mu_cd))[i]
        assert_allclose(one.adhesion, alone.adhesion, rtol=1e-12)


def test_two_stops_say_nothing_of_a_drift(campaign):
    two = Balances(campaign, prepare(campaign)[0][:2])
    assert unavailable(two)["rail_drift"] == "needs 3 stops"
    assert "rail_drift" not in {one.name for one in variants(two)}


def test_the_only_size_of_a_mechanism_of_the_contact_is_also_searched_at_its_typical_value(balances):
    """Half the stiffness has another effect than a tenth less, five times; forces and places are searched as they were."""
    steps = {}
    for one in variants(balances):
        steps.setdefault(one.name, set()).update(np.abs(one.moves()[:1]))
    assert steps["initial_slope"] == {0.125, 0.5}
    assert max(steps["flash_temperature"]) == 1e-3
    assert all(len(steps[name]) == 1 for name in ("vehicle_mass", "adhesion_patch", "falling_friction") if name in steps)


@pytest.fixture(scope="module")
def replica(balances):
    return baseline(balances)


@pytest.mark.parametrize("name", NAMES)
def test_a_campaign_says_how_much_it_matters(name, replica):
    """The typical size of each is of interest, half of it about half as much, and none not at all."""
    whitening = replica.whitening(replica.baseline)
    variant = next(one for one in variants(replica) if one.name == name)
    typical = {one.name: one.typical for one in ALL[name].parameters}
    null = variant.null()

    def multiple(share):
        values = null + share * (np.array([typical[size] for size in variant.sizes]) - null)
        return net_effect(replica, switched(replica.baseline, variant, values), variant, whitening).multiple

    whole = multiple(1.0)
    assert 0.3 < whole < 60.0
    assert multiple(0.5) == pytest.approx(0.5 * whole, rel=0.25)
    assert multiple(0.0) < 1e-5


def test_of_a_force_that_pushes_and_pulls_the_amplitude_matters(replica):
    """Over what retards the vehicle, as distance and slip hardly move: whatever its phase, and of no other force."""
    off = replica.evaluate(replica.baseline)
    forces = [(2.0 * one.load * one.adhesion).sum(axis=1) + one.resistance for one in off]
    sliding = [force[one.brake_force > 0.5 * one.brake_force.max()].mean() for force, one in zip(forces, off, strict=True)]
    for sine, cosine in ((2000.0, 0.0), (-1200.0, 1600.0)):
        choice = {
            "coupler_force": {"sine_n": sine, "cosine_n": cosine, "frequency_hz": 0.5, "from_start": 1.0, "released": 1.0}
        }
        on = replica.evaluate(dataclasses.replace(replica.baseline, choice=choice))
        said = Compared(replica, off).change(on, swings=True)
        assert said.push == pytest.approx(np.mean(2000.0 / np.array(sliding)), rel=0.15)
        assert said.multiple == pytest.approx(said.push / 0.01)
        assert Compared(replica, off).change(on).multiple < 0.5 * said.multiple


def test_the_distance_of_every_stop_is_told_and_the_larger_mean_decides(replica):
    off = replica.evaluate(replica.baseline)
    steep = dataclasses.replace(replica.baseline, choice={"track_gradient": {"rise": -0.003}})
    said = Compared(replica, off).change(replica.evaluate(steep))
    assert len(said.stops) == len(replica.stops)
    assert min(said.stops) > 0.0  # downhill every stop is longer
    assert np.mean(said.stops) <= said.distance <= max(said.stops)


@pytest.mark.parametrize("name", NAMES)
def test_environments_brake_with_it(name):
    speeds = []
    for mechanisms in ({}, {name: {}}):
        env = gym.make("wsp_env/Coach-v1", mechanisms=mechanisms)
        env.reset(seed=3, options={"mu_cd": 0.03, "track": "constant", "demand": 1.0})
        for _ in range(300):
            env.step(np.full(AXLES, 2))
        speeds.append(env.unwrapped.batch.plant.truth().speed[0])
    assert np.isfinite(speeds).all()
    assert speeds[0] != speeds[1]
