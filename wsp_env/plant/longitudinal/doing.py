"""What axles and vehicle are doing in a substep of the plant, for the mechanisms that ask."""

from wsp_env.compiled import inlined
from wsp_env.plant.card import Doing, Moment
from wsp_env.plant.components import brake
from wsp_env.plant.longitudinal.state import PlantConstants, State
from wsp_env.plant.port import Conditions


@inlined
def moment(i: int, h: float, deceleration: float, state: State, p: PlantConstants) -> Moment:
    """Return what the vehicle is doing h [s] after the start of a substep, which it began with `deceleration` [m/s2]."""
    pressure = 0.0
    for k in range(state.wheel_speed.shape[1]):
        pressure += state.brake.pressure[i, k]
    braking = pressure / (p.brake.full_pressure * state.wheel_speed.shape[1])
    return Moment(state.time[i] + h, state.position[i] + h * state.speed[i], deceleration, braking)


@inlined
def _mean_wheel_speed(i: int, state: State) -> float:
    """Mean speed of the wheelsets of vehicle i [rad/s]."""
    total = 0.0
    for k in range(state.wheel_speed.shape[1]):
        total += state.wheel_speed[i, k]
    return total / state.wheel_speed.shape[1]


@inlined
def doing(
    i: int, k: int, h: float, since: float, pressure: float, deceleration: float, state: State, c: Conditions, p: PlantConstants
) -> Doing:  # fmt: skip
    """Return what axle k is doing h [s] after the start of a substep, at a cylinder pressure [bar].

    `since` is the time since mechanisms were brought up to date [s].
    """
    speed, wheel, rate, radius = state.speed[i], state.wheel_speed[i, k], state.wheel_rate[i, k], c.radius[i, k]
    return Doing(
        state.time[i] + h, since, speed, deceleration, wheel, rate, speed - radius * wheel, -deceleration - radius * rate,
        state.position[i] - p.axle_offset[k] + h * speed, state.tachometer.angle[i, k] + h * wheel, radius,
        float(state.wheel_speed.shape[1]), _mean_wheel_speed(i, state), brake.torque(pressure, 1.0, p.brake),
        brake.torque(p.brake.full_pressure, 1.0, p.brake), state.contact_work[i, k], 0.0,
    )  # fmt: skip
