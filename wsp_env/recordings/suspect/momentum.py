"""What the loss of momentum says of one axle's torque: when it changes, the vehicle's speed must follow by as much.

m (v(0) - v) = the integral of the sum of (C + J dw/dt) / r over all axles, and of forces that no torque holds: even, or as v^2.
The torques of an axle under a WSP come and go in their own time, so that its gain can be told from that of all others.
"""

import numpy as np

from wsp_env.parameters.campaign_vehicle import CampaignVehicle
from wsp_env.recordings.recording import Recording

_MASS = 0.03  # relative deviation of the mass, and of the gain that all torques share: assumption
_FREE = 1e3  # prior deviation of what is not known at all, beside the momentum that the vehicle loses
_LEAST_SAMPLES = 200
_LEAST_NOISE2 = 1e-10  # of a speed without any noise [m2/s2]: a simulation's last digits


def axle_gain(run: Recording, vehicle: CampaignVehicle, axle: int) -> tuple[float, float]:
    """Return true over recorded torque of an axle (from 0) with its deviation, by the vehicle's speed; nan for too few samples.

    Parameters
    ----------
    run : with samples at even steps, of which the noise of the vehicle's speed is taken from what is left

    """
    time, speed = run.time_s, run.vehicle_speed_mps
    if len(time) < _LEAST_SAMPLES:
        return np.nan, np.nan
    radius, step = vehicle.wheel_radius_m, float(time[-1] - time[0]) / (len(time) - 1)

    def impulse(force: np.ndarray) -> np.ndarray:
        """Integrate a force (T,) over time [m/s of the vehicle]."""
        total = np.concatenate([[0.0], np.cumsum(0.5 * (force[1:] + force[:-1])) * step])
        return np.asarray(total / run.mass_kg)

    braked = np.column_stack([impulse(run.brake_torque_nm[:, k] / radius) for k in range(vehicle.axles)])
    a, b, c = vehicle.resistance_n
    known = impulse(run.mass_kg * vehicle.gravity_mps2 * run.gradient + a + b * speed + c * speed**2)
    turned = (run.wheel_speed_radps - run.wheel_speed_radps[0]).sum(axis=1)
    spun = vehicle.wheelset_inertia_kgm2 / (run.mass_kg * radius) * turned
    y = speed[0] - speed - known - spun - braked.sum(axis=1)
    # the axle's torque first, then what all share, the speed at the start, an even force, one as the speed squared
    columns = np.column_stack([braked[:, axle], braked.sum(axis=1), np.ones_like(time), time - time[0], impulse(speed**2)])
    prior = np.array([_FREE, _MASS, *(_FREE * np.ptp(speed) / np.maximum(np.abs(columns[:, 2:]).max(axis=0), 1e-12))])

    def solved(noise2: float) -> tuple[np.ndarray, np.ndarray]:
        covariance = np.linalg.inv(columns.T @ columns / noise2 + np.diag(prior**-2.0))
        return covariance @ (columns.T @ y) / noise2, covariance

    left = y - columns @ solved(max(float(np.var(np.diff(y))) / 2.0, _LEAST_NOISE2))[0]
    found, covariance = solved(max(float(left @ left) / len(left) * _together(left), _LEAST_NOISE2))
    return 1.0 + float(found[0]), float(np.sqrt(covariance[0, 0]))


def _together(left: np.ndarray) -> float:
    """Return how many neighbouring samples of a residual (T,) count as one, by its correlation up to the first zero."""
    count = len(left)
    spectrum = np.fft.rfft(left, 2 * count)
    correlation = np.fft.irfft(np.abs(spectrum) ** 2)[: count // 2]
    correlation /= max(correlation[0], 1e-300)
    until = int(np.argmax(correlation < 0.0)) or len(correlation)
    return float(max(2.0 * correlation[:until].sum() - 1.0, 1.0))
