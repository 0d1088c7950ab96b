"""`wsp demo`: the whole way, and the pages it writes."""

import dataclasses
import re
from types import SimpleNamespace

import numpy as np
import pytest

from wsp_env import report
from wsp_env.cli import demo, demo_stops, main
from wsp_env.diagnosis.data_first import data_first


@pytest.mark.long
def test_demo_goes_from_recordings_to_what_they_conceal(tmp_path, capsys):
    page = tmp_path / "new folder" / "demo.html"
    assert main(["demo", "--out", str(page)]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "tau =" in printed
    assert "meets all the seed paper's own figures" in printed  # the validation passes ...
    assert "Verdict: named" in printed  # ... and conceals an effect
    assert "pad friction" in printed
    for who in ("no protection", "rule-based"):
        assert who in printed
    text = page.read_text(encoding="utf-8")
    assert text.count('class="plot"') == 5
    loaded = re.findall(r'<(?:script|link|img)[^>]+(?:src|href)="?(http[^"]*)', text)
    assert [to.partition("/plotly-")[0] for to in loaded] == ["https://cdn.plot.ly"]
    names = {file.name for file in page.parent.iterdir()}
    assert names == {"demo.html", "demo_diagnosis.html"}  # nothing half-written is left beside them


@pytest.mark.slow
def test_a_diagnosis_that_doubts_the_channels_ends_the_demo_before_its_stops(tmp_path, capsys, monkeypatch):
    def doubts(campaign, *rest):
        runs = {
            name: dataclasses.replace(run, vehicle_speed_mps=3.6 * run.vehicle_speed_mps) for name, run in campaign.runs.items()
        }
        return data_first(dataclasses.replace(campaign, runs=runs)).answer

    monkeypatch.setattr(demo, "diagnose", doubts)
    assert main(["demo", "--out", str(tmp_path / "demo.html")]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "The recordings contradict themselves" in printed
    assert "with the found physics" not in printed
    assert {file.name for file in tmp_path.iterdir()} == {"demo.html", "demo_diagnosis.html"}


def test_a_missing_policy_is_said(tmp_path):
    nowhere = SimpleNamespace(stops={}, brake=lambda controller: SimpleNamespace(distance=np.zeros(0)))
    section = demo_stops.policy_section(nowhere, tmp_path / "none")
    assert "comes with a clone" in section.text[0]


def test_text_from_outside_is_escaped():
    table = report.Table(("a", "b"), [("<script>", "1 & 2")], caption="<b>")
    assert "<script>" not in report.page.table_html(table)
    assert "&lt;script&gt;" in report.page.table_html(table)


def test_command_line_names_what_is_wrong(capsys):
    assert main(["tuen"]) == 2
    assert "unknown command 'tuen'; valid: demo, " in capsys.readouterr().err
    assert main(["--help"]) == 0
    assert "usage: wsp COMMAND" in capsys.readouterr().out
    assert main(["tune", "no/such/folder"]) == 2
    assert "there is no folder no/such/folder" in capsys.readouterr().err
