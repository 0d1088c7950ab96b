"""Suspect channels: every kind of fault is found, sound channels and missing physics are not; starts and sensors unknown."""

import dataclasses
import itertools
import warnings
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest
from few_stops import small_demo
from synthetic_stops import AXLES, INERTIA_KGM2, MASS_KG, RADIUS_M, SAMPLE_S, stops, write_campaign

from wsp_env.cli import main
from wsp_env.diagnosis import diagnose
from wsp_env.diagnosis.data_first import data_first
from wsp_env.diagnosis.stops import prepare
from wsp_env.parameters.quantity import ParameterError
from wsp_env.recordings import CampaignError, CampaignWarning, demo_campaign, read_campaign, tune
from wsp_env.recordings.suspect import delays, factors, suspects
from wsp_env.recordings.suspect.delays import _delay, _late, _onset, _weighed, _Witnesses
from wsp_env.recordings.suspect.factors import level
from wsp_env.recordings.suspect.momentum import axle_gain
from wsp_env.recordings.suspect.own_balance import _peak
from wsp_env.recordings.suspect.search import Search

WHEEL, TORQUE = "wheel_speed_radps", "brake_torque_nm"
CREEP_PER_N = (
    1.0 / 5.5e6
)  # creepage of a wheelset by its force while rolling: some per mille at a brake's, as Kalker's theory has it


def rolling_stop(level, seed, duration_s=25.0, speed_mps=30.0, gains=(1.0,) * AXLES, inertia=INERTIA_KGM2):
    """Return a gentle stop: wheels roll with a creepage in proportion to their force, brakes fill within 0.3 s after 3 s."""
    time = SAMPLE_S * np.arange(int(duration_s / SAMPLE_S))
    rng = np.random.default_rng(seed)
    filled = np.where(time > 3.0, 1.0 - np.exp(-(time - 3.0) / 0.25), 0.0)
    torque = level * filled[:, None] * np.array(gains)
    force = torque / RADIUS_M  # the wheels' own inertia is a hundredth of it
    speed = speed_mps - np.cumsum(force.sum(axis=1)) * SAMPLE_S / (MASS_KG + AXLES * inertia / RADIUS_M**2)
    wheel = speed[:, None] * (1.0 - CREEP_PER_N * force) / RADIUS_M
    columns = {"time_s": time, "vehicle_speed_mps": speed + 0.01 * rng.standard_normal(len(time))}
    for k in range(AXLES):
        columns[f"axle{k + 1}_wheel_speed_radps"] = wheel[:, k] + 0.02 * rng.standard_normal(len(time))
        columns[f"axle{k + 1}_brake_torque_nm"] = torque[:, k] + 50.0 * rng.standard_normal(len(time))
    return columns


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Three stops that slide and two that roll."""
    slides = stops(2e-4, [0.055, 0.06, 0.065], duration_s=10.0, noise=1.0, seeds=(1, 2, 3))
    runs = {f"S{i + 1}": one for i, one in enumerate(slides)}
    runs |= {"R1": rolling_stop(2500.0, 4), "R2": rolling_stop(3500.0, 5)}
    return write_campaign(tmp_path_factory.mktemp("sound"), runs)


@pytest.fixture(scope="module")
def sound(folder):
    return read_campaign(folder)


def changed(campaign, change, runs=None):
    """Return a campaign with `change` done to some of its runs, all unless said otherwise."""
    chosen = runs or list(campaign.runs)
    return dataclasses.replace(campaign, runs={n: change(run) if n in chosen else run for n, run in campaign.runs.items()})


def test_a_wheel_that_slides_and_is_vented_says_nothing_of_its_torque_s_channel(tmp_path):
    """One wheel slides under a third of its torque while the others roll; where all roll its torque is the others'."""
    runs = {f"R{i}": rolling_stop(3500.0, i) for i in range(3)}
    slides = np.interp(runs["R1"]["time_s"], (6.0, 7.0, 19.0, 20.0), (0.0, 1.0, 1.0, 0.0))
    runs["R1"]["axle3_wheel_speed_radps"] *= 1.0 - 0.15 * slides
    runs["R1"]["axle3_brake_torque_nm"] *= 1.0 - 0.65 * slides
    search = Search(read_campaign(write_campaign(tmp_path, runs)))
    ratio = level(search.traces()["R1"], 2, list(range(AXLES)))[0]
    assert np.isnan(ratio) or ratio == pytest.approx(1.0, abs=0.1)


def scaled(field, axle, factor):
    def change(run):
        values = getattr(run, field).copy()
        values[:, axle] *= factor
        return dataclasses.replace(run, **{field: values})

    return change


def shifted(field, axle, seconds):
    def change(run):
        values = getattr(run, field).copy()
        values[:, axle] = np.interp(run.time_s - seconds, run.time_s, values[:, axle])
        return dataclasses.replace(run, **{field: values})

    return change


def offset(axle, size):
    def change(run):
        torque = run.brake_torque_nm.copy()
        torque[:, axle] += size
        return dataclasses.replace(run, brake_torque_nm=torque)

    return change


def exchanged(field, order):
    return lambda run: dataclasses.replace(run, **{field: getattr(run, field)[:, order]})


def vehicle(factor):
    return lambda run: dataclasses.replace(run, vehicle_speed_mps=factor * run.vehicle_speed_mps)


EVERY = slice(None)
FAULTS = {
    "kN m": (scaled(TORQUE, 1, 1e-3), "axle2_brake_torque", "factor", 1e-3),
    "kgf m": (scaled(TORQUE, 0, 0.1019716), "axle1_brake_torque", "factor", 0.102),
    "lbf ft": (scaled(TORQUE, 3, 0.7375621), "axle4_brake_torque", "factor", 0.7376),
    "all in lbf ft": (scaled(TORQUE, EVERY, 0.7375621), "axle*_brake_torque", "factor", 0.7376),
    "halved": (scaled(TORQUE, 2, 0.5), "axle3_brake_torque", "factor", 0.5),
    "rpm": (scaled(WHEEL, 1, 60.0 / (2.0 * np.pi)), "axle2_wheel_speed", "unit", 9.549),
    "turns": (scaled(WHEEL, 3, 1.0 / (2.0 * np.pi)), "axle4_wheel_speed", "unit", 0.159),
    "circumference": (scaled(WHEEL, 1, RADIUS_M), "axle2_wheel_speed", "unit", RADIUS_M),
    "km/h": (vehicle(3.6), "vehicle_speed", "unit", 3.6),
    "mph": (vehicle(2.2369), "vehicle_speed", "unit", 2.2369),
    "knots": (vehicle(1.9438), "vehicle_speed", "unit", 1.9438),
    "copied wheel": (exchanged(WHEEL, [0, 1, 1, 3]), "axle3_wheel_speed", "copy", 2.0),
    "copied torque": (exchanged(TORQUE, [0, 1, 2, 0]), "axle4_brake_torque", "copy", 1.0),
    "swapped": (exchanged(WHEEL, [2, 1, 0, 3]), "axle1_wheel_speed", "swap", 3.0),
    "offset": (offset(1, 700.0), "axle2_brake_torque", "offset", 700.0),
    "negative offset": (offset(3, -2500.0), "axle4_brake_torque", "offset", -2500.0),
    "late wheel": (shifted(WHEEL, 2, 0.08), "axle3_wheel_speed", "delay", 0.08),
    "late torque": (shifted(TORQUE, 0, 0.1), "axle1_brake_torque", "delay", 0.1),
    "very late torque": (shifted(TORQUE, 1, 0.8), "axle2_brake_torque", "delay", 0.8),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_every_fault_is_found_and_said_once(sound, fault):
    change, channel, kind, value = FAULTS[fault]
    (found,) = suspects(changed(sound, change))
    assert (found.channel, found.kind) == (channel, kind)
    # Slow contact forces move a lag by a few hundredths of a second here.
    assert found.value == pytest.approx(value, rel=0.15, abs=0.06 if kind == "delay" else 0.0)
    assert found.suspicion
    assert found.remedy


@pytest.mark.parametrize("fault", ["kN m", "rpm", "km/h", "offset", "copied wheel", "halved"])
def test_a_fault_in_one_run_is_said_of_that_run(sound, fault):
    change, channel, kind, _ = FAULTS[fault]
    (found,) = suspects(changed(sound, change, ["R2"]))
    assert (found.channel, found.kind, found.runs) == (channel, kind, ("R2",))
    assert "in run R2" in found.suspicion


def test_sound_recordings_are_not_suspected(sound):
    assert suspects(sound) == ()
    assert suspects(read_campaign(demo_campaign())) == ()


@pytest.fixture(scope="module")
def gentle(tmp_path_factory):
    """Two stops whose wheels slide little and slowly: their own balances say nothing of their torques."""
    runs = stops(2e-4, [0.055, 0.06], 30.0, 10.0, peak=0.12, noise=1.0, seeds=(1, 2), uneven=0.02)
    return read_campaign(write_campaign(tmp_path_factory.mktemp("gentle"), {f"G{i}": one for i, one in enumerate(runs)}))


@pytest.mark.parametrize("factor", [1.0, 0.7376, 0.5, 1.3558])
def test_the_vehicles_momentum_says_what_one_torque_truly_was(gentle, factor):
    campaign = changed(gentle, scaled(TORQUE, 1, factor))
    for run in campaign.runs.values():
        gain, deviation = axle_gain(run, campaign.vehicle, 1)
        assert deviation < 0.15 / factor
        assert abs(gain - 1.0 / factor) < 4.0 * deviation


@pytest.mark.parametrize("factor", [0.7376, 0.5])
def test_a_unit_near_one_on_one_axle_is_found_by_what_the_vehicle_loses(gentle, factor):
    assert suspects(gentle) == ()
    (found,) = suspects(changed(gentle, scaled(TORQUE, 1, factor)))
    assert (found.channel, found.kind) == ("axle2_brake_torque", "factor")
    assert found.value == pytest.approx(factor, rel=0.1)


@pytest.mark.parametrize(
    ("slopes", "only", "agree"),
    [([], "", True), ([], "A", False), ([0.74], "A", True), ([1.0], "A", False), ([1.0], "", False)],
)
def test_one_run_is_in_another_unit_only_if_its_own_wheels_say_so(slopes, only, agree):
    """A dragging brake in a gentle run takes as much momentum as torques in lbf ft would leave; a campaign has many runs."""
    search = SimpleNamespace(own_balances=lambda: {"A": [None, *(SimpleNamespace(slope=one) for one in slopes)], "B": [None]})
    assert factors._slopes_agree(search, 0.7376, only) == agree


@pytest.mark.parametrize(("said", "found"), [(1, 0), (2, 0), (3, 1)])
def test_a_factor_that_most_runs_with_the_same_level_do_not_show_is_none(sound, monkeypatch, said, found):
    """Four runs in which a torque is 0.7 of the others': the channel is wrong only if most of them say so."""
    names = list(sound.runs)[:4]
    campaign = dataclasses.replace(
        changed(sound, scaled(TORQUE, 1, 0.7)), runs={n: changed(sound, scaled(TORQUE, 1, 0.7)).runs[n] for n in names}
    )
    told = names[:said]
    monkeypatch.setattr(factors, "_factor", lambda search, name, axle: 0.7 if axle == 1 and name in told else np.nan)
    search = Search(campaign)
    factors._single_axles(search)
    assert len(search.found) == found


@pytest.mark.parametrize(
    "gains", [(1.15, 1.0, 1.0, 1.0), (1.0, 1.0, 0.86, 1.0), (1.1, 0.9, 1.1, 0.9)], ids=["strong", "weak", "uneven"]
)
def test_brakes_that_differ_are_physics(tmp_path, gains):
    runs = {f"R{i}": rolling_stop(2500.0 + 500.0 * i, i, gains=gains) for i in range(3)}
    assert suspects(read_campaign(write_campaign(tmp_path, runs))) == ()


def test_an_axle_that_brakes_half_and_is_measured_so_is_physics(tmp_path):
    """Its wheel's creepage is half, too: nothing contradicts the channel."""
    runs = {f"R{i}": rolling_stop(2500.0 + 500.0 * i, i, gains=(1.0, 0.5, 1.0, 1.0)) for i in range(3)}
    assert suspects(read_campaign(write_campaign(tmp_path, runs))) == ()


@pytest.mark.parametrize(
    "change",
    [
        scaled(WHEEL, 1, 1.01),  # a worn wheel
        vehicle(1.01),
        lambda run: dataclasses.replace(run, mass_kg=1.2 * run.mass_kg),
        lambda run: dataclasses.replace(run, gradient=0.005),
    ],
    ids=["radius", "speed", "mass", "gradient"],
)
def test_what_physics_does_is_not_suspected(sound, change):
    assert suspects(changed(sound, change)) == ()


def test_a_diagnosis_stops_at_faulty_channels(sound):
    change, channel, *_ = FAULTS["halved"]
    found = diagnose(changed(sound, change))
    assert found.verdict == "data"
    assert found.mechanisms == ()
    assert found.discovered == ()
    assert found.fit.removed_validate is None
    assert channel in found.sentence
    assert found.next_test.startswith(found.suspect_channels[0].remedy)
    assert found.to_json()["suspect_channels"][0]["channel"] == channel
    assert data_first(sound).answer is None


def standing_on(frame, duration_s, rng):
    """Return a recording that goes on at standstill, the brakes applied."""
    last, time = frame[-1].to_dicts()[0], 0.01 * np.arange(1, round(duration_s / 0.01) + 1)
    fades = np.clip(1.0 - 1.1 * time / last["vehicle_speed_mps"], 0.0, None)
    more = {}
    for name, value in last.items():
        noise = 30.0 * rng.standard_normal(len(time))
        more[name] = value + (time if name == "time_s" else noise) if "speed" not in name else value * fades
    return pl.concat([frame, pl.DataFrame(more).select(frame.columns)])


def test_a_logger_that_runs_on_at_standstill_is_not_suspected(tmp_path):
    """The brakes hold a vehicle that stands, and slow nothing."""
    folder, rng = small_demo(tmp_path / "demo"), np.random.default_rng(3)
    for file in folder.glob("*.csv"):
        standing_on(pl.read_csv(file), 30.0, rng).write_csv(file)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        campaign = read_campaign(folder)
    assert suspects(campaign) == ()
    assert all(run.time_s[-1] > 40.0 for run in campaign.runs.values())


def test_the_commands_tell_suspect_channels(tmp_path, capsys):
    columns = stops(2e-4, [0.06], duration_s=8.0, noise=1.0, seeds=(1,))[0]
    columns |= {"axle2_brake_torque_nm": columns["axle2_brake_torque_nm"] / 1e3}
    folder = write_campaign(tmp_path / "campaign", {"A1": columns})
    assert main(["diagnose", str(folder), "--out", str(tmp_path / "out")]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "data: The recordings contradict themselves" in printed
    assert "channel: axle2_brake_torque" in printed
    assert '"verdict": "data"' in (tmp_path / "out" / "diagnosis.json").read_text()
    assert main(["tune", str(folder)]) == 0
    assert "warning: suspect channel axle2_brake_torque" in capsys.readouterr().err
    assert main(["inspect", str(folder / "A1.csv")]) == 0
    assert "suspect channel axle2_brake_torque" in capsys.readouterr().err
    (folder / "campaign.toml").rename(folder / "kept.toml")
    assert main(["inspect", str(folder), "--vehicle", "coach"]) == 0
    assert "suspect channel axle2_brake_torque" in capsys.readouterr().err
    assert "Suspect: axle2_brake_torque" in (folder / "signals.html").read_text()


# --- places that nobody knows ----------------------------------------------------------------------------------------


def without_starts(folder, to, line=""):
    to.mkdir()
    for file in (file for file in folder.iterdir() if file.suffix in (".csv", ".toml")):
        text = file.read_text()
        if file.suffix == ".toml":
            text = "\n".join(line if row.startswith("start_position_m") else row for row in text.splitlines())
        (to / file.name).write_text(text)
    return read_campaign(to)


@pytest.mark.parametrize("line", ["", "start_position_m = 0.0", "start_position_m = 120.0"])
def test_runs_whose_start_nobody_knows_share_no_place(folder, tmp_path, line):
    campaign = without_starts(folder, tmp_path / "copy", line)
    assert not any(run.start_is_known for run in campaign.runs.values())
    prepared, notes = prepare(campaign)
    ends = [(stop.place.min(), stop.place.max()) for stop in prepared]
    for (_, end), (start, _) in itertools.pairwise(ends):
        assert start > end + 20.0
    assert any("start positions" in note and "not known" in note for note in notes)


def test_starts_that_are_known_stay(sound):
    assert all(run.start_is_known for run in sound.runs.values())
    assert [run.start_position_m for run in sound.runs.values()] == [1000.0 * k for k in range(len(sound.runs))]
    assert not any("start positions" in note for note in prepare(sound)[1])


def test_a_run_alone_may_begin_anywhere(tmp_path):
    columns = stops(2e-4, [0.06], duration_s=8.0, noise=1.0, seeds=(1,))[0]
    (run,) = read_campaign(write_campaign(tmp_path, {"A1": columns})).runs.values()
    assert run.start_is_known
    assert run.start_position_m == 0.0


@pytest.mark.slow
@pytest.mark.long
def test_a_worn_wheel_is_named_alone_where_nobody_knows_the_starts(tmp_path):
    demo = without_starts(small_demo(tmp_path / "demo"), tmp_path / "copy")
    found = diagnose(changed(demo, scaled(WHEEL, 1, 1.008)))
    assert found.verdict == "named"
    assert [one.name for one in found.mechanisms] == ["wheel_radius"]
    assert any("start positions" in note for note in found.notes)
    assert found.residuals["cells"]
    assert found.residuals["places"] == []  # what is made up is not drawn


# --- axles without sensors -------------------------------------------------------------------------------------------


def without_axle(folder, to, entry, drop=True):
    """Copy a campaign; `entry` goes below [vehicle], columns of axle 3 are dropped."""
    import polars as pl

    to.mkdir()
    for file in folder.iterdir():
        if file.suffix == ".csv":
            frame = pl.read_csv(file)
            (frame.drop([c for c in frame.columns if c.startswith("axle3") and drop])).write_csv(to / file.name)
        else:
            (to / file.name).write_text(file.read_text().replace("[vehicle]", f"[vehicle]\n{entry}"))
    return to


def test_an_axle_without_sensors_is_left_out_and_the_rest_stays(folder, sound, tmp_path):
    campaign = read_campaign(without_axle(folder, tmp_path / "copy", "missing_axles = [3]"))
    whole = sound.runs["S1"]
    run = campaign.runs["S1"]
    assert run.missing_axles == (3,)
    assert run.suspect[:, 2].all()
    np.testing.assert_allclose(run.wheel_speed_radps[:, 2], whole.wheel_speed_radps[:, [0, 1, 3]].mean(axis=1))
    np.testing.assert_allclose(run.brake_torque_nm[:, 2], whole.brake_torque_nm[:, [0, 1, 3]].mean(axis=1))
    assert suspects(campaign) == ()
    assert tune(campaign).tau_m_per_J == pytest.approx(2e-4, rel=0.05)
    prepared, notes = prepare(campaign)
    assert not prepared[0].usable[:, 2].any()
    assert prepared[0].usable[:, 0].any()
    assert (prepared[0].segment >= 0).any()  # the vehicle's balance is still there
    assert any("axle 3 of run" in note and "believed torque" in note for note in notes)


def test_its_own_torque_is_used_where_it_is_recorded(folder, sound, tmp_path):
    campaign = read_campaign(without_axle(folder, tmp_path / "copy", "missing_axles = [3]", drop=False))
    np.testing.assert_allclose(campaign.runs["S1"].brake_torque_nm, sound.runs["S1"].brake_torque_nm)


def test_missing_columns_are_still_refused_where_nobody_says_so(folder, tmp_path):
    with pytest.raises(CampaignError, match="axles 1, 2, 4"):
        read_campaign(without_axle(folder, tmp_path / "copy", ""))


@pytest.mark.parametrize("entry", ["missing_axles = [5]", "missing_axles = [1, 2, 3, 4]", "missing_axles = 3"])
def test_impossible_missing_axles_are_refused(folder, tmp_path, entry):
    with pytest.raises((CampaignError, ParameterError), match="missing_axles"):
        read_campaign(without_axle(folder, tmp_path / "copy", entry))


@pytest.mark.parametrize("fault", ["zero", "constant", "stuck"])
def test_a_dead_wheel_is_found_left_out_and_proposed(tmp_path, capsys, fault):
    columns = stops(2e-4, [0.06], duration_s=8.0, noise=1.0, seeds=(1,))[0]
    wheel = columns["axle3_wheel_speed_radps"].copy()
    wheel[{"zero": slice(None), "constant": slice(None), "stuck": slice(150, None)}[fault]] = {"zero": 0.0}.get(
        fault, wheel[150]
    )
    folder = write_campaign(tmp_path / "campaign", {"A1": columns | {"axle3_wheel_speed_radps": wheel}})
    with pytest.warns(CampaignWarning, match=r"axle3_wheel_speed .* dead channel; axle 3 is left out"):
        campaign = read_campaign(folder)
    assert campaign.runs["A1"].missing_axles == (3,)
    (found,) = suspects(campaign)
    assert (found.kind, found.channel) == ("dead", "axle3_wheel_speed")
    assert "missing_axles = [3]" in found.remedy
    assert data_first(campaign).answer is None  # the rest is diagnosed
    if fault != "stuck":
        assert main(["inspect", str(folder / "A1.csv")]) == 0
        printed = capsys.readouterr()
        assert "missing_axles = [3]" in printed.out
        assert "axle3_wheel_speed_radps" in printed.err


def test_a_locked_wheel_is_not_dead(tmp_path):
    columns = stops(2e-4, [0.06], duration_s=8.0, noise=1.0, seeds=(1,))[0]
    wheel = columns["axle3_wheel_speed_radps"].copy()
    wheel[200:] = 0.0
    folder = write_campaign(tmp_path, {"A1": columns | {"axle3_wheel_speed_radps": wheel}})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CampaignWarning)
        assert read_campaign(folder).runs["A1"].missing_axles == ()


def test_a_brake_that_fills_slowly_is_late_by_its_level_but_not_by_its_beginning():
    """A protection that meters what it lets into a cylinder fills one axle's more slowly; a late channel is late by both."""
    time = 0.01 * np.arange(400)
    filled = [np.clip(rate * (time - begin), 0.0, 1.0) for begin, rate in ((1.0, 4.0), (1.3, 4.0), (1.0, 0.5))]
    traces = SimpleNamespace(time=time, step=0.01, torque=8000.0 * np.column_stack(filled), good=np.ones(400, dtype=bool))
    first, late, slow = (np.array(_onset(traces, axle)) for axle in range(3))
    assert late - first == pytest.approx([0.3, 0.3], abs=1e-3)
    assert slow - first == pytest.approx([0.15 / 0.5 - 0.15 / 4.0, 0.0], abs=1e-3)


def test_errors_grow_by_what_runs_contradict_each_other():
    assert _weighed([(1.0, 0.1), (1.1, 0.1)])[2] == 1.0
    assert _weighed([(1.0, 0.1), (2.0, 0.1)]) == pytest.approx((1.5, 0.1 / np.sqrt(2.0), 10.0 / np.sqrt(2.0)))
    assert np.isnan(_weighed([(np.nan, np.inf)])[0])


@pytest.mark.parametrize(
    ("torques", "told"), [((0.0, 0.05, -0.05), True), ((-0.7, 0.6, -0.4), False), ((-0.7, -0.7, -0.7), False)]
)
def test_a_wheel_is_late_only_where_the_same_comparison_is_at_one(torques, told):
    """A brake that releases slowly looks like a late wheel, and like a torque that is late in one run and early in another.

    One that also keeps a torque looks like a torque that is further off than the wheel, in all runs.
    """
    runs = [{0: _Witnesses(np.nan, 0.0, -0.15, 0.04, torque, 0.1)} for torque in torques]
    assert _delay(runs, 0) == (("wheel_speed", pytest.approx(-0.15)) if told else None)


@pytest.mark.parametrize(("height", "expected"), [(0.91, 0.0), (0.99, 0.45), (0.3, 0.0)])
def test_a_peak_a_period_later_is_no_delay_unless_it_is_far_better(height, expected):
    """A WSP that repeats itself every 0.45 s: the peak at no lag is 0.9 high and leaves 0.19; one that leaves half is taken."""
    lags = np.arange(-120, 121)
    heights = {-45: 0.5, 0: 0.9, 45: height}
    correlation = sum(high * np.exp(-0.5 * ((lags - lag) / 5.0) ** 2) for lag, high in heights.items())
    assert 0.01 * lags[_peak(lags, correlation)] == pytest.approx(expected)


def test_a_correlation_without_a_peak_is_best_at_its_end():
    lags = np.arange(-5, 6)
    assert _peak(lags, np.linspace(0.1, 0.9, 11)) == 10


@pytest.mark.parametrize(("torque_late_s", "told"), [(0.4, True), (-1.2, True), (-10.2, False)])
def test_a_comparison_that_needs_a_delay_beyond_reason_says_nothing(monkeypatch, torque_late_s, told):
    """A wheel of a sound logger was told as 0.63 s early, by a fit that had its torque 10 s early, too."""
    solved = np.array([0.0, 0.0, -0.63, torque_late_s]), np.array([1e-5, 0.01, 0.01, 0.5])
    monkeypatch.setattr(delays, "rolled", lambda *_: SimpleNamespace(solved=lambda: solved))
    monkeypatch.setattr(delays, "_coarse_wheel", lambda *_: 0.0)
    assert (_late(SimpleNamespace(), 0) is not None) is told


@pytest.mark.parametrize(("usual_s", "told"), [(0.01, 1), (0.12, 0)])
def test_a_torque_of_one_run_is_late_only_beyond_what_the_other_runs_brakes_are(monkeypatch, usual_s, told):
    """One onset is 0.22 s late; those of the other runs scatter by `usual_s`."""
    rng, nan = np.random.default_rng(5), np.nan
    onsets = {name: usual_s * rng.choice([-1.0, 1.0], 4) for name in "ABCD"}
    onsets["D"][2] = 0.22
    found = []
    monkeypatch.setattr(
        delays, "_witnesses",
        lambda _, run: {k: _Witnesses(nan, onset, 0.0, 1.0, 0.0, 1.0) for k, onset in enumerate(onsets[run])},
    )  # fmt: skip
    monkeypatch.setattr(delays, "_tell", lambda *given: found.append(given[1:]))
    delays.find(SimpleNamespace(axles=4, traces=lambda: dict.fromkeys("ABCD")))
    assert found == [(["D"], 2, "brake_torque", 0.22)] * told
