"""The executor of many machines: Ray."""

import os
import platform
import socket
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

from wsp_env import child
from wsp_env.executor.port import TRIES, Answer, ClusterError, Outcome, again, attempt, outcome_of, packed
from wsp_env.executor.versions import difference, versions

T = TypeVar("T")

#: Tasks that are sent ahead for every processor of the cluster, so that none waits for the next one.
_AHEAD = 2

#: A cluster whose port does not take a connection within so long [s] is not there (assumption).
_ANSWERS_WITHIN_S = 10.0


class Cluster:
    """Does tasks on the machines of a Ray cluster; without one, in processes of this machine that Ray starts.

    Parameters
    ----------
    jobs : tasks under way at once; None: as many as the cluster has processors
    processors : that a task takes

    """

    far = True

    def __init__(self, jobs: int | None = None, processors: int = 1) -> None:
        self._ray = _ray()
        self._jobs, self._processors = jobs, processors

    def run(
        self, work: Callable[[T], bytes], tasks: Sequence[T], report: Callable[[str], None] | None = None
    ) -> Iterator[Outcome[T]]:
        """Yield every task with its outcome, see `Executor`."""
        ray = self._ray
        remote = ray.remote(max_retries=0, num_cpus=self._processors)(serve)
        waiting = [(index, 1) for index in reversed(range(len(tasks)))]
        running: dict[Any, tuple[int, int]] = {}
        own = versions()
        try:
            while waiting or running:
                while waiting and len(running) < self._at_once():
                    index, number = waiting.pop()
                    running[remote.remote(work, tasks[index], own)] = (index, number)
                (ready, *_), _ = ray.wait(list(running), num_returns=1)
                index, number = running.pop(ready)
                try:
                    answer: Answer = ray.get(ready)
                except ray.exceptions.RayTaskError as error:  # of what stands around the work: it could not be imported, say
                    raise ClusterError(f"a machine of the cluster could not begin a task: {error.cause}") from error
                except ray.exceptions.RayError as error:  # its process or its machine has died
                    how = _words(error)
                    if number < TRIES:
                        again(tasks[index], how, report)
                        waiting.append((index, number + 1))
                        continue
                    answer = Answer(failure=f"{how}, twice")
                yield outcome_of(tasks[index], answer)
        finally:
            for reference in running:
                ray.cancel(reference, force=True)

    def _at_once(self) -> int:
        """Return how many tasks may be under way; a cluster may grow meanwhile."""
        processors = int(self._ray.cluster_resources().get("CPU", 1))
        return self._jobs or _AHEAD * max(1, processors // self._processors)


def serve(work: Callable[[Any], bytes], task: Any, expected: dict[str, str]) -> Answer:
    """Do a task in a process of Ray's."""
    child.become_expendable()
    if other := difference(expected, versions()):
        return Answer(error=packed(ClusterError(f"{platform.node()} has {other}: all machines of a cluster need the same")))
    return attempt(work, task)


def _words(error: Exception) -> str:
    """Say in a line how a task's process ended."""
    kind = type(error).__name__
    if kind == "OutOfMemoryError":
        return f"{child.ENDED}, for lack of memory"
    return child.ENDED if kind == "WorkerCrashedError" else f"{child.ENDED} ({kind})"


def _ray() -> Any:
    """Return Ray, connected: to the cluster that RAY_ADDRESS or `ray start` names, else to one of this machine alone."""
    try:
        import ray
    except ImportError:
        raise ModuleNotFoundError('--executor ray needs Ray: pip install "wsp-env[cluster]"') from None
    if not ray.is_initialized():
        try:
            ray.init(_address(), log_to_driver=False, include_dashboard=False, logging_level="ERROR")
        except ConnectionError as error:
            token = "where it asks for a token: RAY_AUTH_MODE=token, and ~/.ray/auth_token of its first machine"
            raise ClusterError(f"Ray cannot be reached: {error}; {token}") from None
    return ray


def _address() -> str | None:
    """Return where Ray is to connect to: None, as it finds out itself, or "local", a cluster of its own.

    What `ray start` has noted stays there when its processes were ended otherwise than by `ray stop`; Ray would wait for them
    for minutes, and give up.
    """
    named = os.environ.get("RAY_ADDRESS", "")
    if named and not _answers(named):
        raise ClusterError(
            f"no cluster answers at {named}, the address in RAY_ADDRESS: ray start --head there, or name another"
        )
    if named:
        return None
    try:
        noted = (_temporary() / "ray" / "ray_current_cluster").read_text(encoding="utf-8").strip()
    except OSError:
        return None
    return None if _answers(noted) else "local"


def _answers(address: str) -> bool:
    """Whether somebody listens at an address, HOST:PORT; of any other form it is for Ray to say."""
    host, colon, port = address.rpartition(":")
    if not colon or "/" in host or not port.isdigit():
        return True
    try:
        socket.create_connection((host.strip("[]"), int(port)), _ANSWERS_WITHIN_S).close()
    except OSError:
        return False
    return True


def _temporary() -> Path:
    """Return the folder in which Ray 2.60 keeps its own."""
    if named := os.environ.get("RAY_TMPDIR") or (os.environ.get("TMPDIR") if sys.platform == "linux" else None):
        return Path(named)
    return Path("/tmp" if os.name == "posix" else tempfile.gettempdir())
