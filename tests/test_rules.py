"""The search of the rules' own best thresholds."""

import dataclasses
import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

from agents.measure import Yardstick, mixed
from agents.rules import RANGES, SEARCHED, RuleSearch, Trials, main, read_best, search, show
from baselines.rule_based import RuleBasedParameters, RuleBasedWSP

TINY = RuleSearch(vehicle="wheelset", stops=16, each=2, trials=4, elite=2, classic_share=0.5)


@pytest.fixture(scope="module")
def trials():
    return Trials(TINY)


def point(trials, parameters):
    return (np.array([getattr(parameters, name) for name in RANGES]) - trials.low) / (trials.high - trials.low)


def test_trials_that_brake_together_cost_what_each_costs_alone(trials):
    """One row of thresholds for each stop is the same as one controller for each set of thresholds."""
    default = RuleBasedParameters()
    other = dataclasses.replace(default, slip_per_speed=0.03, pulse_off_s=0.1)
    points = np.stack([point(trials, parameters) for parameters in (default, other, default, other)])
    found = trials.cost(points, 2.0)
    yardstick = Yardstick("wheelset", mixed("wheelset", TINY.each, TINY.classic_share, SEARCHED))
    for parameters, together in zip((default, other), found, strict=False):
        alone = yardstick.figures(RuleBasedWSP(parameters))
        paid = alone["distance_m"] + 2.0 * alone["mean_slip_mps"] * alone["duration_s"] + 10.0 * alone["locked_s"]
        assert_allclose(together, paid.mean(), rtol=1e-9)
    assert_allclose(found[:2], found[2:], rtol=1e-12)


@pytest.mark.long
def test_air_has_its_price(trials):
    points = np.stack([point(trials, RuleBasedParameters())] * TINY.trials)
    dear = Trials(dataclasses.replace(TINY, air_price=0.5)).cost(points, 2.0)[0]
    air = trials.yardstick.figures(RuleBasedWSP())["air_nl"][: TINY.each].mean()
    assert_allclose(dear - trials.cost(points, 2.0)[0], 0.5 * air, rtol=1e-9)


@pytest.mark.long
def test_search_never_ends_worse_than_the_defaults_and_within_its_ranges(trials):
    best = search(trials, TINY, 2.0)
    assert set(best) == set(RANGES)
    for name, value in best.items():
        low, high = RANGES[name]
        assert low - 1e-4 <= value <= high + 1e-4
    points = np.stack([point(trials, RuleBasedParameters(**best)), point(trials, RuleBasedParameters())] * 2)
    found = trials.cost(points, 2.0)
    assert found[0] <= found[1] * (1.0 + 1e-3)  # thresholds are rounded to four digits


def test_thresholds_are_written_read_and_shown(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("agents.rules.search", lambda *_: {"slip_base_mps": 0.25})
    main(dataclasses.replace(TINY, out=tmp_path, slide_prices=(2.0,)))
    capsys.readouterr()
    assert read_best(tmp_path / "wheelset")["2"].slip_base_mps == 0.25
    assert json.loads((tmp_path / "wheelset/rules.json").read_text())["search"]["stops"] == 16
    file = tmp_path / "wheelset/rules.json"
    older = json.loads(file.read_text())
    for name in ("controller", "air_price"):  # a search of before that did not know them had their defaults: it goes on
        del older["search"][name]
    file.write_text(json.dumps(older))
    monkeypatch.setattr("agents.rules.search", lambda *_: {"slip_base_mps": 0.5})
    main(dataclasses.replace(TINY, out=tmp_path, slide_prices=(2.0,)))
    assert read_best(tmp_path / "wheelset")["2"].slip_base_mps == 0.25
    main(dataclasses.replace(TINY, out=tmp_path, show="2"))
    assert "rule-based.slip_base_mps=0.25 " in capsys.readouterr().out
    with pytest.raises(SystemExit, match="no price 7; valid: 2"):
        show(tmp_path / "wheelset", "7")
    assert read_best(tmp_path) == {}
