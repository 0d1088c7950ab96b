"""Pages that one forwards: small, whole without a network, every table for Excel, on paper where there is a browser."""

import base64
import hashlib
import io
import json
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
import zipfile

import numpy as np
import pytest
from browser import BROWSER
from waiting import runs, until

from wsp_env.cli import main
from wsp_env.output import OutputError
from wsp_env.recordings import demo_campaign
from wsp_env.report import COLOURS, Facts, Origin, PageOptions, Section, Table, axes, plotly, write_page
from wsp_env.report.still import picture
from wsp_env.report.workbook import workbook

EVIL = "<b>=1+1$x$"
MAIN = "{http://schemas.openxmlformats.org/spreadsheetml/2006/main}"


def plot(points=100):
    objects, _ = plotly()
    figure = objects.Figure()
    x = np.linspace(0.0, 10.0, points)
    y = np.sin(x)
    y[3] = np.nan
    figure.add_scatter(x=x, y=y, mode="lines", name=EVIL, line={"color": COLOURS[0]})
    figure.add_scatter(x=x, y=np.cos(x), mode="markers", name="marks", marker={"color": COLOURS[1], "size": 4})
    figure.add_hline(y=0.0)
    return axes(figure, "time [s]", "speed [m/s]", height=300)


def sections():
    table = Table(("run", "E [m/s]"), [("A1", "0.25"), ("=1+1", "no slide")], "a caption")
    return [Section("", (), [Facts([("Verdict", "named")]), plot()]), Section("More", (), [table, plot()], fold=True)]


def page(tmp_path, **options):
    path = tmp_path / "page.html"
    write_page(path, "Title", "Lead.", sections(), Origin("wsp x", "4 axles", [("a.csv", "f" * 64)]), PageOptions(**options))
    return path.read_text(encoding="utf-8")


def test_a_page_is_small_and_loads_the_installed_library_alone(tmp_path):
    from plotly.offline import get_plotlyjs

    text = page(tmp_path)
    assert len(text) < 100_000
    digest = base64.b64encode(hashlib.sha256(get_plotlyjs().encode()).digest()).decode()
    assert 'src="https://cdn.plot.ly/plotly-' in text
    assert f'integrity="sha256-{digest}"' in text
    assert text.count(" src=") == 1
    assert list(tmp_path.iterdir()) == [tmp_path / "page.html"]


def test_a_page_that_stands_alone_loads_nothing(tmp_path):
    text = page(tmp_path, standalone=True)
    assert not re.search(r'<(script|link|img)[^>]+(src|href)="?http', text)
    assert len(text) > 1_000_000


def test_the_first_plot_is_a_picture_without_the_library_and_the_others_say_what_they_need(tmp_path):
    first, _, folded = page(tmp_path).partition("<body>")[2].partition("<details>")
    assert first.count("<svg") == 1
    assert "--standalone" not in first
    assert "<svg" not in folded
    assert "--standalone" in folded


def test_numbers_of_a_plot_are_those_that_were_drawn(tmp_path):
    (drawn, _) = re.findall(r'<script type="application/json">(.*?)</script>', page(tmp_path), re.DOTALL)
    line = json.loads(drawn)["data"][0]
    values = np.frombuffer(base64.b64decode(line["y"]["bdata"]), dtype="<f4")
    expected = np.sin(np.linspace(0.0, 10.0, 100))
    expected[3] = np.nan
    np.testing.assert_allclose(values, expected, rtol=1e-6, atol=1e-7)


def test_the_footer_says_who_what_when_and_from_what(tmp_path):
    footer = page(tmp_path, author="A. Engineer; Company").partition("<footer>")[2]
    for words in ("A. Engineer\nCompany", "wsp x", "Vehicle: 4 axles", "a.csv ffffffffffff"):
        assert words in footer
    assert re.search(r"on \d{4}-\d\d-\d\d", footer)


def test_every_table_is_a_sheet_with_numbers_as_numbers_and_no_formula():
    archive = zipfile.ZipFile(io.BytesIO(workbook(sections())))
    assert archive.testzip() is None
    trees = {name: ET.fromstring(archive.read(name)) for name in archive.namelist()}  # each part is XML
    sheets = [one.get("name") for one in trees["xl/workbook.xml"].iter(f"{MAIN}sheet")]
    assert sheets == ["Summary", "More"]
    rows = trees["xl/worksheets/sheet2.xml"].iter(f"{MAIN}row")
    cells = [[(cell.get("t"), "".join(cell.itertext())) for cell in row] for row in rows]
    assert cells[1] == [("inlineStr", "A1"), (None, "0.25")]
    assert cells[2] == [("inlineStr", "=1+1"), ("inlineStr", "no slide")]
    assert not list(trees["xl/worksheets/sheet2.xml"].iter(f"{MAIN}f"))


def test_names_of_sheets_are_such_that_excel_takes_them():
    table = Table(("a",), [("1",)])
    words = "Where: residuals by run, axle and balance"
    many = [Section(title, (), [table]) for title in ("x" * 60, "X" * 60, "a/b:c[d]", "\x01?*", "", words, words)]
    tree = ET.fromstring(zipfile.ZipFile(io.BytesIO(workbook(many))).read("xl/workbook.xml"))
    names = [one.get("name") for one in tree.iter(f"{MAIN}sheet")]
    assert len({name.lower() for name in names}) == len(names) == 7
    assert names[-2:] == ["Where residuals by run, axle", "Where residuals by run 2"]
    assert all(0 < len(name) <= 31 and not set(name) & set("[]:*?/\\") for name in names)


def test_pictures_hold_the_text_of_plots_as_text_and_refuse_what_they_cannot_draw():
    text = picture(plot())
    ET.fromstring(text)
    assert "&lt;b&gt;=1+1$x$" in text
    assert "speed [m/s]" in text
    objects, _ = plotly()
    assert picture(objects.Figure(objects.Heatmap(z=[[1.0]]))) == ""


def test_a_pdf_without_a_browser_is_refused_before_the_work(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("shutil.which", lambda *_: None)
    with pytest.raises(OutputError, match="needs Chromium"):
        PageOptions(pdf=True).files(tmp_path / "page.html")
    assert main(["validate", str(demo_campaign()), "--pdf", "--out", str(tmp_path / "page.html")]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not end children with their parent")
def test_no_browser_outlives_a_command_that_is_killed(tmp_path):
    browser = tmp_path / "chromium"
    browser.write_text(f"#!/bin/sh\necho $$ > {tmp_path}/pid\nexec sleep 600\n")
    browser.chmod(0o755)
    code = "from wsp_env.report.paper import printed; printed('<html></html>')"
    path = f"{tmp_path}{os.pathsep}{os.environ['PATH']}"
    with subprocess.Popen([sys.executable, "-c", code], env={**os.environ, "PATH": path, "TMPDIR": str(tmp_path)}) as parent:
        until((tmp_path / "pid").exists)
        until(lambda: (tmp_path / "pid").read_text().endswith("\n"))
        parent.kill()
    until(lambda: not runs((tmp_path / "pid").read_text().strip()))


def test_on_paper_no_buttons_are_shown_and_a_long_table_repeats_its_header(tmp_path):
    text = page(tmp_path)
    printed = text[text.index("@media print") :]
    assert ".modebar { display: none" in printed
    assert "<thead><tr><th>run</th>" in text


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no Chromium installed")
def test_a_page_on_paper(tmp_path):
    page(tmp_path, pdf=True, excel=True)
    assert (tmp_path / "page.pdf").read_bytes().startswith(b"%PDF")
    assert {file.name for file in tmp_path.iterdir()} == {"page.html", "page.pdf", "page.xlsx"}


@pytest.mark.parametrize(("shared", "labels"), [(True, 1), (False, 2)])
def test_panels_with_a_common_axis_have_its_numbers_once(shared, labels):
    objects, subplots = plotly()
    figure = subplots.make_subplots(rows=2, shared_xaxes=shared)
    for row in (1, 2):
        figure.add_trace(objects.Scatter(x=[0.0, 7777.0], y=[1.0, 2.0]), row=row, col=1)
    figure.update_xaxes(tickvals=[7777.0])
    assert picture(figure).count(">7777.0<") == labels
