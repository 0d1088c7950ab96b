"""A teacher that knows the truth: it steers every wheelset to the slip that is worth its price, with the real valves.

With the adhesion f(s) of the rail under it, a wheelset at slip speed s slows the vehicle by f g and slides s metres a second:
of all slips the one with the least (v + c s) / f(s) costs least metres travelled and priced metres slid for the speed lost.
It knows rail, load, speed, slips and pressures; of the mechanisms those that act on mass, gradient and radius, and the cleaning
of the rail for the wheels behind (`agents.together`).
"""

from collections.abc import Sequence

import numpy as np

from agents.steering import wanted_brake
from agents.together import Together, removal_of
from wsp_env.contact.port import adhesion_under
from wsp_env.evaluation.reference import nearest, wanted_pressure
from wsp_env.evaluation.runner import Conduct, StopRecords, record, start_plant
from wsp_env.observer.estimate import VehicleEstimate, full_brake
from wsp_env.observer.overrule import RELEASED_SHARE
from wsp_env.parameters.resistance import running_resistance
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.port import TRACK_STEP_M, Plant, Stop

#: Slips tried, as shares of the running speed and with a lowest one [m/s].
_SHARES = np.geomspace(0.002, 0.25, 24)
_LEAST_MPS = 0.05

#: Step by which an ideal stop is integrated [s]: short against the rise of the demand.
_IDEAL_STEP_S = 0.1


class Teacher:
    """Commands for the stops of a plant.

    Parameters
    ----------
    plant : whose state it reads
    slide_price : c [-]
    believed : vehicle whose brake the steering knows; none: the plant's
    together : it knows what wheels clean for those behind

    """

    def __init__(
        self, plant: Plant, slide_price: float, believed: Vehicle | None = None, *, together: bool = True
    ) -> None:  # fmt: skip
        self.plant = plant
        self.full_brake = full_brake(believed or plant.vehicle)
        self.slide_price = slide_price
        self.together = Together(plant, slide_price) if together and removal_of(plant) else None

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
        if self.together:
            return self.together.targets(speed[:, 0])
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


def taught(
    vehicle: Vehicle, stops: Sequence[Stop], slide_price: float, conduct: Conduct, *, together: bool = True
) -> StopRecords:  # fmt: skip
    """Let the teacher itself brake the stops with the real valves: what a policy that imitates it cannot surpass by that."""
    plant = start_plant(vehicle, stops, conduct)
    teacher = Teacher(plant, slide_price, together=together)
    return record(plant, lambda: nearest(plant, wanted_pressure(plant, teacher.targets())), conduct)


def ideal(vehicle: Vehicle, stops: Sequence[Stop], slide_price: float, limit_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return metres travelled and slid, (N,) each, if every wheelset had the slip worth its price at any moment.

    Without valves, cylinders and the inertia of slip; only the demand rises as it does. No controller of that price does
    better on rail on which all wheelsets are alike.
    """
    mass = np.array([stop.mass for stop in stops])
    weight, rotating = mass * vehicle.gravity_mps2, vehicle.axles * vehicle.wheelset_inertia_kgm2 / vehicle.wheel_radius_m**2
    full = vehicle.full_brake_torque_nm * vehicle.axles / (vehicle.wheel_radius_m * weight)
    names = ("demand", "tau", "mu_cd", "gradient")
    demand, tau, mu_cd, gradient = (np.array([getattr(stop, name) for stop in stops]) for name in names)
    profile, coverage = (np.array([getattr(stop, name) for stop in stops]) for name in ("profile", "coverage"))
    speed = np.array([stop.initial_speed for stop in stops])
    way, slid, rows = np.zeros(len(stops)), np.zeros(len(stops)), np.arange(len(stops))
    for step in range(int(limit_s / _IDEAL_STEP_S)):
        node = np.clip(np.rint(way / TRACK_STEP_M).astype(int), 0, profile.shape[1] - 1)
        friction, layer = mu_cd * profile[rows, node], coverage[rows, node]
        offered = full * np.minimum(demand, (step + 0.5) * _IDEAL_STEP_S / vehicle.brake.demand_rise_s)
        running = np.maximum(speed, 0.1)[:, None]
        slip = np.concatenate([np.zeros_like(running), running * _SHARES], axis=1)
        per_stop = (value[:, None] for value in (weight / (2.0 * vehicle.axles), friction, tau, layer))
        used = adhesion_under(vehicle.contact.law, slip, running, *per_stop) * weight[:, None]
        resisted = running_resistance(running, vehicle.resistance) + weight[:, None] * gradient[:, None]
        # While wheels slide the brake itself slows them; one that rolls is slowed by the rail, as part of the mass.
        sliding = (used + resisted) / mass[:, None]
        rolling = ((offered * weight)[:, None] + resisted) / (mass + rotating)[:, None]
        slowed = np.maximum(np.minimum(sliding, rolling), 1e-4)
        best = np.argmin((running + slide_price * slip) / slowed, axis=1)
        deceleration = slowed[rows, best]
        after = np.maximum(speed - deceleration * _IDEAL_STEP_S, 0.0)
        moving = speed > 0.0
        way += 0.5 * (speed + after) * _IDEAL_STEP_S
        slid += np.where(moving, slip[rows, best] * _IDEAL_STEP_S, 0.0)
        speed = after
        if not moving.any():
            break
    return way, slid
