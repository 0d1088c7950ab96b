"""The command `wsp`: parses, calls, prints. One module a subcommand, imported only when it is called."""

import importlib
import sys
import warnings
from typing import TextIO

#: Subcommand -> what it does; the module of that name has the function `main`, whose arguments are the command line's.
COMMANDS = {
    "demo": "see it work: recordings, tuning, a validation that passes, the diagnosis of what it concealed, stops with it",
    "compare": "the same stop with and without recovery of adhesion, over mu_cd and tau",
    "compare-campaigns": "two campaigns, as before and after a repair: tau, mu_cd, mechanisms, what changed and how sure",
    "evaluate": "put controllers through a test programme in the manner of EN 15595 and compare them",
    "export": "write laws, controllers, policies and the plant as C99 or FMUs for other tools; a template for a WSP in C",
    "inspect": "list the channels of a recorded file of any logger and draft a campaign.toml for it",
    "replay": "let controllers brake under the conditions of recorded stops, beside the stops as recorded",
    "diagnose": "say which physics the tuned law lacks on recorded stops, where it shows and how sure that is",
    "studio": "open pages in a browser: recordings to a report step by step, a driving desk; on this machine alone",
    "tune": "tune tau and mu_cd on a campaign of recorded stops, score the held-out ones",
    "vehicle": "describe vehicles as data: check a vehicle file, print one to start from, list those with names",
    "validate": "tune, score and simulate recorded stops as the seed paper does; a page with its figures and tables",
}

#: Exit status of a command that the user interrupted (128 + SIGINT).
INTERRUPTED = 130


def main(arguments: list[str] | None = None) -> int:
    """Run `wsp` with the arguments (default: the process's); return the exit status."""
    try:
        return _run(*((sys.argv[1:] if arguments is None else arguments) or ["--help"]))
    except BaseException as error:
        if not _is_interrupt(error):
            raise
        print("wsp: interrupted", file=sys.stderr)
        return INTERRUPTED


def _is_interrupt(error: BaseException | None) -> bool:
    """Whether an error is Ctrl-C, or came of it: of one in the middle of a class, Python makes a RuntimeError."""
    return error is not None and (isinstance(error, KeyboardInterrupt) or _is_interrupt(error.__cause__))


def _run(name: str, *rest: str) -> int:
    if name in ("-h", "--help"):
        width = max(map(len, COMMANDS))
        lines = "\n".join(f"  {command:{width}}  {what}" for command, what in COMMANDS.items())
        print(f"usage: wsp COMMAND [OPTIONS]\n\nA laboratory for railway wheel slide protection.\n\n{lines}\n")
        print("wsp COMMAND --help explains a command and its options.")
        return 0
    if name == "--version":
        from wsp_env import __version__

        print(__version__)
        return 0
    if name not in COMMANDS:
        return _failed(f"unknown command {name!r}; valid: {', '.join(COMMANDS)}")
    import tyro

    from wsp_env.executor import ClusterError
    from wsp_env.output import OutputError
    from wsp_env.parameters.quantity import ParameterError
    from wsp_env.recordings.errors import CampaignError, CampaignWarning

    command = importlib.import_module(f"wsp_env.cli.{name.replace('-', '_')}").main
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("always", CampaignWarning)
            warnings.showwarning = _warned
            tyro.cli(command, prog=f"wsp {name}", args=rest)
    except SystemExit:
        if "--output" in (word.partition("=")[0] for word in rest):  # too unlike "--out" for tyro to propose it
            print("wsp: commands that write files take --out, not --output", file=sys.stderr)
        raise
    except (ParameterError, CampaignError, OutputError, ClusterError, ModuleNotFoundError) as error:  # the last: no extra
        return _failed(str(error))
    except BrokenPipeError:  # nobody reads on, as in `wsp ... | head`
        sys.stdout = None  # so that nothing is flushed into it at the end
        return 1
    except OSError as error:
        return _failed(f"{error.filename or 'a file'}: {(error.strerror or str(error)).lower()}")
    return 0


def _warned(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    print(f"wsp: warning: {message}", file=sys.stderr)


def _failed(message: str) -> int:
    print(f"wsp: {message}", file=sys.stderr)
    return 2
