"""Work spread over processes or machines: one protocol, see `port`."""

import dataclasses
from typing import Literal

from wsp_env.executor.local import Processes, ThisProcess
from wsp_env.executor.parcel import Sent, pack, send, unpack
from wsp_env.executor.port import ClusterError, Executor, Outcome, TaskFailedError

__all__ = [
    "ClusterError", "Executor", "Outcome", "Processes", "Sent", "TaskFailedError", "ThisProcess", "Workers", "pack", "send",
    "unpack",
]  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Workers:
    """Who does the work, and how many; the results do not depend on it.

    Parameters
    ----------
    executor
        Processes of this machine, or those of a Ray cluster.
    jobs
        Tasks done at once; 0: one per processor.

    """

    executor: Literal["local", "ray"] = "local"
    jobs: int = 0

    def make(self, processors: int = 1) -> Executor:
        """Return the executor; `processors` that a task takes.

        Raises
        ------
        ValueError
            for an impossible number
        ModuleNotFoundError
            where Ray is asked for and not installed

        """
        if self.jobs < 0:
            raise ValueError(f"jobs = {self.jobs}: at least 0")
        if self.executor == "ray":
            from wsp_env.executor.cluster import Cluster

            return Cluster(self.jobs or None, processors)
        return Processes(self.jobs or None, processors)
