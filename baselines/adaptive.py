"""Adaptive slip control: certainty-equivalent, on the project's own observer.

The observer (`wsp_env.observer`) estimates running speed, cylinder pressures, the adhesion that each wheelset uses and which
rail it brakes on. The controller believes it: it seeks the slip that is worth its price on that rail and steers each wheelset
there by its balance, as one does who knows all (`wsp_env.evaluation.reference`). A valve moves only when the brake is off the
wanted one by more than a dead band, and then until it is reached.
"""

import dataclasses
from typing import Any, NamedTuple

import numpy as np

from baselines.safety_timer import SafetyParameters
from wsp_env.compiled import inlined, loop, plain, rebuilder
from wsp_env.observer.guard import Guard
from wsp_env.observer.observation import Memory, Observer, ObserverConstants, constants_of, memory_of
from wsp_env.observer.worth import believe, slip_worth_its_price, weights_of
from wsp_env.parameters.quantity import ParameterError, quantity
from wsp_env.parameters.vehicle import Vehicle, check_vehicle
from wsp_env.plant.command import APPLIES, HOLDS, VENTS
from wsp_env.plant.port import Measurement

_TUNED = "assumption: chosen by the search of agents.rules, bogie, price 3, --air-price 0.1"

#: Time between two looks at which slip is worth its price [s]: the belief changes more slowly (assumption).
PLAN_S = 0.1

#: A wheelset does not slide while its recent and its slow slip are below this speed [m/s] or this creepage [-]: so much has a
#: wheel that rolls under brake (assumption).
ROLLS_MPS, ROLLS_CREEPAGE = 0.05, 0.003

#: Slip speed [m/s] below which the grip of a wheelset is not divided by it.
_LEAST_SLIP_MPS = 0.02

_GRAVITY_MPS2 = 9.81


@dataclasses.dataclass(frozen=True)
class AdaptiveParameters(SafetyParameters):
    """Price and gains."""

    slide_price: float = quantity(1.3562, "-", _TUNED + "; metres travelled that a metre of sliding is worth", 0.0, 100.0)
    settling_s: float = quantity(0.1675, "s", _TUNED + "; time constant by which the slip comes to the wanted one", 0.02, 5.0)
    dead_band: float = quantity(0.1868, "-", _TUNED + "; share of the wanted brake within which the valve rests", 0.0, 1.0)
    reached_share: float = quantity(0.3872, "-", _TUNED + "; share of the dead band at which a moving valve rests", 0.0, 1.0)
    smallest_slip_mps: float = quantity(0.03, "m/s", _TUNED + "; the least slip that is wanted", 0.0, 2.0)
    leading_creepage: float = quantity(
        0.0, "-", "least creepage of the leading axles, which clean the rail for the others", 0.0, 0.5
    )
    leading_axles: float = quantity(1.0, "-", "how many axles these are, from the front", 0.0, 64.0)
    pressure_sensors: float = quantity(0.0, "-", "1: the cylinder pressures are measured; 0: they are estimated", 0.0, 1.0)


class Settings(NamedTuple):
    """The parameters of one stop, by the names of the fields above."""

    slide_price: float
    settling_s: float
    dead_band: float
    reached_share: float
    smallest_slip_mps: float
    leading_creepage: float
    leading_axles: float


class Plan(NamedTuple):
    """What the controller itself remembers of N stops with A axles."""

    weights: np.ndarray  # (N, K) of the beliefs on the rail [-]
    since: np.ndarray  # (N,) the last plan [s]
    target: np.ndarray  # (N,) slip that is worth its price [m/s]
    command: np.ndarray  # (N, A) the last


class AdaptiveController:
    """Slip control towards what is worth its price on the believed rail.

    `wheels.failed` and `wheels.standing` (N, A) report sensors that are not believed and locked wheels.

    Parameters
    ----------
    parameters : price and gains

    """

    wheels: Guard

    def __init__(self, parameters: AdaptiveParameters | None = None) -> None:
        self.parameters = parameters or AdaptiveParameters()
        self._plan: Plan | None = None

    def reset(self, n: int, vehicle: Vehicle) -> None:
        """Begin n new stops."""
        check_vehicle(vehicle)
        self._vehicle = vehicle
        self._first: Measurement | None = None
        self._begun = False
        self._plan = Plan(weights_of(n), np.full(n, np.inf), np.zeros(n), np.ones((n, vehicle.axles)))
        columns = [np.broadcast_to(np.reshape(getattr(self.parameters, name), (-1,)), (n,)) for name in Settings._fields]
        self._settings = np.ascontiguousarray(np.stack(columns, axis=1), dtype=np.float64)

    def act(self, measurement: Measurement) -> np.ndarray:
        """Return the commands (N, A): -1 vent, 0 hold, +1 apply."""
        if self._plan is None:
            raise ParameterError("call reset(n, vehicle) before act")
        if not self._begun:
            if self._first is None:  # one measurement alone does not tell how often they come
                self._first = measurement._replace(
                    time=measurement.time.copy(), wheel_speed=measurement.wheel_speed.copy(), demand=measurement.demand.copy()
                )
                return self._plan.command.copy()
            interval = float(np.max(measurement.time - self._first.time))
            if not interval > 0.0:
                raise ParameterError(f"the first two measurements are {interval:g} s apart: time must rise")
            self._begin(self._first, interval)
        self.wheels.observe(measurement, self._plan.command)
        _control(self._settings, plain(self._plan), self._observer.state, self._observer.given)
        return self.wheels.overrule(self._plan.command).copy()

    def _begin(self, first: Measurement, interval: float) -> None:
        p, self._begun = self.parameters, True
        self._observer = Observer(self._vehicle, interval, pressure_sensors=bool(np.all(p.pressure_sensors)))
        self.wheels = Guard(self._vehicle, self._observer, len(first.time), p.safety_timer_s, p.safety_rest_s)
        self.wheels.begin(first)


_plan_of = rebuilder(Plan(weights_of(1), np.zeros(1), np.zeros(1), np.zeros((1, 1))))


@loop
def _control(settings: np.ndarray, plan: Any, state: Any, given: Any) -> None:
    """Write the commands of all N stops into the plan."""
    memory, c, own = memory_of(state), constants_of(given), _plan_of(plan)
    for i in range(len(settings)):
        row = settings[i]
        s = Settings(row[0], row[1], row[2], row[3], row[4], row[5], row[6])
        _think(i, s, own, memory, c)
        for k in range(own.command.shape[1]):
            wanted = _wanted(i, k, s, own, memory, c)
            command = _towards(wanted, i, k, s, own, memory, c)
            own.command[i, k] = APPLIES if _rolls(i, k, memory) else command


@inlined
def _rolls(i: int, k: int, memory: Memory) -> bool:
    """Whether axle k has not slid for seconds and is not released for the running speed's sake: it is braked."""
    slip = max(memory.filtered.recent_slip[i, k], memory.filtered.slow_slip[i, k])
    rolls = slip < max(ROLLS_CREEPAGE * memory.estimate.speed[i], ROLLS_MPS)
    return rolls and not memory.estimate.doubtful[i]


@inlined
def _think(i: int, s: Settings, own: Plan, memory: Memory, c: ObserverConstants) -> None:
    """Look anew, from time to time, at which slip is worth its price."""
    own.since[i] += c.estimator.interval
    if own.since[i] < PLAN_S - 1e-9:
        return
    own.since[i] = 0.0
    believe(i, memory.rail, own.weights)
    offered = c.estimator.full_brake * memory.estimate.demand[i]
    speed = max(memory.estimate.speed[i], 0.1)
    target = slip_worth_its_price(i, speed, offered, s.slide_price, memory.rail, own.weights, c.rail)
    own.target[i] = max(target, s.smallest_slip_mps)


@inlined
def _wanted(i: int, k: int, s: Settings, own: Plan, memory: Memory, c: ObserverConstants) -> float:
    """Return the brake, as the adhesion that it asks for, which brings the slip of axle k to the target."""
    e, target = memory.estimate, own.target[i]
    if k < s.leading_axles:
        target = max(target, s.leading_creepage * e.speed[i])
    per_adhesion = c.estimator.axle_weight / c.estimator.rotating  # of the wheel's acceleration [m/s2]
    mean = 0.0
    for j in range(own.command.shape[1]):
        mean += e.adhesion[i, j] / own.command.shape[1]
    deceleration = e.mass_ratio[i] * _GRAVITY_MPS2 * mean + e.other[i]
    used, slip = e.adhesion[i, k], e.speed[i] - e.wheel[i, k]
    ahead = c.estimator.interval * e.commands.shape[1]
    coming = 0.5 * c.estimator.full_brake * (e.pressure[i, k] + e.pressure_to_come[i, k])
    rate = per_adhesion * (coming - used) - deceleration
    grip = per_adhesion * used / max(slip, _LEAST_SLIP_MPS) if slip < target else 0.0  # a secant; past the peak next to none
    slip += ahead * rate / (1.0 + ahead * max(grip, 0.0))  # when the next command acts
    return used + ((target - slip) / s.settling_s + deceleration) / per_adhesion


@inlined
def _towards(
    wanted: float, i: int, k: int, s: Settings, own: Plan, memory: Memory, c: ObserverConstants
) -> float:  # fmt: skip
    """Return the command that brings the brake to the wanted one, or lets it be."""
    e, full = memory.estimate, c.estimator.full_brake
    held, offered = full * e.pressure_to_come[i, k], full * e.distributor[i]
    band = s.dead_band * max(wanted, 0.0)
    last = own.command[i, k]
    up = s.reached_share * band if last > 0.5 else band
    down = s.reached_share * band if last < -0.5 else band
    if wanted >= offered:
        return APPLIES
    if wanted > held + max(up, 0.5 * c.estimator.fill * (offered - held)):
        return APPLIES
    if wanted < held - max(down, 0.5 * c.estimator.vent * held):
        return VENTS
    return HOLDS
