"""What laws that know one friction coefficient share: the friction of a contaminated rail, and slip and load within bounds."""

from wsp_env.compiled import inlined
from wsp_env.contact.traction import LOAD_FLOOR, SPEED_FLOOR, Surface


@inlined
def kinetic_friction(on: Surface) -> float:
    """Kinetic friction coefficient [-] between mu_cr (clean) and mu_cd, in proportion to the layer (linear: assumption)."""
    return on.mu_cr - min(on.layer + on.held, 1.0) * (on.mu_cr - on.mu_cd)


@inlined
def bounded(slip_speed: float, speed: float, normal_load: float) -> tuple[float, float, float, float]:
    """Return |s| [m/s], 1 / v [s/m], its derivative by v [s2/m2] and the load [N], finite at standstill and without load."""
    rolling = abs(speed)
    per_speed = 1.0 / max(rolling, SPEED_FLOOR)
    return abs(slip_speed), per_speed, -per_speed * per_speed if rolling > SPEED_FLOOR else 0.0, max(normal_load, LOAD_FLOOR)
