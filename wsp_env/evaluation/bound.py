"""The shortest stop that keeps within the slide limit, which no controller can beat under the memoryless law.

Largest adhesion under the limit at every speed and place, full brake torque from the first instant:

    D = integral of v / a dv,   a = min(brake capacity with wheel inertia, g x largest f under the slide limit)

taken axle by axle, since the axles of a long vehicle stand on different rail. It is integrated in time with the wheels'
own speeds, because a wheelset that has slowed down to the limit can give that momentum back later, above the brake's torque:
each wheel has its best adhesion whatever its slip, the full torque, and any speed from (1 - limit) v to v that its momentum
balance J dw/dt = r T - C allows. Every real stop within the limit has at each place no more of either, so by comparison it is
nowhere slower. Not covered: physics with memory or other loads (mechanisms), under which a stop may be shorter.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wsp_env.compiled import kernel
from wsp_env.contact.port import adhesion_under
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant.port import TRACK_STEP_M, Stop

#: Time step of the bound's integration [s]: its distance is within 1e-4 of the converged one.
STEP_S = 0.01

#: The bound is given up after so long [s]: on the gradients of a railway with hardly any adhesion a vehicle runs on.
TIME_LIMIT_S = 1000.0

_SPEED_STEP = 0.5  # of the tables [m/s]
_SCAN = 81  # slips tried before the golden section
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


@dataclasses.dataclass(frozen=True)
class SlideLimit:
    """Largest creepage of a stop that counts; both numbers are assumptions, no standard's number is public."""

    creepage: float = 0.3  # [-]
    above_mps: float = 8.0  # running speed [m/s]; below it any creepage is allowed

    def slip(self, speed: ArrayLike) -> np.ndarray:
        """Largest slip speed [m/s] at a running speed [m/s]."""
        v = np.asarray(speed, dtype=np.float64)
        return np.where(v > self.above_mps, self.creepage * v, v)


def best_adhesion(
    speed: ArrayLike, largest_slip: ArrayLike, load: ArrayLike, mu_cd: ArrayLike, tau: ArrayLike, law: Any,
    layer: ArrayLike = 1.0,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return the largest adhesion coefficient [-] with slip up to `largest_slip` [m/s], and the slip [m/s] that gives it.

    Arguments as of `adhesion_under`, broadcast. A scan over slips, evenly spaced on a logarithmic scale, finds the highest
    of the curve's branches; a golden section sharpens it.
    """
    arguments = np.broadcast_arrays(*(np.asarray(a, dtype=np.float64) for a in (speed, largest_slip, load, mu_cd, tau, layer)))
    v, top, n, friction, rate, covered = (a[..., None].copy() for a in arguments)
    slips = top * np.geomspace(1e-4, 1.0, _SCAN)

    def f(slip: np.ndarray) -> np.ndarray:
        return adhesion_under(law, slip, v, n, friction, rate, covered)

    values = f(slips)
    best = np.argmax(values, axis=-1)[..., None]
    low = np.take_along_axis(slips, np.maximum(best - 1, 0), -1)
    high = np.take_along_axis(slips, np.minimum(best + 1, _SCAN - 1), -1)
    for _ in range(16):
        left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        rises = f(left) < f(right)
        low, high = np.where(rises, left, low), np.where(rises, high, right)
    middle = 0.5 * (low + high)
    found, scanned = f(middle), np.take_along_axis(values, best, -1)
    slip = np.where(found >= scanned, middle, np.take_along_axis(slips, best, -1))
    return np.maximum(found, scanned)[..., 0], slip[..., 0]


class AdhesionTable(NamedTuple):
    """The best adhesion of N stops on K kinds of rail at V speeds, and the kind at M track nodes."""

    speeds: np.ndarray  # (V,) [m/s], rising
    best: np.ndarray  # (N, K, V) largest adhesion coefficient [-]
    slip: np.ndarray  # (N, K, V) the slip speed that gives it [m/s]
    kind: np.ndarray  # (N, M) of rail at each track node


class Braked(NamedTuple):
    """What brakes in N stops with A axles."""

    initial_speed: np.ndarray  # (N,) [m/s]
    mass: np.ndarray  # (N,) [kg]
    torque: np.ndarray  # (N,) demanded brake torque of an axle [N m]
    radius: np.ndarray  # (N, A) [m]
    gradient: np.ndarray  # (N,) [-]


class _Running(NamedTuple):
    """What of the vehicle is the same in all stops."""

    offsets: np.ndarray  # (A,) of the axles behind the leading one [m]
    inertia: float  # of a wheelset [kg m2]
    gravity: float  # [m/s2]
    resistance_a: float  # [N]
    resistance_b: float  # [N s/m]
    resistance_c: float  # [N s2/m2]


@dataclasses.dataclass(frozen=True)
class Ceiling:
    """The best adhesion of N stops at every speed and place."""

    vehicle: Vehicle
    limit: SlideLimit
    table: AdhesionTable
    stops: Braked

    def at(self, speed: np.ndarray, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return best adhesion [-] and its slip [m/s], both (T, N, A), at speeds and leading-axle positions (T, N)."""
        offsets = np.array(self.vehicle.axle_positions_m)
        return _look_up(np.asarray(speed, np.float64), np.asarray(position, np.float64), offsets, self.table)

    def capacity(self, speed: np.ndarray, position: np.ndarray) -> np.ndarray:
        """Return the force [N] of each wheelset (T, N, A) that best adhesion and full brake torque allow, slip constant."""
        best, _ = self.at(speed, position)
        axles, mass = self.vehicle.axles, self.stops.mass
        adhesive = best * (mass * self.vehicle.gravity_mps2 / axles)[:, None]
        braked = np.broadcast_to(self.stops.torque[:, None] / self.stops.radius, adhesive.shape)
        rotating = np.broadcast_to(self.vehicle.wheelset_inertia_kgm2 / self.stops.radius**2, adhesive.shape)
        force = np.minimum(adhesive, braked)
        for _ in range(axles + 1):  # the torque also slows the wheels; after so many passes it is settled who is limited by it
            by_torque = braked - rotating * (force.sum(axis=-1, keepdims=True) / mass[:, None]) < adhesive
            total = np.where(by_torque, braked, adhesive).sum(axis=-1, keepdims=True)
            total /= 1.0 + (rotating * by_torque).sum(axis=-1, keepdims=True) / mass[:, None]
            force = np.where(by_torque, braked - rotating * total / mass[:, None], adhesive)
        return force

    def shortest(self) -> tuple[np.ndarray, np.ndarray]:
        """Return distance [m] and duration [s] of the shortest stops (N,); inf where the vehicle runs on."""
        v = self.vehicle
        running = _Running(
            np.array(v.axle_positions_m), v.wheelset_inertia_kgm2, v.gravity_mps2, v.resistance_a_n, v.resistance_b_ns_per_m,
            v.resistance_c_ns2_per_m2,
        )  # fmt: skip
        return _shortest(self.stops, running, self.limit.creepage, self.limit.above_mps, self.table)


def ceiling(vehicle: Vehicle, stops: Sequence[Stop], limit: SlideLimit = SlideLimit()) -> Ceiling:
    """Tabulate the best adhesion under the slide limit for N stops that have the same number of track nodes."""
    fastest = max(stop.initial_speed for stop in stops)
    near = np.nextafter(limit.above_mps, np.inf)  # the limit sets in at once
    grid = np.arange(_SPEED_STEP, fastest + 20.0, _SPEED_STEP)  # downhill a vehicle may first become faster
    speeds = np.unique(np.concatenate([[0.02, 0.05, 0.1, 0.2, 0.3], grid, [limit.above_mps, near]]))
    speeds = speeds[speeds >= 0.02]  # at rest creepage has no meaning
    rails = [np.unique(np.stack([s.profile, s.coverage]), axis=1, return_inverse=True) for s in stops]
    kinds = max(rail.shape[1] for rail, _ in rails)
    tables = []
    for stop, (rail, _) in zip(stops, rails, strict=True):
        load = stop.mass * vehicle.gravity_mps2 / (2 * vehicle.axles)
        friction = np.minimum(stop.mu_cd * rail[0], vehicle.contact.kinetic_friction_r)[:, None]
        found = best_adhesion(speeds, limit.slip(speeds), load, friction, stop.tau, vehicle.contact.law, rail[1][:, None])
        tables.append([np.pad(values, ((0, kinds - rail.shape[1]), (0, 0))) for values in found])
    table = AdhesionTable(
        speeds=speeds,
        best=np.stack([best for best, _ in tables]),
        slip=np.stack([slip for _, slip in tables]),
        kind=np.stack([inverse.ravel() for _, inverse in rails]),
    )
    braked = Braked(
        initial_speed=np.array([stop.initial_speed for stop in stops]),
        mass=np.array([stop.mass for stop in stops]),
        torque=np.array([stop.demand * vehicle.full_brake_torque_nm for stop in stops]),
        radius=np.stack([stop.radius for stop in stops]),
        gradient=np.array([stop.gradient for stop in stops]),
    )
    return Ceiling(vehicle, limit, table, braked)


@kernel
def _at(i: int, speed: float, place: float, table: AdhesionTable) -> tuple[float, float]:
    """Best adhesion and its slip of stop i at a speed and place; between two nodes the better of both rails."""
    speeds, best, slip, kind = table
    x = min(max(place / TRACK_STEP_M, 0.0), kind.shape[1] - 1.0)
    node = int(x)
    following = min(node + 1, kind.shape[1] - 1)
    j = min(max(int(np.searchsorted(speeds, speed)) - 1, 0), len(speeds) - 2)
    share = min(max((speed - speeds[j]) / (speeds[j + 1] - speeds[j]), 0.0), 1.0)
    here, there = kind[i, node], kind[i, following]
    value = best[i, here, j] + share * (best[i, here, j + 1] - best[i, here, j])
    at_best = slip[i, here, j] + share * (slip[i, here, j + 1] - slip[i, here, j])
    if there != here and x > node:
        other = best[i, there, j] + share * (best[i, there, j + 1] - best[i, there, j])
        if other > value:
            return other, slip[i, there, j] + share * (slip[i, there, j + 1] - slip[i, there, j])
    return value, at_best


@kernel
def _look_up(
    speed: np.ndarray, position: np.ndarray, offsets: np.ndarray, table: AdhesionTable
) -> tuple[np.ndarray, np.ndarray]:
    steps, n = speed.shape
    values = np.empty((steps, n, len(offsets)))
    slips = np.empty((steps, n, len(offsets)))
    for t in range(steps):
        for i in range(n):
            for k in range(len(offsets)):
                value, at_best = _at(i, speed[t, i], position[t, i] - offsets[k], table)
                values[t, i, k] = value
                slips[t, i, k] = at_best
    return values, slips


@kernel
def _shortest(
    stops: Braked, running: _Running, creepage: float, above: float, table: AdhesionTable
) -> tuple[np.ndarray, np.ndarray]:
    """See the module. `wheel` is the circumferential speed r w of each; a wheel is full when it rolls with the vehicle."""
    initial, masses, torques, radii, gradients = stops
    offsets, inertia, gravity, res_a, res_b, res_c = running
    n, axles = radii.shape
    distances = np.full(n, np.inf)
    durations = np.full(n, np.inf)
    wheel = np.empty(axles)
    force = np.empty(axles)
    h = STEP_S
    for i in range(n):
        v, x, t, mass = initial[i], 0.0, 0.0, masses[i]
        wheel[:] = v
        while t < TIME_LIMIT_S:
            resisted = res_a + v * (res_b + v * res_c) + mass * gravity * gradients[i]
            for k in range(axles):
                f, _ = _at(i, v, x - offsets[k], table)
                force[k] = f * mass * gravity / axles
            a = 0.0
            for _ in range(3):  # rolling wheels follow the vehicle: their torque slows them too
                total, rotating = resisted, 0.0
                for k in range(axles):
                    braked = torques[i] / radii[i, k]
                    share = inertia / radii[i, k] ** 2
                    if wheel[k] >= v and braked - share * a < force[k]:
                        total += braked
                        rotating += share
                    else:
                        total += force[k]
                a = total / (mass + rotating)
            after = v - h * a
            least = (1.0 - creepage) * after if after > above else 0.0
            for k in range(axles):
                if wheel[k] >= v and torques[i] / radii[i, k] - inertia / radii[i, k] ** 2 * a < force[k]:
                    wheel[k] = after
                else:
                    own = wheel[k] + h * radii[i, k] / inertia * (radii[i, k] * force[k] - torques[i])
                    wheel[k] = min(max(own, least), after)
            if after <= 0.0:
                distances[i] = x + 0.5 * v * v / a
                durations[i] = t + v / a
                break
            x += 0.5 * h * (v + after)
            t += h
            v = after
    return distances, durations
