"""Springs, dampers, bump-stops, weight, motion of the track's frame, and the solution for the forces of the contacts.

Compiled functions of plain arrays: what is passed whole into many functions takes the compiler long.
"""

import math

import numpy as np
from numpy.typing import NDArray

from wsp_env.compiled import loop
from wsp_env.plant.multibody.bodies import Elements, Motion, Touching
from wsp_env.plant.multibody.structure import PITCH, ROLL, WHEELSETS, Y_, YAW, Z_
from wsp_env.plant.multibody.way import here

Array = NDArray[np.float64]


@loop
def add_product(factor: float, matrix: Array, vector: Array, result: Array) -> None:
    """Add factor times matrix (n, n), symmetric, times vector (n,) to the result (n,)."""
    n = vector.shape[0]
    for row in range(n):
        value = factor * vector[row]
        if value != 0.0:
            for column in range(n):
                result[column] += value * matrix[row, column]


@loop
def stop_force(shift: float, x: Array, force: Array) -> float:
    """Force of a bump-stop [N] at a lateral shift [m], against it, from its curve: deflections x (m,) [m], forces (m,) [N].

    Beyond its end the curve goes on as steep.
    """
    deep = abs(shift)
    if deep <= x[0]:
        return 0.0
    n = 1
    while n < x.shape[0] - 1 and x[n] < deep:
        n += 1
    size = force[n - 1] + (deep - x[n - 1]) * (force[n] - force[n - 1]) / (x[n] - x[n - 1])
    return size if shift > 0.0 else -size


@loop
def _turn_frames(
    h: float, ahead: float, speed: float, gravity: float, mass: Array, segments: Array, e: Elements, w: Motion
) -> None:  # fmt: skip
    """Add what a curve does: shifts of the frames against that of the carbody, and forces of their motion and tilt."""
    centre = here(ahead + e.place[0], segments)
    for body in range(e.place.shape[0]):
        first, distance, height = 6 * body, e.place[body] - e.place[0], e.height[body]
        own = here(ahead + e.place[body], segments)
        tilt, tilting = own.tilt - centre.tilt, speed * (own.tilt_rate - centre.tilt_rate)
        w.at[first + Y_] += own.across - centre.across - centre.heading * distance - height * tilt
        w.at[first + ROLL] += tilt
        w.at[first + YAW] += own.heading - centre.heading
        w.rate[first + Y_] += speed * (own.heading - centre.heading - centre.curvature * distance) - height * tilting
        w.rate[first + ROLL] += tilting
        w.rate[first + YAW] += speed * (own.curvature - centre.curvature)
        outwards = speed * speed * own.curvature
        w.force[first + Y_] -= h * mass[first] * (outwards + gravity * math.sin(own.tilt))
        w.force[first + Z_] += h * mass[first] * (outwards * own.tilt + gravity * (1.0 - math.cos(own.tilt)))
        w.force[first + YAW] -= h * mass[first + YAW] * speed * speed * own.curvature_rate


@loop
def suspend(
    h: float, ahead: float, speed: float, gravity: float, body: tuple[Array, Array, Array], segments: Array, e: Elements,
    w: Motion,
) -> float:  # fmt: skip
    """Write the impulses of springs, dampers, stops and weight over h [s]; return the heat in the dampers [J].

    `ahead` [m] is where the leading axle is, `body` mass (n,), stiffness that the preloads add (n,) and axle loads (A,).
    """
    mass, hanging, axle_load = body
    n = w.at.shape[0]
    for row in range(n):
        w.force[row] = -h * hanging[row] * w.at[row]
        w.change[row] = 0.0
    if segments.shape[0] > 1:
        _turn_frames(h, ahead, speed, gravity, mass, segments, e, w)
    add_product(-h, e.damping, w.rate, w.change)
    heat = 0.0
    for row in range(n):
        heat -= w.rate[row] * w.change[row]
    add_product(-h, e.stiffness, w.at, w.change)
    for row in range(n):
        w.force[row] += w.change[row]
    for bogie in range(2):
        shift = 0.0
        for row in range(WHEELSETS):
            shift += e.stops[bogie, row] * w.at[row]
        push = h * stop_force(shift, e.stop_deflection, e.stop_force)
        if push != 0.0:
            for row in range(WHEELSETS):
                w.force[row] -= push * e.stops[bogie, row]
    for k in range(axle_load.shape[0]):
        w.force[WHEELSETS + 6 * k + Z_] -= h * axle_load[k]
    return heat


@loop
def _eliminate(a: Array, right: int) -> None:
    """Solve the equations in `a` (6, 6 + right sides) in place, with pivots from the column."""
    for column in range(6):
        best = column
        for row in range(column + 1, 6):
            if abs(a[row, column]) > abs(a[best, column]):
                best = row
        if best != column:
            for n in range(column, 6 + right):
                a[column, n], a[best, n] = a[best, n], a[column, n]
        inverse = 1.0 / a[column, column]
        for n in range(column + 1, 6 + right):
            a[column, n] *= inverse
        for row in range(6):
            if row != column:
                factor = a[row, column]
                for n in range(column + 1, 6 + right):
                    a[row, n] -= factor * a[column, n]


@loop
def solve_wheelset(
    k: int, h: float, torque: float, bogie: int, inverse: Array, turning: float, change: Array, t: Touching
) -> None:  # fmt: skip
    """Bring the impulses of wheelset k up to date, and with them what all speeds change by.

    With G the wheelset's block of the inverse and y0 what its speeds change by but for its own impulses, they change by
    y = y0 + G (h F - S y). A wheelset that the brake would turn backwards is held: the brake gives `t.left` less.

    Parameters
    ----------
    torque : of the brake [N m], whole in `change`
    bogie : pitch of the bogie that the brake's reaction acts on
    turning : speed of the wheelset before the substep [rad/s]
    change : of all speeds so far (n,), changed in place

    """
    first, a, held = WHEELSETS + 6 * k, t.local, t.left[k]
    for row in range(6):
        for column in range(6):
            value = 1.0 if row == column else 0.0
            for n in range(6):
                value += inverse[first + row, first + n] * (t.normal_by[k, n, column] + t.creep_by[k, n, column])
            a[row, column] = value
        a[row, 7] = inverse[first + row, first + PITCH] - inverse[first + row, bogie]
        value = change[first + row] - held * a[row, 7]
        for n in range(6):
            value += inverse[first + row, first + n] * (h * (t.normal[k, n] + t.creep[k, n]) - t.given[k, n])
        a[row, 6] = value
    _eliminate(a, 2)
    left = 0.0
    if turning + a[PITCH, 6] <= 0.0:
        left = min(max(-(turning + a[PITCH, 6]) / a[PITCH, 7], 0.0), h * torque)
    for row in range(6):
        t.seen[k, row] = a[row, 6] + left * a[row, 7]
    for row in range(6):
        pressing, creeping = h * t.normal[k, row], h * t.creep[k, row]
        for n in range(6):
            pressing -= t.normal_by[k, row, n] * t.seen[k, n]
            creeping -= t.creep_by[k, row, n] * t.seen[k, n]
        further = pressing + creeping - t.given[k, row] + (left - held if row == PITCH else 0.0)
        for n in range(change.shape[0]):
            change[n] += further * inverse[first + row, n]
        t.given[k, row], t.crept[k, row] = pressing + creeping, creeping
    if left != held:
        for n in range(change.shape[0]):
            change[n] -= (left - held) * inverse[bogie, n]
    t.left[k] = left


@loop
def unsettled(k: int, change: Array, t: Touching) -> float:
    """Return by how much the impulses of wheelset k are off [N s], [N m s]: others have moved it since it was solved."""
    first, largest = WHEELSETS + 6 * k, 0.0
    for row in range(6):
        off = 0.0
        for n in range(6):
            off += (t.normal_by[k, row, n] + t.creep_by[k, row, n]) * (change[first + n] - t.seen[k, n])
        largest = max(largest, abs(off))
    return largest


@loop
def creep_work(k: int, share: float, speed: Array, change: Array, t: Touching) -> float:
    """Heat in the contacts of wheelset k in a substep or the `share` of it that is run: impulse times mean slip [J]."""
    first, spent = WHEELSETS + 6 * k, 0.0
    for row in range(6):
        mean = speed[first + row] + 0.5 * share * change[first + row]
        spent -= share * t.crept[k, row] * mean
    return spent
