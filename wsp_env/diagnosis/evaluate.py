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

    def __call__(self, model: Model) -> list[Evaluation]:
        """Return what the model says of every stop."""
        common = along.model(self.vehicle, model.choice)
        own = [at_stop(model.choice, stop.earlier) for stop in self.stops]
        each = [common if one is model.choice else along.model(self.vehicle, one) for one in own]
        return [self._one(i, constants, model) for i, constants in enumerate(each)]

    def _one(self, i: int, constants: Any, model: Model) -> Evaluation:
        stop = self.stops[i]
        belief = along.Belief(model.mu_cd[i], model.tau, stop.mass, self.vehicle.wheel_radius_m, stop.gradient)
        p = along.along(self._trajectories[i], belief, constants)
        shift = p.speed_mps - stop.speed
        if shift.any():  # the estimated speed follows a change of the recorded one only as far as it is slow
            held = stop.speed + stop.estimator(stop.time, shift) - shift
            p = along.along(dataclasses.replace(self._trajectories[i], speed_mps=held), belief, constants)
        rate = along.true_wheel_acceleration(constants, stop.wheel_rate, stop.wheel_jerk)
        torque = p.torque_nm if stop.pressed is None else stop.torque
        return Evaluation(
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
