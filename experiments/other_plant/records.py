"""Records that the compiled code works on, and the decorator that compiles it.

N is the number of stops, A of axles, K of remembered decisions, R of ripples of the film.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numba
import numpy as np

Function = TypeVar("Function", bound=Callable[..., object])


_OPTIONS: dict[str, Any] = {"error_model": "numpy", "forceinline": True}
_INNER: dict[str, Any] = {**_OPTIONS, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def compiled(function: Function) -> Function:
    """Return the function compiled by numba, with the type that it has; not cached on disk."""
    return cast(Function, numba.njit(**_OPTIONS)(function))


def inner(function: Function) -> Function:
    """Return the function compiled for compiled callers only: that saves the time of making its entrance from Python."""
    return cast(Function, numba.njit(**_INNER)(function))


class Curve(NamedTuple):
    """One Polach curve of docs/contact.md."""

    friction: float  # kinetic friction coefficient [-]
    ratio: float  # A, kinetic to static friction [-]
    decrease: float  # gamma [s/m]
    k_a: float  # reduction in the area of adhesion [-]
    k_s: float  # reduction in the area of slip [-]


class Body(NamedTuple):
    """What all stops have in common."""

    positions_m: np.ndarray  # (A,) behind the leading axle [m]
    inertia_kgm2: float  # of one wheelset [kg m2]
    gravity_mps2: float  # [m/s2]
    stiffness_n: float  # pi G a b c11 / 4 of one wheel [N]
    full_bar: float  # full cylinder pressure, gauge [bar]
    volume_l: float  # of cylinder and pipe of one axle [l]
    clean: Curve  # the rail without film


class Stops(NamedTuple):
    """True parameters of N stops; nothing of this is told to a controller."""

    speed_mps: np.ndarray  # (N,) initial speed [m/s]
    mass_kg: np.ndarray  # (N,) [kg]
    gradient: np.ndarray  # (N,) rise over distance [-]
    drag_ns2pm2: np.ndarray  # (N,) force over speed squared [N s2/m2]
    tau_mpj: np.ndarray  # (N,) recovery rate of one wheel [m/J]; 0: classic law
    film: np.ndarray  # (N, 5) the fields of `Curve` of the contaminated rail
    ripple: np.ndarray  # (N, R, 3) relative amplitude [-], wave number [rad/m], phase [rad] of the film's friction
    rise_s: np.ndarray  # (N,) time in which the distributor gets full [s]
    inshot: np.ndarray  # (N,) share of full pressure that comes at once [-]
    curvature: np.ndarray  # (N,) of the later rise [-]
    fill_ps: np.ndarray  # (N,) conductance of the open valve over cylinder volume [1/s]
    vent_ps: np.ndarray  # (N,) the same to the air [1/s]
    dead_s: np.ndarray  # (N,) from a command to half the valve's stroke out of its middle [s]
    stroke_s: np.ndarray  # (N,) time of the stroke from shut to open [s]
    hysteresis: np.ndarray  # (N,) share of the force lost to friction in piston and rigging [-]
    pad_slope: np.ndarray  # (N,) loss of pad friction over speed, see `pneumatics.pad_friction` [-]
    noise_radps: np.ndarray  # (N,) standard deviation of the sensors' noise [rad/s]
    window_s: np.ndarray  # (N,) window of the pulse counter [s]
    pulses: np.ndarray  # (N,) pulses per turn [-]
    key: np.ndarray  # (N,) uint64, of the noise
    radius_m: np.ndarray  # (N, A) [m]
    load_n: np.ndarray  # (N, A) static load of one wheel [N]
    transfer_s2pm: np.ndarray  # (N, A) relative change of load over deceleration [s2/m]
    torque_pbar: np.ndarray  # (N, A) torque of one axle over cylinder pressure, gains included [N m/bar]
    pulse_phase: np.ndarray  # (N, A) share of a pulse that has turned by at the start [-]


class State(NamedTuple):
    """What changes during the stops; arrays in place."""

    ended: np.ndarray  # (N,) bool
    time_s: np.ndarray  # (N,) own time, stands when the stop has ended [s]
    speed_mps: np.ndarray  # (N,) [m/s]
    position_m: np.ndarray  # (N,) [m]
    pitch_mps2: np.ndarray  # (N,) deceleration that the load transfer follows, lagging [m/s2]
    omega_radps: np.ndarray  # (N, A) [rad/s]
    pressure_bar: np.ndarray  # (N, A) gauge [bar]
    pressing_bar: np.ndarray  # (N, A) pressure that the pads feel, after hysteresis [bar]
    spool: np.ndarray  # (N, A) position of the dump valve, -1 vents, 0 shut, 1 open to the distributor [-]
    command: np.ndarray  # (N, A, K) ring of the last decisions
    angle_rad: np.ndarray  # (N, A) turned by [rad]
    edges: np.ndarray  # (N, A) pulses so far [-]
    edge_s: np.ndarray  # (N, A) time of the last edge [s]
    contact_j: np.ndarray  # (N,) dissipated in the contacts [J]
    brake_j: np.ndarray  # (N,) dissipated in the brakes [J]
    resistance_j: np.ndarray  # (N,) against drag and gradient [J]
    air_nl: np.ndarray  # (N,) vented by the dump valves [Nl]
    braking: np.ndarray  # (N,) bool, a cylinder has had `plant.APPLIED_BAR`
    watched_s: np.ndarray  # (N,) time from there to 5 km/h [s]
    slip_m: np.ndarray  # (N, A) integral of slip over it [m]
    slip_squared: np.ndarray  # (N, A) integral of squared slip over it [m2/s]
    standing_s: np.ndarray  # (N, A) for which the wheel has stood by now [s]
    locked_s: np.ndarray  # (N,) the longest of these times [s]
