"""A plant of somebody else, in thirty lines: no wheel dynamics, deceleration up to what the friction gives."""

import numpy as np

from wsp_env.parameters.quantity import ParameterError
from wsp_env.plant.port import Conditions, Measurement, Plant, Truth


class PointMass(Plant):
    def __init__(self, vehicle, n, setup):
        if setup.mechanisms:
            raise ParameterError(f"a point mass knows no mechanism {', '.join(setup.mechanisms)}")
        self.vehicle, self.n, self.setup = vehicle, n, setup
        a, nodes = vehicle.axles, np.ones((n, setup.track_nodes))
        own = {"key": np.zeros(n, np.uint64), "radius": np.ones((n, a)), "profile": nodes, "coverage": nodes.copy()}
        self.conditions = Conditions(**{name: own.get(name, np.zeros(n)) for name in Conditions._fields})
        wide = {"wheel_speed", "slip_speed", "pressure", "adhesion", "adhesion_d", "adhesion_r", "air", "contact_work"}
        self._truth = Truth(*(np.zeros((n, a) if name in wide else n) for name in Truth._fields))
        self.moving = np.zeros(n, dtype=bool)

    def start(self, index, stop, mechanisms=None):
        for array in self._truth:
            array[index] = 0.0
        for name, array in self.conditions._asdict().items():
            array[index] = getattr(stop, name)
        self._truth.speed[index], self.moving[index] = stop.initial_speed, True
        self._truth.wheel_speed[index] = stop.initial_speed / stop.radius
        self._truth.distributor[index] = 3.8 * stop.demand

    def step(self, command):
        t, c, h = self._truth, self.conditions, self.setup.control_interval_s * self.moving
        wanted = np.clip(t.pressure + command * 8.0 * h[:, None], 0.0, 3.8)
        t.pressure[:] = np.where(self.moving[:, None], wanted, t.pressure)
        t.adhesion[:] = np.minimum(0.03 * t.pressure * c.demand[:, None], 2.0 * c.mu_cd[:, None])
        t.deceleration[:] = 9.81 * t.adhesion.mean(axis=1)
        t.position[:] += t.speed * h
        t.speed[:] = np.maximum(t.speed - t.deceleration * h, 0.0)
        t.slip_speed[:] = 0.2 * t.adhesion * t.speed[:, None]
        t.wheel_speed[:] = (t.speed[:, None] - t.slip_speed) / c.radius
        t.time[:] += h
        self.moving &= t.speed > 0.0

    def reading(self):
        t = self._truth
        return Measurement(t.time.copy(), t.wheel_speed.copy(), self.conditions.demand.copy(), t.pressure.copy())

    def truth(self):
        return self._truth

    def preview(self, then=None):
        return np.clip(self._truth.pressure + 8.0 * self.setup.control_interval_s * (then or 0.0), 0.0, 3.8)
