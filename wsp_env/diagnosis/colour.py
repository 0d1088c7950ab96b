"""Autocorrelation of the residuals of sliding wheels from row to row (coloured noise).

The friction of a sliding wheel fluctuates by itself, because wheel loads bounce and rails are rough. The noise of a wheel's
speed enters two neighbouring rows with opposite signs. If such noise is taken as white, the evidence of an effect is wrong.
There is also a bias: fluctuating friction turns the wheel, so that within a row high friction and small slip occur together, as
if friction fell with slip. If the part predicted from earlier rows is subtracted, only the innovation remains. The slip at the
beginning of the row does not depend on it.

The noise is modelled as one autoregression for all wheels and runs, estimated from the recordings. Its autocovariances are
those of the residuals plus the part that the fitted nuisances removed (expectation step of the restricted likelihood).
Schwarz's criterion selects the order (Annals of Statistics 6, 1978).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import linalg, sparse

from wsp_env.diagnosis.balances import Rows
from wsp_env.diagnosis.covariance import Evidence, Sizes
from wsp_env.diagnosis.loop import stretches
from wsp_env.diagnosis.stops import BLOCK_S

#: Longest lag of the noise's autocorrelation [s]; slower changes are variation in time (a nuisance) or a finding (assumption).
_MEMORY_S = 1.0


class Moments(NamedTuple):
    """Autocovariances of consecutive rows."""

    covariance: np.ndarray  # (lags + 1,)
    rows: int


def moments(evidence: Evidence, sizes: Sizes, parts: Sequence[np.ndarray]) -> Moments:
    """Return the autocovariances of the residuals over stretches of rows, in units of the noise variance.

    Products are summed over pairs and divided by the number of rows, so that a stationary series exists for them.
    """
    lags = max(round(_MEMORY_S / BLOCK_S), 1)
    total, count = np.zeros(lags + 1), 0
    for rows, left, spread in evidence.left(sizes):
        both = np.column_stack([left, spread])
        for part in parts:
            at = np.searchsorted(rows, part)
            if at[0] < len(rows) and rows[at[0]] == part[0]:
                mine = both[at]
                count += len(mine)
                for lag in range(min(lags + 1, len(mine))):
                    total[lag] += float(np.vdot(mine[lag:], mine[: len(mine) - lag]))
    return Moments(total / max(count, 1), count)


def autoregression(found: Moments) -> np.ndarray:
    """Return the autoregression (p,) for given autocovariances (Levinson and Durbin); empty if the series is white."""
    covariance, count = found.covariance, found.rows
    best = least = np.zeros(0)
    variance = float(covariance[0])
    if count < 2 or variance <= 0.0:
        return best
    lowest = count * np.log(variance)
    for order in range(1, len(covariance)):
        reflection = float(covariance[order] - least @ covariance[order - 1 : 0 : -1]) / variance
        variance *= 1.0 - reflection**2
        if variance <= 0.0:  # no series has these autocovariances
            break
        least = np.append(least - reflection * least[::-1], reflection)
        criterion = count * np.log(variance) + order * np.log(count)
        if criterion < lowest:
            lowest, best = criterion, least
    return best


def autocorrelation(coefficients: np.ndarray, lags: int) -> np.ndarray:
    """Return the autocorrelations (lags + 1,) of an autoregression (Yule and Walker's equations)."""
    p = len(coefficients)
    equations, right = np.eye(p), np.zeros(p)
    for i in range(p):  # rho_{i+1} = sum_j a_j rho_{|i+1-j|}
        for j, a in enumerate(coefficients):
            lag = abs(i - j)
            if lag:
                equations[i, lag - 1] -= a
            else:
                right[i] += a
    known = [1.0, *(np.linalg.solve(equations, right) if p else [])]
    while len(known) <= lags:
        known.append(float(coefficients @ known[: -p - 1 : -1]) if p else 0.0)
    return np.array(known[: lags + 1])


def whitening_filter(coefficients: np.ndarray, parts: Sequence[np.ndarray], count: int) -> sparse.csr_array:
    """Return the lower triangular matrix (n, n) that whitens stretches of an autoregression of variance 1.

    Other rows are unchanged. Each stretch starts with the stationary distribution.
    """
    p = len(coefficients)
    correlation = autocorrelation(coefficients, p)
    root = linalg.cholesky(linalg.toeplitz(correlation), lower=True)
    inverse = linalg.solve_triangular(root, np.eye(p + 1), lower=True)  # its last line predicts from the p rows before
    values, lines, columns = [], [], []
    inside = np.zeros(count, dtype=bool)
    for part in parts:
        inside[part] = True
        for i in range(len(part)):
            used = min(i, p)
            values.append(inverse[used, : used + 1])
            columns.append(part[i - used : i + 1])
            lines.append(np.full(used + 1, part[i]))
    rest = np.flatnonzero(~inside)
    entries = np.concatenate([*values, np.ones(len(rest))])
    places = np.concatenate([*lines, rest]), np.concatenate([*columns, rest])
    return sparse.csr_array((entries, places), shape=(count, count))


def colour(rows: Rows, evidence: Evidence, sizes: Sizes) -> np.ndarray:
    """Return the coefficients (p,) of the autoregression of sliding wheels' rows; empty if they are white."""
    return autoregression(moments(evidence, sizes, stretches(rows)))


def slide_whitening(rows: Rows, coefficients: np.ndarray) -> sparse.csr_array | None:
    """Return the filter (n, n) that whitens the rows of sliding wheels; None if they are white."""
    return whitening_filter(coefficients, stretches(rows), len(rows)) if len(coefficients) else None
