"""Clocks and faults of recordings: what is repaired is said and marked, what cannot be is refused, and nothing else changes."""

import re
import shutil
import warnings

import numpy as np
import polars as pl
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from synthetic_stops import AXLES, stop, write_campaign

from wsp_env.recordings import CampaignError, CampaignWarning, clock, demo_campaign, quality, read_campaign, readers, tune

STEP = 0.01


def sines(time):
    return 3.0 + np.sin(2 * np.pi * 0.7 * time) + 0.5 * time


def even(n=500, step=STEP):
    return clock.repair(step * np.arange(n), "here")[0]


def test_a_good_clock_is_left_alone():
    time = STEP * np.arange(500)
    repaired, notes = clock.repair(time, "here")
    assert notes == []
    assert repaired.time_s is not None
    assert_array_equal(repaired.grid_s, time)
    assert repaired.step_s == pytest.approx(STEP)
    assert not repaired.absent.any()


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda t: np.insert(t, 100, t[100]), "row 102 .* doubled in time left out"),
        (lambda t: np.delete(t, slice(100, 130)), "30 samples missing in 1 gap, the first after row 100 "),
        (lambda t: np.where(np.arange(len(t)) == 100, np.nan, t), "row 101 .* without a time"),
        (lambda t: np.where(np.arange(len(t)) == 100, 1e6, t), "row 101 .* without a time"),
        (lambda t: t[np.r_[0:100, 101, 100, 102 : len(t)]], "2 rows, the first row 101 .*wrong order"),
    ],
)
def test_a_clock_is_repaired_and_said(damage, said):
    time = damage(STEP * np.arange(500))
    repaired, notes = clock.repair(time, "here")
    assert any(re.search(said, note) for note in notes), notes
    assert_allclose(np.diff(repaired.grid_s), STEP, rtol=1e-6)
    laid = repaired.lay(time)
    known = np.isfinite(laid)
    assert_allclose(laid[known], repaired.grid_s[known])


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda t: np.zeros_like(t), "stands still"),
        (lambda t: t[::-1], "runs backwards"),
        (lambda t: np.concatenate([t, t]), "row 501 .* runs backwards"),
        (lambda t: np.where(t > 2.0, t + 5.0, t), r"row 202 .* jumps from 2 s to 7.01 s"),
        (lambda t: np.round(t, 1), "stands still|repeats itself"),
        (lambda t: np.full_like(t, np.nan), "no row has a number for its time"),
    ],
)
def test_a_clock_beyond_repair_is_refused(damage, said):
    with pytest.raises(CampaignError, match=said):
        clock.repair(damage(STEP * np.arange(500)), "here")


def test_resampling_to_the_same_clock_is_exact():
    time = STEP * np.arange(500)
    assert_allclose(clock.resample(time, sines(time), time), sines(time), rtol=1e-12)


@pytest.mark.parametrize("source", [1e-4, 1e-3, 3e-3, 0.02, 0.05])
def test_slow_signals_pass_resampling_from_any_rate(source):
    time = np.arange(0.0, 5.0, source)
    targets = np.arange(0.013, 4.9, STEP)
    assert_allclose(clock.resample(time, sines(time), targets), sines(targets), atol=2e-3)


@given(st.integers(40, 900), st.integers(2, 12), st.integers(0, 20), st.integers(0, 2**31))
def test_resampling_is_the_same_from_an_even_clock_as_from_any(samples, every, first, seed):
    """Where the new clock takes every n-th time, a faster way is gone."""
    rng = np.random.default_rng(seed)
    time = 1e-3 * np.arange(samples)
    values = np.cumsum(rng.standard_normal(samples))
    beside = time + 1e-6 * rng.uniform(-1.0, 1.0, samples) * (time > 0) * (time < time[-1])  # uneven by a thousandth of a step
    assert_allclose(
        clock.resample(time, values, time[first::every]), clock.resample(beside, values, time[first::every]), atol=0.05
    )


def test_a_ramp_passes_to_its_very_ends():
    time = np.arange(0.0, 2.0, 1e-3)
    targets = np.arange(0.0, 1.99, STEP)
    assert_allclose(clock.resample(time, 5.0 - 2.0 * time, targets), 5.0 - 2.0 * targets, atol=1e-6)


@given(st.floats(52.0, 400.0), st.floats(0.0, 6.28))
def test_what_the_slower_clock_cannot_show_does_not_alias(frequency, phase):
    time = np.arange(0.0, 3.0, 1e-3)
    targets = np.arange(0.5, 2.5, STEP)  # Nyquist frequency 50 Hz
    assert np.abs(clock.resample(time, np.sin(2 * np.pi * frequency * time + phase), targets)).max() < 0.1
    assert np.abs(clock.resample(time, np.sin(2 * np.pi * (frequency + 10) * time + phase), targets)).max() < 0.01


def test_commands_are_held():
    held = clock.resample(np.array([0.0, 1.0, 2.0]), np.array([1.0, -1.0, 0.0]), np.array([0.0, 0.5, 1.0, 1.7, 2.0]), hold=True)
    assert_array_equal(held, [1.0, 1.0, -1.0, -1.0, 0.0])


@given(st.floats(1e-4, 10.0), st.integers(0, 2**31))
def test_noise_is_estimated_beside_any_smooth_course(noise, seed):
    rng = np.random.default_rng(seed)
    time = STEP * np.arange(5000)
    values = 40.0 - 1.5 * time + noise * rng.standard_normal(len(time))
    assert quality.describe(values).noise == pytest.approx(noise, rel=0.15)


def test_resolution_is_the_step_of_the_sensor():
    time = STEP * np.arange(1000)
    assert quality.describe(np.round(40.0 - 1.5 * time, 1)).resolution == pytest.approx(0.1)


def test_a_lost_sample_and_a_drop_out_are_bridged_and_marked():
    rng = np.random.default_rng(1)
    true = 80.0 - 4.0 * STEP * np.arange(500)
    values = true + 0.02 * rng.standard_normal(500)
    values[100] = np.nan
    values[200] = 900.0
    values[300:340] = 0.0
    repaired, bad, notes = quality.repair(values, "axle1_wheel_speed", even(), "here")
    assert_array_equal(np.flatnonzero(bad), np.r_[100, 200, 300:340])
    assert_allclose(repaired, true, atol=0.15)
    assert len(notes) == 2


@pytest.fixture(scope="module")
def vented():
    """Wheel speeds of a stop in which wheels slide and are vented, ten samples a second."""
    columns = stop(2e-4, 0.05, noise=1.0, seed=3)
    every = round(0.1 / (columns["time_s"][1] - columns["time_s"][0]))
    return np.column_stack([columns[f"axle{k + 1}_wheel_speed_radps"][::every] for k in range(AXLES)])


@given(st.integers(3, 60), st.sampled_from([-1.0, 1.0]), st.floats(8.0, 25.0), st.integers(0, AXLES - 1))
@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_coarsely_sampled_wheel_speed_is_freed_of_a_spike_and_stays_as_it_is_otherwise(vented, at, sign, height, axle):
    """At ten samples a second a wheel may change by more than such a spike in one step, but not up and down."""
    values = vented[:, axle].copy()
    assert not quality.repair(values, "axle1_wheel_speed", even(len(values), 0.1), "here")[1].any()
    values[at] += sign * height
    repaired, bad, notes = quality.repair(values, "axle1_wheel_speed", even(len(values), 0.1), "here")
    assert_array_equal(np.flatnonzero(bad), [at])
    assert "stand out of their neighbours" in notes[0]
    assert np.abs(repaired - vented[:, axle]).max() < 0.5 * height


def test_a_command_that_keeps_its_value_is_not_frozen():
    values = np.where(np.arange(900) < 600, np.where(np.arange(900) % 7 < 4, 1.0, -1.0), 1.0)
    marked = {}
    for name in ("axle1_valve_command", "axle1_cylinder_pressure"):
        _, bad, notes = quality.repair(np.where(values > 0.0, values, 0.0), name, even(900), "here")
        marked[name] = bool(bad.any() or notes)
    assert marked == {"axle1_valve_command": False, "axle1_cylinder_pressure": True}


def test_a_frozen_sensor_is_marked_and_a_locked_wheel_is_not():
    rng = np.random.default_rng(1)
    values = 80.0 - 10.0 * STEP * np.arange(900) + 0.05 * rng.standard_normal(900)
    values[200:300] = values[200]
    values[780:] = 0.0
    _, bad, notes = quality.repair(values, "axle1_wheel_speed", even(900), "here")
    assert_array_equal(np.flatnonzero(bad), np.arange(200, 300))
    assert any("saturated or frozen, from row 201" in note for note in notes)


def test_a_channel_that_jumps_and_stays_is_not_trusted():
    rng = np.random.default_rng(1)
    values = 80.0 - 10.0 * STEP * np.arange(500) + 0.05 * rng.standard_normal(500)
    values[200:] *= 0.5
    repaired, bad, notes = quality.repair(values, "axle1_wheel_speed", even(), "here")
    assert bad.all()
    assert_array_equal(repaired, values)
    assert "row 201" in notes[0]
    assert "not compared with the law" in notes[0]
    values = np.maximum(40.0 - 8.0 * STEP * np.arange(500), 0.0)
    values[values < 2.0] = 0.0  # a sensor that reads nothing at low speed
    assert not quality.repair(values, "vehicle_speed", even(), "here")[1].any()


@pytest.mark.parametrize("end", [700, 900])  # it comes back, or does not
def test_a_wheel_sensor_that_fails_at_speed_is_no_wheel_that_locks(end):
    """No wheel comes to a stand from 60 rad/s between two samples; at 5 rad/s a sensor may read nothing."""
    rng = np.random.default_rng(1)
    course = 80.0 - 10.0 * STEP * np.arange(900) + 0.05 * rng.standard_normal(900)
    failed = course.copy()
    failed[200:end] = 0.0
    _, bad, notes = quality.repair(failed, "axle1_wheel_speed", even(900), "here")
    assert bad.all()
    assert "in row 201" in notes[0]
    assert "stays there; kept, not compared with the law" in notes[0]
    locked = course.copy()
    locked[200:600] = np.minimum(course[200:600], np.maximum(60.0 * np.abs(2.0 - STEP * np.arange(400)) - 60.0, 0.0))
    locked[locked < 5.0] = 0.0
    assert not quality.repair(locked, "axle1_wheel_speed", even(900), "here")[1].any()


def test_too_long_a_gap_is_refused():
    values = np.linspace(80.0, 0.0, 500)
    values[100:250] = np.nan
    with pytest.raises(CampaignError, match=r"here, row 101 .*150 samples in a row"):
        quality.repair(values, "axle1_wheel_speed", even(), "here")
    with pytest.raises(CampaignError, match="no sample is a number"):
        quality.repair(np.full(500, np.nan), "axle1_wheel_speed", even(), "here")


# --- one stop, whole -------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def columns():
    return stop(2e-4, 0.06, duration_s=8.0, noise=1.0)


def scaled(columns, pattern, factor):
    return {name: values * factor if pattern in name else values for name, values in columns.items()}


@pytest.mark.parametrize(
    ("pattern", "factor", "said"),
    [
        ("vehicle_speed", 3.6, 'vehicle_speed is 3.6.* unit = "km/h"'),
        ("vehicle_speed", -1.0, "vehicle_speed is negative; give .* scale = -1"),
        ("vehicle_speed", 0.0, "dead channel"),
        ("axle2_wheel", 60.0 / (2 * np.pi), 'axle2_wheel_speed.* unit = "rpm"'),
        ("wheel", 0.0, "axle1_wheel_speed is 0 throughout: a dead channel"),
        ("speed", 3.6, "all speeds are in km/h"),
        ("torque", 1e-3, 'unit = "kN\\*m"'),
        ("torque", -1.0, "counted negative in braking; give .* scale = -1"),
        ("axle2_wheel", -1.0, "axle2_wheel_speed is negative; give .* scale = -1"),
        ("vehicle_speed", 1.0 / 3.6, "vehicle_speed is 0.278 times .* in m/s and taken for km/h"),
    ],
)
def test_channels_in_another_unit_are_refused(tmp_path, columns, pattern, factor, said):
    with pytest.raises(CampaignError, match=said):
        read_campaign(write_campaign(tmp_path, {"A1": scaled(columns, pattern, factor)}))


@pytest.mark.parametrize(
    ("entry", "wrong", "said"),
    [
        ("mass_kg", lambda mass: mass / 1000.0, "axles looks like tonnes; give it in kg"),
        ("wheel_radius_m", lambda radius: 2.0 * radius, "looks like the diameter; give wheel_radius_m = 0.4"),
    ],
)
def test_an_entry_of_the_vehicle_that_all_channels_contradict_is_named(tmp_path, columns, entry, wrong, said):
    file = write_campaign(tmp_path, {"A1": columns}) / "campaign.toml"
    text = file.read_text(encoding="utf-8")
    file.write_text(
        re.sub(rf"(?<=^{entry} = )[\d.]+", lambda found: str(wrong(float(found[0]))), text, flags=re.M), encoding="utf-8"
    )
    with pytest.raises(CampaignError, match=said):
        read_campaign(file.parent)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda c: scaled(c, "torque", 0.1), "slows .* times as much as its brakes explain"),
        (lambda c: scaled(c, "torque", 1e-6), "its brakes do not explain it"),
        (lambda c: scaled(c, "axle3_brake_torque", 0.0), "brake torque of axle 3 never changes"),
        (lambda c: scaled(c, "axle2_wheel", 0.0), "axle2_wheel_speed is 0 throughout: a dead channel; axle 2 is left out"),
        (lambda c: scaled(c, "axle1_wheel", 0.7), "axle 1 turns 0.7"),
    ],
)
def test_channels_that_contradict_each_other_are_warned_of(tmp_path, columns, change, said):
    with pytest.warns(CampaignWarning, match=said):
        read_campaign(write_campaign(tmp_path, {"A1": change(columns)}))


def test_swapped_axles_are_warned_of(tmp_path):
    """Under a WSP each wheel answers to its own brake: the demo campaign, two of whose wheel speeds are exchanged."""
    folder = shutil.copytree(demo_campaign(), tmp_path / "demo")
    for name in ("A1", "A3", "A5", "B1", "B2"):
        frame = pl.read_csv(folder / f"{name}.csv")
        one, two = "axle1_wheel_speed_radps", "axle2_wheel_speed_radps"
        frame.with_columns(pl.col(one).alias(two), pl.col(two).alias(one)).write_csv(folder / f"{name}.csv")
    with pytest.warns(CampaignWarning) as said:
        read_campaign(folder)
    assert said
    assert all(
        "torque of axle 1 with the wheel of axle 2, the torque of axle 2 with the wheel of axle 1" in str(w.message)
        for w in said
    )


@settings(max_examples=5)
@given(tau=st.floats(0.8e-4, 4e-4), peak=st.floats(0.05, 0.4), noise=st.floats(0.0, 3.0), seed=st.integers(0, 2**31))
def test_channels_as_they_should_be_are_not_warned_of(tmp_path_factory, tau, peak, noise, seed):
    columns = stop(tau, 0.06, peak=peak, noise=noise, seed=seed)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert read_campaign(write_campaign(tmp_path_factory.mktemp("right"), {"A1": columns})).runs["A1"].warnings == ()


def test_an_axle_with_a_dead_torque_is_never_compared_with_the_law(tmp_path, columns):
    with pytest.warns(CampaignWarning, match="axle 3 never changes.*not compared"):
        dead = tune(read_campaign(write_campaign(tmp_path / "dead", {"A1": scaled(columns, "axle3_brake_torque", 0.0)})))
    whole = tune(read_campaign(write_campaign(tmp_path / "whole", {"A1": columns})))
    assert dead.runs["A1"].error[2] is None
    assert dead.tau_m_per_J == pytest.approx(whole.tau_m_per_J, rel=0.02)


@pytest.mark.parametrize("absurd", [1e13, -1e200, 1e308])
@pytest.mark.parametrize("name", ["vehicle_speed_mps", "axle2_wheel_speed_radps", "axle4_brake_torque_nm"])
def test_absurd_numbers_are_bridged_or_refused(tmp_path, columns, name, absurd):
    """However many there are, so that nothing overflows."""
    for rows, said in ((slice(300, 330), "30 samples without a number or with one beyond"), (slice(300, None), "impossible")):
        wrong = {key: values.copy() for key, values in columns.items()}
        wrong[name][rows] = absurd
        folder = write_campaign(tmp_path / str(rows.stop), {"A1": wrong})
        if rows.stop:
            with pytest.warns(CampaignWarning, match=said):
                read_campaign(folder)
        else:
            with pytest.raises(CampaignError, match=said):
                read_campaign(folder)


def test_repaired_samples_are_never_compared_with_the_law(tmp_path, columns):
    wrong = {name: values.copy() for name, values in columns.items()}
    wrong["axle2_wheel_speed_radps"][400:480] = np.nan  # the bridge is far from the truth
    with pytest.warns(CampaignWarning, match="80 samples without a number"):
        damaged = tune(read_campaign(write_campaign(tmp_path / "damaged", {"A1": wrong})))
    whole = tune(read_campaign(write_campaign(tmp_path / "whole", {"A1": columns})))
    assert damaged.tau_m_per_J == pytest.approx(whole.tau_m_per_J, rel=0.02)
    assert max(damaged.runs["A1"].error) < 1.2 * max(whole.runs["A1"].error)


# --- fuzz: damaged files ---------------------------------------------------------------------------------------------


def outcome(folder):
    """The recording, or why there is none; anything but a CampaignError fails the test."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return read_campaign(folder).runs["A1"], ""
        except CampaignError as error:
            return None, str(error)


CELLS = st.sampled_from(["", "nan", "x", "1e999", "-", "--5", '"', "1.2.3", "\0", "#REF!", "9" * 400])


@st.composite
def damaged_text(draw, text):
    """The file with lines lost, doubled, cut, swapped, or cells that are none: what loggers and mail programs do."""
    lines = text.splitlines()
    for _ in range(draw(st.integers(1, 4))):
        kind = draw(st.sampled_from(["lose", "double", "cut", "swap", "cell", "drop cell", "add cell", "truncate", "junk"]))
        at = draw(st.integers(1, len(lines) - 2))
        cells = lines[at].split(",")
        column = draw(st.integers(0, len(cells) - 1))
        if kind == "lose":
            del lines[at : at + draw(st.integers(1, 40))]
        elif kind == "double":
            lines.insert(at, lines[at])
        elif kind == "cut":
            # not inside the last number: what is left of it is a number, and nothing tells that it was longer
            lines[at] = lines[at][: draw(st.integers(0, lines[at].rfind(",") if "," in lines[at] else 0))]
        elif kind == "swap":
            lines[at], lines[at + 1] = lines[at + 1], lines[at]
        elif kind == "cell":
            cells[column] = draw(CELLS)
            lines[at] = ",".join(cells)
        elif kind in ("drop cell", "add cell"):
            # once in a line: a cell put in and another one taken out is another number, and nothing tells that it was one
            if len(cells) == lines[0].count(",") + 1:
                lines[at] = ",".join(
                    [*cells[:column], *(["7", *cells[column:]] if kind == "add cell" else cells[column + 1 :])]
                )
        elif kind == "truncate":
            del lines[max(at, 300) :]
        else:
            lines.insert(at, draw(st.text(max_size=30)))
        if len(lines) < 10:
            break
    return "\n".join(lines)


@pytest.fixture(scope="module")
def original(tmp_path_factory, columns):
    folder = write_campaign(tmp_path_factory.mktemp("fuzz"), {"A1": columns})
    return folder, (folder / "A1.csv").read_text(), read_campaign(folder).runs["A1"]


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(st.data())
def test_a_damaged_file_gives_the_right_numbers_or_one_clear_error(original, data):
    folder, text, whole = original
    damaged = data.draw(damaged_text(text))
    assume(damaged != text)
    (folder / "A1.csv").write_text(damaged, encoding="utf-8", errors="replace", newline="")
    run, refused = outcome(folder)
    if run is None:
        assert "A1.csv" in refused
        return
    slot = np.rint((run.time_s - whole.time_s[0]) / STEP).astype(int)
    inside = (slot >= 0) & (slot < len(whole.time_s))
    assert inside.mean() > 0.9
    slot = slot[inside]
    assert_allclose(run.time_s[inside], whole.time_s[slot], atol=1e-6)
    good = ~run.suspect[inside]
    assert_allclose(
        np.where(good, run.wheel_speed_radps[inside], 0.0), np.where(good, whole.wheel_speed_radps[slot], 0.0), rtol=1e-9
    )
    assert_allclose(
        np.where(good, run.brake_torque_nm[inside], 0.0), np.where(good, whole.brake_torque_nm[slot], 0.0), rtol=1e-9
    )
    vehicle = good.any(axis=1)
    assert_allclose(run.vehicle_speed_mps[inside][vehicle], whole.vehicle_speed_mps[slot][vehicle], rtol=1e-9)
    if len(run.time_s) < len(whole.time_s) or not good.all():
        assert run.warnings or len(run.time_s) <= len(text.splitlines())


@pytest.mark.parametrize("suffix", [".parquet", ".mf4", ".mat", "_v73.mat"])
@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(st.data())
def test_damaged_binary_files_give_one_clear_error_or_a_recording(tmp_path_factory, columns, suffix, data):
    folder = tmp_path_factory.mktemp("binary")
    write_campaign(folder, {}, tune=["A1"])
    with (folder / "campaign.toml").open("a") as toml:
        toml.write(f'[runs.A1]\nfile = "A1{suffix}"\n')
    file = folder / f"A1{suffix}"
    content = bytearray(_binary(file, columns))
    for _ in range(data.draw(st.integers(1, 5))):
        at = data.draw(st.integers(0, len(content) - 1))
        content[at] ^= data.draw(st.integers(1, 255))
    if data.draw(st.booleans()):
        del content[data.draw(st.integers(0, len(content))) :]
    file.write_bytes(bytes(content))
    run, refused = outcome(folder)
    if run is None:
        assert file.name in refused
    else:
        assert run.wheel_speed_radps.shape == (len(run.time_s), AXLES)
        assert np.isfinite(run.wheel_speed_radps).all()


def test_an_mdf_file_whose_records_are_larger_than_itself_is_refused_at_once(tmp_path, columns):
    """By the count of invalidation bytes, which takes seconds and gigabytes to read."""
    write_campaign(tmp_path, {}, tune=["A1"])
    with (tmp_path / "campaign.toml").open("a") as toml:
        toml.write('[runs.A1]\nfile = "A1.mf4"\n')
    content = bytearray(_binary(tmp_path / "A1.mf4", columns))
    count = content.index(b"##CG") + 100  # ASAM MDF 4.1, block CG: header, six links, and five fields before it
    content[count : count + 4] = (3_355_443_200).to_bytes(4, "little")
    (tmp_path / "A1.mf4").write_bytes(bytes(content))
    run, refused = outcome(tmp_path)
    assert run is None
    assert "A1.mf4 is damaged or not an MDF4 file: it cannot hold a record of 3355443280 bytes" in refused


@pytest.mark.parametrize("function", ["read_parquet", "read_parquet_schema"])
def test_a_panic_of_the_parquet_reader_is_one_clear_error(tmp_path, columns, monkeypatch, function):
    """Polars panics at about one of a thousand damaged files, with what is no `Exception`."""
    write_campaign(tmp_path, {}, tune=["A1"])
    with (tmp_path / "campaign.toml").open("a") as toml:
        toml.write('[runs.A1]\nfile = "A1.parquet"\n')
    (tmp_path / "A1.parquet").write_bytes(_binary(tmp_path / "A1.parquet", columns))

    def panic(*_, **__):
        raise pl.exceptions.PanicException("Thrift out of range")

    monkeypatch.setattr(pl, function, panic)
    monkeypatch.setattr(readers, "NATIVE", ())  # in this process, where polars is the one that panics
    run, refused = outcome(tmp_path)
    assert run is None
    assert "A1.parquet" in refused
    assert "Thrift out of range" in refused


_CONTENTS: dict[str, bytes] = {}


def _binary(file, columns):
    from test_recordings_formats import save

    if file.name not in _CONTENTS:
        if file.suffix == ".mf4":
            import asammdf

            with asammdf.MDF(version="4.10") as mdf:
                time = columns["time_s"]
                mdf.append([asammdf.Signal(values, time, name=name) for name, values in columns.items() if name != "time_s"])
                mdf.save(file, overwrite=True)
        elif file.name.endswith("73.mat"):
            import h5py

            with h5py.File(file, "w", userblock_size=512) as content:
                for name, values in columns.items():
                    content[name] = values[None, :]
        elif file.suffix == ".mat":
            import scipy.io

            scipy.io.savemat(file, columns, do_compression=True)
        else:
            save(file, columns)
        _CONTENTS[file.name] = file.read_bytes()
    return _CONTENTS[file.name]
