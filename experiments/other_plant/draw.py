"""Draws stops from a seed: what the plant truly is, in worlds of growing distance from what a controller believes.

A stop has its own random numbers: stop i of a seed starts at the same speed on the same rail in all worlds and under both laws,
whatever the number of stops, and what two worlds both draw is the same in both. All ranges are assumptions.
"""

from typing import Any, Literal, get_args

import numpy as np

from experiments.other_plant.pneumatics import conductance, rise_to_full
from experiments.other_plant.records import Body, Curve, Stops
from wsp_env.parameters.vehicle import Vehicle

World = Literal["nominal", "drawn", "all", "dry"]
Law = Literal["recovering", "classic"]

_RIPPLES = 3  # sines that make the film's texture
_NOMINAL_STROKE_S = 0.01  # of the dump valve [s] (assumption)
_RAIL_HEIGHT_M = {"bogie": 0.5, "body": 1.3}  # height over the rail at which the mass above pulls [m] (assumption)


def body(believed: Vehicle) -> Body:
    """Return what all stops of a vehicle have in common."""
    contact = believed.contact
    stiffness = np.pi / 4.0 * contact.shear_modulus_pa * contact.semi_axis_a_m * contact.semi_axis_b_m * contact.kalker_c11
    clean = Curve(
        contact.kinetic_friction_r, contact.friction_ratio_r, contact.friction_decrease_r_spm, contact.polach_k_ar,
        contact.polach_k_sr,
    )  # fmt: skip
    return Body(
        np.array(believed.axle_positions_m), believed.wheelset_inertia_kgm2, believed.gravity_mps2, float(stiffness),
        believed.brake.full_pressure_bar, believed.brake.cylinder_volume_l, clean,
    )  # fmt: skip


def draw(world: World, law: Law, believed: Vehicle, n: int, seed: int) -> Stops:
    """Return the true parameters of stops.

    Parameters
    ----------
    world
        "nominal": the believed vehicle with half its payload, in this plant's own form of the brake; "drawn": times and gains
        of the brake, radii and load transfer drawn; "all": moreover noise, a worn wheelset, axle loads, gradient and drag;
        "dry": a clean rail under a drawn brake
    law
        "recovering", or "classic": the same rail without recovery
    believed
        vehicle with 1, 2 or 4 axles
    n, seed
        number of stops, and where their numbers come from

    Raises
    ------
    ValueError
        for another world or law, or a number of axles that the load transfer does not know

    """
    if world not in get_args(World) or law not in get_args(Law) or believed.axles not in (1, 2, 4):
        raise ValueError(f"{world!r}, {law!r}, {believed.axles} axles: not of {get_args(World)}, {get_args(Law)}, 1, 2 or 4")
    drawn = [_stop(world, law, believed, np.random.default_rng([seed, number])) for number in range(n)]
    return Stops(**{name: np.array([stop[name] for stop in drawn]) for name in Stops._fields})


def _stop(world: World, law: Law, believed: Vehicle, rng: np.random.Generator) -> dict[str, Any]:
    """Return the fields of `Stops` of one stop."""
    varied, disturbed, dry, axles = world != "nominal", world == "all", world == "dry", believed.axles

    def pick(low: float, high: float, nominal: float, on: bool) -> float:
        value = float(rng.uniform(low, high))
        return value if on else nominal

    contact = believed.contact
    speed, mu_cd, mu_dry = rng.uniform(25.0, 45.0), rng.uniform(0.023, 0.045), rng.uniform(0.27, 0.33)
    tau = rng.uniform(1e-4, 3e-4)
    film = [mu_cd, contact.friction_ratio_d, contact.friction_decrease_d_spm, contact.polach_k_ad, contact.polach_k_sd]
    clean = [mu_dry, contact.friction_ratio_r, contact.friction_decrease_r_spm, contact.polach_k_ar, contact.polach_k_sr]
    ripple = np.column_stack(
        [
            rng.uniform(0.0, 0.03, _RIPPLES),
            2.0 * np.pi / np.exp(rng.uniform(np.log(5.0), np.log(50.0), _RIPPLES)),
            rng.uniform(0.0, 2.0 * np.pi, _RIPPLES),
        ]
    )
    loads = np.where(disturbed, rng.uniform(-0.03, 0.03, axles), 0.0)
    mass = believed.mass_kg + 0.5 * believed.payload_kg  # docs/drive_it.md: what controllers assume
    radius = np.full(axles, believed.wheel_radius_m)
    radius *= 1.0 + np.where(varied, rng.normal(0.0, 5e-4, axles), 0.0)
    radius[rng.integers(axles)] *= 1.0 - pick(0.01, 0.04, 0.0, disturbed)
    return {
        **_brake(believed, varied, rng),
        "speed_mps": speed,
        "mass_kg": mass * (1.0 + loads.mean()),
        "load_n": mass * believed.gravity_mps2 / (2.0 * axles) * (1.0 + loads),
        "transfer_s2pm": rng.uniform(0.5, 1.5) * _transfer(believed) * float(varied),
        "gradient": pick(-0.003, 0.003, 0.0, disturbed),
        "drag_ns2pm2": pick(0.0, 1.5 * axles / 4.0, 0.0, disturbed),  # of a coach, in proportion to its length
        "tau_mpj": 0.0 if dry or law == "classic" else tau,
        "film": np.array(clean if dry else film),
        "ripple": ripple,
        "radius_m": radius,
        "noise_radps": pick(0.0, 0.3, 0.0, disturbed),
        "window_s": pick(0.02, 0.04, 0.02, varied),
        "pulses": np.rint(pick(80.0, 120.0, believed.tachometer.pulses_per_turn, varied)),
        "pulse_phase": rng.uniform(0.0, 1.0, axles),
        "key": rng.integers(0, 2**64, dtype=np.uint64),
    }


def _brake(believed: Vehicle, varied: bool, rng: np.random.Generator) -> dict[str, Any]:
    """Return the fields of the brake of one stop."""

    def pick(low: float, high: float, nominal: float) -> float:
        value = float(rng.uniform(low, high))
        return value if varied else nominal

    brake, axles = believed.brake, believed.axles
    inshot, curvature = pick(0.05, 0.15, 0.1), pick(0.5, 1.5, 1.0)
    rise95 = pick(3.0, 5.0, 0.95 * brake.demand_rise_s)
    hysteresis = pick(0.01, 0.04, 0.02)
    gain = np.full(axles, pick(0.95, 1.05, 1.0))
    gain[rng.integers(axles)] *= pick(0.9, 1.1, 1.0)
    return {
        "rise_s": rise_to_full(rise95, inshot, curvature),
        "inshot": inshot,
        "curvature": curvature,
        "fill_ps": conductance(brake.full_pressure_bar, False, pick(0.18, 0.35, brake.fill_time_constant_s)),
        "vent_ps": conductance(brake.full_pressure_bar, True, pick(0.10, 0.22, brake.vent_time_constant_s)),
        "dead_s": pick(0.02, 0.06, brake.dead_time_s),
        "stroke_s": pick(0.005, 0.02, _NOMINAL_STROKE_S),
        "hysteresis": hysteresis,
        "pad_slope": pick(0.0, 0.1, 0.05),
        # full pressure from below gives the believed torque where there is no error of gain
        "torque_pbar": gain * brake.torque_per_bar_nm / (1.0 - hysteresis),
    }


def _transfer(believed: Vehicle) -> np.ndarray:
    """Return the relative change (A,) of the axle loads over deceleration [s2/m]: 2 h / (g L) in a bogie and between bogies."""
    x = np.array(believed.axle_positions_m)
    change = np.zeros(believed.axles)
    if believed.axles > 1:
        leads = np.where(np.arange(believed.axles) % 2 == 0, 1.0, -1.0)
        change += leads * 2.0 * _RAIL_HEIGHT_M["bogie"] / (believed.gravity_mps2 * (x[1] - x[0]))
    if believed.axles == 4:
        front = np.where(np.arange(4) < 2, 1.0, -1.0)
        change += front * 2.0 * _RAIL_HEIGHT_M["body"] / (believed.gravity_mps2 * (x[2] - x[0]))
    return change
