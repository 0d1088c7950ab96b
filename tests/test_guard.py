"""The observer that doubts: faults of sensors, radii, axles that are not watched, the end of a stop."""

import dataclasses

import numpy as np
import pytest

from agents.measure import low_adhesion
from wsp_env.evaluation.bound import ceiling
from wsp_env.evaluation.controller import load
from wsp_env.evaluation.faults import Faults
from wsp_env.evaluation.figures import figures
from wsp_env.evaluation.runner import run
from wsp_env.observer import estimate, estimator, running_speed
from wsp_env.observer.doubts import DEAD_S, DISOBEYS_S, FROZEN_S, USUAL_NOISE
from wsp_env.observer.guard import Guard
from wsp_env.observer.observation import Observer
from wsp_env.observer.overrule import CALM_S, END_CREEPAGE, LONG_RELEASE_S, RELEASE_S
from wsp_env.parameters.uic_z1 import BOGIE, COACH, WHEELSET
from wsp_env.plant.port import Measurement

INTERVAL_S = 0.02


class Stop:
    """A vehicle with the brake that the observer believes in, its wheels rolling but for what a test changes."""

    def __init__(self, vehicle=BOGIE, speed=30.0, noise=0.05, radius=None):
        self.vehicle, self.speed, self.noise, self.time = vehicle, speed, noise, 0.0
        self.radius = np.full(vehicle.axles, vehicle.wheel_radius_m) if radius is None else np.array(radius)
        self.gain = 1.0  # of the true brakes over the believed ones
        self.pressure, self.distributor = np.zeros(vehicle.axles), 0.0  # of the true brakes, shares of full pressure
        self.coming = [np.ones(vehicle.axles)] * (round(vehicle.brake.dead_time_s / INTERVAL_S) + 1)
        self.rng = np.random.default_rng(1)
        self.observer, self.nominal = Observer(vehicle, INTERVAL_S), estimate.constants(vehicle, INTERVAL_S, False)
        self.guard = Guard(vehicle, self.observer, 1)
        self.command = np.ones((1, vehicle.axles))
        self.guard.begin(self.measure(lambda wheel: wheel))

    def measure(self, change):
        wheel = self.speed / self.radius + self.noise * self.rng.normal(size=len(self.radius))
        return Measurement(np.array([self.time]), change(wheel)[None], np.ones(1))

    def braked(self):
        """Let the nominal brake follow the commands for an interval; return the cylinder pressures."""
        self.coming = [self.command[0].copy(), *self.coming[:-1]]
        self.distributor = min(self.distributor + self.nominal.rise, 1.0)
        acts = self.coming[-1]
        target = np.where(acts > 0.5, self.distributor, np.where(acts < -0.5, 0.0, self.pressure))
        gain = np.where(target > self.pressure, self.nominal.fill, self.nominal.vent)
        self.pressure = self.pressure + gain * (target - self.pressure)
        return self.pressure

    def go_on(self, seconds, change=lambda wheel: wheel, wanted=1.0):
        """Brake on; return for how long an axle was reported first [s], nan if none was."""
        first = np.nan
        for step in range(round(seconds / INTERVAL_S)):
            self.time += INTERVAL_S
            force = self.gain * self.nominal.full_force * self.braked().sum()
            rotating = self.vehicle.axles * self.nominal.rotating
            self.speed = max(self.speed - force / (self.nominal.mass + rotating) * INTERVAL_S, 0.0)
            self.guard.observe(self.measure(change), self.command)
            self.command = self.guard.overrule(np.full_like(self.command, wanted))
            if np.isnan(first) and self.guard.failed.any():
                first = (step + 1) * INTERVAL_S
        return first


def frozen(stop):
    held = stop.speed / stop.radius[0]

    def change(wheel):
        return np.concatenate([[held], wheel[1:]])

    return change


FAULTS = {
    "lost": (lambda stop: lambda wheel: np.concatenate([[np.nan], wheel[1:]]), INTERVAL_S),
    "zero": (lambda stop: lambda wheel: wheel * (np.arange(len(wheel)) > 0), INTERVAL_S),
    "frozen": (frozen, FROZEN_S + 2 * INTERVAL_S),
    "noisy": (lambda stop: lambda wheel: wheel + 4.0 * (np.arange(len(wheel)) == 0) * stop.rng.normal(), 1.0),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_faulty_sensor_is_found_in_time_and_left_out(name):
    make, soon = FAULTS[name]
    stop = Stop()
    assert np.isnan(stop.go_on(2.0))
    assert stop.go_on(2.0, make(stop)) <= soon
    assert stop.guard.failed.tolist() == [[True, False]]
    assert stop.observer.estimate.trusted.tolist() == [[False, True]]
    stop.go_on(10.0)  # it is sound again: not believed for the rest of the stop
    assert stop.guard.failed.tolist() == [[True, False]]
    assert abs(stop.observer.estimate.speed[0] - stop.speed) < 0.3


def test_a_sensor_that_freezes_moves_the_estimated_speed_by_nothing_that_the_brake_depends_on():
    stop = Stop()
    stop.go_on(4.0)
    stop.go_on(FROZEN_S + 3 * INTERVAL_S, frozen(stop))
    assert stop.guard.failed.tolist() == [[True, False]]
    estimate = stop.observer.estimate
    assert abs(estimate.speed[0] - stop.speed) < 0.1
    assert estimate.since_slide[0] == np.inf  # the sound wheel is not taken for one that slides
    assert (stop.command == 1.0).all()


def test_a_sensor_that_is_frozen_from_the_start_is_found_once_the_brake_acts():
    stop = Stop()  # its reading keeps the estimated speed up: the other wheel tells
    assert stop.go_on(3.0, frozen(stop)) < 2.0
    assert stop.guard.failed.tolist() == [[True, False]]
    stop.go_on(5.0)
    assert abs(stop.observer.estimate.speed[0] - stop.speed) < 0.5


def test_readings_that_repeat_while_the_vehicle_coasts_are_no_fault():
    stop = Stop(COACH, 40.0, noise=0.0, radius=COACH.wheel_radius_m * np.array([1.0, 0.97, 1.0, 1.0]))
    for _ in range(100):  # without demand, drag and noise every reading is the one before
        stop.time += INTERVAL_S
        stop.guard.observe(stop.measure(lambda wheel: wheel)._replace(demand=np.zeros(1)), stop.command)
    assert not stop.guard.failed.any()
    assert abs(stop.observer.estimate.speed[0] - stop.speed) < 0.5


def test_a_sensor_that_was_never_there_is_found_at_the_start():
    stop = Stop()
    stop.guard.begin(stop.measure(lambda wheel: np.array([0.0, wheel[1]])))
    assert stop.guard.failed.tolist() == [[True, False]]


@pytest.mark.parametrize("noise", [0.0, 0.1, 0.3])
def test_sound_sensors_are_believed_down_to_standstill(noise):
    stop = Stop(COACH, 12.0, noise)
    if noise == 0.0:  # as a pulse wheel reads: no two readings of a moving wheel are quite the same
        stop.noise = 1e-6
    assert np.isnan(stop.go_on(24.0))


def falling(stop, rate):
    """Return what a wheel shows that slows by `rate` [m/s2] by itself."""
    wheel = {"speed": stop.speed}

    def change(speeds):
        wheel["speed"] = max(wheel["speed"] - rate * INTERVAL_S, 0.0)
        return np.array([wheel["speed"] / stop.radius[0], speeds[1]])

    return change


def test_a_wheel_that_stands_though_its_brake_is_empty_has_no_sensor():
    stop = Stop(speed=4.5)
    stop.go_on(0.5, wanted=-1.0)
    assert stop.go_on(3.0, falling(stop, 90.0), -1.0) > DEAD_S  # as no sensor that is lost
    assert stop.guard.standing.tolist() == [[True, False]]


def test_a_wheel_that_slows_by_more_than_its_brake_can_is_left_out_before_it_stands():
    stop = Stop()
    stop.go_on(4.0)
    assert DISOBEYS_S < stop.go_on(1.0, falling(stop, 12.0), -1.0) < 2.0 * DISOBEYS_S
    assert not stop.guard.standing.any()
    assert abs(stop.observer.estimate.speed[0] - stop.speed) < 0.3  # which it may have shown: the other wheel shows it now
    stop.go_on(2.0, falling(stop, 90.0), -1.0)
    assert stop.guard.standing.tolist() == [[True, False]]  # though it is not believed


def test_radii_are_learned_before_the_brake_acts():
    worn = np.array([1.0, 0.97, 1.0, 1.01]) * COACH.wheel_radius_m
    stop = Stop(COACH, 40.0, 0.05, worn)
    stop.go_on(2.0)
    found = stop.guard.radius[0]
    np.testing.assert_allclose(found / found.mean(), worn / worn.mean(), atol=4e-4)  # 0.05 rad/s in some 25 readings of 90
    assert np.ptp(stop.observer.estimate.wheel[0]) < 0.1  # as nominal wheels


def test_usual_readings_pass_as_they_are_and_noisy_ones_lose_noise():
    for noise, filtered in ((0.5 * USUAL_NOISE, False), (3.0 * USUAL_NOISE, True)):
        stop = Stop(noise=noise)
        stop.go_on(3.0)
        errors = []
        for _ in range(200):
            seen = {}
            stop.go_on(INTERVAL_S, lambda wheel, seen=seen: seen.setdefault("wheel", wheel))
            passed = stop.guard.doubts.clean[0] / stop.guard.doubts.ratio[0]
            if not filtered:
                np.testing.assert_array_equal(passed, seen["wheel"])
            errors.append(passed - stop.speed / stop.radius)
        assert np.std(errors) < (0.75 if filtered else 1.1) * noise


def slide(share):
    """Let the watched axle slide, at a share of the running speed."""
    return lambda wheel: np.array([np.nan, (1.0 - share) * wheel[1]])


def test_an_axle_that_is_not_watched_is_braked_fully_where_nothing_slides():
    stop = Stop()
    stop.go_on(4.0)
    stop.go_on(2.0, lambda wheel: np.array([np.nan, wheel[1]]))
    assert (stop.command == 1.0).all()


def test_an_axle_that_is_not_watched_is_braked_less_than_the_watched_ones_where_these_slide():
    stop = Stop()
    stop.go_on(5.0)
    stop.go_on(0.1, slide(0.03), -1.0)  # to more than half of what it used: below that it would seem to roll
    estimate = stop.observer.estimate
    for _ in range(150):
        estimate.speed_variance[0] = 0.01  # the running speed is certain: no axle is released to show it
        stop.go_on(INTERVAL_S, slide(0.03), 0.0)
    assert 0.0 < estimate.pressure[0, 0] < 0.8 * estimate.pressure[0, 1]
    assert stop.go_on(2.0 * CALM_S, lambda wheel: np.array([np.nan, wheel[1]]), 1.0)
    assert stop.command[0, 0] == 1.0  # nothing has slid for long


def test_an_axle_that_is_not_watched_is_not_braked_fully_beside_watched_ones_that_are_not():
    """A controller that holds its axle below the brake asked for does not slide: the rail may carry no more all the same."""
    stop = Stop()
    stop.go_on(5.0)
    stop.go_on(0.2, wanted=-1.0)
    stop.go_on(3.0 * CALM_S, lambda wheel: np.array([np.nan, wheel[1]]), 0.0)
    estimate = stop.observer.estimate
    assert estimate.since_slide[0] == np.inf
    assert 0.1 < estimate.pressure[0, 1] < 0.7
    assert 0.05 < estimate.pressure[0, 0] < 0.9 * estimate.pressure[0, 1]


def test_an_axle_that_is_not_watched_is_braked_fully_beside_one_that_holds_the_full_brake_while_it_slides():
    """Rail that sliding cleans: what carries the full brake there carries it here."""
    stop = Stop()
    stop.go_on(5.0)
    for _ in range(round(2.0 * CALM_S / INTERVAL_S)):
        stop.observer.estimate.speed_variance[0] = 0.01  # the running speed is certain: no axle is released to show it
        stop.go_on(INTERVAL_S, slide(0.03), 1.0)
    assert stop.observer.estimate.since_slide[0] == 0.0
    assert stop.command[0, 0] == 1.0
    stop.go_on(0.3, slide(0.03), -1.0)
    assert stop.command[0, 0] == -1.0
    stop.go_on(0.3, slide(0.03), 0.0)
    assert stop.command[0, 0] == -1.0  # vented first: it may have locked


def unwatched(wheel):
    return np.array([np.nan, wheel[1]])


@pytest.mark.parametrize(("gain", "borne"), [(0.8, True), (0.65, False)])
def test_a_watched_axle_vouches_for_another_only_while_the_vehicle_slows_as_brakes_within_tolerances_make_it(gain, borne):
    """It holds the full brake in both cases; where the vehicle slows by less, the other one must have slid."""
    stop = Stop()
    stop.gain = gain
    stop.go_on(9.0, unwatched)
    assert (stop.guard.doubts.full[0] == np.inf) == borne
    assert (stop.command[0, 0] == 1.0) == borne
    assert stop.command[0, 1] == 1.0


def test_an_axle_that_was_braked_fully_in_vain_is_for_so_much_longer_not_braked_so_again():
    stop = Stop()
    stop.go_on(6.0, unwatched)
    full = stop.guard.doubts.full
    full[0] = CALM_S + 2.0  # as after a release
    stop.gain = 0.4
    while full[0] > 0.0:
        assert stop.command[0, 0] == 1.0
        stop.go_on(INTERVAL_S, unwatched)
    assert -CALM_S - 4.0 < full[0] < -CALM_S - 2.0
    stop.gain = 1.0
    stop.go_on(CALM_S + 1.0, unwatched)
    assert full[0] < CALM_S
    stop.go_on(2.0 * CALM_S + 4.0, unwatched)
    assert stop.command[0, 0] == 1.0


@pytest.mark.parametrize(("loses", "vented"), [(0.0, RELEASE_S), (4.0, LONG_RELEASE_S)])
def test_an_axle_that_is_not_watched_is_released_for_longer_where_a_watched_wheel_has_slowed_as_no_vehicle_does(loses, vented):
    """That wheel slid; the other one may have slid further."""
    stop = Stop()
    stop.go_on(6.0, unwatched)
    begun = stop.time

    def slowed(wheel):
        return unwatched(wheel - loses * min(stop.time - begun, 0.5) / stop.radius)

    stop.go_on(0.5, slowed)
    for step in range(150):
        stop.go_on(INTERVAL_S, slowed, -1.0 if step < 10 else 0.0)
        released = stop.guard.doubts.blind[0, 0]
        if released > INTERVAL_S:  # since the full brake ended
            assert (stop.command[0, 0] == -1.0) == (released <= vented), step
        if released > vented:
            break
    assert released == pytest.approx(vented, abs=2 * INTERVAL_S)


def test_the_safety_timer_applies_an_axle_that_is_not_watched_whatever_its_brake_is_believed_to_hold():
    stop = Stop()
    stop.guard = Guard(BOGIE, stop.observer, 1, timer_s=3.0)
    stop.guard.begin(stop.measure(lambda wheel: wheel))
    stop.go_on(5.0)
    stop.go_on(0.2, wanted=-1.0)
    longest = unbraked = 0.0
    for _ in range(600):
        stop.go_on(INTERVAL_S, unwatched, 0.0)
        unbraked = 0.0 if stop.command[0, 0] > 0.0 else unbraked + INTERVAL_S
        longest = max(longest, unbraked)
    assert stop.observer.estimate.pressure_to_come[0, 0] > 0.1
    assert 2.0 < longest <= 3.0 + 2 * INTERVAL_S


@pytest.mark.parametrize("failed", [0, 1])
def test_the_last_watched_axle_shows_the_running_speed_that_is_in_doubt_whatever_is_wanted(failed):
    stop = Stop()
    stop.go_on(5.0)
    stop.guard.doubts.failed[0, failed] = True
    stop.observer.estimate.doubtful[0] = True
    stop.guard.overrule(command := np.ones((1, 2)))
    assert command[0, 1 - failed] == -1.0


def test_a_noisy_wheel_that_catches_up_with_the_vehicle_is_not_taken_for_one_that_rolls():
    """Let go from a slide of 4 m/s it needs a second; the running speed followed it down meanwhile."""
    stop = Stop(WHEELSET, 20.0, noise=0.0)
    stop.go_on(4.0)
    estimate, noise, wheel = stop.observer.estimate, 0.27 / np.sqrt(2.0), stop.speed - 4.0
    estimate.usual_adhesion[:] = estimate.adhesion[:] = 0.04
    estimate.rolling_adhesion[:], estimate.pressure[:], estimate.wheel[:] = 0.02, 0.1, wheel
    estimate.speed_variance[0], estimate.since_slide[0] = 0.1, 0.0
    for step in range(40):  # 0.04 of its load less the brake's 0.01 turns it faster
        wheel += 0.03 * stop.nominal.axle_weight / stop.nominal.rotating * INTERVAL_S
        seen = wheel / stop.radius + noise * stop.rng.normal(size=1)
        estimator.update(0, seen[None], -np.ones((1, 1)), 1.0, np.empty((0, 0)), estimate, stop.nominal)
        assert wheel > stop.speed or estimate.speed[0] > stop.speed - 1.0, step


def test_a_wheel_that_slides_on_steadily_is_not_taken_for_one_that_rolls_before_its_brake_is_empty():
    """A brake that holds more than it is believed to does so; what it would say is 5 m/s off.

    A brake that is believed to be empty, but for which no more than that is certain that it was full, may do so too.
    """
    stop = Stop(WHEELSET, 20.0, noise=0.0)
    stop.go_on(4.0)
    estimate, wheel, distributor = stop.observer.estimate, stop.speed - 5.0, stop.observer.estimate.distributor[0]
    estimate.usual_adhesion[:], estimate.adhesion[:], estimate.wheel[:] = 0.02, 0.013, wheel
    estimate.commands[:], estimate.since_slide[0], estimate.speed_variance[0] = 0.0, 0.0, 0.05
    for share, certain, believed in ((0.9, True, stop.speed), (0.4, False, stop.speed), (0.4, True, wheel)):
        estimate.pressure[:] = share * estimator.ROLLING_ADHESION / stop.nominal.full_brake
        estimate.most_pressure[:] = estimate.pressure if certain else distributor
        estimate.unseen[:] = 0.0
        for _ in range(5):
            seen = np.full((1, 1), wheel / stop.radius[0])
            estimator.update(0, seen, np.zeros((1, 1)), 1.0, np.empty((0, 0)), estimate, stop.nominal)
        assert abs(estimate.speed[0] - believed) < 0.5, (share, certain)
        assert estimate.doubtful[0] == (believed > wheel)


def test_the_mass_ratio_learns_from_a_wheel_that_shows_a_running_speed_which_was_in_doubt():
    """The forces took it astray: beside the speed they are in doubt, and go on being believed less than what is shown."""
    stop = Stop(WHEELSET, noise=0.0)
    stop.go_on(5.0)
    e, shown = stop.observer.estimate, stop.speed - 1.0
    e.speed_variance[0], e.covariance[0], e.mass_variance[0] = 0.05, -0.95 * np.sqrt(0.05) * 0.04, 0.04**2
    running_speed.correct(0, shown, estimator.ROLLING_DEVIATION_MPS, False, e)
    assert e.speed[0] > shown + 0.9
    assert np.sqrt(e.speed_variance[0]) == pytest.approx(e.speed[0] - shown)
    assert abs(e.covariance[0]) < np.sqrt(e.speed_variance[0] * e.mass_variance[0])
    assert e.mass_ratio[0] < 1.02
    running_speed.correct(0, shown, estimator.ROLLING_DEVIATION_MPS, True, e)
    assert abs(e.speed[0] - shown) < 0.05
    assert 1.1 < e.mass_ratio[0] <= running_speed.MASS_RANGE[1]


def test_the_axle_that_shows_the_running_speed_is_vented_until_its_brake_is_surely_empty():
    """The estimated one is empty sooner."""
    stop = Stop()
    stop.go_on(5.0)
    estimate, seconds = stop.observer.estimate, {}
    while "most_pressure" not in seconds:
        estimate.doubtful[0] = True
        stop.guard.overrule(command := np.ones((1, 2)))
        assert command[0, 1] == -1.0
        stop.command, stop.time = command, stop.time + INTERVAL_S
        stop.guard.observe(stop.measure(lambda wheel: wheel), command)
        for name in ("pressure", "most_pressure"):
            if stop.nominal.full_brake * getattr(estimate, name)[0, 1] < estimator.ROLLING_ADHESION:
                seconds.setdefault(name, stop.time)
    assert seconds["most_pressure"] > seconds["pressure"] + 0.1


@pytest.mark.parametrize(("uncertainty", "shown"), [(0.6, True), (0.2, False)])
def test_near_the_end_of_a_stop_an_axle_shows_a_running_speed_that_may_be_far_off(uncertainty, shown):
    stop = Stop(speed=8.0)
    while stop.speed > 4.0:
        stop.go_on(INTERVAL_S)
    estimate = stop.observer.estimate
    assert not estimate.doubtful[0]
    for since_slide in (0.0, np.inf):
        estimate.uncertainty[0], estimate.since_slide[0] = uncertainty, since_slide
        stop.guard.overrule(command := np.ones((1, 2)))
        assert command.tolist() == [[1.0, -1.0 if shown and since_slide == 0.0 else 1.0]]


@pytest.mark.parametrize(("speed", "vented"), [(2.0, True), (20.0, False)])
def test_a_wheel_that_would_lock_before_its_brake_is_empty_is_vented_in_time(speed, vented):
    """At a creepage of a tenth: the dead time and the emptying of the cylinder are left."""
    stop = Stop(speed=speed + 3.0, noise=0.0)
    while stop.speed > speed:
        stop.go_on(INTERVAL_S)
    fall, slower = falling(stop, 8.0), 0.0
    while slower < 0.1 * 2.0:
        stop.go_on(INTERVAL_S, fall)
        slower = stop.speed - stop.observer.estimate.wheel[0, 0]
    assert slower < END_CREEPAGE * stop.speed
    assert stop.command.tolist() == [[-1.0 if vented else 1.0, 1.0]]


def test_the_safety_timer_ends_where_the_wheel_that_it_brakes_slides():
    stop = Stop(speed=6.0, noise=0.0)
    while stop.speed > 4.0:
        stop.go_on(INTERVAL_S)
    stop.guard.doubts.rest[:] = 1.0
    stop.go_on(0.2, falling(stop, 8.0), 0.0)
    assert stop.command.tolist() == [[-1.0, 1.0]]
    assert stop.guard.doubts.rest[0, 0] == 0.0
    stop.observer.estimate.speed[0] *= 2.0  # if it is wrong, wheels that do not slow must be braked all the same
    stop.guard.overrule(command := np.zeros((1, 2)))
    assert command[0, 1] == 1.0


def test_at_the_end_of_a_stop_no_wheel_locks_beside_a_faster_one():
    stop = Stop(speed=4.0)
    while stop.speed > 1.9:
        stop.go_on(INTERVAL_S)
    stop.observer.estimate.speed[0] = 1.0  # it was lost
    stop.go_on(INTERVAL_S, lambda wheel: wheel * [1.0, 0.9 - END_CREEPAGE])
    assert stop.command.tolist() == [[1.0, -1.0]]


def test_when_the_stop_is_as_good_as_over_the_brake_is_applied_whatever_is_wanted():
    stop = Stop(speed=3.0)
    while stop.speed > 0.3:
        stop.go_on(INTERVAL_S)
    stop.go_on(INTERVAL_S, lambda wheel: wheel * [1.0, 0.0], 0.0)
    assert (stop.command == 1.0).all()


def test_a_valve_that_vents_no_more_locks_its_own_wheel_alone_and_is_reported():
    """The axle that cannot be vented seems to roll when it is released for the running speed, and pulls that down."""
    stops = low_adhesion(BOGIE, "classic", 4, 11)
    stuck = np.array([[5.0, np.inf], [np.inf, 5.0]] * 2)
    faults = dataclasses.replace(Faults.none(4, 2), applies_s=stuck)
    controller = load("adaptive")
    found = figures(run(controller, BOGIE, stops, faults=faults), ceiling(BOGIE, stops), faults.protected)
    assert found["locked_s"].max() < 0.4
    assert found["unreported_s"].max() < 3.0
    assert (controller.wheels.failed >= np.isfinite(stuck)).all()


def test_an_axle_that_slides_on_and_seems_to_roll_does_not_pull_the_running_speed_down():
    """Where sliding cleans the rail a wheel that cannot be vented slides on, hardly slowing, at a third of the speed."""
    stops = low_adhesion(COACH, "recovering", 4, 11)
    stuck = np.full((4, 4), np.inf)
    stuck[np.arange(4), np.arange(4)] = 5.0
    faults = dataclasses.replace(Faults.none(4, 4), applies_s=stuck)
    found = figures(run(load("adaptive"), COACH, stops, faults=faults), ceiling(COACH, stops), faults.protected)
    assert found["beyond_limit_s"].max() < 0.5  # 3.6 s before the running speed was asked


def test_the_rules_renew_the_running_speed_on_the_axle_whose_valve_obeys():
    """The one that stands has been vented longer, but will not roll."""
    stops = low_adhesion(BOGIE, "classic", 2, 11)
    faults = dataclasses.replace(Faults.none(2, 2), applies_s=np.array([[5.0, np.inf], [np.inf, 5.0]]))
    found = figures(run(load("rule-based"), BOGIE, stops, faults=faults), ceiling(BOGIE, stops), faults.protected)
    assert found["beyond_limit_s"].max() < 0.5
    assert found["locked_s"].max() == 0.0
