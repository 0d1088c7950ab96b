"""The effects that a case may conceal: those that the library has a name for, and some that no library has.

Each is a function of (setup, size, place) that returns the setup with the effect in it; at size 0 nothing changes. `Place`
says where: which axle, where along the track, which variant. Sizes are in the unit stated and may be negative where
`signed`. Forms differ from the exponentials and straight lines that one would fit wherever the literature has another.
"""

import dataclasses
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from experiments.concealed.records import PlannedStop
from experiments.concealed.setup import Sensors, Setup


class Place(NamedTuple):
    """Where and how an effect acts."""

    axle: int = 1  # from 0
    track_m: float = 300.0
    length_m: float = 60.0
    variant: int = 0


class ConcealedEffect(NamedTuple):
    """One effect that can be concealed."""

    name: str
    quantity: str  # what the size is
    unit: str
    largest: float  # no search beyond this size
    signed: bool
    apply: Callable[[Setup, float, Place], Setup]
    pressure_only: bool = False  # cannot be seen where the torque itself is measured
    least_axles: int = 1
    variants: tuple[str, ...] = ("",)
    assumed: float = 0.0  # smallest size of interest where no reference stop would show any
    named: str = ""  # the library's name for it, where it is another one
    slots: tuple[str, ...] = ()  # where a term without a name acts, any of which is right; of what no library has
    on_axle: bool = False  # such a term acts on the place's axle alone


def _effects(setup: Setup, **changes: float) -> Setup:
    return dataclasses.replace(setup, effects=setup.effects._replace(**changes))


def _sensors(setup: Setup, **changes: float) -> Setup:
    sensors: Sensors = dataclasses.replace(setup.sensors, **changes)  # type: ignore[arg-type]  # names checked by replace
    return dataclasses.replace(setup, sensors=sensors)


def _in_every_run(setup: Setup, change: Callable[[PlannedStop], PlannedStop]) -> Setup:
    return dataclasses.replace(setup, runs={name: change(run) for name, run in setup.runs.items()})


def _patch(setup: Setup, size: float, place: Place) -> Setup:
    """Bend mu_cd along the track by a raised cosine."""
    along = (np.arange(len(setup.profile)) - place.track_m) / place.length_m
    bump = np.where(np.abs(along) < 1.0, 0.5 + 0.5 * np.cos(np.pi * np.clip(along, -1.0, 1.0)), 0.0)
    return dataclasses.replace(setup, profile=setup.profile * (1.0 + size * bump))


def _pad(setup: Setup, size: float, place: Place) -> Setup:
    """Friction of the pads: falls with speed (variant 0) or with the heat of the discs (variant 1)."""
    if place.variant % 2 == 0:
        return _effects(setup, pad_speed=size)
    return _effects(setup, pad_heat=size / 300.0)  # per 300 K


def _on_axle(values: np.ndarray, size: float, place: Place) -> np.ndarray:
    changed = values.copy()
    changed[place.axle % len(values)] *= 1.0 + size
    return changed


def _gain(setup: Setup, size: float, place: Place) -> Setup:
    return dataclasses.replace(setup, brake=setup.brake._replace(gain=_on_axle(setup.brake.gain, size, place)))


def _radius(setup: Setup, size: float, place: Place) -> Setup:
    return dataclasses.replace(setup, vehicle=setup.vehicle._replace(radius=_on_axle(setup.vehicle.radius, size, place)))


def _mass(setup: Setup, size: float, _: Place) -> Setup:
    return dataclasses.replace(setup, vehicle=setup.vehicle._replace(mass=setup.vehicle.mass * (1.0 + size)))


def _drag(setup: Setup, size: float, place: Place) -> Setup:
    """Davis: all of it aerodynamic (variant 0), or with the rolling terms that go with it (variant 1; assumption)."""
    rolling = float(place.variant % 2)
    return _effects(setup, drag_c=size, drag_b=5.0 * size * rolling, drag_a=100.0 * size * rolling)


def _slope(setup: Setup, size: float, _: Place) -> Setup:
    return _in_every_run(setup, lambda run: run._replace(slope=run.slope + size))


#: The eighteen names of the library that the truth was first written for.
LIBRARY: dict[str, ConcealedEffect] = {
    effect.name: effect
    for effect in (
        ConcealedEffect("leading_axle_cleaning", "removal", "m/J", 1e-3, False,
               lambda s, z, _: _effects(s, removal=z), least_axles=2),
        ConcealedEffect("contaminant_memory", "length", "m", 100.0, False, lambda s, z, _: _effects(s, memory=z)),
        ConcealedEffect("adhesion_patch", "depth", "-", 0.9, True, _patch),
        ConcealedEffect("speed_dependent_friction", "exponent", "-", 3.0, True, lambda s, z, _: _effects(s, running=z)),
        ConcealedEffect("recovery_shape", "threshold", "J/m", 5e3, False, lambda s, z, _: _effects(s, threshold=z)),
        ConcealedEffect("flash_temperature", "softening", "1/K", 0.05, False, lambda s, z, _: _effects(s, flash=z)),
        ConcealedEffect("load_transfer", "body height", "m", 8.0, False,
               lambda s, z, _: _effects(s, body_height=z, pivot_height=0.3 * z), least_axles=2),
        ConcealedEffect("pad_friction", "speed coefficient", "-", 0.8, True, _pad, pressure_only=True,
               variants=("falls with speed", "falls with heat")),
        ConcealedEffect("brake_gain_imbalance", "relative gain", "-", 0.6, True, _gain, pressure_only=True, least_axles=2),
        ConcealedEffect("track_gradient", "gradient", "-", 0.05, True, _slope),
        ConcealedEffect("aerodynamic_drag", "c", "N s2/m2", 60.0, False, _drag, variants=("c only", "with a and b")),
        ConcealedEffect("vehicle_mass", "relative mass", "-", 0.4, True, _mass),
        ConcealedEffect("non_adhesive_brake", "largest force", "N", 4e4, False, lambda s, z, _: _effects(s, eddy=z)),
        ConcealedEffect("initial_slope", "compliance", "-", 0.5, False, lambda s, z, _: _effects(s, layer=z)),
        ConcealedEffect("falling_friction", "drop", "-", 0.8, True, lambda s, z, _: _effects(s, drop=z)),
        ConcealedEffect("wheel_radius", "relative radius", "-", 0.05, True, _radius),
        ConcealedEffect("wheel_speed_lag", "lag", "s", 1.0, False, lambda s, z, _: _sensors(s, lag_s=z)),
        ConcealedEffect("clock_offset", "offset", "s", 1.0, True, lambda s, z, _: _sensors(s, clock_s=z)),
    )
}  # fmt: skip

#: Effects that got a name in the library after this truth had been written.
NEWER: dict[str, ConcealedEffect] = {
    effect.name: effect
    for effect in (
        ConcealedEffect("sanding", "gain of friction", "-", 3.0, False, lambda s, z, _: _effects(s, sand=z)),
        ConcealedEffect("slack_action", "swinging force", "N", 3e4, False, lambda s, z, _: _effects(s, slack=z),
               assumed=500.0, named="coupler_force"),  # about 1 % of the braking force
        ConcealedEffect("dragging_brake", "torque", "N m", 3e3, False,
               lambda s, z, p: _effects(s, dragging=z, dragging_axle=float(p.axle % s.axles)), pressure_only=True),
    )
}  # fmt: skip

#: In no library: what a diagnosis may describe, but has to leave without a name.
FOREIGN: dict[str, ConcealedEffect] = {
    effect.name: effect
    for effect in (
        ConcealedEffect("hunting", "share of adhesion", "-", 0.9, False, lambda s, z, _: _effects(s, hunting=z),
               slots=("friction",)),
        ConcealedEffect("wind_gusts", "force at 30 m/s", "N", 3e4, False, lambda s, z, _: _effects(s, gusts=z),
               slots=("vehicle force",)),
        ConcealedEffect("radar_pitch", "error per deceleration", "s2/m", 0.1, False, lambda s, z, _: _sensors(s, pitch_s2pm=z),
               slots=("sensor",)),
        ConcealedEffect("torque_drift", "drift", "N m/s", 300.0, True,
               lambda s, z, p: _sensors(s, drift_nmps=z, drift_axle=p.axle % s.axles),
               assumed=2.5, slots=("brake torque", "sensor"), on_axle=True),  # about 1 % of the torque in half a minute
    )
}  # fmt: skip

#: All that the library has a name for.
NAMED = LIBRARY | NEWER
ALL = NAMED | FOREIGN
SENSOR_FAULTS = ("wheel_radius", "wheel_speed_lag", "clock_offset", "radar_pitch", "torque_drift")


def library_names(effects: Iterable[str]) -> list[str]:
    """Return the library's names of those effects that it has a name for."""
    return [ALL[name].named or name for name in effects if name in NAMED]
