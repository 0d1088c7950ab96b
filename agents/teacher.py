"""A teacher that knows the truth: it steers every wheelset to the slip that is worth its price, with the real valves.

With the adhesion f(s) of the rail under it, a wheelset at slip speed s slows the vehicle by f g and slides s metres a second:
of all slips the one with the least (v + c s) / f(s) costs least metres travelled and priced metres slid for the speed lost.
It knows rail, load, speed, slips and pressures; of the mechanisms those that act on mass, gradient and radius alone.
"""

import numpy as np

from agents.steering import wanted_brake
from wsp_env.contact.port import adhesion_under
from wsp_env.evaluation.reference import wanted_pressure
from wsp_env.observer.estimator import VehicleEstimate, full_brake
from wsp_env.plant.port import Plant

#: Slips tried, as shares of the running speed and with a lowest one [m/s].
_SHARES = np.geomspace(0.002, 0.25, 24)
_LEAST_MPS = 0.05

#: When the running speed is in doubt the last wheelset is asked for this share of the adhesion below which it rolls, see
#: `wsp_env.observer.estimator` (assumption).
RELEASED_SHARE = 0.5


class Teacher:
    """Commands for the stops of a plant.

    Parameters
    ----------
    plant : whose state it reads
    slide_price : c [-]

    """

    def __init__(self, plant: Plant, slide_price: float) -> None:
        self.plant = plant
        self.full_brake = full_brake(plant.vehicle)
        self.slide_price = slide_price

    def wanted(self, estimate: VehicleEstimate) -> np.ndarray:
        """Return the brakes wanted (N, A), see `agents.steering`; where the estimated speed is in doubt the last rolls."""
        plant = self.plant
        share = wanted_pressure(plant, self.targets()) / plant.vehicle.brake.full_pressure_bar
        adhesion = np.where(share < 1.0, share * self.full_brake, np.inf)  # all that there is
        released = np.minimum(adhesion[:, -1], RELEASED_SHARE * estimate.rolling_adhesion[:, -1])
        adhesion[:, -1] = np.where(estimate.doubtful, released, adhesion[:, -1])
        return wanted_brake(adhesion)

    def targets(self) -> np.ndarray:
        """Return the slips worth their price (N, A) [m/s]."""
        plant = self.plant
        state, c, vehicle = plant.truth(), plant.conditions, plant.vehicle
        ahead = vehicle.brake.dead_time_s
        speed = np.maximum(state.speed - ahead * state.deceleration, 0.1)[:, None]
        place = (state.position + ahead * state.speed)[:, None] - np.array(vehicle.axle_positions_m)
        node = np.clip(np.rint(place / plant.setup.track_step_m).astype(int), 0, c.profile.shape[1] - 1)
        rows = np.arange(plant.n)[:, None]
        friction, layer = (c.mu_cd[:, None] * c.profile[rows, node])[..., None], c.coverage[rows, node][..., None]
        slip = np.maximum(speed * _SHARES, _LEAST_MPS * np.geomspace(1.0, 2.0, len(_SHARES)))[:, None, :]
        load = (c.mass * vehicle.gravity_mps2 / (2.0 * vehicle.axles))[:, None, None]
        law = vehicle.contact.law
        adhesion = adhesion_under(law, slip, speed[..., None], load, friction, c.tau[:, None, None], layer)
        best = np.argmin((speed[..., None] + self.slide_price * slip) / adhesion, axis=-1)
        chosen: np.ndarray = np.take_along_axis(np.broadcast_to(slip, adhesion.shape), best[..., None], -1)[..., 0]
        return chosen
