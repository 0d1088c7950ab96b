"""What decides, each rule by itself, on small searches made by hand: columns and residuals are a few orthogonal directions."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wsp_env.diagnosis import decide
from wsp_env.diagnosis.candidates import Candidate, Variant
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.fitting import Fitted
from wsp_env.diagnosis.gls import LeastSquares
from wsp_env.diagnosis.rules import (
    CHANCE,
    HELD_OUT_SHARE,
    INDISTINCT,
    LEAST_MULTIPLE,
    LEAST_REDUCTION,
    LEAST_SHARE,
    LEAST_SHARE_ANY,
    LEAST_SHARE_APART,
    LEAST_SHARE_EXACT,
    OVER_NULLS,
    SHARE_OF_REDUCTION,
    Accepted,
    Trial,
    alternatives_to,
    expected,
    is_normal,
    is_shadow,
    largest_cosine,
    least_held_out,
    least_reduction,
    least_share,
)
from wsp_env.diagnosis.search import Found, LibrarySearch, Products, Scan
from wsp_env.plant.mechanisms import ALL

ROWS = 8
#: Mechanisms of one fitted size each: two that the adhesion alone shows, two that the vehicle's balance shows and that have one
#: form, and one that both balances show.
CLEANING, MEMORY, GRADIENT, MASS, PADS = (
    "leading_axle_cleaning",
    "contaminant_memory",
    "track_gradient",
    "vehicle_mass",
    "pad_friction",
)


def unit(*share: float) -> np.ndarray:
    """Return a direction (ROWS,) of length 1 with these first components, each over a pair of rows, one of either half."""
    components = np.zeros(ROWS // 2)
    components[: len(share)] = share
    direction = np.repeat(components, 2)
    return direction / np.linalg.norm(direction)


def variant(name: str) -> Variant:
    return Variant(name, (next(size.name for size in ALL[name].sizes if size.fitted),), {})


def scan_of(columns: dict[str, np.ndarray], residual: np.ndarray) -> Scan:
    """Return the scan of mechanisms with a column each; the runs to validate are every other row."""
    x = np.column_stack(list(columns.values()))
    candidates = tuple(Candidate(name, np.zeros((0, 1)), variant(name), (1.0,)) for name in columns)

    def products(rows: slice) -> Products:
        return Products(x[rows].T @ x[rows], x[rows].T @ residual[rows], float(residual[rows] @ residual[rows]), ROWS)

    parts = tuple(slice(i, i + 1) for i in range(len(columns)))
    return Scan(candidates, parts, 0, products(slice(None)), products(slice(0, None, 2)), products(slice(1, None, 2)))


def search_of(columns: dict[str, np.ndarray], residual: np.ndarray) -> LibrarySearch:
    """Return a search whose null recordings hold nothing."""
    silent = [scan_of(columns, np.zeros(ROWS)) for _ in range(3)]
    return LibrarySearch(scan_of(columns, residual), silent, np.zeros(0, dtype=int), np.zeros(0))


def found(search: LibrarySearch, name: str, **changes: object) -> Found:
    one = next(one for one in search.found() if one.name == name)
    return dataclasses.replace(one, **changes)


def trial(one: Found, multiple: float = 1.0, **choice: float) -> Trial:
    own = variant(one.name)
    fitted = Fitted(Model(1e-4, (0.05,), {one.name: choice}), (own,), (np.zeros(1),), (np.eye(1),), 0.0)
    return Trial(one, own, own, fitted, multiple, np.zeros(1))


def accepted(one: Found) -> Accepted:
    own = variant(one.name)
    return Accepted(one, own, own, (one.name,), 1.0, 1.0, np.zeros(1))


def test_a_search_made_by_hand_is_the_least_squares():
    search = search_of({CLEANING: unit(1.0), MEMORY: unit(1.0, 1.0)}, -10.0 * unit(1.0))
    assert found(search, CLEANING).reduction == pytest.approx(100.0)
    assert found(search, MEMORY).reduction == pytest.approx(50.0)
    assert expected(search, found(search, CLEANING)) == pytest.approx(50.0)  # half of the rows


def test_a_mechanism_explains_nothing_on_its_impossible_side():
    search = search_of({CLEANING: unit(1.0), GRADIENT: unit(1.0)}, 10.0 * unit(1.0))
    assert found(search, CLEANING).reduction == 0.0  # no wheel brings contaminant along
    assert found(search, GRADIENT).reduction == pytest.approx(100.0)


def test_least_reduction_of_a_first_mechanism():
    search = search_of({CLEANING: unit(1.0)}, 10.0 * unit(1.0))
    for largest in (1.0, 40.0):
        one = found(search, CLEANING, nulls=np.array([0.5, largest]))
        least = least_reduction(search, one, variant(CLEANING), ())
        assert least == max(LEAST_REDUCTION, OVER_NULLS * largest)


@pytest.mark.parametrize(("overlap", "share"), [(0.0, LEAST_SHARE_ANY), (0.8, LEAST_SHARE * 0.8**2), (1.0, LEAST_SHARE)])
def test_least_reduction_beside_another_grows_with_what_they_have_in_common(overlap, share):
    columns = {CLEANING: unit(1.0), MEMORY: unit(overlap, np.sqrt(1.0 - overlap**2))}
    search = search_of(columns, 100.0 * unit(1.0))
    first = accepted(found(search, CLEANING, reduction=1e4))
    least = least_reduction(search, found(search, MEMORY), variant(MEMORY), [first])
    assert least == pytest.approx(share * 1e4)


@pytest.mark.parametrize(
    ("one", "other", "share"),
    [
        (MEMORY, GRADIENT, LEAST_SHARE_EXACT),  # a gradient has one form
        (GRADIENT, MASS, LEAST_SHARE_EXACT),  # whatever they share
        (GRADIENT, CLEANING, LEAST_SHARE_APART),  # no balance shows both
        (PADS, CLEANING, LEAST_SHARE_APART),  # the vehicle's shows the pads alone
        (CLEANING, PADS, LEAST_SHARE_ANY),
        (MEMORY, CLEANING, LEAST_SHARE_ANY),
    ],
)
def test_floor_of_what_a_further_mechanism_must_explain(one, other, share):
    assert least_share(one, other) == share


def test_what_must_show_on_held_out_runs():
    assert least_held_out(0.0) == 0.0
    assert least_held_out(100.0) == pytest.approx(HELD_OUT_SHARE * 100.0 - 2.0 * CHANCE * 10.0)
    assert least_held_out(10.0) < 0.0  # chance alone may take as much
    assert least_held_out(1e6) == pytest.approx(HELD_OUT_SHARE * 1e6, rel=0.01)


@given(st.floats(0.0, np.pi / 2.0))
def test_cosine_of_two_columns_is_theirs(angle):
    x = np.column_stack([unit(1.0), unit(np.cos(angle), np.sin(angle))])
    assert largest_cosine(x.T @ x, np.array([0]), np.array([1])) == pytest.approx(np.cos(angle), abs=1e-7)


def test_cosine_of_sets_is_that_of_their_nearest_directions():
    x = np.column_stack([unit(1.0), unit(0.0, 1.0), unit(1.0, 1.0), unit(0.0, 0.0, 1.0)])
    gram = x.T @ x
    assert largest_cosine(gram, np.array([0, 1]), np.array([2, 3])) == pytest.approx(1.0)  # the first two span the third
    assert largest_cosine(gram, np.array([0, 1]), np.array([3])) == pytest.approx(0.0)
    scaled = np.diag([1e-3, 1.0, 1e4, 1.0]) @ gram @ np.diag([1e-3, 1.0, 1e4, 1.0])
    assert largest_cosine(scaled, np.array([0]), np.array([2])) == pytest.approx(np.sqrt(0.5))


def test_a_direction_that_a_set_has_twice_counts_once():
    x = np.column_stack([unit(1.0), unit(1.0), unit(1.0, 1.0)])
    assert largest_cosine(x.T @ x, np.array([0, 1]), np.array([2])) == pytest.approx(np.sqrt(0.5))


def others(top: float, *net: float) -> list[Found]:
    fit = LeastSquares(0.0, np.zeros(1), np.eye(1))
    names = [name for name in ALL if name != CLEANING]
    return [Found(name, top + one, np.zeros(3), 0.0, 0, fit) for name, one in zip(names, net, strict=False)]


@pytest.mark.parametrize(("top", "margin"), [(50.0, INDISTINCT), (1000.0, SHARE_OF_REDUCTION * 1000.0)])
def test_alternatives_explain_nearly_as_much(top, margin):
    fit = LeastSquares(top, np.zeros(1), np.eye(1))
    best = trial(Found(CLEANING, top, np.zeros(3), 0.0, 0, fit))
    rivals = others(top, -1.01 * margin, -0.99 * margin, -0.5 * margin)
    names, _ = alternatives_to(best, rivals)
    assert names == (CLEANING, rivals[2].name, rivals[1].name)


def test_belief_is_shared_with_those_that_explain_as_much():
    fit = LeastSquares(1000.0, np.zeros(1), np.eye(1))
    best = trial(Found(CLEANING, 1000.0, np.zeros(3), 0.0, 0, fit))
    _, alone = alternatives_to(best, [])
    _, far = alternatives_to(best, others(1000.0, -900.0))
    _, equal = alternatives_to(best, others(1000.0, 0.0))
    _, linear = alternatives_to(best, others(1000.0, 500.0))  # without a refit: no more than the best refit's
    assert alone == pytest.approx(1.0)
    assert far == pytest.approx(alone, abs=1e-5)
    assert equal == linear == pytest.approx(0.5)


def test_belief_is_no_larger_than_the_null_recordings_allow():
    fit = LeastSquares(30.0, np.zeros(1), np.eye(1))
    nulls = np.array([10.0, 20.0, 30.0])
    one = Found(CLEANING, 30.0, nulls, 0.0, 0, fit)
    _, belief = alternatives_to(trial(one), [])
    assert belief == pytest.approx(1.0 - 10.0**-one.neg_log10_p)
    assert belief < 0.95


@pytest.mark.parametrize("name", [name for name, card in ALL.items() if card.signature.normal])
def test_normal_variation_is_no_mechanism(name):
    (size, most), *_ = ALL[name].signature.normal.items()
    null = next(one.null for one in ALL[name].parameters if one.name == size)
    one = Found(name, 100.0, np.zeros(3), 50.0, 0, LeastSquares(100.0, np.zeros(1), np.eye(1)))
    for change, normal in ((0.9, True), (-0.9, True), (1.1, False), (-1.1, False)):
        assert is_normal(trial(one, **{size: null + change * most})) == normal


def test_a_mechanism_that_sound_vehicles_do_not_vary_by_is_never_normal():
    one = Found(CLEANING, 100.0, np.zeros(3), 50.0, 0, LeastSquares(100.0, np.zeros(1), np.eye(1)))
    assert not is_normal(trial(one, removal_m_per_j=0.0))


@pytest.mark.parametrize(
    ("overlap", "multiple", "shadow"),
    [
        (1.0, 0.5 * LEAST_MULTIPLE, True),  # nothing is left beside it, and it is too small to matter
        (1.0, 2.0 * LEAST_MULTIPLE, False),  # it matters itself: the two are alternatives
        (0.0, 0.5 * LEAST_MULTIPLE, False),  # it explains something else
    ],
)
def test_the_shadow_of_a_mechanism_too_small_to_matter(overlap, multiple, shadow):
    columns = {CLEANING: unit(1.0), MEMORY: unit(overlap, np.sqrt(1.0 - overlap**2))}
    search = search_of(columns, 10.0 * unit(1.0) + 9.0 * unit(0.0, 1.0))
    better = trial(found(search, CLEANING), multiple)
    assert is_shadow(search, trial(found(search, MEMORY)), [better]) == shadow


@pytest.mark.parametrize(("lost", "names"), [(1.0, [MEMORY]), (400.0, [CLEANING, MEMORY])])
def test_what_a_later_mechanism_explains_too_is_dropped(lost, names, monkeypatch):
    """Without the first mechanism the refit loses `lost` of chi-square."""
    search = search_of({CLEANING: unit(1.0), MEMORY: unit(0.8, 0.6)}, 30.0 * unit(1.0))
    first, last = (accepted(found(search, name, reduction=one)) for name, one in ((CLEANING, 900.0), (MEMORY, 300.0)))
    choice = {name: {} for name in (CLEANING, MEMORY)}
    both = Fitted(Model(1e-4, (0.05,), choice), (first.variant, last.variant), (), (), 100.0)

    def refit(balances, model, variants, weights, tilts):
        assert set(model.choice) == {one.name for one in variants} == {MEMORY}
        return Fitted(model, tuple(variants), (), (), both.cost + lost)

    monkeypatch.setattr(decide, "refit", refit)
    kept, fitted = decide._needed(None, both, search, [first, last], None)
    assert [one.found.name for one in kept] == names
    assert [one.name for one in fitted.variants] == names
    # The one that is left has what both explained, less what is lost.
    assert kept[-1].found.reduction == (300.0 if len(kept) == 2 else 300.0 + 900.0 - lost)
