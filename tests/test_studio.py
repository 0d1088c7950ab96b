"""The studio without its pages: who may ask, what is kept per workspace, work in children, stops as programs."""

import asyncio
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from strange_csvs import NAMELESS, write_six

from wsp_env.cli import main
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.recordings import read_campaign
from wsp_env.recordings.inspection import inspect
from wsp_env.studio.desk import FIRST, MECHANISMS, Desk
from wsp_env.studio.files import File
from wsp_env.studio.gate import Gate
from wsp_env.studio.jobs import Job
from wsp_env.studio.stop import Choice, braked
from wsp_env.studio.work import BUCKETS, envelope
from wsp_env.studio.workspace import MOST_BYTES, RefusedError, Workspace

TOKEN, PORT, MOST = "right", 8080, 1000
HOST = (b"host", b"127.0.0.1:8080")
COOKIE = (b"cookie", b"other=1; wsp_studio_8080=right")


def asked(path="/", headers=(HOST, COOKIE), method="GET", kind="http", query=b""):
    """Return the status and headers of an answer, and whether the request reached what lies behind the gate."""
    reached, sent = [], []

    async def behind(scope, receive, send):
        reached.append(scope)
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def send(message):
        sent.append(message)

    scope = {"type": kind, "method": method, "path": path, "query_string": query, "headers": list(headers)}
    asyncio.run(Gate(behind, TOKEN, PORT, MOST)(scope, None, send))
    return sent[0].get("status", sent[0]["type"]), dict(sent[0].get("headers", ())), bool(reached)


def test_the_token_is_exchanged_for_a_cookie_and_leaves_the_address():
    status, headers, reached = asked("/desk", [HOST], query=b"a=1&token=right")
    assert (status, headers[b"location"], reached) == (303, b"/desk?a=1", False)
    cookie = headers[b"set-cookie"].decode()
    assert cookie.startswith("wsp_studio_8080=right;")
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert asked()[2]
    _, headers, _ = asked("//evil.example/\r\nx", [HOST], query=b"token=right")
    assert headers[b"location"] == b"/evil.example/%0D%0Ax"


@pytest.mark.parametrize(
    "headers",
    [
        [HOST],
        [HOST, (b"cookie", b"wsp_studio_8080=wrong")],
        [HOST, (b"cookie", b"wsp_studio_8081=right")],
        [HOST, (b"cookie", b"\xff=;;")],
        [(b"host", b"evil.example:8080"), COOKIE],
        [(b"host", b"127.0.0.1:80"), COOKIE],
        [COOKIE],
    ],
)
def test_without_token_or_by_another_name_nobody_gets_in(headers):
    for kind in ("http", "websocket"):
        status, _, reached = asked(headers=headers, kind=kind)
        assert (status, reached) == (403 if kind == "http" else "websocket.close", False)
    assert not asked(headers=[HOST], query=b"token=wrong")[2]


def test_another_page_cannot_write_or_listen():
    foreign = [HOST, COOKIE, (b"origin", b"http://evil.example"), (b"content-length", b"1")]
    assert not asked(headers=foreign, method="POST")[2]
    assert not asked(headers=foreign, kind="websocket")[2]
    own = [HOST, COOKIE, (b"origin", b"http://127.0.0.1:8080"), (b"content-length", b"1")]
    assert asked(headers=own, method="POST")[2]
    assert asked(headers=own, kind="websocket")[2]


@pytest.mark.parametrize("length", [None, b"1001", b"-1", b"1e3", b""])
def test_a_body_is_refused_before_it_is_read(length):
    stated = [] if length is None else [(b"content-length", length)]
    status, _, reached = asked(headers=[HOST, COOKIE, *stated], method="POST")
    assert (status, reached) == (413, False)


def test_every_answer_keeps_pages_to_their_own_server():
    _, headers, _ = asked()
    assert b"default-src 'self'" in headers[b"content-security-policy"]
    assert b"http:" not in headers[b"content-security-policy"]


def filled(folder, files):
    """Return a workspace that has looked at files, without a child."""
    space = Workspace(folder)
    for file in files:
        place = space.place(file.name, file.stat().st_size)
        place.write_bytes(file.read_bytes())
        space.add(place)
    for file in space.files.values():
        file.channels, file.looked = inspect(file.path), True
        file.rows = max(one.samples for one in file.channels)
    space._suggest()
    return space


@pytest.fixture(scope="module")
def six(tmp_path_factory):
    return write_six(tmp_path_factory.mktemp("six"), duration_s=4.0)


def test_six_strange_files_become_a_campaign_that_reads_as_mapped(six, tmp_path):
    space = filled(tmp_path, six)
    assert space.missing == ["the vehicle's speed"]
    with pytest.raises(RefusedError, match="the vehicle's speed"):
        space.campaign_text()
    with pytest.raises(RefusedError, match="unit"):
        space.choose("vehicle_speed", NAMELESS, "kN")
    space.choose("vehicle_speed", NAMELESS, "km/h")
    with pytest.raises(RefusedError, match="mass"):
        space.campaign_text()
    space.take_vehicle(COACH, "coach")
    space.write_campaign()
    campaign = read_campaign(space.recordings)
    assert len(campaign.runs) == 6
    assert len(campaign.validate) == 2
    assert campaign.vehicle.mass_kg == COACH.mass_kg
    for run in campaign.runs.values():
        assert run.vehicle_speed_mps[0] == pytest.approx(35.0, abs=0.1)
        assert np.median(run.wheel_speed_radps[:50]) * COACH.wheel_radius_m == pytest.approx(35.0, rel=0.05)


def test_what_is_left_out_or_changed_is_no_longer_in_the_campaign(six, tmp_path):
    space = filled(tmp_path, six)
    space.choose("vehicle_speed", NAMELESS, "km/h")
    space.take_vehicle(COACH, "coach")
    space.files[six[0].name].group = "left out"
    space.remove(six[1].name)
    space.write_campaign()
    assert sorted(read_campaign(space.recordings).runs) == sorted(file.stem for file in six[2:])


@pytest.mark.parametrize("name", ["../../x.csv", "..\\x.csv", "/etc/x.csv", "x\0.csv", "a" * 500 + ".csv", "<b>.csv", "‮.csv"])
def test_a_file_stays_in_its_workspace(tmp_path, name):
    place = Workspace(tmp_path).place(name, 1)
    assert place.parent == tmp_path / "campaign"
    place.write_text("x")


@pytest.mark.parametrize(("name", "size"), [("x.exe", 1), ("csv", 1), (".csv", 1), ("x.csv", MOST_BYTES + 1)])
def test_files_of_other_kinds_or_too_many_bytes_are_refused(tmp_path, name, size):
    with pytest.raises(RefusedError):
        Workspace(tmp_path).place(name, size)


def test_an_envelope_keeps_lowest_and_highest_and_is_short():
    values = np.sin(np.linspace(0.0, 300.0, 100_000))
    values[77_777], values[5] = 9.0, np.nan
    drawn = envelope(np.arange(100_000.0), values)
    assert drawn.shape == (2, 2 * BUCKETS)
    assert drawn[1].max() == 9.0
    assert drawn[1].min() == pytest.approx(-1.0, abs=1e-4)


@pytest.mark.slow
def test_a_child_looks_at_files_and_a_broken_one_harms_no_other(six, tmp_path):
    space = Workspace(tmp_path)
    broken = space.recordings / "broken.mat"
    broken.write_bytes(b"MATLAB 5.0 MAT-file" + bytes(range(256)) * 20)
    good = space.recordings / six[0].name
    good.write_bytes(six[0].read_bytes())
    space.files = {file.name: File(file) for file in (broken, good)}
    asyncio.run(space.look())
    assert space.jobs["look"].state == "done"
    assert "broken.mat" in space.files["broken.mat"].error
    assert str(tmp_path) not in space.files["broken.mat"].error
    assert space.files[six[0].name].rows == 400
    assert space.curve(good_file := space.files[six[0].name], good_file.channels[0].name).shape[0] == 2


@pytest.mark.slow
def test_work_is_cancelled_at_once_and_nothing_of_it_lives_on(tmp_path):
    async def begun():
        job = Job("brake", tmp_path, {"stops": [vars(Choice(speed_kmh=200.0, mu_cd=0.02, vehicle="train"))] * 2})
        work = asyncio.create_task(job.run())
        while job._process is None:
            await asyncio.sleep(0.01)
        process = job._process.pid
        began = time.monotonic()
        await job.cancel()
        await work
        return job, process, time.monotonic() - began

    job, process, took = asyncio.run(begun())
    assert job.state == "cancelled"
    assert took < 30.0
    assert not Path(f"/proc/{process}").exists()
    assert not (tmp_path / "result.json").exists()


@pytest.mark.skipif(sys.platform != "linux", reason="the system ends children with their parent on Linux")
@pytest.mark.slow
def test_no_child_outlives_a_killed_studio(tmp_path):
    code = (
        "import asyncio, sys; from pathlib import Path; from wsp_env.studio.jobs import Job\n"
        "async def go():\n"
        "    job = Job('brake', Path(sys.argv[1]), {'stops': [{'vehicle': 'train'}] * 2})\n"
        "    work = asyncio.create_task(job.run())\n"
        "    while job.step == 'starting': await asyncio.sleep(0.05)\n"
        "    print(job._process.pid, flush=True); await work\n"
        "asyncio.run(go())"
    )
    parent = subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE, text=True, env=dict(os.environ)
    )
    child = parent.stdout.readline().strip()
    parent.kill()
    parent.wait()
    deadline = time.monotonic() + 30.0
    while _lives(child) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not _lives(child)


def _lives(process):
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.slow
@pytest.mark.parametrize(
    "choice",
    [
        Choice(speed_kmh=40.0),
        Choice(speed_kmh=40.0, controller="adaptive", track="patches", seed=3, mechanisms={"vehicle_mass": {"extra": 0.1}}),
        Choice(speed_kmh=40.0, controller="none", recovering=False, vehicle="bogie", load=0.5),
    ],
    ids=lambda choice: choice.controller,
)
def test_the_program_of_a_stop_brakes_the_same_stop(choice, tmp_path):
    found = braked(choice)
    (tmp_path / "stop.py").write_text(choice.code(), encoding="utf-8")
    done = subprocess.run([sys.executable, str(tmp_path / "stop.py")], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == f"{found['distance_m']:.2f} m in {found['time_s']:.2f} s"
    course = found["course"]
    assert course["position_m"][-1] == pytest.approx(found["distance_m"], abs=1e-4)
    assert len(course["wheel_mps"][0]) == len(found["vehicle"]["axle_positions_m"])


def test_a_desk_refuses_what_cannot_be_and_takes_every_mechanism(tmp_path):
    desk = Desk(tmp_path)
    with pytest.raises(RefusedError, match="controller"):
        desk.choose(0, controller="evil.py")
    with pytest.raises(RefusedError):
        desk.choose(0, nothing=1)
    for name in MECHANISMS:
        desk.add(1, name)
    assert set(desk.choices[1].mechanisms) == set(MECHANISMS)
    assert desk.choices[0] == FIRST[0]
    compile(desk.choices[1].code(), "stop", "exec")


def test_the_command_says_which_extra_is_missing(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "nicegui", None)
    assert main(["studio"]) == 2
    assert 'pip install "wsp-env[studio]"' in capsys.readouterr().err
    assert main(["studio", "--port", "70000"]) == 2
    assert "port" in capsys.readouterr().err
