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

#: A controller's, and a valve's, commands.
VENTS, HOLDS, APPLIES = -1.0, 0.0, 1.0

#: The environments' actions.
ACTIONS = {"vent": 0, "hold": 1, "apply": 2}


def of_action(action: np.ndarray) -> np.ndarray:
    """Return valve commands from the environments' actions 0, 1, 2."""
    return action - 1.0


def to_action(command: np.ndarray) -> np.ndarray:
    """Return the environments' actions from valve commands."""
    return np.asarray(command).astype(int) + 1


def share_of_pressure(command: np.ndarray) -> np.ndarray:
    """Return shares of the demanded pressure, 0 to 1, from a controller's pressure commands, -1 to +1; clipped."""
    share: np.ndarray = 0.5 * (np.clip(command, -1.0, 1.0) + 1.0)
    return share
