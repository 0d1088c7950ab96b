"""The truth by another hand: its law, its integration, the signs of its effects, its draws, its files and labels."""

import dataclasses
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from experiments.concealed.truths import COMPARABLE, KINDS, SLOTS, of_label
from experiments.other_truth import effects, record, sizes, sound
from experiments.other_truth.__main__ import make_campaign, tables
from experiments.other_truth.campaign import draw
from experiments.other_truth.contact import adhesion, limits
from experiments.other_truth.labels import label
from experiments.other_truth.plant import GRAVITY_MPS2, ROW_S, STEP_S
from experiments.other_truth.records import Sizes
from wsp_env.contact.degraded import degraded_adhesion
from wsp_env.parameters import velim
from wsp_env.plant.mechanisms import LIBRARY
from wsp_env.recordings import read_campaign

#: Of a campaign with two axles, five stops and a protection by steps of pressure: quick.
SEED = 65
#: By how much halving the step may change the length of a stop.
CONVERGED = 1e-4
CASES = [
    (s, v, n, mu, tau)
    for s in (0.02, 0.5, 5.0)
    for v in (8.0, 40.0)
    for n in (3e4, 7e4)
    for mu in (0.02, 0.06)
    for tau in (0.0, 3e-4)
]


@pytest.fixture(scope="module")
def campaign():
    return draw(SEED)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A campaign's folder, name and label."""
    folder = tmp_path_factory.mktemp("truth") / "i065"
    return folder, make_campaign(0, SEED, "single", ["wheel_radius"], folder)


@pytest.fixture(scope="module")
def dry(campaign):
    """The campaign's gentle stop alone, on a dry rail, from 20 m/s, and with known places."""
    run = campaign.runs[3]._replace(mu_cd=0.28, speed_mps=20.0, coast_s=3.0)
    return dataclasses.replace(campaign, runs=[run], places=campaign.places._replace(gain_axle=1, radius_axle=0))


def driven(campaign, **effect):
    return campaign.stop(0, Sizes(**effect), sound=False)


def slowing(vehicle, rows, mass=1.0):
    """Loss of speed over the loss that the torques explain on wheels that roll, for a mass times the believed one."""
    r = vehicle.radius_m
    inert = mass * vehicle.mass_kg + rows.wheel.shape[1] * vehicle.inertia_kgm2 / r**2
    return (rows.speed[0] - rows.speed[-1]) / (np.trapezoid(rows.torque.sum(axis=1)) * ROW_S / r / inert)


def test_the_law_holds():
    for slip, v, load, mu_cd, tau in CASES:
        f, work = adhesion(slip, v, load, mu_cd, tau, 0.0, 0.0, -1.0)
        f_d, f_r = limits(slip, v, load, mu_cd, 0.0)
        assert work == pytest.approx(f * load * slip / v, rel=1e-14)
        assert f == pytest.approx(f_d + (1.0 - np.exp(-tau * work)) * (f_r - f_d), abs=1e-10)
        assert min(f_d, f_r) - 1e-12 <= f <= max(f_d, f_r) + 1e-12
        assert adhesion(-slip, v, load, mu_cd, tau, 0.0, 0.0, -1.0) == (f, work)


def test_two_solutions_of_the_law_agree():
    # The seed paper's contact in both; wsp_env solves it by Lambert's function.
    slip, v, load, mu_cd, tau = np.array(CASES).T
    theirs = degraded_adhesion(slip, v, load, mu_cd, tau, velim.CONTACT.law)
    ours = [adhesion(*case, 0.0, 0.0, -1.0)[0] for case in CASES]
    assert ours == pytest.approx(theirs, abs=1e-9)


def test_recovery_with_a_threshold_and_with_a_memory():
    case = (3.0, 20.0, 5e4, 0.04, 2e-4)
    f_d, f_r = limits(*case[:4], 0.0)
    below, _ = adhesion(*case, 1e6, 0.0, -1.0)  # no work reaches the threshold
    assert below == pytest.approx(f_d, rel=0.02)
    little, _ = adhesion(*case, 1e-6, 0.0, -1.0)
    assert little == pytest.approx(adhesion(*case, 0.0, 0.0, -1.0)[0], abs=1e-6)
    assert adhesion(*case, 0.0, 0.0, 0.0)[0] == pytest.approx(f_d, rel=1e-12)
    assert adhesion(*case, 0.0, 0.0, 1e9)[0] == pytest.approx(f_r, rel=1e-12)


@pytest.mark.long
def test_the_integration_converges(campaign, dry):
    lengths = [dry.stop(0, Sizes(), sound=False, step_s=STEP_S / parts).length for parts in (1, 2, 4)]
    assert abs(lengths[1] / lengths[0] - 1.0) < CONVERGED
    assert abs(lengths[2] - lengths[1]) < 0.6 * abs(lengths[1] - lengths[0])  # first order
    whole = dataclasses.replace(
        campaign, protection=campaign.protection._replace(period_s=0.06)
    )  # whole steps between decisions
    for stop in (2, 4):
        coarse, fine = (whole.stop(stop, Sizes(), sound=False, step_s=h) for h in (STEP_S, 0.5 * STEP_S))
        assert fine.slip.max() > 0.5
        assert abs(fine.length / coarse.length - 1.0) < CONVERGED


def test_rolling_wheels_slow_the_vehicle_by_their_torques(dry):
    assert slowing(dry.vehicle, driven(dry)) == pytest.approx(1.0, abs=2e-3)


def test_sizes_mean_what_the_library_means(dry):
    vehicle, r = dry.vehicle, dry.vehicle.radius_m
    coasting = slice(0, round(2.5 / ROW_S))
    rows = driven(dry, vehicle_mass=0.1)
    assert slowing(vehicle, rows, 1.1) == pytest.approx(1.0, abs=2e-3)
    rows = driven(dry, track_gradient=0.004)  # uphill slows
    inert = 1.0 + dry.axles * vehicle.inertia_kgm2 / r**2 / vehicle.mass_kg
    lost = rows.speed[coasting][0] - rows.speed[coasting][-1]
    assert lost == pytest.approx(GRAVITY_MPS2 * 0.004 * (2.5 - ROW_S) / inert, rel=1e-2)
    rows = driven(dry, wheel_radius=-0.02)
    assert rows.wheel[coasting] * (r * np.array([0.98, 1.0])) == pytest.approx(np.outer(rows.speed[coasting], [1, 1]), rel=1e-5)
    rows = driven(dry, brake_gain_imbalance=0.2)
    assert rows.torque == pytest.approx(rows.pressure * vehicle.torque_per_bar_nm * [1.0, 1.2], abs=1e-6)
    silent = dataclasses.replace(dry, sound=[])
    late = record.record(silent, 0, rows, record.Recorders(200, "computed", True, 0.0), 0.3)["vehicle_speed_mps"]
    assert late[1000:2000] == pytest.approx(rows.speed[940:1940], abs=2e-3)  # the library's late speed: that of 0.3 s before


def test_every_effect_moves_a_stop(campaign):
    placed = dataclasses.replace(
        campaign, places=campaign.places._replace(patch_m=300.0, patch_length_m=200.0, curve_m=300.0, curve_length_m=300.0)
    )
    bare = placed.stop(0, Sizes(), sound=False)
    for name, effect in effects.EFFECTS.items():
        length, slip = sizes.moved(placed, Sizes(**{name: effect.guess}), [bare], [0, 1])
        assert 1e-4 < max(abs(length[0]), slip[0]) < 1.0, name


def test_tables_of_effects_agree(campaign):
    assert tuple(effects.EFFECTS) == Sizes._fields
    assert {name for name, one in effects.EFFECTS.items() if one.library} == set(effects.EFFECTS) & set(LIBRARY)
    assert set(effects.SLOTS.values()) <= set(SLOTS)
    for name, one in effects.EFFECTS.items():
        assert set(one.others) | {one.axle} - {""} <= set(campaign.places._fields)
        if one.parameter:
            assert COMPARABLE[name][0] == one.parameter


def test_the_plan_mixes_kinds_and_lets_effects_take_turns():
    planned = effects.plan(1, 100)
    assert Counter(kind for kind, _ in planned) == {"null": 40, "single": 30, "pair": 10, "outside": 20}
    assert {kind: len(names) for kind, names in planned} == {"null": 0, "single": 1, "pair": 2, "outside": 1}
    singles = Counter(name for kind, names in planned if kind == "single" for name in names)
    assert len(singles) == sum(one.library for one in effects.EFFECTS.values())
    assert planned[:30] == effects.plan(1, 30)
    assert planned != effects.plan(2, 100)


@pytest.mark.long
def test_the_same_seed_draws_the_same(campaign):
    again, other = draw(SEED), draw(SEED + 46)
    assert (again.runs, again.places, again.protection, again.sound) == (
        campaign.runs,
        campaign.places,
        campaign.protection,
        campaign.sound,
    )
    first = campaign.stop(1, Sizes())
    assert (again.stop(1, Sizes()).wheel == first.wheel).all()
    assert other.runs != campaign.runs
    assert other.stop(1, Sizes()).length != first.length


def test_sound_variation_stays_within_what_is_promised(campaign):
    for stop in range(len(campaign.runs)):
        length, slip = campaign.spread(stop)
        assert 0.0 < length < 0.004
        assert slip < 0.05


def test_kinds_of_sound_variation_that_are_not_drawn_have_no_size():
    silent = sound.draw_sound(1, 0, 4, [])
    assert all((values == 0.0).all() for values in silent)
    loud = sound.draw_sound(1, 0, 4, list(sound.SOUND))
    assert np.std(loud.roughness) == pytest.approx(sound.SOUND["rail_roughness"].size, rel=0.2)
    assert np.std(loud.bounce) == pytest.approx(sound.SOUND["wheel_bounce"].size, rel=0.2)
    assert abs(loud.radius.sum()) < 1e-12


def test_a_campaign_is_read_with_its_label(made):
    folder, content = made
    campaign = read_campaign(folder)
    assert len(campaign.tune) + len(campaign.validate) == len(content["mu_cd"])
    truth = of_label("i065", content)
    assert (truth.kind, truth.names, truth.matters) == ("single", ("wheel_radius",), True)
    detail = content["details"][0]
    assert truth.parameters == {"wheel_radius": {"change": detail["size"], "axle": detail["axles"][0]}}
    assert sizes.REACHED[0] < detail["reached"] < sizes.REACHED[1]


@pytest.mark.long
def test_a_campaign_is_not_written_over(made):
    with pytest.raises(FileExistsError):
        make_campaign(0, SEED, "null", [], made[0])


@pytest.mark.parametrize("name", effects.EFFECTS)
def test_labels_say_where_effects_act(campaign, name):
    effect = effects.EFFECTS[name]
    recorders = record.Recorders(100, "computed", True, 1.0)
    one = sizes.Concealed(name, effect.guess, [1], 1.5, 0.5, [], [])
    kind = "single" if effect.library else "outside"
    truth = of_label("c", label(campaign, kind, [one], recorders, {}))
    assert truth.kind in KINDS
    assert not truth.matters  # 0.5 of the least effect
    assert truth.names == ((name,) if effect.library else ())
    assert bool(truth.slots) != effect.library
    assert truth.axles == (() if effect.library or truth.slots == ("vehicle force",) else (2,))
    assert bool(truth.parameters) == bool(effect.parameter)


def test_the_page_has_the_tables_of_today():
    page = Path(__file__).parents[1] / "docs" / "lab" / "concealed.md"
    for table in tables().split("\n\n"):
        assert table in page.read_text(encoding="utf-8"), "write them anew with `python -m experiments.other_truth tables`"
