"""The studio in a real browser: from strange files to a forwarded report, by keyboard alone, a broken file, two at once."""

import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import polars as pl
import pytest
from browser import BROWSER
from strange_csvs import NAMELESS, write_six

from wsp_env.studio.work import BUCKETS

pytest.importorskip("nicegui", reason="the studio's pages need the extra [studio]")
playwright = pytest.importorskip("playwright.sync_api", reason="the browser is driven by playwright")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.xdist_group("studio"),
    pytest.mark.skipif(BROWSER is None, reason="no Chromium or Chrome on the PATH"),
    # A loaded machine lets steps of a page run late, and a test that fails then says nothing: they are run on purpose.
    pytest.mark.skipif(not os.environ.get("WSP_STUDIO_BROWSER"), reason="run by `make studio`, on an idle machine"),
]

#: For one step of a page on a busy machine [ms]; what computes has more.
PATIENCE_MS, WORK_MS = 180_000, 1_200_000
ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
             "--disable-component-update", "--disable-sync"]  # fmt: skip


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """Return the server's process and its address."""
    place = tmp_path_factory.mktemp("studio")
    command = [sys.executable, "-m", "wsp_env", "studio", "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env={**os.environ, "TMPDIR": str(place)}) as server:
        yield server, re.search(r"http\S+", server.stdout.readline())[0]
        assert list(place.glob("wsp-studio-*"))
        server.terminate()
        server.wait(PATIENCE_MS / 1000.0)
    assert not list(place.glob("wsp-studio-*"))  # what was uploaded ends with the server


@pytest.fixture(scope="module")
def address(served):
    return served[1]


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=BROWSER, args=ARGUMENTS)
        yield opened
        opened.close()


@pytest.fixture
def open_tab(browser, address):
    """Return what opens a tab of a browser of its own; at the end no tab has asked for anything elsewhere."""
    contexts, elsewhere = [], []
    own = address.partition("/?")[0]

    def opened():
        context = browser.new_context(viewport={"width": 1360, "height": 900}, accept_downloads=True)
        contexts.append(context)
        tab = context.new_page()
        tab.set_default_timeout(PATIENCE_MS)
        tab.on(
            "request",
            lambda request: elsewhere.append(request.url) if not request.url.startswith((own, "data:", "blob:")) else None,
        )
        tab.goto(address)
        tab.get_by_role("heading", name="What is at hand?").wait_for()
        assert "token" not in tab.url
        return tab

    yield opened
    for context in contexts:
        context.close()
    assert elsewhere == []


@pytest.fixture(scope="module")
def six(tmp_path_factory):
    return write_six(tmp_path_factory.mktemp("six"), duration_s=6.0)


def drop(tab, files):
    tab.get_by_role("button", name="Read recordings").click()
    tab.locator("input[type=file]").set_input_files([str(file) for file in files])


def press(tab, name, wait_for, patience=PATIENCE_MS):
    tab.get_by_role("button", name=name, exact=True).click()
    tab.get_by_role("heading", name=wait_for).or_(tab.get_by_role("button", name=wait_for)).wait_for(timeout=patience)


def choose(tab, label, option):
    field = tab.get_by_label(label, exact=True)
    tab.locator("label.q-field", has=field).click()
    listed = tab.locator(f"[id='{field.get_attribute('aria-controls')}']")  # other fields' lists may still be closing
    listed.get_by_role("option", name=option).first.click()


def describe_vehicle(tab):
    for label, value in (("mass of the vehicle", "43000"), ("moment of inertia", "160"), ("wheel radius", "0.445")):
        tab.get_by_label(label).fill(value)


def test_from_six_strange_files_to_a_forwarded_report(open_tab, six, tmp_path):
    tab = open_tab()
    drop(tab, six)
    tab.get_by_text(six[-1].name).wait_for()
    press(tab, "Continue: columns", "Which column is what")
    tab.get_by_text("Still missing: the vehicle's speed.").wait_for()
    assert tab.get_by_role("button", name="Continue: vehicle").is_disabled()
    choose(tab, "column of vehicle speed", NAMELESS)
    tab.get_by_text("Still missing").wait_for(state="hidden")
    choose(tab, "unit of vehicle speed", "km/h")
    press(tab, "Continue: vehicle", "Vehicle as tested")
    describe_vehicle(tab)
    press(tab, "Check the recordings", "Continue: tune", WORK_MS)
    press(tab, "Continue: tune", "How fast sliding cleans the rail")
    press(tab, "Tune", "Continue: validate", WORK_MS)
    tab.get_by_text("95 % interval").first.wait_for()
    press(tab, "Continue: validate", "Does the tuned law hold?")
    press(tab, "Validate", "Continue: diagnose", WORK_MS)
    press(tab, "Continue: diagnose", "Which physics is missing?")
    press(tab, "Diagnose", "Download the report", WORK_MS)
    tab.frame_locator("iframe").get_by_role("heading", name="Diagnosis of").wait_for()  # is_visible would not wait
    with tab.expect_download() as taken:
        tab.get_by_role("link", name="The report, one page (HTML)").click()
    taken.value.save_as(tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Fahrt 01.csv" in page
    assert not re.search(r'<(script|link|img)[^>]+(src|href)="?http', page)  # it can be read where there is no network
    tab.reload()  # what was made is still there
    tab.get_by_role("button", name="Download the report").wait_for()


def test_by_keyboard_alone(open_tab, six):
    tab = open_tab()
    keys = tab.keyboard

    def to(name):
        """Go on by the tab key until what is named has the focus; a page that is late has its time."""
        seen, until = [], time.monotonic() + PATIENCE_MS / 1000.0
        while time.monotonic() < until:
            keys.press("Tab")
            focused = tab.evaluate(
                "(() => { const e = document.activeElement; return e === document.body ? '' : [e.innerText, "
                "e.getAttribute('aria-label'), e.labels && e.labels[0] && e.labels[0].innerText].join(' ') })()"
            )
            if name in focused:
                return
            seen.append(focused[:40])
        pytest.fail(f"{name} cannot be reached by the tab key, which goes over {list(dict.fromkeys(seen))}")

    to("Read recordings")
    keys.press("Enter")
    tab.get_by_role("heading", name="Recorded stops").wait_for()
    to("Choose files")
    with tab.expect_file_chooser() as chooser:
        keys.press("Enter")
    chooser.value.set_files([str(file) for file in six[:3]])
    tab.get_by_text(six[2].name).wait_for()
    to("Continue: columns")
    keys.press("Enter")
    tab.get_by_role("heading", name="Which column is what").wait_for()
    assert tab.evaluate("document.activeElement.id") == "top"  # a new screen begins at its heading
    to("column of vehicle speed")
    keys.press("ArrowDown")
    tab.get_by_role("option", name=NAMELESS).wait_for()
    for _ in range(30):
        if tab.locator(".q-manual-focusable--focused", has_text=NAMELESS).count():
            break
        keys.press("ArrowDown")
    keys.press("Enter")
    tab.get_by_text("Still missing").wait_for(state="hidden")
    to("Continue: vehicle")
    keys.press("Enter")
    tab.get_by_role("heading", name="Vehicle as tested").wait_for()
    for field, value in (("mass", "43000"), ("inertia", "160"), ("radius", "0.445")):
        to(field)
        keys.type(value)
    to("Check the recordings")
    keys.press("Enter")
    tab.get_by_role("button", name="Continue: tune").wait_for(timeout=WORK_MS)


def test_what_is_pressed_before_the_server_has_answered_is_done(open_tab, served, six):
    """On a busy machine a server answers late: the button that follows a field must not be another one by then."""
    tab = open_tab()
    drop(tab, six[:3])
    press(tab, "Continue: columns", "Which column is what")
    choose(tab, "column of vehicle speed", NAMELESS)
    press(tab, "Continue: vehicle", "Vehicle as tested")
    os.kill(served[0].pid, signal.SIGSTOP)
    try:
        describe_vehicle(tab)
        tab.get_by_role("button", name="Check the recordings").click()
    finally:
        os.kill(served[0].pid, signal.SIGCONT)
    tab.get_by_role("button", name="Continue: tune").wait_for(timeout=WORK_MS)


def test_a_broken_file_is_named_and_the_others_go_on(open_tab, six, tmp_path):
    broken = tmp_path / "<i>broken.parquet"
    broken.write_bytes(b"PAR1" + bytes(range(256)) * 40 + b"PAR1")
    (tmp_path / "notes.exe").write_bytes(b"MZ")
    tab = open_tab()
    drop(tab, [broken, six[0], tmp_path / "notes.exe"])
    tab.get_by_text("Cannot be read: _i_broken.parquet").wait_for()
    tab.get_by_text(six[0].name, exact=True).wait_for()
    assert tab.get_by_text("notes.exe").count() == 0
    tab.get_by_role("button", name="remove _i_broken.parquet").click()
    tab.get_by_text("Cannot be read").wait_for(state="detached")
    press(tab, "Continue: columns", "Which column is what")


def test_ten_million_rows(open_tab, tmp_path):
    """2.8 hours at 1 kHz, some 700 MB: through the browser, looked at, suggested and drawn; the page stays small."""
    rows = int(os.environ.get("WSP_STUDIO_ROWS", 10_000_000))
    time_s = 1e-3 * np.arange(rows)
    speed = np.clip(40.0 - 35.0 * np.minimum(time_s / time_s[-1], 1.0), 0.5, None)
    table = {"t [s]": time_s, "v_train [km/h]": 3.6 * speed}
    for k in range(1, 5):
        table[f"n_axle{k} [1/min]"] = speed / 0.445 * 9.549 * (1.0 - 0.002 * k)
        table[f"M_brake{k} [kNm]"] = np.full(rows, 2.0 + 0.1 * k)
    file = tmp_path / "long.csv"
    pl.DataFrame(table).write_csv(file, float_precision=4)
    tab = open_tab()
    drop(tab, [file])
    tab.get_by_text(f"{rows:,}").wait_for(timeout=WORK_MS)
    press(tab, "Continue: columns", "Which column is what")
    assert tab.get_by_text("Still missing").count() == 0 or tab.get_by_text("Still missing").is_hidden()
    tab.locator(".js-plotly-plot .scatterlayer").first.wait_for(state="attached")
    points = tab.evaluate("Math.max(...document.querySelector('.js-plotly-plot').data.map(one => one.x.length))")
    assert points <= 2 * BUCKETS
    press(tab, "Continue: vehicle", "Vehicle as tested")


def test_two_sessions_at_once_keep_to_themselves(open_tab, six):
    one, two = open_tab(), open_tab()
    drop(one, six[:1])
    drop(two, six[1:2])
    one.get_by_text(six[0].name, exact=True).wait_for()
    two.get_by_text(six[1].name, exact=True).wait_for()
    assert one.url != two.url
    assert one.get_by_text(six[1].name).count() == two.get_by_text(six[0].name).count() == 0
    press(one, "Continue: columns", "Which column is what")
    assert two.get_by_role("heading", name="Recorded stops").is_visible()
    two.goto(one.url)  # a second tab of the same workspace shows the same, and what the other one does
    two.get_by_role("heading", name="Which column is what").wait_for()
    choose(one, "column of vehicle speed", NAMELESS)
    two.get_by_text("Still missing").wait_for(state="hidden")


def test_without_the_token_nothing_is_shown(browser, address):
    context = browser.new_context()
    tab = context.new_page()
    answer = tab.goto(address.partition("?")[0])
    assert answer.status == 403
    assert "needs its token" in tab.content()
    context.close()


def test_two_stops_are_braked_watched_and_taken_along(open_tab, tmp_path):
    tab = open_tab()
    tab.get_by_role("button", name="Go to the driving desk").click()
    for stop in range(2):
        tab.get_by_label("From [km/h]").nth(stop).fill("40")
    tab.get_by_role("button", name="Brake both stops").click()
    tab.get_by_text("stops after").wait_for(timeout=WORK_MS)
    tab.get_by_role("img", name="stop B on its track").wait_for()
    before = tab.get_by_label("time of the stop in seconds").input_value()
    tab.get_by_role("button", name="Watch").click()
    tab.wait_for_function(f"document.querySelector('input[type=range]').value > {float(before) + 0.5}")
    tab.get_by_text("Stop B as a Python program").click()
    with tab.expect_download() as taken:
        tab.get_by_role("button", name="Download stop_b.py").click()
    taken.value.save_as(tmp_path / "stop_b.py")
    done = subprocess.run([sys.executable, str(tmp_path / "stop_b.py")], capture_output=True, text=True, check=True)
    distance = re.match(r"[\d.]+", done.stdout)[0]
    assert f"{float(distance):.1f}" in tab.locator("table.plain tr").nth(2).inner_text()
