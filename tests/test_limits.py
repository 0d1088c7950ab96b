"""Code of others has its time, its process ends with ours, and a network that nothing could interrupt is refused."""

import itertools
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections import deque

import numba
import numpy as np
import pytest
from onnx import TensorProto, helper
from test_policy import network, stop, write
from waiting import runs, until

from wsp_env import child
from wsp_env.child import TookTooLongError, limited
from wsp_env.evaluation import runner
from wsp_env.evaluation.controller import load
from wsp_env.evaluation.network import check_network
from wsp_env.evaluation.runner import ControllerFailure
from wsp_env.executor import Processes, TaskFailedError
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.uic_z1 import BOGIE

posix = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")


@posix
def test_time_is_limited_and_other_timers_go_on():
    heard = []
    before = signal.signal(signal.SIGALRM, lambda *_: heard.append(1))
    signal.setitimer(signal.ITIMER_REAL, 100.0)
    try:
        with pytest.raises(TookTooLongError):
            _wait_limited(0.2)
        left, _ = signal.setitimer(signal.ITIMER_REAL, 0.0)
        assert 0.0 < left <= 100.0
    finally:
        signal.signal(signal.SIGALRM, before)
    assert not heard


@posix
def test_what_numba_compiles_does_not_count():
    def compile_anew():
        numba.njit(lambda x: (x * x).sum())(np.ones(2))

    compile_anew()  # the first one also initialises the compiler
    begun = time.process_time()
    compile_anew()
    limit = 0.3 * (time.process_time() - begun)
    with limited(limit):
        compile_anew()
    with pytest.raises(TookTooLongError):
        _wait_limited(limit, compile_anew)


def _wait_limited(seconds, before=lambda: None):
    with limited(seconds):
        before()
        while True:
            pass


class Endless:
    """Never answers, and lets no exception through."""

    def reset(self, n, vehicle):
        """Begin."""

    def act(self, measurement):
        while True:
            try:
                while True:
                    pass
            except Exception:
                continue


@posix
def test_a_decision_has_a_limit(monkeypatch):
    monkeypatch.setattr(runner, "DECISION_LIMIT_S", 0.2)
    with pytest.raises(ControllerFailure, match=r"Endless.act took more than 0.2 s of the processor at 0.00 s"):
        runner.run(Endless(), BOGIE, [stop()])


@posix
def test_a_file_that_never_ends_is_not_waited_for(tmp_path, monkeypatch):
    monkeypatch.setattr("wsp_env.evaluation.controller.LOADING_LIMIT_S", 0.2)
    (tmp_path / "endless.py").write_text("while True:\n    pass\n")
    with pytest.raises(ParameterError, match="of the processor to be loaded"):
        load(str(tmp_path / "endless.py"))


@pytest.mark.parametrize(
    "code",
    ["import os\n\nos._exit(3)\n", "from os import _exit\n\n\nclass Dies:\n    def __init__(self):\n        _exit(3)\n\n"
     "    def reset(self, n, vehicle):\n        pass\n\n    def act(self, seen):\n        pass\n"],
    ids=["loaded", "made"],
)  # fmt: skip
def test_a_file_that_ends_the_process_is_refused(tmp_path, code):
    (tmp_path / "dies.py").write_text(code)
    end = os._exit
    with pytest.raises(ParameterError, match=r"it calls os\._exit\(3\); a controller must not end its process"):
        load(str(tmp_path / "dies.py"))
    assert os._exit is end


def task(what):
    """Do what a controller may do in its process."""
    if what == "dies":
        os._exit(3)
    if what == "raises":
        raise ParameterError("no")
    if what == "swallows":
        child._GRACE_S = 0.3
        with limited(0.2):
            while True:
                try:
                    while True:
                        pass
                except BaseException:
                    continue
    if what == "native":  # a single call into compiled code
        child._GRACE_S = 0.3
        with limited(0.2):
            deque(itertools.repeat(0), maxlen=0)
    if what == "fails":
        raise TaskFailedError("failed")
    return what.encode()


@pytest.mark.long
@posix
def test_workers_die_alone():
    tasks = ["works", "dies", "swallows", "fails", "native"]
    reported = []
    found = {done.task: done for done in Processes(2).run(task, tasks, reported.append)}
    assert set(found) == set(tasks)
    assert found["works"].result == b"works"
    assert not found["works"].failure
    assert found["fails"].failure == "failed"
    assert found["dies"].failure == "ended the process it ran in, twice"
    assert found["swallows"].failure == found["native"].failure == "took too long and was ended"
    assert reported == ["dies: ended the process it ran in; it is tried once more"]  # a limit of time would end it again


def test_what_a_worker_raises_is_raised():
    with pytest.raises(ParameterError, match="no"):
        list(Processes(1).run(task, ["raises"]))


PARENT = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell starts what runs in its background deaf to it
sys.path.insert(0, {tests!r})
import test_limits
from wsp_env.executor import Processes
if __name__ == "__main__":
    for _ in Processes(1).run(test_limits.lingers, ["{file}"]):
        pass
"""


def lingers(file):
    """Say who it is, then never end."""
    with open(file, "w") as out:
        json.dump(os.getpid(), out)
    while True:
        pass


@posix
@pytest.mark.parametrize("ended_by", [signal.SIGINT, pytest.param(signal.SIGKILL, marks=pytest.mark.long)])
def test_no_worker_outlives_its_parent(tmp_path, ended_by):
    file = tmp_path / "worker"
    code = tmp_path / "parent.py"
    code.write_text(PARENT.format(tests=os.path.dirname(__file__), file=file))
    parent = subprocess.Popen([sys.executable, str(code)], stderr=subprocess.DEVNULL)
    until(lambda: file.exists() and file.read_text())
    worker = json.loads(file.read_text())
    parent.send_signal(ended_by)
    parent.wait(60)
    until(lambda: not runs(worker))


def blocked(what):
    """Say which signals wait."""
    return ",".join(one.name for one in signal.pthread_sigmask(signal.SIG_BLOCK, [])).encode()


@posix
def test_a_worker_that_is_just_being_started_says_nothing_of_ctrl_c():
    (done,) = Processes(1).run(blocked, [""])
    assert done.result == b"SIGINT"
    assert not signal.pthread_sigmask(signal.SIG_BLOCK, [])


@posix
@pytest.mark.parametrize("beside", [0, 3], ids=["alone", "beside threads"])
def test_ctrl_c_while_a_worker_is_begun_is_not_lost(beside):
    begun, over = [], threading.Event()
    threads = [threading.Thread(target=over.wait) for _ in range(beside)]

    def begin():
        with child.deaf_children():
            os.kill(os.getpid(), signal.SIGINT)
            begun.append(1)

    for thread in threads:
        thread.start()
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # shells start what runs behind deaf to it
    try:
        with pytest.raises(KeyboardInterrupt):
            begin()
        after = signal.getsignal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)
        over.set()
    assert begun
    assert after is signal.default_int_handler


def model(nodes, outputs=(("command", TensorProto.FLOAT, ["N", 2]),), constants=(), functions=(), domains=("",)):
    inputs = [helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["N", 34])]
    made = [helper.make_tensor_value_info(*one) for one in outputs]
    graph = helper.make_graph(nodes, "g", inputs, made, constants)
    opsets = [helper.make_opsetid(domain, 17) for domain in domains]
    return helper.make_model(graph, opset_imports=opsets, ir_version=9, functions=functions).SerializeToString()


def endless_loop():
    """A loop of 2**62 rounds."""
    body = helper.make_graph(
        [helper.make_node("Identity", ["go"], ["on"])], "body",
        [helper.make_tensor_value_info("i", TensorProto.INT64, []), helper.make_tensor_value_info("go", TensorProto.BOOL, [])],
        [helper.make_tensor_value_info("on", TensorProto.BOOL, [])],
    )  # fmt: skip
    numbers = [
        helper.make_tensor("times", TensorProto.INT64, [], [2**62]),
        helper.make_tensor("yes", TensorProto.BOOL, [], [1]),
    ]
    return model([helper.make_node("Loop", ["times", "yes"], [], body=body)], constants=numbers)


def elsewhere():
    kept = helper.make_tensor("w", TensorProto.FLOAT, [2], [1.0, 2.0])
    kept.ClearField("float_data")
    kept.data_location = TensorProto.EXTERNAL
    kept.external_data.add(key="location", value="/etc/passwd")
    return model([helper.make_node("Add", ["observation", "w"], ["command"])], constants=[kept])


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (endless_loop(), "graph within a graph"),
        (elsewhere(), "numbers in other files"),
        (model([helper.make_node("SequenceConstruct", ["observation"], ["command"])]), "'SequenceConstruct'"),
        (model([helper.make_node("Optional", ["observation"], ["command"])]), "'Optional'"),
        (model([helper.make_node("Run", ["observation"], ["command"], domain="evil")], domains=("", "evil")), "of 'evil'"),
        (b"", "no graph"),
        (b"\xff" * 50, "damaged"),
        (network()[:-7], "damaged"),
    ],
)
def test_networks_that_are_refused_before_they_are_loaded(content, said, tmp_path):
    with pytest.raises(ValueError, match=said):
        check_network(content)
    with pytest.raises(ParameterError, match=f"policy.onnx is refused: .*{said}"):
        load(write(tmp_path, content=content))


@pytest.mark.parametrize("shape", [[], [2], ["N", 3], ["N", 2, 1]])
def test_outputs_that_are_no_table_are_refused(shape, tmp_path):
    axes = helper.make_tensor("axes", TensorProto.INT64, [2], [0, 1])
    zero = helper.make_tensor(
        "zero",
        TensorProto.FLOAT,
        shape if "N" not in shape else [1] * len(shape),
        [0.0] * max(int(np.prod([one for one in shape if one != "N"])) if "N" not in shape else 1, 1),
    )
    content = model(
        [helper.make_node("Identity", ["zero"], ["command"])], (("command", TensorProto.FLOAT, shape),), [zero, axes]
    )
    with pytest.raises(ParameterError, match=r"tables of floats|cannot be loaded"):
        load(write(tmp_path, content=content))


def test_what_came_along_is_not_refused():
    check_network(network())
