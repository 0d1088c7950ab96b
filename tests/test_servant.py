"""The child process for what may crash: numbers there and back, and how it may end."""

import math

import numpy as np
import pytest

from wsp_env.servant import GoneError, Servant


@pytest.fixture(scope="module")
def servant():
    return Servant("answering")


def test_numbers_come_back_as_they_are(servant):
    given = np.array([0.1, -0.0, math.inf, math.nan]), np.empty(0), np.linspace(0.0, 1.0, 300_000)
    head, found = servant.ask({"do": "double"}, 20.0, *given)
    assert head["said"] == "double"
    for one, other in zip(given, found, strict=False):
        np.testing.assert_array_equal(2.0 * one, other)
    np.testing.assert_array_equal(found[-1], np.arange(6.0))  # flat
    assert math.copysign(1.0, found[0][1]) == -1.0


def test_a_child_that_ends_says_how():
    servant = Servant("answering")
    with pytest.raises(GoneError) as gone:
        servant.ask({"do": "end"}, 20.0)
    assert (gone.value.code, gone.value.late) == (7, False)
    assert not servant.alive
    with pytest.raises(GoneError):  # and does not hang
        servant.ask({"do": "double"}, 20.0)


@pytest.mark.slow
def test_a_child_that_does_not_answer_is_ended():
    servant = Servant("answering")
    with pytest.raises(GoneError) as gone:
        servant.ask({"do": "loop"}, 0.1)
    assert gone.value.late
    assert not servant.alive


def test_a_child_that_cannot_be_begun_is_said():
    with pytest.raises(GoneError):
        Servant("no_such_module")
