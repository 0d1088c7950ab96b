"""The intervals of what was fitted, and whether they leave it open that it is there."""

import pytest

from wsp_env.diagnosis.answer import Estimate
from wsp_env.diagnosis.candidates import Variant
from wsp_env.diagnosis.estimates import intervals_contain_null, undetermined, within_a_sample

PADS = Variant("pad_friction", ("per_speed_s_per_m", "per_temperature_1_per_k"), {})
PATCH = Variant("adhesion_patch", ("change", "start_m", "length_m"), {})


def estimates(variant: Variant, *intervals: tuple[float, float]) -> dict[str, Estimate]:
    each = zip(variant.sizes, intervals, strict=True)
    return {name: Estimate(0.5 * (low + high), "", (low, high)) for name, (low, high) in each}


@pytest.mark.parametrize(
    ("speed", "heat", "is_open"),
    [((-0.003, 0.001), (-1e-4, 2e-4), True), ((-0.003, -0.001), (-1e-4, 2e-4), False), ((-0.003, 0.0), (1e-5, 2e-4), False)],
)
def test_one_size_that_is_surely_there_is_enough(speed, heat, is_open):
    assert intervals_contain_null(estimates(PADS, speed, heat), PADS) == is_open


def test_where_something_acts_does_not_tell_that_it_is_there():
    shapes = ((200.0, 210.0), (40.0, 60.0))
    assert intervals_contain_null(estimates(PATCH, (-0.1, 0.4), *shapes), PATCH)
    assert not intervals_contain_null(estimates(PATCH, (0.1, 0.4), *shapes), PATCH)


@pytest.mark.parametrize(
    ("rate", "share", "is_open"),
    [
        ((10.7, 20.0), (0.0, 0.52), True),  # fitted to what a torque left that it did not describe
        ((1.2, 20.0), (1.1, 1.3), False),
        ((0.8, 3.0), (0.0, 0.9), True),
        ((1.2, 3.0), (0.9, 1.1), False),
    ],
)
def test_what_may_be_none_or_beyond_its_bounds_in_every_size_is_undetermined(rate, share, is_open):
    fall = Variant("falling_friction", ("decrease", "excess"), {})
    assert undetermined(estimates(fall, rate, share), fall) == is_open
    assert not intervals_contain_null(estimates(fall, rate, share), fall)


@pytest.mark.parametrize(
    ("interval", "within"),
    [((0.031, 0.068), True), ((0.052, 0.068), False), ((-0.4, -0.2), False), ((-0.4, -0.04), True), ((-0.01, 0.02), True)],
)
def test_a_time_that_may_be_less_than_a_sample_says_nothing(interval, within):
    clock = Variant("clock_offset", ("offset_s",), {})
    assert within_a_sample(estimates(clock, interval), clock, 0.05, 20.0) == within


@pytest.mark.parametrize(("interval", "within"), [((0.5, 1.4), True), ((1.1, 1.4), False)])
def test_a_distance_that_may_be_rolled_within_a_sample_says_nothing(interval, within):
    """A metre at 20 m/s and 20 Hz: a counted wheel speed is the mean since the last sample."""
    memory = Variant("contaminant_memory", ("distance_m",), {})
    assert within_a_sample(estimates(memory, interval), memory, 0.05, 20.0) == within


def test_what_is_no_time_has_no_sample():
    assert not within_a_sample(estimates(PADS, (0.0, 0.001), (0.0, 1e-4)), PADS, 0.05, 20.0)
