"""What a command to the brake is: the only place of its codes.

========  ======================  =======================================  ====================================
command   action of the           command of a controller, and of the      pressure control: share of the
          environments            plant's valves                           demanded pressure
========  ======================  =======================================  ====================================
vent      0                       -1                                       0 (a controller writes -1)
hold      1                        0
apply     2                       +1                                       1 (a controller writes +1)
========  ======================  =======================================  ====================================
"""

import numpy as np
from numpy.typing import ArrayLike

from wsp_env.compiled import loop

#: A controller's, and a valve's, commands.
VENTS, HOLDS, APPLIES = -1.0, 0.0, 1.0


def to_action(command: ArrayLike) -> np.ndarray:
    """Return the environments' actions (..., A) from valve commands."""
    return np.asarray(command).astype(int) + 1


@loop
def valve_commands(actions: np.ndarray) -> bool:
    """Turn actions 0, 1, 2 (N, A) into commands -1, 0, +1, in place; False if there are others."""
    others = 0  # counted without a branch, which random actions would make the processor guess wrong
    for i in range(actions.shape[0]):
        for k in range(actions.shape[1]):
            action = actions[i, k]
            others += 1 - ((action == 0.0) | (action == 1.0) | (action == 2.0))
            actions[i, k] = action - 1.0
    return others == 0


@loop
def pressure_commands(actions: np.ndarray) -> bool:
    """Clip actions (N, A) to -1 to 1, in place; False if there are some that are not finite."""
    for i in range(actions.shape[0]):
        for k in range(actions.shape[1]):
            if not np.isfinite(actions[i, k]):
                return False
            actions[i, k] = min(max(actions[i, k], -1.0), 1.0)
    return True


def share_of_pressure(command: np.ndarray) -> np.ndarray:
    """Return shares of the demanded pressure, 0 to 1, from a controller's pressure commands, -1 to +1; clipped."""
    share: np.ndarray = 0.5 * (np.clip(command, -1.0, 1.0) + 1.0)
    return share
