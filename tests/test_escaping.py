"""Names come from other people's files: on pages and terminals they are text, whatever stands in them."""

import dataclasses
from html.parser import HTMLParser

import pytest
from synthetic_stops import stop, write_campaign

from wsp_env.cli import main
from wsp_env.cli.diagnose import _print
from wsp_env.diagnosis.report import write_report

EVIL = "<!--<script></script><script>alert(1)</script><img src=x onerror=alert(1)>[/bold]"


class Elements(HTMLParser):
    """The elements of a page, and its text outside of scripts."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.text, self.scripts = [], "", ""
        self.feed(page)
        assert self.get_starttag_text() is not None

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        assert not any(name.startswith("on") for name, _ in attrs)

    def handle_data(self, data):
        if self.tags and self.tags[-1] == "script" and self.cdata_elem == "script":
            self.scripts += data
        else:
            self.text += data


def poisoned(value):
    """Return an answer whose names of runs are evil, at any depth."""
    if dataclasses.is_dataclass(value):
        changes = {field.name: poisoned(getattr(value, field.name)) for field in dataclasses.fields(value)}
        return dataclasses.replace(value, **changes)
    if isinstance(value, tuple | list):
        return type(value)(poisoned(one) for one in value)
    if isinstance(value, dict):
        return {poisoned(key): poisoned(one) for key, one in value.items()}
    return value + EVIL if value in ("A1", "B1", "trial") else value


def same_elements(page, harmless):
    evil, sound = Elements(page), Elements(harmless)
    assert evil.tags == sound.tags
    assert "img" not in evil.tags
    assert "<script>alert" not in evil.scripts
    assert "<!--" not in evil.scripts
    return evil


def test_a_diagnosis(found, tmp_path, capsys):
    write_report(tmp_path / "sound.html", found)
    bad = dataclasses.replace(poisoned(found), sentence=found.sentence + EVIL, next_test=found.next_test + EVIL, notes=(EVIL,))
    write_report(tmp_path / "evil.html", bad)
    harmless = dataclasses.replace(found, notes=("a note",))
    write_report(tmp_path / "sound.html", harmless)
    same_elements((tmp_path / "evil.html").read_text(), (tmp_path / "sound.html").read_text())
    _print(bad, tmp_path)
    assert EVIL in capsys.readouterr().out.replace("\n", "")


@pytest.mark.long
def test_an_evaluation(tmp_path, capsys):
    pages = []
    for name in ("sound", EVIL):
        case = f"[[case]]\nname='low {name}'\nabout='{name}'\ninitial_speed_kmh=40.0\ninitial_adhesion=[0.05, 0.06]\n"
        (tmp_path / "programme.toml").write_text(f"[programme]\nname = '{name}'\n{case}")
        arguments = ["--programme", str(tmp_path / "programme.toml"), "--out", str(tmp_path / f"out{len(pages)}")]
        assert (
            main(["evaluate", "--controllers", "none", "--vehicle", "wheelset", "--draws", "1", "--jobs", "1", *arguments]) == 0
        )
        pages.append((tmp_path / f"out{len(pages)}" / "report.html").read_text())
    same_elements(pages[1], pages[0])


def test_signals_of_a_campaign(tmp_path):
    from wsp_env.recordings import read_campaign
    from wsp_env.recordings.signals import write_signals

    columns = stop(2e-4, 0.06, duration_s=2.0)
    campaign = read_campaign(write_campaign(tmp_path, {"A1": columns}))
    write_signals(tmp_path / "sound.html", campaign)
    run = dataclasses.replace(campaign.runs["A1"], warnings=())
    write_signals(tmp_path / "evil.html", dataclasses.replace(campaign, name=EVIL, runs={EVIL: run}))
    same_elements((tmp_path / "evil.html").read_text(), (tmp_path / "sound.html").read_text())
