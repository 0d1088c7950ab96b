"""One control interval of the multibody plant: the compiled step.

The equations of motion M du/dt = -C (u + dg/dt) - K (q + g) + F, with F of contacts, brakes, stops, weight and the frames' motion
and g what the frames of the bodies are shifted against each other in a curve, are integrated linearly implicitly: springs, dampers
and normal contact forces by the theta method (0.5: the midpoint rule), creep forces, which are stiff at low speed, by Euler's
implicit one, all with one linear solution a substep:

    (M + theta h C + (theta h)^2 K + S) du = h F(q + theta h u, u) - ...,   q' = q + h (u + theta du)

The matrix without S is inverted once a stop. S is what the contacts of the wheelsets add; it is solved wheelset by wheelset with
the wheelset's own block of the inverse (what wheelsets do to each other through the suspension within a substep is left out of S
only). A wheelset that comes to rest within a substep is held, and its brake's torque becomes a reaction.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wsp_env.compiled import inlined, loop, rebuilder
from wsp_env.contact.port import law_at
from wsp_env.parameters.uic_z1 import COACH
from wsp_env.plant.components import brake
from wsp_env.plant.longitudinal.axles import (
    TORQUE,
    Stepping,
    believed_resistance,
    brake_axle,
    notice,
    read_sensors,
    turn_axle,
)
from wsp_env.plant.longitudinal.doing import moment
from wsp_env.plant.longitudinal.state import batch
from wsp_env.plant.mechanisms import NULL, Active, mechanisms_at
from wsp_env.plant.multibody.bodies import NOT_FINITE, OFF_THE_RAIL, SOUND, Bodies, BodyConstants, Scratch
from wsp_env.plant.multibody.structure import PITCH, ROLL, WHEELSETS, Y_, YAW, Z_
from wsp_env.plant.multibody.way import here
from wsp_env.plant.multibody.wheels import touch
from wsp_env.plant.port import Setup
from wsp_env.plant.slots import before_contact_acts, resistance

Array = NDArray[np.float64]


@loop
def _subtract_product(matrix: Array, vector: Array, result: Array) -> None:
    """Subtract matrix (n, n), symmetric, times vector (n,) from the result (n,)."""
    n = vector.shape[0]
    for row in range(n):
        value = vector[row]
        if value != 0.0:
            for column in range(n):
                result[column] -= value * matrix[row, column]


@inlined
def _stop_force(shift: float, b: BodyConstants) -> float:
    """Force of a bump-stop [N] at a lateral shift [m], against it."""
    x, f, last = b.stop_deflection, b.stop_force, b.stop_deflection.shape[0] - 1
    deep = abs(shift)
    if deep <= x[0]:
        return 0.0
    n = 1
    while n < last and x[n] < deep:
        n += 1
    size = f[n - 1] + (deep - x[n - 1]) * (f[n] - f[n - 1]) / (x[n] - x[n - 1])
    return size if shift > 0.0 else -size


@inlined
def _turn_frames(i: int, on_step: Stepping, m: Bodies, b: BodyConstants, w: Scratch) -> None:
    """Add what a curve does: shifts of the frames against that of the carbody, and forces of their motion and tilt."""
    state, _, p, _, _, _, _ = on_step
    h = p.substep
    speed, ahead = state.speed[i], state.position[i] + b.theta * h * state.speed[i]
    centre = here(ahead + b.place[0], b.way)
    for body in range(b.place.shape[0]):
        first, distance = 6 * body, b.place[body] - b.place[0]
        own = here(ahead + b.place[body], b.way)
        mass = m.mass[i, first + Y_]
        tilt, tilting = own.tilt - centre.tilt, speed * (own.tilt_rate - centre.tilt_rate)
        w.at[first + Y_] += own.across - centre.across - centre.heading * distance - b.height[body] * tilt
        w.at[first + ROLL] += tilt
        w.at[first + YAW] += own.heading - centre.heading
        w.rate[first + Y_] += speed * (own.heading - centre.heading - centre.curvature * distance) - b.height[body] * tilting
        w.rate[first + ROLL] += tilting
        w.rate[first + YAW] += speed * (own.curvature - centre.curvature)
        outwards = speed * speed * own.curvature
        w.force[first + Y_] -= h * mass * (outwards + p.gravity * np.sin(own.tilt))
        w.force[first + Z_] += h * mass * (outwards * own.tilt + p.gravity * (1.0 - np.cos(own.tilt)))
        w.force[first + YAW] -= h * m.mass[i, first + YAW] * speed * speed * own.curvature_rate


@inlined
def _suspend(i: int, on_step: Stepping, m: Bodies, b: BodyConstants, w: Scratch) -> None:
    """Add the impulses of springs, dampers, stops and weight."""
    h = on_step.p.substep
    for n in range(w.at.shape[0]):
        w.force[n] -= h * m.hanging[i, n] * w.at[n]
        w.change[n] = 0.0
    if b.way.segments.shape[0] > 1:
        _turn_frames(i, on_step, m, b, w)
    _subtract_product(b.damping, w.rate, w.change)
    heat = 0.0
    for n in range(w.at.shape[0]):
        heat -= w.rate[n] * w.change[n]
    m.damper_work[i] += h * heat
    _subtract_product(b.stiffness, w.at, w.change)
    for n in range(w.at.shape[0]):
        w.force[n] += h * w.change[n]
    for side in range(2):
        shift = 0.0
        for n in range(WHEELSETS):
            shift += b.stops[side, n] * w.at[n]
        push = _stop_force(shift, b)
        if push != 0.0:
            for n in range(WHEELSETS):
                w.force[n] -= h * push * b.stops[side, n]
    for k in range(m.axle_load.shape[1]):
        w.force[WHEELSETS + 6 * k + Z_] -= h * m.axle_load[i, k]


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


@inlined
def _solve_wheelset(i: int, k: int, h: float, torque: float, m: Bodies, b: BodyConstants, w: Scratch) -> float:
    """Write the impulse of the contacts of wheelset k; return the part of its brake's impulse that a held wheelset leaves [N m s].

    With G the wheelset's block of the inverse and y0 what it changes by without contacts: y = y0 + G (h F - S y).
    """
    first, a = WHEELSETS + 6 * k, w.local
    bogie = b.bogie_of[k] + PITCH
    for row in range(6):
        for column in range(6):
            value = 1.0 if row == column else 0.0
            for n in range(6):
                value += m.inverse[i, first + row, first + n] * (w.normal_by[k, n, column] + w.creep_by[k, n, column])
            a[row, column] = value
        value = w.change[first + row]
        for n in range(6):
            value += m.inverse[i, first + row, first + n] * h * (w.normal[k, n] + w.creep[k, n])
        a[row, 6] = value
        a[row, 7] = m.inverse[i, first + row, first + PITCH] - m.inverse[i, first + row, bogie]
    _eliminate(a, 2)
    turning = m.speed[i, first + PITCH]
    left = 0.0
    if turning + a[PITCH, 6] <= 0.0:  # the brake would turn it backwards: it takes up what holds the wheelset
        left = min(max(-(turning + a[PITCH, 6]) / a[PITCH, 7], 0.0), h * torque)
    for row in range(6):
        a[row, 6] += left * a[row, 7]
    for row in range(6):
        value = h * (w.normal[k, row] + w.creep[k, row])
        for n in range(6):
            value -= (w.normal_by[k, row, n] + w.creep_by[k, row, n]) * a[n, 6]
        w.impulse[k, row] = value
    return left


@loop
def _add_impulses(force: Array, inverse: Array, change: Array) -> None:
    """Add what impulses (n,) change in the speeds (n,)."""
    n = change.shape[0]
    for row in range(n):
        value = force[row]
        if value != 0.0:
            for column in range(n):
                change[column] += value * inverse[row, column]


@inlined
def _substep(i: int, j: int, on_step: Stepping, m: Bodies, b: BodyConstants, w: Scratch) -> bool:
    """Advance vehicle i by substep j of the control interval; True when it has stopped or left the track."""
    state, c, p, _, active, work, _ = on_step
    h, axles, n_all = p.substep, state.wheel_speed.shape[1], w.at.shape[0]
    speed, last = state.speed[i], state.deceleration[i]
    if before_contact_acts(active):
        notice(i, on_step)
    for n in range(n_all):
        w.at[n] = m.position[i, n] + b.theta * h * m.speed[i, n]
        w.rate[n] = m.speed[i, n]
        w.force[n] = 0.0
    for k in range(axles):
        ahead = state.position[i] - p.axle_offset[k] + b.theta * h * speed
        curvature = here(ahead, b.way).curvature
        if not touch(i, k, j, curvature, on_step, m, b, w):
            m.fault[i, 0], m.fault[i, 1] = OFF_THE_RAIL, k
    _suspend(i, on_step, m, b, w)
    distributor = brake.distribute(i, c.demand[i], h, state.brake, p.brake)
    for k in range(axles):
        brake_axle(i, k, j * h, distributor, last, on_step)
        w.force[WHEELSETS + 6 * k + PITCH] -= h * work[TORQUE, k]
        w.force[b.bogie_of[k] + PITCH] += h * work[TORQUE, k]
    middle = speed - 0.5 * h * last
    resisted = resistance(i, middle, believed_resistance(i, middle, c, p), moment(i, 0.5 * h, last, state, p), active)
    for body in range(3 + axles):
        w.force[6 * body] -= h * resisted * m.mass[i, 6 * body] / c.mass[i]
    for n in range(n_all):
        w.change[n] = 0.0
    _add_impulses(w.force, m.inverse[i], w.change)
    for n in range(n_all):
        w.force[n] = 0.0
    for k in range(axles):
        left = _solve_wheelset(i, k, h, work[TORQUE, k], m, b, w)
        work[TORQUE, k] -= left / h
        for row in range(6):
            w.force[WHEELSETS + 6 * k + row] += w.impulse[k, row]
        w.force[WHEELSETS + 6 * k + PITCH] += left
        w.force[b.bogie_of[k] + PITCH] -= left
    _add_impulses(w.force, m.inverse[i], w.change)
    return _move(i, resisted, on_step, m, b, w)


@inlined
def _move(i: int, resisted: float, on_step: Stepping, m: Bodies, b: BodyConstants, w: Scratch) -> bool:
    """Move all bodies to the end of the substep; True when the vehicle has stopped."""
    state, c, p, _, _, work, _ = on_step
    h, axles, speed = p.substep, state.wheel_speed.shape[1], state.speed[i]
    after = speed
    for body in range(3 + axles):
        after += m.mass[i, 6 * body] * w.change[6 * body] / c.mass[i]
    if not -1e3 < after < 1e3:
        m.fault[i, 0] = NOT_FINITE
    if m.fault[i, 0] != SOUND:
        return True
    stopped = after <= 0.0
    share = speed / (speed - after) if stopped else 1.0
    travelled = 0.5 * h * share * (speed + max(after, 0.0))
    state.resistance_work[i] += resisted * travelled
    for k in range(axles):
        first = WHEELSETS + 6 * k
        spent = 0.0
        for row in range(6):
            creeping = h * w.creep[k, row]
            for n in range(6):
                creeping -= w.creep_by[k, row, n] * w.change[first + n]
            spent -= creeping * (m.speed[i, first + row] + 0.5 * w.change[first + row])
        wheel = 0.0 if stopped else max(m.speed[i, first + PITCH] + w.change[first + PITCH], 0.0)
        turn_axle(i, k, h * share, wheel, work[TORQUE, k], share * spent, travelled, on_step)
    drift = speed + b.theta * (after - speed)
    for n in range(w.at.shape[0]):
        m.position[i, n] += h * share * (m.speed[i, n] + b.theta * w.change[n])
        m.speed[i, n] = 0.0 if stopped else m.speed[i, n] + w.change[n]
    for body in range(3 + axles):
        m.position[i, 6 * body] -= h * share * drift
    for k in range(axles):
        m.speed[i, WHEELSETS + 6 * k + PITCH] = state.wheel_speed[i, k]
    state.deceleration[i] = (speed - after) / h
    state.speed[i] = max(after, 0.0)
    state.position[i] += travelled
    state.time[i] += h * share
    return stopped


_batch = rebuilder(batch(1, COACH, Setup(), NULL))


@loop
def advance(
    command: np.ndarray, believed: Any, given: Any, moving: np.ndarray, work: np.ndarray, m: Bodies, b: BodyConstants,
    w: Scratch,
) -> None:  # fmt: skip
    """Advance every vehicle that moves by one control interval.

    Parameters
    ----------
    command : (N, A) see `wsp_env.plant.command`
    believed : the vehicle's traction law: the type of what the mechanisms make of it
    given : a `wsp_env.plant.longitudinal.state.Batch` as `plain` tuples; its state is changed in place
    moving : (N,) bool, changed in place: False once a vehicle stands or was given up; such a vehicle is left as it is
    work : (ROWS, A) scratch
    m, b, w : the bodies, changed in place, their constants, scratch

    """
    state, c, physics, p = _batch(given)
    for i in range(command.shape[0]):
        if not moving[i]:
            continue
        law = law_at(believed, physics.law, i)
        active = Active(mechanisms_at(physics.mechanisms, i), p.derived, state.memory)
        on_step = Stepping(state, c, p, law, active, work, physics.inertia)
        brake.receive(i, command, state.brake)
        for j in range(p.substeps):
            if _substep(i, j, on_step, m, b, w):
                moving[i] = False
                break
        read_sensors(i, state, c, p, active)
