"""The command `wsp` from its first instant: Ctrl-C ends it in one line while the libraries are still being loaded.

It lies beside the package: importing anything of the package loads them.
"""

import os
import signal
from typing import NoReturn


def main() -> int:
    """Load the command line and run it; return the exit status."""
    usual = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # else whoever started it wants it deaf
    if usual:
        signal.signal(signal.SIGINT, _end)
    # Before numpy is loaded: the matrices are small and the work is spread over threads already; with a thread more for each
    # product a diagnosis took a quarter longer on two cores.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from wsp_env.cli import main as run

    if usual:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    return run()


def _end(*_: object) -> NoReturn:
    """End at once: nothing has been begun, and a half-loaded library makes errors of its own of an exception."""
    os.write(2, b"wsp: interrupted\n")
    os._exit(130)
