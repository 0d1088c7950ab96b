"""Eigenfrequencies and static loads of the coach by an independent engine, exudyn (J. Gerstmayr; pip install exudyn==1.13.6).

    python -m experiments.multibody.reference

Prints what `tests/test_multibody_structure.py` compares with. Development only: nothing else needs exudyn. Bodies are rigid
with three rotations each, springs are between body-fixed points, wheelsets are held; the springs that carry weight have
the preload as an offset and keep their direction, as in the plant.
"""

import json
from typing import Any

import numpy as np

from wsp_env.parameters.uic_z1 import COACH

SIDES = (1.0, -1.0)


class Built:
    """The coach in exudyn, on held wheelsets; `preloaded`: it rests in the reference configuration."""

    def __init__(self, preloaded: bool) -> None:
        import exudyn

        self.exu, self.m, self.g = exudyn, COACH.multibody, COACH.gravity_mps2
        self.container = exudyn.SystemContainer()
        self.mbs = self.container.AddSystem()
        self.free: list[int] = []
        self.bodies: list[Any] = []  # exudyn's indices
        self.places: dict[int, np.ndarray] = {}
        self.preloaded = preloaded
        m, axles = self.m, -np.array(COACH.axle_positions_m)
        bogies = axles.reshape(2, 2).mean(axis=1)
        car_kg = m.carbody_kg(COACH.mass_kg, COACH.axles)
        scale = car_kg / m.carbody_mass_kg
        inertia = (m.carbody_inertia_xx_kgm2, m.carbody_inertia_yy_kgm2, m.carbody_inertia_zz_kgm2)
        car = self.body(car_kg, [scale * value for value in inertia], (bogies.mean(), 0.0, m.carbody_height_m), range(6))
        for b, x in enumerate(bogies):
            frame = (m.bogie_inertia_xx_kgm2, m.bogie_inertia_yy_kgm2, m.bogie_inertia_zz_kgm2)
            bogie = self.body(m.bogie_mass_kg, list(frame), (x, 0.0, m.bogie_height_m), range(6))
            self.secondary(car, bogie, float(x), car_kg)
            for k in (2 * b, 2 * b + 1):
                for side in SIDES:
                    self.primary(bogie, float(axles[k]), side, (car_kg / 2.0 + m.bogie_mass_kg) * self.g / 4.0)
        self.mbs.Assemble()

    def body(self, mass: float, inertia: list[float], place: tuple[float, float, float], free: range | tuple[int, ...]) -> Any:
        """Add a rigid body; only its coordinates `free` may move."""
        from exudyn.utilities import RigidBodyInertia

        number = self.mbs.CreateRigidBody(
            inertia=RigidBodyInertia(mass, np.diag(inertia)), nodeType=self.exu.NodeType.RotationRxyz,
            referencePosition=list(place), gravity=[0.0, 0.0, -self.g],
        )  # fmt: skip
        self.free += [6 * len(self.bodies) + own for own in free]
        self.bodies.append(number)
        self.places[int(number)] = np.array(place)
        return number

    def spring(self, first: Any, second: Any, point: tuple[float, float, float], k: list[float], carried: float) -> None:
        """Add a spring of stiffnesses k [N/m] along x, y, z at a point; `first` rests on `second` with `carried` [N]."""
        local = [np.array(point) - self.places[int(n)] for n in (first, second)]
        lifted = carried / k[2] if carried and self.preloaded else 0.0
        self.mbs.CreateCartesianSpringDamper(
            itemNumbers=[second, first], localPosition0=list(local[1]), localPosition1=list(local[0]), stiffness=k,
            damping=[0.0] * 3, offset=[0.0, 0.0, lifted],
        )  # fmt: skip

    def turning(self, first: Any, second: Any, point: tuple[float, float, float], k: list[float]) -> None:
        """Add a spring of stiffnesses k [N m/rad] about x, y, z."""
        local = [np.array(point) - self.places[int(n)] for n in (first, second)]
        self.mbs.CreateRigidBodySpringDamper(
            itemNumbers=[second, first], localPosition0=list(local[1]), localPosition1=list(local[0]),
            stiffness=np.diag([0.0, 0.0, 0.0, *k]), damping=np.zeros((6, 6)),
        )  # fmt: skip

    def secondary(self, car: Any, bogie: Any, x: float, car_kg: float) -> None:
        """Add springs, traction rod and anti-roll bar of a bogie."""
        m = self.m
        k = [m.secondary_stiffness_x_n_per_m, m.secondary_stiffness_y_n_per_m, m.secondary_stiffness_z_n_per_m]
        for side in SIDES:
            self.spring(car, bogie, (x, side * m.secondary_half_spacing_m, m.secondary_height_m), k, car_kg * self.g / 4.0)
        rod = [m.traction_rod_stiffness_n_per_m, 0.0, 0.0]
        self.spring(car, bogie, (x, 0.0, m.traction_rod_height_m), rod, 0.0)
        self.turning(car, bogie, (x, 0.0, m.bogie_height_m), [m.anti_roll_bar_nm_per_rad, 0.0, 0.0])

    def primary(self, bogie: Any, x: float, side: float, carried: float) -> None:
        """Add an axle box, which may only turn about its axle, and its springs."""
        m = self.m
        inertia = [m.axle_box_inertia_xx_kgm2, m.axle_box_inertia_yy_kgm2, m.axle_box_inertia_zz_kgm2]
        point = (x, side * m.primary_half_spacing_m, m.primary_height_m)
        box = self.body(m.axle_box_mass_kg, inertia, (point[0], point[1], COACH.wheel_radius_m), (4,))
        k = [m.primary_stiffness_x_n_per_m, m.primary_stiffness_y_n_per_m, m.primary_stiffness_z_n_per_m]
        self.spring(bogie, box, point, k, carried)
        self.turning(bogie, box, point, [m.primary_rotation_x_nm_per_rad, m.primary_rotation_y_nm_per_rad, 0.0])

    @property
    def held(self) -> list[int]:
        """Coordinates that may not move."""
        return [n for n in range(6 * len(self.bodies)) if n not in self.free]


def frequencies() -> list[float]:
    """Return the eigenfrequencies [Hz], rising."""
    built = Built(preloaded=True)
    values, _ = built.mbs.ComputeODE2Eigenvalues(constrainedCoordinates=built.held, convert2Frequencies=True)
    return sorted(float(value) for value in values)


def loads() -> list[float]:
    """Return what every axle carries [N] at rest: its springs' forces with its own weight."""
    built = Built(preloaded=False)
    m, mbs = built.m, built.mbs
    for index, number in enumerate(built.bodies):
        for own in range(6):
            if 6 * index + own not in built.free:
                _hold(built, mbs.GetObject(number)["nodeNumber"], own)
    mbs.Assemble()
    settings = built.exu.SimulationSettings()
    settings.solutionSettings.writeSolutionToFile = False
    mbs.SolveStatic(settings)
    own_n = (m.wheelset_mass_kg + 2.0 * m.axle_box_mass_kg) * built.g
    found = []
    for bogie, boxes in ((built.bodies[1], built.bodies[2:6]), (built.bodies[6], built.bodies[7:11])):
        for axle in (boxes[:2], boxes[2:]):
            carried = 0.0
            for box in axle:
                local = built.places[int(box)] - built.places[int(bogie)]
                sunk = mbs.GetObjectOutputBody(bogie, built.exu.OutputVariableType.Displacement, list(local))
                carried -= m.primary_stiffness_z_n_per_m * float(sunk[2])
            found.append(carried + own_n)
    return found


def _hold(built: Built, node: Any, coordinate: int) -> None:
    from exudyn.itemInterface import CoordinateConstraint, MarkerNodeCoordinate, NodePointGround

    ground = built.mbs.AddNode(NodePointGround())
    first = built.mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
    second = built.mbs.AddMarker(MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate))
    built.mbs.AddObject(CoordinateConstraint(markerNumbers=[first, second]))


def main() -> None:
    """Print frequencies [Hz] and axle loads [N]."""
    print(json.dumps({"frequencies_hz": [round(f, 5) for f in frequencies()], "axle_loads_n": [round(n, 2) for n in loads()]}))


if __name__ == "__main__":
    main()
