"""Makes replicas about an extended model, until the model fitted to the last one is the model that it was made about.

What a mechanism does bends: about the baseline it is linear over a part of its size only.
"""

import numpy as np

from wsp_env.diagnosis.balances import Balances
from wsp_env.diagnosis.fitting import Fitted, Weights, refit
from wsp_env.diagnosis.replica import Replica

#: Replicas that are made, each about the fit to the one before: the first may be far from the recordings, and of a wheel that
#: is turned by a per cent so may the second. At least, and at most.
_REPLICAS = 2, 6
#: Deviations by which a size still moves from replica to replica, below which it has settled.
_SETTLED = 0.5


def settle(recorded: Balances, fitted: Fitted, weights: Weights) -> tuple[Replica, Fitted]:
    """Return the replica about an extended model, and the model fitted to it."""
    for made in range(1, _REPLICAS[1] + 1):
        replica = Replica(recorded, fitted.model)
        again = refit(replica, fitted.model, fitted.variants, weights)
        moved = max(
            float(np.max(np.abs(new - old) / np.sqrt(np.maximum(np.diag(spread), 1e-300))))
            for new, old, spread in zip(again.values, fitted.values, again.covariance, strict=True)
        )
        fitted = again
        if made >= _REPLICAS[0] and moved < _SETTLED:
            break
    return replica, fitted
