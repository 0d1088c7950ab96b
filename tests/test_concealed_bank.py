"""The proof's truth model and plan: physics, nulls, independence, sensors, normal variation."""

import ast
import dataclasses
import math
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import experiments.concealed as package
from experiments.concealed import interest
from experiments.concealed.campaign import build
from experiments.concealed.effects import ALL, FOREIGN, LIBRARY, NAMED, Place, library_names
from experiments.concealed.faults import DELAYS_S, FAULTS, inject
from experiments.concealed.plan import CONFOUNDED, MIXED, SHARES, Case, plan
from experiments.concealed.records import Effects
from experiments.concealed.sensors import DEVIATION, QUANTUM, SAMPLE_S, record
from experiments.concealed.setup import GRAVITY_MPS2, Setup, draw, make_law, reference
from experiments.concealed.truth import STEP_S, limit, rub, simulate, solve
from wsp_env.contact.degraded import degraded_adhesion
from wsp_env.parameters import velim
from wsp_env.plant import mechanisms

TRUTH = ("truth", "records", "setup", "effects", "sensors", "interest", "campaign", "plan", "faults")
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


@pytest.mark.parametrize("cases", [7, 8, 60, 228, 240])
def test_plan_holds_every_class(cases):
    planned = plan(cases)
    assert [case.index for case in planned] == list(range(cases))
    assert {case.kind for case in planned} == set(SHARES)
    assert all(case.axles >= ALL[name].least_axles for case in planned for name in case.effects)
    assert not [c for c in planned if c.measured_torque and any(ALL[name].pressure_only for name in c.effects)]
    if cases >= 228:
        assert sum(case.kind == "null" for case in planned) >= 60
        singles = [case.effects[0] for case in planned if case.kind == "single"]
        assert {name: singles.count(name) >= 4 for name in NAMED} == dict.fromkeys(NAMED, True)
        assert {case.effects[0] for case in planned if case.kind == "foreign"} == set(FOREIGN)
        assert {case.fault for case in planned if case.kind == "fault"} == set(FAULTS)
        unknown = [case for case in planned if not case.start_positions]
        assert {case.kind for case in unknown} == {"null", "single"}
        assert "adhesion_patch" not in [name for case in unknown for name in case.effects]
        assert {case.recipe for case in planned if case.kind == "confounded"} == set(range(len(CONFOUNDED)))


def test_plan_refuses_fewer_cases_than_classes():
    with pytest.raises(ValueError, match="at least 7"):
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


def test_effects_have_the_library_s_names_or_none():
    assert set(library_names(NAMED)) <= set(mechanisms.LIBRARY)
    assert library_names(["slack_action", "hunting"]) == ["coupler_force"]
    assert not set(FOREIGN) & set(mechanisms.LIBRARY)
    assert all(effect.slots for effect in FOREIGN.values())
    assert all((first in NAMED, second in FOREIGN) == (True, True) for first, second in MIXED)


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_fault_spoils_its_channel_and_no_other(tmp_path, fault, suffix):
    rng = np.random.default_rng(2)
    names = [f"axle{k}_{what}" for k in (1, 2, 3, 4) for what in ("wheel_speed_radps", "brake_torque_nm")]
    before = pl.DataFrame({"time_s": np.arange(200) * 0.01, **{name: rng.uniform(1.0, 9.0, 200) for name in names}})
    file = tmp_path / f"A1.{suffix}"
    (before.write_csv if suffix == "csv" else before.write_parquet)(file)
    axles = inject(tmp_path, fault, 0, 5)
    after = pl.read_csv(file) if suffix == "csv" else pl.read_parquet(file)
    changed = [name for name in before.columns if not np.allclose(before[name], after[name])]
    what = "brake_torque_nm" if fault.startswith("torque") else "wheel_speed_radps"
    assert sorted(changed) == sorted(f"axle{k}_{what}" for k in axles)
    old, new = before[changed[0]].to_numpy(), after[changed[0]].to_numpy()
    late = round(DELAYS_S[0] / 0.01)
    expected = {
        "torque in another unit": lambda: np.allclose(new, 1e-3 * old),
        "torque halved": lambda: np.allclose(new, 0.5 * old),
        "wheel speed in another unit": lambda: np.allclose(new, 60.0 / (2.0 * np.pi) * old),
        "torque offset": lambda: np.allclose(new, old + 2000.0),
        "wheel speed delayed": lambda: np.allclose(new[late:], old[:-late]),
        "wheel speed copied": lambda: any(np.allclose(new, before[name]) for name in names if name != changed[0]),
        "wheel speeds swapped": lambda: np.allclose(new, before[changed[1]]) and np.allclose(old, after[changed[1]]),
    }
    assert expected[fault]()
