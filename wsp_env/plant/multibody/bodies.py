"""The arrays of the multibody plant beside those that every plant has: what moves, and what stays."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wsp_env.contact.geometry.patch import PatchTable
from wsp_env.contact.geometry.port import CONTACTS, Contact, Pair
from wsp_env.plant.multibody.way import Way

Array = NDArray[np.float64]

#: Why a stop was given up; see `wsp_env.plant.multibody.plant.REASONS`.
SOUND, OFF_THE_RAIL, NOT_FINITE = range(3)


class Bodies(NamedTuple):
    """N vehicles of n coordinates (see `structure`) and A wheelsets; sides are left and right."""

    position: Array  # (N, n) [m], [rad]; along the track against the centre of mass
    speed: Array  # (N, n) [m/s], [rad/s]
    mass: Array  # (N, n) diagonal of M
    inverse: Array  # (N, n, n) of M + theta h C + (theta h)^2 K
    hanging: Array  # (N, n) stiffness that the preloads add
    axle_load: Array  # (N, A) vertical force of both wheels at rest [N]
    rows: Array  # (N, A, 2, CONTACTS, fields) contacts, see `wsp_env.contact.geometry.port`
    wheel_load: Array  # (N, A, 2) vertical force on the rail, Q [N]
    guiding: Array  # (N, A, 2) lateral force on the rail, outwards, Y [N]
    shift: Array  # (N, A) of the wheelset against the track, to the left [m]
    damper_work: Array  # (N,) heat in the dampers [J]
    fault: NDArray[np.int64]  # (N, 2) why a stop was given up, and the wheelset, from 0


class Elements(NamedTuple):
    """Force elements of the suspensions, and where the bodies are."""

    stiffness: Array  # (n, n) of the springs
    damping: Array  # (n, n)
    stops: Array  # (2, n) lateral shift over each bogie per coordinate
    stop_deflection: Array  # (m,) [m]
    stop_force: Array  # (m,) [N]
    place: Array  # (3 + A,) of the bodies ahead of the leading axle [m]
    height: Array  # (3 + A,) of their centres of mass [m]


class Rolling(NamedTuple):
    """What the contacts of all wheels share."""

    pair: Pair
    table: PatchTable
    damping: float  # [s/m]
    reference: float  # pi G a b c11 / 4 that the law's stiffness belongs to [N]
    radius: float  # nominal [m]
    widest: float  # lateral shift of a wheelset beyond which it counts as derailed [m]
    highest: float  # the same of its lift [m]


class BodyConstants(NamedTuple):
    """What is the same in every stop of a batch."""

    elements: Elements
    rolling: Rolling
    way: Way
    bogie_of: NDArray[np.int64]  # (A,) first coordinate of the bogie that the axle carries
    theta: float  # where in a substep springs and contacts are evaluated, 0.5 to 1


class Motion(NamedTuple):
    """One substep of one vehicle."""

    at: Array  # (n,) coordinates where the substep evaluates them, before what it changes
    rate: Array  # (n,) speeds with those of the frames
    force: Array  # (n,) impulse of all but the contacts [N s], [N m s]
    change: Array  # (n,) of the speeds


class Touching(NamedTuple):
    """The contacts of the wheelsets in one substep."""

    normal: Array  # (A, 6) normal forces on the wheelset's coordinates
    creep: Array  # (A, 6) creep forces
    normal_by: Array  # (A, 6, 6) impulse that a change of the speeds takes away, of the normal forces
    creep_by: Array  # (A, 6, 6) the same of the creep forces
    given: Array  # (A, 6) impulse of the contacts [N s], [N m s]
    seen: Array  # (A, 6) change of its speeds that a wheelset was last solved with [m/s], [rad/s]
    crept: Array  # (A, 6) that of the creep forces
    left: Array  # (A,) what the brake of a held wheelset does not give [N m s]
    along: Array  # (3, 6) what the contact at hand moves forwards, across and along its normal per coordinate
    local: Array  # (6, 8) a wheelset's equations


class Scratch(NamedTuple):
    """What a step works on."""

    motion: Motion
    touching: Touching


def allocate(n: int, coordinates: int, axles: int) -> Bodies:
    """Return the bodies of n vehicles."""
    wheels, fields = (n, axles, 2), len(Contact._fields)
    return Bodies(
        position=np.zeros((n, coordinates)),
        speed=np.zeros((n, coordinates)),
        mass=np.zeros((n, coordinates)),
        inverse=np.zeros((n, coordinates, coordinates)),
        hanging=np.zeros((n, coordinates)),
        axle_load=np.zeros((n, axles)),
        rows=np.full((*wheels, CONTACTS, fields), -np.inf),
        wheel_load=np.zeros(wheels),
        guiding=np.zeros(wheels),
        shift=np.zeros((n, axles)),
        damper_work=np.zeros(n),
        fault=np.zeros((n, 2), dtype=np.int64),
    )


def scratch(coordinates: int, axles: int) -> Scratch:
    """Return what a step works on."""
    sizes: list[Any] = [(axles, 6)] * 2 + [(axles, 6, 6)] * 2 + [(axles, 6)] * 3 + [(axles,), (3, 6), (6, 8)]
    return Scratch(Motion(*(np.zeros(coordinates) for _ in range(4))), Touching(*(np.zeros(size) for size in sizes)))
