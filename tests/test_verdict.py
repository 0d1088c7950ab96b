"""From findings and what they leave to a verdict."""

from types import SimpleNamespace

import pytest

from wsp_env.diagnosis.answer import FitQuality
from wsp_env.diagnosis.structure import Structure
from wsp_env.diagnosis.verdict import describes_a_part, improves_nothing, leaves_something, verdict_of

NAME, TERM = (SimpleNamespace(trial=SimpleNamespace(listed=SimpleNamespace(family=one))) for one in ("", "friction by work"))
NOTHING, LARGE = Structure(0.9, "adhesion", 2.0), Structure(8.0, "adhesion", 1.6)


def quality(removed, misfits=True, before=2.0, after=1.0):
    fit = FitQuality(1.0, {"tune": before, "validate": before}, {"tune": after, "validate": after}, removed)
    return SimpleNamespace(fit=fit, misfits=misfits)


@pytest.mark.parametrize(
    ("missing", "failed", "left", "removed", "misfits", "leaves"),
    [
        ([], False, NOTHING, None, True, False),
        ([], False, LARGE, None, True, True),
        ([NAME], False, LARGE, 0.9, True, False),
        ([NAME], False, LARGE, 0.4, True, True),
        ([NAME], False, LARGE, None, True, True),
        ([], False, LARGE, 0.9995, True, True),  # removed by late wheel speeds within a sample, which are no finding
        ([], True, NOTHING, None, True, True),  # sure in all runs, but not in those held out
        ([], True, NOTHING, None, False, False),  # a drag of 88 N m, in recordings that the law fits
        ([NAME], True, NOTHING, 0.9, True, False),
    ],
)
def test_what_no_model_describes(missing, failed, left, removed, misfits, leaves):
    assert leaves_something(missing, failed, left, quality(removed, misfits)) == leaves


@pytest.mark.parametrize(
    ("removed", "after", "nothing"),
    [(0.9, 1.0, False), (0.0, 1.0, True), (-3.2, 1.0, True), (None, 1.0, False), (0.9, 2.1, True)],
)
def test_what_removes_nothing_is_no_finding(removed, after, nothing):
    assert improves_nothing([NAME], quality(removed, after=after)) == nothing
    assert not improves_nothing([], quality(removed, after=after))


def test_a_term_that_leaves_the_balance_that_is_off_is_a_part():
    """A term on friction says nothing of wheels that roll on another radius; a name may stand beside what else is missing."""
    removed = {"adhesion": 0.9, "kinematics": None, "vehicle": 0.1}

    def part(missing, size, balance):
        return describes_a_part(missing, Structure(size, balance, 2.0), removed)

    assert part([TERM], 9.0, "kinematics")
    assert part([TERM], 9.0, "vehicle")
    assert not part([TERM], 9.0, "adhesion")
    assert not part([TERM], 0.9, "kinematics")
    assert not part([TERM, NAME], 9.0, "kinematics")
    assert not part([], 9.0, "kinematics")


def test_verdicts():
    sure, unsure = SimpleNamespace(alternatives=("a", "b")), SimpleNamespace(alternatives=("a", "b", "c"))
    term = SimpleNamespace()
    assert verdict_of((sure,), (term,), True, True) == "named"
    assert verdict_of((sure, unsure), (), True, True) == "ambiguous"
    assert verdict_of((), (term,), True, False) == "discovered"
    assert verdict_of((), (), True, True) == "unknown"
    assert verdict_of((), (), False, True) == "adequate"
    assert verdict_of((), (), False, False) == "insufficient"
