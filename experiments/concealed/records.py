"""What the compiled truth model takes and returns."""

from typing import NamedTuple

import numpy as np


class Vehicle(NamedTuple):
    """What rolls; arrays (A,) by axle."""

    mass: float  # [kg]
    inertia: float  # [kg m2] of a wheelset
    gravity: float  # [m/s2]
    radius: np.ndarray  # [m]
    stiffness: np.ndarray  # [N] of the contact, eq. (6): pi G a b c11 / 4
    offset: np.ndarray  # [m] behind the leading axle
    body_arm: np.ndarray  # [1/m] load of one wheel per mass, deceleration and height of the body
    pivot_arm: np.ndarray  # [1/m] the same for the height of the bogies' pivots


class Law(NamedTuple):
    """The seed paper's law; Table 2."""

    k_ad: float
    k_sd: float
    k_ar: float
    k_sr: float
    ratio_d: float
    ratio_r: float
    gamma_d: float  # [s/m]
    gamma_r: float  # [s/m]
    mu_cr: float
    tau: float  # [m/J]
    semi_axis: float  # [m] in rolling direction
    pressure_per_load: float  # [1/m2] Hertz's largest pressure per load


class Brake(NamedTuple):
    """Pneumatic brake and WSP; arrays (A,) by axle."""

    gain: np.ndarray  # [-] true over nominal torque
    fill: np.ndarray  # [s] time constant of the cylinder
    vent: np.ndarray  # [s]
    dead_steps: np.ndarray  # int64, steps between command and valve
    rise: float  # [s] time constant of the distributor
    wsp: float  # 1: acts, 0: switched off


class PlannedStop(NamedTuple):
    """One stop."""

    speed: float  # [m/s] at its start
    end_speed: float  # [m/s] at which the recording ends
    coast: float  # [s] of free rolling before the brake is called
    demand: float  # [N m] nominal torque of a wheelset
    position: float  # [m] of the leading axle at the start
    mu_cd: float  # [-]
    slope: float  # [-] rise per metre
    phase: float  # [rad] of whatever oscillates
    gust: np.ndarray  # [-] random, deviation 1, every 0.1 s


class Effects(NamedTuple):
    """Sizes of all effects; the defaults are the nulls, at which nothing is left of them."""

    removal: float = 0.0  # [m/J] film removed on the rail
    memory: float = 0.0  # [m] over which the film is cleaned; it returns over twice that
    running: float = 0.0  # [-] exponent of Kother's falling friction
    threshold: float = 0.0  # [J/m] below which hardly anything is cleaned
    flash: float = 0.0  # [1/K] softening
    body_height: float = 0.0  # [m]
    pivot_height: float = 0.0  # [m]
    pad_speed: float = 0.0  # [-]
    pad_heat: float = 0.0  # [1/K]
    drag_a: float = 0.0  # [N]
    drag_b: float = 0.0  # [N s/m]
    drag_c: float = 0.0  # [N s2/m2]
    eddy: float = 0.0  # [N] largest force of an eddy-current track brake
    layer: float = 0.0  # [-] creepage per adhesion of a compliant third body
    drop: float = 0.0  # [-] further fall of friction with slip speed
    sand: float = 0.0  # [-] gain of friction on sand
    slack: float = 0.0  # [N] swinging force at the coupler
    hunting: float = 0.0  # [-] share of adhesion taken by lateral creepage
    gusts: float = 0.0  # [N] deviation of the force of gusts at 30 m/s
    dragging: float = 0.0  # [N m] torque of a brake that does not release
    dragging_axle: float = 0.0


class State(NamedTuple):
    """What changes within a stop, by axle (A,) unless stated."""

    wheel: np.ndarray  # [rad/s]
    adhesion: np.ndarray  # [-]
    steep: np.ndarray  # [-] derivative of the equation solved for it, where it was last solved
    torque: np.ndarray  # [N m] true
    pressure: np.ndarray  # [N m] cylinder pressure times the nominal gain
    command: np.ndarray  # of the WSP: vent -1, hold 0, apply 1
    seen: np.ndarray  # [rad/s] wheel speed at the WSP's last decision
    rate: np.ndarray  # [m/s2] its filtered deceleration
    waiting: np.ndarray  # (64, A) commands on their way to the valves, a ring
    disc: np.ndarray  # [K] heat of the rubbed layers of the discs
    flash: np.ndarray  # [K] flash temperature of the contact
    share: np.ndarray  # [-] adhesion recovered, where the film has a memory
    pending: np.ndarray  # [J] spent on the cell of rail under the wheel
    film: np.ndarray  # (cells,) [-] contaminant left on the rail
    sanded: np.ndarray  # (cells,) 1 where sand lies
    work: np.ndarray  # (3,) [J] of brakes, contacts, resistances


class History(NamedTuple):
    """What happened, every millisecond; (T,) or (T, A)."""

    speed: np.ndarray  # [m/s]
    wheel: np.ndarray  # [rad/s]
    torque: np.ndarray  # [N m] true
    nominal: np.ndarray  # [N m] cylinder pressure times the nominal gain
    position: np.ndarray  # [m]
    adhesion: np.ndarray  # [-]
    load: np.ndarray  # [N] of one wheel
    work: np.ndarray  # (3,) [J] of brakes, contacts, resistances
