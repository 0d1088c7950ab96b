"""Pages in a headless Chromium without a network: what its console says, what axes its plots have."""

import re
import shutil
import subprocess
from pathlib import Path

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)


def alone(page: Path) -> Path:
    """Return a copy of a page that carries plotly's library and has its folds open."""
    from plotly.offline import get_plotlyjs

    text = page.read_text(encoding="utf-8").replace("<details>", "<details open>")
    text = re.sub(r'<script src="https://cdn.plot.ly/[^>]*>', lambda _: f"<script>{get_plotlyjs()}", text)
    copy = page.with_name(f"alone_{page.name}")
    copy.write_text(text, encoding="utf-8")
    return copy


def open_page(page: Path, profile: Path) -> tuple[list[str], int, list[str]]:
    """Return what the console said, the number of plots and the titles of their axes, all folds open."""
    command = [
        BROWSER, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={profile}", "--enable-logging=stderr",
        "--host-resolver-rules=MAP * ~NOTFOUND", "--virtual-time-budget=20000", "--dump-dom", alone(page).resolve().as_uri(),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    said = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    plots = len(re.findall(r'class="[^"]*js-plotly-plot', done.stdout))
    titles = re.findall(r'class="[xy]\d*title"[^>]*>([^<]*)<', done.stdout)
    return said, plots, titles
