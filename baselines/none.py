"""No wheel slide protection: the valves always apply."""

import numpy as np

from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.port import Measurement


class NoWSP:
    """Applies the brake whatever the wheels do."""

    def reset(self, n: int, vehicle: Vehicle) -> None:
        """Begin n new stops."""

    def act(self, measurement: Measurement) -> np.ndarray:
        """Return +1 for every axle (N, A)."""
        return np.ones_like(measurement.wheel_speed)
