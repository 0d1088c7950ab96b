"""Who does the work of a command, and how many: options that `wsp evaluate`, `wsp replay` and `wsp diagnose` share."""

from typing import Annotated, TypeAlias

import tyro

from wsp_env.executor import Executor, Workers
from wsp_env.parameters.quantity import ParameterError

#: Options of a command that spreads its work; they stand beside the command's own.
WorkersOption: TypeAlias = Annotated[Workers, tyro.conf.arg(name="")]


def executor_of(workers: Workers) -> Executor:
    """Return the executor asked for; `ParameterError` for an impossible number, `ModuleNotFoundError` without Ray."""
    try:
        return workers.make()
    except ValueError as error:
        raise ParameterError(str(error)) from None
