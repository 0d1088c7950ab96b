"""A recorded speed that wanders is found by the wheels that grip; noise, and what one axle alone shows, is not."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from synthetic_stops import SAMPLE_S, stops, write_campaign

from wsp_env.diagnosis.balances import Balances
from wsp_env.diagnosis.baseline import baseline
from wsp_env.diagnosis.stops import SLIP_MPS, prepare
from wsp_env.diagnosis.wander import beyond_motion, errors_of, wander, wandering
from wsp_env.recordings import read_campaign

RUNS, MEANS, AXLES = 6, 8, 4
HELD_OUT = [False] * 4 + [True] * 2


def errors(common, own, seed=0):
    """Return errors (M, A) of each run: one that all axles share, and the axles' own, of given standard deviations."""
    rng = np.random.default_rng(seed)
    return [common * rng.standard_normal((MEANS, 1)) + own * rng.standard_normal((MEANS, AXLES)) for _ in range(RUNS)]


def test_what_all_axles_share_is_the_vehicles_reading():
    drawn = errors(0.2, 0.01)
    found = wander(drawn, HELD_OUT)
    assert found.matters
    assert found.common > 0.95
    shared = np.array([one.mean(axis=1) for one in drawn])
    assert_allclose(found.of_runs, np.sqrt(np.mean(shared**2, axis=1)))
    assert found.size == pytest.approx(np.quantile(np.abs(shared), 0.95))
    assert found.multiple == pytest.approx(found.size / SLIP_MPS)
    assert 0.0 < found.held_out_gain < found.gain


@pytest.mark.parametrize("common", [0.0, 0.02])
def test_what_is_an_axles_own_is_not(common):
    """One wheel of another radius, and axles that err each for itself by much."""
    lame = [one + np.array([0.5, 0.0, 0.0, 0.0]) for one in errors(common, 0.01)]
    assert not wander(lame, HELD_OUT).matters
    assert not wander(errors(common, 0.5), HELD_OUT).matters


def test_what_is_too_small_to_matter_is_not():
    found = wander(errors(0.02, 0.001), HELD_OUT)
    assert found.common > 0.95
    assert not found.matters


def test_the_runs_held_out_decide():
    drawn = errors(0.6, 0.01)
    torn = [one if not held else errors(0.0, 0.1, seed=1)[0] for one, held in zip(drawn, HELD_OUT, strict=True)]
    assert wander(torn, [False] * RUNS).matters
    assert not wander(torn, HELD_OUT).matters


def test_a_mean_of_one_axle_says_nothing():
    drawn = [np.where(np.arange(AXLES) == 0, one, np.nan) for one in errors(0.5, 0.0)]
    found = wander(drawn, HELD_OUT)
    assert np.isnan(found.of_runs).all()
    assert (found.size, found.common, found.gain) == (0.0, 0.0, 0.0)
    assert not found.matters


def test_gaps_change_nothing_of_what_is_shared():
    drawn = errors(0.2, 0.0)
    gaps = [one.copy() for one in drawn]
    for one in gaps:
        one[::3, 1] = np.nan
    assert_allclose(wander(gaps, HELD_OUT).of_runs, wander(drawn, HELD_OUT).of_runs, rtol=1e-12)


def gripping(folder, error):
    """Return the replica of six stops whose wheels grip, and whose recorded speed errs by `error` (time, generator) [m/s]."""
    driven = stops(2e-4, (0.05, 0.06, 0.07) * 2, peak=0.003, noise=1.0, seeds=range(RUNS))
    made = {f"A{i}": one for i, one in enumerate(driven)}
    for i, columns in enumerate(driven):
        columns["vehicle_speed_mps"] += error(columns["time_s"], np.random.default_rng(i))
    names = list(made)
    campaign = read_campaign(write_campaign(folder, made, names[:4], names[4:]))
    return baseline(Balances(campaign, prepare(campaign)[0]))


def coloured(time, rng, deviation=0.045, correlation_s=0.5):
    """Return the noise of a receiver: an Ornstein-Uhlenbeck process, as of the coarsest sound one."""
    kept, steps = np.exp(-SAMPLE_S / correlation_s), rng.standard_normal(len(time))
    noise = np.zeros(len(time))
    for i in range(1, len(time)):
        noise[i] = kept * noise[i - 1] + deviation * np.sqrt(1.0 - kept**2) * steps[i]
    return noise


def drift(time, rng):
    """Return a random walk of 0.1 m/s per root second."""
    return 0.1 * np.sqrt(SAMPLE_S) * np.cumsum(rng.standard_normal(len(time)))


def late_and_scaled(time, rng):
    """Return the error of a clock that is 0.15 s late at 1 m/s2, and of a scale."""
    return 0.15 + 0.01 * (35.0 - time)


def test_a_receivers_noise_does_not_wander(tmp_path):
    assert wandering(gripping(tmp_path / "c", coloured)) is None


def test_what_repeats_in_every_stop_does_not_wander(tmp_path):
    errors, features = errors_of(gripping(tmp_path / "c", late_and_scaled))
    assert wander(errors, HELD_OUT).matters
    assert not wander(beyond_motion(errors, features), HELD_OUT).matters


def test_a_recorded_speed_that_wanders_is_found_with_its_size(tmp_path):
    replica = gripping(tmp_path / "c", drift)
    found = wandering(replica)
    assert found is not None
    assert found.term.slot == "sensor"
    means = [drift(np.zeros(1200), np.random.default_rng(i)).reshape(-1, 200).mean(axis=1) for i in range(RUNS)]
    true = [np.repeat(one[:, None], AXLES, axis=1) for one in means]
    size = found.term.parameters["wander"]
    shown = wander(beyond_motion(true, errors_of(replica)[1]), HELD_OUT).size
    assert 0.6 * shown < size.value < 1.05 * shown  # where the error is so large that wheels seem to slide, it is not seen
    assert size.interval90[0] < size.value < size.interval90[1]
    assert found.term.removed_validate > 0.9
    assert found.location.equation == "kinematics"
    assert 0 < len(found.location.runs) < RUNS


def test_of_few_means_nothing_is_said(tmp_path):
    errors, features = errors_of(gripping(tmp_path / "c", drift))
    assert np.isnan(np.concatenate(beyond_motion(errors[:3], features[:3]))).all()
