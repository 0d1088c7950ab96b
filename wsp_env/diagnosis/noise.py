"""Estimates how much the residuals of a model vary by themselves: sizes of the nuisances and colour of the noise."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wsp_env.diagnosis.balances import Whitening
from wsp_env.diagnosis.colour import colour, slide_whitening
from wsp_env.diagnosis.covariance import Evidence, Sizes
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.variation import Group, nuisances


class NoiseParameters(NamedTuple):
    """What is known about the normal variation of similar residuals."""

    sizes: Sizes  # of the nuisances
    colour: np.ndarray  # (p,) autoregression of sliding wheels' rows


class Noise(NamedTuple):
    """Normal variation of the recordings about a model, without mechanisms that do not matter."""

    groups: tuple[Group, ...]  # nuisances
    whitening: Whitening
    colour: np.ndarray  # (p,) autoregression of sliding wheels' rows
    sizes: Sizes  # of the nuisances

    @property
    def parameters(self) -> NoiseParameters:
        """What it tells about similar residuals."""
        return NoiseParameters(self.sizes, self.colour)


def noise_of(
    replica: Replica, model: Model, base: np.ndarray, free: Sequence[Group] = (), start: Sizes | None = None
) -> Noise:  # fmt: skip
    """Estimate the normal variation of a model's residuals.

    Parameters
    ----------
    base : (n,) the residuals
    free : columns whose size is free
    start : sizes of the nuisances about a similar model, from which fewer iterations suffice; None: the expected sizes

    """
    plain = replica.whitening(replica.about)
    groups = nuisances(replica, model, base, plain)
    alone = Evidence(replica, plain, [*groups, *free], base)
    begin = alone.solve(None if start is None else Sizes(np.append(start.groups, np.ones(len(free))), start.noise))
    coefficients = colour(replica.rows, alone, begin)
    whitening = dataclasses.replace(plain, colour=slide_whitening(replica.rows, coefficients))
    return Noise(groups, whitening, coefficients, Sizes(begin.groups[: len(groups)], begin.noise))


def noise_from_parameters(
    parameters: NoiseParameters, replica: Replica, model: Model, base: np.ndarray, groups: tuple[Group, ...] = ()
) -> Noise:
    """Return the normal variation of a model's residuals (n,) with known sizes and colour, and `groups` if known."""
    plain = replica.whitening(replica.about)
    whitening = dataclasses.replace(plain, colour=slide_whitening(replica.rows, parameters.colour))
    return Noise(groups or nuisances(replica, model, base, plain), whitening, parameters.colour, parameters.sizes)
