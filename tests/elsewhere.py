"""An executor that does as another machine does, for tests of what travels."""

import pickle

from wsp_env.executor import ThisProcess


class Elsewhere(ThisProcess):
    """Gets what is sent, and works in folders of its own; the last task is ready first."""

    far = True

    def run(self, work, tasks, report=None):
        for task in reversed(tasks):
            there = pickle.loads(pickle.dumps(task))
            for outcome in super().run(work, [there], report):
                yield outcome._replace(task=task)
