"""Evaluation: every stop of every controller, resuming, several processes, bad controllers, the report."""

import json
from pathlib import Path

import numpy as np
import polars
import pytest
from browser import BROWSER, open_page
from elsewhere import Elsewhere

from wsp_env import cli
from wsp_env.evaluation import evaluate as module
from wsp_env.evaluation import results
from wsp_env.evaluation.bound import SlideLimit
from wsp_env.evaluation.controller import load, read_settings
from wsp_env.evaluation.evaluate import BOUND, KEYS, REFERENCE, evaluate
from wsp_env.evaluation.figures import FIGURES
from wsp_env.evaluation.programme import (
    Case,
    Draws,
    Programme,
    Requirement,
)
from wsp_env.evaluation.programme_report import write_report
from wsp_env.evaluation.runner import Conduct
from wsp_env.evaluation.sources import code_digest, imported_beside
from wsp_env.evaluation.summary import judge, summarise
from wsp_env.executor import Processes
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.uic_z1 import WHEELSET
from wsp_env.scenario import Scenario

#: A controller that anybody could write in one file: vents a wheel that falls 5 % behind the fastest.
OWN = """
import dataclasses
import numpy as np

@dataclasses.dataclass
class Thresholds:
    slip: float = 0.05

class Own:
    def __init__(self, parameters=None):
        self.parameters = parameters or Thresholds()

    def reset(self, n, vehicle):
        self.radius, self.reference = vehicle.wheel_radius_m, np.zeros(n)

    def act(self, measurement):
        speed = self.radius * measurement.wheel_speed
        self.reference = np.maximum(speed.max(axis=1), self.reference - 0.02)
        slip = 1 - speed / np.maximum(self.reference, 1)[:, None]
        command = np.where(slip > self.parameters.slip, -1, np.where(slip > self.parameters.slip / 2, 0, 1))
        return np.where(self.reference[:, None] < 3, 1, command)
"""

SMALL = Programme(
    "small",
    SlideLimit(),
    Scenario(),
    (
        Case("dry", "clean", 40.0),
        Case("low", "contaminated", 50.0, (0.05, 0.06)),
    ),
    (Requirement("no lock", "locked_s", 0.0, "assumption"), Requirement("dry only", "ratio_dry", 1.02, "assumption", ("dry",))),
)


@pytest.fixture
def own(tmp_path):
    path = tmp_path / "own.py"
    path.write_text(OWN)
    return str(path)


def write_controller(folder: Path, name: str, act: str) -> str:
    path = folder / f"{name}.py"
    path.write_text(
        "import numpy as np\nclass Bad:\n    def reset(self, n, vehicle):\n        self.shape = (n, vehicle.axles)\n"
        f"    def act(self, measurement):\n        {act}\n"
    )
    return f"{path}:Bad"


def run_small(controllers, folder, **options) -> module.ProgrammeResult:
    return evaluate(controllers, SMALL, SMALL.cases, WHEELSET, folder, draws=Draws(2), **options)


def test_every_controller_has_every_stop_and_is_never_better_than_the_bound_within_the_limit(tmp_path, own):
    result = run_small({"none": {}, own: {}}, tmp_path / "cases")
    stops = result.stops
    assert not result.failures
    assert stops.group_by("controller").len()["len"].to_list() == [6] * 4  # 2 draws of dry, and of low under both laws
    inside = stops.filter(polars.col("within_limit"))
    assert {BOUND, REFERENCE} <= set(inside["controller"])
    assert (inside["ratio_bound"] >= 1.0).all()
    left = stops.filter(~polars.col("within_limit"))
    assert (left["beyond_limit_s"] > 0.0).all()
    assert (left["largest_creepage"] > SMALL.limit.creepage).all()
    assert "none" in set(left["controller"])
    assert (stops.filter(polars.col("controller") == BOUND)["ratio_bound"] == 1.0).all()
    assert (stops.filter(polars.col("controller") == REFERENCE)["ratio_reference"] == 1.0).all()
    dry = stops.filter((polars.col("controller") == "none") & (polars.col("case") == "dry"))
    assert (dry["ratio_dry"] == 1.0).all()
    assert "energy_wheel_1_mj" in stops.columns
    verdicts = {(v.requirement, v.controller): v for v in judge(stops, SMALL.requirements)}
    assert not verdicts["no lock", "none"].passed
    assert "low, classic" in verdicts["no lock", "none"].where
    assert verdicts["dry only", "none"].passed
    summary = summarise(stops)
    row = summary.filter((polars.col("controller") == own) & (polars.col("case") == "low") & (polars.col("law") == "classic"))
    own_stops = stops.filter(
        (polars.col("controller") == own) & (polars.col("case") == "low") & (polars.col("law") == "classic")
    )
    assert row["distance_m"][0] == pytest.approx(own_stops["distance_m"].mean())
    drawn = {(t.controller, t.case, t.law, t.draw): t for t in result.traces}
    assert set(drawn) == set(stops.filter(polars.col("controller") != BOUND).select(KEYS).iter_rows())
    for key, distance in zip(own_stops.select(KEYS).iter_rows(), own_stops["distance_m"], strict=True):
        trace = drawn[key]
        assert (trace.time[0], trace.speed[-1]) == (0.0, 0.0)
        assert trace.position[-1] == pytest.approx(distance)
        assert (np.diff(trace.time) >= 0.0).all()
        assert trace.wheel.shape == trace.pressure.shape == (*trace.time.shape, 1)


def test_what_is_there_is_not_computed_again_and_nothing_half_written_counts(tmp_path, own, monkeypatch):
    folder = tmp_path / "cases"
    worked = []
    original = module.work

    def counted(task):
        worked.append((task.task.controller, task.task.case.name))
        if len(worked) == 4:
            raise KeyboardInterrupt  # the user's
        return original(task)

    monkeypatch.setattr(module, "work", counted)
    with pytest.raises(KeyboardInterrupt):
        run_small({"none": {}, own: {}}, folder)
    assert len(list(folder.glob("*.npz"))) == 3
    resumed = run_small({"none": {}, own: {}}, folder)
    assert worked.count(worked[3]) == 2
    assert len(worked) == 7  # six, and the interrupted one again
    again = run_small({"none": {}, own: {}}, folder)
    assert len(worked) == 7
    assert again.stops.equals(resumed.stops)
    run_small({own: {"slip": 0.1}}, folder)
    assert len(worked) == 9  # other parameters, other results
    Path(own).write_text(OWN + "\n# changed\n")
    run_small({own: {}}, folder)
    assert len(worked) == 11  # other code too


def test_a_damaged_result_is_computed_again(tmp_path, own):
    folder = tmp_path / "cases"
    whole = run_small({own: {}}, folder)
    files = sorted(folder.glob("*.npz"))
    assert len(files) == 4
    data = files[0].read_bytes()
    files[0].write_bytes(data[: len(data) // 2])
    files[1].write_bytes(b"")
    files[2].write_bytes(data[:200] + bytes(byte ^ 255 for byte in data[200:400]) + data[400:])
    with pytest.warns(UserWarning, match="cannot be read and is computed again") as warned:
        again = run_small({own: {}}, folder)
    assert {str(warning.message).split()[0] for warning in warned} >= {str(file) for file in files[:3]}
    assert again.stops.equals(whole.stops)


def test_a_file_may_import_what_lies_beside_it_and_is_run_again_when_that_changes(tmp_path):
    for name, slip in (("one", 0.04), ("two", 0.06)):
        (tmp_path / name / "kit").mkdir(parents=True)
        (tmp_path / name / "own.py").write_text("from helper import SLIP\n" + OWN.replace("0.05", "SLIP"))
        (tmp_path / name / "helper.py").write_text("import kit.numbers\nSLIP = kit.numbers.SLIP\n")
        (tmp_path / name / "kit" / "numbers.py").write_text(f"SLIP = {slip}\n")
        (tmp_path / name / "stranger.py").write_text("")
    files = [str(tmp_path / name / "own.py") for name in ("one", "two")]
    assert [load(file).parameters.slip for file in files] == [0.04, 0.06]  # each its own helper
    beside = {path.relative_to(tmp_path / "one").as_posix() for path in imported_beside(tmp_path / "one" / "own.py")}
    assert beside == {"own.py", "helper.py", "kit/numbers.py"}
    first = code_digest(files[0])
    (tmp_path / "one" / "stranger.py").write_text("# not imported\n")
    assert code_digest(files[0]) == first
    (tmp_path / "one" / "kit" / "numbers.py").write_text("SLIP = 0.03\n")
    assert code_digest(files[0]) != first


def test_a_result_is_written_whole_or_not_at_all(tmp_path):
    class Stubborn:
        def __array__(self, *_, **__):
            raise OSError("no space left")

    with pytest.raises(OSError, match="no space"):
        results.write(tmp_path / "a.npz", {"good": np.ones(3), "bad": Stubborn()})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
def test_results_do_not_depend_on_who_does_the_work(tmp_path, own):
    one = run_small({"none": {}, own: {}}, tmp_path / "one", executor=Processes(1))
    two = run_small({"none": {}, own: {}}, tmp_path / "two", executor=Processes(2))
    assert one.stops.equals(two.stops)
    far = run_small({"none": {}, own: {}}, tmp_path / "far", executor=Elsewhere())
    assert one.stops.equals(far.stops)


def test_bad_controllers_are_reported_and_the_others_evaluated(tmp_path, own):
    bad = {
        write_controller(tmp_path, "nan", "return np.full(self.shape, np.nan)"): "returned nan for axle 1 of stop 1",
        write_controller(tmp_path, "shape", "return np.ones(3)"): r"returned shape (3,)",
        write_controller(tmp_path, "raises", "raise RuntimeError('no idea')"): "raised RuntimeError at 0.00 s: no idea",
        write_controller(tmp_path, "nothing", "pass"): "Bad.act returned",
    }
    result = run_small({**{name: {} for name in bad}, own: {}}, tmp_path / "cases")
    assert len(result.failures) == 2 * len(bad)
    for failure in result.failures:
        assert bad[failure.controller] in failure.message
    assert set(result.stops["controller"]) == {BOUND, REFERENCE, own}
    verdicts = judge(result.stops, SMALL.requirements, result.failures)
    assert all(not verdict.passed and "failed" in verdict.where for verdict in verdicts if verdict.controller in bad)
    assert {verdict.controller for verdict in verdicts} == {REFERENCE, own, *bad}


@pytest.mark.long
def test_a_controller_that_ends_its_process_is_reported_and_the_others_evaluated(tmp_path, own):
    """By one process at a time; that of two one dies alone is what test_limits says."""
    bad = write_controller(tmp_path, "ends", "__import__('os')._exit(3)")
    result = run_small({bad: {}, own: {}}, tmp_path / "cases", executor=Processes(1))
    assert [(f.controller, f.case, f.message) for f in result.failures] == [
        (bad, case.name, "ended the process it ran in, twice") for case in SMALL.cases
    ]
    assert set(result.stops["controller"]) == {BOUND, REFERENCE, own}
    assert result.stops.filter(polars.col("controller") == own).height == 6


def test_a_stop_that_ran_on_meets_no_requirement(tmp_path):
    result = evaluate(
        {"none": {}}, SMALL, SMALL.cases[:1], WHEELSET, tmp_path, draws=Draws(1), conduct=Conduct(time_limit_s=2.0)
    )
    verdicts = judge(result.stops, SMALL.requirements)
    assert [verdict.passed for verdict in verdicts if verdict.controller == "none"] == [False, False]
    assert all("ran on" in verdict.where for verdict in verdicts)
    cells = summarise(result.stops).filter(polars.col("controller") == "none")
    assert cells["stopped"].to_list() == [0]


def test_settings_from_the_command_line():
    assert read_settings(("a.py:B", "none"), ("a.py:B.slip=0.5",)) == {"a.py:B": {"slip": 0.5}, "none": {}}
    for wrong in ("a.py:B.slip", "other.slip=1", "slip=1"):
        with pytest.raises(ParameterError, match=r"CONTROLLER\.PARAMETER=VALUE"):
            read_settings(("a.py:B",), (wrong,))


def test_a_text_for_a_number_is_refused(own):
    with pytest.raises(ParameterError, match=r"slip of .* must be a number, got 'abc'"):
        load(own, {"slip": "abc"})


def test_the_command_evaluates_a_file_and_reports(tmp_path, own, capsys):
    programme = tmp_path / "programme.toml"
    programme.write_text("[[case]]\nname='low'\nabout=''\ninitial_speed_kmh=40.0\ninitial_adhesion=[0.05, 0.06]\n")
    bad = write_controller(tmp_path, "raises", "raise RuntimeError('no idea')")
    common = [
        "--vehicle",
        "wheelset",
        "--draws",
        "2",
        "--jobs",
        "1",
        "--programme",
        str(programme),
        "--out",
        str(tmp_path / "out"),
    ]
    assert cli.main(["evaluate", "--controllers", own, *common, "--set", f"{own}.slip=0.04", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert {row["controller"] for row in document["summary"]} == {BOUND, REFERENCE, own}
    assert document["failures"] == []
    assert len(document["stops"]) == 2 * 2 * 3
    assert all(stop["within_limit"] for stop in document["stops"] if stop["controller"] == BOUND)
    table = polars.read_parquet(tmp_path / "out" / "stops.parquet")
    assert set(FIGURES) <= set(table.columns)
    assert polars.read_csv(tmp_path / "out" / "stops.csv").height == table.height
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Where each controller loses distance" in page
    assert page.count("src=") == page.count('src="https://cdn.plot.ly/') == 1  # nothing else from the network
    with pytest.raises(SystemExit) as end:
        cli.main(["evaluate", "--controllers", own, bad, *common])
    assert end.value.code == 1
    captured = capsys.readouterr()
    assert "no idea" in captured.err
    assert "own.py" in captured.out
    assert str(tmp_path) not in captured.out.partition("stops.csv")[0].rpartition("\n")[0]


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no Chromium installed")
def test_the_page_opens_without_a_network_and_draws_the_stop_that_is_chosen(tmp_path):
    result = run_small({"none": {}}, tmp_path / "cases")
    page = tmp_path / "report.html"
    write_report(page, result, summarise(result.stops), judge(result.stops, SMALL.requirements), "small")
    choose = """<script>for (const [name, value] of [["case", "low"], ["law", "recovering"], ["draw", "1"]]) {
      const menu = document.getElementById("course-" + name);
      menu.value = value;
      menu.dispatchEvent(new Event("change"));
    }
    console.log("chosen: " + document.getElementById("course-note").textContent);</script></body>"""
    page.write_text(page.read_text(encoding="utf-8").replace("</body>", choose), encoding="utf-8")
    said, plots, titles = open_page(page, tmp_path / "profile")
    assert plots == 4  # the front, the losses under both laws, the course
    assert all(title.endswith("]") for title in titles), titles
    shown = result.stops.filter(
        (polars.col("case") == "low") & (polars.col("draw") == 1) & (polars.col("controller") == "none")
    )
    (distance,) = shown.filter(polars.col("law") == "recovering")["distance_m"]
    assert len(said) == 1, said  # no error besides
    assert f"chosen: Stopped after {distance:.0f} m" in said[0]


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--controllers", "nobody"], "valid: none, rule-based"),
        (["--cases", "wet"], "unknown case wet"),
        (["--vehicle", "tram"], "unknown vehicle"),
        (["--draws", "0"], "draws"),
        (["--controllers", "none", "none"], "named twice"),
        (["--set", "none.x=1"], "no parameters to set"),
    ],
)
def test_wrong_arguments_are_one_line(tmp_path, capsys, arguments, complaint):
    assert cli.main(["evaluate", "--out", str(tmp_path), *arguments]) == 2
    message = capsys.readouterr().err
    assert complaint in message
    assert "Traceback" not in message
