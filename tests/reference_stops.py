"""Reference stops that show what a mechanism does, and the smallest effect of interest of every parameter.

Three stops from 40 m/s: one that slides under an ideal slip control, whose wanted creepage swings as a WSP's does; one on a
clean rail at full brake; and one on a contaminated rail just below its adhesion, without any control. None depends on
thresholds, so small causes have small effects.
"""

import dataclasses
import functools
import math
from collections.abc import Mapping

import numpy as np
from scipy.optimize import brentq

from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant import mechanisms
from wsp_env.plant.longitudinal.plant import LongitudinalPlant
from wsp_env.plant.port import Setup, Stop

#: An effect is of interest that moves a reference stop by this share of its distance, or a measured slip by this much [m/s].
DISTANCE_SHARE = 0.01
SLIP_MPS = 0.1

#: The reference stops, with mu_cd and demand [-] (assumptions: the extremely low adhesion of EN 15595; mu_cr; the seed paper's
#: mu_cd with some nine tenths of its adhesion used).
NAMES = ("sliding", "clean", "creeping")
_MU_CD = (0.035, 0.28, 0.06)
_DEMAND = (1.0, 1.0, 0.9)
_INITIAL_SPEED_MPS = 40.0
_TAU = 1.9e-4  # [m/J], tuned in the seed paper
_TIME_LIMIT_S = 120.0
_TOLERANCE = 0.01  # of a smallest effect, relative [-]
_COUNTED_ABOVE_MPS = 5.0  # creepage and slip say little below

# The sliding stop's wanted creepage, mean and swing [-] and period [s] (assumption: as rule-based WSPs swing), and the gain of
# its control [s/m].
_CREEPAGE, _SWING, _PERIOD_S, _GAIN = 0.08, 0.04, 2.0, 0.1


@dataclasses.dataclass(frozen=True)
class ReferenceStops:
    """The three stops of `NAMES`, sampled at every control interval: arrays (T, 3) or (T, 3, A)."""

    time_s: np.ndarray  # (T,)
    moving: np.ndarray  # (T, 3) bool
    speed_mps: np.ndarray
    acceleration_mps2: np.ndarray  # of the vehicle, at the sample
    recorded_speed_mps: np.ndarray
    position_m: np.ndarray  # of the leading axle
    wheel_speed_radps: np.ndarray  # (T, 3, A)
    recorded_wheel_speed_radps: np.ndarray  # (T, 3, A)
    nominal_torque_nm: np.ndarray  # (T, 3, A) cylinder pressure times the believed gain
    adhesion: np.ndarray  # (T, 3, A)

    def measured_slip(self, radius_m: float) -> np.ndarray:
        """Slip speed of the recorded speeds with the believed radius (T, 3, A) [m/s]."""
        slip: np.ndarray = self.recorded_speed_mps[..., None] - radius_m * self.recorded_wheel_speed_radps
        return slip


def reference_stops(
    vehicle: Vehicle, choice: Mapping[str, Mapping[str, float]] | None = None, interval_s: float = 0.1
) -> ReferenceStops:
    """Brake a vehicle through the reference stops with the mechanisms of `choice`."""
    plant = LongitudinalPlant(vehicle, len(NAMES), Setup(interval_s, mechanisms=choice or {}, pressure_control=True))
    for i in range(len(NAMES)):
        plant.start(i, _stop(vehicle, i))
    s, p = plant.state, plant.constants
    per_bar = p.brake.torque_per_bar
    rows: list[tuple[np.ndarray, ...]] = []
    full = vehicle.full_brake_torque_nm
    command = np.ones(s.wheel_speed.shape)
    while plant.moving.any() and len(rows) * interval_s < _TIME_LIMIT_S:
        wanted = _CREEPAGE + _SWING * math.sin(2.0 * math.pi * len(rows) * interval_s / _PERIOD_S)
        load = plant.conditions.mass[0] * p.gravity / (2 * vehicle.axles)
        held = 2.0 * load * s.adhesion[0] * vehicle.wheel_radius_m / full
        command[0] = np.clip(held + _GAIN * (wanted * s.speed[0] - s.slip_speed[0]), 0.0, 1.0)
        before = s.speed.copy()
        moving = plant.moving.copy()
        plant.step(command)
        rows.append(
            (
                moving, s.speed.copy(), (s.speed - before) / interval_s, s.recorded_speed.copy(), s.position.copy(),
                s.wheel_speed.copy(), s.tachometer.filtered.copy(), per_bar * s.brake.pressure, s.adhesion.copy(),
            )
        )  # fmt: skip
    return ReferenceStops(interval_s * np.arange(1, len(rows) + 1), *(np.array(column) for column in zip(*rows, strict=True)))


def _stop(vehicle: Vehicle, i: int) -> Stop:
    return Stop(
        mu_cd=_MU_CD[i],
        tau=_TAU,
        initial_speed=_INITIAL_SPEED_MPS,
        mass=vehicle.mass_kg,
        demand=_DEMAND[i],
        gradient=0.0,
        noise=0.0,
        key=0,
        radius=np.full(vehicle.axles, vehicle.wheel_radius_m),
        profile=np.ones(1),
        coverage=np.ones(1),
    )


def effect(stops: ReferenceStops, without: ReferenceStops, radius_m: float) -> float:
    """Return how much of interest the stops differ from those `without`: 1 is the smallest effect of interest [-]."""
    distance = np.abs(stops.position_m[-1] / without.position_m[-1] - 1.0).max() / DISTANCE_SHARE
    samples = min(len(stops.time_s), len(without.time_s))
    fast = np.minimum(stops.speed_mps[:samples], without.speed_mps[:samples]) > _COUNTED_ABOVE_MPS
    moved = stops.measured_slip(radius_m)[:samples] - without.measured_slip(radius_m)[:samples]
    squares = np.where(fast[..., None], moved**2, 0.0).sum(axis=0) / fast.sum(axis=0)[:, None]
    return max(float(distance), math.sqrt(squares.max()) / SLIP_MPS)


@functools.lru_cache(maxsize=4)
def _without(vehicle: Vehicle) -> ReferenceStops:
    return reference_stops(vehicle)


@functools.lru_cache(maxsize=256)
def smallest_effect(mechanism: str, parameter: str, vehicle: Vehicle = COACH) -> float:
    """Return the value of a size parameter from which on it is of interest, found by a root-finder on the reference stops.

    The value moves a reference stop by `DISTANCE_SHARE` of its distance or a measured slip by `SLIP_MPS` (root mean square over
    a stop), in the direction of the typical value, the mechanism's other sizes null and its shapes typical. Infinite
    (with the sign of the direction) when nothing within the bounds does. `ParameterError` for an unknown mechanism or size.
    """
    if mechanism not in mechanisms.ALL:
        raise ParameterError(f"unknown mechanism {mechanism}; valid: {', '.join(mechanisms.ALL)}")
    parameters = {one.name: one for one in mechanisms.ALL[mechanism].parameters}
    sizes = [name for name, one in parameters.items() if one.kind == "size"]
    if parameter not in sizes:
        raise ParameterError(f"mechanism {mechanism} has no size {parameter}; valid: {', '.join(sizes)}")
    one = parameters[parameter]
    rest = {name: other.null for name, other in parameters.items() if other.kind == "size"}
    rest |= {"axle": min(parameters["axle"].typical, float(vehicle.axles))} if "axle" in parameters else {}
    bound = one.low if one.typical < one.null else one.high

    def interest(share: float) -> float:
        value = one.null + share * (bound - one.null)
        stops = reference_stops(vehicle, {mechanism: rest | {parameter: value}})
        return effect(stops, _without(vehicle), vehicle.wheel_radius_m)

    if interest(1.0) < 1.0:
        return math.copysign(math.inf, bound - one.null)
    # Brent's method on logarithms, as an effect is nearly a power of its size; exp(-20) of the bound has none.
    share = brentq(lambda x: math.log(max(interest(math.exp(x)), 1e-9)), -20.0, 0.0, xtol=_TOLERANCE)
    return one.null + math.exp(share) * (bound - one.null)
