"""What a stop is made of: vehicle, brake, slide protection, run, effects, sound variation, and what changes as it goes.

Axles are counted from 0 here, places in metres along the track. Signs are positive in braking.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Vehicle(NamedTuple):
    """The vehicle as its test team knows it."""

    mass_kg: float
    radius_m: float  # of all wheels
    inertia_kgm2: float  # of a wheelset
    torque_per_bar_nm: float  # of a wheelset
    wheelbase_m: float  # of a bogie
    pivots_m: float  # distance of the bogies' pivots, or of the two axles
    positions_m: Array  # (A,) of the axles behind the leading one


class Brake(NamedTuple):
    """The brake cylinders; the unit of the rates depends on the character, see `brakes.flow`."""

    character: int
    fill: float
    vent: float


class Protection(NamedTuple):
    """The wheel slide protection; what `vent` and `apply` are depends on its kind, see `brakes.decide`."""

    kind: int
    period_s: float  # between decisions
    slowing_mps2: float  # the reference speed falls no faster
    slip_mps: float  # slip aimed at, at standstill
    slip_per_speed: float  # what is added to it, per speed
    vent: float
    apply: float


class Run(NamedTuple):
    """One stop."""

    speed_mps: float
    position_m: float  # of the leading axle at the start
    coast_s: float  # until the brake is applied
    mu_cd: float  # kinetic friction of the contaminated contact
    tau_m_per_j: float
    pressure_bar: float  # demanded
    rise_s: float  # of the demand


class Sizes(NamedTuple):
    """Size of each effect, 0 where it is absent; units and meaning in `effects.EFFECTS`."""

    leading_axle_cleaning: float = 0.0
    contaminant_memory: float = 0.0
    adhesion_patch: float = 0.0
    speed_dependent_friction: float = 0.0
    recovery_shape: float = 0.0
    falling_friction: float = 0.0
    load_transfer: float = 0.0
    pad_friction: float = 0.0
    brake_gain_imbalance: float = 0.0
    dragging_brake: float = 0.0
    track_gradient: float = 0.0
    aerodynamic_drag: float = 0.0
    non_adhesive_brake: float = 0.0
    vehicle_mass: float = 0.0
    wheel_radius: float = 0.0
    clock_offset: float = 0.0
    sticking_rigging: float = 0.0
    leaking_valve: float = 0.0
    hydroplaning: float = 0.0
    bogie_resonance: float = 0.0
    coupled_axles: float = 0.0
    parking_brake_remnant: float = 0.0
    wet_pads: float = 0.0
    curve_resistance: float = 0.0
    squeeze_film: float = 0.0


class Places(NamedTuple):
    """Where effects act, and their second parameters; drawn for every campaign, whatever it conceals."""

    gain_axle: int  # brake_gain_imbalance
    dragging_axle: int  # dragging_brake
    radius_axle: int  # wheel_radius
    leaking_axle: int  # leaking_valve
    parking_axle: int  # parking_brake_remnant
    patch_m: float  # adhesion_patch: centre
    patch_length_m: float
    electric_from_mps: float  # non_adhesive_brake: acts above
    planing_mps: float  # hydroplaning: half is lost here
    wave_m: float  # bogie_resonance: wavelength of the track
    resonance_radps: float
    release_s: float  # parking_brake_remnant: time constant
    drying_j: float  # wet_pads: work that dries a wheelset's pads
    curve_m: float  # curve_resistance: centre
    curve_length_m: float


class Sound(NamedTuple):
    """Sound variation of one stop, which is no effect; see `sound.SOUND`."""

    friction: Array  # (A,) relative, of mu_cd
    loads: Array  # (A,) relative, of the static load
    radius: Array  # (A,) relative
    valves: Array  # (A,) relative, of the fill and vent rates
    teeth: Array  # (A,) relative, of the wheel speed, once a turn
    gusts_n: Array  # (T,) every `sound.GRID_S`
    ripple: Array  # (T,) relative, of the distributor pressure
    pads: Array  # (A, T) relative, of the torque
    bounce: Array  # (A, T) relative, of the static load
    roughness: Array  # (M,) relative, of mu_cd, at every metre from -60 m on
    gradient: Array  # (M,) rise at the same places


class State(NamedTuple):
    """What changes while a stop goes on, of every axle (A,) and of the rail."""

    radius: Array  # [m], true; it stays
    wheel: Array  # [rad/s]
    turned: Array  # [rad]
    pressure: Array  # [bar] in the cylinder
    inside: Array  # [bar] behind the play of the rigging
    leaked: Array  # [bar]
    pad_work: Array  # [J]
    share: Array  # of the distributor pressure that a pressure-step protection asks for
    valve: Array  # -1 vents, 0 holds, 1 applies
    pulse: Array  # [s] for which a creep-band protection opens its valve
    before: Array  # [rad/s] wheel at the last decision
    slid: Array  # 1 once a deceleration protection has vented
    remembered: Array  # [J/m] friction work, by `contaminant_memory`
    slip: Array  # [m/s] of the last step
    slip_rate: Array  # [m/s2] over 0.05 s
    cell: NDArray[np.int64]  # of rail under the wheel, -1 at first
    passing: Array  # [J/m] friction work on that cell
    rail: Array  # (cells,) [J/m] left behind by earlier wheels
