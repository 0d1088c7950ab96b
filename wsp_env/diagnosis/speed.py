"""The vehicle's speed out of a noisy recording: what the noise is like is estimated from the recordings themselves.

The recorded speed less what the wheels' own balances predict of it is a slowly changing course plus noise. The course is an
integrated Wiener process of the acceleration, about a free line; the noise is white plus an Ornstein-Uhlenbeck process, as the
filters of radar and satellite receivers leave it. Four sizes, common to the stops of a campaign, maximise the restricted
likelihood (Rasmussen, Williams: Gaussian processes for machine learning, 2006, chapters 2 and 5).
"""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import linalg, optimize

from wsp_env.diagnosis.arrow import inverse_of

#: Blocks over which the course is fitted [s]; shorter than the correlation of any noise that a filter of a receiver leaves.
NODE_S = 0.2
_START = (0.01, 0.02, 0.3, 0.01)
_BOUNDS = ((1e-4, 1.0), (1e-4, 1.0), (0.1, 20.0), (1e-4, 1.0))
#: Most nodes of one stop that the sizes are estimated from: more tell no more and cost their cube.
_MOST_NODES = 300
#: Until rounding decides nothing: a likelihood is flat about its maximum.
_CONVERGED = {"maxiter": 200, "ftol": 1e-12, "gtol": 1e-4}


class SpeedNoise(NamedTuple):
    """What a recorded speed holds beside the speed."""

    white: float  # of a node's mean [m/s]
    coloured: float  # deviation of the Ornstein-Uhlenbeck noise [m/s]
    correlation_s: float  # its correlation time [s]
    walk: float  # of the acceleration that the wheels do not predict [m/s2 per root second]

    def covariance(self, time: np.ndarray) -> np.ndarray:
        """Covariance (n, n) [m2/s2] of the noise at nodes of times (n,) [s]."""
        apart = np.abs(time[:, None] - time)
        result: np.ndarray = self.coloured**2 * np.exp(-apart / self.correlation_s) + self.white**2 * (apart == 0.0)
        return result

    def course(self, time: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Covariance (n, m) [m2/s2] of the course between two sets of times from the start [s]."""
        first, last = np.minimum(time[:, None], other), np.maximum(time[:, None], other)
        result: np.ndarray = self.walk**2 * (first**2 * last / 2.0 - first**3 / 6.0)
        return result


@dataclasses.dataclass(frozen=True)
class SpeedEstimate:
    """The course of one stop at its nodes (n,), and how uncertain it is."""

    time: np.ndarray  # (n,) [s] from the start
    course: np.ndarray  # (n,) [m/s]
    modes: np.ndarray  # (n, m) deviations of the course along its principal directions [m/s]
    gain: np.ndarray  # (n, n) of the nodes' means, that the course is


@dataclasses.dataclass(frozen=True)
class SpeedEstimator:
    """How the estimated speed follows from the recorded one."""

    time: np.ndarray  # (n,) of its nodes [s]
    gain: np.ndarray  # (n, n)

    def __call__(self, time: np.ndarray, change: np.ndarray) -> np.ndarray:
        """Return the change (T,) of the estimated speed by a change (T,) of the recorded one [m/s]."""
        course = self.gain @ np.interp(self.time, time, change)
        if len(course) < 2:
            return np.full(len(time), course[0])
        result: np.ndarray = np.interp(time, self.time, course)
        for edge, inner in ((0, 1), (-1, -2)):  # beyond the outer nodes it goes on as a line
            beyond = time < self.time[0] if edge == 0 else time > self.time[-1]
            slope = (course[inner] - course[edge]) / (self.time[inner] - self.time[edge])
            result[beyond] = course[edge] + slope * (time[beyond] - self.time[edge])
        return result


def nodes(rest: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times (n,) [s] and means (n,) [m/s] of the nodes of a rest (T,) sampled every `step` [s]."""
    length = max(round(NODE_S / step), 1)
    count = max(len(rest) // length, 1)
    time = (np.arange(count) * length + 0.5 * (length - 1)) * step
    return time, rest[: count * length].reshape(count, -1).mean(axis=1)


def estimate_noise(rests: Sequence[tuple[np.ndarray, np.ndarray]]) -> SpeedNoise:
    """Return the sizes that maximise the restricted likelihood of all stops' nodes (times, means)."""
    parts = [_Part.of(time[:_MOST_NODES] - time[0], rest[:_MOST_NODES]) for time, rest in rests]

    def cost(logs: np.ndarray) -> tuple[float, np.ndarray]:
        noise = SpeedNoise(*np.exp(logs))
        costs, slopes = zip(*(_restricted(noise, part) for part in parts), strict=True)
        return sum(costs), np.sum(slopes, axis=0)

    bounds = [tuple(np.log(one)) for one in _BOUNDS]
    found = optimize.minimize(cost, np.log(_START), jac=True, method="L-BFGS-B", bounds=bounds, options=_CONVERGED)
    return SpeedNoise(*map(float, np.exp(found.x)))


class _Part(NamedTuple):
    """The nodes of one stop (n,), and what their covariance is made of."""

    rest: np.ndarray
    line: np.ndarray  # (n, 2)
    apart: np.ndarray  # (n, n) [s]
    course: np.ndarray  # (n, n) of a walk of 1

    @classmethod
    def of(cls, time: np.ndarray, rest: np.ndarray) -> "_Part":
        return cls(rest, _line(time), np.abs(time[:, None] - time), SpeedNoise(0.0, 0.0, 1.0, 1.0).course(time, time))


def _line(time: np.ndarray) -> np.ndarray:
    return np.column_stack([np.ones(len(time)), time])


def _restricted(noise: SpeedNoise, part: _Part) -> tuple[float, np.ndarray]:
    """Minus the restricted log likelihood of one stop's nodes, and its slope (4,) over the logs of the sizes."""
    coloured = noise.coloured**2 * np.exp(-part.apart / noise.correlation_s)
    covariance = coloured + noise.walk**2 * part.course
    covariance[np.diag_indices_from(covariance)] += noise.white**2
    root = linalg.cholesky(covariance, lower=True, check_finite=False)
    inverse = inverse_of(root)
    across = inverse @ part.line
    normal = part.line.T @ across
    kept = inverse - across @ np.linalg.solve(normal, across.T)  # the inverse on what is no line
    weighted = kept @ part.rest
    cost = 0.5 * part.rest @ weighted + np.log(np.diag(root)).sum() + 0.5 * np.linalg.slogdet(normal)[1]
    misfit = kept - np.outer(weighted, weighted)
    by_white = noise.white**2 * np.trace(misfit)
    by_time = 0.5 * np.vdot(misfit, coloured * part.apart) / noise.correlation_s
    return float(cost), np.array([by_white, np.vdot(misfit, coloured), by_time, noise.walk**2 * np.vdot(misfit, part.course)])


def estimate(noise: SpeedNoise, time: np.ndarray, rest: np.ndarray, least_share: float = 0.001) -> SpeedEstimate:
    """Return the course at nodes (n,) given their means.

    Parameters
    ----------
    least_share : of the uncertainty's variance, below which a direction is left out of `modes`

    """
    time = time - time[0]
    of_course = noise.course(time, time)
    root = linalg.cho_factor(of_course + noise.covariance(time), lower=True)
    line = _line(time)
    inverse = linalg.cho_solve(root, np.eye(len(time)))
    across = inverse @ line
    normal = line.T @ across
    left = line - of_course @ across
    gain = of_course @ inverse + left @ np.linalg.solve(normal, across.T)
    covariance = of_course - of_course @ inverse @ of_course + left @ np.linalg.solve(normal, left.T)
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    kept = values > least_share * max(float(values.sum()), 1e-30)
    return SpeedEstimate(time, gain @ rest, vectors[:, kept] * np.sqrt(values[kept]), gain)
