"""Two campaigns compared: differences are antisymmetric, nothing differs from itself, and what cannot be told is not told."""

import dataclasses
import json

import numpy as np
import pytest
from scipy.stats import ttest_ind
from test_diagnosis_report import DISCOVERED, SUSPECT

from wsp_env.diagnosis.answer import Worth
from wsp_env.diagnosis.changes import friction_change, mechanism_changes, sentence, tau_change
from wsp_env.diagnosis.index import summary
from wsp_env.diagnosis.stored import read_diagnosis
from wsp_env.recordings import CampaignError
from wsp_env.recordings.tuning import RunScore, Tuning


def tuning(tau, frictions, width=1.2):
    runs = {f"A{i}": RunScore("tune", mu, True, (0.01,)) for i, mu in enumerate(frictions)}
    return Tuning(tau, (tau / width, tau * width), runs)


ONE = tuning(2e-4, (0.05, 0.052, 0.049, 0.051))
OTHER = tuning(4e-4, (0.06, 0.063, 0.058))


def test_nothing_differs_from_itself(found):
    changes = [tau_change(ONE, ONE), friction_change(ONE, ONE), *mechanism_changes(found, found)]
    assert [one.shown for one in changes] == [False] * len(changes)
    assert sentence(changes, "a", "b") == "Nothing that these recordings show has changed from a to b."


def test_tau_is_compared_by_its_ratio():
    there, back = tau_change(ONE, OTHER), tau_change(OTHER, ONE)
    assert there.difference.startswith("+100 %")
    assert back.difference.startswith("-50 %")
    assert there.shown
    assert back.shown
    assert not tau_change(tuning(2e-4, (0.05,), 3.0), OTHER).shown  # an interval from 0.7 to 6
    low = np.exp(np.log(2.0) - np.sqrt(2.0) * np.log(1.2))
    assert f"({100.0 * (low - 1.0):+.0f} to" in there.difference


def test_an_open_tau_is_not_compared():
    open_ = dataclasses.replace(ONE, interval95=(0.0, np.inf))
    assert tau_change(open_, OTHER).shown is None


def test_friction_is_compared_by_welchs_interval():
    values = [[score.mu_cd for score in one.runs.values()] for one in (ONE, OTHER)]
    reference = ttest_ind(values[1], values[0], equal_var=False).confidence_interval(0.95)
    assert f"({reference.low:+.4f} to {reference.high:+.4f}, 95 %)" in friction_change(ONE, OTHER).difference
    assert friction_change(ONE, tuning(2e-4, (0.05,))).shown is None  # one run is no sample


@pytest.mark.parametrize(
    ("least", "verdict", "shown"),
    [(3e-4, "adequate", True), (0.1, "adequate", None), (3e-4, "data", None), (3e-4, "unknown", True)],
)
def test_what_is_gone_is_told_only_where_it_would_have_been_seen(found, least, verdict, shown):
    without = dataclasses.replace(found, mechanisms=(), verdict=verdict, detectable={"track_gradient": {"rise": least}})
    gone = next(one for one in mechanism_changes(found, without) if one.what == "track gradient")
    new = next(one for one in mechanism_changes(without, found) if one.what == "track gradient")
    assert gone.shown is new.shown is shown
    if shown:
        assert "is gone" in gone.words
        assert "is new" in new.words


def test_a_parameter_that_moves_beyond_both_intervals_has_changed(found):
    def at(value):
        (one,) = found.mechanisms
        rise = dataclasses.replace(one.parameters["rise"], value=value, interval90=(value - 0.0008, value + 0.0008))
        return dataclasses.replace(found, mechanisms=(dataclasses.replace(one, parameters={"rise": rise}),))

    half = np.sqrt(2.0) * 0.0008 * 1.960 / 1.645
    assert mechanism_changes(at(-0.0089), at(-0.0089 + 1.01 * half))[0].shown
    assert not mechanism_changes(at(-0.0089), at(-0.0089 + 0.99 * half))[0].shown


def test_a_diagnosis_is_read_as_it_was_written(found, tmp_path):
    whole = dataclasses.replace(
        found, discovered=(DISCOVERED,), suspect_channels=(SUSPECT,), worth=Worth(0.03, (0.02, 0.04), 0.2, 420.0)
    )
    for one in (found, whole):
        (tmp_path / "diagnosis.json").write_text(json.dumps(one.to_json()), encoding="utf-8")
        again = read_diagnosis(tmp_path / "diagnosis.json")
        assert again == one
    assert "track gradient in 2" in summary([found, whole])


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"campaign": 1}', '{"mechanisms": [1]}', "null"])
def test_what_is_no_diagnosis_is_refused_in_a_line(text, tmp_path):
    (tmp_path / "diagnosis.json").write_text(text, encoding="utf-8")
    with pytest.raises(CampaignError, match="holds no diagnosis"):
        read_diagnosis(tmp_path / "diagnosis.json")
