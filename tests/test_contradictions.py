"""A channel in another unit: reading refuses it, and a diagnosis answers `data`, with the channel and how to mend it."""

import json
import pickle

import numpy as np
import polars as pl
import pytest
from synthetic_stops import stop, write_campaign

from wsp_env.cli import main
from wsp_env.diagnosis import diagnose
from wsp_env.recordings import CampaignError, read_campaign
from wsp_env.recordings.errors import ContradictionError

RPM = 60.0 / (2.0 * np.pi)


@pytest.fixture
def campaign(tmp_path):
    """Two stops, of which the first has one wheel in rpm and the second has none."""
    good = stop(2e-4, 0.06, duration_s=8.0, noise=1.0)
    wrong = good | {"axle2_wheel_speed_radps": good["axle2_wheel_speed_radps"] * RPM}
    return write_campaign(tmp_path / "rpm", {"A1": wrong, "A2": good})


def test_reading_refuses_it_unless_told_otherwise(campaign):
    with pytest.raises(
        ContradictionError, match=r'A1.*axle2_wheel_speed is 9.5.* in rpm\? Give axle2_wheel_speed unit = "rpm"'
    ):
        read_campaign(campaign)
    runs = read_campaign(campaign, refuse=False).runs
    assert isinstance(runs["A1"].contradiction, CampaignError)
    assert runs["A2"].contradiction is None


def test_a_diagnosis_names_the_channel_and_no_physics(campaign):
    found = diagnose(read_campaign(campaign, refuse=False))
    assert found.verdict == "data"
    assert not found.mechanisms
    (suspect,) = (one for one in found.suspect_channels if one.kind == "unit")
    assert (suspect.channel, suspect.kind, suspect.axle, suspect.runs) == ("axle2_wheel_speed", "unit", 2, ("A1",))
    assert 'unit = "rpm"' in suspect.remedy
    assert "axle2_wheel_speed" in found.sentence
    assert "in run A1" in found.sentence


def test_a_unit_of_each_run_is_told(campaign):
    file = campaign / "A2.csv"
    column = "axle2_wheel_speed_radps"
    pl.read_csv(file).with_columns(pl.col(column) * 3.6).write_csv(file)
    found = diagnose(read_campaign(campaign, refuse=False)).suspect_channels
    assert {one.runs for one in found if one.channel == "axle2_wheel_speed"} == {("A1",), ("A2",)}


def test_an_axle_without_a_sensor_is_not_blamed_for_what_stands_in(campaign):
    for file in campaign.glob("*.csv"):
        pl.read_csv(file).with_columns(axle1_wheel_speed_radps=pl.lit(0.0)).write_csv(file)
    found = diagnose(read_campaign(campaign, refuse=False))
    assert [one.channel for one in found.suspect_channels if one.kind == "unit"] == ["axle2_wheel_speed"]


@pytest.mark.parametrize(
    ("pattern", "factor", "channel"),
    [
        ("vehicle_speed", -1.0, "vehicle_speed"),
        ("vehicle_speed", 3.6, "vehicle_speed"),
        ("wheel_speed", -1.0, "axle*_wheel_speed"),
        ("torque", 1e-3, "axle*_brake_torque"),
        ("torque", -1.0, "axle*_brake_torque"),
    ],
)
def test_other_contradictions_are_answers_too(tmp_path, pattern, factor, channel):
    columns = stop(2e-4, 0.06, duration_s=8.0, noise=1.0)
    wrong = {name: values * factor if pattern in name else values for name, values in columns.items()}
    found = diagnose(read_campaign(write_campaign(tmp_path, {"A1": wrong}), refuse=False))
    assert (found.verdict, [one.channel for one in found.suspect_channels]) == ("data", [channel])
    assert "[channels]" in found.next_test


def test_the_command_writes_the_answer(campaign, tmp_path, capsys):
    main(["diagnose", str(campaign), "--out", str(tmp_path / "out")])
    said = json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    assert said["verdict"] == "data"
    assert "axle2_wheel_speed" in capsys.readouterr().out
    assert (tmp_path / "out" / "report.html").is_file()


def test_the_error_survives_the_way_to_another_process():
    error = ContradictionError("here/A1.csv", "axle2_wheel_speed", "is 9.5 times too large", "give its unit", 9.5)
    again = pickle.loads(pickle.dumps(error))
    assert vars(again) == vars(error)
    assert str(again) == "here/A1.csv: axle2_wheel_speed is 9.5 times too large; give its unit"
