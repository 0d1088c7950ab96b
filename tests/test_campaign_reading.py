"""Campaigns: what is in the files comes out, and what is wrong with them is said in one clear sentence."""

import numpy as np
import polars as pl
import pytest
from numpy.testing import assert_array_equal
from synthetic_stops import AXLES, MASS_KG, stop, write_campaign

from wsp_env.parameters.campaign_vehicle import plant_vehicle
from wsp_env.parameters.velim import CONTACT
from wsp_env.recordings import CampaignError, CampaignWarning, demo_campaign, read_campaign


@pytest.fixture(scope="module")
def columns():
    return stop(2e-4, 0.06, duration_s=3.0)


@pytest.fixture
def folder(tmp_path, columns):
    return write_campaign(tmp_path / "campaign", {"A1": columns, "B1": columns}, ["A1"], ["B1"])


def edit(folder, old, new):
    path = folder / "campaign.toml"
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_columns_come_out_as_they_went_in(tmp_path, columns, suffix):
    campaign = read_campaign(write_campaign(tmp_path, {"A1": columns}, suffix=suffix))
    run = campaign.runs["A1"]
    assert_array_equal(run.time_s, columns["time_s"])
    assert_array_equal(run.vehicle_speed_mps, columns["vehicle_speed_mps"])
    for k in range(AXLES):
        assert_array_equal(run.wheel_speed_radps[:, k], columns[f"axle{k + 1}_wheel_speed_radps"])
        assert_array_equal(run.brake_torque_nm[:, k], columns[f"axle{k + 1}_brake_torque_nm"])
    assert campaign.vehicle.mass_kg == run.mass_kg == MASS_KG
    assert campaign.contact == CONTACT
    assert run.kinetic_friction_d == CONTACT.kinetic_friction_d


def test_a_run_may_differ_from_the_vehicle(folder):
    edit(folder, "[runs.A1]", "[runs.A1]\nmass_kg = 50000\nkinetic_friction_d = 0.05\ngradient = -0.002")
    run = read_campaign(folder).runs["A1"]
    assert (run.mass_kg, run.kinetic_friction_d, run.gradient) == (50000.0, 0.05, -0.002)


def test_a_campaign_may_say_which_axles_form_a_bogie(folder):
    edit(folder, "[vehicle]", f"[vehicle]\nbodies = {[[1] * AXLES]}")
    campaign = read_campaign(folder)
    assert campaign.vehicle.bodies == ((1,) * AXLES,)
    assert plant_vehicle(campaign.vehicle, CONTACT, "recorded").running_gear == ((1,) * AXLES,)
    edit(folder, f"bodies = {[[1] * AXLES]}", f"bodies = {[[AXLES, 1]]}")
    with pytest.raises(CampaignError, match=f"stand on {AXLES + 1} axles, but the vehicle has {AXLES}"):
        read_campaign(folder)


def test_demo_campaign_is_complete():
    campaign = read_campaign(demo_campaign())
    assert set(campaign.tune) | set(campaign.validate) == set(campaign.runs)
    assert all(len(run.time_s) > 1000 for run in campaign.runs.values())


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("tune = ['A1']", "tune = ['A1', 'A7']", ["'A7'", r"add \[runs.A7\]"]),
        ("tune = ['A1']", "tune = []", ["tune is empty"]),
        ('"measured"', "'guess'", ["brake_torque_source = 'guess'", 'valid: "measured"']),
        ("tune = ['A1']", "tune = ['A1', 'B1']", ["B1 in both tune and validate"]),
        ("tune = ['A1']", "tune = 3", ["must be a list of run names"]),
        ("sample_time_s = 0.01", "", ["lacks sample_time_s"]),
        ("sample_time_s = 0.01", "sample_time_s = 0", ["sample_time_s must be a finite number above 0"]),
        ("sample_time_s = 0.01", "sampling = 0.01", ["unknown key sampling", "valid: name"]),
        ("axles = 4", "axles = 5", ["axles 1, 2, 3, 4", "axles = 5", "correct the one or the other"]),
        ("axles = 4", "axles = 4.0", ["whole number"]),
        ("mass_kg = 43000.0", "mass_kg = -1", ["mass_kg = -1 kg is impossible"]),
        ("mass_kg = 43000.0", "", ["lacks mass_kg"]),
        ("mass_kg = 43000.0", "mass_kg = 43000.0\nweight = 1", [r"unknown key in \[vehicle\] weight", "valid: axles"]),
        ('set = "velim"', 'set = "mars"', ["'mars' is unknown", "valid: velim"]),
        ('set = "velim"', 'set = ["velim"]', [r"\['velim'\] is unknown", "valid: velim"]),
        ('[contact]\nset = "velim"', '[[contact]]\nset = "velim"', [r"\[contact\] must be a table"]),
        ('set = "velim"', 'set = "velim"\nkinetic_friction_d = 0.5', ["exceeds kinetic_friction_r"]),
        ('file = "A1.csv"', 'file = "A9.csv"', ["A9.csv does not exist", "file of run A1"]),
        ("[runs.A1]", "[runs.A1]\nkinetic_friction_d = 0.28", ["not below kinetic_friction_r"]),
        ("[vehicle]", "[vehicle", ["not valid TOML"]),
    ],
)
def test_campaign_toml_that_cannot_be_used(folder, old, new, said):
    edit(folder, old, new)
    with pytest.raises(CampaignError) as error:
        read_campaign(folder)
    for what in said:
        assert error.match(what)


def test_no_campaign(tmp_path):
    with pytest.raises(CampaignError, match=r"campaign\.toml does not exist"):
        read_campaign(tmp_path)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_missing_column(tmp_path, columns, suffix):
    without = {name: values for name, values in columns.items() if name != "axle2_brake_torque_nm"}
    with pytest.raises(CampaignError, match=r"A1\S+ lacks the column axle2_brake_torque_nm; it has: time_s"):
        read_campaign(write_campaign(tmp_path, {"A1": without}, suffix=suffix))


@pytest.mark.parametrize("content", ["", "time_s,vehicle_speed_mps\n"])
def test_empty_file(folder, content):
    (folder / "A1.csv").write_text(content)
    with pytest.raises(CampaignError, match=r"A1\.csv"):
        read_campaign(folder)


def test_a_cell_that_is_no_number_is_bridged_and_said(folder):
    lines = (folder / "A1.csv").read_text().splitlines()
    cells = lines[241].split(",")
    lines[241] = ",".join(["x" if i == 2 else cell for i, cell in enumerate(cells)])
    (folder / "A1.csv").write_text("\n".join(lines))
    with pytest.warns(CampaignWarning, match=r"A1\.csv, column axle1_wheel_speed_radps: 1 .*row 241 \(line 242 of a CSV\)"):
        run = read_campaign(folder).runs["A1"]
    assert np.argwhere(run.suspect).tolist() == [[240, 0]]


def test_a_file_that_is_no_table(folder):
    edit(folder, '"A1.csv"', '"A1.parquet"')
    (folder / "A1.parquet").write_bytes(b"not parquet at all")
    with pytest.raises(CampaignError, match=r"A1\.parquet is empty or no Parquet table"):
        read_campaign(folder)


def test_text_columns_are_ignored_unless_needed(folder, columns):
    frame = pl.DataFrame(columns).with_columns(pl.lit("dry").alias("weather"))
    frame.write_csv(folder / "A1.csv")
    assert np.isfinite(read_campaign(folder).runs["A1"].brake_torque_nm).all()


def test_what_is_no_campaign_is_told_apart(tmp_path):
    (tmp_path / "A1.csv").write_text("time_s\n0\n", encoding="utf-8")
    for path, said in (
        (tmp_path / "A1.csv", "is a file; a campaign is a folder: give "),
        (tmp_path / "nowhere", "there is no folder"),
        (tmp_path, "wsp inspect FOLDER"),
    ):
        with pytest.raises(CampaignError, match=said):
            read_campaign(path)
