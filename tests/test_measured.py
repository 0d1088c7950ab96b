"""The experiments on measured data, tried on made data: a drive with dry friction, a robot that crosses a border."""

import numpy as np
import pytest
from scipy.io import savemat

from experiments.measured import __main__, emps, lone, robot
from experiments.measured.files import DRIVE_FILES, MeasuredError, Run, drives, one_surface
from experiments.measured.page import fill, table

MASS, VISCOUS, DRY, OFFSET = 95.0, 200.0, 20.0, -3.0
MM = 1.8  # per pixel


@pytest.fixture(scope="module")
def drive_folder(tmp_path_factory):
    """Two recordings of a drive of mass, viscous and dry friction and an offset, noise on force and position."""
    folder = tmp_path_factory.mktemp("drive")
    rng = np.random.default_rng(1)
    time = np.arange(0.0, 15.0, 1e-3)
    for name in DRIVE_FILES:
        # Cycles of 3 s, a faster wave on them so that mass, viscous and dry friction are told apart.
        w = 2.0 * np.pi / 3.0
        q = 0.1 * (1.0 - np.cos(w * time)) + 0.01 * np.sin(3.0 * w * time)
        v = 0.1 * w * np.sin(w * time) + 0.03 * w * np.cos(3.0 * w * time)
        a = 0.1 * w**2 * np.cos(w * time) - 0.09 * w**2 * np.sin(3.0 * w * time)
        force = MASS * a + VISCOUS * v + DRY * np.sign(v) + OFFSET + rng.normal(0.0, 1.0, len(time))
        measured = q + rng.normal(0.0, 1e-6, len(time))
        savemat(folder / name, {"t": time, "qm": measured, "qg": q, "vir": force / 35.0, "gtau": 35.0})
    return folder


@pytest.fixture(scope="module")
def drive_rows(drive_folder):
    return emps.rows(drives(drive_folder))


def test_dry_friction_is_found_first_then_the_offset_then_nothing(drive_rows):
    found = emps.find(drive_rows)
    first, second = found.chosen
    assert first.term.name == "sign(v)"
    # Beside dry friction an offset is the same as more of it on one way: three names of one law, and the answer says so.
    assert {"offset", "sign(v), forward only", "sign(v), backward only"} <= {second.term.name, *second.alternatives}
    assert found.refused is None
    both = emps.fitted(drive_rows, ("sign(v)", "offset")).values
    assert both["sign(v)"] == pytest.approx(DRY, rel=0.01)
    assert both["offset"] == pytest.approx(OFFSET, rel=0.03)
    last = emps.steps(drive_rows, found)[-1]
    assert last.values["M"] == pytest.approx(MASS, rel=0.01)
    assert last.values["F_v"] == pytest.approx(VISCOUS, rel=0.02)


def test_each_term_lowers_the_held_out_error(drive_rows):
    errors = [one.error_held_out for one in emps.steps(drive_rows, emps.find(drive_rows))]
    assert errors == sorted(errors, reverse=True)


def test_nothing_is_found_in_a_drive_of_mass_and_viscous_friction(drive_rows):
    plain = drive_rows.baseline @ [MASS, VISCOUS]
    rng = np.random.default_rng(2)
    assert emps.find(drive_rows._replace(force=plain + rng.normal(0.0, 0.3, len(plain)))).chosen == ()


def test_cycles_begin_where_the_drive_sets_out_forward():
    time = np.arange(0.0, 10.0, 0.01)
    cycle = emps._cycles(1.0 - np.cos(2.0 * np.pi * time / 2.5))
    assert cycle.max() == 3
    assert np.flatnonzero(np.diff(cycle)) * 0.01 == pytest.approx([2.5, 5.0, 7.5], abs=0.03)


def robot_run(number: int, direction: float, border: float | None, rng: np.random.Generator, drift: float = 0.0) -> Run:
    """A robot that drives up the picture: 10 N on the floor, 30 N more with all wheels beyond a line, slip 0.1 or 0.5."""
    n, step = 300, 0.03
    angle = np.pi - direction  # so that the set direction points up the picture
    speed = 0.2 * np.array([np.cos(direction), np.sin(direction)])
    motors = (-np.sin(robot.WHEELS) * speed[0] + np.cos(robot.WHEELS) * speed[1]) / robot.WHEEL_RADIUS * robot.GEAR
    share = np.abs(motors) * robot.WHEEL_RADIUS / robot.GEAR / 0.2
    place, places, currents, steps = np.array([800.0, 900.0]), [], [], []
    for _ in range(n):
        wheels = place + robot._wheel_places(np.array([angle]), MM)[0]
        beyond = 0.0 if border is None else float((wheels[:, 0] > border).mean())
        force = 10.0 + 30.0 * beyond + rng.normal(0.0, 2.0)
        currents.append(share * force / (share @ share) / robot.NEWTON_PER_AMPERE)
        local = speed * (1.0 - 0.1 - 0.4 * beyond) * step * 1e3  # [mm]
        steps.append(local)
        sine, cosine = np.sin(angle), np.cos(angle)
        moved = np.array([-sine * local[0] - cosine * local[1], -cosine * local[0] + sine * local[1]])
        place = place + moved / MM + np.array([drift, 0.0])
        places.append(place)
    time = np.arange(n) * step
    wheels_speed = np.tile(motors, (n, 1))
    return Run(
        f"{number}", time, speed, motors, wheels_speed, np.array(currents), np.array(places), np.full(n, angle), np.array(steps)
    )


@pytest.fixture(scope="module")
def robot_runs():
    rng = np.random.default_rng(3)
    directions = np.radians(np.arange(0.0, 360.0, 15.0))
    alone = [robot_run(i, d, None, rng) for i, d in enumerate(directions)]
    # Some to the right, some to the left, over a border that the left wheels have not reached at the start.
    across = [robot_run(i, d, 830.0, rng, 0.5 - (i % 3) * 0.4) for i, d in enumerate(directions)]
    return tuple([robot.blocks(one, MM) for one in runs] for runs in (alone, across)), alone


def test_the_scale_of_the_picture_comes_from_the_files_own_steps(robot_runs):
    assert robot.scale(robot_runs[1]) == pytest.approx(MM, rel=1e-2)


def test_a_robot_that_follows_its_wheels_has_the_slip_it_has(robot_runs):
    (alone, _), _ = robot_runs
    assert np.concatenate([one.slip for one in alone]) == pytest.approx(0.1, abs=1e-6)


def test_force_is_that_of_the_currents_along_the_direction(robot_runs):
    (alone, _), _ = robot_runs
    assert np.array([one.force.mean() for one in alone]) == pytest.approx(10.0, abs=0.6)


def test_the_border_is_found_and_where_it_is(robot_runs):
    (alone, across), _ = robot_runs
    model = robot.identify("floor", alone)
    found = robot.find(robot.campaign(across, model), model, most=1)
    one = found.chosen[0]
    assert one.term.name in ("wheels beyond x = 820", "wheels beyond x = 840")
    assert one.amplitude[0] == pytest.approx(30.0, rel=0.1)
    assert lone.border(across, [run.slip for run in across])[0] == pytest.approx(830.0, abs=10.0)
    crossing = [run for run in across if np.isfinite(lone.crossings(run, 830.0)).any()]
    lines = [lone.change(run, model).line for run in crossing]
    assert len(crossing) >= 8
    assert np.median(np.abs(np.array(lines) - 830.0)) <= 10.0


def test_one_floor_has_no_border(robot_runs):
    (alone, _), _ = robot_runs
    model = robot.identify("floor", alone[::2])
    assert robot.find(robot.campaign(alone[1::2], model), model).chosen == ()


def test_a_wrong_path_is_one_line(tmp_path, capsys, monkeypatch):
    for what, word in (("emps", DRIVE_FILES[0]), ("robot", "one_surface")):
        monkeypatch.setattr("sys.argv", ["measured", what, str(tmp_path)])
        assert __main__.main() == 1
        error = capsys.readouterr().err
        assert error.startswith("error: ")
        assert error.count("\n") == 1
        assert word in error


def test_a_file_that_is_none_is_named(tmp_path):
    folder = tmp_path / "one_surface" / "table_surface"
    folder.mkdir(parents=True)
    (folder / "exp00.csv").write_text("a\nb\nc\n1;2\n", encoding="utf-8")
    with pytest.raises(MeasuredError, match=r"exp00\.csv is not a run"):
        one_surface(tmp_path, "table")
    (tmp_path / DRIVE_FILES[0]).write_text("no", encoding="utf-8")
    with pytest.raises(MeasuredError, match=r"DATA_EMPS\.mat is not a recording"):
        drives(tmp_path)


def test_the_page_takes_its_blocks_and_keeps_the_rest(tmp_path):
    page = tmp_path / "measured.md"
    page.write_text("before\n<!-- begin: a -->\nold\n<!-- end: a -->\nafter\n", encoding="utf-8")
    fill(tmp_path, {"a": table(["x"], [["1"]])})
    assert page.read_text(encoding="utf-8") == "before\n<!-- begin: a -->\n| x |\n| --- |\n| 1 |\n<!-- end: a -->\nafter\n"
    with pytest.raises(MeasuredError, match="no place for b"):
        fill(tmp_path, {"b": ""})
