"""The balances of a braked vehicle along recorded stops, as residuals averaged over blocks of time.

With T_k = (C_k + J dw_k/dt) / r from the wheel's own balance:

- adhesion: T_k - 2 N_k f(s_k, v, history), per axle, over twice the believed wheel load. If a wheel rolls freely (T near 0),
  this is the kinematic balance v - r w = 0 times the slope of the creep curve. It is then reported as kinematics.
- vehicle: v(t) - v(0) + (1/M) integral of (sum T_k + resistances) dt. It contains no adhesion model. In integrated form, the
  noise of the recorded speed stays white and J dw/dt is exact.
- actuator: C_k minus the torque from the recorded cylinder pressure, per axle. It exists only if both were measured.

Each row is divided by the standard deviation that noise alone gives it.
"""

import dataclasses
import functools
import threading
from collections.abc import Sequence

import numpy as np
from scipy import linalg, sparse

from wsp_env.diagnosis.evaluate import Evaluation, Evaluator, Model
from wsp_env.diagnosis.speed import NODE_S
from wsp_env.diagnosis.stops import BLOCK_S, ROLLING_SHARE, VEHICLE_BLOCK_S, PreparedStop, least_slip
from wsp_env.diagnosis.thinning import thinned
from wsp_env.recordings import Campaign

#: Error of the vehicle balance in addition to noise [m/s]: quantisation and the trapezoidal sum.
_SPEED_FLOOR_MPS = 5e-4
#: Error of the adhesion coefficient in addition to noise [-].
_ADHESION_FLOOR = 1e-4
#: Error of a wheelset's torque in addition to noise [N m]; equal to that of the adhesion at a wheelset load of about 100 kN.
_TORQUE_FLOOR_NM = 5.0

#: Creepage below which a wheel without torque counts as rolling [-]; a wrong radius causes less, a slide without torque more.
_ROLLING_CREEPAGE = 0.03

ADHESION, KINEMATICS, VEHICLE, ACTUATOR = 0, 1, 2, 3
BALANCES = ("adhesion", "kinematics", "vehicle", "actuator")
#: Classes of rows with a noise of their own: the balances, and the adhesion of sliding wheels.
NOISES = (*BALANCES, "sliding")


@dataclasses.dataclass(frozen=True)
class Rows:
    """Properties of each residual (n,); quantities are means over its block."""

    balance: np.ndarray  # ADHESION, KINEMATICS, VEHICLE or ACTUATOR
    slides: np.ndarray  # bool: adhesion rows of sliding wheels; on a replica, those on the flat part of its creep curve
    run: np.ndarray  # index into the stops
    axle: np.ndarray  # from 0; -1: the vehicle
    segment: np.ndarray  # stretch of the vehicle's momentum balance, numbered through all stops; -1: a wheel's row
    validate: np.ndarray  # bool
    time: np.ndarray  # [s]
    place: np.ndarray  # of the axle [m]
    speed: np.ndarray  # [m/s]
    slip: np.ndarray  # [m/s]
    work: np.ndarray  # W_sp [J/m]
    deceleration: np.ndarray  # [m/s2]

    def __len__(self) -> int:
        return len(self.run)

    @property
    def wheels(self) -> np.ndarray:
        """Mask (n,) of the wheel rows: adhesion and kinematics."""
        result: np.ndarray = (self.balance == ADHESION) | (self.balance == KINEMATICS)
        return result

    @property
    def noise(self) -> np.ndarray:
        """Index (n,) into `NOISES`; sliding wheels have a class of their own, because friction fluctuates only there."""
        return np.where(self.slides, len(BALANCES), self.balance)


@dataclasses.dataclass(frozen=True)
class Whitening:
    """Transformation that makes the noise of rows white, with standard deviation 1."""

    deviation: np.ndarray  # (n,)
    roots: tuple[tuple[np.ndarray, np.ndarray], ...]  # rows (m,) and the inverse root (m, m) of their covariance
    colour: sparse.csr_array | None = None  # (n, n) lower triangular, removes autocorrelation: `wsp_env.diagnosis.colour`

    def __call__(self, raw: np.ndarray) -> np.ndarray:
        """Return rows (n,) or (n, k) whitened."""
        white = raw / (self.deviation if raw.ndim == 1 else self.deviation[:, None])
        for rows, root in self.roots:
            white[rows] = root @ raw[rows]
        if self.colour is not None:
            white = self.colour @ white
        return white

    def of(self, rows: slice | np.ndarray) -> "Whitening":
        """Return the whitening of the rows (m,) of one run alone."""
        number = np.full(len(self.deviation), -1)
        number[rows] = np.arange(len(self.deviation[rows]))
        roots = tuple((number[mine], root) for mine, root in self.roots if number[mine[0]] >= 0)
        return Whitening(self.deviation[rows], roots, None if self.colour is None else self.colour[rows][:, rows])

    def plain(self, white: np.ndarray) -> np.ndarray:
        """Return whitened rows (n,) before the removal of autocorrelation; unit: standard deviations of the channels' noise."""
        if self.colour is None:
            return white
        result: np.ndarray = sparse.linalg.spsolve_triangular(self.colour, white, lower=True)
        return result

    def back(self, white: np.ndarray) -> np.ndarray:
        """Return whitened rows (n,) in the units of the balances."""
        white = self.plain(white)
        raw = white * self.deviation
        for rows, root in self.roots:
            raw[rows] = linalg.solve_triangular(root, white[rows], lower=True)
        return raw


class Balances:
    """The balances of a campaign's stops: the residuals of a model, and their whitening.

    Parameters
    ----------
    stops : with all samples
    like : balances of other stops (their recordings, if these are replicas), into whose rows these are cut; None: into own ones

    """

    #: As of a replica; recordings have no model about which their wheels are predicted.
    determinant = 0.0

    def __init__(self, campaign: Campaign, stops: Sequence[PreparedStop], like: "Balances | None" = None) -> None:
        self.campaign, self.sources = campaign, tuple(stops)
        self.stops = tuple(map(thinned, stops))
        self._evaluator = Evaluator(campaign, self.stops)
        self._kept = threading.local()  # each thread keeps its last evaluation
        self.vehicle = vehicle = self._evaluator.vehicle
        self.axles, self.radius, self.inertia = vehicle.axles, vehicle.wheel_radius_m, vehicle.wheelset_inertia_kgm2
        self.offsets = np.array(vehicle.axle_positions_m)
        cuts: Sequence[Blocks | None] = like.parts if like else [None] * len(self.stops)
        self.parts: list[Blocks] = [Blocks(stop, self, cut) for stop, cut in zip(self.stops, cuts, strict=True)]
        self.rows = _joined([part.rows(i) for i, part in enumerate(self.parts)])
        if like:
            self.rows = dataclasses.replace(self.rows, balance=like.rows.balance, segment=like.rows.segment)

    @property
    def sample_s(self) -> float:
        """Longest time between two samples of a recording [s]."""
        return max(stop.step_s for stop in self.sources)

    def evaluate(self, model: Model) -> list[Evaluation]:
        """Evaluate a model along every stop; the last result is cached."""
        last: tuple[Model, list[Evaluation]] | None = getattr(self._kept, "last", None)
        if last is None or last[0] != model:
            last = self._kept.last = (model, self._evaluator(model))
        return last[1]

    def evaluate_forces(self, model: Model) -> list[Evaluation]:
        """Evaluate a model without the adhesion and its slope."""
        return self._evaluator.forces(model)

    def evaluate_slid(self, model: Model, more: Sequence[np.ndarray]) -> list[Evaluation]:
        """Evaluate a model with the slip speeds raised by `more`, (T, A) of each stop [m/s]."""
        return self._evaluator(model, [-slip / self.radius for slip in more])

    def raw(self, model: Model, beside: Model | None = None) -> np.ndarray:
        """Residuals (n,) of a model: forces over the believed load [-], speeds [m/s], torques [N m].

        `beside` is as in `Replica.evaluate`; here, it changes nothing.
        """
        return np.concatenate([part.residuals(one) for part, one in zip(self.parts, self.evaluate(model), strict=True)])

    def like(self, stops: Sequence[PreparedStop]) -> "Balances":
        """Return the balances of other stops (replicas), cut into the same rows."""
        return Balances(self.campaign, stops, like=self)

    def whitening(self, model: Model) -> "Whitening":
        """Return the whitening of the channels' own noise at a model."""
        return self.whitening_of(self.evaluate(model))

    def whitening_of(self, evaluations: Sequence[Evaluation]) -> "Whitening":
        """Return the whitening of the channels' own noise for given evaluations of a model."""
        deviation = np.concatenate([part.deviation(one) for part, one in zip(self.parts, evaluations, strict=True)])
        roots = []
        for i, part in enumerate(self.parts):
            if part.momenta:
                root = linalg.cholesky(part.momentum_covariance(), lower=True)
                rows = np.flatnonzero((self.rows.run == i) & (self.rows.balance == VEHICLE))
                roots.append((rows, linalg.solve_triangular(root, np.eye(part.momenta), lower=True)))
        return Whitening(deviation, tuple(roots))


class Blocks:
    """One stop, cut into blocks, like another one if there is one."""

    def __init__(self, stop: PreparedStop, owner: Balances, like: "Blocks | None" = None) -> None:
        self.stop, self.owner = stop, owner
        self.length = max(round(BLOCK_S / stop.step_s), 1)
        self.vehicle_length = max(round(VEHICLE_BLOCK_S / stop.step_s), 1)
        self.used: np.ndarray
        self.segments: np.ndarray
        if like:
            self.used, self.segments = like.used, like.segments
            return
        self.used = self._mean(stop.usable, self.length) > 0.99
        inside = self._cut(stop.segment, self.vehicle_length)
        self.segments = np.where((inside == inside[:, :1]).all(axis=1), inside[:, 0], -1)
        # A stretch of one block determines only its own initial speed.
        counts = np.bincount(self.segments[self.segments >= 0], minlength=1) if len(self.segments) else np.zeros(1)
        self.segments = np.where((self.segments >= 0) & (counts[np.maximum(self.segments, 0)] > 1), self.segments, -1)

    @staticmethod
    def _cut(values: np.ndarray, length: int) -> np.ndarray:
        blocks = len(values) // length
        return values[: blocks * length].reshape(blocks, length, *values.shape[1:])

    @property
    def block_s(self) -> float:
        """Length of the wheels' blocks [s]."""
        return self.length * self.stop.step_s

    def _mean(self, values: np.ndarray, length: int) -> np.ndarray:
        result: np.ndarray = np.einsum("bl...->b...", self._cut(np.asarray(values, dtype=float), length)) / length
        return result

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Mean over each adhesion block of an array (T,) or (T, A): (B,) or (B, A)."""
        return self._mean(values, self.length)

    def rows(self, index: int) -> Rows:
        """Return the properties of the rows of this stop, the `index`-th of the campaign."""
        stop, owner = self.stop, self.owner
        b, a = np.nonzero(self.used)
        slip = stop.speed[:, None] - owner.radius * stop.wheel
        moment = stop.torque + owner.inertia * stop.wheel_rate
        work = moment / (2.0 * owner.radius) * slip / np.maximum(stop.speed, 1.0)[:, None]
        share = np.abs(self.mean(stop.torque)) / max(float(np.abs(stop.torque).max()), 1.0)
        rolls = (share < ROLLING_SHARE) & (np.abs(self.mean(slip)) < _ROLLING_CREEPAGE * self.mean(stop.speed)[:, None])

        def every(values: np.ndarray) -> np.ndarray:
            own = self.mean(values)[b]
            return self.joined(own, self.vehicle_rows(values), own)

        def wheels(values: np.ndarray) -> np.ndarray:
            own = self.mean(values)[b, a]
            return self.joined(own, brakes=own)

        balance = np.where(rolls[b, a], KINEMATICS, ADHESION)
        slides = ~rolls[b, a] & (self.mean(slip)[b, a] > least_slip(self.mean(stop.speed))[b])
        run = self.joined(np.full(len(b), index), np.full(self.momenta, index), np.full(len(b), index))
        return Rows(
            balance=self.joined(balance, np.full(self.momenta, VEHICLE), np.full(len(b), ACTUATOR)),
            slides=self.joined(slides),
            run=run,
            axle=self.joined(a, np.full(self.momenta, -1), a),
            segment=self.joined(np.full(len(b), -1), self.segments[self.segments >= 0], np.full(len(b), -1)),
            validate=np.full(len(run), stop.group == "validate"),
            time=every(stop.time),
            place=every(stop.place) - self.joined(owner.offsets[a], brakes=owner.offsets[a]),
            speed=every(stop.speed),
            slip=wheels(slip),
            work=wheels(work),
            deceleration=-every(stop.acceleration),
        )

    @functools.cached_property
    def momenta(self) -> int:
        """Number of rows of the vehicle balance."""
        return int((self.segments >= 0).sum())

    @functools.cached_property
    def _wheel_rows(self) -> int:
        return int(self.used.sum())

    @functools.cached_property
    def _stretches(self) -> list[np.ndarray]:
        """The vehicle rows of each stretch."""
        segment = self.segments[self.segments >= 0]
        return [np.flatnonzero(segment == which) for which in np.unique(segment)]

    def joined(
        self, wheels: np.ndarray | None = None, vehicle: np.ndarray | None = None, brakes: np.ndarray | None = None
    ) -> np.ndarray:
        """Return all rows (n, ...) of this stop: wheels, vehicle, actuators; None stands for zeros.

        If no pressure was recorded beside the torque, there are no actuator rows, and `brakes` is ignored.
        """
        parts = []
        counts = (self._wheel_rows, self.momenta, self._wheel_rows if self.stop.pressed is not None else 0)
        given = next(part for part in (wheels, vehicle, brakes) if part is not None)
        for part, count in zip((wheels, vehicle, brakes), counts, strict=True):
            parts.append(np.zeros((count, *given.shape[1:]), given.dtype) if part is None else part[:count])
        return np.concatenate(parts)

    def wheel_rows(self, values: np.ndarray) -> np.ndarray:
        """Block means of an array (T, A), as rows of the wheels or of their brakes."""
        result: np.ndarray = self.mean(values)[self.used]
        return result

    def vehicle_rows(self, values: np.ndarray) -> np.ndarray:
        """Block means of an array (T,), as rows of the vehicle balance."""
        result: np.ndarray = self._mean(values, self.vehicle_length)[self.segments >= 0]
        return result

    def summed(self, force: np.ndarray) -> np.ndarray:
        """Integrate a force (T,) [N] over the stop [N s]; the constant of each stretch is projected out later."""
        rest = np.where(self.stop.segment >= 0, force, 0.0)
        result: np.ndarray = np.cumsum(rest) * self.stop.step_s - 0.5 * rest * self.stop.step_s
        return result

    def residuals(self, one: Evaluation) -> np.ndarray:
        """Return the residuals of all rows of this stop."""
        impulse = self.summed(one.brake_force + one.resistance) + one.impulse
        momentum = self.vehicle_rows(one.recorded_speed + impulse / one.mass)
        for stretch in self._stretches:  # the initial speed of each stretch is free
            momentum[stretch] -= momentum[stretch].mean()
        brakes = None if self.stop.pressed is None else self.wheel_rows(one.torque - one.braking)
        return self.joined(self.wheel_rows(one.unbalanced(one.adhesion)), momentum, brakes)

    def deviation(self, one: Evaluation) -> np.ndarray:
        """Return the rows' standard deviations by the channels' noise; 1 in vehicle rows, whose noise is correlated.

        The noise of dw/dt counts with the inertia of the model. With the believed one, less noise would look like less inertia.
        """
        noise, radius = self.stop.noise, self.owner.radius
        moment = noise.moment(one.inertia) / (2.0 * radius * one.believed_load)
        slip = noise.slip(radius) * self.mean(one.stiffness)
        adhesion = np.sqrt(moment**2 + slip**2 + _ADHESION_FLOOR**2)[self.used]
        brakes = np.full(len(adhesion), np.hypot(noise.block_torque, _TORQUE_FLOOR_NM))
        return self.joined(adhesion, np.ones(self.momenta), brakes)

    def momentum_covariance(self) -> np.ndarray:
        """Covariance (m, m) [m2/s2] of the vehicle rows by the noise of the recorded speed."""
        noise = self.stop.noise.speed
        shorter = noise.white * np.sqrt(NODE_S / (self.vehicle_length * self.stop.step_s))
        covariance = noise._replace(white=shorter).covariance(self.vehicle_rows(self.stop.time))
        segment = self.segments[self.segments >= 0]
        same = segment[:, None] == segment
        result: np.ndarray = np.where(same, covariance, 0.0) + _SPEED_FLOOR_MPS**2 * np.eye(self.momenta)
        return result


def _joined(parts: list[Rows]) -> Rows:
    """Join the rows of all stops; number the stretches through."""
    first, shifted = 0, []
    for part in parts:
        shifted.append(np.where(part.segment >= 0, part.segment + first, -1))
        first += int(part.segment.max(initial=-1)) + 1
    joined = {field.name: np.concatenate([getattr(part, field.name) for part in parts]) for field in dataclasses.fields(Rows)}
    return Rows(**(joined | {"segment": np.concatenate(shifted)}))
