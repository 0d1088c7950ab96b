"""What every command that writes a report takes: see `wsp_env.report.PageOptions`."""

from typing import Annotated, TypeAlias

import tyro

from wsp_env.report import PageOptions

#: Options of a command's report; all of them stand beside the command's own.
Pages: TypeAlias = Annotated[PageOptions, tyro.conf.arg(name=""), tyro.conf.FlagCreatePairsOff]
