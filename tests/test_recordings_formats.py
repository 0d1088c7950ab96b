"""The same stop in every format and in third-party units: the same numbers."""

import importlib.util
import sys

import numpy as np
import polars as pl
import pytest
from numpy.testing import assert_allclose
from synthetic_stops import AXLES, RADIUS_M, stop, write_campaign

from wsp_env.recordings import CampaignError, CampaignWarning, read_campaign, readers, reading, tune
from wsp_env.recordings.columns import read_columns

NM_PER_BAR = 2500.0

CHANNELS = """
[channels]
time = {column = "T_MS", unit = "ms"}
vehicle_speed = {column = "FS_SPEED_KPH", unit = "km/h"}
"""
for k in range(1, AXLES + 1):
    CHANNELS += f'axle{k}_wheel_speed = {{column = "W{k}_RPM", unit = "rpm"}}\n'
    CHANNELS += f'axle{k}_cylinder_pressure = {{column = "BCP_M_AXLE{k}_IN_MBAR", unit = "mbar"}}\n'


@pytest.fixture(scope="module")
def columns():
    return stop(2e-4, 0.06, duration_s=8.0, noise=1.0)


@pytest.fixture(scope="module")
def strange(columns):
    """The same recording with third-party names and units; pressures instead of torques."""
    table = {"T_MS": 1e3 * columns["time_s"], "FS_SPEED_KPH": 3.6 * columns["vehicle_speed_mps"]}
    for k in range(1, AXLES + 1):
        table[f"W{k}_RPM"] = columns[f"axle{k}_wheel_speed_radps"] * 60.0 / (2.0 * np.pi)
        table[f"BCP_M_AXLE{k}_IN_MBAR"] = 1e3 * columns[f"axle{k}_brake_torque_nm"] / NM_PER_BAR
    return table


def save(file, table):
    if file.suffix == ".csv":
        pl.DataFrame(table).write_csv(file)
    elif file.suffix == ".parquet":
        pl.DataFrame(table).write_parquet(file)
    elif file.suffix == ".mf4":
        import asammdf

        with asammdf.MDF(version="4.10") as mdf:
            time = table["T_MS"] / 1e3
            mdf.append([asammdf.Signal(values, time, name=name) for name, values in table.items() if name != "T_MS"])
            mdf.save(file, overwrite=True)
    elif file.stem.endswith("73"):
        import h5py

        with h5py.File(file, "w", userblock_size=512) as content:
            for name, values in table.items():
                content[f"test/{name}"] = values[None, :]
        with file.open("r+b") as stream:
            stream.write(b"MATLAB 7.3 MAT-file, Platform: test")
    else:
        import scipy.io

        scipy.io.savemat(file, {"test": table})


def campaign_of(folder, file_name, table, channels=CHANNELS):
    """A campaign of one run whose file has third-party columns."""
    folder.mkdir()
    save(folder / file_name, table)
    lines = write_campaign(folder, {}, tune=["A1"]).joinpath("campaign.toml").read_text()
    lines = lines.replace("wheel_radius_m", f"torque_per_bar_nm = {NM_PER_BAR}\nwheel_radius_m")
    if file_name.endswith(".mat"):
        channels = channels.replace('column = "', 'column = "test.')
    (folder / "campaign.toml").write_text(lines + channels + f'[runs.A1]\nfile = "{file_name}"\n')
    return folder


@pytest.mark.parametrize("file_name", ["A1.csv", "A1.parquet", "A1.mf4", "A1.mat", "A1_v73.mat"])
def test_every_format_gives_the_same_numbers(tmp_path, columns, strange, file_name):
    run = read_campaign(campaign_of(tmp_path / "strange", file_name, strange)).runs["A1"]
    assert run.warnings == ()
    assert_allclose(run.time_s, columns["time_s"], rtol=1e-9, atol=1e-9)
    assert_allclose(run.vehicle_speed_mps, columns["vehicle_speed_mps"], rtol=1e-9)
    for k in range(AXLES):
        assert_allclose(run.wheel_speed_radps[:, k], columns[f"axle{k + 1}_wheel_speed_radps"], rtol=1e-9)
        assert_allclose(run.brake_torque_nm[:, k], columns[f"axle{k + 1}_brake_torque_nm"], rtol=1e-9)


#: A reader as somebody would add it.
NPZ = '''"""NumPy archives."""

import numpy as np

from wsp_env.recordings.readers.channel_file import ChannelFile, Samples


class Npz(ChannelFile):
    def read(self, names):
        with np.load(self.file) as archive:
            return {name: Samples(archive[name]) for name in names}


def open_file(file):
    with np.load(file) as archive:
        return Npz(file, dict.fromkeys(archive.files, ""))
'''


def test_a_new_format_is_one_module_and_one_line(tmp_path, columns, monkeypatch):
    """The module stands beside the test, so that the package stays as it is."""
    name = f"{readers.__name__}.npz"
    (tmp_path / "npz.py").write_text(NPZ)
    spec = importlib.util.spec_from_file_location(name, tmp_path / "npz.py")
    monkeypatch.setitem(sys.modules, name, importlib.util.module_from_spec(spec))
    spec.loader.exec_module(sys.modules[name])
    monkeypatch.setitem(readers.FORMATS, (".npz",), "npz")  # the line
    folder = write_campaign(tmp_path / "campaign", {"A1": columns})
    np.savez(folder / "A1.npz", **columns)
    (folder / "campaign.toml").write_text((folder / "campaign.toml").read_text().replace("A1.csv", "A1.npz"))
    run = read_campaign(folder).runs["A1"]
    assert run.warnings == ()
    assert_allclose(run.brake_torque_nm[:, 3], columns["axle4_brake_torque_nm"])


def test_european_text_is_read(tmp_path, columns):
    folder = write_campaign(tmp_path, {"A1": columns})
    text = (folder / "A1.csv").read_text().replace(",", ";").replace(".", ",")
    (folder / "A1.csv").write_text("\n" + text.replace("\n", "\r\n"), encoding="utf-8-sig")
    run = read_campaign(folder).runs["A1"]
    assert_allclose(run.vehicle_speed_mps, columns["vehicle_speed_mps"], rtol=1e-12)


def rows_of(folder):
    return (folder / "A1.csv").read_text().splitlines()


@pytest.mark.parametrize("comments", [("", ""), ("", "brake released"), ("x,5", "")])
def test_a_column_of_comments_may_be_empty(tmp_path, columns, comments):
    """An empty last cell is no missing one."""
    folder = write_campaign(tmp_path, {"A1": columns})
    head, *lines = [line.replace(",", ";").replace(".", ",") for line in rows_of(folder)]
    lines = [f"{line};{comments[number == 300]}" for number, line in enumerate(lines)]
    (folder / "A1.csv").write_text("\n".join([f"{head};comment", *lines]))
    run = read_campaign(folder).runs["A1"]
    assert run.warnings == ()
    assert_allclose(run.vehicle_speed_mps, columns["vehicle_speed_mps"], rtol=1e-12)


def test_lines_may_end_in_separators(tmp_path, columns):
    for name, header_ends, ends in (("both", ",,", ",,"), ("rows", "", ",")):
        folder = write_campaign(tmp_path / name, {"A1": columns})
        head, *lines = rows_of(folder)
        (folder / "A1.csv").write_text("\n".join([head + header_ends, *(line + ends for line in lines)]))
        run = read_campaign(folder).runs["A1"]
        assert run.warnings == ()
        assert_allclose(run.vehicle_speed_mps, columns["vehicle_speed_mps"], rtol=1e-12)


@pytest.mark.parametrize("preamble", [["Prüfung 5; Ort: Köln", ""], ["5", "Fahrzeug;3"], ["Prüfung 5" + ";" * 9]])
def test_lines_before_the_names_and_a_line_of_units(tmp_path, columns, preamble):
    folder = write_campaign(tmp_path, {"A1": columns})
    head, *lines = [line.replace(",", ";").replace(".", ",") for line in rows_of(folder)]
    units = ["s", "m/s"] + ["rad/s", "Nm"] * AXLES
    lost = 200
    lines[lost] = ";".join(["x", *lines[lost].split(";")[1:]])
    text = "\r\n".join([*preamble, head, ";".join(units), *lines])
    (folder / "A1.csv").write_bytes(text.encode("cp1252"))
    with pytest.warns(CampaignWarning, match=rf"row {lost + 1} \(line {len(preamble) + 3 + lost} of a CSV\)"):
        run = read_campaign(folder).runs["A1"]
    kept = np.delete(np.arange(len(columns["time_s"])), lost)
    assert_allclose(run.vehicle_speed_mps[kept], columns["vehicle_speed_mps"][kept], rtol=1e-12)


def test_a_line_of_units_is_believed(tmp_path, columns):
    folder = write_campaign(tmp_path, {"A1": columns | {"vehicle_speed_mps": 3.6 * columns["vehicle_speed_mps"]}})
    head, *lines = rows_of(folder)
    units = ["(s)", "(km/h)"] + ["(rad/s)", "-"] * AXLES
    (folder / "A1.csv").write_text("\n".join([head.replace("vehicle_speed_mps", "v"), ",".join(units), *lines]))
    with (folder / "campaign.toml").open("a") as toml:
        toml.write('[channels]\nvehicle_speed = "v"\n')
    run = read_campaign(folder).runs["A1"]
    assert run.warnings == ()
    assert_allclose(run.vehicle_speed_mps, columns["vehicle_speed_mps"], rtol=1e-12)


def test_quoted_and_padded_numbers_are_read(tmp_path, columns):
    folder = write_campaign(tmp_path, {"A1": columns})
    head, *lines = (folder / "A1.csv").read_text().splitlines()
    lines = [", ".join(f'"{cell}" ' for cell in line.split(",")) for line in lines]
    (folder / "A1.csv").write_text("\n".join([head, *lines]))
    run = read_campaign(folder).runs["A1"]
    assert run.warnings == ()
    assert_allclose(run.brake_torque_nm[:, 3], columns["axle4_brake_torque_nm"])


def test_what_is_in_quotes_is_one_cell(tmp_path):
    """Commas in quotes are no separators, points in such numbers part thousands, and a short line counts for nothing."""
    (tmp_path / "a.csv").write_text('t,n,note\n"0,5","1.234,5","a, b"\n1,"1.234",\n"1,5","7"\n')
    found = readers.open_file(tmp_path / "a.csv").read(["t", "n"])
    assert_allclose(found["t"].values, [0.5, 1.0, np.nan])
    assert_allclose(found["n"].values, [1234.5, 1234.0, np.nan])
    (tmp_path / "b.csv").write_text('t,n\n"0,5","1,5"\n"1,0","1,6","2,5"\n')
    with pytest.raises(CampaignError, match="line 3 has 3 cells, the header 2"):
        readers.open_file(tmp_path / "b.csv").read(["t", "n"])


def test_units_stated_in_the_file_are_used(tmp_path, columns):
    table = columns | {"v [km/h]": 3.6 * columns["vehicle_speed_mps"]}
    del table["vehicle_speed_mps"]
    folder = write_campaign(tmp_path, {"A1": table})
    with (folder / "campaign.toml").open("a") as toml:
        toml.write('[channels]\nvehicle_speed = "v [km/h]"\n')
    assert_allclose(read_campaign(folder).runs["A1"].vehicle_speed_mps, columns["vehicle_speed_mps"], rtol=1e-12)


def test_turns_a_minute_are_what_channels_says(tmp_path, columns):
    table = columns | {"n2 [1/min]": columns["axle2_wheel_speed_radps"] * 60.0 / (2.0 * np.pi)}
    folder = write_campaign(tmp_path, {"A1": table})
    with (folder / "campaign.toml").open("a") as toml:
        toml.write('[channels]\naxle2_wheel_speed = {column = "n2 [1/min]", unit = "rpm"}\n')
    run = read_campaign(folder).runs["A1"]
    assert run.warnings == ()
    assert_allclose(run.wheel_speed_radps[:, 1], columns["axle2_wheel_speed_radps"], rtol=1e-12)


def test_wheel_speed_as_speed_of_the_circumference(tmp_path, columns):
    table = columns | {"wheel2": 3.6 * RADIUS_M * columns["axle2_wheel_speed_radps"]}
    folder = write_campaign(tmp_path, {"A1": table})
    with (folder / "campaign.toml").open("a") as toml:
        toml.write('[channels]\naxle2_wheel_speed = {column = "wheel2", unit = "km/h"}\n')
    assert_allclose(read_campaign(folder).runs["A1"].wheel_speed_radps[:, 1], columns["axle2_wheel_speed_radps"], rtol=1e-12)


@pytest.mark.parametrize(
    ("channels", "said"),
    [
        ('speed = "x"', "unknown channel speed"),
        ("vehicle_speed = 3", "must name a column"),
        ('vehicle_speed = {column = "x", unit = "bar"}', "'bar' is a unit of .*mass.*vehicle_speed is one of .*length"),
        ('vehicle_speed = {column = "x", unit = "furlongs per moon"}', "no unit known"),
        ('axle1_wheel_speed = {column = "x", unit = "1/min"}', "turns or radians"),
        ('axle1_wheel_speed = {column = "x", unit = "Hz"}', "turns or radians"),
        ('axle1_brake_torque = {column = "x", unit = "kN"}', r"N m\)"),
        ('vehicle_speed = {column = "x", units = "m/s"}', "unknown key units"),
        ('vehicle_speed = {column = "x", unit = "m/s", scale = 0}', "scale must be"),
        ('vehicle_speed = {column = "nowhere", unit = "m/s"}', "lacks the column nowhere"),
        ('vehicle_speed = {column = "vehicle_speed_mps"}', "neither the file nor .channels. says its unit"),
        ('axle9_wheel_speed = {column = "x", unit = "rpm"}', "unknown channel axle9_wheel_speed"),
    ],
)
def test_mappings_that_cannot_be_used(tmp_path, columns, channels, said):
    folder = write_campaign(tmp_path, {"A1": columns})
    with (folder / "campaign.toml").open("a") as toml:
        toml.write(f"[channels]\n{channels}\n")
    with pytest.raises(CampaignError, match=said):
        read_campaign(folder)


def test_a_file_that_contradicts_the_mapping_is_warned_of(tmp_path, columns):
    table = columns | {"v [m/s]": 3.6 * columns["vehicle_speed_mps"]}
    folder = write_campaign(tmp_path, {"A1": table})
    with (folder / "campaign.toml").open("a") as toml:
        toml.write('[channels]\nvehicle_speed = {column = "v [m/s]", unit = "km/h"}\n')
    with pytest.warns(CampaignWarning, match=r"states 'm/s', \[channels\] 'km/h'"):
        read_campaign(folder)


def test_channels_at_other_rates_come_to_one_clock(tmp_path, columns):
    """A logger with 1 kHz wheel speeds and torques and a 20 Hz vehicle speed, each on its own clock."""
    import asammdf

    fine = {name: np.interp(np.arange(0.0, 7.9, 1e-3), columns["time_s"], values) for name, values in columns.items()}
    slow = np.arange(0.02, 7.85, 0.05)
    folder = tmp_path / "rates"
    folder.mkdir()
    with asammdf.MDF(version="4.10") as mdf:
        names = [name for name in fine if name.startswith("axle")]
        mdf.append([asammdf.Signal(fine[name], fine["time_s"], name=name) for name in names])
        speed = np.interp(slow, columns["time_s"], columns["vehicle_speed_mps"])
        mdf.append([asammdf.Signal(speed, slow, name="vehicle_speed_mps")])
        mdf.save(folder / "A1.mf4")
    write_campaign(folder, {}, tune=["A1"])
    with (folder / "campaign.toml").open("a") as toml:
        toml.write('[runs.A1]\nfile = "A1.mf4"\n')
    with pytest.warns(CampaignWarning, match="recorded every"):
        campaign = read_campaign(folder)
    run = campaign.runs["A1"]
    assert_allclose(np.diff(run.time_s), 0.01, rtol=1e-6)
    assert run.time_s[0] == pytest.approx(0.02)
    assert tune(campaign).tau_m_per_J == pytest.approx(2e-4, rel=0.05)


@pytest.mark.parametrize("suffix", [".mat", ".parquet"])
@pytest.mark.parametrize("share", [0.01, 0.5, 0.99])
def test_a_file_whose_end_is_missing_is_refused_with_what_to_do(tmp_path, columns, suffix, share):
    import scipy.io

    file = tmp_path / f"A1{suffix}"
    if suffix == ".mat":
        scipy.io.savemat(file, columns)
    else:
        pl.DataFrame(columns).write_parquet(file)
    whole = file.read_bytes()
    file.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(CampaignError, match="export it again"):
        readers.open_file(file)


@pytest.mark.parametrize("suffix", [".mf4", ".mat", ".parquet", ".xyz", ".csv"])
@pytest.mark.parametrize("content", [b"", b"\x00" * 2000, b"MDF     4.10    " + b"\xff" * 3000, b"MATLAB 7.3" + b" " * 900])
def test_files_that_are_none(tmp_path, suffix, content):
    folder = write_campaign(tmp_path, {}, tune=["A1"])
    (folder / f"A1{suffix}").write_bytes(content)
    with (folder / "campaign.toml").open("a") as toml:
        toml.write(f'[runs.A1]\nfile = "A1{suffix}"\n')
    with pytest.raises(CampaignError, match=rf"A1\{suffix}"):
        read_campaign(folder)


@pytest.mark.parametrize("pressures", [True, False])
@pytest.mark.parametrize("torques", [True, False])
def test_torques_are_computed_only_where_a_file_has_none(tmp_path, columns, torques, pressures):
    """A vehicle may state its nominal gain, whatever was recorded: a torque that was measured is not replaced by it."""
    per_bar, off = 3000.0, 1.1  # the nominal gain, and that of the true brake over it
    kept = {name: values for name, values in columns.items() if torques or "torque" not in name}
    for k in range(1, AXLES + 1):
        if pressures:
            kept[f"axle{k}_cylinder_pressure_bar"] = columns[f"axle{k}_brake_torque_nm"] / (off * per_bar)
    folder = write_campaign(tmp_path / "both", {"A1": kept}, tune=["A1"])
    file = folder / "campaign.toml"
    file.write_text(file.read_text().replace("wheel_radius_m", f"torque_per_bar_nm = {per_bar}\nwheel_radius_m"))
    if not (torques or pressures):
        with pytest.raises(CampaignError, match="lacks the column axle1_cylinder_pressure_bar"):
            read_campaign(folder)
        return
    campaign = read_campaign(folder)
    run = campaign.runs["A1"]
    expected = columns["axle1_brake_torque_nm"] / (1.0 if torques else off)
    assert_allclose(run.brake_torque_nm[:, 0], expected, rtol=1e-9, atol=1e-6)
    assert campaign.vehicle.torque_is_measured == torques
    assert (run.cylinder_pressure_bar is not None) == pressures


def test_no_channel_of_a_missing_axle_is_asked_for_twice(tmp_path, columns, monkeypatch):
    kept = {name: values for name, values in columns.items() if "torque" not in name}
    for k in range(1, AXLES + 1):
        kept[f"axle{k}_cylinder_pressure_bar"] = columns[f"axle{k}_brake_torque_nm"] / NM_PER_BAR
    folder = write_campaign(tmp_path / "missing", {"A1": kept}, tune=["A1"])
    file = folder / "campaign.toml"
    more = f"torque_per_bar_nm = {NM_PER_BAR}\nmissing_axles = [2]\nwheel_radius_m"
    file.write_text(file.read_text().replace("wheel_radius_m", more))
    asked = []

    def noted(file, required, optional, *rest):
        asked.extend([*required, *optional])
        return read_columns(file, required, optional, *rest)

    monkeypatch.setattr(reading, "read_columns", noted)
    run = read_campaign(folder).runs["A1"]
    assert len(asked) == len(set(asked))
    assert_allclose(run.brake_torque_nm[:, 1], columns["axle2_brake_torque_nm"], rtol=1e-9, atol=1e-6)
