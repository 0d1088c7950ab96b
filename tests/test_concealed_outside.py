"""The proof on other people's campaigns: labels, every figure on made-up answers, resuming, refusals, the tables."""

import json

import pytest

from experiments.concealed import answers, outside, page, workers
from experiments.concealed.__main__ import Outside
from experiments.concealed.errors import BankError
from experiments.concealed.promised import by_group, not_there, placed, promised, removed
from experiments.concealed.rates import plain, restored
from experiments.concealed.required import common
from experiments.concealed.truths import Truth, of_bank, of_label
from wsp_env.executor import ThisProcess


def named(*names, sets=(), confidence=0.9, verdict="named", removed_validate=0.8, seconds=10.0, **parameters):
    """Return a diagnosis; `sets` are the alternatives of each name."""
    sets = sets or [()] * len(names)
    mechanisms = [
        {"name": name, "confidence": confidence, "alternatives": [name, *others], "parameters": parameters}
        for name, others in zip(names, sets, strict=True)
    ]
    fit = {"noise_floor": 1.0, "baseline": {"validate": 5.0}, "extended": {}, "removed_validate": removed_validate}
    return {"verdict": verdict, "mechanisms": mechanisms, "fit": fit, "seconds": seconds}


def term(slot, *axles, also=(), **values):
    """Return an answer with one discovered term."""
    discovered = [{"slot": slot, "slots_not_separable": list(also), "axles": list(axles)}]
    return named(verdict="discovered", **values) | {"discovered": discovered}


def nothing(verdict="adequate", **values):
    """Return an answer that accepts nothing."""
    return named(verdict=verdict, **{"removed_validate": None, **values})


SINGLE = Truth("single", ("wheel_radius",))
OUTSIDE = Truth("outside", slots=("brake torque", "sensor"), axles=(2,))


def test_labels_say_what_is_true():
    assert of_label("c", {"effects": []}).kind == "null"
    assert of_label("c", {"effects": ["wheel_radius"]})[:2] == ("single", ("wheel_radius",))
    assert of_label("c", {"effects": ["wheel_radius", "load_transfer"]}).kind == "pair"
    assert of_label("c", {"effects": ["wheel_radius", "torque_ripple"]})[:2] == ("mixed", ("wheel_radius",))
    ripple = of_label("c", {"effects": ["torque_ripple"], "slot": "brake torque", "axle": [3, 1]})
    assert (ripple.kind, ripple.names, ripple.slots, ripple.axles) == ("outside", (), ("brake torque",), (1, 3))
    assert of_label("c", {"effects": ["slack"], "mechanisms": ["coupler_force"]})[:2] == ("single", ("coupler_force",))
    assert of_label("c", {"effects": ["wheel_radius"], "fault": "copied"}).kind == "fault"
    assert of_label("c", {"effects": ["wheel_radius"], "kind": "confounded"}).kind == "confounded"
    groups = ({"group": "wet"}, {"plus": True}, {})
    assert [of_label("A/c", {"effects": []} | one).group for one in groups] == ["wet", "plus", "A"]
    given = {"wheel_radius": {"change": -0.01, "axle": 2, "of mine": 3.0}, "load_transfer": [1.0, 2.0]}
    told = of_label("c", {"effects": ["wheel_radius", "load_transfer"], "params": given})
    assert told.parameters == {"wheel_radius": {"change": -0.01, "axle": 2.0}}


@pytest.mark.parametrize(
    ("label", "wrong"),
    [
        ({}, '"effects" must be a list'),
        ({"effects": "wheel_radius"}, '"effects" must be a list'),
        ({"effects": [], "mechanisms": ["nonsense"]}, "nonsense"),
        ({"effects": [], "kind": "odd"}, "valid: null"),
        ({"effects": ["x"], "slot": "wheel"}, "valid: brake torque"),
    ],
)
def test_labels_that_cannot_be_understood_are_refused(label, wrong):
    with pytest.raises(BankError, match=wrong):
        of_label("c07", label)


def test_labels_of_the_bank_become_the_same_truths():
    effect = {"name": "dragging_brake", "size": 300.0, "multiple": 2.0, "axle": 5, "variant": 0}
    label = {
        "class": "single",
        "mechanisms": ["dragging_brake"],
        "effects": [effect],
        "axles": 4,
        "start_positions": False,
        "net": 1.5,
    }
    truth = of_bank(label)
    assert truth[:3] == ("single", ("dragging_brake",), True)
    assert truth.parameters == {"dragging_brake": {"torque_nm": 300.0, "axle": 2.0}}
    assert truth.group == "start positions unknown"
    assert not of_bank(label | {"net": 0.9}).matters
    foreign = {"class": "foreign", "mechanisms": [], "effects": [effect | {"name": "torque_drift"}], "axles": 4, "net": 2.0}
    assert of_bank(foreign | {"slots": ["sensor"], "slot_axles": [2]})[:5] == ("outside", (), True, ("sensor",), (2,))


def test_alarms_are_all_but_adequate_and_insufficient():
    cases = [(Truth("null"), nothing(verdict)) for verdict in ("adequate", "insufficient", "unknown", "discovered", "data")]
    assert promised([*cases, (Truth("null"), named("load_transfer"))])["false_alarms"][:2] == (4, 6)


def test_names_that_are_not_there():
    assert not not_there(SINGLE, named("wheel_radius"))
    assert not not_there(SINGLE, named("clock_offset", sets=[("wheel_radius",)]))
    assert not_there(SINGLE, named("clock_offset"))
    assert not_there(SINGLE, named("wheel_radius", "clock_offset"))
    assert not_there(SINGLE, named("wheel_radius", "clock_offset", sets=[(), ("wheel_radius",)]))  # one is there, not two
    assert not_there(OUTSIDE, named("clock_offset"))
    assert not not_there(OUTSIDE, nothing("unknown"))
    assert not_there(Truth("null"), named("clock_offset"))
    figures = promised([(SINGLE, named("clock_offset")), (OUTSIDE, named("clock_offset")), (Truth("null"), nothing())])
    assert figures["not_there"][:2] == (2, 3)
    assert figures["not_there_library"][:2] == figures["outside_named"][:2] == (1, 1)


def test_singles_pairs_and_mixed():
    two, three = ("wheel_radius",), ("wheel_radius", "clock_offset")
    pair = Truth("pair", ("wheel_radius", "load_transfer"))
    mixed = Truth("mixed", ("wheel_radius",))
    figures = promised([
        (SINGLE, named("wheel_radius")),
        (SINGLE, named("load_transfer", sets=[two])),
        (SINGLE, named("load_transfer", sets=[three], verdict="ambiguous")),
        (SINGLE, nothing()),
        (SINGLE._replace(matters=False), nothing()),
        (pair, named("load_transfer", "wheel_radius")),
        (pair, named("load_transfer")),
        (mixed, named("wheel_radius")),
        (mixed, nothing("unknown")),
    ])  # fmt: skip
    assert figures["singles_in_set_of_two"][:2] == (2, 4)
    assert figures["singles_first"][:2] == figures["singles_missed"][:2] == (1, 4)
    assert figures["pairs_both"][:2] == figures["mixed_kept"][:2] == (1, 2)


def test_terms_are_placed_by_slot_and_axles():
    assert placed(OUTSIDE, term("sensor", 2))
    assert placed(OUTSIDE, term("friction", 2, also=["brake torque"]))
    assert not placed(OUTSIDE, term("friction", 2))
    assert not placed(OUTSIDE, term("brake torque", 2, 3))
    assert not placed(OUTSIDE, nothing("unknown"))
    assert placed(OUTSIDE._replace(axles=()), term("brake torque", 2, 3))
    figures = promised([(OUTSIDE, term("sensor", 2)), (OUTSIDE, nothing()), (Truth("outside"), term("sensor", 2))])
    assert figures["outside_placed"][:2] == (1, 2)  # where the label does not say where, nothing is counted


def test_residual_removed_outside_the_library():
    assert removed(term("sensor", removed_validate=0.7)) == 0.7
    assert removed(nothing()) == 0.0
    assert removed({"verdict": "data", "mechanisms": []}) == 0.0
    quiet = nothing()
    quiet["fit"]["baseline"]["validate"] = 0.9
    assert removed(quiet) is None
    cases = [(OUTSIDE, one) for one in (term("sensor", removed_validate=0.9), term("sensor", removed_validate=0.6), nothing())]
    assert promised([*cases, (OUTSIDE, quiet), (SINGLE, nothing())])["outside_removed"]["median"] == pytest.approx(0.6)


def test_parameters_are_compared_where_the_label_gives_them():
    truth = SINGLE._replace(parameters={"wheel_radius": {"change": -0.01, "axle": 2.0}})
    change = {"value": -0.011, "interval90": [-0.012, -0.0095]}

    def on(axle):
        return named("wheel_radius", change=change, axle={"value": axle, "interval90": [axle, axle]})

    cases = [(truth, on(2.0)), (truth, on(3.0)), (SINGLE, on(2.0)), (truth, named("clock_offset", change=change))]
    figures = promised(cases)["parameters"]
    assert figures["relative_error"]["count"] == 2
    assert figures["relative_error"]["mean"] == pytest.approx((0.1 + 1.0) / 2)
    assert figures["interval90_covers"][:2] == (1, 2)


def test_confidence_is_held_against_what_is_there():
    cases = [(SINGLE, named("wheel_radius"))] * 3 + [(SINGLE, named("clock_offset"))]
    found = promised(cases)["calibration"]
    assert found["claims"] == 4
    assert found["expected_error"] == pytest.approx(0.9 - 0.75)


def test_channel_faults_are_counted_by_kind():
    copied, halved = Truth("fault", fault="copied"), Truth("fault", ("wheel_radius",), fault="halved")
    faults = promised([
        (copied, nothing("data")), (copied, named("load_transfer")), (halved, nothing()), (halved, named("wheel_radius")),
    ])["faults"]  # fmt: skip
    assert faults["all"]["as_data"][:2] == (1, 4)
    assert faults["copied"]["as_data"][:2] == faults["copied"]["as_physics"][:2] == (1, 2)
    assert faults["halved"]["as_physics"][:2] == (0, 2)  # the name is true


def test_groups_are_counted_apart_and_seconds_told():
    cases = [(Truth("null", group=group), nothing(seconds=s)) for group, s in (("A", 10.0), ("A", 30.0), ("B", 20.0))]
    assert promised(cases)["seconds"]["median"] == 20.0
    assert {name: one["seconds"]["highest"] for name, one in by_group(cases).items()} == {"A": 30.0, "B": 20.0}
    assert by_group(cases[:2]) == {}


def test_table_holds_figures_against_what_is_required():
    cases = [(Truth("null"), nothing()), (SINGLE, nothing()), (OUTSIDE, term("sensor", 2))]
    figures = promised(cases)
    assert restored(json.loads(json.dumps(plain(figures)))) == figures
    marks = {one.what: one.mark for one in common(figures)}
    assert marks["false alarms on nulls"] == "yes"
    assert marks["library: right name in a set of at most two, singles that matter"] == "**no**"
    assert marks["library: both of a pair found"] == "nothing to measure"
    assert marks["outside the library: slot and axles right"] == "yes"
    assert marks["outside the library: held-out residual removed, median"] == "yes"
    assert marks["calibration error of the stated confidence"] == ""
    assert not [what for what in marks if what.startswith("channel faults")]


@pytest.fixture
def campaigns(tmp_path):
    """Return a folder of three campaigns in two groups, that nobody can diagnose."""
    labels = {"A/one": {"effects": []}, "A/two": {"effects": ["wheel_radius"]}, "B/one": {"effects": ["torque_ripple"]}}
    for name, label in labels.items():
        folder = tmp_path / "theirs" / name
        folder.mkdir(parents=True)
        (folder / "campaign.toml").write_text("", encoding="utf-8")
        (folder / "label.json").write_text(json.dumps(label), encoding="utf-8")
    return tmp_path / "theirs"


def test_goes_on_where_it_was_broken_off(campaigns, tmp_path, monkeypatch):
    asked = []

    def here(work, tasks, executor, title):
        asked.append([task.name for task in tasks])
        return ThisProcess().run(work, tasks)

    monkeypatch.setattr(outside, "each", here)
    monkeypatch.setattr(outside, "answer", lambda folder: (nothing(), None))
    out = tmp_path / "out"
    frozen = outside.read_labels(campaigns)
    outside.freeze(frozen, out)
    workers.write_whole(out / "answers" / "A" / "two" / "diagnosis.json", named("wheel_radius"))
    Outside(campaigns, out, title="Theirs").run()
    Outside(campaigns, out, title="Theirs").run()
    assert asked == [["A/one", "B/one"], []]
    assert (out / "labels.sha256").read_text(encoding="utf-8").split()[0] == frozen.sha256
    scored = restored(json.loads((out / "score.json").read_text(encoding="utf-8")))
    assert scored["promised"]["singles_in_set_of_two"][:2] == (1, 1)
    assert set(scored["groups"]) == {"A", "B"}
    text = (out / "page.md").read_text(encoding="utf-8")
    assert text == page.others(scored)
    assert text.startswith("### Theirs")
    assert answers.digest() in text
    assert "| false alarms on nulls | at most 5 % | 0.0 % (0 of 1; 0.0 % to 95.0 %) | yes |" in text


def test_labels_are_frozen_before_the_first_answer(campaigns, tmp_path, monkeypatch):
    out = tmp_path / "out"

    def stop(work, tasks, executor, title):
        assert (out / "labels.sha256").is_file()
        raise KeyboardInterrupt

    monkeypatch.setattr(outside, "each", stop)
    with pytest.raises(KeyboardInterrupt):
        outside.run(campaigns, out, ThisProcess())
    (campaigns / "A" / "one" / "label.json").write_text('{"effects": ["load_transfer"]}', encoding="utf-8")
    with pytest.raises(BankError, match="labels have changed"):
        outside.run(campaigns, out, ThisProcess())
    with pytest.raises(BankError, match="labels have changed"):
        outside.score(campaigns, out, "")


def test_breaking_down_on_one_campaign_leaves_the_others(campaigns, tmp_path, monkeypatch):
    def break_down(folder):
        if folder.parent.name == "B":
            raise ZeroDivisionError
        return nothing(), None

    monkeypatch.setattr(outside, "answer", break_down)
    with pytest.raises(BankError, match=r"broke down on 1 of 3 campaigns, see .*B.one.failed\.txt"):
        outside.run(campaigns, tmp_path / "out", ThisProcess())
    assert set(answers.read_answers(tmp_path / "out" / "answers")) == {"A/one", "A/two"}
    assert "ZeroDivisionError" in (tmp_path / "out" / "answers" / "B" / "one" / "failed.txt").read_text(encoding="utf-8")


def test_two_versions_of_the_code_are_not_mixed(campaigns, tmp_path):
    workers.write_whole(tmp_path / "out" / "answers" / "version.json", {"sha256": "another"})
    with pytest.raises(BankError, match="another version"):
        outside.run(campaigns, tmp_path / "out", ThisProcess())


def test_what_is_missing_is_told(campaigns, tmp_path):
    with pytest.raises(BankError, match="no answer for 3 of 3"):
        outside.score(campaigns, tmp_path / "out", "")
    (campaigns / "A" / "one" / "label.json").unlink()
    with pytest.raises(BankError, match=r"1 of 3 campaigns .* no label\.json, the first is A/one"):
        outside.read_labels(campaigns)
    (tmp_path / "empty").mkdir()
    with pytest.raises(BankError, match="holds no campaign"):
        outside.read_labels(tmp_path / "empty")
