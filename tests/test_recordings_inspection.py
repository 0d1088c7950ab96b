"""From a third-party file to a tuned law without writing code: inspect, edit the draft, tune."""

import tomllib

import numpy as np
import polars as pl
import pytest
from synthetic_stops import AXLES, INERTIA_KGM2, MASS_KG, RADIUS_M, stop

from wsp_env.cli import main
from wsp_env.recordings import CampaignError, guessing, inspection, read_campaign, tune
from wsp_env.recordings.folder import in_order
from wsp_env.recordings.readers import open_file

TAU, MU_CD, NM_PER_BAR = 2e-4, 0.06, 2000.0


@pytest.fixture(scope="module")
def third_party(tmp_path_factory):
    columns = stop(TAU, MU_CD, noise=1.0)
    table = {"Time [ms]": 1e3 * columns["time_s"], "FS_SPEED_KPH": 3.6 * columns["vehicle_speed_mps"]}
    for k in range(1, AXLES + 1):
        table[f"WHEEL{k}_SPEED_KPH"] = 3.6 * RADIUS_M * columns[f"axle{k}_wheel_speed_radps"]
        table[f"BCP_M_AXLE{k}_IN_BAR"] = columns[f"axle{k}_brake_torque_nm"] / NM_PER_BAR
    table["Ambient Temp [degC]"] = np.full_like(columns["time_s"], 12.0)
    file = tmp_path_factory.mktemp("third_party") / "stop 1.csv"
    pl.DataFrame(table).write_csv(file)
    return file


def test_channels_are_described(third_party):
    found = {channel.name: channel for channel in inspection.inspect(third_party)}
    assert set(found) == set(open_file(third_party).units)
    speed = found["FS_SPEED_KPH"]
    assert (speed.guess, speed.guessed_unit, speed.samples, speed.missing) == ("vehicle_speed", "km/h", 1200, 0)
    assert speed.rate_hz == pytest.approx(100.0)
    assert speed.quality.noise == pytest.approx(3.6 * 0.01, rel=0.2)
    assert found["BCP_M_AXLE3_IN_BAR"].guess == "axle3_cylinder_pressure"
    assert found["WHEEL2_SPEED_KPH"].guess == "axle2_wheel_speed"
    assert found["Time [ms]"].guess == "time"
    assert found["Ambient Temp [degC]"].guess == ""


@pytest.mark.parametrize(
    ("column", "unit", "channel"),
    [
        ("axle3_brake_torque_nm", "", "axle3_brake_torque"),
        ("vehicle_speed_mps", "", "vehicle_speed"),
        ("Wheelset 2 speed", "rpm", "axle2_wheel_speed"),
        ("TorqueAxle4", "kNm", "axle4_brake_torque"),
        ("Drehzahl_Achse1", "1/min", "axle1_wheel_speed"),  # drafted in rpm, for a person to confirm
        ("Drehzahl_Achse1", "rpm", "axle1_wheel_speed"),
        ("TrainSpeed", "km/h", "vehicle_speed"),
        ("t", "s", "time"),
        ("Axle1 pressure", "degC", ""),
        ("comment", "", ""),
    ],
)
def test_names_and_units_are_understood(column, unit, channel):
    assert guessing.named(column, unit) == channel


def test_units_and_numbers_speak_where_names_do_not(tmp_path):
    table = {"t [s]": [0.0, 0.01, 0.02], "V_Zug [km/h]": [9.0, 8.0, 7.0], "p0 [bar]": [5.0, 5.0, 5.0]}
    for k in (1, 2):
        table |= {f"n_{k} [1/min]": [9.0, 8.0, 7.0], f"p_C{k} [bar]": [0.0, 1.0, 2.0], f"T{k} [degC]": [7.0, 7.0, 7.0]}
    pl.DataFrame(table).write_csv(tmp_path / "1.csv")
    found = guessing.guess(open_file(tmp_path / "1.csv"), dict.fromkeys(table, 9.0))
    assert {name: (source.column, source.unit) for name, source in found.items()} == {
        "time": ("t [s]", "s"),
        "vehicle_speed": ("V_Zug [km/h]", "km/h"),
        "axle1_wheel_speed": ("n_1 [1/min]", "rpm"),
        "axle1_cylinder_pressure": ("p_C1 [bar]", "bar"),
        "axle2_wheel_speed": ("n_2 [1/min]", "rpm"),
        "axle2_cylinder_pressure": ("p_C2 [bar]", "bar"),
    }


def test_files_of_the_same_columns_are_runs_of_the_draft(third_party, tmp_path):
    for name in ("b.csv", "a.csv"):
        (tmp_path / name).write_bytes(third_party.read_bytes())
    (tmp_path / "other.csv").write_text("x,y\n1,2\n")
    (tmp_path / "empty.csv").write_text("")
    drafted = tomllib.loads(inspection.draft(tmp_path / "b.csv", inspection.inspect(tmp_path / "b.csv")))
    assert drafted["campaign"]["tune"] == list(drafted["runs"]) == ["a", "b"]
    assert drafted["vehicle"]["brake_torque_source"] == "cylinder pressure times the nominal gain"


def test_a_draft_asks_for_what_only_a_person_knows(third_party, tmp_path, capsys):
    out = tmp_path / "campaign.toml"
    assert main(["inspect", str(third_party), "--out", str(out)]) == 0
    assert "FS_SPEED_KPH" in capsys.readouterr().out
    drafted = tomllib.loads(out.read_text(encoding="utf-8"))
    assert "mass_kg" not in drafted["vehicle"]
    assert drafted["channels"]["axle4_cylinder_pressure"] == {"column": "BCP_M_AXLE4_IN_BAR", "unit": "bar"}
    assert main(["inspect", str(third_party), "--out", str(out)]) == 2
    assert "exists already" in capsys.readouterr().err


def test_from_a_third_party_file_to_a_tuned_law(third_party, tmp_path):
    folder = tmp_path / "campaign"
    folder.mkdir()
    (folder / third_party.name).write_bytes(third_party.read_bytes())
    assert main(["inspect", str(folder / third_party.name), "--out", str(folder / "campaign.toml")]) == 0
    with pytest.raises(CampaignError, match="lacks mass_kg, wheelset_inertia_kgm2, wheel_radius_m"):
        read_campaign(folder)
    text = (folder / "campaign.toml").read_text()
    known = {
        "mass_kg": MASS_KG,
        "wheelset_inertia_kgm2": INERTIA_KGM2,
        "wheel_radius_m": RADIUS_M,
        "torque_per_bar_nm": NM_PER_BAR,
    }
    for name, value in known.items():
        assert f"# {name} = ..." in text
        text = text.replace(f"# {name} = ...", f"{name} = {value} #")
    (folder / "campaign.toml").write_text(text)
    tuning = tune(read_campaign(folder))
    assert tuning.tau_m_per_J == pytest.approx(TAU, rel=0.03)
    assert tuning.runs["stop 1"].mu_cd == pytest.approx(MU_CD, rel=0.05)


def test_files_that_cannot_be_inspected(tmp_path, capsys):
    (tmp_path / "nothing.csv").write_text("")
    assert main(["inspect", str(tmp_path / "nothing.csv")]) == 2
    assert main(["inspect", str(tmp_path / "nowhere.mf4")]) == 2
    printed = capsys.readouterr().err
    assert "nothing.csv is empty" in printed
    assert "nowhere.mf4 cannot be opened" in printed


def test_runs_of_a_folder_stand_in_the_order_of_their_numbers(tmp_path):
    """Mechanisms may count the stops that came before on the same rail."""
    places = [tmp_path / name for name in ("B1.csv", "a10.csv", "a9.csv", "a2.csv", "early/z.csv", "a2b.csv", "A11.csv")]
    names = [str(path.relative_to(tmp_path)) for path in in_order(places)]
    assert names == ["a2.csv", "a2b.csv", "a9.csv", "a10.csv", "A11.csv", "B1.csv", "early/z.csv"]


@pytest.mark.parametrize("name", ["Uhrzeit", "Zeit [s]", "time", "Timestamp"])
def test_time_has_many_names(name):
    assert guessing.named(name, "") == "time"
