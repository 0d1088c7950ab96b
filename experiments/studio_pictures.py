"""The pictures of docs/studio.md: the studio driven in a headless Chromium with the campaign that travels with the package.

python experiments/studio_pictures.py        # writes docs/studio/*.png; needs the extras [studio] and [dev], and Chromium
"""

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

from wsp_env.recordings import demo_campaign
from wsp_env.report.paper import browser

FOLDER = Path(__file__).parents[1] / "docs" / "studio"
_WIDTH_PX, _HEIGHT_PX = 1200, 860
_TRACK_PX = 598  # down to the end of the two vehicles on their track
_WAIT_MS = 1_200_000  # for a diagnosis on a busy machine
_ACTIONS = (
    "Check the recordings",
    "Continue: tune",
    "Tune",
    "Continue: validate",
    "Validate",
    "Continue: diagnose",
    "Diagnose",
)
_SETTLE_MS = 3000  # until plots are drawn


def main() -> None:
    """Write the pictures."""
    from playwright.sync_api import sync_playwright

    FOLDER.mkdir(exist_ok=True)
    command = [sys.executable, "-m", "wsp_env", "studio", "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server, sync_playwright() as driver:
        assert server.stdout is not None
        found = re.search(r"http\S+", server.stdout.readline())
        assert found is not None
        chromium = driver.chromium.launch(executable_path=browser(), args=["--no-sandbox", "--disable-gpu"])
        tab = chromium.new_page(viewport={"width": _WIDTH_PX, "height": _HEIGHT_PX})
        tab.set_default_timeout(_WAIT_MS)
        try:
            for room in (desk, recordings):
                if room.__name__ in (sys.argv[1:] or ("desk", "recordings")):
                    room(tab, found[0])
        finally:
            chromium.close()
            server.terminate()


def desk(tab: Any, address: str) -> None:
    """Brake two stops and show them."""
    tab.goto(address)
    tab.get_by_role("button", name="Go to the driving desk").click()
    tab.get_by_role("button", name="Brake both stops").click()
    tab.get_by_text("stops after").wait_for()
    drawn(tab)
    tab.evaluate("document.querySelector('.good').scrollIntoView(); window.scrollBy(0, -70)")
    shot(tab, "desk", height=_TRACK_PX)


def recordings(tab: Any, address: str) -> None:
    """Take the demo campaign's files to a diagnosis."""
    tab.goto(address)
    tab.get_by_role("button", name="Read recordings").click()
    files = sorted(str(file) for file in demo_campaign().glob("*.csv"))
    tab.locator("input[type=file]").set_input_files(files)
    tab.get_by_role("button", name="Continue: columns", disabled=False).click()
    tab.get_by_role("heading", name="Which column is what").wait_for()
    drawn(tab)
    shot(tab, "columns")
    tab.get_by_role("button", name="Continue: vehicle").click()
    for label, value in (("mass of the vehicle", "43000"), ("moment of inertia", "160"), ("wheel radius", "0.445")):
        tab.get_by_label(label).fill(value)
    for action in (
        "Check the recordings",
        "Continue: tune",
        "Tune",
        "Continue: validate",
        "Validate",
        "Continue: diagnose",
        "Diagnose",
    ):
        tab.get_by_role("button", name=action, exact=True).click()
    tab.get_by_role("button", name="Download the report").wait_for()
    shot(tab, "diagnosis")


def drawn(tab: Any) -> None:
    """Wait until every plot is drawn."""
    tab.locator(".js-plotly-plot").first.wait_for()
    tab.wait_for_function("[...document.querySelectorAll('.js-plotly-plot')].every(plot => plot.querySelector('.main-svg'))")


def shot(tab: Any, name: str, height: int = _HEIGHT_PX) -> None:
    """Write a picture in 256 colours, which a page has few of."""
    from PIL import Image  # comes with matplotlib

    tab.wait_for_timeout(_SETTLE_MS)
    file = FOLDER / f"{name}.png"
    tab.screenshot(path=file, clip={"x": 0, "y": 0, "width": _WIDTH_PX, "height": height})
    Image.open(file).convert("RGB").quantize(256, dither=Image.Dither.NONE).save(file, optimize=True)
    print(f"{file} {file.stat().st_size // 1000} kB")


if __name__ == "__main__":
    main()
