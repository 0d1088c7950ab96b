"""The diagnosis' page of made-up answers: one screen says it all, no number misleads, evidence lies behind folds."""

import dataclasses
import hashlib
from types import SimpleNamespace

import numpy as np
import pytest

from wsp_env.diagnosis import worth
from wsp_env.diagnosis.answer import (
    Diagnosis,
    Discovered,
    Estimate,
    FitQuality,
    Location,
    Named,
    Worth,
)
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.interest import StopChange
from wsp_env.diagnosis.report import write_report
from wsp_env.diagnosis.report_facts import MEANINGS, confidence_said, lead, misfit_said, removed_said, where_said, worth_said
from wsp_env.diagnosis.report_runs import figures, heat_maps, still_high
from wsp_env.diagnosis.sources import signed
from wsp_env.recordings import demo_campaign, read_campaign
from wsp_env.recordings.suspect import SuspectChannel


def page_of(found: Diagnosis, folder) -> tuple[str, str]:
    """Return what the page shows at once, and all of it."""
    write_report(folder / "report.html", found)
    body = (folder / "report.html").read_text(encoding="utf-8").partition("<body>")[2]
    return body.partition("<details>")[0], body


DISCOVERED = Discovered(
    "brake torque", ("friction",), ("friction by braking time",), (1,), "650 N m while braking", ("braking",),
    {"coefficient": Estimate(650.0, "N m", (600.0, 700.0))}, ("dragging brake",), 0.93, 3.0, 500.0, 200.0,
)  # fmt: skip
SUSPECT = SuspectChannel("axle2_brake_torque_nm", "1000 times too small", "give it the unit kN m")


def test_the_page_tells_where_what_and_what_remains(found, tmp_path):
    _, body = page_of(found, tmp_path)
    for words in (
        "The track falls by 8.9 per mille more than believed (8.1 to 9.7 per mille)",
        "Run B1, held out: adhesion coefficient of axle 2",
        "ecorded minus predicted vehicle speed",
        "vehicle speed in B1 (3.5)",
        "<td>track gradient</td><td>additional gradient</td><td>0.0003</td><td>(dimensionless)</td>",
    ):
        assert words in body, words
    assert "<td>-</td>" not in body  # a lone dash reads as minus
    table = body.partition("log10 of evidence</th>")[2]
    gained = [
        table.index(f"<td>{name}") for name in ("force on the vehicle over time (term)", "track gradient", "vehicle mass")
    ]
    assert gained == sorted(gained)  # by gain


def test_what_could_not_have_been_seen_and_what_was_not_fitted_is_said_without_figures(found, tmp_path):
    """A term's slot, axles and feature are codes, which its equation says in words."""
    parameters = DISCOVERED.parameters | {"slot_1": Estimate(0.0, "code", (0.0, 0.0))}
    term = dataclasses.replace(DISCOVERED, parameters=parameters)
    _, body = page_of(dataclasses.replace(found, discovered=(term,), detectable=found.detectable | {"sanding": {}}), tmp_path)
    assert "These recordings would not have shown at any possible size: sanding." in body
    assert "650" in body.partition("The term found")[2]
    assert "<td>code</td>" not in body


def test_the_first_screen_holds_the_message_and_one_plot_and_the_folds_the_evidence(found, tmp_path):
    where = (Location("vehicle", (), ("A1", "B1"), "speed from 10 to 20 m/s", 1.0),)
    change = Worth(0.031, (0.02, 0.04), 0.2)
    first, body = page_of(dataclasses.replace(found, location=where, worth=change), tmp_path)
    for words in (
        "By this, real stops are 3.1 % longer than simulated ones.",
        MEANINGS["named"],
        "change +2 to +4 %",
        "in the balance of vehicle speed, in every run, speed from 10 to 20 m/s",
        "track gradient: 99 %",
        "90 % of what the baseline leaves",
        "Coasting over the same track",
    ):
        assert words in first, words
    assert first.count('class="plot"') == 1
    assert "chi-square" not in first
    assert body.count("<details>") == body.count("</details>") >= 4


def changed(found: Diagnosis, **values: object) -> Diagnosis:
    """Return an answer without names, with other values."""
    return dataclasses.replace(found, **({"mechanisms": (), "evidence": ()} | values))


@pytest.mark.parametrize(
    ("verdict", "values", "words"),
    [
        ("adequate", {}, "mean squares in held-out runs are 6.0 times"),
        ("insufficient", {"course": None}, MEANINGS["insufficient"]),
        ("unknown", {}, MEANINGS["unknown"]),
        ("discovered", {"discovered": (DISCOVERED,)}, "650 N m while braking looks like dragging brake and may as well act on"),
        ("data", {"suspect_channels": (SUSPECT,), "residuals": {"cells": [], "places": []}, "runs": (), "course": None,
                  "detectable": {}, "fit": FitQuality(1.0, {}, {}, None)}, "give it the unit kN m"),
    ],
)  # fmt: skip
def test_every_verdict_has_a_page_with_its_meaning(found, tmp_path, verdict, values, words):
    first, body = page_of(changed(found, verdict=verdict, **values), tmp_path)
    assert MEANINGS[verdict] in first
    assert words in first
    assert ("after" in first) == (verdict == "discovered")
    if verdict == "discovered":
        assert "The term found: 650 N m while braking" in body
        assert "<td>coefficient</td><td>650</td><td>N m</td><td>600 to 700</td>" in body


@pytest.mark.parametrize(
    ("share", "words"),
    [
        (1.1, "all of "), (1.0, "all of "), (0.874, "87 % of "), (0.03, "most of it is still there"),
        (0.0, "none: the held-out runs fit no better"), (-0.4, "none: the held-out runs fit no better"),
        (None, "not measurable"),
    ],
)  # fmt: skip
def test_the_share_removed_is_no_more_than_all_and_no_less_than_none(share, words):
    assert words in removed_said(share)
    assert "110" not in removed_said(share)
    assert "-" not in removed_said(share).replace("held-out", "")


def test_a_misfit_is_told_with_what_is_too_small_to_matter():
    """Wheel speeds that are late by half a sample explain nearly all, and matter in no stop."""
    law = FitQuality(1.0, {"tune": 8.0, "validate": 4.84}, {"tune": 1.1, "validate": 0.96}, None)
    told = "mean squares in held-out runs are 4.8 times what noise and normal variation leave"
    assert misfit_said(law) == f"{told}, and 1.0 times with what was seen but is too small to matter"
    assert misfit_said(dataclasses.replace(law, extended=law.baseline)) == told


def test_no_confidence_stands_beside_a_failed_held_out_test_without_it(found):
    (one,) = found.mechanisms
    failed = dataclasses.replace(found, mechanisms=(dataclasses.replace(one, confidence=1.0, held_out_gain=-508.0),))
    assert confidence_said(failed) == (
        "track gradient: above 99 %, but its held-out test failed: chi-square rises by 508 there"
    )
    assert "failed" not in confidence_said(found)


def test_the_axle_that_is_named_is_the_place_whatever_else_moves(found):
    gain = {"gain": Estimate(-0.04, "-", (-0.05, -0.03)), "axle": Estimate(2.0, "-", (2.0, 2.0))}
    named = (Named("brake_gain_imbalance", 0.9, ("brake_gain_imbalance",), gain, 3.0, 100.0, 9.0, 40.0),)
    where = (Location("adhesion", (1, 2, 3), ("B1",), "everywhere", 0.8),)
    answer = dataclasses.replace(found, mechanisms=named, location=where)
    assert where_said(answer) == "axle 2, in the balance of adhesion under torque, in run B1, everywhere"
    assert where_said(changed(found)) == ""


def test_what_is_worth_nothing_in_distance_is_not_told_as_distance(found):
    assert "1 % of its distance" in worth_said(found)  # where its size is not known, by what matters
    slips = dataclasses.replace(found, worth=Worth(0.0, None, 0.3))
    assert worth_said(slips) == "no change of the stopping distance; a change of slip of 0.30 m/s"
    assert lead(slips) == found.sentence
    assert lead(dataclasses.replace(found, worth=Worth(-0.02, None, 0.3))).endswith("2.0 % shorter than simulated ones.")


def test_places_without_a_share_are_left_out(found, tmp_path):
    where = (Location("vehicle", (), ("A1",), "everywhere", 0.999), Location("adhesion", (4,), ("A1",), "everywhere", 0.001))
    _, body = page_of(dataclasses.replace(found, location=where), tmp_path)
    assert "<td>100 %</td>" in body
    assert "<td>0 %</td>" not in body


def test_the_footer_names_the_files_and_their_hashes(found, tmp_path):
    folder = demo_campaign()
    answer = signed(found, folder)
    content = (folder / "campaign.toml").read_bytes()
    assert answer.sources[0].file == "campaign.toml"
    assert answer.sources[0].sha256 == hashlib.sha256(content).hexdigest()
    assert len(answer.sources) > 1
    footer = page_of(answer, tmp_path)[1].partition("<footer>")[2]
    assert answer.made in footer
    assert answer.version in footer
    assert all(f"{one.file} {one.sha256[:12]}" in footer for one in answer.sources)


def test_maps_grow_darker_by_factors():
    cells = [{"balance": "adhesion", "run": f"A{i}", "axle": 1, "before": value} for i, value in enumerate((1.0, 10.0, 100.0))]
    (heat,) = heat_maps(cells, "run", {"before": "before"}, "run").data
    steps = list(heat.z[0])
    assert steps[0] == 0.0
    assert steps[2] - steps[1] == pytest.approx(steps[1] - steps[0])
    assert list(heat.text[0]) == ["1.0", "10", "100"]


def test_a_map_over_a_track_that_nobody_knows_is_left_out(found, tmp_path):
    _, body = page_of(found, tmp_path)
    assert "place of the axle" in body
    _, without = page_of(dataclasses.replace(found, residuals=found.residuals | {"places": []}), tmp_path)
    assert "place of the axle" not in without
    assert "no map over the track" in without


def test_figures_have_a_column_each_and_held_out_runs_are_marked(found):
    by_axle, by_run = figures(found, True)
    assert len(by_axle.rows) == 2 * len(found.runs)
    assert all(len(row) == len(by_axle.header) for row in by_axle.rows)
    assert by_axle.rows[0] == ("A1", "1", "4.00", "2.00", *["0.50"] * 6)
    assert by_axle.rows[3][:4] == ("B1*", "2", "no slide", "no slide")
    assert by_run.rows[1] == ("B1*", "0.3", "0.2")
    heads = [name for table in (by_axle, by_run) for name in table.header]
    assert len({name.lower() for name in heads} - {"run"}) == len(heads) - 2  # none differs from another by case alone
    before = figures(found, False)
    assert not any("after" in name or "before" in name for table in before for name in table.header)


def test_only_cells_that_stay_high_are_told_of(found):
    assert still_high(found) == "Above 2 after the extension: vehicle speed in B1 (3.5)."
    assert "A1 (9.0)" in still_high(dataclasses.replace(found, mechanisms=()))
    quiet = {"cells": [cell | {"after": 1.0} for cell in found.residuals["cells"]]}
    assert still_high(dataclasses.replace(found, residuals=quiet)) == "No cell stays above 2 after the extension."


def test_the_worth_is_the_mean_change_of_the_stops(monkeypatch):
    """In metres and as a share of the braking distance of all stops together; a stop without braking has none."""
    campaign = read_campaign(demo_campaign())
    names = list(campaign.runs)
    ways = worth.braked_m(campaign)
    shares = (0.02, np.nan, *(0.05 for _ in names[2:]))
    monkeypatch.setattr(worth, "net_change", lambda *_: StopChange(0.05, 0.1, stops=shares))
    replica = SimpleNamespace(campaign=campaign, stops=[SimpleNamespace(name=name) for name in names])
    outcome = SimpleNamespace(replica=replica, last=SimpleNamespace(whitening=None))
    found = worth.worth_of(outcome, Model(2e-4, (0.05,)), [])
    assert set(found.stops_m) == set(names) - {names[1]}
    assert found.stops_m[names[0]] == pytest.approx(0.02 * ways[names[0]])
    assert found.distance_share * found.stop_m == pytest.approx(np.mean(list(found.stops_m.values())))
    said = worth_said(SimpleNamespace(worth=found))
    assert f"m in {names[0]} to " in said  # the smallest and the largest change


def test_the_law_is_told_with_what_is_only_believed(found, tmp_path):
    model = found.model | {"tau_m_per_J": 1.9e-4, "mu_cd": {"A1": 0.05, "B1": 0.06}, "note_mu_cd": "believed, not fitted: B1"}
    _, body = page_of(dataclasses.replace(found, model=model), tmp_path)
    law = body.partition("The tuned law")[2]
    for words in ("0.00019 m/J", "<td>0.0600</td>", "mu_cd is believed, not fitted: B1."):
        assert words in law
