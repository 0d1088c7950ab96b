"""`wsp studio`: recordings and a driving desk as pages in a browser, on this machine alone."""

from pathlib import Path
from typing import Annotated

import tyro

from wsp_env.parameters.quantity import ParameterError


def main(
    port: int = 0,
    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None,
    most_mb: float = 2000.0,
    browser: bool = True,
) -> None:
    """Serve pages on which recorded stops become a report, and stops are braked and compared.

    They are served to this machine alone, by an address that holds a secret. Nothing is sent anywhere else.

    Parameters
    ----------
    port
        On the loopback; 0 takes one that is free.
    out
        Folder in which files and results are kept; without it they end with the server.
    most_mb
        Largest file that is taken [MB].
    browser
        Open the page in a browser.

    """
    if not 0 <= port < 2**16:
        raise ParameterError(f"port = {port} is impossible: it must lie in [0, {2**16 - 1}]")
    if not 0.0 < most_mb < 1e6:
        raise ParameterError(f"most_mb = {most_mb:g} is impossible: it must lie in (0, 1e6)")
    try:
        import nicegui  # noqa: F401
        import plotly  # noqa: F401
    except ImportError:
        raise ModuleNotFoundError('wsp studio needs NiceGUI: pip install "wsp-env[studio]"') from None
    from wsp_env.studio.server import serve

    serve(port, browser, out, int(1e6 * most_mb))
