"""Diagnosis of creep curves: what is missing is found on synthetic ones, and on the measured Eurosprinter points."""

import json
import re
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from wsp_env.cli import main
from wsp_env.contact.polach import contact_stiffness, polach_adhesion
from wsp_env.diagnosis import many
from wsp_env.diagnosis.creep_curves import diagnose_creep_curves
from wsp_env.diagnosis.creep_curves.model import CreepModel
from wsp_env.parameters import eurosprinter
from wsp_env.recordings.creep_curves import (
    CreepContact,
    CreepCurve,
    CreepCurves,
    eurosprinter_curve,
    holds_creep_curves,
    read_creep_curves,
)
from wsp_env.recordings.errors import CampaignError

PAGE = Path(__file__).parents[1] / "docs" / "creep_curves.md"
CONTACT = CreepContact(wheel_load_n=80e3, wheel_radius_m=0.46)
TOML = """
[campaign]
name = "test"
kind = "creep_curve"
[contact]
wheel_load_n = 80000.0
wheel_radius_m = 0.46
[curves.one]
file = "one.csv"
speed_mps = 15.0
"""


def synthetic(seed=0, slope=1.0, friction=(0.3, 0.3, 0.5), speeds=(15.0,), extra=None, noise=0.01, points=120, low=5e-4):
    """Points on Polach's law, written with its own formula, with white noise; friction: static, kinetic, rate [s/m]."""
    static, kinetic, rate = friction
    random = np.random.default_rng(seed)
    patch = CONTACT.patch()
    stiffness = slope * float(contact_stiffness(patch.semi_axis_a, patch.semi_axis_b, patch.shear_modulus, patch.c11))
    curves = {}
    for speed in speeds:
        e = np.sort(np.exp(random.uniform(np.log(low), np.log(0.25), points)))
        falling = (kinetic, kinetic / static, rate, 1.0, 1.0)
        f = polach_adhesion(e, e * speed, CONTACT.wheel_load_n, stiffness, *falling) + noise * random.standard_normal(points)
        curves[f"{speed:g} m/s"] = CreepCurve(speed, e, f + (extra(e) if extra else 0.0))
    return CreepCurves("synthetic", CONTACT, curves)


def names(found):
    return {one.name for one in found.mechanisms}


def value(found, name, parameter):
    (one,) = (one for one in found.mechanisms if one.name == name)
    return one.parameters[parameter]


# The model.


@settings(max_examples=30, deadline=None)
@given(level=st.floats(0.02, 0.6), factor=st.floats(0.1, 2.0), speed=st.floats(1.0, 50.0))
def test_baseline_is_polachs_law_with_kalkers_slope(level, factor, speed):
    model = CreepModel(synthetic(speeds=(speed,)))
    law = model.adhesion(level, model.choice((), np.array([level])))
    patch = CONTACT.patch()
    stiffness = float(contact_stiffness(patch.semi_axis_a, patch.semi_axis_b, patch.shear_modulus, patch.c11))
    load = CONTACT.wheel_load_n
    assert_allclose(law, polach_adhesion(model.creepage, 0.0, load, stiffness, level, 1.0, 0.0, 1.0, 1.0), rtol=1e-12)
    softer = model.adhesion(level, model.choice(("initial_slope",), np.array([level, factor])))
    expected = polach_adhesion(model.creepage, 0.0, load, factor * stiffness, level, 1.0, 0.0, 1.0, 1.0)
    assert_allclose(softer, expected, rtol=1e-12)
    small = np.array([1e-7])  # Kalker: T = G a b c11 e
    steepness = float(model.adhesion(level, model.choice((), np.array([level])), (small, np.full(1, speed)))[0]) / 1e-7
    kalker = patch.shear_modulus * patch.semi_axis_a * patch.semi_axis_b * patch.c11 / load
    assert steepness == pytest.approx(kalker, rel=1e-2 if level < 0.05 else 1e-3)


@pytest.mark.parametrize("ratio", [1.0, 0.5])
def test_mechanisms_are_nested_exactly_in_the_baseline(ratio):
    data = synthetic(speeds=(10.0, 30.0))
    data = CreepCurves("nested", CreepContact(80e3, 0.46, friction_ratio=ratio), data.curves)
    model = CreepModel(data)
    plain = model.adhesion(0.3, model.choice((), np.array([0.3])))
    for name in ("initial_slope", "falling_friction", "flash_temperature", "speed_dependent_friction"):
        null = np.array([0.3, *(p.null for p in model.sizes(name))])
        assert (model.adhesion(0.3, model.choice((name,), null)) == plain).all()
        assert model.fit((name,), model.measured).cost <= model.fit((), model.measured).cost * (1.0 + 1e-3)
    assert (np.ptp(plain[model.creepage > 0.05]) < 0.01) == (ratio == 1.0)  # constant friction: no fall


def test_level_is_the_friction_at_the_mean_slip_speed():
    model = CreepModel(synthetic())
    choice = model.choice(("falling_friction",), np.array([0.3, 0.8, 1.0]))
    law = model.law(choice)
    mu = model.kinetic_friction(0.3, law)
    assert mu * (1.0 + (1.0 / law.ratio_r - 1.0) * np.exp(-law.gamma_r * model.reference_mps)) == pytest.approx(0.3)


# Synthetic curves: nothing missing, one thing, both, several speeds, something unknown, nothing to be seen.


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.long)])
def test_nothing_missing_is_adequate_and_says_what_would_have_been_seen(seed):
    found = diagnose_creep_curves(synthetic(seed), seed=seed)
    assert found.verdict == "adequate"
    assert not found.mechanisms
    assert found.closure is None
    assert {"initial_slope", "falling_friction"} <= set(found.detectable)
    assert 0.0 < found.detectable["initial_slope"]["factor"] < 0.5
    assert found.fit.extended == found.fit.baseline
    assert found.fit.removed_validate is None
    assert found.fit.baseline["validate"] == pytest.approx(1.0, abs=0.25)


@pytest.mark.slow
def test_only_the_slope():
    found = diagnose_creep_curves(synthetic(slope=0.4))
    assert found.verdict == "named"
    assert names(found) == {"initial_slope"}
    estimate = value(found, "initial_slope", "factor")
    assert estimate.value == pytest.approx(0.4, rel=0.15)
    assert estimate.interval90[0] < estimate.value < estimate.interval90[1]
    assert found.fit.removed_validate > 0.85
    assert found.location
    low, high = (float(x) for x in re.match(r"creepage (\S+)% to (\S+)%", found.location[0].where).groups())
    assert low < high < 2.0


@pytest.mark.long
def test_only_the_fall():
    found = diagnose_creep_curves(synthetic(friction=(0.35, 0.15, 0.8)))
    assert found.verdict in ("named", "ambiguous")
    assert names(found) == {"falling_friction"}
    assert found.law["static friction"].value == pytest.approx(0.35, rel=0.1)
    assert found.law["kinetic friction"].value == pytest.approx(0.15, rel=0.2)
    assert found.law["friction decrease rate"].value == pytest.approx(0.8, rel=0.3)


@pytest.mark.long
def test_slope_and_fall_together():
    found = diagnose_creep_curves(synthetic(slope=0.4, friction=(0.35, 0.15, 0.8)))
    assert len(found.mechanisms) == 2
    (fall,) = (one for one in found.mechanisms if one.name != "initial_slope")
    assert "falling_friction" in fall.alternatives  # at one speed heat may explain the fall as well
    assert value(found, "initial_slope", "factor").value == pytest.approx(0.4, rel=0.2)
    assert found.cross_validation.held_out["extended"] < found.cross_validation.held_out["baseline"]
    assert found.fit.removed_validate > 0.85
    assert all(one.gain > one.null_gain for one in found.mechanisms)
    places = " ".join(one.where for one in found.location)
    assert "lacks initial slope alone" in places
    assert f"lacks {fall.name.replace('_', ' ')} alone" in places


@pytest.mark.long
def test_a_second_speed_tells_the_running_speed_apart():
    slow, fast = synthetic(1, speeds=(10.0,)), synthetic(2, friction=(0.24, 0.24, 0.5), speeds=(40.0,))
    found = diagnose_creep_curves(CreepCurves("two speeds", CONTACT, slow.curves | fast.curves))
    assert names(found) == {"speed_dependent_friction"}
    assert value(found, "speed_dependent_friction", "share").value > 0.0


@pytest.mark.long
def test_adhesion_that_rises_again_is_unknown():
    found = diagnose_creep_curves(synthetic(extra=lambda e: 0.12 * (e / 0.25) ** 2))
    assert found.verdict == "unknown"
    assert found.closure is not None
    assert found.closure.held_out_gain > 0.0


@pytest.mark.long
def test_points_that_scatter_wildly_are_insufficient():
    found = diagnose_creep_curves(synthetic(noise=0.3, points=24, low=0.02))
    assert found.verdict == "insufficient"


@pytest.mark.long
def test_a_fall_that_never_levels_off_leaves_its_parameters_open():
    found = diagnose_creep_curves(synthetic(friction=(0.35, 0.1, 0.15)))
    assert "falling_friction" in names(found)
    tied = {parameter for one in found.inseparable for parameter in one.parameters}
    assert {"falling_friction.excess", "kinetic_friction"} <= tied
    assert (
        found.law["friction at the mean slip speed"].interval90[1]
        < 1.1 * found.law["friction at the mean slip speed"].interval90[0]
    )


# The measured points.


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """Return what the command writes of the measured points; it asks what the code on the page asked, and is told the same."""
    out = tmp_path_factory.mktemp("eurosprinter")
    (block,) = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    names = {}
    exec(compile(block, str(PAGE), "exec"), names)

    def told(data, effort, seed, report):
        assert (data.name, effort, seed) == (read_creep_curves(eurosprinter_curve()).name, 1.0, 0)
        return names["found"]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(many, "diagnose_creep_curves", told)
        assert main(["diagnose", str(eurosprinter_curve()), "--out", str(out)]) == 0
    return out, json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))


def test_the_measured_folder_is_polachs_case():
    data = read_creep_curves(eurosprinter_curve())
    creepage, adhesion = eurosprinter.measured()
    (curve,) = data.curves.values()
    assert curve.speed_mps == eurosprinter.SPEED_MPS
    assert (np.sort(creepage) == curve.creepage).all()
    assert np.sort(adhesion).sum() == pytest.approx(curve.adhesion.sum())
    assert data.contact.wheel_load_n == eurosprinter.NORMAL_LOAD_N
    assert_allclose(data.contact.patch(), eurosprinter.patch(), rtol=1e-12)


@pytest.mark.long
def test_eurosprinter_lacks_slope_and_fall(measured):
    _, found = measured
    assert found["verdict"] == "named"
    assert {one["name"] for one in found["mechanisms"]} == {"initial_slope", "falling_friction"}
    held_out = found["cross_validation"]["held_out"]
    assert held_out["extended"] < 0.85 * held_out["baseline"]
    places = [one["where"] for one in found["location"]]
    slope = [place for place in places if "below the law that lacks initial slope" in place]
    fall = [place for place in places if "below the law that lacks falling friction" in place]
    ends = [[float(x) for x in re.match(r"creepage (\S+)% to (\S+)%", place).groups()] for place in (slope[0], fall[0])]
    assert ends[0][1] == pytest.approx(1.0, abs=0.3)  # known: too steep below some 1 %
    assert ends[1][0] > ends[0][1]  # and the friction falls above
    open_parameters = {parameter for one in found["inseparable"] for parameter in one["parameters"]}
    assert "falling_friction.excess" in open_parameters
    for one in found["mechanisms"]:
        for estimate in one["parameters"].values():
            low, high = estimate["interval90"]
            assert low <= estimate["value"] <= high


@pytest.mark.long
def test_eurosprinter_has_the_contract_of_stops_and_a_page(measured):
    out, found = measured
    keys = {
        "verdict",
        "mechanisms",
        "location",
        "fit",
        "detectable",
        "next_test",
        "closure",
        "evidence",
        "confounding",
        "notes",
    }
    assert keys <= set(found)
    assert set(found["fit"]) == {"noise_floor", "baseline", "extended", "removed_validate"}
    page = (out / "report.html").read_text(encoding="utf-8")
    loaded = re.findall(r'<(?:script|link|img)[^>]+(?:src|href)="?(http[^"]*)"([^>]*)>', page)
    assert [to.partition("/plotly-")[0] for to, _ in loaded] == ["https://cdn.plot.ly"]
    assert "integrity=" in loaded[0][1]
    for words in (one["words"] for one in found["inseparable"]):
        assert words in page
    env = gym.make("wsp_env/Wheelset-v1", model=str(out / "model.json"))
    env.reset(seed=0)
    _, reward, *_ = env.step(env.action_space.sample())
    assert np.isfinite(reward)


# Bad input.


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "campaign.toml").write_text(TOML, encoding="utf-8")
    (tmp_path / "one.csv").write_text("creepage,adhesion_coefficient\n" + "0.01,0.2\n" * 30, encoding="utf-8")
    return tmp_path


def test_a_good_folder_is_read(folder):
    assert holds_creep_curves(folder)
    assert len(read_creep_curves(folder).curves["one"].creepage) == 30


@pytest.mark.parametrize(
    ("csv", "message"),
    [
        ("creepage,adhesion\n" + "0.01,0.2\n" * 30, "lacks the column adhesion_coefficient"),
        ("creepage,adhesion_coefficient\n" + "0.01,0.2\n" * 29 + "-0.01,0.2\n", "point 30 has creepage = -0.01"),
        ("creepage,adhesion_coefficient\n" + "0.01,0.2\n" * 29 + "2,0.2\n", "point 30 has creepage = 2"),
        ("creepage,adhesion_coefficient\n0.01,nan\n" + "0.01,0.2\n" * 29, "point 1 has adhesion_coefficient = nan"),
        ("creepage,adhesion_coefficient\n,0.2\n" + "0.01,0.2\n" * 29, "point 1 has creepage = nan"),
        ("creepage,adhesion_coefficient\n" + "0.01,0.2\n" * 10, "10 points together, a diagnosis needs at least 20"),
        ("creepage,adhesion_coefficient\n", "no samples"),
        ("", "is empty"),
    ],
)
def test_bad_points_get_one_clear_error(folder, csv, message, capsys):
    (folder / "one.csv").write_text(csv, encoding="utf-8")
    with pytest.raises(CampaignError, match=re.escape(message)):
        read_creep_curves(folder)
    assert main(["diagnose", str(folder), "--out", str(folder / "out")]) == 2
    assert message in capsys.readouterr().err
    assert not (folder / "out").exists()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("speed_mps = 15.0", "speed_mps = 0.0", "speed_mps must be a finite number above 0"),
        ("speed_mps = 15.0", "", "lacks speed_mps"),
        ("speed_mps = 15.0", "speed_mps = 15.0\nload = 3", "unknown key load"),
        ("wheel_load_n = 80000.0", "", "needs wheel_load_n"),
        ("wheel_load_n = 80000.0", "wheel_load_n = -1.0", "wheel_load_n = -1.0 N is impossible"),
        ("wheel_radius_m = 0.46", "wheel_radius_m = 0.46\nlateral_curvature_per_m = 99.0", "Kalker's table covers"),
        ('"one.csv"', '"two.csv"', "two.csv cannot be opened"),
        ("[curves.one]", "[stops.one]", "lacks curves"),
    ],
)
def test_bad_descriptions_get_one_clear_error(folder, old, new, message):
    (folder / "campaign.toml").write_text(TOML.replace(old, new), encoding="utf-8")
    with pytest.raises(CampaignError, match=re.escape(message)):
        read_creep_curves(folder)


def test_an_unknown_kind_is_told(folder, capsys):
    (folder / "campaign.toml").write_text(TOML.replace("creep_curve", "creeps"), encoding="utf-8")
    assert not holds_creep_curves(folder)
    with pytest.raises(CampaignError, match="kind = 'creeps' is unknown"):
        read_creep_curves(folder)
