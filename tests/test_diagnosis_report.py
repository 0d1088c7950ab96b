"""The diagnosis' page of a made-up answer: it says what the JSON says, marks held-out runs and what stays high."""

import dataclasses

import pytest

from wsp_env.diagnosis.answer import (
    Closure,
    ClosureKind,
    Diagnosis,
    Estimate,
    Evidence,
    FitQuality,
    Named,
    Pair,
    RunFigures,
    RunTrace,
)
from wsp_env.diagnosis.report import write_report
from wsp_env.diagnosis.report_runs import figures, still_high


def figures_of(run: str, group: str) -> RunFigures:
    two = (0.5, 0.25)
    return RunFigures(run, group, (0.04, None), (0.02, None), 0.3, 0.2, two, two, two, two, two, two)


@pytest.fixture
def found() -> Diagnosis:
    rise = {"rise": Estimate(-0.0089, "-", (-0.0097, -0.0081))}
    names = ("track_gradient", "vehicle_mass")
    evidence = (
        Evidence("vehicle_mass", 200.0, (1.0, 3.0), 20.0, 100.0, 1.5),
        Evidence("track_gradient", 900.0, (2.0, 9.0), 90.0, 400.0, 4.0),
        Evidence("force on the vehicle over time", 950.0, (20.0, 40.0), 50.0, 0.0, 0.0),
    )
    cells = [
        {"balance": "vehicle", "run": run, "axle": 0, "before": 9.0, "after": after}
        for run, after in (("A1", 0.9), ("B1", 3.5))
    ]
    places = [{"balance": "vehicle", "axle": 0, "place_m": 100.0, "before": 9.0, "after": 1.0}]
    return Diagnosis(
        campaign="trial",
        verdict="named",
        sentence="What the simulation lacks: the track falls by 8.9 per mille more than believed (8.1 to 9.7 per mille).",
        mechanisms=(Named("track_gradient", 0.99, ("track_gradient",), rise, 4.0, 900.0, 9.0, 400.0),),
        location=(),
        fit=FitQuality(1.0, {"tune": 5.0, "validate": 6.0}, {"tune": 1.1, "validate": 1.5}, 0.9),
        detectable={"track_gradient": {"rise": 3e-4}},
        next_test="coasting over the same track in both directions",
        closure=Closure(ClosureKind("force", "time"), "force on the vehicle over time", 60.0, 30.0, "time in each run [s]",
                        "speed lost [m/s]",
                        ((0.0, 0.1, 0.01), (3.0, 0.2, 0.01), (0.0, -0.1, 0.01), (3.0, -0.2, 0.01))),
        evidence=evidence,
        pairs=(Pair(("adhesion_patch", "track_gradient"), 310.0, 12.0),),
        confounding={a: dict.fromkeys(names, 1.0) for a in names},
        model={},
        residuals={"cells": cells, "places": places},
        runs=(figures_of("A1", "tune"), figures_of("B1", "validate")),
        notes=(),
        course=RunTrace("B1", "validate", 2, (0.0, 1.0), (0.1, 0.11), (0.09, 0.1), (0.1, 0.11), (0.0, 1.0), (0.2, 0.3),
                      (0.0, 0.1)),
    )  # fmt: skip


def test_the_page_tells_where_what_and_what_remains(found, tmp_path):
    write_report(tmp_path / "report.html", found)
    body = (tmp_path / "report.html").read_text(encoding="utf-8").partition("<body>")[2]
    for words in (
        "The track falls by 8.9 per mille more than believed (8.1 to 9.7 per mille)",
        "Run B1, held out: adhesion coefficient of axle 2",
        "Recorded minus predicted vehicle speed",
        "vehicle in B1 (3.5)",
        "<td>adhesion patch and track gradient</td><td>310</td><td>12</td>",
        "What remains: force on the vehicle over time",
        "<td>track gradient</td><td>rise</td><td>0.0003</td><td>-</td>",
    ):
        assert words in body, words
    table = body.partition("Null band</th>")[2]
    gained = [
        table.index(f"<td>{name}") for name in ("force on the vehicle over time (closure)", "track gradient", "vehicle mass")
    ]
    assert gained == sorted(gained)  # by gain


def test_figures_have_a_column_each_and_held_out_runs_are_marked(found):
    by_axle, by_run = figures(found)
    assert len(by_axle.rows) == 2 * len(found.runs)
    assert all(len(row) == len(by_axle.header) for row in by_axle.rows)
    assert by_axle.rows[0] == ("A1", "1", "4.00", "2.00", *["0.50"] * 6)
    assert by_axle.rows[3][:4] == ("B1*", "2", "-", "-")
    assert by_run.rows[1] == ("B1*", "0.3", "0.2")
    before = figures(dataclasses.replace(found, mechanisms=()))
    assert not any("after" in name for table in before for name in table.header)


def test_only_cells_that_stay_high_are_told_of(found):
    assert still_high(found) == "Above 2 after the extension: vehicle in B1 (3.5)."
    assert "A1 (9.0)" in still_high(dataclasses.replace(found, mechanisms=()))
    quiet = {"cells": [cell | {"after": 1.0} for cell in found.residuals["cells"]]}
    assert still_high(dataclasses.replace(found, residuals=quiet)) == "No cell stays above 2 after the extension."
