"""Friction of a contaminated rail for laws that know one friction coefficient."""

from wsp_env.compiled import inlined
from wsp_env.contact.traction import Surface


@inlined
def kinetic_friction(on: Surface) -> float:
    """Kinetic friction coefficient [-] between mu_cr (clean) and mu_cd, in proportion to the layer (linear: assumption)."""
    return on.mu_cr - min(on.layer + on.held, 1.0) * (on.mu_cr - on.mu_cd)
