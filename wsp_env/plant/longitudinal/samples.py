"""The compiled loop of `wsp_env.plant.longitudinal.along`: sample after sample of each stop, many contacts at once."""

from typing import Any, NamedTuple

import numpy as np

from wsp_env.compiled import inlined, loop
from wsp_env.contact.port import tractions
from wsp_env.contact.traction import Adhesion
from wsp_env.parameters.resistance import running_resistance
from wsp_env.plant.card import LOCKED_MPS, Doing, Moment, Passage, doing_at, note_doing
from wsp_env.plant.longitudinal.state import PlantConstants
from wsp_env.plant.mechanisms import Active
from wsp_env.plant.slots import (
    after_contact,
    after_passage,
    at_speed,
    before_contact,
    changed_contact,
    reading_factor,
    recovery,
    resistance,
    surface,
    torque,
    torque_factor,
    true_speed,
    wheel_load,
    wheel_speed,
)


class Columns(NamedTuple):
    """The arrays of `Trajectory`, as the compiled loop takes them."""

    time: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    position: np.ndarray
    wheel: np.ndarray
    wheel_acceleration: np.ndarray
    torque: np.ndarray


class Given(NamedTuple):
    """What is given, as the compiled loop takes it; S stops."""

    measured: Columns
    first: np.ndarray  # (S + 1,) the sample at which each stop begins, and the end
    mean: np.ndarray  # (S,) time over which its values are means [s]
    mu_cd: np.ndarray  # (T, A)
    tau: float
    mass: np.ndarray  # (S,)
    gradient: np.ndarray  # (S,)
    radius: np.ndarray  # (A,)
    inertia: np.ndarray  # (A,)
    constants: PlantConstants
    law: Any
    active: Active
    told: bool  # whether a mechanism is told of passages
    asked: bool  # whether one asks what axles do before their contacts are evaluated
    noted: bool  # whether that must be kept


class Found(NamedTuple):
    """What the compiled loop fills, and what it works with."""

    per_axle: np.ndarray  # (7, T, A) the first fields of `Prediction`
    per_vehicle: np.ndarray  # (2, T) the next ones
    kept: np.ndarray  # (KEPT, S, A), see below
    doings: np.ndarray  # (fields of `Doing`, S or T, A)
    met: np.ndarray  # (8, contacts at once and spare), as `tractions` takes them
    adhesion: np.ndarray  # (fields of `Adhesion`, the same), and returns them


# Rows of the scratch array `kept` (KEPT, S, A): at the last sample the friction power of one wheel and the braking power of
# the axle [W] and the slip speed [m/s]; so far the heat in both contacts [J] and the angle turned [rad]; the wheels' speed now
# [rad/s].
_FRICTION, _BRAKING, _SLID, _WORK, _ANGLE, _WHEEL, KEPT = range(7)

AT_ONCE = 32  # samples; so that what is passed from loop to loop stays in the fastest cache
SPARE = 7  # contacts, as a compiler that works on eight at once may take them


@inlined
def _held_back(j: int, i: int, k: int, given: Given) -> tuple[float, float]:
    """Return T [N] and J dw/dt [N m] of a wheelset by its own balance; of a locked one its share of the vehicle's force."""
    measured = given.measured
    if given.radius[k] * measured.wheel[j, k] < LOCKED_MPS:
        return -given.mass[i] * measured.acceleration[j] / measured.wheel.shape[1], 0.0
    turning = given.inertia[k] * measured.wheel_acceleration[j, k]
    return (measured.torque[j, k] + turning) / given.radius[k], turning


@inlined
def _roll(i: int, j: int, before: int, given: Given, found: Found) -> None:
    """Let stop i come to sample j from the one before."""
    measured, p, active, kept = given.measured, given.constants, given.active, found.kept
    axles = measured.wheel.shape[1]
    full_torque = p.brake.torque_per_bar * p.brake.full_pressure
    duration = measured.time[j] - measured.time[before]
    now, deceleration = measured.time[j] - measured.time[given.first[i]], -measured.acceleration[j]
    speed = true_speed(active, measured.speed[j], measured.acceleration[j], now)
    mean_wheel, braking = 0.0, 0.0
    for k in range(axles):
        if given.told:
            offset = p.axle_offset[k]
            force, turning = _held_back(j, i, k, given)
            passage = Passage(
                measured.position[before] - offset, measured.position[j] - offset, kept[_FRICTION, i, k] * duration,
                kept[_BRAKING, i, k] * duration, duration, measured.torque[j, k], full_torque,
                kept[_SLID, i, k], force, turning,
            )  # fmt: skip
            after_passage(active, i, k, passage)
        last = kept[_WHEEL, i, k]
        read = wheel_speed(active, measured.wheel[j, k], measured.wheel_acceleration[j, k])
        nearly = read / reading_factor(active, k, given.radius[k] * read, now)  # to first order in the sensor's error
        kept[_WHEEL, i, k] = read / reading_factor(active, k, given.radius[k] * nearly, now)
        kept[_WORK, i, k] += 2.0 * kept[_FRICTION, i, k] * duration
        kept[_ANGLE, i, k] += 0.5 * (last + kept[_WHEEL, i, k]) * duration
        if j == given.first[i]:  # a mean stands for the middle of its time
            kept[_ANGLE, i, k] = 0.5 * kept[_WHEEL, i, k] * given.mean[i]
        mean_wheel += kept[_WHEEL, i, k] / axles
        braking += measured.torque[j, k]
    at = j if found.doings.shape[1] == len(measured.time) else i
    static = given.mass[i] * p.gravity / (2.0 * axles)
    for k in range(axles):
        slip = speed - given.radius[k] * kept[_WHEEL, i, k]
        if given.asked or given.noted:
            rate = measured.wheel_acceleration[j, k]
            doing = Doing(
                now, duration, speed, deceleration, kept[_WHEEL, i, k], rate, slip, -deceleration - given.radius[k] * rate,
                measured.position[j] - p.axle_offset[k], kept[_ANGLE, i, k], given.radius[k], float(axles), mean_wheel,
                measured.torque[j, k], full_torque, kept[_WORK, i, k], given.mean[i],
            )  # fmt: skip
            before_contact(active, i, k, doing)
            if given.noted:
                note_doing(doing, found.doings, at, k)
        found.per_axle[2, j, k] = wheel_load(i, k, given.mass[i], deceleration, static, active)
        found.per_axle[3, j, k] = slip
    moment = Moment(now, measured.position[j], deceleration, braking / (full_torque * axles))
    believed = running_resistance(speed, p.resistance) + given.mass[i] * p.gravity * given.gradient[i]
    found.per_vehicle[0, j] = speed
    found.per_vehicle[1, j] = resistance(i, speed, believed, moment, active)


@inlined
def _meet(i: int, j: int, before: int, at: int, given: Given, found: Found) -> None:
    """Note what the wheels of stop i meet at sample j, from column `at` on."""
    measured, active, met, speed = given.measured, given.active, found.met, found.per_vehicle[0, j]
    rolled = speed * (measured.time[j] - measured.time[before])
    for k in range(measured.wheel.shape[1]):
        place = measured.position[j] - given.constants.axle_offset[k]
        on = at_speed(speed, surface(i, k, place, rolled, given.mu_cd[j, k], 1.0, given.law.mu_cr, active), active)
        met[0, at + k], met[1, at + k], met[2, at + k] = found.per_axle[3, j, k], speed, found.per_axle[2, j, k]
        met[3, at + k], met[4, at + k], met[5, at + k], met[6, at + k] = on.mu_cd, on.mu_cr, on.layer, on.held
        met[7, at + k] = recovery(active, i, k, given.tau)


@inlined
def _slide(i: int, j: int, before: int, at: int, given: Given, found: Found) -> None:
    """Take over the adhesion of stop i's wheels at sample j, from column `at` on."""
    measured, active, per_axle, law = given.measured, given.active, found.per_axle, found.adhesion
    speed = found.per_vehicle[0, j]
    rolled = speed * (measured.time[j] - measured.time[before])
    for k in range(measured.wheel.shape[1]):
        c, slip, load = at + k, per_axle[3, j, k], per_axle[2, j, k]
        unchanged = Adhesion(law[0, c], law[1, c], law[2, c], law[3, c], law[4, c], law[5, c])
        adhesion = changed_contact(active, unchanged, slip, speed, load)
        after_contact(active, i, k, rolled, adhesion.kept)
        found.kept[_FRICTION, i, k] = adhesion.f * load * abs(slip)
        per_axle[0, j, k] = adhesion.f if slip >= 0.0 else -adhesion.f
        per_axle[1, j, k] = adhesion.df_ds


@inlined
def _brake(i: int, j: int, given: Given, found: Found) -> None:
    """Note the torques of stop i's brakes at sample j."""
    measured, active, per_axle, kept = given.measured, given.active, found.per_axle, found.kept
    at = j if found.doings.shape[1] == len(measured.time) else i
    for k in range(measured.wheel.shape[1]):
        wheel, nominal = kept[_WHEEL, i, k], measured.torque[j, k]
        pressure = nominal / given.constants.brake.torque_per_bar
        factor = torque_factor(active, i, k, given.radius[k] * wheel, pressure)
        true = factor * nominal
        if given.noted:
            true = torque(i, k, true, doing_at(found.doings, at, k, 0.0), active)
        kept[_BRAKING, i, k] = true * wheel
        kept[_SLID, i, k] = per_axle[3, j, k]
        per_axle[4, j, k] = wheel
        per_axle[5, j, k] = factor
        per_axle[6, j, k] = true


@loop
def evaluate(given: Given, found: Found, contacts: bool, at_once: int) -> None:
    """Evaluate all stops, so many samples `at_once` as the contacts of one have nothing to do with those of the next."""
    axles = given.measured.wheel.shape[1]
    for i in range(len(given.mass)):
        first, last = given.first[i], given.first[i + 1]
        for begin in range(first, last, at_once):
            end = min(begin + at_once, last)
            for j in range(begin, end):
                before = max(j - 1, first)
                _roll(i, j, before, given, found)
                if contacts:
                    _meet(i, j, before, (j - begin) * axles, given, found)
                if at_once > 1:
                    _brake(i, j, given, found)
            if contacts:
                tractions(found.met, (end - begin) * axles, given.law, found.adhesion)
            for j in range(begin, end):
                if contacts:
                    _slide(i, j, max(j - 1, first), (j - begin) * axles, given, found)
                if at_once == 1:
                    _brake(i, j, given, found)


@loop
def undone(read_rate: np.ndarray, read_jerk: np.ndarray, active: Active, rate: np.ndarray) -> None:
    """Fill the true rates (T, A) [rad/s2] of wheels, from those that sensors read and their rates [rad/s3]."""
    for j in range(rate.shape[0]):
        for k in range(rate.shape[1]):
            rate[j, k] = wheel_speed(active, read_rate[j, k], read_jerk[j, k])
