"""Null recordings: what the fitted baseline would have recorded, with noise, quantisation and normal variation.

The smoothed creepage histories are kept, the vehicle's speed is integrated from the baseline's forces, the wheel speeds are
(1 - e) v / r and the torque follows from the wheel's balance: exact recordings of a sound vehicle that need no WSP. Where
a wheel does not slide its creepage is the one at which the baseline gives the force that was recorded: the measured
one is noise there.
"""

import dataclasses

import numpy as np

from wsp_env.compiled import inlined, kernel
from wsp_env.contact.degraded import DegradedLaw, adhesion, adhesion_slope, degraded_adhesion
from wsp_env.contact.traction import Surface
from wsp_env.diagnosis.balances import Balances
from wsp_env.diagnosis.evaluate import Evaluation, Evaluator, Model
from wsp_env.diagnosis.stops import LEAST_SPEED_MPS, PreparedStop, smooth_speed, smooth_torque, smooth_wheels
from wsp_env.diagnosis.variation import GAIN, RADIUS, STIFFNESS, TRACK, gain_deviation

_SLIDES = 0.01  # creepage from which on the measured one is kept
_TRACK_M = (5.0, 20.0)  # distances between values of mu_cd along the track
_NEWTON = 12


@dataclasses.dataclass(frozen=True)
class Draw:
    """Normal variation of one null campaign; deviations as `variation` has them, uniform."""

    gain: np.ndarray  # (R, runs, A) of the torque
    brake: np.ndarray  # (R, runs, A) of the brake, where its pressure is recorded beside a measured torque
    radius: np.ndarray  # (R, runs, A)
    stiffness: np.ndarray  # (R, A)
    places: np.ndarray  # (M,) [m]
    track: np.ndarray  # (R, M)


def draw(balances: Balances, replicates: int, rng: np.random.Generator) -> Draw:
    """Draw the normal variation of some null campaigns; half of gain and radius stays from run to run."""
    runs, axles = len(balances.stops), balances.axles
    widest = np.sqrt(3.0)

    def uniform(deviation: float, *shape: int) -> np.ndarray:
        return deviation * widest * rng.uniform(-1.0, 1.0, (replicates, *shape))

    rows = balances.rows
    places = np.arange(rows.place.min() - 50.0, rows.place.max() + 50.0, 1.0)
    track = np.empty((replicates, len(places)))
    for i in range(replicates):
        knots = places[0] + np.concatenate([[0.0], np.cumsum(rng.uniform(*_TRACK_M, int(len(places) / _TRACK_M[0]) + 2))])
        track[i] = np.interp(places, knots, TRACK * widest * rng.uniform(-1.0, 1.0, len(knots)))
    gain = gain_deviation(balances)
    # A vehicle keeps its gains, or a run has its own: which one is not known, so half of the null campaigns each.
    own = (rng.random(replicates) < 0.5)[:, None, None]

    def kept_or_own(deviation: float) -> np.ndarray:
        return np.where(own, uniform(deviation, runs, axles), uniform(deviation, 1, axles))

    torque, radius, stiffness = kept_or_own(gain), kept_or_own(RADIUS), uniform(STIFFNESS, axles)
    recorded = any(stop.pressed is not None for stop in balances.stops)
    return Draw(torque, kept_or_own(GAIN) if recorded else torque, radius, stiffness, places, track)


class Maker:
    """Makes null campaigns of a baseline."""

    def __init__(self, balances: Balances, model: Model) -> None:
        self.balances, self.model = balances, dataclasses.replace(model, choice={})
        self._evaluations = Evaluator(balances.campaign, balances.sources)(self.model)
        self._creepages = [_creepage(balances, one, self.model, i) for i, one in enumerate(self._evaluations)]

    def make(self, replicates: int, rng: np.random.Generator) -> list[list[PreparedStop]]:
        """Return null campaigns, each a list of stops prepared as the recorded ones are."""
        varied = draw(self.balances, replicates, rng)
        per_stop = [self._stop(i, varied, rng) for i in range(len(self.balances.sources))]
        return [[stops[r] for stops in per_stop] for r in range(replicates)]

    def _stop(self, index: int, varied: Draw, rng: np.random.Generator) -> list[PreparedStop]:
        balances, model, creepage = self.balances, self.model, self._creepages[index]
        stop, vehicle = balances.sources[index], balances.vehicle
        step, inertia, radius = stop.step_s, vehicle.wheelset_inertia_kgm2, vehicle.wheel_radius_m
        load = stop.mass * vehicle.gravity_mps2 / (2 * balances.axles)
        replicates, samples = len(varied.gain), len(stop.time)
        speed = np.full((replicates, samples), stop.speed[0])
        force = np.empty((replicates, samples, balances.axles))
        places = stop.place[:, None] - np.array(vehicle.axle_positions_m)
        nodes = np.clip(np.rint(places - varied.places[0]).astype(np.int64), 0, len(varied.places) - 1)
        run = (model.mu_cd[index], model.tau, load, stop.mass, step)
        resisted, law = self._evaluations[index].resistance, vehicle.contact.law
        _brake(creepage, nodes, varied.track, varied.stiffness, resisted, run, law, speed, force)
        radii = radius * (1.0 + varied.radius[:, min(index, varied.radius.shape[1] - 1)])[:, None, :]
        wheel = (1.0 - creepage) * speed[:, :, None] / radii
        torque = radii * force - inertia * np.gradient(wheel, step, axis=1)
        pressed = torque / (1.0 + varied.brake[:, min(index, varied.brake.shape[1] - 1)][:, None, :])
        torque /= 1.0 + varied.gain[:, min(index, varied.gain.shape[1] - 1)][:, None, :]
        return _recorded(balances, stop, (speed, wheel, torque, pressed), rng)


@inlined
def _stiffer(law: DegradedLaw, factor: float) -> DegradedLaw:
    return DegradedLaw(
        law.stiffness * factor, law.k_ad, law.k_sd, law.k_ar, law.k_sr, law.mu_cr, law.ratio_d, law.ratio_r,
        law.gamma_d, law.gamma_r, law.recovery_exponent, law.recovery_threshold,
    )  # fmt: skip


@kernel
def _brake(
    creepage: np.ndarray,
    nodes: np.ndarray,
    track: np.ndarray,
    stiffness: np.ndarray,
    resisted: np.ndarray,
    run: tuple[float, float, float, float, float],
    law: DegradedLaw,
    speed: np.ndarray,
    force: np.ndarray,
) -> None:
    """Integrate the speed (R, T), by Adams and Bashforth's second order, and fill in the forces (R, T, A) of the wheelsets."""
    mu_cd, tau, load, mass, step = run
    for r in range(len(speed)):
        last = 0.0
        for j in range(creepage.shape[0]):
            v = speed[r, j]
            total = resisted[j]
            for k in range(creepage.shape[1]):
                own = _stiffer(law, 1.0 + stiffness[r, k])
                e = creepage[j, k]
                on = Surface(mu_cd * (1.0 + track[r, nodes[j, k]]), own.mu_cr, 1.0, 0.0)
                f = adhesion(e * v, v, load, on, tau, own).f
                force[r, j, k] = 2.0 * load * (f if e >= 0.0 else -f)
                total += force[r, j, k]
            mean = total if j == 0 else 1.5 * total - 0.5 * last
            last = total
            if j + 1 < creepage.shape[0]:
                speed[r, j + 1] = max(v - step * mean / mass, 0.1)


def _creepage(balances: Balances, one: Evaluation, model: Model, index: int) -> np.ndarray:
    """Creepage (T, A) of the stop: as measured where the wheel slides, else as its force needs it."""
    stop, law = balances.sources[index], balances.vehicle.contact.law
    load = stop.mass * balances.vehicle.gravity_mps2 / (2 * balances.axles)
    v = np.maximum(stop.speed, 0.1)[:, None]
    measured = one.slip / v
    aim = np.clip(one.force / (2.0 * load), -0.05, None)
    slip = np.zeros_like(measured)
    for _ in range(_NEWTON):
        f = degraded_adhesion(slip, v, load, model.mu_cd[index], model.tau, law)
        slope = adhesion_slope(slip, v, load, model.mu_cd[index], model.tau, law)
        slip = np.clip(slip + (aim - f) / np.maximum(slope, 0.05 / v), -_SLIDES * v, _SLIDES * v)
    # Blend between 0.7 and 1.3 of the limit, so that the wheel does not jump.
    share = np.clip((measured / _SLIDES - 0.7) / 0.6, 0.0, 1.0)
    result: np.ndarray = np.clip(share * measured + (1.0 - share) * slip / v, -0.2, 0.999)
    return result


def _recorded(
    balances: Balances, stop: PreparedStop, channels: tuple[np.ndarray, ...], rng: np.random.Generator
) -> list[PreparedStop]:
    """Add noise, round, and smooth as recordings are: speed, wheel speeds, torques and those by the cylinders' pressures."""
    speed, wheel, torque, pressed = channels
    noise, step = stop.noise, stop.step_s
    thinning = np.sqrt(max(round(step / noise.step_s), 1))  # samples that were thinned were averaged by the smoothing

    def noisy(values: np.ndarray, deviation: float) -> np.ndarray:
        result: np.ndarray = values + deviation / thinning * rng.standard_normal(values.shape)
        return result

    wheel, torque, recorded = noisy(wheel, noise.wheel), noisy(torque, noise.torque), noisy(speed, noise.speed)
    smooth, rate, jerk, smoothed_torque = smooth_wheels(wheel, torque, step)
    by_pressure = None if stop.pressed is None else smooth_torque(noisy(pressed, noise.pressed), step)
    v, acceleration = smooth_speed(recorded, smooth, rate, smoothed_torque, balances.campaign, stop.mass, step)
    fast = v > 0.5 * LEAST_SPEED_MPS
    return [
        dataclasses.replace(
            stop, speed=v[r], acceleration=acceleration[r], recorded_speed=recorded[r], wheel=smooth[r], wheel_rate=rate[r],
            wheel_jerk=jerk[r], torque=smoothed_torque[r], pressed=None if by_pressure is None else by_pressure[r],
            place=stop.place[0] + np.cumsum(v[r]) * step, usable=stop.usable & fast[r][:, None],
        )
        for r in range(len(speed))
    ]  # fmt: skip
