"""The proof's bank, answers and score: labels, every step on a small bank, figures on made-up answers, the page."""

import dataclasses
import hashlib
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from elsewhere import Elsewhere
from few_stops import TUNE, VALIDATE, few_stops

from experiments.concealed import answers, bank, black_box, concealment, diagnoses, page, rivals, workers
from experiments.concealed.__main__ import Diagnose, Page, Rivals, Score
from experiments.concealed.distances import distance_change
from experiments.concealed.effects import ALL, library_names
from experiments.concealed.errors import BankError
from experiments.concealed.plan import SHARES
from experiments.concealed.promised import found
from experiments.concealed.rates import plain, rate, restored
from experiments.concealed.required import DISTANCES, checks
from experiments.concealed.score import score
from experiments.concealed.truths import true_value
from wsp_env.diagnosis.candidates import Variant, parameter_of, step
from wsp_env.executor import Processes, ThisProcess, Workers
from wsp_env.plant import mechanisms
from wsp_env.plant.mechanisms import clock_offset
from wsp_env.recordings import CampaignError, demo_campaign, read_campaign

DOCS = Path(__file__).parents[1] / "docs"


@pytest.fixture(scope="module")
def small_bank(tmp_path_factory):
    """Return the folder of the small bank and its digest."""
    out = tmp_path_factory.mktemp("bank")
    with few_stops():
        yield out, bank.make(out, len(SHARES), 11, ThisProcess())  # within: a test makes a part of the bank anew


@pytest.mark.long
def test_bank_is_readable_concealed_labelled_and_reproducible(small_bank):
    out, digest = small_bank
    labels = bank.read_labels(out)
    assert hashlib.sha256((out / "labels.json").read_bytes()).hexdigest() == digest
    assert {label["class"] for label in labels.values()} == set(SHARES)
    for name, label in labels.items():
        campaign = read_campaign(out / "campaigns" / name)
        assert (campaign.tune, campaign.validate) == (TUNE, VALIDATE)
        assert campaign.vehicle.axles == label["axles"]
        assert (campaign.vehicle.brake_torque_source == "measured") == label["measured_torque"]
        assert label["fault"] or concealment.passes(concealment.worst_error(out / "campaigns" / name))
        assert label["mechanisms"] == library_names(e["name"] for e in label["effects"])
        assert label["verdict"] == {"null": "adequate", "foreign": "discovered", "fault": "data"}.get(label["class"], "named")
        text = (out / "campaigns" / name / "campaign.toml").read_text(encoding="utf-8").replace("wheel_radius_m", "")
        assert not [effect for effect in ALL if effect in text]  # nothing tells what is concealed
    spoilt = next(name for name, label in labels.items() if label["fault"])
    parts = [out / "labels" / f"{spoilt}.json"]  # the fault is put in again, once
    before = parts[0].read_text(encoding="utf-8")
    for file in (out / "campaigns" / parts[0].stem).iterdir():
        file.unlink()
    parts[0].unlink()
    assert bank.make(out, len(SHARES), 11, Elsewhere()) == digest  # goes on, and makes the same again
    assert parts[0].read_text(encoding="utf-8") == before


@pytest.mark.long
def test_who_answers_the_cases_does_not_matter(small_bank, tmp_path, monkeypatch):
    """Diagnoses and rivals of what is sent; how they come to their answers does not matter here."""

    def of_its_files(folder):
        return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in folder.iterdir()} | {"is": folder.name}

    monkeypatch.setattr(diagnoses, "answer", of_its_files)
    monkeypatch.setattr(rivals, "examine", lambda folder: (dict.fromkeys(rivals.RULES, of_its_files(folder)), {}))
    monkeypatch.setattr(rivals.black_box, "run", lambda labels, folder, executor: None)
    made = []
    for name, executor in (("here", ThisProcess()), ("there", Elsewhere())):
        out = tmp_path / name
        shutil.copytree(small_bank[0], out)
        diagnoses.run(out, executor)
        rivals.run(out, executor)
        made.append({file.relative_to(out): file.read_bytes() for file in out.rglob("*") if file.is_file()})
    assert made[0] == made[1]


@pytest.mark.long
def test_bank_refuses_other_numbers_and_changed_labels(small_bank):
    out, _ = small_bank
    with pytest.raises(BankError, match="another bank"):
        bank.make(out, len(SHARES) + 1, 11, ThisProcess())
    kept = (out / "labels.json").read_bytes()
    (out / "labels.json").write_bytes(kept.replace(b"null", b"none"))
    with pytest.raises(BankError, match="changed since its hash"):
        bank.read_labels(out)
    (out / "labels.json").write_bytes(kept)


def test_labels_need_a_finished_bank(tmp_path):
    with pytest.raises(BankError, match="no finished bank"):
        bank.read_labels(tmp_path)


def truth(kind: str, *names: str, size: float = 1.0, multiple: float = 2.0) -> dict:
    """Return a label."""
    effects = [{"name": name, "size": size, "multiple": multiple, "axle": 1, "variant": 0} for name in names]
    mechanisms = library_names(names)
    return {
        "class": kind, "mechanisms": mechanisms, "effects": effects, "noise": 1.0, "axles": 4, "distance_change": -0.02,
        "net": 0.6 * multiple,
    }  # fmt: skip


def answer(verdict: str, *names: str, alternatives: tuple[str, ...] = (), confidence: float = 0.9, **parameters) -> dict:
    """Return a diagnosis that removes three fourths of what can be removed."""
    mechanisms = [
        {"name": name, "confidence": confidence, "alternatives": [name, *alternatives], "parameters": parameters}
        for name in names
    ]
    fit = {"noise_floor": 1.0, "baseline": {"validate": 5.0}, "extended": {"validate": 2.0}}
    return {"verdict": verdict, "mechanisms": mechanisms, "fit": fit}


def test_score_of_made_up_answers():
    rise = {"value": 0.0011, "unit": "-", "interval90": [0.0008, 0.0013]}
    pairs = {
        "n1": (truth("null"), answer("adequate")),
        "n2": (truth("null"), answer("named", "wheel_radius", confidence=0.6)),
        "n3": (truth("null"), answer("insufficient")),
        "s1": (truth("single", "track_gradient", size=0.001), answer("named", "track_gradient", rise=rise)),
        "s2": (truth("single", "load_transfer"), answer("ambiguous", "flash_temperature", alternatives=("load_transfer",))),
        "s3": (truth("single", "load_transfer", multiple=1.0), answer("adequate")),
        "p1": (truth("pair", "wheel_radius", "load_transfer"), answer("named", "load_transfer", "wheel_radius")),
        "p2": (truth("pair", "wheel_radius", "load_transfer"), answer("named", "load_transfer")),
        "c1": (truth("confounded", "track_gradient"), answer("insufficient")),
        "c2": (truth("confounded", "track_gradient"), answer("named", "vehicle_mass")),
        "f1": (truth("foreign", "hunting"), answer("unknown")),
        "f2": (truth("foreign", "hunting"), answer("named", "falling_friction")),
    }
    figures = score({k: v[0] for k, v in pairs.items()}, {k: v[1] for k, v in pairs.items()})
    assert figures["promised"]["false_alarms"][:3] == (1, 3, 1 / 3)
    assert figures["singles"]["right_name_first"][:2] == (1, 3)
    assert figures["singles"]["in_set"][:2] == figures["singles"]["in_set_of_two"][:2] == (2, 3)
    assert figures["singles_by_size"]["1.5 to 3"]["in_set"].share == 1.0
    assert figures["singles_by_size"]["0.75 to 1.5"]["in_set"].share == 0.0
    assert figures["promised"]["pairs_both"][:2] == figures["pairs_one_found"][:2] == (1, 2)
    assert figures["confounded_honest"][:2] == (1, 2)
    assert figures["promised"]["outside_named"][:2] == (1, 2)
    assert figures["promised"]["outside_seen"].share == 1.0
    assert figures["separable"]["right_name_first"][:2] == (1, 2)  # what is smaller than twice of interest does not count
    assert figures["removed_share"]["named"]["mean"] == pytest.approx(0.75)
    assert figures["removed_share"]["all"]["mean"] == pytest.approx(0.75 * 4 / 5)  # one of the singles and pairs is adequate
    assert figures["removed_share"]["of_sums"] == pytest.approx(0.75 * 4 / 5)
    assert figures["promised"]["parameters"]["relative_error"]["mean"] == pytest.approx(0.1)
    assert figures["promised"]["parameters"]["interval90_covers"].share == 1.0
    assert figures["promised"]["calibration"]["claims"] == 8
    assert figures["confusion"]["load_transfer"] == {"flash_temperature": 1, "adequate": 1}


def test_score_needs_every_answer():
    with pytest.raises(BankError, match="no answer for 1 of 1"):
        score({"n1": truth("null")}, {})


def test_two_truths_need_two_mechanisms():
    both = answer("ambiguous", "wheel_radius", alternatives=("load_transfer",))
    assert found(["wheel_radius", "load_transfer"], both) == 1
    assert found(["load_transfer"], both) == 1
    assert found(["load_transfer"], both, largest_set=1) == 0
    assert found([], both) == 0


def test_rate_bounds_are_clopper_and_pearson_s():
    none = rate([False] * 60)
    assert none.upper95 == pytest.approx(1.0 - 0.05 ** (1 / 60))  # the closed form for no event
    assert none.lower95 == 0.0
    assert rate([True] * 60).lower95 == pytest.approx(0.05 ** (1 / 60))
    assert rate([]).share is None


def test_figures_survive_the_file_and_are_held_against_what_is_required():
    figures = score(
        {"n": truth("null"), "s": truth("single", "track_gradient", size=0.001), "f": truth("foreign", "hunting")},
        {"n": answer("adequate"), "s": answer("named", "track_gradient"), "f": answer("named", "vehicle_mass")},
    )
    assert restored(json.loads(json.dumps(plain(figures)))) == figures
    met = {one.what.split(",")[0]: one.met for one in checks(figures)}
    assert met["outside the library: wrong name"] is False
    assert met["library: both of a pair found"] is None
    assert met["cases"] is False
    assert met["false alarms on nulls"] is True
    assert met["right name first"] is True
    assert met[DISTANCES] is None  # a gradient's own parameter is compared


def test_intervals_of_the_change_of_distance_are_required_to_cover():
    labels = {f"s{i}": truth("single", "load_transfer") for i in range(10)}  # of a change by -2 %
    answers = {
        name: answer("named", "load_transfer")
        | {"distance_change": {"value": -0.03, "interval90": [-0.04, -0.025 if i == 0 else -0.01]}}
        for i, name in enumerate(labels)
    }
    (told,) = (one for one in checks(score(labels, answers)) if one.what == DISTANCES)
    assert told.measured.startswith("90.0 % (9 of 10;")
    assert told.met is True
    for name in list(labels)[:2]:
        answers[name]["distance_change"]["interval90"] = [-0.04, -0.025]
    (told,) = (one for one in checks(score(labels, answers)) if one.what == DISTANCES)
    assert told.met is False


def test_page_is_filled_and_filled_again(tmp_path):
    docs, out = tmp_path / "docs", tmp_path / "out"
    (docs / "lab").mkdir(parents=True)
    (out / "rivals" / "bic").mkdir(parents=True)
    for name in page.PAGES:
        shutil.copy(DOCS / name, docs / name)
    labels = {"n": truth("null"), "s": truth("single", "track_gradient", size=0.001)}
    answers = {"n": answer("adequate"), "s": answer("named", "track_gradient")}
    figures = json.dumps(plain(score(labels, answers)))
    for file in (out / "score.json", out / "rivals" / "bic" / "score.json"):
        file.write_text(figures, encoding="utf-8")
    (out / "bank.json").write_text('{"cases": 2, "seed": 1}', encoding="utf-8")
    (out / "labels.sha256").write_text("abc  labels.json\n", encoding="utf-8")
    Page(out, docs).run()
    text, more, others = ((docs / name).read_text(encoding="utf-8") for name in page.PAGES)
    assert "| false alarms on nulls | at most 5 % | 0.0 % (0 of 1; 0.0 % to 95.0 %) | yes |" in text
    assert "`abc`" in text
    required = text.partition("<!-- begin: required -->")[2].partition("<!-- end: required -->")[0]
    assert "90 % intervals of the change of stopping distance cover" in required
    pictures = [line.split("(")[1].rstrip(")") for line in f"{text}\n{more}".splitlines() if line.startswith("![")]
    assert pictures
    assert all((docs / picture).is_file() for picture in pictures)
    Page(out, docs).run()
    assert [(docs / name).read_text(encoding="utf-8") for name in page.PAGES] == [text, more, others]
    (docs / page.PAGES[1]).write_text(more.replace("<!-- begin: power -->", ""), encoding="utf-8")
    with pytest.raises(BankError, match="markers"):
        Page(out, docs).run()
    (out / "score.json").unlink()
    with pytest.raises(BankError, match=r"no score\.json"):
        Page(out, docs).run()


def test_comparable_parameters_have_the_library_s_sign():
    """What the truth's late clock records is what the library's clock says of the parameter that it is scored by."""
    speed, acceleration, late = 30.0, -0.8, 0.2
    offset = true_value({"name": "clock_offset", "size": late, "variant": 0})
    stamped = clock_offset.recorded(clock_offset.Parameters(offset), speed, acceleration, 1.0)
    assert stamped == pytest.approx(speed + late * acceleration)  # sampled later than stamped: slower already
    drag = true_value({"name": "aerodynamic_drag", "size": 2.0, "variant": 1})
    assert drag * 30.0**2 == pytest.approx(2.0 * (100.0 + 5.0 * 30.0 + 30.0**2))


def test_refused_campaign_is_insufficient(monkeypatch):
    def refuse(campaign, refuse):
        raise CampaignError("no run can be diagnosed")

    monkeypatch.setattr(answers, "quietly_read", refuse)
    said = diagnoses.answer(Path("anywhere"))
    assert said["verdict"] == "insufficient"
    assert said["notes"] == ["no run can be diagnosed"]


def made_up_scan(rng: np.random.Generator, amplitude: float) -> rivals.Scan:
    """Return a scan of gradient and mass, in which only the gradient is there."""
    chosen = (Variant("track_gradient", ("rise",), {}), Variant("vehicle_mass", ("extra",), {}))
    x = rng.standard_normal((900, 2))
    y = amplitude * x[:, 0] + rng.standard_normal(900)

    def products(keep: slice) -> rivals.Products:
        return rivals.Products(x[keep].T @ x[keep], x[keep].T @ y[keep], len(y[keep]))

    return rivals.Scan(chosen, products(slice(None)), products(slice(600)), products(slice(600, None)))


@pytest.mark.parametrize("name", rivals.RULES)
def test_rivals_find_what_is_there_and_its_size(name):
    said = rivals.select(made_up_scan(np.random.default_rng(1), 2.0), rivals.RULES[name])
    assert said["mechanisms"][0]["name"] == "track_gradient"
    assert said["mechanisms"][0]["confidence"] > 0.99
    rise = said["mechanisms"][0]["parameters"]["rise"]
    null, change = parameter_of("track_gradient", "rise").null, step("track_gradient", "rise")
    assert rise["value"] == pytest.approx(null - 2.0 * change, rel=0.1)
    assert rise["interval90"][0] < rise["value"] < rise["interval90"][1]


def test_bic_wants_more_than_chance_and_held_out_does_not():
    scans = [made_up_scan(np.random.default_rng(seed), 0.0) for seed in range(40)]
    named = {name: sum(bool(rivals.select(one, rule)["mechanisms"]) for one in scans) for name, rule in rivals.RULES.items()}
    assert named["bic"] <= 4  # 2 candidates, a gain above log(900) = 6.8 of each by chance in 0.9 %
    assert named["held_out"] > 10  # every other candidate improves held-out runs by chance


@pytest.mark.long
def test_black_box_learns_from_the_other_folds():
    rng, targets, seen = np.random.default_rng(0), {}, {}
    for i in range(40):
        targets[f"case{i:03d}"] = (black_box.NOTHING, black_box.UNKNOWN, "wheel_radius", "track_gradient")[i % 4]
        seen[f"case{i:03d}"] = {"noise": rng.standard_normal(), "gain": i % 4 + 0.1 * rng.standard_normal()}
    dealt = black_box.folds([targets[name] for name in sorted(targets)])
    assert np.bincount(dealt).tolist() == [8] * 5
    ((_, content),) = workers.results(black_box.answer_fold, [black_box.Fold(seen, targets, 0)], Processes(1), "fold")
    said = json.loads(content)  # of a process of one thread
    assert sorted(said) == [name for name, fold in zip(sorted(targets), dealt, strict=True) if fold == 0]
    first = {name: one["mechanisms"][0]["name"] if one["mechanisms"] else one["verdict"] for name, one in said.items()}
    words = {black_box.NOTHING: "adequate"}
    assert first == {name: words.get(targets[name], targets[name]) for name in said}


@pytest.mark.slow
@pytest.mark.long
def test_every_step_on_a_small_bank(small_bank, tmp_path, monkeypatch):
    """One case is diagnosed, two are put to the rivals; the others were, it seems, before the commands were broken off."""
    out = tmp_path / "bank"
    shutil.copytree(small_bank[0], out)
    labels = bank.read_labels(out)
    assert list(bank.read_labels(out, 3)) == list(labels)[:3]
    fresh = next(name for name, label in labels.items() if label["class"] == "single")
    files = {name: out / "diagnoses" / name / "diagnosis.json" for name in labels}
    workers.write_whole(out / "diagnoses" / "version.json", {"sha256": answers.digest()})
    for name in labels:
        if name != fresh:
            workers.write_whole(files[name], answer("adequate"))
    before = {name: file.stat().st_mtime_ns for name, file in files.items() if name != fresh}
    Diagnose(out, Workers(jobs=1)).run()
    assert {name: file.stat().st_mtime_ns for name, file in files.items() if name != fresh} == before
    said = json.loads(files[fresh].read_text(encoding="utf-8"))
    assert said["verdict"] in ("adequate", "named", "ambiguous", "discovered", "unknown", "insufficient")
    assert {"mechanisms", "location", "fit", "detectable", "next_test"} <= set(said)
    assert ("distance_change" in said) == bool(said["mechanisms"])
    spoilt = next(name for name, label in labels.items() if label["fault"])
    for name in set(labels) - {fresh, spoilt}:
        for rule in rivals.RULES:
            workers.write_whole(out / "rivals" / rule / name / "diagnosis.json", answer("adequate"))
        workers.write_whole(out / "rivals" / "features" / f"{name}.json", {"axles": labels[name]["axles"]})
    monkeypatch.setattr(Workers, "make", lambda *_: ThisProcess())  # which has loaded all that the rivals need
    Rivals(out).run()
    Score(out).run()
    figures = restored(json.loads((out / "score.json").read_text(encoding="utf-8")))
    assert figures["cases"] == dict.fromkeys(SHARES, 1)
    assert set(rivals.NAMES) == set(page.RIVALS)
    for name in rivals.NAMES:
        assert (out / "rivals" / name / "score.json").is_file()
        for case in labels:
            told = json.loads((out / "rivals" / name / case / "diagnosis.json").read_text(encoding="utf-8"))
            assert {one["name"] for one in told["mechanisms"]} <= set(mechanisms.ALL)
    workers.write_whole(out / "diagnoses" / "version.json", {"sha256": "another"})
    with pytest.raises(BankError, match="another version"):
        Diagnose(out).run()


def said_of(name, **values):
    whole = {parameter.name: parameter.null for parameter in mechanisms.ALL[name].parameters} | values
    parameters = {key: {"value": value, "interval90": [0.8 * value, 1.2 * value]} for key, value in values.items()}
    model = {"tau_m_per_J": 2.3e-4, "mu_cd": {"A1": 0.058}, "mechanisms": {name: whole}}
    return {"model": model, "mechanisms": [{"name": name, "parameters": parameters}]}


@pytest.mark.long
def test_change_of_distance_is_that_of_stops_driven_with_and_without():
    campaign = dataclasses.replace(read_campaign(demo_campaign()), tune=("A1",), validate=())
    band = {"lowest_mps": 5.0, "highest_mps": 100.0}
    found = distance_change(campaign, said_of("non_adhesive_brake", force_n=4000.0, **band))
    # Some 4 kN beside the 25 kN or so that such rail carries.
    assert -0.25 < found["value"] < -0.05
    low, high = found["interval90"]
    assert low < found["value"] < high < 0.0
    nothing = distance_change(campaign, said_of("non_adhesive_brake", force_n=0.0, **band))
    assert nothing == {"value": 0.0, "interval90": [0.0, 0.0]}
    beyond = distance_change(campaign, said_of("adhesion_patch", change=-0.4, start_m=50_000.0, length_m=100.0))
    assert abs(beyond["value"]) < 1e-6
