"""Work spread over processes and machines: one protocol, equal results, dead workers tried once more, files that travel."""

import io
import math
import os
import pickle
import signal
import socket
import zipfile
from pathlib import Path

import pytest

from wsp_env.evaluation.carried import carry
from wsp_env.evaluation.controller import load
from wsp_env.executor import ClusterError, Processes, TaskFailedError, ThisProcess, Workers, pack, send, unpack
from wsp_env.executor import cluster as cluster_module
from wsp_env.executor.versions import difference, versions
from wsp_env.parameters.quantity import ParameterError


def square_root(number):
    """Return a square root as bytes; of numbers below 0 there is none."""
    if number < 0:
        raise TaskFailedError(f"has no root: {number}")
    return math.sqrt(number).hex().encode()


def dies_once(file):
    """End the process it runs in, unless somebody else has done so before."""
    if not Path(file).exists():
        Path(file).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return b"done"


def dies(_):
    os._exit(3)


def refuses(number):
    raise ParameterError(f"{number} is impossible")


@pytest.fixture(scope="module")
def cluster():
    """Return the executor of Ray, on this machine alone; its workers find this module."""
    ray = pytest.importorskip("ray", reason="the extra [cluster] is not installed")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAY_ADDRESS", "local")
        patch.setenv("PYTHONPATH", os.path.dirname(__file__), prepend=os.pathsep)
        yield Workers("ray", 2).make()
        ray.shutdown()


@pytest.fixture(params=["this process", "processes", "ray"])
def executor(request):
    if request.param == "ray":
        return request.getfixturevalue("cluster")
    return ThisProcess() if request.param == "this process" else Processes(2)


def test_results_do_not_depend_on_who_does_the_work(executor):
    tasks = [float(number) for number in range(-2, 20)]
    found = {task: (result, failure) for task, result, failure in executor.run(square_root, tasks)}
    expected = {
        number: (math.sqrt(number).hex().encode(), "") if number >= 0 else (b"", f"has no root: {number}") for number in tasks
    }
    assert found == expected


def test_no_tasks_are_done_at_once(executor):
    assert list(executor.run(square_root, [])) == []


def test_what_the_work_raises_is_raised(executor):
    with pytest.raises(ParameterError, match="3 is impossible"):
        list(executor.run(refuses, [3]))


@pytest.fixture(params=["processes", "ray"])
def others(request):
    """Return an executor whose tasks run in other processes."""
    return request.getfixturevalue("cluster") if request.param == "ray" else Processes(2)


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_a_task_whose_worker_was_killed_is_tried_once_more_and_reported(others, tmp_path):
    reported = []
    tasks = [str(tmp_path / name) for name in ("one", "two", "three")]
    Path(tasks[1]).touch()
    found = {task: (result, failure) for task, result, failure in others.run(dies_once, tasks, reported.append)}
    assert found == dict.fromkeys(tasks, (b"done", ""))
    assert sorted(line.partition(":")[0] for line in reported) == sorted([tasks[0], tasks[2]])
    assert all(line.endswith("ended the process it ran in; it is tried once more") for line in reported)


def test_a_task_that_ends_every_worker_fails_alone(others):
    reported = []
    (done,) = others.run(dies, ["task"], reported.append)
    assert done.failure == "ended the process it ran in, twice"
    assert len(reported) == 1


def test_without_a_listener_a_second_try_is_said_on_standard_error(capfd):
    list(Processes(1).run(dies, ["a task"]))
    assert "wsp: a task: ended the process it ran in; it is tried once more" in capfd.readouterr().err


def test_a_caller_that_breaks_off_ends_its_workers(others):
    doing = others.run(square_root, [1.0, 4.0, 9.0])
    assert next(doing).result
    doing.close()


def test_who_does_the_work_is_checked():
    with pytest.raises(ValueError, match="jobs = -1"):
        Workers(jobs=-1).make()


def test_without_ray_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "ray", None)
    with pytest.raises(ModuleNotFoundError, match=r"wsp-env\[cluster\]"):
        Workers("ray").make()


def test_a_cluster_that_is_gone_is_not_waited_for(monkeypatch, tmp_path):
    """Ray itself would wait for minutes for what `ray start` noted, and was ended without `ray stop`."""
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        there = f"127.0.0.1:{listening.getsockname()[1]}"
        monkeypatch.setenv("RAY_TMPDIR", str(tmp_path))
        monkeypatch.delenv("RAY_ADDRESS", raising=False)
        assert cluster_module._address() is None  # nothing noted: Ray begins one
        (tmp_path / "ray").mkdir()
        (tmp_path / "ray" / "ray_current_cluster").write_text(f"{there}\n")
        assert cluster_module._address() is None
        monkeypatch.setenv("RAY_ADDRESS", there)
        assert cluster_module._address() is None
    with pytest.raises(ClusterError, match=f"no cluster answers at {there}, the address in RAY_ADDRESS"):
        cluster_module._address()
    monkeypatch.delenv("RAY_ADDRESS")
    assert cluster_module._address() == "local"


def test_a_folder_travels_whole_and_in_equal_bytes(tmp_path):
    (tmp_path / "campaign" / "runs").mkdir(parents=True)
    files = {"campaign.toml": b"[campaign]", "runs/a.csv": bytes(range(256))}
    for name, content in files.items():
        (tmp_path / "campaign" / name).write_bytes(content)
    sent = pickle.loads(pickle.dumps(send(tmp_path / "campaign", far=True)))
    assert sent.content == pack(tmp_path / "campaign")
    with sent.here() as folder:
        assert folder != tmp_path / "campaign"
        assert folder.name == "campaign"  # what is read may be called by it
        assert {file.relative_to(folder).as_posix(): file.read_bytes() for file in folder.rglob("*.*")} == files
    assert not folder.exists()
    with send(tmp_path / "campaign", far=False).here() as folder:
        assert folder == tmp_path / "campaign"


def test_a_packed_file_cannot_leave_its_folder(tmp_path):
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        archive.writestr("../outside", b"x")
    with pytest.raises(ValueError, match="leads out"):
        unpack(content.getvalue(), tmp_path / "in")
    assert not (tmp_path / "outside").exists()


def test_a_controller_travels_with_what_lies_beside_it(tmp_path, monkeypatch):
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "beside.py").write_text("GAIN = 1\n")
    (folder / "unused.py").write_text("raise RuntimeError\n")
    (folder / "own.py").write_text(
        "import beside\n\n\nclass Own:\n    def reset(self, n, vehicle):\n        self.gain = beside.GAIN\n\n"
        "    def act(self, measurement):\n        return None\n"
    )
    monkeypatch.chdir(tmp_path)
    carried = pickle.loads(pickle.dumps(carry("mine/own.py:Own", far=True)))
    for file in folder.iterdir():
        file.unlink()
    with carried.here() as name:
        controller = load(name)
        controller.reset(1, None)
    assert controller.gain == 1
    assert carry("rule-based", far=True).sent is None
    assert carry("package.module:Class", far=True).sent is None


def test_machines_that_differ_are_named():
    own = versions()
    assert difference(own, own) == ""
    assert difference(own, own | {"numpy": "0.1"}) == f"numpy 0.1 and not {own['numpy']}"
