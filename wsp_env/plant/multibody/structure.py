"""Bodies and force elements of a vehicle on two bogies as constant matrices M, C, K.

Frame: x forward, y to the left, z up; every body moves by small displacements against the track's frame at its own place, only
forward motion and the wheelsets' turning are large. The n = 18 + 8 A degrees of freedom of A wheelsets:

=========  =====================  ==============================================================================
carbody    0 to 5                 x, y, z, roll (left side up), pitch (nose down), yaw (nose to the left)
bogies     6 + 6 b                the same
wheelsets  18 + 6 k               the same; pitch is the turning about the axle
axle box   18 + 6 A + 2 k + side  pitch alone: hinged on its axle; side 0 is left, 1 is right
=========  =====================  ==============================================================================

An element between two bodies has the stiffnesses k and dampings c of its six directions: with B, what its ends move against
each other per coordinate, K = sum B^T k B and C = sum B^T c B. All coordinates are zero at rest, where the springs carry the
weight. The vertical preloads stay vertical at body-fixed points (assumption), which adds f Z to the stiffness in roll and pitch
of a body on which a force f acts at the height Z above its centre of mass: a carbody on springs below it is a pendulum upside
down.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wsp_env.parameters.multibody import Multibody
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.vehicle import Vehicle

Array = NDArray[np.float64]

X_, Y_, Z_, ROLL, PITCH, YAW = range(6)
CARBODY, BOGIES, WHEELSETS = 0, 6, 18
#: Left and right.
SIDES = (1.0, -1.0)


class Structure(NamedTuple):
    """A vehicle on two bogies with A axles and n degrees of freedom."""

    mass: Array  # (n,) diagonal of M [kg], [kg m2]
    damping: Array  # (n, n) C
    stiffness: Array  # (n, n) K of the springs
    hanging: Array  # (n,) diagonal of the stiffness that the preloads add
    bump_stops: Array  # (2, n) lateral shift of the carbody over each bogie per coordinate [-], [m]
    axle_load: Array  # (A,) vertical force of both wheels at rest [N]
    bogie_of: NDArray[np.int64]  # (A,) first coordinate of the bogie that the axle carries
    place: Array  # (3 + A,) of carbody, bogies, wheelsets ahead of the leading axle [m]
    height: Array  # (3 + A,) of their centres of mass above the rails' tops [m]


def coordinates(axles: int) -> int:
    """Return the number n of degrees of freedom."""
    return WHEELSETS + 8 * axles


def assemble(vehicle: Vehicle, mass_kg: float | None = None) -> Structure:
    """Return the matrices of a vehicle of `mass_kg`; the carbody has what the other bodies leave of it.

    `ParameterError` for a vehicle that does not run on two bogies or leaves its carbody no mass.
    """
    if len(vehicle.running_gear) != 1 or len(vehicle.running_gear[0]) != 2:
        raise ParameterError(
            f"{vehicle.name} has bodies = {vehicle.running_gear}: the multibody plant takes one body on two bogies, such as "
            "the coach's ((2, 2),)"
        )
    m, counts = vehicle.multibody, vehicle.running_gear[0]
    axle_x = -np.array(vehicle.axle_positions_m)
    of_axle = np.repeat([0, 1], counts)
    bogie_x = np.array([axle_x[of_axle == b].mean() for b in (0, 1)])
    carbody_kg = m.carbody_kg(vehicle.mass_kg if mass_kg is None else mass_kg, vehicle.axles)
    place = np.concatenate([[np.average(bogie_x, weights=counts)], bogie_x, axle_x])
    height = np.array([m.carbody_height_m, m.bogie_height_m, m.bogie_height_m, *[vehicle.wheel_radius_m] * vehicle.axles])
    made = _Assembly(m, vehicle, place, height)
    levers = (place[0] - bogie_x[::-1]) / (bogie_x - bogie_x[::-1])
    loads = []
    for b, count in enumerate(counts):
        on_bogie = carbody_kg * vehicle.gravity_mps2 * levers[b]
        made.secondary(b, on_bogie / 2.0)
        on_boxes = (on_bogie + m.bogie_mass_kg * vehicle.gravity_mps2) / count
        for k in np.flatnonzero(of_axle == b):
            made.primary(b, int(k), on_boxes / 2.0)
            loads.append(on_boxes + (m.wheelset_mass_kg + 2.0 * m.axle_box_mass_kg) * vehicle.gravity_mps2)
    return Structure(
        _masses(m, vehicle, carbody_kg), made.damping, made.stiffness, made.hanging, made.stops, np.array(loads),
        BOGIES + 6 * of_axle.astype(np.int64), place, height,
    )  # fmt: skip


def _masses(m: Multibody, vehicle: Vehicle, carbody_kg: float) -> Array:
    """Return the diagonal of M; an axle box moves with its wheelset but for its pitch."""
    scale = carbody_kg / m.carbody_mass_kg
    car = [carbody_kg] * 3 + [
        scale * m.carbody_inertia_xx_kgm2, scale * m.carbody_inertia_yy_kgm2, scale * m.carbody_inertia_zz_kgm2,
    ]  # fmt: skip
    bogie = [m.bogie_mass_kg] * 3 + [m.bogie_inertia_xx_kgm2, m.bogie_inertia_yy_kgm2, m.bogie_inertia_zz_kgm2]
    arm = m.axle_box_mass_kg * m.primary_half_spacing_m**2
    wheelset = [m.wheelset_mass_kg + 2.0 * m.axle_box_mass_kg] * 3 + [
        m.wheelset_inertia_xx_kgm2 + 2.0 * (m.axle_box_inertia_xx_kgm2 + arm),
        vehicle.wheelset_inertia_kgm2,
        m.wheelset_inertia_xx_kgm2 + 2.0 * (m.axle_box_inertia_zz_kgm2 + arm),
    ]
    return np.array(car + 2 * bogie + vehicle.axles * wheelset + 2 * vehicle.axles * [m.axle_box_inertia_yy_kgm2])


class _Assembly:
    """Adds the force elements one by one."""

    def __init__(self, m: Multibody, vehicle: Vehicle, place: Array, height: Array) -> None:
        self.m, self.place, self.height, self.axles = m, place, height, vehicle.axles
        self.n = coordinates(vehicle.axles)
        self.damping, self.stiffness = np.zeros((self.n, self.n)), np.zeros((self.n, self.n))
        self.hanging, self.stops = np.zeros(self.n), np.zeros((2, self.n))

    def _moved(self, body: int, point: tuple[float, float, float]) -> Array:
        """Return what a point of carbody 0, bogies 1, 2, wheelsets 3 ... moves and turns per coordinate (6, n)."""
        first = 6 * body
        x, y, z = point[0] - self.place[body], point[1], point[2] - self.height[body]
        rows = np.zeros((6, self.n))
        rows[:, first : first + 6] = np.eye(6)
        rows[X_, first + PITCH], rows[X_, first + YAW] = z, -y
        rows[Y_, first + YAW], rows[Y_, first + ROLL] = x, -z
        rows[Z_, first + ROLL], rows[Z_, first + PITCH] = y, -x
        return rows

    def _box_moved(self, k: int, side: int, point: tuple[float, float, float]) -> Array:
        """Return the same for an axle box, whose pitch is its own."""
        rows = self._moved(3 + k, point)
        own, shared = WHEELSETS + 6 * self.axles + 2 * k + side, WHEELSETS + 6 * k + PITCH
        rows[:, own], rows[:, shared] = rows[:, shared].copy(), 0.0
        return rows

    def _add(self, moved: Array, stiffness: tuple[float, ...], damping: tuple[float, ...]) -> None:
        self.stiffness += moved.T @ (np.array(stiffness)[:, None] * moved)
        self.damping += moved.T @ (np.array(damping)[:, None] * moved)

    def secondary(self, b: int, preload: float) -> None:
        """Add springs, dampers, anti-roll bar, traction rod and bump-stop of bogie b."""
        m, x = self.m, self.place[1 + b]
        for side in SIDES:
            point = (x, side * m.secondary_half_spacing_m, m.secondary_height_m)
            k = (m.secondary_stiffness_x_n_per_m, m.secondary_stiffness_y_n_per_m, m.secondary_stiffness_z_n_per_m)
            c = (m.secondary_damping_x_ns_per_m, m.secondary_damping_y_ns_per_m, m.secondary_damping_z_ns_per_m)
            self._add(self._moved(0, point) - self._moved(1 + b, point), (*k, 0.0, 0.0, 0.0), (*c, 0.0, 0.0, 0.0))
            for body, force in ((0, preload), (1 + b, -preload)):
                self._hang(6 * body + ROLL, 6 * body + PITCH, force, point[2] - self.height[body])
        whole = self._moved(0, (x, 0.0, 0.0)) - self._moved(1 + b, (x, 0.0, 0.0))
        self._add(whole, (0.0, 0.0, 0.0, m.anti_roll_bar_nm_per_rad, 0.0, 0.0), (0.0,) * 6)
        rod = (x, 0.0, m.traction_rod_height_m)
        k, c = (m.traction_rod_stiffness_n_per_m, 0.0, 0.0), (m.traction_rod_damping_ns_per_m, 0.0, 0.0)
        self._add(self._moved(0, rod) - self._moved(1 + b, rod), (*k, 0.0, 0.0, 0.0), (*c, 0.0, 0.0, 0.0))
        stop = (x, 0.0, m.bump_stop_height_m)
        self.stops[b] = (self._moved(0, stop) - self._moved(1 + b, stop))[Y_]

    def primary(self, b: int, k: int, preload: float) -> None:
        """Add springs and dampers between bogie b and the axle boxes of wheelset k."""
        m = self.m
        stiffness = (
            m.primary_stiffness_x_n_per_m, m.primary_stiffness_y_n_per_m, m.primary_stiffness_z_n_per_m,
            m.primary_rotation_x_nm_per_rad, m.primary_rotation_y_nm_per_rad, 0.0,
        )  # fmt: skip
        turning = m.primary_rotation_damping_nms_per_rad
        damping = (
            m.primary_damping_x_ns_per_m, m.primary_damping_y_ns_per_m, m.primary_damping_z_ns_per_m, turning, turning, 0.0,
        )  # fmt: skip
        for side, y in enumerate(SIDES):
            point = (self.place[3 + k], y * m.primary_half_spacing_m, m.primary_height_m)
            self._add(self._moved(1 + b, point) - self._box_moved(k, side, point), stiffness, damping)
            bogie, wheelset, box = 6 * (1 + b), WHEELSETS + 6 * k, WHEELSETS + 6 * self.axles + 2 * k + side
            self._hang(bogie + ROLL, bogie + PITCH, preload, point[2] - self.height[1 + b])
            self._hang(wheelset + ROLL, box, -preload, point[2] - self.height[3 + k])

    def _hang(self, roll: int, pitch: int, force: float, above: float) -> None:
        """Let a vertical force act at a point so far above the centre of mass."""
        self.hanging[roll] += force * above
        self.hanging[pitch] += force * above
