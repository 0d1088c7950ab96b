"""Rolling radius difference and equivalent conicity of a wheelset on its track."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wsp_env.contact.geometry.equilibrium import SIDES, contacts, settled
from wsp_env.contact.geometry.port import Pair

Array = NDArray[np.float64]


def rolling_radius_difference(shifts_m: Sequence[float] | Array, pair: Pair) -> Array:
    """Return the left wheel's rolling radius less the right one's [m] at lateral shifts to the left [m], without yaw.

    The wheelset is rigid and touches both rails, each wheel with its deepest point. `ContactLostError` where it cannot.
    """
    differences = []
    for shift in shifts_m:
        pose = settled(float(shift), 0.0, pair)
        left, right = (contacts(pose, side, pair)[0].rolling_radius for side in SIDES)
        differences.append(left - right)
    return np.array(differences)


def equivalent_conicity(amplitudes_m: ArrayLike, shifts_m: Array, differences_m: Array, phases: int = 180) -> Array:
    """Return the conicity [-] of the cone that has the same first harmonic over a lateral oscillation of these amplitudes [m].

    `differences_m` [m] are `rolling_radius_difference` at `shifts_m` [m], rising, which must reach the largest amplitude.
    A cone of conicity c has a difference of 2 c y, so that c = integral(dR(A sin p) sin p dp) / (2 pi A) over one period.
    """
    amplitudes = np.asarray(amplitudes_m, dtype=float)
    if not (np.all(amplitudes > 0.0) and np.max(amplitudes) <= min(-shifts_m[0], shifts_m[-1])):
        raise ValueError(f"amplitudes must be above 0 and within the shifts {shifts_m[0]!r} to {shifts_m[-1]!r} m")
    sines = np.sin(2.0 * np.pi * (np.arange(phases) + 0.5) / phases)
    at = np.interp(amplitudes[..., None] * sines, shifts_m, differences_m)
    result: Array = np.mean(at * sines, axis=-1) / amplitudes
    return result
