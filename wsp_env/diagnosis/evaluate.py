"""Evaluates a model along recorded stops: contact, wheel loads, brake torque and what resists, at measured speeds."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wsp_env.diagnosis.stops import PreparedStop, torque_per_bar
from wsp_env.parameters.campaign_vehicle import plant_vehicle
from wsp_env.parameters.vehicle import Brake, Vehicle
from wsp_env.plant.longitudinal import along
from wsp_env.plant.mechanisms import at_stop
from wsp_env.recordings import Campaign

#: Mechanism -> its parameters.
Choice = Mapping[str, Mapping[str, float]]


@dataclasses.dataclass(frozen=True)
class Model:
    """The law's free parameters and the mechanisms that are on."""

    tau: float  # [m/J]
    mu_cd: tuple[float, ...]  # of each stop [-]
    choice: Choice = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """A model along one stop; (T, A) unless said otherwise."""

    speed: np.ndarray  # (T,) of the vehicle, as the model's forces and the recorded speed give it [m/s]
    adhesion: np.ndarray  # [-]
    slope: np.ndarray  # its derivative by the slip speed [s/m]
    load: np.ndarray  # of one wheel [N]
    slip: np.ndarray  # [m/s]
    force: np.ndarray  # T = (C + J dw/dt) / r of the wheelset, by its own balance [N]
    torque: np.ndarray  # C, measured, else by the model's brake [N m]
    braking: np.ndarray  # what the model's brake gives at the recorded pressure, else C [N m]
    impulse: np.ndarray  # (T,) J w / r summed over the wheelsets [N s]
    brake_force: np.ndarray  # (T,) C / r summed over the wheelsets [N]
    recorded_speed: np.ndarray  # (T,) raw, with the mechanisms on its recorder undone [m/s]
    resistance: np.ndarray  # (T,) beside the wheels [N]
    mass: float  # [kg]
    misread: np.ndarray | float = 0.0  # slip that sensors show beside that of wheels that are known to roll [m/s]


def vehicle_of(campaign: Campaign) -> Vehicle:
    """Return the campaign's vehicle as the plant takes it, with a brake whose pressures fit the recorded torques."""
    return plant_vehicle(campaign.vehicle, campaign.contact, campaign.name, payload_kg=0.0, brake=_brake(campaign))


def _brake(campaign: Campaign) -> Brake:
    """Return a brake whose pressures fit the recorded torques: a mechanism may depend on the pressure."""
    per_bar = torque_per_bar(campaign)
    if per_bar > 0.0:
        return Brake(torque_per_bar_nm=per_bar)
    largest = max(float(np.quantile(run.brake_torque_nm, 0.999)) for run in campaign.runs.values())
    plain = Brake()
    return Brake(torque_per_bar_nm=max(largest, 1.0) / plain.full_pressure_bar)


class Evaluator:
    """Evaluates models along the stops of a campaign."""

    def __init__(self, campaign: Campaign, stops: Sequence[PreparedStop]) -> None:
        self.vehicle = vehicle_of(campaign)
        self.stops = tuple(stops)
        self._trajectories = [
            along.Trajectory(
                s.time, s.speed, s.acceleration, s.place, s.wheel, s.wheel_rate, s.torque if s.pressed is None else s.pressed
            )
            for s in self.stops
        ]
        self._bare: list[np.ndarray | None] = [None] * len(self.stops)

    def __call__(self, model: Model, faster: Sequence[np.ndarray] | None = None) -> list[Evaluation]:
        """Return what the model says of every stop; of wheels that are by some speeds (T, A) `faster` [rad/s], where given."""
        common = along.model(self.vehicle, model.choice)
        own = [at_stop(model.choice, stop.earlier) for stop in self.stops]
        each = [common if one is model.choice else along.model(self.vehicle, one) for one in own]
        trajectories = self._trajectories
        if faster is not None:
            pairs = zip(trajectories, faster, strict=True)
            trajectories = [dataclasses.replace(one, wheel_speed_radps=one.wheel_speed_radps + more) for one, more in pairs]
        return [self._one(i, constants, model, trajectories[i]) for i, constants in enumerate(each)]

    def _one(self, i: int, constants: Any, model: Model, trajectory: along.Trajectory) -> Evaluation:
        stop = self.stops[i]
        belief = along.Belief(model.mu_cd[i], model.tau, stop.mass, self.vehicle.wheel_radius_m, stop.gradient)
        p = along.along(trajectory, belief, constants)
        shift = p.speed_mps - stop.speed
        # What forces predict of the speed is believed, the recorded speed only as far as it is slow.
        moved = self._predicted(stop, p, constants) - self._believed(i)
        held = moved - stop.estimator(stop.time, moved - shift)
        if held.any():
            again = dataclasses.replace(trajectory, speed_mps=stop.speed + held - shift)
            p = along.along(again, belief, constants)
        rate = along.true_wheel_acceleration(constants, stop.wheel_rate, stop.wheel_jerk)
        torque = p.torque_nm if stop.pressed is None else stop.torque
        return Evaluation(
            speed=p.speed_mps,
            adhesion=p.adhesion,
            slope=p.adhesion_slope,
            load=p.wheel_load_n,
            slip=p.slip_speed_mps,
            force=(torque + p.inertia_kgm2 * rate) / p.radius_m,
            torque=torque,
            braking=p.torque_nm,
            impulse=(p.inertia_kgm2 * p.wheel_speed_radps / p.radius_m).sum(axis=1),
            brake_force=(torque / p.radius_m).sum(axis=1),
            recorded_speed=stop.recorded_speed + shift,
            resistance=p.resistance_n,
            mass=p.mass_kg,
        )

    def _predicted(self, stop: PreparedStop, p: along.Prediction, constants: Any) -> np.ndarray:
        """Return the change of speed (T,) that wheels and resistance predict from the start on [m/s]."""
        rate = along.true_wheel_acceleration(constants, stop.wheel_rate, stop.wheel_jerk)
        torque = p.torque_nm if stop.pressed is None else stop.torque
        force = ((torque + p.inertia_kgm2 * rate) / p.radius_m).sum(axis=1) + p.resistance_n
        result: np.ndarray = -(np.cumsum(force) - 0.5 * force) * stop.step_s / p.mass_kg
        return result

    def _believed(self, i: int) -> np.ndarray:
        """Return the same without mechanisms: what the estimated speed of a stop rests on."""
        bare = self._bare[i]
        if bare is None:
            stop, constants = self.stops[i], along.model(self.vehicle, {})
            belief = along.Belief(stop.believed_mu_cd, 0.0, stop.mass, self.vehicle.wheel_radius_m, stop.gradient)
            bare = self._bare[i] = self._predicted(stop, along.along(self._trajectories[i], belief, constants), constants)
        return bare
