"""What goes on from row to row in what a model leaves: that no model holds, whatever it is worth in a stop."""

from typing import NamedTuple

import numpy as np

from wsp_env.diagnosis.balances import BALANCES
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.search import Screen
from wsp_env.diagnosis.trials import weights_of

#: What goes on from row to row over the channels' own noise, beside all that varies, from which on no model holds: what is as
#: large as the noise is seen in any plot.
STRUCTURED = 1.0
_LEAST_PAIRS = 20  # neighbouring rows of a balance that say whether one follows the other


class Structure(NamedTuple):
    """What goes on from row to row in what a model leaves."""

    size: float  # over the channels' noise
    balance: str  # in which it is largest


def structured(replica: Replica, seen: Screen) -> Structure:
    """Return how large what goes on from row to row is in what the model of a search leaves, and where.

    Noise of any size says that channels are noisy; what a row shares with the next one of the same axle and run is physics that
    neither model nor nuisances describe. The largest root of the rows' autocovariance, over the balances.
    """
    weights, rows = weights_of(replica, seen), replica.rows
    left = seen.whitening.plain(weights.projector.rest(weights(seen.base)) * weights.noise)
    order = np.lexsort((rows.time, rows.axle, rows.run, rows.balance))
    one, two = order[:-1], order[1:]
    follows = (rows.balance[one] == rows.balance[two]) & (rows.run[one] == rows.run[two]) & (rows.axle[one] == rows.axle[two])
    shared = [(0.0, BALANCES[0])]
    for balance in np.unique(rows.balance):
        mine = follows & (rows.balance[one] == balance)
        if mine.sum() >= _LEAST_PAIRS:
            shared.append((float(np.mean(left[one[mine]] * left[two[mine]])), BALANCES[balance]))
    size, where = max(shared)
    return Structure(float(np.sqrt(size)), where)
