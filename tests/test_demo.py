"""`wsp demo`, and the pages it writes."""

import re

import numpy as np
import pytest

from wsp_env import report
from wsp_env.cli import demo, main
from wsp_env.parameters import eurosprinter


@pytest.mark.slow
def test_demo_writes_one_page(tmp_path, capsys):
    page = tmp_path / "new folder" / "demo.html"
    assert main(["demo", "--out", str(page)]) == 0
    printed = capsys.readouterr().out
    assert "tau =" in printed
    assert all(law in printed for law in ("recovering", "classic"))
    text = page.read_text(encoding="utf-8")
    assert text.count('class="plot"') == 4
    loaded = re.findall(r'<(?:script|link|img)[^>]+(?:src|href)="?(http[^"]*)', text)
    assert [to.partition("/plotly-")[0] for to in loaded] == ["https://cdn.plot.ly"]
    assert list(page.parent.iterdir()) == [page]  # nothing half-written is left beside it


@pytest.mark.slow
def test_recovery_shortens_the_stop_and_no_wheel_locks():
    pins = {"mu_cd": 0.04, "tau": 3e-4, "initial_speed": 25.0, "demand": 1.0, "load": 0.0, "gradient": 0.0, "track": "constant"}
    recovering, classic = (demo.brake(law, pins, 8000.0) for law in ("recovering", "classic"))
    assert recovering["position_m"][-1] < classic["position_m"][-1]
    assert not recovering["locked"].any()
    assert not classic["locked"].any()
    assert np.abs(recovering["adhesion"]).max() <= np.abs(recovering["adhesion_r"]).max() + 1e-9


def test_falling_friction_fits_the_measured_creep_curve_best():
    kalker, constant, falling = demo.creep_curves()
    assert falling.error < 0.8 * min(kalker.error, constant.error)
    creepage, adhesion = eurosprinter.measured()
    assert len(creepage) == len(adhesion) == 180
    # the fall: measured friction at large creepage lies well under the largest, which only the last law follows
    assert falling.adhesion[-1] < 0.8 * falling.adhesion.max()
    assert constant.adhesion[-1] == pytest.approx(constant.adhesion.max(), rel=1e-3)


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
    assert "campaign.toml does not exist" in capsys.readouterr().err
