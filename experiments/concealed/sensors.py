"""From the truth to the recorded channels: sampling, faults, noise and quanta."""

import numpy as np

from experiments.concealed.records import History
from experiments.concealed.setup import Setup
from experiments.concealed.truth import STEP_S

SAMPLE_S = 0.01
#: Deviation of the white noise of a sample, estimated by third differences from recordings of such campaigns.
DEVIATION = {"vehicle_speed": 0.03, "wheel_speed": 0.025, "torque": 40.0}  # [m/s], [rad/s], [N m]
QUANTUM = {"vehicle_speed": 0.001, "wheel_speed": 0.004, "torque": 0.1}


def record(history: History, setup: Setup, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Return the columns of one run's table, 10 ms apart."""
    sensors = setup.sensors
    every = round(SAMPLE_S / STEP_S)
    steps = np.arange(len(history.speed))
    samples = steps[::every]
    # The vehicle's recorder has its own clock: what it stamps t happened at t + clock_s.
    shift = sensors.clock_s / STEP_S
    speed = np.interp(samples + shift, steps, history.speed)
    if sensors.pitch_s2pm:
        speed = speed * (1.0 + sensors.pitch_s2pm * np.interp(samples + shift, steps, _deceleration(history.speed)))
    torque = (history.torque if setup.measured_torque else history.nominal)[::every].copy()
    time = samples * STEP_S
    torque[:, sensors.drift_axle] += sensors.drift_nmps * time
    wheel = _averaged(history.wheel, sensors.lag_s)[::every]
    columns = {"time_s": np.round(time, 4), "vehicle_speed_mps": _noisy(speed, "vehicle_speed", sensors.noise, rng)}
    for k in range(setup.axles):
        columns[f"axle{k + 1}_wheel_speed_radps"] = _noisy(wheel[:, k], "wheel_speed", sensors.noise, rng)
        columns[f"axle{k + 1}_brake_torque_nm"] = _noisy(torque[:, k], "torque", sensors.noise, rng)
    return columns


def _noisy(values: np.ndarray, channel: str, noise: float, rng: np.random.Generator) -> np.ndarray:
    quantum = QUANTUM[channel]
    disturbed = values + noise * DEVIATION[channel] * rng.standard_normal(len(values))
    rounded: np.ndarray = np.round(np.round(disturbed / quantum) * quantum, 6)
    return rounded


def _deceleration(speed: np.ndarray) -> np.ndarray:
    """Mean deceleration [m/s2] over the last 0.2 s: a body pitches no faster."""
    window = round(0.2 / STEP_S)
    earlier = np.concatenate([np.full(window, speed[0]), speed])[: len(speed)]
    return (earlier - speed) / (window * STEP_S)


def _averaged(wheel: np.ndarray, lag_s: float) -> np.ndarray:
    """Mean over the last 2 lag_s: a sensor that counts pulses in a window is late by half of it."""
    window = 2.0 * lag_s / STEP_S
    if window <= 0.0:
        return wheel
    steps = np.arange(len(wheel), dtype=float)
    padded = np.concatenate([[0.0], steps + 1.0])
    late = np.empty_like(wheel)
    for k in range(wheel.shape[1]):
        total = np.concatenate([[0.0], np.cumsum(wheel[:, k])])
        begin = steps + 1.0 - window  # before the recording starts the wheel rolls as at its start
        before = np.minimum(begin, 0.0) * wheel[0, k]
        late[:, k] = (total[1:] - np.interp(begin, padded, total) - before) / window
    return late
