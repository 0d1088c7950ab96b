"""Slips worth their price where the wheels in front clean the rail for those behind: all wheelsets of a vehicle together.

With the mechanism `leading_axle_cleaning`, a wheel that slides leaves the share exp(-removal E) of the contaminant layer, E the
energy that it and those before it spent on a metre of rail. Of all slips s of the wheelsets those are sought with the least
(v + c mean s) / mean f, f the adhesion that each uses: the leading ones may slide for the others' sake.
"""

import numpy as np

from agents.worlds import SPEEDS
from wsp_env.contact.port import adhesion_under
from wsp_env.plant.mechanisms import make
from wsp_env.plant.port import Plant

#: Slips tried, as shares of the running speed, and with a lowest one [m/s].
_SHARES = np.geomspace(0.002, 0.3, 20)
_LEAST_MPS = 0.05

#: Rounds in which the slips of all wheelsets are chosen anew, one after the other (assumption).
_ROUNDS = 2


def removal_of(plant: Plant) -> float:
    """Return what wheels of all stops remove from the layer for those behind them [m/J]; 0 without the mechanism.

    Stops that are started with physics of their own are not known.
    """
    return float(make(plant.setup.mechanisms).leading_axle_cleaning.removal_m_per_j)


class Together:
    """The slips of the wheelsets of a plant's stops, for uniform rail; they are computed when a stop has begun.

    Parameters
    ----------
    plant : whose mechanism and conditions it knows
    slide_price : c [-]

    """

    def __init__(self, plant: Plant, slide_price: float) -> None:
        self.plant, self.slide_price, self.removal = plant, slide_price, removal_of(plant)
        self._known = np.zeros((plant.n, 4))
        self._table = np.zeros((plant.n, len(SPEEDS), plant.vehicle.axles))

    def targets(self, speed: np.ndarray) -> np.ndarray:
        """Return the slips (N, A) [m/s] at running speeds (N,) [m/s]."""
        c = self.plant.conditions
        now = np.stack([c.mu_cd * c.profile.mean(axis=1), c.tau, c.mass, c.demand], axis=1)
        begun = np.flatnonzero((now != self._known).any(axis=1))
        if len(begun):
            self._table[begun] = self._slips(now[begun])
            self._known[begun] = now[begun]
        place = np.clip(speed / SPEEDS[1], 0.0, len(SPEEDS) - 1.001)
        below, rows = place.astype(int), np.arange(len(speed))
        share = (place - below)[:, None]
        found: np.ndarray = (1.0 - share) * self._table[rows, below] + share * self._table[rows, below + 1]
        return found

    def _slips(self, conditions: np.ndarray) -> np.ndarray:
        """Return the slips (n, K, A) for friction, recovery, mass and demand (n, 4)."""
        vehicle, axles = self.plant.vehicle, self.plant.vehicle.axles
        friction, tau, mass, demand = (value[:, None, None] for value in conditions.T)
        speed = np.maximum(SPEEDS, 0.5)[:, None]
        tried = np.maximum(speed * _SHARES, _LEAST_MPS * np.geomspace(1.0, 2.0, len(_SHARES)))  # (K, S)
        weight = mass * vehicle.gravity_mps2
        load, offered = (
            weight / (2.0 * axles),
            demand * vehicle.full_brake_torque_nm * axles / (vehicle.wheel_radius_m * weight),
        )

        def used(slip: np.ndarray, spent: np.ndarray) -> np.ndarray:
            layer = np.exp(-self.removal * spent)
            adhesion = adhesion_under(vehicle.contact.law, slip, speed, load, friction, tau, layer)
            return np.minimum(adhesion, offered)

        def after(spent: np.ndarray, slip: np.ndarray, adhesion: np.ndarray) -> np.ndarray:
            return spent + adhesion * load * slip / speed

        def price(adhesion: np.ndarray, slip: np.ndarray, several: int) -> np.ndarray:
            """Of sums over that many wheelsets."""
            return (speed + self.slide_price * slip / several) / (adhesion / several)

        def chosen(leading: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            """Return slips (n, K, A) and their price (n, K); at first the leading axle tries these, each other for itself."""
            slips = [np.zeros(shape)] * axles
            for turn in range(_ROUNDS + 1):
                ahead, before, slid = np.zeros(shape), np.zeros(shape), np.zeros(shape)  # energy; sums of adhesion and slip
                for k in range(axles):
                    some = leading if turn == k == 0 else tried
                    slip = np.broadcast_to(some, (*shape[:2], some.shape[-1]))
                    adhesion = used(slip, ahead)
                    spent, total, every = after(ahead, slip, adhesion), before + adhesion, slid + slip
                    for behind in slips[k + 1 :] if turn else ():
                        own = used(behind, spent)
                        spent, total, every = after(spent, behind, own), total + own, every + behind
                    paid = price(total, every, axles) if turn else price(adhesion, slip, 1)
                    best = np.argmin(paid, axis=-1)[..., None]
                    slips[k], own = (np.take_along_axis(values, best, -1) for values in (slip, adhesion))
                    ahead, before, slid = after(ahead, slips[k], own), before + own, slid + slips[k]
            return np.concatenate(slips, axis=-1), price(before, slid, axles)

        shape = (len(conditions), len(SPEEDS), 1)
        # The price may have two minima: all slide a little, or the first much and those behind hardly.
        (little, less), (much, more) = chosen(tried), chosen(tried[:, -1:])
        found: np.ndarray = np.where(less <= more, little, much)
        return found
