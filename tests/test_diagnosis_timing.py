"""When the axles' channels were read, and friction along the track in one run: both are found in the recordings."""

import dataclasses

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from synthetic_stops import AXLES, SAMPLE_S, stops, write_campaign

from wsp_env.diagnosis.balances import Balances
from wsp_env.diagnosis.covariance import Evidence
from wsp_env.diagnosis.evaluate import Model
from wsp_env.diagnosis.replica import Replica
from wsp_env.diagnosis.stops import prepare
from wsp_env.diagnosis.timing import Times, aligned, times
from wsp_env.diagnosis.variation import nuisances
from wsp_env.recordings import Campaign, read_campaign

LAW = Model(2e-4, (0.06, 0.07))
LATE = 0.6 * SAMPLE_S  # [s] of the last axle's wheel speed


def campaign_of(folder, noise: float) -> Campaign:
    a, b = stops(LAW.tau, LAW.mu_cd, seeds=(1, 2), noise=noise)
    write_campaign(folder, {"A1": a, "B1": b}, ["A1"], ["B1"])
    return read_campaign(folder)


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> Campaign:
    return campaign_of(tmp_path_factory.mktemp("sound") / "c", noise=1.0)


def replica_of(campaign: Campaign) -> Replica:
    return Replica(Balances(campaign, prepare(campaign)[0]), LAW)


def late(campaign: Campaign, seconds: float) -> Campaign:
    """Return the campaign with the last axle's wheel speed read later than everything else."""
    runs = {}
    for name, run in campaign.runs.items():
        wheel = run.wheel_speed_radps.copy()
        at = np.clip(run.time_s - seconds, run.time_s[0], run.time_s[-1])
        wheel[:, -1] = CubicSpline(run.time_s, wheel[:, -1])(at)
        runs[name] = dataclasses.replace(run, wheel_speed_radps=wheel)
    return dataclasses.replace(campaign, runs=runs)


def test_an_axle_read_late_is_found_and_moved_back(sound):
    shifted = late(sound, LATE)
    before, after = times(replica_of(sound)), times(replica_of(shifted))
    assert after.matters
    # How much earlier than its brake's torque, against the axles' mean: late is negative. A torque that was read early does
    # the same to a wheel's balance, so that both have a part in it.
    change = (after.wheel - before.wheel) - (after.torque - before.torque)
    assert change[-1] - change[0] == pytest.approx(-LATE, abs=0.15 * SAMPLE_S)


def test_channels_are_moved_back_by_what_is_found(tmp_path):
    """What is smooth comes back whole: a wheel speed that was read late, by the same time."""
    smooth = campaign_of(tmp_path / "c", noise=0.0)
    known = Times(np.array([0.0] * (AXLES - 1) + [-LATE]), np.zeros(AXLES), True)
    back = aligned(late(smooth, LATE), known)
    for name, run in smooth.runs.items():
        inner = slice(20, -20)
        wrong = np.abs(late(smooth, LATE).runs[name].wheel_speed_radps - run.wheel_speed_radps)[inner].max()
        assert np.abs(back.runs[name].wheel_speed_radps - run.wheel_speed_radps)[inner].max() < 0.05 * wrong
        assert back.runs[name].brake_torque_nm[inner] == pytest.approx(run.brake_torque_nm[inner], abs=1e-6)


def test_what_all_axles_share_is_not_moved(sound):
    """The mean over the axles of what is moved is nothing: the vehicle's speed says it too badly."""
    found = times(replica_of(late(sound, LATE)))
    assert found.wheel.shape == found.torque.shape == (AXLES,)
    assert float(found.wheel.mean()) == pytest.approx(0.0, abs=1e-3 * SAMPLE_S)


def test_friction_that_a_run_has_for_itself_is_learned_as_such(sound):
    """Friction along the track, in one run alone: the size of its group grows, that of what the runs share does not."""
    replica = replica_of(sound)
    whitening, base = replica.whitening(LAW), replica.raw(LAW)
    groups = nuisances(replica, LAW, base, whitening)
    one = next(group for group in groups if group.name == "track of a run")
    draw = np.random.default_rng(4).normal(0.0, 0.05, one.columns.shape[1])
    sizes = {}
    for name, rows in (("as it is", base), ("of a run", base + one.columns @ draw)):
        found = Evidence(replica, whitening, groups, rows, np.zeros((len(base), 0))).solve()
        sizes[name] = dict(zip((group.name for group in groups), found.groups, strict=True))
    assert sizes["of a run"]["track of a run"] * one.expected == pytest.approx(0.05, rel=0.3)
    assert sizes["as it is"]["track of a run"] < 0.3 * sizes["of a run"]["track of a run"]
