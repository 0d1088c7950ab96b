"""What the wheels felt: the experimental quantities of the seed paper's section 3.2, from a recording.

Smoothing. Speeds, torque and their derivatives come from a Savitzky-Golay filter of second order, which leaves every
parabola as it is and delays nothing. The wheel's quantities share one window, so that C and J dw/dt in its balance are
smoothed alike; the vehicle's speed, whose noise is the largest share of the slip's and which a mass of some 43 t cannot
change fast, has a longer one. In the first and last half window the filter extrapolates its last parabola: the noise
there is up to nine times larger in variance, so `Derived.usable` leaves those samples out.
"""

import dataclasses

import numpy as np
from scipy.ndimage import maximum_filter1d

from wsp_env.contact.degraded import DegradedLaw, adhesion_recovered, adhesion_without_recovery
from wsp_env.contact.traction import SPEED_FLOOR
from wsp_env.parameters.quantity import Checked, quantity
from wsp_env.recordings.campaign import Campaign
from wsp_env.recordings.errors import CampaignError
from wsp_env.recordings.recording import Recording

_ORDER = 2
_ROLLING_TORQUE = 0.05  # share of a run's largest torque below which a wheel counts as rolling freely
_STANDSTILL_MPS = 0.3  # below, speed sensors say nothing
_ROLLING_TIME_S = 0.5  # shorter pieces of free rolling say little about the radius
_RADIUS_TOLERANCE = 0.1  # a larger deviation from the believed radius is a wrong unit, not a worn wheel


@dataclasses.dataclass(frozen=True)
class Smoothing(Checked):
    """How recordings are smoothed, and which samples are compared with the law."""

    # Window [s] of the filter of the vehicle's speed.
    vehicle_window_s: float = quantity(0.5, "s", "least error of tau on simulated stops, flat from 0.2 to 1 s", 0.0, 5.0)
    # Window [s] of the filter of wheel speeds and torques.
    wheel_window_s: float = quantity(0.15, "s", "as above, flat from 0.1 to 0.2 s", 0.0, 5.0)
    # Running speed [m/s] below which samples are left out.
    least_speed_mps: float = quantity(5.0, "m/s", "noise of the creepage grows as 1 / v", 0.0, 100.0)
    # Creepage [-] below which a wheel does not count as sliding.
    least_creepage: float = quantity(0.01, "-", "below, f is as steep as noise in s is large", 0.0, 1.0)
    # Circumferential speed [m/s] below which a wheel counts as locked and is left out.
    locked_below_mps: float = quantity(0.5, "m/s", "a locked wheel's torque is a reaction", 0.0, 10.0)


@dataclasses.dataclass(frozen=True)
class Derived:
    """Quantities of one recording; arrays (T, axles) except the first three (T,). Forces are per wheel."""

    time_s: np.ndarray  # [s]
    speed_mps: np.ndarray  # v [m/s], smoothed
    acceleration_mps2: np.ndarray  # dv/dt [m/s2]
    slip_speed_mps: np.ndarray  # s = v - r w [m/s], eq. (2)
    creepage: np.ndarray  # e = s / v [-], eq. (2)
    contact_force_n: np.ndarray  # T_c [N], eq. (11) with two wheels: J dw/dt = 2 r T_c - C
    normal_load_n: float  # N_c = M g / (2 axles) [N]
    adhesion: np.ndarray  # f = T_c / N_c [-], eq. (1)
    energy_jpm: np.ndarray  # W_sp = T_c e [J/m], eq. (1)
    torque_share: np.ndarray  # C / (2 r N_c) [-]: what of f comes from the brake torque
    usable: np.ndarray  # bool: sliding, turning, fast enough, as recorded, and inside the filter's ends


def rolling_radii(campaign: Campaign, smoothing: Smoothing = Smoothing()) -> np.ndarray:
    """Wheel radius [m] of each axle (axles,), seen while rolling freely before the brakes apply.

    Least squares of v = r w on the means of the runs to tune on: those to validate must not touch what is tuned. Where
    no run rolls freely for half a second: the believed radius.

    Raises
    ------
    CampaignError
        when the radius seen is off by more than a tenth: a channel in another unit

    """
    believed = campaign.vehicle.wheel_radius_m
    vw = np.zeros(campaign.vehicle.axles)
    ww = np.zeros(campaign.vehicle.axles)
    for name in campaign.tune:
        run = campaign.runs[name]
        end, stopped = braking(run, campaign.sample_time_s, smoothing)
        if end == stopped:
            continue
        if end * campaign.sample_time_s > _ROLLING_TIME_S and run.vehicle_speed_mps[:end].min() > smoothing.least_speed_mps:
            speed, wheel = run.vehicle_speed_mps[:end].mean(), run.wheel_speed_radps[:end].mean(axis=0)
            vw += end * speed * wheel
            ww += end * wheel**2
    if not ww.all():
        return np.full(campaign.vehicle.axles, believed)
    radii: np.ndarray = vw / ww
    if (np.abs(radii / believed - 1.0) > _RADIUS_TOLERANCE).any():
        raise CampaignError(
            f"campaign {campaign.name}: rolling freely, the wheels seem to have radii of "
            f"{', '.join(f'{radius:.3f}' for radius in radii)} m, but [vehicle] wheel_radius_m = {believed:g}; "
            "check the units of vehicle_speed_mps and axle*_wheel_speed_radps"
        )
    return radii


def braking(run: Recording, sample_time_s: float, smoothing: Smoothing = Smoothing()) -> tuple[int, int]:
    """Return the first sample of braking and the first after it (the same for a run without).

    Braking is from the first to the last sample at which some torque exceeds a twentieth of the run's largest and the vehicle
    still moves.
    """
    torque = np.abs(_smooth(run, run.brake_torque_nm, smoothing.wheel_window_s, sample_time_s))
    on = (torque > _ROLLING_TORQUE * torque.max()).any(axis=1) & (run.vehicle_speed_mps > _STANDSTILL_MPS)
    samples = np.flatnonzero(on)
    return (int(samples[0]), int(samples[-1]) + 1) if samples.size else (0, 0)


def derive(
    campaign: Campaign,
    run: Recording,
    radii_m: np.ndarray,
    smoothing: Smoothing = Smoothing(),
) -> Derived:
    """Derive the experimental quantities of eqs. (1), (2) and (11) from one recording.

    Parameters
    ----------
    radii_m : wheel radius of each axle (axles,) [m], see `rolling_radii`

    Raises
    ------
    CampaignError
        when the recording is shorter than the filter's window

    """
    step, vehicle = campaign.sample_time_s, campaign.vehicle
    speed = _smooth(run, run.vehicle_speed_mps, smoothing.vehicle_window_s, step)
    wheel = _smooth(run, run.wheel_speed_radps, smoothing.wheel_window_s, step)
    torque = _smooth(run, run.brake_torque_nm, smoothing.wheel_window_s, step)
    wheel_acceleration = _smooth(run, run.wheel_speed_radps, smoothing.wheel_window_s, step, derivative=1)
    load = run.mass_kg * vehicle.gravity_mps2 / (2 * vehicle.axles)
    circumferential = radii_m * wheel
    slip = speed[:, None] - circumferential
    creepage = slip / np.maximum(speed, SPEED_FLOOR)[:, None]
    force = (torque + vehicle.wheelset_inertia_kgm2 * wheel_acceleration) / (2 * radii_m)
    usable = (speed > smoothing.least_speed_mps)[:, None] & (creepage > smoothing.least_creepage)
    usable &= circumferential > smoothing.locked_below_mps
    end = _length(max(smoothing.vehicle_window_s, smoothing.wheel_window_s), step) // 2
    usable[:end] = usable[len(usable) - end :] = False
    if run.suspect is not None and run.suspect.any():  # repaired samples spoil what the filter makes of their neighbours
        usable &= ~maximum_filter1d(run.suspect, 2 * end + 1, axis=0)
    return Derived(
        time_s=run.time_s,
        speed_mps=speed,
        acceleration_mps2=_smooth(run, run.vehicle_speed_mps, smoothing.vehicle_window_s, step, derivative=1),
        slip_speed_mps=slip,
        creepage=creepage,
        contact_force_n=force,
        normal_load_n=load,
        adhesion=force / load,
        energy_jpm=force * creepage,
        torque_share=torque / (2 * radii_m * load),
        usable=usable,
    )


def limits(derived: Derived, mu_cd: float, law: DegradedLaw) -> tuple[np.ndarray, np.ndarray]:
    """Limit adhesion coefficients f_d and f_r [-] along the recording, each (T, axles), eq. (5)."""
    state = (derived.slip_speed_mps, derived.speed_mps[:, None], derived.normal_load_n, mu_cd, 0.0, law)
    return adhesion_without_recovery(*state), adhesion_recovered(*state)


def transition(derived: Derived, mu_cd: float, law: DegradedLaw) -> np.ndarray:
    """Experimental transition function lambda [-] (T, axles), eq. (3) solved for it; nan where f_r = f_d (no slip)."""
    f_d, f_r = limits(derived, mu_cd, law)
    gap = f_r - f_d
    value: np.ndarray = np.divide(derived.adhesion - f_d, gap, out=np.full_like(gap, np.nan), where=gap != 0.0)
    return value


def _length(window_s: float, step_s: float) -> int:
    return max(2 * round(window_s / (2 * step_s)) + 1, _ORDER + 1)


def _smooth(run: Recording, values: np.ndarray, window_s: float, step_s: float, derivative: int = 0) -> np.ndarray:
    length = _length(window_s, step_s)
    if len(values) < length:
        raise CampaignError(
            f"run {run.name} has {len(values)} samples, the smoothing window of {window_s:g} s needs {length}: "
            "leave the run out"
        )
    from scipy.signal import savgol_filter  # here, as it takes longer to import than all the rest

    smooth: np.ndarray = savgol_filter(values, length, _ORDER, deriv=derivative, delta=step_s, axis=0)
    return smooth
