"""What a diagnosis says that it could have seen."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from trial_cases import GAIN, GRADIENT, found

from wsp_env.diagnosis.search import LARGE, SEEN, SMALL, Found, detectable
from wsp_env.plant.mechanisms import ALL


def seen(*listed: Found) -> SimpleNamespace:
    return SimpleNamespace(found=listed)


def test_the_smallest_detectable_size_has_the_evidence_of_what_is_seen() -> None:
    """From a deviation of 1 interest: evidence of large over small size at the multiple that is returned."""
    one = found(GRADIENT, 0.0)
    (size,) = detectable(seen(one))["track_gradient"].values()
    multiple = size / abs(float(GRADIENT.moves()[0]))  # the step is one interest
    small, large = 1.0 + SMALL**2, 1.0 + LARGE**2
    assert 0.5 * multiple**2 * (1.0 / small - 1.0 / large) - 0.5 * np.log(large / small) == pytest.approx(SEEN, rel=0.05)


def test_a_size_that_cannot_be_is_not_offered() -> None:
    blind = dataclasses.replace(found(GAIN, 0.0), deviation=np.array([1e6]))
    (gain,) = (one for one in ALL["brake_gain_imbalance"].parameters if one.name == "gain")
    assert detectable(seen(blind)) == {"brake_gain_imbalance": {}}
    (size,) = detectable(seen(found(GAIN, 0.0)))["brake_gain_imbalance"].values()
    assert size <= gain.high - gain.low
