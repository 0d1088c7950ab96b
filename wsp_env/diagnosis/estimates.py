"""The fitted parameters of a mechanism with their intervals, and tests of what these intervals allow."""

from collections.abc import Mapping

import numpy as np

from wsp_env.diagnosis.agreement import agreement
from wsp_env.diagnosis.answer import Estimate
from wsp_env.diagnosis.candidates import Variant, parameter_of
from wsp_env.diagnosis.fitting import Fitted
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.trials import form_of
from wsp_env.diagnosis.weights import Weights
from wsp_env.plant.card import Parameter
from wsp_env.plant.mechanisms import ALL


def estimates(
    replica: Replica, fitted: Fitted, variant: Variant, weights: Weights, reduction: float
) -> dict[str, Estimate]:  # fmt: skip
    """Return the parameters of a mechanism that is on, with their 90 % intervals.

    Parameters
    ----------
    fitted : fit to the replica with these weights
    reduction : of chi-square, by the mechanism

    """
    at = fitted.variants.index(variant)
    values, covariance = fitted.values[at], fitted.covariance[at]
    own = 0.0 if ALL[variant.name].signature.exact else form_of(variant)
    runs = agreement(replica, fitted.model, variant, weights, own)
    found, sizes = {}, _sizes(variant)
    for j, name in enumerate(variant.sizes):
        parameter = parameter_of(variant.name, name)
        value = float(np.clip(values[j], parameter.low, parameter.high))
        change = 0.0 if parameter.kind == "shape" else value - parameter.null  # form error and runs apply to sizes only
        nonlinear = sizes == [name] and len(variant.sizes) > 1 and change != 0.0  # one size, fitted together with shapes
        absent = abs(change) / np.sqrt(max(reduction, 1e-12)) if nonlinear else np.inf
        interval = runs.interval(value, float(np.sqrt(max(covariance[j, j], 0.0))), change, own * change, absent)
        low, high = np.clip(interval, parameter.low, parameter.high)
        found[name] = Estimate(value, parameter.unit, (float(low), float(high)))
    for name, fixed in variant.fixed.items():
        parameter = parameter_of(variant.name, name)
        if parameter.kind != "axle" or name == "axle" or fixed != parameter.null:  # there may be no second axle
            found[name] = Estimate(float(fixed), parameter.unit, (float(fixed), float(fixed)))
    return found


def intervals_contain_null(found: Mapping[str, Estimate], variant: Variant) -> bool:
    """Whether the intervals of all sizes contain their null values: the mechanism may be absent."""
    return all(low <= one.null <= high for (low, high), one in _intervals(found, variant))


def undetermined(found: Mapping[str, Estimate], variant: Variant) -> bool:
    """Whether the interval of each size contains its null value, or reaches a bound: then another form may be required."""
    return all(low <= one.null <= high or low <= one.low or high >= one.high for (low, high), one in _intervals(found, variant))


def within_a_sample(found: Mapping[str, Estimate], variant: Variant, sample_s: float, speed_mps: float) -> bool:
    """Whether all sizes are times, or rolled distances, whose intervals contain values below one sample.

    Channels of one logger are read within a sample of each other, and the course of a pressure between two samples is unknown.
    A wheel speed that is counted is the mean since the last sample: its slip, and so its friction, seem to be late.

    Parameters
    ----------
    speed_mps : usual speed at which a distance is rolled

    """

    def within(low: float, high: float, one: Parameter) -> bool:
        least = sample_s * (speed_mps if one.rolled else 1.0)
        return (one.rolled or one.unit == "s") and low - one.null <= least and high - one.null >= -least

    return all(within(low, high, one) for (low, high), one in _intervals(found, variant))


def _intervals(found: Mapping[str, Estimate], variant: Variant) -> list[tuple[tuple[float, float], Parameter]]:
    """Return the 90 % interval of each size, with its parameter."""
    return [(found[name].interval90, parameter_of(variant.name, name)) for name in _sizes(variant)]


def _sizes(variant: Variant) -> list[str]:
    return [name for name in variant.sizes if parameter_of(variant.name, name).kind == "size"]
