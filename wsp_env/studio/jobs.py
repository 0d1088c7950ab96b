"""Work in child processes: begun with a request, followed line by line, cancelled at any time."""

import asyncio
import contextlib
import json
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any, Literal

from wsp_env.output import OutputError, write_text

#: Time [s] that a child has to end by itself once it is asked to, before it is ended.
_GRACE_S = 2.0

#: The longest line that a child writes [bytes]: warnings are lines, results are files.
_LONGEST_LINE = 2**20

_LAST_WORDS = 4000  # characters of what a child wrote as an error that are kept

# The child ends with this process, also when that is killed; it imports from where this one does.
_CODE = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from wsp_env.child import end_with_parent; end_with_parent(); "
    "from wsp_env.studio import work; sys.exit(work.main(sys.argv[2], sys.argv[3]))"
)

State = Literal["running", "done", "failed", "cancelled"]


class Job:
    """One task of `wsp_env.studio.work` in a child process.

    Parameters
    ----------
    task : name of the task
    folder : for what it reads and leaves; the request and the result are files in it
    request : what the task takes

    """

    def __init__(self, task: str, folder: Path, request: dict[str, Any]) -> None:
        self.task, self.folder, self._request = task, folder, request
        self.state: State = "running"
        self.step, self.share = "starting", 0.0  # share of the whole [-]; 0 where it is not known
        self.warnings: list[str] = []
        self.message = ""  # why it failed
        self.result: dict[str, Any] = {}
        self._began, self._ended = time.monotonic(), 0.0
        self._process: asyncio.subprocess.Process | None = None

    @property
    def running(self) -> bool:
        """Whether it is still at work."""
        return self.state == "running"

    @property
    def seconds(self) -> float:
        """For how long it has been at work [s]."""
        return (self._ended or time.monotonic()) - self._began

    async def run(self) -> None:
        """Do the work; returns when it is done, has failed or was cancelled."""
        try:
            code, words = await self._work()
        except (OSError, OutputError) as error:  # no process, no memory, a full disk
            code, words = 1, str(error)
        except asyncio.CancelledError:  # the server ends
            self.end()
            raise
        self._ended = time.monotonic()
        if self.running:
            self._finish(code, words)

    async def _work(self) -> tuple[int, str]:
        """Return the exit status of the child and its last words."""
        self.folder.mkdir(parents=True, exist_ok=True)
        write_text(self.folder / "request.json", json.dumps(self._request))
        (self.folder / "result.json").unlink(missing_ok=True)
        path = json.dumps([os.path.abspath(place) for place in sys.path])
        pipe = asyncio.subprocess.PIPE
        self._process = process = await asyncio.create_subprocess_exec(
            sys.executable, "-P", "-c", _CODE, path, self.task, str(self.folder),
            stdin=asyncio.subprocess.DEVNULL, stdout=pipe, stderr=pipe, limit=_LONGEST_LINE, process_group=0,
        )  # fmt: skip
        if not self.running:  # cancelled before there was anything to end
            self._signal(signal.SIGKILL)
        assert process.stdout is not None
        assert process.stderr is not None
        _, words = await asyncio.gather(self._follow(process.stdout), process.stderr.read())
        return await process.wait(), words.decode(errors="replace")[-_LAST_WORDS:]

    async def cancel(self) -> None:
        """End the work; what it has written is whole or absent."""
        if not self.running:
            return
        self.state = "cancelled"
        self._signal(signal.SIGINT)
        process = self._process
        if process is not None:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(process.wait(), _GRACE_S)
            self._signal(signal.SIGKILL)

    def end(self) -> None:
        """End the work without waiting."""
        if self.running:
            self.state = "cancelled"
            self._signal(signal.SIGKILL)

    def _signal(self, number: int) -> None:
        """Send a signal to the child and all that it began."""
        if self._process is not None:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid, number)

    async def _follow(self, lines: asyncio.StreamReader) -> None:
        while True:
            try:
                line = await lines.readline()
            except ValueError:  # longer than any that is expected
                continue
            if not line:
                return
            with contextlib.suppress(ValueError):
                self._hear(json.loads(line))

    def _hear(self, said: dict[str, Any]) -> None:
        if "warning" in said:
            self.warnings.append(str(said["warning"]))
        elif "error" in said:
            self.message = str(said["error"])
        elif "step" in said:
            self.step, self.share = str(said["step"]), max(self.share, float(said.get("share", 0.0)))

    def _finish(self, code: int, words: str) -> None:
        try:
            self.result = json.loads((self.folder / "result.json").read_text(encoding="utf-8"))
            self.state = "done"
        except (OSError, ValueError):
            last = words.strip().splitlines()[-1:] or [f"its process ended with {code}"]
            self.message = self.message or f"the work could not be done: {last[0]}"
            self.state = "failed"
