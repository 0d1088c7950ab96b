"""The proof's truth model, bank and score: physics, nulls, independence, format, labels, figures on made-up answers."""

import ast
import dataclasses
import hashlib
import math
from pathlib import Path

import numpy as np
import pytest

import experiments.concealed as package
from experiments.concealed import bank, concealment, interest
from experiments.concealed.campaign import build
from experiments.concealed.effects import ALL, FOREIGN, LIBRARY, Place
from experiments.concealed.plan import CONFOUNDED, SHARES, Case, plan
from experiments.concealed.records import Effects
from experiments.concealed.score import found, rate, score
from experiments.concealed.sensors import DEVIATION, QUANTUM, SAMPLE_S, record
from experiments.concealed.setup import GRAVITY_MPS2, RUNS, Setup, draw, make_law, reference
from experiments.concealed.truth import STEP_S, limit, rub, simulate, solve
from wsp_env.contact.degraded import degraded_adhesion
from wsp_env.parameters import velim
from wsp_env.recordings import read_campaign

TRUTH = ("truth", "records", "setup", "effects", "sensors", "interest", "campaign", "plan")
SIZES = interest.sizes()


def sliding() -> Setup:
    """Return the reference with one stop that slides and is soon over."""
    setup = reference()
    run = setup.runs["sliding 34"]
    return dataclasses.replace(setup, runs={"A1": run._replace(speed=20.0, coast=1.0)})


def driven(setup: Setup):
    """Return the history of the one stop of a setup."""
    (run,) = setup.runs.values()
    return simulate(setup.vehicle, setup.law, setup.brake, run, setup.profile, setup.effects)


@pytest.mark.parametrize("module", TRUTH)
def test_truth_shares_no_code_with_the_project(module):
    tree = ast.parse((Path(package.__file__).parent / f"{module}.py").read_text(encoding="utf-8"))
    named = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    named |= {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert not [name for name in named if name.split(".")[0] in ("wsp_env", "baselines")]


@pytest.mark.parametrize("speed", [3.0, 12.0, 40.0])
@pytest.mark.parametrize("creepage", [-0.2, 5e-4, 0.01, 0.08, 0.3, 1.0])
def test_own_root_is_the_paper_s_law(speed, creepage):
    vehicle, law, mu_cd = reference().vehicle, make_law(1.9e-4), 0.06
    load = vehicle.mass * GRAVITY_MPS2 / 8
    f, _ = solve(creepage * speed, 0.0, 0.1, 1.0, speed, load, mu_cd, 1.0, -1.0, vehicle.stiffness[0], law, Effects())
    expected = degraded_adhesion(creepage * speed, speed, load, mu_cd, 1.9e-4, velim.CONTACT.law)
    assert f == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize(
    "effects",
    [
        Effects(),
        Effects(removal=1e-5, memory=3.0, flash=1e-4),
        Effects(body_height=2.0, drag_c=8.0, eddy=5e3, slack=2e3, gusts=1e3, dragging=300.0),
        Effects(sand=0.4, hunting=0.1, layer=0.05, threshold=200.0, drop=0.2, running=0.5, pad_heat=1e-3, pad_speed=0.2),
    ],
)
def test_energy_is_conserved(effects):
    setup = dataclasses.replace(sliding(), effects=effects)
    history = driven(setup)
    mass, inertia = setup.vehicle.mass, setup.vehicle.inertia

    def energy(n: int) -> float:
        return 0.5 * mass * history.speed[n] ** 2 + 0.5 * inertia * (history.wheel[n] ** 2).sum()

    assert history.work.sum() == pytest.approx(energy(0) - energy(-1), rel=1e-3)  # the last step is not in the history
    assert history.work[1] > 0.02 * history.work.sum()  # it does slide


def test_forces_balance_at_every_sample():
    setup = sliding()
    history = driven(setup)
    inertia, radius = setup.vehicle.inertia, setup.vehicle.radius
    force = 2.0 * history.load * history.adhesion
    window = 20  # the mean over 20 ms of both sides of J dw/dt = r T - C
    kernel = np.ones(window) / window
    for k in range(setup.axles):
        torque = np.convolve(radius[k] * force[:, k] - history.torque[:, k], kernel, "valid")[1:]
        rate = inertia * (history.wheel[window:, k] - history.wheel[:-window, k]) / (window * STEP_S)
        assert np.abs(rate - torque[: len(rate)]).max() < 0.03 * history.torque.max()
    deceleration = (history.speed[0] - history.speed[-1]) * setup.vehicle.mass
    assert deceleration == pytest.approx(force.sum() * STEP_S, rel=2e-3)


def test_gentle_stop_takes_the_distance_of_its_torque():
    setup = reference()
    run = setup.runs["gentle"]
    history = driven(dataclasses.replace(setup, runs={"A1": run}))
    mass = setup.vehicle.mass + 4 * setup.vehicle.inertia / 0.445**2
    deceleration = 4 * run.demand / 0.445 / mass
    ideal = (run.speed**2 - run.end_speed**2) / (2 * deceleration) + run.speed * setup.brake.rise
    brake_lag = setup.brake.fill[0] * run.speed
    assert history.position[-1] - run.position - run.speed * run.coast == pytest.approx(ideal + brake_lag, rel=0.01)


@pytest.mark.parametrize("name", ALL)
def test_effect_vanishes_at_its_null_and_acts_beyond(name):
    setup, effect = sliding(), ALL[name]
    for variant in range(len(effect.variants)):
        place = Place(track_m=100.0, variant=variant)
        size = 8.0 * SIZES[interest.key(name, variant)]
        tables = [
            record(driven(one), one, np.random.default_rng(0))
            for one in (setup, effect.apply(setup, 0.0, place), effect.apply(setup, size, place))
        ]
        assert all(np.array_equal(tables[0][column], tables[1][column]) for column in tables[0])
        both = min(len(tables[0]["time_s"]), len(tables[2]["time_s"]))
        assert any(np.abs(tables[0][c][:both] - tables[2][c][:both]).max() > 1e-3 for c in tables[0])


def test_size_table_covers_all_and_is_reproduced():
    assert set(SIZES) == {interest.key(name, v) for name, effect in ALL.items() for v in range(len(effect.variants))}
    distance, slip = interest.change(LIBRARY["track_gradient"], SIZES["track_gradient/0"])
    reached = max(abs(distance) / interest.DISTANCE_SHARE, slip / interest.SLIP_MPS)
    assert reached == pytest.approx(1.0, abs=0.1)


def test_cleaning_has_the_limits_of_its_equation():
    film = np.ones(3)
    rub(1, 1e3, 1e-5, film)
    assert film[0] == film[2] == 1.0
    assert film[1] == pytest.approx(math.exp(-1e-2), rel=1e-4)  # of first order as any law
    rub(1, 1e9, 1e-5, film)
    assert 0.0 < film[1] < 1e-6


def test_limit_curve_without_slip_is_nothing_and_grows_with_kalkers_slope():
    setup = reference()
    stiffness, load = setup.vehicle.stiffness[0], 52_700.0
    slope = limit(1e-7, 0.0, load, stiffness, 0.3, 0.4, 0.2, 1.0, 1.0, 0.0) / 1e-7
    assert slope == pytest.approx(2.0 / math.pi * 2.0 * stiffness / load, rel=1e-6)


def test_normal_variation_is_as_stated():
    setups = [draw(np.random.default_rng(seed), 4, 1.0, False) for seed in range(20)]
    gains = np.array([one.brake.gain for one in setups])
    radii = np.array([one.vehicle.radius for one in setups]) / 0.445
    frictions = np.array([[run.mu_cd / one.believed_mu_cd for run in one.runs.values()] for one in setups])
    for values, spread in ((gains, 0.01), (radii, 0.0005), (frictions, 0.15)):
        assert np.abs(values - 1.0).max() <= spread
        assert values.std() == pytest.approx(spread / math.sqrt(3.0), rel=0.25)
    profile = setups[0].profile
    assert np.abs(profile - 1.0).max() <= 0.02
    assert all(one.effects == Effects() for one in setups)


def test_sensors_add_the_stated_noise_and_quanta():
    setup = dataclasses.replace(sliding(), sensors=dataclasses.replace(sliding().sensors, noise=2.0))
    history = driven(setup)
    noisy = record(history, setup, np.random.default_rng(3))
    quiet = record(history, sliding(), np.random.default_rng(3))
    for channel, column in (("vehicle_speed", "vehicle_speed_mps"), ("wheel_speed", "axle2_wheel_speed_radps"),
                            ("torque", "axle2_brake_torque_nm")):  # fmt: skip
        assert (noisy[column] - quiet[column]).std() == pytest.approx(2.0 * DEVIATION[channel], rel=0.1)
        steps = noisy[column] / QUANTUM[channel]
        assert np.abs(steps - np.round(steps)).max() < 1e-3
    assert np.allclose(np.diff(noisy["time_s"]), SAMPLE_S)


def test_lagging_sensor_is_late_by_its_lag_in_a_steady_deceleration():
    setup = reference()
    setup = dataclasses.replace(setup, runs={"A1": setup.runs["gentle"]})
    late = dataclasses.replace(setup, sensors=dataclasses.replace(setup.sensors, lag_s=0.3))
    history = driven(setup)
    column = "axle1_wheel_speed_radps"
    plain, lagged = (record(history, one, np.random.default_rng(0))[column] for one in (setup, late))
    middle = slice(1500, 4000)
    rate = np.polyfit(np.arange(2500) * SAMPLE_S, plain[middle], 1)[0]
    assert (lagged - plain)[middle].mean() == pytest.approx(-0.3 * rate, rel=0.01)


@pytest.mark.parametrize("cases", [5, 8, 60, 228, 230])
def test_plan_holds_every_class(cases):
    planned = plan(cases)
    assert [case.index for case in planned] == list(range(cases))
    assert {case.kind for case in planned} == set(SHARES)
    assert all(case.axles >= ALL[name].least_axles for case in planned for name in case.effects)
    assert not [c for c in planned if c.measured_torque and any(ALL[name].pressure_only for name in c.effects)]
    if cases >= 228:
        assert sum(case.kind == "null" for case in planned) >= 60
        singles = [case.effects[0] for case in planned if case.kind == "single"]
        assert {name: singles.count(name) >= 5 for name in LIBRARY} == dict.fromkeys(LIBRARY, True)
        assert {case.effects[0] for case in planned if case.kind == "foreign"} == set(FOREIGN)
        assert {case.recipe for case in planned if case.kind == "confounded"} == set(range(len(CONFOUNDED)))


def test_plan_refuses_fewer_cases_than_classes():
    with pytest.raises(ValueError, match="at least 5"):
        plan(4)


def test_draws_are_the_case_s_own_and_sizes_do_not_disturb_them():
    case = Case(7, "single", ("track_gradient",), 2.0, 1.0)
    one, effects = build(case, 3, 0, SIZES, 1.0)
    two, smaller = build(case, 3, 0, SIZES, 0.5)
    other, _ = build(dataclasses.replace(case, index=8), 3, 0, SIZES, 1.0)
    assert one.law.tau == two.law.tau != other.law.tau
    assert smaller[0].size == pytest.approx(0.5 * effects[0].size)
    assert effects[0].multiple == pytest.approx(2.0)
    assert one.runs["A1"].slope == pytest.approx(effects[0].size)


@pytest.fixture(scope="module")
def small_bank(tmp_path_factory):
    """Return the folder of the small bank and its digest."""
    out = tmp_path_factory.mktemp("bank")
    return out, bank.make(out, 5, 11, 1)


@pytest.mark.slow
def test_bank_is_readable_concealed_labelled_and_reproducible(small_bank):
    out, digest = small_bank
    labels = bank.read_labels(out)
    assert hashlib.sha256((out / "labels.json").read_bytes()).hexdigest() == digest
    assert {label["class"] for label in labels.values()} == set(SHARES)
    for name, label in labels.items():
        campaign = read_campaign(out / "campaigns" / name)
        assert (*campaign.tune, *campaign.validate) == RUNS
        assert campaign.vehicle.axles == label["axles"]
        assert (campaign.vehicle.brake_torque_source == "measured") == label["measured_torque"]
        assert concealment.passes(concealment.worst_error(out / "campaigns" / name))
        assert label["mechanisms"] == [e["name"] for e in label["effects"] if e["name"] in LIBRARY]
        assert label["verdict"] == {"null": "adequate", "foreign": "unknown"}.get(label["class"], "named")
        text = (out / "campaigns" / name / "campaign.toml").read_text(encoding="utf-8").replace("wheel_radius_m", "")
        assert not [effect for effect in ALL if effect in text]  # nothing tells what is concealed
    parts = sorted((out / "labels").glob("*.json"))
    before = parts[0].read_text(encoding="utf-8")
    for file in (out / "campaigns" / parts[0].stem).iterdir():
        file.unlink()
    parts[0].unlink()
    assert bank.make(out, 5, 11, 1) == digest  # goes on, and makes the same again
    assert parts[0].read_text(encoding="utf-8") == before


@pytest.mark.slow
def test_bank_refuses_other_numbers_and_changed_labels(small_bank):
    out, _ = small_bank
    with pytest.raises(bank.BankError, match="another bank"):
        bank.make(out, 6, 11, 1)
    kept = (out / "labels.json").read_bytes()
    (out / "labels.json").write_bytes(kept.replace(b"null", b"none"))
    with pytest.raises(bank.BankError, match="changed since its hash"):
        bank.read_labels(out)
    (out / "labels.json").write_bytes(kept)


def test_labels_need_a_finished_bank(tmp_path):
    with pytest.raises(bank.BankError, match="no finished bank"):
        bank.read_labels(tmp_path)


def truth(kind: str, *names: str, size: float = 1.0, multiple: float = 2.0) -> dict:
    """Return a label."""
    effects = [{"name": name, "size": size, "unit": ALL[name].unit, "multiple": multiple} for name in names]
    mechanisms = [name for name in names if name in LIBRARY]
    return {"class": kind, "mechanisms": mechanisms, "effects": effects, "noise": 1.0, "axles": 4, "distance_change": -0.02}


def answer(verdict: str, *names: str, alternatives: tuple[str, ...] = (), confidence: float = 0.9, **parameters) -> dict:
    """Return a diagnosis that removes three fourths of what can be removed."""
    mechanisms = [
        {"name": name, "confidence": confidence, "alternatives": [name, *alternatives], "parameters": parameters}
        for name in names
    ]
    fit = {"noise_floor": 1.0, "baseline": {"validate": 5.0}, "extended": {"validate": 2.0}}
    return {"verdict": verdict, "mechanisms": mechanisms, "fit": fit}


def test_score_of_made_up_answers():
    gradient = {"value": 0.0011, "unit": "-", "interval90": [0.0008, 0.0013]}
    pairs = {
        "n1": (truth("null"), answer("adequate")),
        "n2": (truth("null"), answer("named", "wheel_radius", confidence=0.6)),
        "n3": (truth("null"), answer("insufficient")),
        "s1": (truth("single", "track_gradient", size=0.001), answer("named", "track_gradient", gradient=gradient)),
        "s2": (truth("single", "load_transfer"), answer("ambiguous", "flash_temperature", alternatives=("load_transfer",))),
        "s3": (truth("single", "load_transfer", multiple=1.0), answer("adequate")),
        "p1": (truth("pair", "wheel_radius", "load_transfer"), answer("named", "load_transfer", "wheel_radius")),
        "p2": (truth("pair", "wheel_radius", "load_transfer"), answer("named", "load_transfer")),
        "c1": (truth("confounded", "track_gradient"), answer("insufficient")),
        "c2": (truth("confounded", "track_gradient"), answer("named", "vehicle_mass")),
        "f1": (truth("foreign", "sanding"), answer("unknown")),
        "f2": (truth("foreign", "sanding"), answer("named", "falling_friction")),
    }
    figures = score({k: v[0] for k, v in pairs.items()}, {k: v[1] for k, v in pairs.items()})
    assert figures["false_alarms"][:3] == (1, 3, 1 / 3)
    assert figures["singles"]["right_name_first"][:2] == (1, 3)
    assert figures["singles"]["in_set"][:2] == figures["singles"]["in_set_of_two"][:2] == (2, 3)
    assert figures["singles_by_size"]["1.5 to 3"]["in_set"].share == 1.0
    assert figures["singles_by_size"]["0.75 to 1.5"]["in_set"].share == 0.0
    assert figures["pairs_both_found"][:2] == figures["pairs_one_found"][:2] == (1, 2)
    assert figures["confounded_honest"][:2] == (1, 2)
    assert figures["foreign_named_wrongly"][:2] == (1, 2)
    assert figures["foreign_seen"].share == 1.0
    assert figures["removed_share"]["mean"] == pytest.approx(0.75)
    assert figures["parameters"]["relative_error"]["mean"] == pytest.approx(0.1)
    assert figures["parameters"]["interval90_covers"].share == 1.0
    assert figures["calibration"]["claims"] == 8
    assert figures["confusion"]["load_transfer"] == {"flash_temperature": 1, "adequate": 1}


def test_score_needs_every_answer():
    with pytest.raises(bank.BankError, match="no answer for 1 of 1"):
        score({"n1": truth("null")}, {})


def test_two_truths_need_two_mechanisms():
    both = answer("ambiguous", "wheel_radius", alternatives=("load_transfer",))
    assert found(["wheel_radius", "load_transfer"], both) == 1
    assert found(["load_transfer"], both) == 1
    assert found(["load_transfer"], both, largest_set=1) == 0
    assert found([], both) == 0


def test_rate_bounds_are_clopper_and_pearson_s():
    none = rate([False] * 60)
    assert none.upper95 == pytest.approx(1.0 - 0.05 ** (1 / 60))  # the closed form for no event
    assert none.lower95 == 0.0
    assert rate([True] * 60).lower95 == pytest.approx(0.05 ** (1 / 60))
    assert rate([]).share is None
