"""Files as loggers and people leave them, each to a tuned campaign in two commands: `wsp inspect FOLDER`, `wsp tune FOLDER`."""

import dataclasses
import json
import warnings

import numpy as np
import polars as pl
import pytest
from synthetic_stops import AXLES, GRAVITY, INERTIA_KGM2, MASS_KG, RADIUS_M, stop, write_campaign

from wsp_env.cli import main
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.parameters.vehicle_file import write_vehicle
from wsp_env.recordings import CampaignError, CampaignWarning, read_campaign
from wsp_env.recordings.readers import MOST_CHANNELS, open_file
from wsp_env.recordings.readers.text import seconds

TAU, NM_PER_BAR = 2e-4, 2500.0
EACH = range(1, AXLES + 1)


@pytest.fixture(scope="module")
def columns():
    return stop(TAU, 0.06, duration_s=12.0, noise=1.0)


@pytest.fixture(scope="module")
def vehicle(tmp_path_factory):
    brake = dataclasses.replace(COACH.brake, torque_per_bar_nm=NM_PER_BAR)
    values = {"mass_kg": MASS_KG, "wheelset_inertia_kgm2": INERTIA_KGM2, "wheel_radius_m": RADIUS_M, "gravity_mps2": GRAVITY}
    file = tmp_path_factory.mktemp("vehicle") / "mine.toml"
    file.write_text(write_vehicle(dataclasses.replace(COACH, brake=brake, **values)))
    return file


def text_of(table, separator=",", empty=""):
    rows = zip(*table.values(), strict=True)
    lines = [separator.join(empty if isinstance(one, float) and np.isnan(one) else str(one) for one in row) for row in rows]
    return "\n".join([separator.join(table), *lines]) + "\n"


def rounded(columns):
    return {name: np.round(values, 6).tolist() for name, values in columns.items()}


def missing_wheel(folder, columns):
    pl.DataFrame({name: values for name, values in columns.items() if name != "axle3_wheel_speed_radps"}).write_csv(
        folder / "a.csv"
    )


def dead_wheel(folder, columns):
    pl.DataFrame(columns | {"axle3_wheel_speed_radps": np.zeros(len(columns["time_s"]))}).write_csv(folder / "a.csv")


def each_at_its_rate(folder, columns):
    table = rounded(columns)
    for k in EACH:
        name = f"axle{k}_brake_torque_nm"
        table[name] = [value if row % 2 == k % 2 else float("nan") for row, value in enumerate(table[name])]
    (folder / "a.csv").write_text(text_of(table))


def matlab_structure(folder, columns):
    import scipy.io

    omega, torque = (
        np.stack([columns[f"axle{k}_{what}"] for k in EACH], axis=1) for what in ("wheel_speed_radps", "brake_torque_nm")
    )
    data = {"t": columns["time_s"], "v_train": columns["vehicle_speed_mps"], "omega": omega, "torque": torque}
    scipy.io.savemat(folder / "a.mat", {"data": data})


def wide_text(folder, columns):
    (folder / "a.txt").write_bytes(text_of(rounded(columns), "\t").encode("utf-16"))


def returns_only(folder, columns):
    (folder / "a.csv").write_bytes(text_of(rounded(columns)).replace("\n", "\r").encode())


def times_of_day(folder, columns):
    table = rounded(columns)
    of_day = [86396.0 + value for value in table.pop("time_s")]  # over midnight
    cells = [f"{int(t // 3600) % 24:02d}:{int(t // 60) % 60:02d}:{t % 60.0:06.3f}" for t in of_day]
    (folder / "a.csv").write_text(text_of({"Time": cells} | table))


def code_page_850(folder, columns):
    table = {"Zeit [s]": columns["time_s"], "Geschwindigkeit Prüfzug [km/h]": 3.6 * columns["vehicle_speed_mps"]}
    for k in EACH:
        table[f"Drehzahl Achse {k} für WSP [rad/s]"] = columns[f"axle{k}_wheel_speed_radps"]
        table[f"Moment Achse {k} für WSP [kNm]"] = 1e-3 * columns[f"axle{k}_brake_torque_nm"]
    text = text_of({name: np.round(values, 6).tolist() for name, values in table.items()}, ";").replace(".", ",")
    (folder / "a.csv").write_bytes(text.encode("cp850"))


def names_of_its_own(folder, columns):
    table = {"t": columns["time_s"], "V_ZUG_KMH": 3.6 * columns["vehicle_speed_mps"]}
    for k in EACH:
        table[f"V_AXLE_{k}"] = 3.6 * RADIUS_M * columns[f"axle{k}_wheel_speed_radps"]
        table[f"p_Zyl_{k}"] = columns[f"axle{k}_brake_torque_nm"] / NM_PER_BAR
    pl.DataFrame(table).write_csv(folder / "a.csv")


def sixty_channels(folder, columns):
    """Sound, but every channel on a clock of its own, none of them the campaign's."""
    import asammdf

    with asammdf.MDF(version="4.10") as mdf:
        for place, (name, values) in enumerate(columns.items()):
            if name != "time_s":
                time = np.arange(0.001 * place, 11.9, 0.008)
                mdf.append([asammdf.Signal(np.interp(time, columns["time_s"], values), time, name=name)])
        for k in range(50):
            mdf.append([asammdf.Signal(np.sin(np.arange(100.0)), 0.1 * np.arange(100.0), name=f"temperature {k}")])
        mdf.save(folder / "a.mf4")


def lines_ended_twice(folder, columns):
    """A CSV with an empty row between any two: https://github.com/danielhrisca/asammdf/issues/132."""
    (folder / "a.csv").write_text(text_of(rounded(columns)).replace("\n", "\n\n"))


def points_at_thousands(folder, columns):
    """Decimal commas, and points that part thousands: https://github.com/pandas-dev/pandas/issues/59299."""

    def german(value):
        return f"{value:,.4f}".translate(str.maketrans(",.", ".,"))

    (folder / "a.csv").write_text(text_of({name: list(map(german, values)) for name, values in columns.items()}, ";"))


def commas_in_quotes(folder, columns):
    """Commas between the cells and, in quotes, within them; lines on the test before."""
    table = {name: [f'"{value}"'.replace(".", ",") for value in values] for name, values in rounded(columns).items()}
    (folder / "a.csv").write_text("Messfahrt 1\n" + text_of(table))


def one_name_in_two_groups(folder, columns):
    """A signal recorded at two rates: https://github.com/danielhrisca/asammdf/issues/8."""
    import asammdf

    time = columns["time_s"]
    with asammdf.MDF(version="4.10") as mdf:
        mdf.append([asammdf.Signal(values, time, name=name) for name, values in columns.items() if name != "time_s"])
        mdf.append([asammdf.Signal(columns["axle1_brake_torque_nm"][::10], time[::10], name="axle1_brake_torque_nm")])
        mdf.save(folder / "a.mf4")


def union_of_clocks(folder, columns):
    """Channels of other rates on the union of their clocks, else no number: https://github.com/danielhrisca/asammdf/issues/1219."""
    slow = np.arange(0.0, 11.9, 0.014)
    time = np.union1d(np.round(columns["time_s"], 4), np.round(slow, 4))
    table = {"timestamps": time}
    for name, values in columns.items():
        if name != "time_s":
            own = np.round(columns["time_s"] if "wheel" in name else slow, 4)
            table[name] = np.where(np.isin(time, own), np.interp(time, columns["time_s"], values), np.nan)
    (folder / "a.csv").write_text(text_of({name: values.tolist() for name, values in table.items()}, empty="nan"))


def delimiters_at_the_end(folder, columns):
    """Every row of data, not the names, ends with a comma: https://github.com/pandas-dev/pandas/issues/14124."""
    names, *rows = text_of(rounded(columns)).splitlines()
    (folder / "a.csv").write_text("\n".join([names, *(f"{row}," for row in rows)]) + "\n")


def unit_of_the_time_alone(folder, columns):
    """A line of units in which only the time has one: https://github.com/ratal/mdfreader/issues/199."""
    names, *rows = text_of(rounded(columns)).splitlines()
    (folder / "a.csv").write_text("\n".join([names, "s" + "," * names.count(","), *rows]) + "\n")


def words_for_a_value(folder, columns):
    """Signals of a bus with a code for "not available", which is a text: https://github.com/danielhrisca/asammdf/issues/748."""
    import asammdf
    from asammdf.blocks.conversion_utils import from_dict

    with asammdf.MDF(version="4.10") as mdf:
        for name, values in columns.items():
            if "wheel" in name:
                coded = np.round(values / 0.005).astype("<u2")
                coded[300:305] = 65535
                told = from_dict({"val_0": 65535, "text_0": "SNA", "default_addr": {"a": 0.005, "b": 0.0}})
                mdf.append([asammdf.Signal(coded, columns["time_s"], name=name, conversion=told, unit="rad/s")])
            elif name != "time_s":
                mdf.append([asammdf.Signal(values, columns["time_s"], name=name)])
        mdf.save(folder / "a.mf4")


def lines_on_the_device(folder, columns):
    """Lines that begin with a hash before the names: https://github.com/ngscopeclient/scopehal/issues/408."""
    device = "#Digital recorder\n#Serial Number: SN:1, 2\n#Date Time: 2026-04-14 13:10:34.255\n\n"
    (folder / "a.csv").write_text(device + text_of(rounded(columns)))


ODD = [
    missing_wheel, dead_wheel, each_at_its_rate, matlab_structure, wide_text, returns_only, times_of_day, code_page_850,
    names_of_its_own, sixty_channels, lines_ended_twice, points_at_thousands, commas_in_quotes, one_name_in_two_groups,
    union_of_clocks, delimiters_at_the_end, unit_of_the_time_alone, words_for_a_value, lines_on_the_device,
]  # fmt: skip


@pytest.mark.parametrize("write", ODD, ids=lambda write: write.__name__)
def test_an_odd_file_becomes_a_tuned_campaign_in_two_commands(write, columns, vehicle, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("wsp_env.cli.inspect.pictured", lambda *_: None)  # has a test of its own
    write(tmp_path, columns)
    assert main(["inspect", str(tmp_path), "--vehicle", str(vehicle)]) == 0, capsys.readouterr().err
    drafted = (tmp_path / "campaign.toml").read_text()
    capsys.readouterr()
    assert main(["tune", str(tmp_path), "--json"]) == 0, capsys.readouterr().err + drafted
    told = capsys.readouterr()
    assert json.loads(told.out)["tau_m_per_J"] == pytest.approx(TAU, rel=0.1)
    assert len(told.err.splitlines()) <= 3, told.err
    if write in (missing_wheel, dead_wheel):
        assert "\nmissing_axles = [3]" in drafted


def run_of(columns, tmp_path, **changes):
    return write_campaign(tmp_path, {"A1": columns | changes})


@pytest.mark.parametrize(("factor", "said"), [(1e3, "every 10 s"), (1e6, "every 1e.04 s"), (1e-9, "every 1e-11 s")])
def test_time_in_another_unit_is_refused(columns, tmp_path, factor, said):
    with pytest.raises(CampaignError, match=rf"{said} says nothing of a slide; is the time in another unit"):
        read_campaign(run_of(columns, tmp_path, time_s=factor * columns["time_s"]))


def test_a_hundred_thousand_columns_are_refused_at_once(tmp_path):
    (tmp_path / "a.csv").write_text(",".join(f"c{k}" for k in range(10**5)) + "\n" + ",".join("1" * 10**5) + "\n")
    with pytest.raises(CampaignError, match=f"more than {MOST_CHANNELS}"):
        open_file(tmp_path / "a.csv")


def test_times_of_day():
    def of(*cells):
        return seconds(pl.Series(list(cells))).tolist()

    assert of("12:03:04.125", ' "12:03:05,5"') == [43384.125, 43385.5]
    assert of("23:59:59", "00:00:01", "00:00:02") == [86399.0, 86401.0, 86402.0]
    assert of("2026-01-31 23:59:59.5", "2026-02-01 00:00:00.5Z") == [86399.5, 86400.5]
    assert of("31.01.2026 23:59:59", "01.02.2026 00:00:00") == [86399.0, 86400.0]
    assert of("03:04.5") == [184.5]
    assert np.isnan(of("12:00:00", "x")[1])


def test_a_folder_is_split_fairly_and_told_of(columns, vehicle, tmp_path, capsys):
    folder = tmp_path / "stops"
    (folder / "more").mkdir(parents=True)
    for place, name in enumerate(("c", "a", "e", "b", "more/d", "more/a")):
        slide = 1.0 - 0.01 * place * np.clip(columns["time_s"] / 3.0 - 1.0, 0.0, 1.0)
        other = {key: values * slide if "wheel_speed" in key else values for key, values in columns.items()}
        other["Temperature [degC]"] = columns["time_s"]
        pl.DataFrame(other).write_csv(folder / f"{name}.csv")
    (folder / "notes.txt").write_text("x,y\n1,2\n")
    (folder / "broken.mat").write_bytes(b"MATLAB")
    assert main(["inspect", str(folder), "--vehicle", str(vehicle)]) == 0
    told = capsys.readouterr()
    assert "4 runs tune, 2 validate, 2 left out" in told.out
    assert "columns not used: Temperature [degC]" in told.out
    assert "broken.mat" in told.err
    assert "notes.txt" in told.err
    campaign = read_campaign(folder)
    assert len(campaign.runs) == 6
    assert "more/a" in campaign.runs
    assert set(campaign.validate) == {"a", "b"}  # the second and the fourth by sliding; that with the most tunes
    page = (folder / "signals.html").read_text()
    assert "wheel, axle 4" in page
    written = (folder / "campaign.toml").read_bytes()
    (folder / "signals.html").unlink()  # as if it had been killed between the two
    assert main(["inspect", str(folder), "--vehicle", str(vehicle)]) == 0
    assert "Kept as it is" in capsys.readouterr().out
    assert (folder / "campaign.toml").read_bytes() == written
    assert (folder / "signals.html").read_text() == page
    assert main(["inspect", str(folder), "--out", str(folder / "campaign.toml")]) == 2
    assert "exists already" in capsys.readouterr().err
    for other in (folder / "x.toml", folder):  # no command would read the first, and the second is full of recordings
        assert main(["inspect", str(folder), "--out", str(other)]) == 2
        assert f"is called campaign.toml; name {folder / 'campaign.toml'} with --out" in capsys.readouterr().err
    assert not (folder / "x.toml").exists()


def test_what_only_a_person_knows_is_asked_for_on_a_terminal(columns, tmp_path, monkeypatch, capsys):
    pl.DataFrame(columns).write_csv(tmp_path / "a.csv")
    answers = {"mass": ["heavy", str(MASS_KG)], "moment of inertia": ["-1", str(INERTIA_KGM2)], "radius": ["0,445"]}

    def answer(question):
        return next(given for word, given in answers.items() if word in question).pop(0)

    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr("builtins.input", answer)
    assert main(["inspect", str(tmp_path)]) == 0
    assert read_campaign(tmp_path).vehicle.wheel_radius_m == RADIUS_M


def test_what_stays_open_is_said(columns, tmp_path, capsys):
    pl.DataFrame(columns).write_csv(tmp_path / "a.csv")
    assert main(["inspect", str(tmp_path)]) == 0
    assert "Still open in it: mass_kg, wheelset_inertia_kgm2, wheel_radius_m" in capsys.readouterr().out


def test_a_folder_without_stops_is_refused(tmp_path, capsys):
    assert main(["inspect", str(tmp_path)]) == 2
    assert "holds no file of a known format" in capsys.readouterr().err
    assert main(["diagnose", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert "holds no file of a known format" in capsys.readouterr().err


def test_what_was_repaired_is_shaded(columns, tmp_path):
    from wsp_env.recordings.signals import write_signals

    wheel = columns["axle2_wheel_speed_radps"].copy()
    wheel[500:503] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CampaignWarning)
        campaign = read_campaign(run_of(columns, tmp_path, axle2_wheel_speed_radps=wheel))
    write_signals(tmp_path / "page.html", campaign)
    page = (tmp_path / "page.html").read_text()
    assert '"type":"rect"' in page.replace(" ", "")
    assert "without a number" in page
