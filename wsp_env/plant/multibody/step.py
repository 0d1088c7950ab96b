"""One control interval of the multibody plant: the compiled step.

The equations of motion M du/dt = -C (u + dg/dt) - K (q + g) + F hold for the coordinates q and speeds u, with F of contacts,
brakes, stops, weight and the frames' motion, and g what the frames of the bodies are shifted against each other in a curve.
They are integrated linearly implicitly: springs, dampers and normal contact forces by the theta method (0.5: the midpoint
rule), creep forces, which are stiff at low speed, by Euler's implicit one, all with one linear solution a substep:

    (M + theta h C + (theta h)^2 K + S) du = h (F - C (u + dg/dt) - K (q + theta h u + g)),   q' = q + h (u + theta du)

The matrix without S is inverted once a stop. S is what the contacts of the wheelsets add. Wheelsets are solved one after the
other with their own blocks of the inverse, each from what those before it have changed, again and again until none is moved any
more (Gauss and Seidel's method; S and the inverse are symmetric, so it converges). On springs once is enough; where wheelsets
hang together rigidly, the vehicle would never come to rest with less. A wheelset that comes to rest within a substep is held,
and its brake's torque becomes a reaction.
"""

from typing import Any

import numpy as np

from wsp_env.compiled import inlined, loop
from wsp_env.plant.components import brake
from wsp_env.plant.longitudinal.axles import (
    TORQUE,
    Stepping,
    believed_resistance,
    brake_axle,
    notice,
    turn_axle,
)
from wsp_env.plant.longitudinal.doing import moment
from wsp_env.plant.longitudinal.interval import advance_by
from wsp_env.plant.multibody.bodies import NOT_FINITE, OFF_THE_RAIL, SOUND, Bodies, BodyConstants, Scratch
from wsp_env.plant.multibody.structure import PITCH, WHEELSETS
from wsp_env.plant.multibody.suspension import add_product, creep_work, solve_wheelset, suspend, unsettled
from wsp_env.plant.multibody.way import here
from wsp_env.plant.multibody.wheels import touch
from wsp_env.plant.slots import before_contact_acts, resistance

#: Sum of the changes of all speeds [m/s], [rad/s] in a substep beyond which a motion is none any more.
_LARGEST_CHANGE = 1e4

#: Wheelsets are solved anew while impulses are off by more than this share of their weight's [-]: far below what adhesion is
#: known by. The coach's, on their springs, are within 5e-6 at once; those of the blocked vehicle take two to four rounds.
_SETTLED = 1e-4
#: Most rounds (assumption).
_ROUNDS = 40

#: What this plant's substep works on beside the arrays of all plants.
More = tuple[Bodies, BodyConstants, Scratch]


@inlined
def _substep(i: int, j: int, on_step: Stepping, more: More) -> bool:
    """Advance vehicle i by substep j of the control interval; True when it has stopped or left the track."""
    m, b, w = more
    state, c, p, _, active, work, _ = on_step
    h, axles, motion = p.substep, state.wheel_speed.shape[1], w.motion
    speed, last = state.speed[i], state.deceleration[i]
    if before_contact_acts(active):
        notice(i, on_step)
    for n in range(motion.at.shape[0]):
        motion.at[n] = m.position[i, n] + b.theta * h * m.speed[i, n]
        motion.rate[n] = m.speed[i, n]
    ahead = state.position[i] + b.theta * h * speed
    for k in range(axles):
        curvature = here(ahead - p.axle_offset[k], b.way.segments).curvature
        if not touch(i, k, j, curvature, on_step, m, b, w):
            m.fault[i, 0], m.fault[i, 1] = OFF_THE_RAIL, k
    m.damper_work[i] += suspend(
        h, ahead, speed, p.gravity, (m.mass[i], m.hanging[i], m.axle_load[i]), b.way.segments, b.elements, motion
    )
    distributor = brake.distribute(i, c.demand[i], h, state.brake, p.brake)
    for k in range(axles):
        brake_axle(i, k, j * h, distributor, last, on_step)
        motion.force[WHEELSETS + 6 * k + PITCH] -= h * work[TORQUE, k]
        motion.force[b.bogie_of[k] + PITCH] += h * work[TORQUE, k]
    middle = speed - 0.5 * h * last
    resisted = resistance(i, middle, believed_resistance(i, middle, c, p), moment(i, 0.5 * h, last, state, p), active)
    for body in range(3 + axles):  # like a gradient, on every body (assumption for running resistance, which is small)
        motion.force[6 * body] -= h * resisted * m.mass[i, 6 * body] / c.mass[i]
    _solve(i, on_step, m, b, w)
    after, largest = speed, 0.0
    for body in range(3 + axles):
        after += m.mass[i, 6 * body] * motion.change[6 * body] / c.mass[i]
    for n in range(motion.change.shape[0]):
        largest += abs(motion.change[n])
    if not largest < _LARGEST_CHANGE:
        m.fault[i, 0] = NOT_FINITE
    if m.fault[i, 0] != SOUND:
        return True
    return _move(i, after, resisted, on_step, m, b, w)


@inlined
def _solve(i: int, on_step: Stepping, m: Bodies, b: BodyConstants, w: Scratch) -> None:
    """Turn the impulses into changes of the speeds, contacts and held wheelsets included, wheelset by wheelset."""
    p, work, motion = on_step.p, on_step.work, w.motion
    for n in range(motion.at.shape[0]):
        motion.change[n] = 0.0
    add_product(1.0, m.inverse[i], motion.force, motion.change)
    axles, h = work.shape[1], p.substep
    for k in range(axles):
        w.touching.left[k] = 0.0
        for row in range(6):
            w.touching.given[k, row] = 0.0
    for sweep in range(_ROUNDS):
        for n in range(axles):
            k = axles - 1 - n if sweep % 2 == 1 else n
            first, bogie = WHEELSETS + 6 * k, b.bogie_of[k] + PITCH
            turning = m.speed[i, first + PITCH]
            solve_wheelset(k, h, work[TORQUE, k], bogie, m.inverse[i], turning, motion.change, w.touching)
        settled = True
        for k in range(axles):
            settled = settled and unsettled(k, motion.change, w.touching) <= _SETTLED * h * m.axle_load[i, k]
        if settled:
            break
    for k in range(axles):
        work[TORQUE, k] -= w.touching.left[k] / h


@inlined
def _move(i: int, after: float, resisted: float, on_step: Stepping, m: Bodies, b: BodyConstants, w: Scratch) -> bool:
    """Move all bodies to the end of the substep, at which the vehicle runs with `after` [m/s]; True when it has stopped."""
    state, _, p, _, _, work, _ = on_step
    h, axles, speed, change = p.substep, state.wheel_speed.shape[1], state.speed[i], w.motion.change
    stopped = after <= 0.0
    state.deceleration[i] = (speed - after) / h
    share = 1.0
    if stopped:  # within the substep
        share = speed / (speed - after)
        after = 0.0
    h *= share
    travelled = 0.5 * h * (speed + after)
    state.resistance_work[i] += resisted * travelled
    for k in range(axles):
        spent = creep_work(k, share, m.speed[i], change, w.touching)
        turn = WHEELSETS + 6 * k + PITCH
        wheel = 0.0 if stopped else max(m.speed[i, turn] + change[turn], 0.0)
        turn_axle(i, k, h, wheel, work[TORQUE, k], spent, travelled, on_step)
    for n in range(change.shape[0]):
        m.position[i, n] += h * (m.speed[i, n] + b.theta * change[n])
        m.speed[i, n] = 0.0 if stopped else m.speed[i, n] + change[n]
    for body in range(3 + axles):  # along the track against the centre of mass
        m.position[i, 6 * body] -= h * (speed + b.theta * (after - speed))
    for k in range(axles):
        m.speed[i, WHEELSETS + 6 * k + PITCH] = state.wheel_speed[i, k]
    state.speed[i] = after
    state.position[i] += travelled
    state.time[i] += h
    return stopped


@loop
def advance(
    command: np.ndarray, believed: Any, given: Any, moving: np.ndarray, work: np.ndarray, more: More
) -> None:  # fmt: skip
    """Advance every vehicle that moves by one control interval, see `advance_by`; `more`: bodies, their constants, scratch."""
    advance_by(_substep, command, believed, given, moving, work, more)
