"""Recorded stops simulated with the recorded brake torque: what the law is worth in the vehicle's dynamics.

Over windows of a second, each started from the recorded speeds: the controller that kept the recorded slide stable
answered to the recorded speeds and not to the simulated, so that longer simulations may part from the recording however
good the law is. Over the whole stop what the vehicle does as a whole, and statistics of the slide, are compared.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from wsp_env.parameters.campaign_vehicle import plant_vehicle
from wsp_env.parameters.resistance import Resistance, running_resistance
from wsp_env.parameters.vehicle import Brake, Vehicle
from wsp_env.plant import make_plant
from wsp_env.plant.port import Plant, Setup, Stop
from wsp_env.recordings.campaign import Campaign
from wsp_env.recordings.derive import Derived, Smoothing
from wsp_env.recordings.recording import Recording

#: Length [s] of the windows.
WINDOW_S = 1.0

_AT_ONCE_S = 1e-6  # time constants of a brake that follows its command
_PRESSURE_BAR = 10.0  # stands for the largest recorded torque


class Piece(NamedTuple):
    """A part of a recorded stop, from a sample on, with a law and mechanisms; see `simulate`."""

    run: Recording
    derived: Derived
    start: int
    mu_cd: float
    tau: float
    mechanisms: Mapping[str, Mapping[str, float]]


@dataclasses.dataclass(frozen=True)
class Simulated:
    """Speeds of N simulated pieces of a stop, each of T samples."""

    speed_mps: np.ndarray  # (N, T) of the vehicle
    circumferential_mps: np.ndarray  # (N, T, axles) r w

    def piece(self, index: int, samples: int) -> "Simulated":
        """Return the first samples of one piece alone."""
        return Simulated(self.speed_mps[index : index + 1, :samples], self.circumferential_mps[index : index + 1, :samples])


@dataclasses.dataclass(frozen=True)
class Slide:
    """Eqs. (19) to (21) over one stop."""

    speed_error_mps: float  # E, largest difference between recorded and simulated speed of the vehicle
    recorded_mean_mps: tuple[float, ...]  # per axle
    recorded_deviation_mps: tuple[float, ...]
    simulated_mean_mps: tuple[float, ...]
    simulated_deviation_mps: tuple[float, ...]


def simulate(
    campaign: Campaign,
    run: Recording,
    derived: Derived,
    radii_m: np.ndarray,
    starts: np.ndarray,
    samples: int,
    mu_cd: float,
    tau: float,
    mechanisms: Mapping[str, Mapping[str, float]] | None = None,
) -> Simulated:
    """Simulate N pieces of a stop with the recorded torque.

    Parameters
    ----------
    derived, radii_m : the stop's `Derived` and the radii (axles,) it was derived with: the pieces start from its speeds
    starts : samples (N,) at which they start
    samples : length T of each, the start included
    mu_cd, tau : of the law [-], [m/J]; tau = 0 is the classic law
    mechanisms : physics beyond the law, see `wsp_env.plant.mechanisms.make`

    """
    pieces = [Piece(run, derived, int(start), mu_cd, tau, mechanisms or {}) for start in starts]
    return simulate_pieces(campaign, pieces, radii_m, samples)


def simulate_pieces(campaign: Campaign, pieces: Sequence[Piece], radii_m: np.ndarray, samples: int) -> Simulated:
    """Simulate N pieces with the recorded torque, in one batch; parameters as for `simulate`.

    Beyond its end a recording's torque stays as it was last.
    """
    largest = max(float(np.abs(one.run.brake_torque_nm).max()) for one in pieces) or 1.0
    setup = Setup(campaign.sample_time_s, pressure_control=True)
    plant = make_plant(_vehicle(campaign, largest), len(pieces), setup)
    asked = np.empty((samples, len(pieces), campaign.vehicle.axles))
    for index, one in enumerate(pieces):
        share = one.run.brake_torque_nm / largest
        at = np.minimum(one.start + np.arange(samples), len(share) - 2)
        asked[:, index] = 0.5 * (share[at] + share[at + 1])
        _start(plant, index, one, radii_m, share[one.start])
    speed = np.empty((len(pieces), samples))
    wheel = np.empty((len(pieces), samples, campaign.vehicle.axles))
    for step in range(samples):
        truth = plant.truth()
        speed[:, step], wheel[:, step] = truth.speed, radii_m * truth.wheel_speed
        plant.step(asked[step])
    return Simulated(speed, wheel)


def without_slip(
    campaign: Campaign, run: Recording, derived: Derived, radii_m: np.ndarray, starts: np.ndarray, n: int
) -> Simulated:
    """Simulate as `simulate` does, with wheels that roll however hard they are braked: M dv/dt = -sum C / r."""
    vehicle = campaign.vehicle
    mass = run.mass_kg + (vehicle.wheelset_inertia_kgm2 / radii_m**2).sum()
    resistance = Resistance(*vehicle.resistance_n)
    brakes = (run.brake_torque_nm / radii_m).sum(axis=1) + run.mass_kg * vehicle.gravity_mps2 * run.gradient
    speed = np.empty((len(starts), n))
    speed[:, 0] = derived.speed_mps[starts]
    for step in range(n - 1):
        v = speed[:, step]
        at = np.minimum(starts + step, len(brakes) - 2)
        force = 0.5 * (brakes[at] + brakes[at + 1]) + running_resistance(v, resistance)
        speed[:, step + 1] = np.maximum(v - campaign.sample_time_s * force / mass, 0.0)
    return Simulated(speed, np.repeat(speed[:, :, None], vehicle.axles, axis=2))


def windows(derived: Derived, sample_time_s: float, smoothing: Smoothing) -> tuple[np.ndarray, int]:
    """Return the starts (N,) of the stop's windows and their length in samples: fast enough throughout."""
    samples = max(round(WINDOW_S / sample_time_s), 2)
    fast = derived.speed_mps > smoothing.least_speed_mps
    starts = np.arange(0, len(fast) - samples, samples)
    return starts[[bool(fast[start : start + samples].all()) for start in starts]], samples


def window_error(derived: Derived, simulated: Simulated, starts: np.ndarray) -> float:
    """Return the root mean square [m/s] of simulated minus recorded r w over all windows and axles."""
    n = simulated.speed_mps.shape[1]
    at = starts[:, None] + np.arange(n)
    recorded = derived.speed_mps[at][:, :, None] - derived.slip_speed_mps[at]
    return float(np.sqrt(np.mean((simulated.circumferential_mps - recorded) ** 2)))


def slide(derived: Derived, simulated: Simulated, start: int) -> Slide:
    """Compare one whole stop from sample `start` on by eqs. (19) to (21); `simulated` holds that piece alone."""
    n = simulated.speed_mps.shape[1]
    part = slice(start, start + n)
    recorded = derived.slip_speed_mps[part]
    computed = simulated.speed_mps[0][:, None] - simulated.circumferential_mps[0]
    return Slide(
        speed_error_mps=float(np.abs(derived.speed_mps[part] - simulated.speed_mps[0]).max()),
        recorded_mean_mps=tuple(map(float, recorded.mean(axis=0))),
        recorded_deviation_mps=tuple(map(float, recorded.std(axis=0))),
        simulated_mean_mps=tuple(map(float, computed.mean(axis=0))),
        simulated_deviation_mps=tuple(map(float, computed.std(axis=0))),
    )


def _vehicle(campaign: Campaign, largest_nm: float) -> Vehicle:
    """Return the campaign's vehicle with a brake whose torque is what is asked for, at once."""
    brake = Brake(
        full_pressure_bar=_PRESSURE_BAR,
        torque_per_bar_nm=largest_nm / _PRESSURE_BAR,
        demand_rise_s=_AT_ONCE_S,
        fill_time_constant_s=_AT_ONCE_S,
        vent_time_constant_s=_AT_ONCE_S,
        dead_time_s=0.0,
    )
    return plant_vehicle(campaign.vehicle, campaign.contact, campaign.name, brake=brake)


def _start(plant: Plant, index: int, one: Piece, radii_m: np.ndarray, torque: np.ndarray) -> None:
    nodes, run = np.ones(1), one.run
    speed = float(one.derived.speed_mps[one.start])
    begun = Stop(one.mu_cd, one.tau, speed, run.mass_kg, 1.0, run.gradient, 0.0, 0, radii_m, profile=nodes, coverage=nodes)
    plant.start(index, begun, one.mechanisms)
    wheel = np.maximum((speed - one.derived.slip_speed_mps[one.start]) / radii_m, 0.0)
    plant.set_state(index, wheel, torque * _PRESSURE_BAR)
