"""What a traction law takes and gives: the records that every contact law shares."""

from collections.abc import Callable
from typing import Any, NamedTuple

#: Running speed [m/s] below which the creepage is taken as s / SPEED_FLOOR: keeps e finite at standstill, where it is
#: undefined. The contact then acts as a stiff damper, so that the friction vanishes with the slip.
SPEED_FLOOR = 1e-3

#: Least load [N] that a law computes with: a lifted wheel transmits nothing, its adhesion coefficient stays finite.
LOAD_FLOOR = 1e-6


class Surface(NamedTuple):
    """What one wheel finds on the rail.

    The contaminant layer is what lies between wheel and rail and lowers the friction (water, leaves, oil). `layer` and `held`
    are shares of it, 0 (clean) to 1; the friction work of this wheel acts on `layer` only.
    """

    mu_cd: float  # kinetic friction coefficient with the layer [-]
    mu_cr: float  # the same of the clean rail [-]
    layer: float = 1.0  # share of the contaminant layer that this wheel's work acts on [-]
    held: float = 0.0  # share that lags behind it, for a mechanism that remembers [-]


class Adhesion(NamedTuple):
    """The law at one state, with its derivatives; all for |s|, the caller puts the sign back."""

    f: float  # adhesion coefficient T / N [-]
    f_d: float  # its limit without recovery [-]
    f_r: float  # its limit after full recovery [-]
    df_ds: float  # derivative with respect to the slip speed at constant speed [s/m]
    df_dv: float  # derivative with respect to the running speed at constant slip speed [s/m]
    kept: float  # share of the layer that this wheel's own work leaves, 1 - lambda(W_sp) [-]


class TractionLaw(NamedTuple):
    """A contact law as the plant takes it.

    Every record has a field `mu_cr`, the kinetic friction coefficient of the clean rail [-]. A mechanism on the law needs the
    fields that it changes, such as `stiffness`, or `gamma_d` and `ratio_d`; a law without them refuses that mechanism.

    `evaluate(slip_speed [m/s], speed [m/s], normal_load [N], surface, tau [m/J], record)` is a compiled function of scalars
    that returns an `Adhesion`. `make(contact)` builds the record, a NamedTuple of floats, from `ContactParameters`.
    `several`, where that is faster, evaluates many contacts at once, see `wsp_env.contact.port.tractions`.
    """

    name: str
    summary: str
    record: type[Any]
    evaluate: Callable[..., Adhesion]
    make: Callable[[Any], Any]
    several: Callable[..., None] | None = None
