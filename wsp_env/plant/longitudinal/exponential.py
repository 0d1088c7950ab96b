"""The exponential Rosenbrock-Euler step of a wheelset's slip speed; see `wsp_env.plant.longitudinal.step`."""

import math

from wsp_env.compiled import inlined


@inlined
def _phi(z: float) -> tuple[float, float]:
    """phi_1(z) = (e^z - 1) / z and phi_2(z) = (phi_1(z) - 1) / z, by series where they would cancel."""
    if abs(z) < 1e-3:
        return 1.0 + z * (0.5 + z / 6.0), 0.5 + z * (1.0 / 6.0 + z / 24.0)
    phi_1 = (math.exp(z) - 1.0) / z
    return phi_1, (phi_1 - 1.0) / z


@inlined
def slip_growth(force: float, torque: float, deceleration: float, radius: float, inertia: float) -> float:
    """Rate of the slip speed [m/s2]."""
    return -deceleration - radius * (radius * force - torque) / inertia


@inlined
def slip_drift(slope_v: float, torque_rate: float, deceleration: float, jerk: float, radius: float, inertia: float) -> float:
    """Rate of that rate at a constant slip speed [m/s3]."""
    return -jerk + radius * (radius * slope_v * deceleration + torque_rate) / inertia


@inlined
def slip_after(h: float, slip: float, growth: float, rate: float, drift: float) -> float:
    """Slip speed [m/s] after h [s] of the exponential Rosenbrock-Euler step; `rate` is L [1/s], see the module."""
    phi_1, phi_2 = _phi(h * rate)
    return slip + h * (phi_1 * growth + h * phi_2 * drift)
