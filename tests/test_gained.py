"""What policies pay over the one that they began from."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import agents.gained
from agents.gained import Arguments, compare, table

SHIPPED = Path(__file__).parents[1] / "agents/trained"


def test_a_policy_pays_what_it_pays_itself():
    given = Arguments(base=SHIPPED / "wheelset", policies=(SHIPPED / "wheelset",), world="nominal", sets=1, stops=8)
    rows = compare(given)
    assert [row["law"] for row in rows] == ["both", "recovering", "classic"]
    for row in rows:
        assert [row[name] for name in ("paid", "travelled", "slid", "air")] == [1.0] * 4
        assert row["half"] == row["locked_s"] == row["ran_on"] == 0.0


def test_ratios_are_taken_vehicle_by_vehicle_and_laws_count_alike(monkeypatch):
    def braked(policy, given, law, price):
        assert price == 4.3
        saved = {"base": 0.0, "recovering": 0.1, "classic": 0.3}[law if policy.name == "new" else "base"]
        paid = np.array([100.0, 1000.0]) * (1.0 - saved)
        return {
            "paid": paid,
            "travelled": paid,
            "slid": paid,
            "air": paid,
            "locked_s": np.array([0.0, 1.0 * (law == "classic")]),
            "ran_on": np.array([1.0, 2.0 * (law == "classic")]),
        }

    monkeypatch.setattr(agents.gained, "braked", braked)
    contract = SimpleNamespace(vehicle="bogie", training={"arguments": {"slide_price": 4.3}})
    monkeypatch.setattr(agents.gained, "load_policy", lambda folder: SimpleNamespace(name=folder.name, contract=contract))
    rows = compare(Arguments(base=Path("old"), policies=(Path("new"),)))
    assert {row["law"]: row["paid"] for row in rows} == pytest.approx({"both": 0.8, "recovering": 0.9, "classic": 0.7})
    assert {row["law"]: row["locked_s"] for row in rows} == {"both": 1.0, "recovering": 0.0, "classic": 1.0}
    assert {row["law"]: row["ran_on"] for row in rows} == {"both": 4, "recovering": 1, "classic": 3}


def test_several_trainings_have_an_interval_of_their_own():
    row = {
        "policy": "a",
        "law": "both",
        "paid": 0.98,
        "half": 0.01,
        "travelled": 1.0,
        "slid": 0.9,
        "air": 1.1,
        "locked_s": 0.0,
        "ran_on": 0,
    }
    assert "over the policies" not in table([row])
    text = table([row, {**row, "policy": "b", "paid": 0.99}])
    mean, least = 0.985, "0.9800 to 0.9900"
    assert f"| 2 | both | {mean:.4f}" in text
    assert least in text


def test_sets_have_stops_and_vehicles_of_their_own(monkeypatch):
    """A set more leaves those before as they are."""
    seen = []
    monkeypatch.setattr(agents.gained, "world", lambda *given: seen.append(given[-1]) or agents.drawn.world(*given))

    class Nothing:
        blocks = np.zeros(1)

        def __init__(self, believed, parts):
            pass

        def figures(self, policy):
            names = ("distance_m", "mean_slip_mps", "duration_s", "air_nl", "locked_s")
            return {name: np.ones(1) for name in names} | {"stopped": np.array([True])}

    monkeypatch.setattr(agents.gained, "Drawn", Nothing)
    given = Arguments(Path(), (), sets=3, stops=8)
    policy = SimpleNamespace(contract=SimpleNamespace(vehicle="bogie"))
    found = agents.gained.braked(policy, given, "classic", 4.0)
    assert seen == [given.drawn_by + number for number in range(3)]
    assert found["paid"].tolist() == [5.0] * 3
    assert given.world == "all"


def test_what_cannot_be_compared_is_refused_before_anything_is_braked():
    with pytest.raises(SystemExit, match="is for a wheelset, the base for a bogie"):
        compare(Arguments(SHIPPED / "bogie", (SHIPPED / "wheelset",)))
    with pytest.raises(SystemExit, match="nowhere"):
        compare(Arguments(SHIPPED / "bogie", (Path("nowhere"),)))
    with pytest.raises(SystemExit, match="at least 8 stops"):
        compare(Arguments(SHIPPED / "bogie", (SHIPPED / "bogie",), stops=1))
