"""Estimates the vehicle's speed from a noisy recording; the noise model is estimated from the recordings themselves.

The recorded speed, minus its prediction by the wheels' own balances, is a slowly changing course plus noise. The course is an
integrated Wiener process of the acceleration about a free line. The noise is white plus an Ornstein-Uhlenbeck process, as the
filters of radar and satellite receivers produce it. Four parameters, common to the stops of a campaign, maximise the restricted
likelihood (Rasmussen, Williams: Gaussian processes for machine learning, 2006, chapters 2 and 5).
"""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import optimize

from wsp_env.diagnosis.triangular import cholesky, inverse_of

#: Length of the blocks (nodes) for the course [s]; shorter than the correlation time of any receiver filter's noise.
NODE_S = 0.2
_START = (0.01, 0.02, 0.3, 0.01)
_BOUNDS = ((1e-4, 1.0), (1e-4, 1.0), (0.1, 20.0), (1e-4, 1.0))
#: Largest number of nodes of one stop for the noise estimate: more hardly improve it and cost the cube of their number.
_MOST_NODES = 300
#: Tolerances at which the parameters are known to some 1e-5; a likelihood is flat about its maximum.
_CONVERGED = {"maxiter": 200, "ftol": 1e-10, "gtol": 1e-3}


class SpeedNoise(NamedTuple):
    """Parameters of the noise of a recorded speed, and of the course."""

    white: float  # standard deviation of a node's mean [m/s]
    coloured: float  # standard deviation of the Ornstein-Uhlenbeck noise [m/s]
    correlation_s: float  # correlation time of this noise [s]
    walk: float  # intensity of the acceleration that the wheels do not predict [m/s2 per root second]

    def covariance(self, time: np.ndarray) -> np.ndarray:
        """Covariance (n, n) [m2/s2] of the noise at nodes with times (n,) [s]."""
        apart = np.abs(time[:, None] - time)
        result: np.ndarray = self.coloured**2 * np.exp(-apart / self.correlation_s) + self.white**2 * (apart == 0.0)
        return result

    def course(self, time: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Covariance (n, m) [m2/s2] of the course between two sets of times since the start [s]."""
        first, last = np.minimum(time[:, None], other), np.maximum(time[:, None], other)
        result: np.ndarray = self.walk**2 * (first**2 * last / 2.0 - first**3 / 6.0)
        return result


@dataclasses.dataclass(frozen=True)
class SpeedEstimate:
    """The estimated course of one stop at its nodes (n,), with its uncertainty."""

    time: np.ndarray  # (n,) [s] from the start
    course: np.ndarray  # (n,) [m/s]
    modes: np.ndarray  # (n, m) standard deviations of the course along its principal directions [m/s]
    gain: np.ndarray  # (n, n) matrix from the nodes' means to the course


@dataclasses.dataclass(frozen=True)
class SpeedEstimator:
    """Linear map from the recorded speed to the estimated one."""

    time: np.ndarray  # (n,) of its nodes [s]
    gain: np.ndarray  # (n, n)

    def __call__(self, time: np.ndarray, change: np.ndarray) -> np.ndarray:
        """Return the change (T,) of the estimated speed for a change (T,) of the recorded one [m/s]."""
        course = self.gain @ np.interp(self.time, time, change)
        if len(course) < 2:
            return np.full(len(time), course[0])
        result: np.ndarray = np.interp(time, self.time, course)
        for edge, inner in ((0, 1), (-1, -2)):  # extrapolate linearly beyond the outer nodes
            beyond = time < self.time[0] if edge == 0 else time > self.time[-1]
            slope = (course[inner] - course[edge]) / (self.time[inner] - self.time[edge])
            result[beyond] = course[edge] + slope * (time[beyond] - self.time[edge])
        return result


def nodes(rest: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times (n,) [s] and means (n,) [m/s] of the nodes of a residual speed (T,) sampled every `step` [s]."""
    length = max(round(NODE_S / step), 1)
    count = max(len(rest) // length, 1)
    time = (np.arange(count) * length + 0.5 * (length - 1)) * step
    return time, rest[: count * length].reshape(count, -1).mean(axis=1)


def estimate_noise(rests: Sequence[tuple[np.ndarray, np.ndarray]]) -> SpeedNoise:
    """Return the parameters that maximise the restricted likelihood of all stops' nodes (times, means)."""
    parts = [_Part.of(time[:_MOST_NODES] - time[0], rest[:_MOST_NODES]) for time, rest in rests]

    def cost(logs: np.ndarray) -> tuple[float, np.ndarray]:
        noise = SpeedNoise(*np.exp(logs))
        costs, slopes = zip(*(_restricted(noise, part) for part in parts), strict=True)
        return sum(costs), np.sum(slopes, axis=0)

    bounds = [tuple(np.log(one)) for one in _BOUNDS]
    found = optimize.minimize(cost, np.log(_START), jac=True, method="L-BFGS-B", bounds=bounds, options=_CONVERGED)
    return SpeedNoise(*map(float, np.exp(found.x)))


class _Part(NamedTuple):
    """The nodes of one stop (n,), and the components of their covariance."""

    rest: np.ndarray
    line: np.ndarray  # (n, 2)
    apart: np.ndarray  # (n, n) [s]
    course: np.ndarray  # (n, n) of a walk with intensity 1

    @classmethod
    def of(cls, time: np.ndarray, rest: np.ndarray) -> "_Part":
        return cls(rest, _line(time), np.abs(time[:, None] - time), SpeedNoise(0.0, 0.0, 1.0, 1.0).course(time, time))


def _line(time: np.ndarray) -> np.ndarray:
    return np.column_stack([np.ones(len(time)), time])


def _restricted(noise: SpeedNoise, part: _Part) -> tuple[float, np.ndarray]:
    """Minus the restricted log likelihood of one stop's nodes, and its gradient (4,) by the logs of the parameters."""
    coloured = noise.coloured**2 * np.exp(-part.apart / noise.correlation_s)
    covariance = coloured + noise.walk**2 * part.course
    covariance[np.diag_indices_from(covariance)] += noise.white**2
    root = cholesky(covariance)
    inverse = inverse_of(root)
    across = inverse @ part.line
    normal = part.line.T @ across
    kept = inverse - across @ np.linalg.solve(normal, across.T)  # inverse covariance projected off the line
    weighted = kept @ part.rest
    cost = 0.5 * part.rest @ weighted + np.log(np.diag(root)).sum() + 0.5 * np.linalg.slogdet(normal)[1]
    misfit = kept - np.outer(weighted, weighted)
    by_white = noise.white**2 * np.trace(misfit)
    by_time = 0.5 * np.vdot(misfit, coloured * part.apart) / noise.correlation_s
    return float(cost), np.array([by_white, np.vdot(misfit, coloured), by_time, noise.walk**2 * np.vdot(misfit, part.course)])


def estimate(noise: SpeedNoise, time: np.ndarray, rest: np.ndarray, least_share: float = 0.001) -> SpeedEstimate:
    """Return the estimated course at nodes (n,) with means `rest` (n,) [m/s].

    Parameters
    ----------
    least_share : directions with a smaller share of the uncertainty's variance are omitted from `modes`

    """
    time = time - time[0]
    of_course = noise.course(time, time)
    line = _line(time)
    inverse = inverse_of(cholesky(of_course + noise.covariance(time)))
    across = inverse @ line
    normal = line.T @ across
    left = line - of_course @ across
    gain = of_course @ inverse + left @ np.linalg.solve(normal, across.T)
    covariance = of_course - of_course @ inverse @ of_course + left @ np.linalg.solve(normal, left.T)
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    kept = values > least_share * max(float(values.sum()), 1e-30)
    return SpeedEstimate(time, gain @ rest, vectors[:, kept] * np.sqrt(values[kept]), gain)
