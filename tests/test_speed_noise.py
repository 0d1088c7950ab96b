"""The vehicle's speed, estimated from a recorded one with coloured noise."""

import numpy as np
import pytest
from synthetic_stops import SAMPLE_S, stops, write_campaign

from wsp_env.diagnosis.speed import SpeedNoise, estimate, estimate_noise
from wsp_env.diagnosis.stops import LEAST_SPEED_MPS, prepare
from wsp_env.recordings import read_campaign


def made(noise: SpeedNoise, seed: int, n: int = 150) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng, time = np.random.default_rng(seed), 0.2 * np.arange(n)
    course = rng.multivariate_normal(np.zeros(n), noise.course(time, time), method="eigh") + 3.0 - 0.05 * time
    return time, course, course + rng.multivariate_normal(np.zeros(n), noise.covariance(time))


def test_coloured_noise_of_a_recorded_speed_is_recognised():
    true = SpeedNoise(0.004, 0.035, 0.6, 0.001)
    found = estimate_noise([made(true, seed)[::2] for seed in range(8)])
    assert found.coloured == pytest.approx(true.coloured, rel=0.25)
    assert found.correlation_s == pytest.approx(true.correlation_s, rel=0.5)


def test_the_estimated_speed_is_as_uncertain_as_it_says():
    noise = SpeedNoise(0.004, 0.035, 0.6, 0.001)
    errors, said = [], []
    for seed in range(40):
        time, course, recorded = made(noise, seed)
        one = estimate(noise, time, recorded)
        errors.append(np.mean((one.course - course) ** 2))
        said.append(np.mean((one.modes**2).sum(axis=1)))
        assert one.gain @ recorded == pytest.approx(one.course)
        every = estimate(noise, time, recorded, 0.0).modes
        assert (one.modes**2).sum() > 0.99 * (every**2).sum()  # what is left out of its directions is next to nothing
    assert np.mean(errors) == pytest.approx(np.mean(said), rel=0.35)
    assert np.sqrt(np.mean(errors)) < 0.6 * noise.coloured


def test_a_straight_course_is_kept():
    time = 0.2 * np.arange(80)
    one = estimate(SpeedNoise(0.01, 0.02, 0.5, 0.002), time, 4.0 - 0.3 * time)
    assert one.course == pytest.approx(4.0 - 0.3 * time, abs=1e-8)


def test_a_vehicle_that_stands_at_the_end_tells_nothing_of_its_speeds_noise(tmp_path):
    """The brake still presses, nothing moves: the wheels' balances predict a deceleration of the vehicle that stands."""
    found, rng = [], np.random.default_rng(1)
    for stands in (False, True):
        every = stops(2e-4, (0.10, 0.11), speed_mps=14.0, noise=1.0, seeds=(1, 2))
        for one in every:
            end = int(np.flatnonzero(one["vehicle_speed_mps"] > LEAST_SPEED_MPS)[-1]) + 1
            fades = np.maximum(1.0 - SAMPLE_S * np.arange(1, 601) / 3.0, 0.0) if stands else np.zeros(0)
            for name, values in one.items():
                further = fades if "speed" in name else 1.0 + 0.01 * rng.standard_normal(len(fades))
                one[name] = np.append(values[:end], values[end - 1] * further)
            one["time_s"] = SAMPLE_S * np.arange(end + len(fades))
        folder = tmp_path / str(stands)
        write_campaign(folder, {"A1": every[0], "B1": every[1]}, ["A1"], ["B1"])
        found.append(prepare(read_campaign(folder))[0])
    for moving, standing in zip(*found, strict=True):
        assert standing.noise.speed == pytest.approx(moving.noise.speed, rel=0.05)
        both = slice(0, len(moving.speed) - 50)  # filters reach over the end of the shorter recording
        assert standing.speed[both] == pytest.approx(moving.speed[both], abs=0.01)
