"""The command `wsp diagnose` around the work: what it refuses before, and how it tells how far it is."""

import dataclasses
import json
import shutil
import warnings

import pytest
from elsewhere import Elsewhere
from synthetic_stops import stop, write_campaign

from wsp_env.cli import diagnose, main
from wsp_env.diagnosis import diagnose as engine
from wsp_env.diagnosis import many, progress
from wsp_env.diagnosis.decide import MOST
from wsp_env.executor import ThisProcess
from wsp_env.recordings import CampaignError, CampaignWarning, demo_campaign, read_campaign


@pytest.mark.parametrize(
    ("option", "value", "words"),
    [
        ("--seed", "-1", "seed = -1 is impossible"),
        ("--effort", "0", "effort = 0 is impossible"),
        ("--effort", "inf", "effort = inf is impossible"),
        ("--effort", "nan", "effort = nan is impossible"),
        ("--workers", "0", "workers = 0 is impossible"),
    ],
)
def test_options_that_cannot_be_are_refused_before_the_work(option, value, words, tmp_path, capsys):
    assert main(["diagnose", str(demo_campaign()), "--out", str(tmp_path / "out"), option, value]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("below", ["", "deeper/still"])
def test_a_file_in_place_of_the_folder_is_refused_before_the_work(below, tmp_path, capsys):
    file = tmp_path / "diagnosis"
    file.write_text("kept", encoding="utf-8")
    assert main(["diagnose", str(demo_campaign()), "--out", str(file / below)]) == 2
    assert "is a file, not a folder" in capsys.readouterr().err
    assert file.read_text(encoding="utf-8") == "kept"


def test_the_help_says_how_many_folders(capsys):
    with pytest.raises(SystemExit):
        main(["diagnose", "--help"])
    assert "wsp diagnose [-h] [OPTIONS] FOLDER [FOLDER ...]" in capsys.readouterr().out


def test_an_answer_does_without_its_page_where_plotly_is_missing(tmp_path, capsys):
    earlier = tmp_path / "report.html"
    earlier.write_text("of an earlier answer", encoding="utf-8")

    def missing():
        raise ModuleNotFoundError('the report needs plotly: pip install "wsp-env[report]"')

    diagnose._page(earlier, missing)
    assert capsys.readouterr().err == 'wsp: no report.html: the report needs plotly: pip install "wsp-env[report]"\n'
    assert not earlier.exists()


@pytest.mark.parametrize("rounds", range(1, MOST + 1))
def test_the_share_done_only_grows_over_the_steps_of_stops(rounds):
    course = progress.Advance()
    told = ["checking the data", "fitting the baseline", "searching"]
    told += [*(f"refitting {i + 1} of {MOST}" for i in range(rounds)), "judging"]
    shares = [course.reach(step) for step in told]
    assert shares == [progress.STEPS[step] for step in told]
    assert shares == sorted(set(shares))
    assert shares[0] == 0.0
    assert shares[-1] < 1.0


@pytest.mark.slow
def test_every_step_that_a_diagnosis_of_stops_tells_is_known(tmp_path):
    told: list[str] = []
    folder = write_campaign(tmp_path, {"A1": stop(2e-4, 0.06, duration_s=6.0, noise=1.0)})
    engine(read_campaign(folder), progress=told.append)
    assert told == [step for step in progress.STEPS if step in told]
    assert {step for step in progress.STEPS if not step.startswith("refitting")} <= set(told)


def test_the_share_done_only_grows_over_steps_not_known_before():
    course = progress.Advance()
    told = [f"{step}: null recording {i + 1} of 9" for step in ("first", "second", "without it") for i in range(9)]
    shares = [course.reach(step) for step in told]
    assert shares == sorted(shares)
    assert shares[8] == 0.5
    assert shares[-1] < 1.0


def test_a_log_gets_lines_and_few_of_them(capsys):
    with diagnose.progress() as told:
        for step in (
            "checking the data",
            "fitting the baseline",
            *(f"round 1: null recording {i + 1} of 100" for i in range(100)),
        ):
            told(step)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "wsp: 0%: checking the data"
    assert 4 <= len(lines) <= 10
    assert not any("\x1b" in line for line in lines)


@pytest.fixture
def done(monkeypatch, found):
    """Let `wsp diagnose` answer at once, in this process; returns what was diagnosed."""
    asked = []

    def answer(folder, how, report, workers):
        asked.append(folder.name)
        if folder.name == "bad":
            raise CampaignError(f"{folder} is bad")
        if folder.name == "odd":
            warnings.warn(f"{folder}: a channel is odd", CampaignWarning, stacklevel=1)
        return dataclasses.replace(found, campaign=folder.name)

    monkeypatch.setattr(many, "diagnose_folder", answer)
    monkeypatch.setattr(diagnose, "executor_of", lambda workers: ThisProcess())
    return asked


def test_several_campaigns_each_get_a_folder_and_are_not_diagnosed_again(tmp_path, done, capsys, monkeypatch):
    for name in ("good", "bad", "odd"):
        shutil.copytree(demo_campaign(), tmp_path / name)
    command = ["diagnose", *(str(tmp_path / name) for name in ("good", "bad", "odd")), "--out", str(tmp_path / "out"), "--json"]
    with pytest.raises(SystemExit, match="1"):
        main(command)
    printed = capsys.readouterr()
    assert list(json.loads(printed.out)) == ["good", "odd"]
    assert f"wsp: {tmp_path / 'bad'}: {tmp_path / 'bad'} is bad" in printed.err
    assert f"warning: {tmp_path / 'odd'}: a channel is odd" in printed.err
    assert "wsp: campaign 3 of 3" in printed.err
    for name in ("good", "odd"):
        assert json.loads((tmp_path / "out" / name / "diagnosis.json").read_text())["campaign"] == name
    assert done == ["good", "bad", "odd"]
    monkeypatch.setattr(diagnose, "executor_of", lambda workers: Elsewhere())
    with pytest.raises(SystemExit, match="1"):
        main([*command[:-3], "--out", str(tmp_path / "there"), "--json"])
    there = capsys.readouterr()
    assert there.out == printed.out
    assert f"wsp: {tmp_path / 'bad'}: {tmp_path / 'bad'} is bad" in there.err  # where it lies here
    assert f"warning: {tmp_path / 'odd'}: a channel is odd" in there.err
    monkeypatch.setattr(diagnose, "executor_of", lambda workers: ThisProcess())
    with (tmp_path / "odd" / "campaign.toml").open("a") as file:
        file.write("# changed\n")
    with pytest.raises(SystemExit, match="1"):
        main(command)
    assert done[6:] == ["bad", "odd"]  # the good one is kept
    assert list(json.loads(capsys.readouterr().out)) == ["good", "odd"]
