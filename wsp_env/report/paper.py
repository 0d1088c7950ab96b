"""A page on paper: PDF by a headless Chromium, where there is one."""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from wsp_env.child import end_with_parent
from wsp_env.output import OutputError

_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
_LIMIT_S = 300.0  # for one page, by the clock: many plots on a busy machine (assumption)
_ENDS = end_with_parent if sys.platform == "linux" else None  # the browser, when this process is killed
_DRAWN_MS = 20_000  # of the page's own time, in which its plots are drawn: passes as fast as they are


def browser() -> str | None:
    """Return the path of a Chromium or Chrome; None where there is none."""
    return next(filter(None, map(shutil.which, _BROWSERS)), None)


def printed(page: str) -> bytes:
    """Return a page that needs no network as PDF, all folds open.

    Raises
    ------
    OutputError
        where there is no browser, or it fails

    """
    found = browser()
    if found is None:
        raise OutputError("no PDF: it needs Chromium or Google Chrome on the PATH")
    with tempfile.TemporaryDirectory(prefix="wsp-") as folder:
        source, target = Path(folder) / "page.html", Path(folder) / "page.pdf"
        source.write_text(page.replace("<details>", "<details open>"), encoding="utf-8", errors="backslashreplace")
        command = [
            found, "--headless", "--disable-gpu", "--no-sandbox", f"--user-data-dir={folder}/profile", "--no-pdf-header-footer",
            "--host-resolver-rules=MAP * ~NOTFOUND", f"--virtual-time-budget={_DRAWN_MS}", f"--print-to-pdf={target}",
            source.as_uri(),
        ]  # fmt: skip
        try:
            subprocess.run(command, capture_output=True, timeout=_LIMIT_S, check=True, preexec_fn=_ENDS)
            return target.read_bytes()
        except (OSError, subprocess.SubprocessError) as error:
            raise OutputError(
                f"no PDF: {Path(found).name} failed ({type(error).__name__}); the page itself is written"
            ) from None
