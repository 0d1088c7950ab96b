"""Evaluates a model along recorded stops at the measured speeds: contact, wheel loads, brake torque and resistances."""

import dataclasses
import functools
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from wsp_env.diagnosis.stops import PreparedStop, torque_per_bar
from wsp_env.parameters.campaign_vehicle import plant_vehicle
from wsp_env.parameters.vehicle import Brake, Vehicle
from wsp_env.plant import mechanisms
from wsp_env.plant.longitudinal import along
from wsp_env.plant.mechanisms import at_stop
from wsp_env.recordings import Campaign

#: Mechanism -> its parameters.
Choice = Mapping[str, Mapping[str, float]]

#: Lower bound of a wheel's load, as a share of its static load (assumption: T/2N of a wheel that hardly touches the rail tells
#: nothing of its adhesion, and that of a lifted wheel is infinite).
_LEAST_LOAD = 0.1

#: Lower bound of a vehicle's speed [m/s]: the forces of a model that is far from the recordings would stop it, or turn it back,
#: where the recorded one still rolls, and the law has no friction there (assumption: below the speeds that are evaluated).
_LEAST_SPEED_MPS = 0.1


@dataclasses.dataclass(frozen=True)
class Model:
    """The law's free parameters and the mechanisms that are on."""

    tau: float  # [m/J]
    mu_cd: tuple[float, ...]  # of each stop [-]
    choice: Choice = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """A model evaluated along one stop; arrays (T, A) unless stated otherwise."""

    speed: np.ndarray  # (T,) of the vehicle, from the recorded speed and the model's forces [m/s]
    adhesion: np.ndarray  # [-]
    slope: np.ndarray  # derivative of the adhesion by the slip speed [s/m]
    load: np.ndarray  # of one wheel [N]
    believed_load: float  # of one wheel, by the believed mass [N]
    slip: np.ndarray  # [m/s]
    force: np.ndarray  # T = (C + J dw/dt) / r of the wheelset, from its own balance [N]
    torque: np.ndarray  # C: measured, else by the model's brake [N m]
    braking: np.ndarray  # torque of the model's brake at the recorded pressure, else C [N m]
    impulse: np.ndarray  # (T,) J w / r summed over the wheelsets [N s]
    brake_force: np.ndarray  # (T,) C / r summed over the wheelsets [N]
    recorded_speed: np.ndarray  # (T,) raw, corrected for the mechanisms on its recorder [m/s]
    resistance: np.ndarray  # (T,) forces other than the wheels' [N]
    mass: float  # [kg]
    inertia: np.ndarray  # (A,) of the wheelsets [kg m2]
    misread: np.ndarray | float = 0.0  # slip error shown by sensors, beyond that of wheels known to roll [m/s]

    @property
    def stiffness(self) -> np.ndarray:
        """Derivative (T, A) of the wheel's force by the slip speed, over its believed load [s/m]."""
        result: np.ndarray = self.slope * (self.load / self.believed_load)
        return result

    def unbalanced(self, adhesion: np.ndarray) -> np.ndarray:
        """Return the force (T, A) [-] that the wheel's own balance needs beyond that of an adhesion, over its believed load.

        Over the load by the model, noise of the force would look smaller beside a heavier vehicle.
        """
        result: np.ndarray = (0.5 * self.force - self.load * adhesion) / self.believed_load
        return result

    def changed(self, other: "Evaluation", before: "Evaluation") -> "Evaluation":
        """Return this evaluation plus the difference `other` - `before`."""
        names = [field.name for field in dataclasses.fields(Evaluation)]
        return Evaluation(**{name: getattr(self, name) + (getattr(other, name) - getattr(before, name)) for name in names})


def vehicle_of(campaign: Campaign) -> Vehicle:
    """Return the campaign's vehicle as the plant's, with a brake whose pressures fit the recorded torques."""
    return plant_vehicle(campaign.vehicle, campaign.contact, campaign.name, payload_kg=0.0, brake=_brake(campaign))


def read_late(vehicle: Vehicle, choice: Choice) -> float:
    """Return the delay of the wheel speeds [s]: the correction applied to a speed that rises by 1 rad/s2."""
    rising = np.ones((1, vehicle.axles))
    return float(along.true_wheel_acceleration(along.model(vehicle, choice), np.zeros_like(rising), rising)[0, 0])


def _brake(campaign: Campaign) -> Brake:
    """Return a brake whose pressures fit the recorded torques; some mechanisms depend on the pressure."""
    per_bar = torque_per_bar(campaign)
    if per_bar > 0.0:
        return Brake(torque_per_bar_nm=per_bar)
    largest = max(float(np.quantile(run.brake_torque_nm, 0.999)) for run in campaign.runs.values())
    plain = Brake()
    return Brake(torque_per_bar_nm=max(largest, 1.0) / plain.full_pressure_bar)


class Evaluator:
    """Evaluates models along the stops of a campaign."""

    def __init__(self, campaign: Campaign, stops: Sequence[PreparedStop]) -> None:
        self._campaign = campaign
        self.vehicle = vehicle_of(campaign)
        self.stops = tuple(stops)

        def every(name: str) -> np.ndarray:
            return np.concatenate([getattr(stop, name) for stop in self.stops])

        self._torque, self._speed, self._recorded = every("torque"), every("speed"), every("recorded_speed")
        self._rates = every("wheel_rate"), every("wheel_jerk")
        braked = [stop.torque if stop.pressed is None else stop.pressed for stop in self.stops]
        self._counts = [len(stop.time) for stop in self.stops]
        self._measured = np.repeat([stop.pressed is not None for stop in self.stops], self._counts)[:, None]
        self._kept = threading.local()  # each thread keeps the last result that does not depend on the contacts
        self._trajectory = along.Trajectory(
            every("time"), self._speed, every("acceleration"), every("place"), every("wheel"), self._rates[0],
            np.concatenate(braked), tuple(np.cumsum([0, *self._counts[:-1]]).tolist()),
            tuple(stop.step_s if stop.step_s > stop.noise.step_s else 0.0 for stop in self.stops),
        )  # fmt: skip

    def __call__(self, model: Model, faster: Sequence[np.ndarray] | None = None) -> list[Evaluation]:
        """Evaluate a model along every stop; optionally with wheels turned `faster` by (T, A) of each stop [rad/s].

        `faster` does not change the estimated speed of the vehicle.
        """
        own = self._choices(model)
        if any(one != own[0] for one in own):
            parts = enumerate(zip(self._each, self._alone(model, own), strict=True))
            return [one(m, faster and faster[i : i + 1])[0] for i, (one, m) in parts]
        m, trajectory, belief = along.model(self.vehicle, own[0]), self._trajectory, self._belief(model.mu_cd, model.tau)
        if mechanisms.work_moves(m.mechanisms):
            speed, shift = self._changed_speed(m, trajectory, belief)
        else:
            speed, shift = self._last(self._speed_of, along.moving(m.mechanisms))
        if faster is not None:
            trajectory = trajectory.measured(wheel_speed_radps=trajectory.wheel_speed_radps + np.concatenate(faster))
        moving = np.maximum(speed, _LEAST_SPEED_MPS)
        return self._evaluations(m, along.along(trajectory.measured(speed_mps=moving), belief, m), shift)

    def forces(self, model: Model) -> list[Evaluation]:
        """Evaluate a model without the adhesion and its slope."""
        own = self._choices(model)
        if any(one != own[0] for one in own):
            return [one.forces(m)[0] for one, m in zip(self._each, self._alone(model, own), strict=True)]
        on = mechanisms.make(own[0])
        return self(model) if mechanisms.work_moves(on) else self._last(self._forces_of, along.moving(on, loads=True))

    def _choices(self, model: Model) -> list[Choice]:
        return [at_stop(model.choice, stop.earlier) for stop in self.stops]

    @staticmethod
    def _alone(model: Model, own: Sequence[Choice]) -> list[Model]:
        """Return the model for each stop alone."""
        return [dataclasses.replace(model, mu_cd=model.mu_cd[i : i + 1], choice=one) for i, one in enumerate(own)]

    def _last(self, of: Callable[[Any], Any], on: Any) -> Any:
        """Return `of(on)`; the last two results are cached, because many consecutive models have the same mechanisms.

        Two, because a model is often evaluated with two states of its delays in turn.
        """
        last: tuple[tuple[Any, Any], ...] = getattr(self._kept, of.__name__, ())
        found = next((one for one in last if one[0] == on), None) or (on, of(on))
        setattr(self._kept, of.__name__, (found, *(one for one in last if one is not found))[:2])
        return found[1]

    def _speed_of(self, on: Any) -> tuple[np.ndarray, np.ndarray]:
        """Return `_changed_speed` for mechanisms whose effect does not depend on the friction."""
        return self._changed_speed(along.of_mechanisms(self.vehicle, on), self._trajectory, self._any_belief)

    def _forces_of(self, on: Any) -> list[Evaluation]:
        """Return `forces` for mechanisms whose effect does not depend on the friction."""
        m, (speed, shift) = along.of_mechanisms(self.vehicle, on), self._last(self._speed_of, along.moving(on))
        p = along.along(self._trajectory.measured(speed_mps=speed), self._any_belief, m, contacts=False)
        return self._evaluations(m, p, shift)

    def _changed_speed(
        self, m: along.PlantModel, trajectory: along.Trajectory, belief: along.Belief
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Return the vehicle's speed (T,) with the change by a model's forces, and the shift of the recorded speed (T,) [m/s].

        Fast changes follow the prediction by the forces, slow ones the recorded speed.
        """
        if along.moving(m.mechanisms) == mechanisms.NULL:
            return self._speed, np.zeros(len(self._speed))
        p = along.along(trajectory, belief, m, contacts=False)
        shift, moved = p.speed_mps - self._speed, self._predicted(m, p) - self._believed
        speed = self._speed.copy()
        for stop, samples in zip(self.stops, trajectory.stops, strict=True):
            change = moved[samples] - stop.estimator(stop.time, moved[samples] - shift[samples])
            if change.any():
                speed[samples] += change - shift[samples]
        return speed, shift

    def _evaluations(self, m: along.PlantModel, p: along.Prediction, shift: np.ndarray) -> list[Evaluation]:
        """Return each stop's part of a prediction; `shift` is the correction of the recorded speed."""
        beside = self._beside(m)
        torque, rate = self._braking(p, beside), along.true_wheel_acceleration(m, *self._rates)
        static = np.repeat(p.mass_kg, self._counts)[:, None] * self.vehicle.gravity_mps2 / (2.0 * self.vehicle.axles)
        every = {
            "speed": p.speed_mps, "adhesion": p.adhesion, "slope": p.adhesion_slope,
            "load": np.maximum(p.wheel_load_n, _LEAST_LOAD * static),
            "slip": p.slip_speed_mps, "force": (torque + p.inertia_kgm2 * rate) / p.radius_m, "torque": torque,
            "braking": p.torque_nm - beside * self._measured, "impulse": p.wheel_speed_radps @ (p.inertia_kgm2 / p.radius_m),
            "brake_force": torque @ (1.0 / p.radius_m), "recorded_speed": self._recorded + shift, "resistance": p.resistance_n,
        }  # fmt: skip
        return [
            Evaluation(
                **{name: values[samples] for name, values in every.items()},
                mass=float(mass),
                inertia=p.inertia_kgm2,
                believed_load=stop.mass * self.vehicle.gravity_mps2 / (2.0 * self.vehicle.axles),
            )
            for samples, mass, stop in zip(self._trajectory.stops, p.mass_kg, self.stops, strict=True)
        ]

    def _braking(self, p: along.Prediction, beside: np.ndarray) -> np.ndarray:
        """Return the torques (T, A): measured with those `beside` them, else those of the model's brakes [N m]."""
        return np.where(self._measured, self._torque + beside, p.torque_nm) if self._measured.any() else p.torque_nm

    def _beside(self, m: along.PlantModel) -> np.ndarray:
        """Return the torques (T, A) that no caliper holds, so that measured torques do not contain them [N m]."""
        on = mechanisms.beside_calipers(m.mechanisms)
        if on == mechanisms.NULL or not self._measured.any():
            return np.zeros_like(self._torque)
        result: np.ndarray = self._last(self._beside_of, on)
        return result

    def _beside_of(self, on: Any) -> np.ndarray:
        p = along.along(self._trajectory, self._any_belief, along.of_mechanisms(self.vehicle, on), contacts=False)
        return p.torque_nm - self._trajectory.brake_torque_nm

    def _predicted(self, m: along.PlantModel, p: along.Prediction) -> np.ndarray:
        """Return the change of speed (T,) since each stop's start, predicted from wheel forces and resistance [m/s]."""
        force = self._braking(p, self._beside(m)) @ (1.0 / p.radius_m) + p.resistance_n
        impulse = p.wheel_speed_radps @ (p.inertia_kgm2 / p.radius_m)  # exact, also on replicas with predicted rates
        sums = []
        for samples, stop, mass in zip(self._trajectory.stops, self.stops, p.mass_kg, strict=True):
            lost = (np.cumsum(force[samples]) - 0.5 * force[samples]) * stop.step_s + impulse[samples] - impulse[samples.start]
            sums.append(lost / -mass)
        return np.concatenate(sums)

    def _belief(self, mu_cd: Sequence[float], tau: float) -> along.Belief:
        masses, gradients = np.array([stop.mass for stop in self.stops]), np.array([stop.gradient for stop in self.stops])
        friction = np.repeat(mu_cd[: len(self.stops)], self._counts)[:, None]
        return along.Belief(friction, tau, masses, self.vehicle.wheel_radius_m, gradients)

    @functools.cached_property
    def _each(self) -> "list[Evaluator]":
        """Evaluators of the single stops."""
        return [Evaluator(self._campaign, [stop]) for stop in self.stops]

    @functools.cached_property
    def _any_belief(self) -> along.Belief:
        """A belief for quantities that do not depend on friction."""
        return self._belief([1.0] * len(self.stops), 0.0)

    @functools.cached_property
    def _believed(self) -> np.ndarray:
        """Change of speed (T,) predicted without mechanisms, on which the estimated speeds are based [m/s]."""
        m = along.model(self.vehicle, {})
        return self._predicted(m, along.along(self._trajectory, self._any_belief, m, contacts=False))
